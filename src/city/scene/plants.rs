//! Trees of several kinds and hedges.

use super::grounds::ring_of;
use super::mesh::{Class, Finish, Mesh, Surface, Vertex};
use super::{Level, Object, Place};
use crate::city::Shape;
use glam::{Vec2, Vec3};
use std::f32::consts::{PI, TAU};

const BARK: Finish = Finish::new(Surface::Wood, [104, 84, 66], Class::Vegetation);
const BIRCH: Finish = Finish::new(Surface::Wood, [206, 202, 192], Class::Vegetation);
const HEDGE: Finish = Finish::new(Surface::Leaves, [104, 128, 74], Class::Vegetation);

/// Greens of crowns.
const GREENS: [[u8; 3]; 6] =
    [[122, 142, 76], [104, 130, 72], [136, 148, 84], [98, 122, 78], [128, 138, 68], [116, 138, 92]];
/// Crowns that are not green.
const COPPER: [u8; 3] = [122, 92, 78];
/// How far crowns reach beyond the circle of the drawing, which stays clear of the lanes by more.
const REACH: f32 = 1.30;

/// Faces around a crown and from its bottom to its top, and around a trunk.
#[derive(Clone, Copy)]
pub(super) struct Leafage {
    around: u32,
    rings: u32,
    trunk: u32,
    has_limbs: bool,
}

impl Leafage {
    const NEAR: Self = Self { around: 11, rings: 7, trunk: 6, has_limbs: true };
    const MIDDLE: Self = Self { around: 7, rings: 4, trunk: 4, has_limbs: false };
    const DISTANT: Self = Self { around: 5, rings: 3, trunk: 3, has_limbs: false };
    /// For trees of a few pixels.
    const FAR: Self = Self { around: 4, rings: 3, trunk: 3, has_limbs: false };
}

/// A tree at all its levels of detail.
pub(super) fn tree_object(place: &Place<'_>) -> Object {
    let level = |(leafage, error_m)| {
        let mut mesh = Mesh::default();
        tree(&mut mesh, place, leafage);
        Level { mesh, error_m }
    };
    let levels =
        [(Leafage::NEAR, 0.0), (Leafage::MIDDLE, 0.15), (Leafage::DISTANT, 0.30), (Leafage::FAR, 0.7)];
    Object { levels: levels.map(level).to_vec() }
}

/// A clump of leaves: an ellipsoid with lumps.
#[derive(Clone, Copy)]
struct Clump {
    centre: Vec3,
    size: Vec3,
    /// How much of the size lumps add and take.
    rough: f32,
    /// How open its lowest leaves are.
    dark: f32,
    seed: u32,
}

