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
    let (x, y) = (u * cells[0] as f32, v * cells[1] as f32);
    let (ix, iy) = (x.floor(), y.floor());
    let smooth = |t: f32| t * t * (3.0 - 2.0 * t);
    let (fx, fy) = (smooth(x - ix), smooth(y - iy));
    let at = |dx: i32, dy: i32| {
        hash((ix as i32 + dx).rem_euclid(cells[0]), (iy as i32 + dy).rem_euclid(cells[1]), seed)
    };
    let (a, b) = (at(0, 0) + (at(1, 0) - at(0, 0)) * fx, at(0, 1) + (at(1, 1) - at(0, 1)) * fx);
    a + (b - a) * fy
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
