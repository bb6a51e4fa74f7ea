//! Procedural texture of each surface, which vertex colours multiply. Alpha is roughness: 255 for fully matt.

use super::noise::{hash, octaves, value};
use super::{facades, glyphs};
use city3d_scene::Surface;

/// Colour and roughness, each from 0 to 1.
pub(super) type Texel = ([f32; 3], f32);

/// RGBA texels of a layer, row by row with v growing.
pub(super) fn pattern(layer: u8, size: u32) -> Vec<u8> {
    let draw: fn([f32; 2]) -> Texel = match layer {
        l if l == Surface::Asphalt as u8 => asphalt,
        l if l == Surface::Grass as u8 => grass,
        l if l == Surface::Slabs as u8 => slabs,
        l if l == Surface::Concrete as u8 => concrete,
        l if l == Surface::Paint as u8 => paint,
        l if l == Surface::Brick as u8 => brick,
        l if l == Surface::Windows as u8 => facades::windows,
        l if l == Surface::Glazing as u8 => facades::glazing,
        l if l == Surface::Shopfront as u8 => facades::shopfront,
        l if l == Surface::Boutique as u8 => facades::boutique,
        l if l == Surface::Tearoom as u8 => facades::tearoom,
        l if l == Surface::RoofTiles as u8 => roof_tiles,
        l if l == Surface::Gravel as u8 => gravel,
        l if l == Surface::Leaves as u8 => leaves,
        l if l == Surface::Wood as u8 => wood,
        l if l == Surface::Water as u8 => water,
        l if l == Surface::Sand as u8 => sand,
        l if l == Surface::Flowers as u8 => flowers,
        l if l == Surface::Lane as u8 => lane,
        l if l == Surface::Patch as u8 => patch,
        l if l == Surface::Manhole as u8 => manhole,
        l if l == Surface::Sash as u8 => facades::sash,
        l if l == Surface::Shutters as u8 => facades::shutters,
        l if l == Surface::Balcony as u8 => facades::balcony,
        l if l == Surface::Door as u8 => facades::door,
        l if l == Surface::Gate as u8 => facades::gate,
        l if l == Surface::Letters as u8 => glyphs::letters,
        l if l == Surface::Signs as u8 => glyphs::signs,
        l if l == Surface::Setts as u8 => setts,
        l if l == Surface::Needles as u8 => needles,
        l if l == Surface::Awning as u8 => awning,
        l if l == Surface::CarPaint as u8 => |_| ([1.0; 3], 0.5),
        l if l == Surface::Glass as u8 => |_| ([0.10, 0.13, 0.16], 0.1),
        l if l == Surface::Metal as u8 => |_| ([1.0; 3], 0.7),
        _ => |_| ([1.0; 3], 1.0),
    };
    // Outlines of signs run across texels: each is the mean of several points.
    let points = if layer == Surface::Signs as u8 { 3 } else { 1 };
    let mut texels = Vec::with_capacity((size * size * 4) as usize);
    for y in 0..size {
        for x in 0..size {
            let (colour, dull) = mean_of(draw, [x, y].map(|k| k * points), points, size * points);
            texels.extend(colour.iter().chain([&dull]).map(|c| (c.clamp(0.0, 1.0) * 255.0 + 0.5) as u8));
        }
    }
    texels
}

/// Mean of a square of points, whose corner is this one of a lattice.
fn mean_of(draw: fn([f32; 2]) -> Texel, corner: [u32; 2], points: u32, lattice: u32) -> Texel {
    let (mut colour, mut dull) = ([0.0; 3], 0.0);
    for k in 0..points * points {
        let point = [corner[0] + k % points, corner[1] + k / points];
        let (own, own_dull) = draw(point.map(|k| (k as f32 + 0.5) / lattice as f32));
        colour = std::array::from_fn(|c| colour[c] + own[c]);
        dull += own_dull;
    }
    let count = (points * points) as f32;
    (colour.map(|c| c / count), dull / count)
}

