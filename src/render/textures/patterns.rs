//! The pattern of each surface: what tints multiply. Alpha is dullness, 255 for no gloss at all.

use super::noise::{hash, octaves, value};
use crate::city::scene::Surface;

type Texel = ([f32; 3], f32);

/// RGBA texels of a layer, row by row with v growing.
pub(super) fn pattern(layer: u8, size: u32) -> Vec<u8> {
    let draw: fn([f32; 2]) -> Texel = match layer {
        l if l == Surface::Asphalt as u8 => asphalt,
        l if l == Surface::Grass as u8 => grass,
        l if l == Surface::Slabs as u8 => slabs,
        l if l == Surface::Concrete as u8 => concrete,
        l if l == Surface::Paint as u8 => paint,
        l if l == Surface::Brick as u8 => brick,
        l if l == Surface::Windows as u8 => windows,
        l if l == Surface::Glazing as u8 => glazing,
        l if l == Surface::Shopfront as u8 => shopfront,
        l if l == Surface::RoofTiles as u8 => roof_tiles,
        l if l == Surface::Gravel as u8 => gravel,
        l if l == Surface::Leaves as u8 => leaves,
        l if l == Surface::Wood as u8 => wood,
        l if l == Surface::Water as u8 => water,
        l if l == Surface::Sand as u8 => sand,
        l if l == Surface::Flowers as u8 => flowers,
        l if l == Surface::Glass as u8 => |_| ([0.10, 0.13, 0.16], 0.1),
        l if l == Surface::Metal as u8 => |_| ([1.0; 3], 0.7),
        _ => |_| ([1.0; 3], 1.0),
    };
    let mut texels = Vec::with_capacity((size * size * 4) as usize);
    for y in 0..size {
        for x in 0..size {
            let (colour, dull) = draw([x, y].map(|k| (k as f32 + 0.5) / size as f32));
            texels.extend(colour.iter().chain([&dull]).map(|c| (c.clamp(0.0, 1.0) * 255.0).round() as u8));
        }
    }
    texels
}

fn grey(level: f32) -> Texel {
    ([level; 3], 1.0)
}

fn asphalt(at: [f32; 2]) -> Texel {
    let grain = value(at, [128, 128], 1) - 0.5;
    let stone = if value(at, [90, 90], 7) > 0.86 { 0.10 } else { 0.0 };
    grey(0.82 + 0.16 * grain + 0.16 * (octaves(at, [4, 4], 4, 2) - 0.5) + stone)
}

fn grass(at: [f32; 2]) -> Texel {
    let blades = value(at, [96, 64], 11) - 0.5;
    let tufts = octaves(at, [6, 6], 4, 12) - 0.5;
    let level = 0.80 + 0.30 * blades + 0.34 * tufts;
    ([level * (1.0 + 0.12 * tufts), level, level * (0.92 - 0.2 * tufts)], 1.0)
}

/// Joint lines of a bond: 0 in a joint to 1 inside, and a number of the piece.
fn bond([u, v]: [f32; 2], columns: i32, rows: i32, joint: [f32; 2], shift: f32) -> (f32, i32) {
    let row = (v * rows as f32).floor();
    let x = u * columns as f32 + if row as i32 % 2 == 0 { 0.0 } else { shift };
    let (fx, fy) = (x.fract(), (v * rows as f32).fract());
    let away = |f: f32, width: f32| ((f.min(1.0 - f) / width).min(1.0)).powi(2);
    let column = (x.floor() as i32).rem_euclid(columns);
    (away(fx, joint[0]).min(away(fy, joint[1])), column + row as i32 * columns)
}

fn slabs(at: [f32; 2]) -> Texel {
    let (inside, piece) = bond(at, 4, 4, [0.035, 0.035], 0.5);
    let tone = 0.88 + 0.10 * (hash(piece, 3, 5) - 0.5) + 0.08 * (octaves(at, [16, 16], 3, 21) - 0.5);
    grey(tone * (0.70 + 0.30 * inside))
}

fn concrete(at: [f32; 2]) -> Texel {
    grey(0.90 + 0.10 * (octaves(at, [8, 8], 4, 31) - 0.5) + 0.06 * (value(at, [100, 100], 33) - 0.5))
}

fn paint(at: [f32; 2]) -> Texel {
    let worn = (octaves(at, [10, 10], 4, 41) - 0.56).max(0.0);
    grey(0.96 - 0.5 * worn + 0.05 * (value(at, [90, 90], 43) - 0.5))
}

fn brick(at: [f32; 2]) -> Texel {
    let (inside, piece) = bond(at, 8, 24, [0.03, 0.09], 0.5);
    let tone = 0.78 + 0.16 * (hash(piece, 9, 6) - 0.5) + 0.10 * (value(at, [80, 80], 51) - 0.5);
    let joint = 1.0 - inside.min(1.0);
    (std::array::from_fn(|k| tone + ([0.98, 0.97, 0.95][k] - tone) * joint), 1.0)
}

/// Soft edge of a rectangle: 1 inside, 0 outside.
fn within([u, v]: [f32; 2], [left, right]: [f32; 2], [low, high]: [f32; 2]) -> bool {
    u > left && u < right && v > low && v < high
}

/// Panes reflect the sky: brighter towards the top, with a faint slanted sheen.
fn pane([u, v]: [f32; 2], seed: i32) -> Texel {
    let sheen = if ((u * 1.2 + v + hash(seed, 1, 2)) * 3.0).fract() < 0.35 { 0.05 } else { 0.0 };
    let level = 0.10 + 0.16 * v + sheen;
    ([level * 0.72, level * 0.95, level * 1.18], 0.12)
}

fn render_wall(at: [f32; 2]) -> f32 {
    0.93 + 0.06 * (octaves(at, [12, 12], 4, 61) - 0.5)
}