/// A trunk and its crown; the drawing's circle is the crown's, the kind is drawn by lot.
fn tree(mesh: &mut Mesh, place: &Place<'_>, leafage: Leafage) {
    let Shape::Circle { centre, radius_m } = place.piece.shape else { return };
    let foot = centre.as_vec2().extend(0.06);
    let radius = radius_m as f32 * REACH;
    let green = GREENS[(place.dice(1) * GREENS.len() as f32) as usize % GREENS.len()];
    let colour = if place.dice(6) > 0.95 { COPPER } else { green };
    let leaves = Finish::new(Surface::Leaves, colour, Class::Vegetation);
    let scale = 0.88 + 0.34 * place.dice(2);
    let seed = place.seed;
    let clump = |centre, size, rough| Clump { centre, size, rough, dark: 0.42, seed };
    let turn = place.dice(4) * TAU;
    match place.dice(3) {
        // Round: maple, lime.
        d if d < 0.40 => {
            let height = (2.7 * radius + 2.0) * scale;
            let clear = 0.30 * height;
            trunk(mesh, foot, [0.06 * radius + 0.08, 0.05], clear + 0.5 * radius, leafage, BARK);
            limbs(mesh, foot, clear, radius, turn, leafage);
            let half = (height - clear) / 2.0;
            let middle = foot + Vec3::Z * (clear + half);
            blob(mesh, clump(middle, Vec3::new(radius, radius, half * 1.04), 0.26), leafage, leaves);
        }
        // Upright: poplar, hornbeam.
        d if d < 0.56 => {
            let height = (3.4 * radius + 3.0) * scale;
            trunk(mesh, foot, [0.12, 0.06], height * 0.4, leafage, BARK);
            let middle = foot + Vec3::Z * (height * 0.58);
            let size = Vec3::new(0.62 * radius, 0.62 * radius, height * 0.43);
            blob(mesh, clump(middle, size, 0.16), leafage, leaves.shaded(1.04));
        }
        // Birch: a white trunk, loose clumps one above the other.
        d if d < 0.70 => {
            let height = (3.2 * radius + 2.6) * scale;
            trunk(mesh, foot, [0.10, 0.05], height * 0.7, leafage, BIRCH);
            let (sin, cos) = turn.sin_cos();
            let lean = Vec3::new(cos, sin, 0.0) * (0.16 * radius);
            for (up, wide, tall) in [(0.48, 0.80, 0.24), (0.72, 0.58, 0.26)] {
                let middle = foot + Vec3::Z * (height * up) + if up < 0.5 { lean } else { -lean };
                let size = Vec3::new(wide * radius, wide * radius, tall * height);
                blob(mesh, clump(middle, size, 0.30), leafage, leaves.shaded(1.08));
            }
        }
        // Conifers of tiers.
        d if d < 0.86 => {
            let height = (3.2 * radius + 3.0) * scale;
            let needles = Finish::new(Surface::Needles, [104, 128, 98], Class::Vegetation);
            trunk(mesh, foot, [0.15, 0.11], 1.0, leafage, BARK);
            let tiers: &[(f32, f32, f32)] = if leafage.has_limbs {
                &[(0.10, 0.42, 0.84), (0.27, 0.58, 0.70), (0.44, 0.76, 0.54), (0.62, 1.0, 0.36)]
            } else {
                &[(0.10, 0.62, 0.84), (0.42, 1.0, 0.54)]
            };
            for &(from, to, wide) in tiers {
                let at = foot + Vec3::Z * (height * from);
                let finish = needles.shaded(0.86 + 0.26 * from);
                tier(mesh, at, [wide * radius, height * (to - from)], turn + 5.0 * from, leafage, finish);
            }
        }
        // Wide: cherry, plane.
        _ => {
            let height = (1.9 * radius + 2.4) * scale;
            trunk(mesh, foot, [0.16, 0.08], height * 0.55, leafage, BARK);
            limbs(mesh, foot, height * 0.36, radius, turn, leafage);
            let middle = foot + Vec3::Z * (height * 0.70);
            blob(
                mesh,
                clump(middle, Vec3::new(radius * 1.04, radius * 1.04, 0.34 * height), 0.24),
                leafage,
                leaves,
            );
        }
    }
}

fn trunk(mesh: &mut Mesh, foot: Vec3, radii: [f32; 2], height: f32, leafage: Leafage, bark: Finish) {
    let flare = radii[0] * 1.35;
    if leafage.has_limbs {
        mesh.frustum(foot, [flare, radii[0]], 0.35, leafage.trunk, bark.shaded(0.85));
        mesh.frustum(foot + Vec3::Z * 0.35, radii, height - 0.35, leafage.trunk, bark);
    } else {
        mesh.frustum(foot, radii, height, leafage.trunk, bark);
    }
}

/// Three branches from the trunk into the crown.
fn limbs(mesh: &mut Mesh, foot: Vec3, from: f32, radius: f32, turn: f32, leafage: Leafage) {
    if !leafage.has_limbs {
        return;
    }
    for k in 0..3 {
        let (sin, cos) = (turn + TAU / 3.0 * k as f32).sin_cos();
        let start = foot + Vec3::Z * (from * (0.78 + 0.10 * k as f32));
        let end = start + Vec3::new(cos * 0.62 * radius, sin * 0.62 * radius, 0.72 * radius);
        let side = Vec3::new(-sin, cos, 0.0);
        let up = side.cross(end - start).normalize_or(Vec3::Z);
        let ring = |at: Vec3, r: f32| [side * r + at, up * r + at, -side * r + at, -up * r + at];
        let (a, b) = (ring(start, 0.055), ring(end, 0.025));
        for k in 0..4 {
            let n = (k + 1) % 4;
            mesh.plate(&[a[k], b[k], b[n], a[n]], BARK.shaded(0.8), 1.0);
        }
    }
}