pub(super) fn grey(level: f32) -> Texel {
    ([level; 3], 1.0)
}

/// Grain, stones, stains and fine cracks; the mean equals that of [`lane`].
fn asphalt(at: [f32; 2]) -> Texel {
    let broad = octaves(at, [3, 3], 4, 2) - 0.5;
    grey(0.80 + grain(at, [150, 150]) + 0.16 * broad - 0.16 * crack(at, [5, 5]))
}

fn grain(at: [f32; 2], cells: [i32; 2]) -> f32 {
    let stone = if value(at, cells.map(|c| c * 3 / 5), 7) > 0.84 { 0.09 } else { 0.0 };
    0.15 * (value(at, cells, 1) - 0.5) + stone
}

/// 1 on thin cracks in some places, 0 elsewhere.
fn crack(at: [f32; 2], cells: [i32; 2]) -> f32 {
    let line = (octaves(at, cells, 3, 301) - 0.5).abs();
    let there = ((value(at, [3, 3], 305) - 0.62) * 6.0).clamp(0.0, 1.0);
    (1.0 - line / 0.008).max(0.0) * there
}

/// u across the lane, v along it: tyres polish two tracks, oil drips between them.
fn lane(at: [f32; 2]) -> Texel {
    let [u, v] = at;
    // Gaussian profile of a tyre track.
    let near = |track: f32| (-((u - track) / 0.085).powi(2)).exp();
    let wander = 0.02 * (value([0.0, v], [1, 6], 311) - 0.5);
    let tracks = near(0.27 + wander) + near(0.73 + wander);
    let oil = (-((u - 0.5) / 0.07).powi(2)).exp() * (0.35 + 0.65 * value(at, [6, 20], 313));
    // Fades to plain asphalt at the edges.
    let inside = (1.0 - (2.0 * u - 1.0).abs().powi(6)).max(0.0);
    let broad = octaves(at, [3, 8], 4, 315) - 0.5;
    let level = 0.80 + grain(at, [110, 300]) + 0.14 * broad
        - inside * (0.10 * tracks + 0.09 * oil - 0.05)
        - 0.20 * crack([u, v], [3, 10]) * inside;
    grey(level)
}

fn patch(at: [f32; 2]) -> Texel {
    let [u, v] = at;
    let rim = u.min(1.0 - u).min(v.min(1.0 - v));
    let seal = rim < 0.012 + 0.02 * value(at, [12, 12], 321);
    grey(if seal { 0.50 } else { 0.71 + grain(at, [100, 100]) })
}

fn manhole(at: [f32; 2]) -> Texel {
    let [x, y] = at.map(|c| 2.0 * c - 1.0);
    let r = x.hypot(y);
    match r {
        r if r > 0.90 => grey(0.80 + grain(at, [40, 40])),
        r if r > 0.84 => grey(0.42),
        r if r > 0.74 => grey(0.66),
        r if r > 0.70 => grey(0.36),
        _ => {
            let stud =
                ((x * 7.0).fract().abs() - 0.5).abs() < 0.32 && ((y * 7.0).fract().abs() - 0.5).abs() < 0.32;
            ([0.56, 0.55, 0.53].map(|c: f32| if stud { c + 0.10 } else { c - 0.12 }), 0.85)
        }
    }
}

fn grass(at: [f32; 2]) -> Texel {
    let blades = value(at, [128, 96], 11) - 0.5;
    let fine = value(at, [64, 128], 15) - 0.5;
    let tufts = octaves(at, [7, 7], 4, 12) - 0.5;
    let dry = ((octaves(at, [4, 4], 3, 17) - 0.54) * 5.0).clamp(0.0, 1.0);
    let level = 0.80 + 0.26 * blades + 0.16 * fine + 0.26 * tufts;
    (
        [
            level * (1.0 + 0.10 * tufts + 0.16 * dry),
            level * (1.0 + 0.02 * dry),
            level * (0.94 - 0.12 * tufts),
        ],
        1.0,
    )
}