fn windows(at: [f32; 2]) -> Texel {
    let [u, v] = at;
    let wall = render_wall(at);
    if within(at, [0.30, 0.70], [0.30, 0.80]) {
        let frame =
            !within(at, [0.325, 0.675], [0.325, 0.775]) || (u - 0.5).abs() < 0.012 || (v - 0.62).abs() < 0.01;
        return if frame { ([0.95, 0.95, 0.93], 1.0) } else { pane([u, (v - 0.3) * 2.0], 1) };
    }
    if within(at, [0.27, 0.73], [0.262, 0.30]) {
        return grey(0.80);
    }
    if within(at, [0.28, 0.72], [0.80, 0.835]) {
        return grey(0.72);
    }
    // A floor band, and the shade under the sill.
    let band = if v < 0.03 { 0.86 } else { 1.0 };
    let shade = if within(at, [0.28, 0.74], [0.235, 0.262]) { 0.84 } else { 1.0 };
    grey(wall * band * shade)
}

fn glazing(at: [f32; 2]) -> Texel {
    let [u, v] = at;
    if v < 0.22 {
        return grey(if !(0.02..=0.2).contains(&v) { 0.62 } else { render_wall(at) });
    }
    let mullion = !(0.03..=0.97).contains(&u) || (u - 0.5).abs() < 0.014 || v > 0.975;
    if mullion { grey(0.42) } else { pane([u, (v - 0.2) * 1.25], if u < 0.5 { 3 } else { 4 }) }
}

fn shopfront(at: [f32; 2]) -> Texel {
    let [u, v] = at;
    if v > 0.86 {
        // The board above the window takes the tint at full strength.
        return grey(if !(0.875..=0.985).contains(&v) { 0.55 } else { 1.0 });
    }
    if v < 0.12 || !(0.04..=0.96).contains(&u) {
        return ([0.30, 0.29, 0.28], 1.0);
    }
    if (u - 0.5).abs() < 0.012 || (v - 0.70).abs() < 0.008 || !within(at, [0.055, 0.945], [0.135, 0.85]) {
        return ([0.16, 0.16, 0.17], 1.0);
    }
    // Warm light inside, goods as dim shapes.
    let (x, y) = ((u * 14.0) as i32, (v * 9.0) as i32);
    let goods = if v < 0.5 && hash(x, y, 71) > 0.45 { 0.16 * hash(x, y, 72) } else { 0.0 };
    let (mut colour, _) = pane([u, v], 5);
    colour[0] += 0.12 + goods;
    colour[1] += 0.08 + goods * 0.8;
    colour[2] += 0.02 + goods * 0.6;
    (colour, 0.2)
}

fn roof_tiles(at: [f32; 2]) -> Texel {
    let [u, v] = at;
    let row = (v * 12.0).floor();
    let x = u * 12.0 + if row as i32 % 2 == 0 { 0.0 } else { 0.5 };
    let piece = (x.floor() as i32).rem_euclid(12) + row as i32 * 12;
    let (fx, fy) = (x.fract(), (v * 12.0).fract());
    let round = 1.0 - 0.30 * (2.0 * fx - 1.0).powi(4);
    let overlap = if fy < 0.16 { 0.62 } else { 0.86 + 0.14 * fy };
    grey((0.84 + 0.22 * (hash(piece, 4, 81) - 0.5)) * round * overlap)
}

fn gravel(at: [f32; 2]) -> Texel {
    grey(0.80 + 0.34 * (value(at, [110, 110], 91) - 0.5) + 0.12 * (octaves(at, [6, 6], 3, 92) - 0.5))
}

fn leaves(at: [f32; 2]) -> Texel {
    let clumps = octaves(at, [10, 10], 4, 101);
    let glints = value(at, [72, 72], 103);
    let level = 0.36 + 0.95 * (clumps - 0.25) + 0.30 * (glints - 0.5);
    ([level * (0.92 + 0.16 * clumps), level, level * 0.86], 1.0)
}

fn wood(at: [f32; 2]) -> Texel {
    let [u, v] = at;
    let grain = value([u, v], [6, 64], 111) - 0.5;
    let gap = if (v * 4.0).fract() < 0.05 { 0.55 } else { 1.0 };
    grey((0.86 + 0.25 * grain) * gap)
}

fn water(at: [f32; 2]) -> Texel {
    let ripple = octaves(at, [8, 14], 4, 121) - 0.5;
    ([0.80 + 0.25 * ripple, 0.88 + 0.22 * ripple, 0.92 + 0.2 * ripple], 0.12)
}

fn sand(at: [f32; 2]) -> Texel {
    grey(0.90 + 0.12 * (value(at, [120, 120], 131) - 0.5) + 0.10 * (octaves(at, [5, 5], 4, 132) - 0.5))
}

fn flowers(at: [f32; 2]) -> Texel {
    let (x, y) = ((at[0] * 22.0) as i32, (at[1] * 22.0) as i32);
    let (fx, fy) = ((at[0] * 22.0).fract() - 0.5, (at[1] * 22.0).fract() - 0.5);
    let pick = hash(x, y, 141);
    let petal = fx * fx + fy * fy < 0.03 + 0.12 * hash(x, y, 142);
    if petal && pick < 0.62 {
        const PETALS: [[f32; 3]; 4] =
            [[0.93, 0.26, 0.30], [0.97, 0.80, 0.22], [0.94, 0.92, 0.90], [0.62, 0.34, 0.72]];
        return (PETALS[(pick / 0.62 * 4.0) as usize % 4], 1.0);
    }
    let level = 0.26 + 0.22 * value(at, [64, 64], 143);
    ([level * 0.62, level, level * 0.45], 1.0)
}
