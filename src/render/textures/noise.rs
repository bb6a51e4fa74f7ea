//! Noise that repeats without a seam.

use crate::geom::scatter;

/// A well-mixed number in [0, 1) for a lattice point.
pub(super) fn hash(x: i32, y: i32, seed: u32) -> f32 {
    scatter::unit(
        (x as u32).wrapping_mul(0x9E37_79B1)
            ^ (y as u32).wrapping_mul(0x85EB_CA77)
            ^ seed.wrapping_mul(0xC2B2_AE3D),
    )
}

/// Value noise in [0, 1] with period 1 in u and v, `cells` lattice cells along each.
pub(super) fn value([u, v]: [f32; 2], cells: [i32; 2], seed: u32) -> f32 {
    let ([x0, x1], fx) = lattice(u * cells[0] as f32, cells[0]);
    let ([y0, y1], fy) = lattice(v * cells[1] as f32, cells[1]);
    let (a, b) = (hash(x0, y0, seed), hash(x0, y1, seed));
    let (a, b) = (a + (hash(x1, y0, seed) - a) * fx, b + (hash(x1, y1, seed) - b) * fx);
    a + (b - a) * fy
}

/// The lattice points on both sides of a place, and how far it lies between them, smoothed. Start-up asks some
/// ten million times: no division, no call.
fn lattice(x: f32, cells: i32) -> ([i32; 2], f32) {
    let whole = x as i32;
    let below = whole - i32::from((whole as f32) > x);
    let t = x - below as f32;
    let first = if (0..cells).contains(&below) { below } else { below.rem_euclid(cells) };
    let second = if first + 1 == cells { 0 } else { first + 1 };
    ([first, second], t * t * (3.0 - 2.0 * t))
}

/// Octaves of [`value`], each twice as fine and half as strong; about 0.5 on average.
pub(super) fn octaves(at: [f32; 2], cells: [i32; 2], count: u32, seed: u32) -> f32 {
    let (mut sum, mut weight, mut total) = (0.0, 1.0, 0.0);
    for k in 0..count {
        sum += weight * value(at, cells.map(|c| c << k), seed + k);
        total += weight;
        weight *= 0.55;
    }
    sum / total
}