/// Masonry bond: 0 in a joint to 1 inside a piece, and the number of the piece.
pub(super) fn bond([u, v]: [f32; 2], columns: i32, rows: i32, joint: [f32; 2], shift: f32) -> (f32, i32) {
    let row = (v * rows as f32).floor();
    let x = u * columns as f32 + if row as i32 % 2 == 0 { 0.0 } else { shift };
    let (fx, fy) = (x.fract(), (v * rows as f32).fract());
    let away = |f: f32, width: f32| ((f.min(1.0 - f) / width).min(1.0)).powi(2);
    let column = (x.floor() as i32).rem_euclid(columns);
    (away(fx, joint[0]).min(away(fy, joint[1])), column + row as i32 * columns)
}

fn slabs(at: [f32; 2]) -> Texel {
    let (inside, piece) = bond(at, 4, 6, [0.018, 0.027], 0.5);
    let tone = 0.86 + 0.13 * (hash(piece, 3, 5) - 0.5) + 0.10 * (octaves(at, [16, 16], 3, 21) - 0.5);
    let stain = 0.10 * ((octaves(at, [3, 3], 3, 25) - 0.55) * 4.0).clamp(0.0, 1.0);
    grey((tone - stain) * (0.66 + 0.34 * inside))
}

fn setts(at: [f32; 2]) -> Texel {
    let (inside, piece) = bond(at, 12, 12, [0.10, 0.10], 0.5);
    let tone = 0.80 + 0.24 * (hash(piece, 5, 8) - 0.5) + 0.10 * (value(at, [60, 60], 27) - 0.5);
    grey(tone * (0.58 + 0.42 * inside))
}

fn concrete(at: [f32; 2]) -> Texel {
    grey(0.90 + 0.10 * (octaves(at, [8, 8], 4, 31) - 0.5) + 0.06 * (value(at, [100, 100], 33) - 0.5))
}

fn paint(at: [f32; 2]) -> Texel {
    let worn = (octaves(at, [10, 10], 4, 41) - 0.56).max(0.0);
    grey(0.96 - 0.5 * worn + 0.05 * (value(at, [90, 90], 43) - 0.5))
}

