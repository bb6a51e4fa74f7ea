//! Street furniture made in code: benches, picnic tables, lamps, bins, fuel pumps. All face +x and stand on
//! the ground at their origin.

use super::{PrimitiveBuilder, StaticMaterial};
use city3d_models::{BENCH, BIN, FUEL_PUMP, LAMP, Model, ModelNode, PICNIC_TABLE};
use glam::{Affine3A, Vec2, Vec3};
use std::f32::consts::TAU;

const SLAT: StaticMaterial = StaticMaterial::new("wood", [150, 108, 70]);
const IRON: StaticMaterial = StaticMaterial::new("iron", [52, 55, 57]).metal().rough(0.6);
const POST: StaticMaterial = StaticMaterial::new("post", [64, 70, 74]).metal().rough(0.5);
const LANTERN: StaticMaterial = StaticMaterial::new("lantern", [248, 244, 226]).rough(0.3);
const GREEN: StaticMaterial = StaticMaterial::new("green_sheet", [46, 78, 60]).metal().rough(0.5);
const DARK: StaticMaterial = StaticMaterial::new("opening", [22, 24, 25]);
const WHITE: StaticMaterial = StaticMaterial::new("white_sheet", [232, 232, 228]).metal().rough(0.4);
const RED: StaticMaterial = StaticMaterial::new("red_sheet", [190, 44, 40]).metal().rough(0.4);
const RUBBER: StaticMaterial = StaticMaterial::new("rubber", [26, 26, 28]);
const SCREEN: StaticMaterial = StaticMaterial::new("glass", [255, 255, 255]).rough(0.1);
const STONE: StaticMaterial = StaticMaterial::new("concrete", [206, 202, 194]);

type Draw = fn(&mut PrimitiveBuilder);

/// All models by file name.
pub fn models() -> Vec<(&'static str, Model)> {
    let piece = |drawn: &[(&str, Draw)]| {
        let mut model = Model::default();
        for &(name, draw) in drawn {
            let mut builder = PrimitiveBuilder::default();
            draw(&mut builder);
            let mesh = model.meshes.len();
            model.meshes.push(builder.finish());
            model.nodes.push(ModelNode { name: name.to_owned(), mesh, model_from_mesh: Affine3A::IDENTITY });
        }
        model
    };
    vec![
        (BENCH, piece(&[("bench", bench), ("far_bench", far_bench)])),
        (PICNIC_TABLE, piece(&[("table", picnic_table), ("far_table", far_picnic_table)])),
        (LAMP, piece(&[("lamp", lamp), ("far_lamp", far_lamp), ("farther_lamp", farther_lamp)])),
        (BIN, piece(&[("bin", bin)])),
        (FUEL_PUMP, piece(&[("pump", fuel_pump)])),
    ]
}

/// Openness by height: low faces are near the ground and below the rest.
fn openness(z: f32) -> u8 {
    (130.0 + 125.0 * (z / 0.8).clamp(0.0, 1.0)) as u8
}

/// A box without its underside.
fn block(b: &mut PrimitiveBuilder, low: Vec3, high: Vec3, face_material: StaticMaterial) {
    let at = |x: bool, y: bool, z: bool| {
        Vec3::new(
            if x { high.x } else { low.x },
            if y { high.y } else { low.y },
            if z { high.z } else { low.z },
        )
    };
    let ring = [(false, false), (true, false), (true, true), (false, true)];
    for k in 0..4 {
        let ((ax, ay), (bx, by)) = (ring[k], ring[(k + 1) % 4]);
        face(b, &[at(ax, ay, false), at(bx, by, false), at(bx, by, true), at(ax, ay, true)], face_material);
    }
    face(b, &ring.map(|(x, y)| at(x, y, true)), face_material);
}

/// A flat face, darker towards the ground.
fn face(b: &mut PrimitiveBuilder, corners: &[Vec3], face_material: StaticMaterial) {
    let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or(Vec3::Z);
    let slots: Vec<u32> =
        corners.iter().map(|&corner| b.vertex(face_material, corner, normal, openness(corner.z))).collect();
    for k in 2..slots.len() {
        b.triangle(face_material, [slots[0], slots[k - 1], slots[k]]);
    }
}

