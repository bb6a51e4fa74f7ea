//! Tileable value noise and its octaves.

use city3d_geometry::hash;

/// Hash of a lattice point to [0, 1).
pub(super) fn hash(x: i32, y: i32, seed: u32) -> f32 {
    hash::unit_f32(
        (x as u32).wrapping_mul(0x9E37_79B1)
            ^ (y as u32).wrapping_mul(0x85EB_CA77)
            ^ seed.wrapping_mul(0xC2B2_AE3D),
    )
}

/// Permutation table for lattice noise, looked up for one axis after the other. Start-up takes some ten million
/// lookups; a hash would take twice as long.
const ORDER: [u8; 256] = {
    let mut order = [0; 256];
    let mut k = 0;
    while k < 256 {
        order[k] = k as u8;
        k += 1;
    }
    // Fisher-Yates shuffle by a linear congruential generator.
    let mut state: u32 = 0x2545_F491;
    while k > 1 {
        k -= 1;
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let other = ((state >> 16) as usize) % (k + 1);
        let kept = order[k];
        order[k] = order[other];
        order[other] = kept;
    }
    order
};

fn ordered(number: u32) -> u32 {
    u32::from(ORDER[(number & 255) as usize])
}

/// Value noise in [0, 1] with period 1 in u and v, `cells` lattice cells along each (Perlin 1985).
pub(super) fn value([u, v]: [f32; 2], cells: [i32; 2], seed: u32) -> f32 {
    let ([x0, x1], fx) = lattice(u * cells[0] as f32, cells[0]);
    let ([y0, y1], fy) = lattice(v * cells[1] as f32, cells[1]);
    let seed = ordered(seed) + (seed >> 8);
    let columns = [x0, x1].map(|x| ordered(x as u32 + seed) + ((x as u32) >> 8));
    let at = |column: u32, y: i32| ordered(column + y as u32) as f32;
    let [a, b] = [y0, y1].map(|y| {
        let [left, right] = columns.map(|column| at(column, y));
        left + (right - left) * fx
    });
    (a + (b - a) * fy) * (1.0 / 255.0)
}

/// Lattice points on both sides of `x`, and the smoothstep weight of the second. Avoids divisions and calls.
fn lattice(x: f32, cells: i32) -> ([i32; 2], f32) {
    let whole = x as i32;
    let below = whole - i32::from((whole as f32) > x);
    let t = x - below as f32;
    let first = if (0..cells).contains(&below) { below } else { below.rem_euclid(cells) };
    let second = if first + 1 == cells { 0 } else { first + 1 };
    ([first, second], t * t * (3.0 - 2.0 * t))
}

/// Fractal sum of octaves of [`value`], each twice as fine and about half as strong; mean about 0.5.
pub(super) fn octaves(at: [f32; 2], cells: [i32; 2], count: u32, seed: u32) -> f32 {
    let (mut sum, mut weight, mut total) = (0.0, 1.0, 0.0);
    for k in 0..count {
        sum += weight * value(at, cells.map(|c| c << k), seed + k);
        total += weight;
        weight *= 0.55;
    }
    sum / total
}