pub(super) fn brick(at: [f32; 2]) -> Texel {
    let (inside, piece) = bond(at, 8, 24, [0.03, 0.09], 0.5);
    let tone = 0.78 + 0.16 * (hash(piece, 9, 6) - 0.5) + 0.10 * (value(at, [80, 80], 51) - 0.5);
    let joint = 1.0 - inside.min(1.0);
    (std::array::from_fn(|k| tone + ([0.98, 0.97, 0.95][k] - tone) * joint), 1.0)
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

/// Leaves as small ellipses of random brightness over dark gaps (cellular noise).
fn leaves(at: [f32; 2]) -> Texel {
    const CELLS: i32 = 26;
    let clumps = octaves(at, [5, 5], 3, 101);
    let mut level = 0.20 + 0.30 * clumps;
    let [x, y] = at.map(|c| c * CELLS as f32);
    let (ix, iy) = (x.floor() as i32, y.floor() as i32);
    for dy in -1..=1 {
        for dx in -1..=1 {
            let (cx, cy) = (ix + dx, iy + dy);
            let draw = |salt: u32| hash(cx.rem_euclid(CELLS), cy.rem_euclid(CELLS), 103 + salt);
            let (ox, oy) = (x - cx as f32 - draw(0), y - cy as f32 - draw(1));
            let (sin, cos) = (draw(2) * std::f32::consts::PI).sin_cos();
            let (a, b) = ((ox * cos + oy * sin) / 0.78, (oy * cos - ox * sin) / 0.40);
            if a * a + b * b < 1.0 {
                let light = 0.46 + 0.44 * draw(3) + 0.34 * (clumps - 0.5) - 0.10 * (a * a + b * b);
                level = level.max(light);
            }
        }
    }
    ([level * (0.90 + 0.14 * clumps), level, level * 0.82], 1.0)
}

fn needles(at: [f32; 2]) -> Texel {
    let tufts = value(at, [26, 14], 105);
    let fine = value(at, [96, 40], 107);
    let level = 0.34 + 0.52 * tufts * (0.5 + 0.5 * fine) + 0.20 * (octaves(at, [6, 6], 3, 109) - 0.5);
    ([level * 0.92, level, level * 0.94], 1.0)
}

fn awning([u, v]: [f32; 2]) -> Texel {
    let light = (u * 4.0).fract() < 0.5;
    let fold = 1.0 - 0.10 * (1.0 - v).powi(2);
    grey(if light { 1.0 } else { 0.42 } * fold)
}

fn wood(at: [f32; 2]) -> Texel {
    let [u, v] = at;
    let grain = value([u, v], [6, 64], 111) - 0.5;
    let gap = if (v * 4.0).fract() < 0.05 { 0.55 } else { 1.0 };
    grey((0.86 + 0.25 * grain) * gap)
}

fn water(at: [f32; 2]) -> Texel {
    let ripple = octaves(at, [6, 11], 4, 121) - 0.5;
    let glint = ((value(at, [40, 64], 123) - 0.80) * 3.0).max(0.0);
    let deep = 0.62 + 0.5 * ripple + 0.25 * glint;
    ([deep * 0.82, deep * 0.95, deep], 0.08)
}

fn sand(at: [f32; 2]) -> Texel {
    grey(0.90 + 0.12 * (value(at, [120, 120], 131) - 0.5) + 0.10 * (octaves(at, [5, 5], 4, 132) - 0.5))
}

/// Flowers among leaves, in clumps of one colour (Voronoi cells).
fn flowers(at: [f32; 2]) -> Texel {
    const PETALS: [[f32; 3]; 4] =
        [[0.80, 0.20, 0.24], [0.90, 0.72, 0.24], [0.88, 0.86, 0.82], [0.54, 0.34, 0.66]];
    /// Clumps and flowers along a repeat.
    const CLUMPS: i32 = 9;
    const FLOWERS: i32 = 42;
    let cell = |count: i32| at.map(|c| (c * count as f32).floor() as i32);
    let seed_of = |x: i32, y: i32, salt: u32| hash(x.rem_euclid(CLUMPS), y.rem_euclid(CLUMPS), salt);
    // The nearest clump.
    let [cx, cy] = cell(CLUMPS);
    let around = (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (cx + dx, cy + dy)));
    let squared = |(x, y): (i32, i32)| {
        let middle = [x as f32 + seed_of(x, y, 144), y as f32 + seed_of(x, y, 145)];
        [0, 1].map(|k| (middle[k] - at[k] * CLUMPS as f32).powi(2)).iter().sum::<f32>()
    };
    let nearest = around.map(|clump| (squared(clump), clump)).min_by(|a, b| a.0.total_cmp(&b.0));
    let (squared, (x, y)) = nearest.unwrap_or((0.0, (cx, cy)));
    let colour = PETALS[(seed_of(x, y, 146) * 4.0) as usize % 4];
    let [fx, fy] = cell(FLOWERS);
    let hash_to_unit = |salt: u32| hash(fx, fy, salt);
    let off = [at[0] * FLOWERS as f32 - fx as f32, at[1] * FLOWERS as f32 - fy as f32];
    let out = (off[0] - 0.3 - 0.4 * hash_to_unit(147)).hypot(off[1] - 0.3 - 0.4 * hash_to_unit(148));
    let radius = 0.22 + 0.20 * hash_to_unit(142);
    if out < radius && hash_to_unit(141) < 0.66 && squared < 0.62 * 0.62 {
        let tone = (0.80 + 0.30 * hash_to_unit(149)) * (1.0 - 0.35 * out / radius);
        return (colour.map(|c| c * tone), 1.0);
    }
    let level = 0.20 + 0.22 * value(at, [64, 64], 143);
    ([level * 0.66, level, level * 0.45], 1.0)
}