/// Noise over directions, about 0, within 1.
fn lumps(direction: Vec3, seed: u32) -> f32 {
    let at = direction * 2.1 + Vec3::splat(7.0 + (seed % 97) as f32);
    let cell = at.floor();
    let t = at - cell;
    let t = t * t * (Vec3::splat(3.0) - 2.0 * t);
    let node = |dx: u32, dy: u32, dz: u32| {
        let h = (cell.x as u32 + dx).wrapping_mul(73_856_093)
            ^ (cell.y as u32 + dy).wrapping_mul(19_349_663)
            ^ (cell.z as u32 + dz).wrapping_mul(83_492_791);
        ((h.wrapping_mul(0x9E37_79B1) >> 16) & 0xff) as f32 / 127.5 - 1.0
    };
    let along_x = |dy, dz| node(0, dy, dz) * (1.0 - t.x) + node(1, dy, dz) * t.x;
    let along_y = |dz| along_x(0, dz) * (1.0 - t.y) + along_x(1, dz) * t.y;
    along_y(0) * (1.0 - t.z) + along_y(1) * t.z
}

fn blob(mesh: &mut Mesh, clump: Clump, leafage: Leafage, finish: Finish) {
    let Leafage { around, rings, .. } = leafage;
    let base = mesh.vertices.len() as u32;
    let swell = |out: Vec3| {
        let fine = lumps(out * 2.3, clump.seed + 11);
        1.0 + clump.rough * (0.8 * lumps(out, clump.seed) + 0.45 * fine)
    };
    for ring in 0..=rings {
        let (sin_up, cos_up) = (PI * (ring as f32 / rings as f32 - 0.5)).sin_cos();
        for k in 0..=around {
            let (sin, cos) = (TAU * (k as f32 + 0.5 * (ring % 2) as f32) / around as f32).sin_cos();
            let out = Vec3::new(cos * cos_up, sin * cos_up, sin_up);
            let reach = swell(out);
            // Hollows face their neighbours: less light, and more of it from above.
            let normal = (out / clump.size + Vec3::Z * 0.15).normalize_or(Vec3::Z);
            let height = 0.5 + 0.5 * sin_up;
            let hollow = (0.5 + (reach - 1.0) / clump.rough.max(0.05) * 0.5).clamp(0.0, 1.0);
            let open = clump.dark + (1.0 - clump.dark) * height * (0.62 + 0.38 * hollow);
            let uv = Vec2::new(
                k as f32 / around as f32 * 2.6 * clump.size.x,
                ring as f32 / rings as f32 * 1.5 * clump.size.z,
            );
            let uv = uv * 1.5;
            let position = clump.centre + out * clump.size * reach;
            mesh.vertex(Vertex { position, normal, uv, finish, openness: (255.0 * open) as u8 });
        }
    }
    for ring in 0..rings {
        for k in 0..around {
            let a = base + ring * (around + 1) + k;
            let b = a + around + 1;
            if ring > 0 {
                mesh.indices.extend([a, a + 1, b + 1]);
            }
            if ring + 1 < rings || ring == 0 {
                mesh.indices.extend([a, b + 1, b]);
            }
        }
    }
}