/// A bar of rectangular cross-section with half extents `half` across and up; open at its ends.
fn bar(b: &mut PrimitiveBuilder, from: Vec3, to: Vec3, half: Vec2, face_material: StaticMaterial) {
    let along = (to - from).normalize_or(Vec3::Z);
    let across = if along.y.abs() > 0.9 { Vec3::X } else { Vec3::Y };
    let up = across.cross(along).normalize_or(Vec3::Z);
    let ring = |at: Vec3| {
        [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
            .map(|(s, t)| at + across * s * half.x + up * t * half.y)
    };
    let (p, q) = (ring(from), ring(to));
    for k in 0..4 {
        let n = (k + 1) % 4;
        let corners = [p[k], p[n], q[n], q[k]];
        let outward = (p[k] + p[n]) / 2.0 - from;
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
        let turned = [p[n], p[k], q[k], q[n]];
        face(b, if normal.dot(outward) > 0.0 { &corners } else { &turned }, face_material);
    }
}

/// A surface of revolution through rings of (height, radius), smooth around.
fn turned(
    b: &mut PrimitiveBuilder,
    foot: Vec3,
    rings: &[(f32, f32)],
    sides: u32,
    face_material: StaticMaterial,
) {
    let slots: Vec<Vec<u32>> = rings
        .iter()
        .enumerate()
        .map(|(row, &(z, radius))| {
            let other = rings[if row == 0 { 1 } else { row - 1 }];
            let slope =
                (other.1 - radius) / (z - other.0).abs().max(0.01) * if row == 0 { -1.0 } else { 1.0 };
            (0..sides)
                .map(|k| {
                    let (sin, cos) = (TAU * k as f32 / sides as f32).sin_cos();
                    let normal = Vec3::new(cos, sin, slope).normalize_or(Vec3::Z);
                    let at = foot + Vec3::new(cos * radius, sin * radius, z);
                    b.vertex(face_material, at, normal, openness(at.z))
                })
                .collect()
        })
        .collect();
    for pair in slots.windows(2) {
        for k in 0..sides as usize {
            let n = (k + 1) % sides as usize;
            b.triangle(face_material, [pair[0][k], pair[0][n], pair[1][n]]);
            b.triangle(face_material, [pair[0][k], pair[1][n], pair[1][k]]);
        }
    }
}

/// A level disc at a height.
fn lid(b: &mut PrimitiveBuilder, centre: Vec3, radius: f32, sides: u32, face_material: StaticMaterial) {
    let ring: Vec<Vec3> = (0..sides)
        .map(|k| {
            let (sin, cos) = (TAU * k as f32 / sides as f32).sin_cos();
            centre + Vec3::new(cos, sin, 0.0) * radius
        })
        .collect();
    face(b, &ring, face_material);
}

const BENCH_HALF_M: f32 = 0.88;
/// Lower and upper end of a bench's back in side view.
const BACK: [Vec2; 2] = [Vec2::new(-0.20, 0.44), Vec2::new(-0.34, 0.88)];

fn bench(b: &mut PrimitiveBuilder) {
    for k in 0..4 {
        let x = -0.18 + 0.125 * k as f32;
        block(b, Vec3::new(x, -BENCH_HALF_M, 0.43), Vec3::new(x + 0.105, BENCH_HALF_M, 0.465), SLAT);
    }
    for part in [0.34, 0.62, 0.90] {
        let at = BACK[0].lerp(BACK[1], part);
        let (from, to) = (Vec3::new(at.x, -BENCH_HALF_M, at.y), Vec3::new(at.x, BENCH_HALF_M, at.y));
        bar(b, from, to, Vec2::new(0.018, 0.055), SLAT);
        for (end, out) in [(from, -1.0), (to, 1.0)] {
            let (x, z) = (Vec3::X * 0.018, Vec3::Z * 0.055);
            let corners = [end - x - z, end + x - z, end + x + z, end - x + z];
            let turned = [corners[3], corners[2], corners[1], corners[0]];
            face(b, if out < 0.0 { &corners } else { &turned }, SLAT);
        }
    }
    for y in [-0.62_f32, 0.62] {
        let at = |x: f32, z: f32| Vec3::new(x, y, z);
        let half = Vec2::new(0.022, 0.022);
        bar(b, at(0.28, 0.0), at(0.24, 0.64), half, IRON);
        bar(b, at(-0.28, 0.0), at(-0.16, 0.42), half, IRON);
        bar(b, at(-0.14, 0.40), at(BACK[1].x - 0.03, BACK[1].y), half, IRON);
        bar(b, at(-0.24, 0.41), at(0.28, 0.41), half, IRON);
        bar(b, at(-0.25, 0.66), at(0.27, 0.66), Vec2::new(0.035, 0.018), IRON);
    }
}

fn far_bench(b: &mut PrimitiveBuilder) {
    block(b, Vec3::new(-0.18, -BENCH_HALF_M, 0.41), Vec3::new(0.30, BENCH_HALF_M, 0.465), SLAT);
    let [low, high] = BACK.map(|p| p + Vec2::new(0.0, 0.04));
    let at = |p: Vec2, y: f32| Vec3::new(p.x, y, p.y);
    let front =
        [at(low, -BENCH_HALF_M), at(low, BENCH_HALF_M), at(high, BENCH_HALF_M), at(high, -BENCH_HALF_M)];
    face(b, &front, SLAT);
    face(b, &[front[3], front[2], front[1], front[0]], SLAT);
    for y in [-0.62_f32, 0.62] {
        for x in [-0.24_f32, 0.24] {
            let foot = Vec3::new(x, y, 0.0);
            turned(b, foot, &[(0.0, 0.035), (0.42, 0.035)], 3, IRON);
        }
    }
}

const TABLE_HALF_M: f32 = 0.92;

fn picnic_table(b: &mut PrimitiveBuilder) {
    // Long along y; people sit on both sides of it.
    for k in 0..5 {
        let x = -0.36 + 0.145 * k as f32;
        block(b, Vec3::new(x, -TABLE_HALF_M, 0.70), Vec3::new(x + 0.13, TABLE_HALF_M, 0.74), SLAT);
    }
    for side in [-1.0_f32, 1.0] {
        for near in [0.56_f32, 0.70] {
            let (a, c) = (side * near, side * (near + 0.125));
            let (low, high) =
                (Vec3::new(a.min(c), -TABLE_HALF_M, 0.41), Vec3::new(a.max(c), TABLE_HALF_M, 0.45));
            block(b, low, high, SLAT);
        }
    }
    for y in [-0.60_f32, 0.60] {
        let at = |x: f32, z: f32| Vec3::new(x, y, z);
        for side in [-1.0_f32, 1.0] {
            bar(b, at(side * 0.62, 0.0), at(side * 0.22, 0.70), Vec2::new(0.03, 0.05), SLAT);
        }
        bar(b, at(-0.82, 0.36), at(0.82, 0.36), Vec2::new(0.03, 0.05), SLAT);
        bar(b, at(-0.34, 0.65), at(0.34, 0.65), Vec2::new(0.03, 0.05), SLAT);
    }
}

fn far_picnic_table(b: &mut PrimitiveBuilder) {
    block(b, Vec3::new(-0.36, -TABLE_HALF_M, 0.68), Vec3::new(0.35, TABLE_HALF_M, 0.74), SLAT);
    for side in [-1.0_f32, 1.0] {
        let (a, c) = (side * 0.56, side * 0.83);
        block(b, Vec3::new(a.min(c), -TABLE_HALF_M, 0.40), Vec3::new(a.max(c), TABLE_HALF_M, 0.45), SLAT);
        for y in [-0.60_f32, 0.60] {
            bar(
                b,
                Vec3::new(side * 0.62, y, 0.0),
                Vec3::new(side * 0.22, y, 0.70),
                Vec2::new(0.03, 0.05),
                SLAT,
            );
        }
    }
}

/// Height of a lamp's lens.
const LENS_M: f32 = 6.14;
/// How far the lens reaches out over the road.
const REACH_M: f32 = 1.35;

fn lamp(b: &mut PrimitiveBuilder) {
    turned(b, Vec3::ZERO, &[(0.0, 0.11), (0.95, 0.10), (1.0, 0.075), (5.7, 0.05)], 6, POST);
    // Bent over.
    let bow = [(0.0, 5.68), (0.10, 6.0), (0.42, 6.18), (REACH_M - 0.28, 6.23)];
    for pair in bow.windows(2) {
        let [p, q] = [pair[0], pair[1]].map(|(x, z)| Vec3::new(x, 0.0, z));
        bar(b, p, q, Vec2::splat(0.038), POST);
    }
    luminaire(b, 0.34);
}

/// A flat head and its lens, seen from below.
fn luminaire(b: &mut PrimitiveBuilder, half: f32) {
    let corner = |x: f32, y: f32, z: f32| Vec3::new(REACH_M + x * half, y, LENS_M + z);
    let (wide, narrow) = (0.15, 0.09);
    let rim = [
        corner(-1.0, -wide, 0.0),
        corner(1.0, -narrow, 0.0),
        corner(1.0, narrow, 0.0),
        corner(-1.0, wide, 0.0),
    ];
    let top = [
        corner(-1.0, -0.6 * wide, 0.13),
        corner(0.8, -0.6 * narrow, 0.06),
        corner(0.8, 0.6 * narrow, 0.06),
        corner(-1.0, 0.6 * wide, 0.13),
    ];
    for k in 0..4 {
        let n = (k + 1) % 4;
        face(b, &[rim[k], rim[n], top[n], top[k]], POST);
    }
    face(b, &top, POST);
    face(b, &[rim[3], rim[2], rim[1], rim[0]], POST);
    let lens = [(-0.6, -0.09), (-0.6, 0.09), (0.8, 0.07), (0.8, -0.07)].map(|(x, y)| corner(x, y, -0.008));
    face(b, &lens, LANTERN);
}

fn far_lamp(b: &mut PrimitiveBuilder) {
    turned(b, Vec3::ZERO, &[(0.0, 0.10), (6.1, 0.055)], 3, POST);
    bar(b, Vec3::new(0.0, 0.0, 6.08), Vec3::new(REACH_M - 0.2, 0.0, 6.20), Vec2::splat(0.05), POST);
    luminaire(b, 0.34);
}

/// A minimal lamp: slivers for the post and its arm, a roof over the lens.
fn farther_lamp(b: &mut PrimitiveBuilder) {
    let at = |x: f32, y: f32, z: f32| Vec3::new(x, y, z);
    let ring = [at(0.10, 0.0, 0.0), at(-0.05, 0.09, 0.0), at(-0.05, -0.09, 0.0)];
    let top = at(0.0, 0.0, 6.15);
    let far = REACH_M + 0.34;
    for k in 0..3 {
        face(b, &[ring[k], ring[(k + 1) % 3], top], POST);
    }
    face(b, &[at(0.0, 0.0, 6.0), at(REACH_M - 0.3, -0.14, LENS_M), top], POST);
    face(b, &[at(0.0, 0.0, 6.0), top, at(REACH_M - 0.3, 0.14, LENS_M)], POST);
    let rim = [
        at(REACH_M - 0.34, -0.15, LENS_M),
        at(far, -0.09, LENS_M),
        at(far, 0.09, LENS_M),
        at(REACH_M - 0.34, 0.15, LENS_M),
    ];
    face(b, &[rim[0], rim[1], rim[2], at(REACH_M - 0.3, 0.0, LENS_M + 0.10)], POST);
    face(b, &[rim[2], rim[3], at(REACH_M - 0.3, 0.0, LENS_M + 0.10)], POST);
    face(b, &[rim[3], rim[2], rim[1], rim[0]], LANTERN);
}

fn bin(b: &mut PrimitiveBuilder) {
    turned(b, Vec3::ZERO, &[(0.0, 0.20), (0.06, 0.23), (0.74, 0.25)], 10, GREEN);
    // Posts hold a hood over the opening.
    lid(b, Vec3::Z * 0.70, 0.235, 10, DARK);
    for k in 0..4 {
        let (sin, cos) = (TAU * (k as f32 + 0.5) / 4.0).sin_cos();
        let foot = Vec3::new(cos * 0.21, sin * 0.21, 0.0);
        turned(b, foot, &[(0.70, 0.018), (0.92, 0.018)], 3, GREEN);
    }
    turned(b, Vec3::ZERO, &[(0.90, 0.27), (0.94, 0.27), (1.04, 0.06)], 10, GREEN);
    lid(b, Vec3::Z * 1.04, 0.06, 10, GREEN);
}

/// A pump on its plinth, with a screen and a hose on either side.
fn fuel_pump(b: &mut PrimitiveBuilder) {
    block(b, Vec3::new(-0.34, -0.52, 0.0), Vec3::new(0.34, 0.52, 0.10), STONE);
    block(b, Vec3::new(-0.24, -0.42, 0.10), Vec3::new(0.24, 0.42, 1.30), WHITE);
    block(b, Vec3::new(-0.27, -0.45, 1.30), Vec3::new(0.27, 0.45, 1.62), RED);
    for side in [-1.0_f32, 1.0] {
        let panel =
            |b: &mut PrimitiveBuilder, y: [f32; 2], z: [f32; 2], out: f32, face_material: StaticMaterial| {
                let x = side * out;
                let (a, c) = if side > 0.0 { (y[0], y[1]) } else { (y[1], y[0]) };
                face(
                    b,
                    &[(a, z[0]), (c, z[0]), (c, z[1]), (a, z[1])].map(|(y, z)| Vec3::new(x, y, z)),
                    face_material,
                );
            };
        panel(b, [-0.26, 0.26], [0.98, 1.22], 0.246, SCREEN);
        panel(b, [-0.34, 0.34], [0.40, 0.80], 0.244, RED);
        // Nozzles in their holsters at the ends, hoses that hang in a loop.
        let y = side * 0.42;
        let (low, high) = (Vec3::new(-0.06, y.min(y * 1.28), 0.86), Vec3::new(0.06, y.max(y * 1.28), 1.16));
        block(b, low, high, RUBBER);
        let loops = [(0.0, 1.10), (0.10, 0.70), (0.13, 0.36), (0.06, 0.24), (0.0, 0.34)];
        for pair in loops.windows(2) {
            let [p, q] = [pair[0], pair[1]].map(|(out, z)| Vec3::new(0.14, y * 1.04 + side * out, z));
            bar(b, p, q, Vec2::splat(0.022), RUBBER);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of each face the outer side is seen: a ray from outside meets a front before it meets a back.
    #[test]
    fn pieces_stand_on_the_ground_and_face_outwards() {
        for (name, model) in models() {
            let [low, high] = model.bounds(|node| !node.name.starts_with("far")).unwrap();
            // Legs that lean dip a corner into the ground.
            assert!((-0.03..0.001).contains(&low.z) && high.z < 7.0, "{name}: {low} {high}");
            for part in model.meshes.iter().flatten() {
                for t in part.indices.chunks_exact(3) {
                    let [p, q, r] = [t[0], t[1], t[2]].map(|k| part.vertices[k as usize]);
                    let facing = (q.position - p.position).cross(r.position - p.position);
                    let meant = p.normal + q.normal + r.normal;
                    assert!(
                        facing.dot(meant) > 0.0,
                        "{name}: a face of {} looks inwards",
                        part.material.name
                    );
                }
            }
        }
    }

    #[test]
    fn what_stands_in_at_a_distance_fills_the_same_box_with_fewer_faces() {
        for (name, model) in models() {
            for pair in model.nodes.windows(2) {
                let [fine, coarse] = [&pair[0], &pair[1]].map(|node| {
                    let faces: usize = model.parts(node).iter().map(|part| part.indices.len() / 3).sum();
                    (faces, model.bounds(|other| other.name == node.name).unwrap())
                });
                for (a, b) in fine.1.iter().zip(&coarse.1) {
                    assert!(a.distance(*b) < 0.15, "{name}: {:?} and {:?}", fine.1, coarse.1);
                }
                assert!(coarse.0 * 2 <= fine.0, "{name}: {} of {}", coarse.0, fine.0);
            }
        }
    }
}