/// A tier of a conifer: a cone whose rim goes in and out, dark below.
fn tier(
    mesh: &mut Mesh,
    foot: Vec3,
    [radius, height]: [f32; 2],
    turn: f32,
    leafage: Leafage,
    finish: Finish,
) {
    let sides = leafage.around + leafage.around % 2;
    let base = mesh.vertices.len() as u32;
    for k in 0..=sides {
        let (sin, cos) = (turn + TAU * k as f32 / sides as f32).sin_cos();
        let normal = Vec3::new(cos * height, sin * height, 0.8 * radius).normalize_or(Vec3::Z);
        let uv = Vec2::new(k as f32 / sides as f32 * 2.0, 0.0);
        let out = if leafage.has_limbs && k % 2 == 1 { 0.80 } else { 1.0 };
        let drop = if leafage.has_limbs && k % 2 == 1 { 0.10 * height } else { 0.0 };
        let rim = foot + Vec3::new(cos * out, sin * out, 0.0) * radius + Vec3::Z * drop;
        mesh.vertex(Vertex { position: rim, normal, uv, finish, openness: 190 });
        let tip = foot + Vec3::Z * height;
        mesh.vertex(Vertex { position: tip, normal, uv: uv + Vec2::Y * height / 1.6, finish, openness: 140 });
    }
    let middle = mesh.vertex(Vertex {
        position: foot + Vec3::Z * (0.22 * height),
        normal: -Vec3::Z,
        uv: Vec2::ZERO,
        finish: finish.shaded(0.5),
        openness: 80,
    });
    for k in 0..sides {
        let a = base + 2 * k;
        mesh.indices.extend([a, a + 2, a + 1]);
        mesh.indices.extend([a + 2, a, middle]);
    }
}

/// Woods around the city where its plain begins, so that streets do not end in nothing: two belts of a
/// wavy height, seen from inside.
pub(super) fn woods([low, high]: [Vec2; 2]) -> Vec<Object> {
    let mut woods = Vec::new();
    const COUNT: u32 = 72;
    /// So many faces are one object.
    const STRETCH: u32 = 6;
    let (middle, half) = ((low + high) / 2.0, (high - low) / 2.0);
    for (belt, away, tall, tone) in [(0_u32, 46.0, 8.0, 0.80), (1, 92.0, 15.0, 0.62)] {
        let finish = Finish::new(Surface::Leaves, [96, 116, 78], Class::Vegetation).shaded(tone);
        let point = |k: u32| {
            let k = k % COUNT;
            let turn = TAU * k as f32 / COUNT as f32;
            let (sin, cos) = turn.sin_cos();
            // Between a circle and a square, in and out a little.
            let square = 1.0 / cos.abs().max(sin.abs()).powf(0.55);
            let wander = 9.0 * (super::dice(k, 31 + belt) - 0.5);
            let at = middle
                + Vec2::new(cos * half.x, sin * half.y) * square
                + Vec2::new(cos, sin) * (away + wander);
            (at, tall * (0.62 + 0.6 * super::dice(k, 37 + belt)))
        };
        let mut along = 0.0;
        let mut mesh = Mesh::default();
        for k in 0..COUNT {
            let ((a, high_a), (b, high_b)) = (point(k), point(k + 1));
            let crest = (a + b) / 2.0;
            let high = (high_a + high_b) / 2.0 + 1.6 * super::dice(k, 41 + belt);
            let then = along + a.distance(b) / 5.0;
            let uv = |u: f32, z: f32| Vec2::new(u, z / 5.0);
            // Seen from the city: its right is where angles grow.
            let corners =
                [b.extend(0.0), a.extend(0.0), a.extend(high_a), crest.extend(high), b.extend(high_b)];
            let uvs = [
                uv(then, 0.0),
                uv(along, 0.0),
                uv(along, high_a),
                uv((along + then) / 2.0, high),
                uv(then, high_b),
            ];
            mesh.shaded_face(&corners, &uvs, finish, &[120, 120, 235, 245, 235]);
            along = then;
            if (k + 1) % STRETCH == 0 {
                woods.push(Object::of_one_level(std::mem::take(&mut mesh)));
            }
        }
    }
    woods
}

/// A clipped hedge along a line or within a polygon.
pub(super) fn hedge(mesh: &mut Mesh, place: &Place<'_>) {
    let height = place.piece.height_m.map_or(1.15, |h| h as f32);
    match &place.piece.shape {
        Shape::Polyline(line) => super::props::along(mesh, line, 0.9, height, HEDGE, HEDGE.shaded(1.08)),
        shape => {
            let ring: Vec<Vec3> = ring_of(shape).iter().map(|p| p.as_vec2().extend(0.05)).collect();
            mesh.prism(&ring, height, HEDGE, HEDGE.shaded(1.08));
        }
    }
}
