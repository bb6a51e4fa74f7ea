//! Bicycles: two wheels and a frame of tubes. They are scenery, as parked cars are.

use super::foliage::limb;
use super::mesh::{Class, Finish, Mesh, Surface};
use super::{LodMesh, SceneObject, hash_to_unit};
use glam::{Affine3A, Vec3};
use std::f32::consts::TAU;

const WHEEL_M: f32 = 0.33;
/// Middles of the wheels along x.
const HUBS_M: [f32; 2] = [-0.50, 0.55];
/// Length over both wheels.
pub(super) const LENGTH_M: f32 = HUBS_M[1] - HUBS_M[0] + 2.0 * WHEEL_M;

/// Top of the saddle, and the left grip of the bar.
const SADDLE_M: Vec3 = Vec3::new(-0.22, 0.0, 0.875);
pub(super) const GRIP_M: Vec3 = Vec3::new(0.35, 0.25, 1.0);
/// The bottom bracket, and from there to the left pedal; the right one is opposite.
const BRACKET_M: Vec3 = Vec3::new(-0.06, 0.0, 0.29);
const CRANK_M: Vec3 = Vec3::new(0.147, 0.12, 0.085);

/// Errors of the coarser level, and from which on none is drawn: half its height.
const COARSER_M: f32 = 0.05;
const UNDRAWN_M: f32 = 0.5;

const TYRE: Finish = Finish::new(Surface::Plain, [34, 34, 36], Class::Vehicle);
/// Tinted by [`painted`].
const FRAME: Finish = Finish::new(Surface::CarPaint, [255, 255, 255], Class::Vehicle);
const STEEL: Finish = Finish::new(Surface::Metal, [168, 172, 176], Class::Vehicle);
const PAINTS: [[u8; 3]; 6] =
    [[168, 40, 36], [36, 74, 122], [38, 40, 44], [46, 104, 78], [196, 150, 52], [204, 206, 206]];

/// A bicycle that faces along x, white, its wheels on the ground.
pub(super) fn bicycle() -> SceneObject {
    let drawn = |is_near: bool| {
        let mut mesh = Mesh::default();
        draw(&mut mesh, is_near);
        mesh
    };
    let mut object = SceneObject::of_one_level(drawn(true));
    object.add_level(drawn(false), COARSER_M);
    object
}

/// One of them at a place, in a colour of its own.
pub(super) fn painted(bicycle: &SceneObject, city_from_bicycle: Affine3A, seed: u32) -> SceneObject {
    let colour = PAINTS[(hash_to_unit(seed, 31) * PAINTS.len() as f32) as usize % PAINTS.len()];
    let mut one = bicycle.placed(city_from_bicycle, |finish| match finish.surface {
        Surface::CarPaint => Finish { colour, ..finish },
        _ => finish,
    });
    one.levels.push(LodMesh { mesh: Mesh::default(), error_m: UNDRAWN_M });
    one
}

fn draw(mesh: &mut Mesh, is_near: bool) {
    let at = |x: f32, z: f32| Vec3::new(x, 0.0, z);
    for x in HUBS_M {
        hoop(mesh, at(x, WHEEL_M), if is_near { 12 } else { 7 }, is_near);
    }
    let [rear, front] = HUBS_M.map(|x| at(x, WHEEL_M));
    let (bracket, seat, head) = (BRACKET_M, at(-0.20, 0.77), at(0.38, 0.82));
    let mut tube = |from: Vec3, to: Vec3, radius: f32, finish: Finish| {
        limb(mesh, &[(from, radius), (to, radius)], 3, finish);
    };
    tube(bracket, seat, 0.020, FRAME);
    tube(bracket, at(0.42, 0.68), 0.022, FRAME);
    tube(rear, at(-0.18, 0.70), 0.013, FRAME);
    tube(head, front, 0.016, FRAME);
    if !is_near {
        return;
    }
    tube(at(-0.19, 0.72), at(0.40, 0.76), 0.018, FRAME);
    tube(rear, bracket, 0.013, FRAME);
    tube(head, at(0.33, 1.0), 0.014, STEEL);
    tube(seat, SADDLE_M - Vec3::Z * 0.03, 0.014, STEEL);
    let [right, left] = [-1.0, 1.0].map(|side| GRIP_M * Vec3::new(1.0, side, 1.0));
    tube(right - Vec3::Y * 0.05, left + Vec3::Y * 0.05, 0.014, STEEL);
    for side in [1.0, -1.0] {
        let pedal = bracket + CRANK_M * side;
        let axle = Vec3::Y * (0.05 * side);
        tube(bracket + axle, pedal - axle, 0.013, STEEL);
        tube(pedal - axle, pedal + axle, 0.035, TYRE);
    }
    mesh.block(SADDLE_M - Vec3::Z * 0.045, Vec3::new(0.25, 0.13, 0.045), 0.0, TYRE);
}

/// A tyre with a rim: a ring seen from both sides, and its tread.
fn hoop(mesh: &mut Mesh, middle: Vec3, parts: u32, has_tread: bool) {
    const HALF_M: f32 = 0.016;
    let spoke = |k: u32| {
        let (sin, cos) = (TAU * k as f32 / parts as f32).sin_cos();
        Vec3::new(cos, 0.0, sin)
    };
    for k in 0..parts {
        let (a, b) = (spoke(k), spoke(k + 1));
        let [outer, inner] = [WHEEL_M, WHEEL_M - 0.045];
        for side in [HALF_M, -HALF_M] {
            let on = |way: Vec3, radius: f32| middle + way * radius + Vec3::Y * side;
            let mut ring = [on(a, inner), on(b, inner), on(b, outer), on(a, outer)];
            if side < 0.0 {
                ring.reverse();
            }
            mesh.plate(&ring, TYRE, 1.0);
        }
        if has_tread {
            let on = |way: Vec3, y: f32, radius: f32| middle + way * radius + Vec3::Y * y;
            let tread =
                [on(a, HALF_M, outer), on(b, HALF_M, outer), on(b, -HALF_M, outer), on(a, -HALF_M, outer)];
            mesh.plate(&tread, TYRE, 1.0);
            let bed =
                [on(a, -HALF_M, inner), on(b, -HALF_M, inner), on(b, HALF_M, inner), on(a, HALF_M, inner)];
            mesh.plate(&bed, STEEL, 1.0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bicycle_stands_on_its_wheels_and_all_its_faces_look_outwards() {
        let object = bicycle();
        for level in &object.levels {
            let [low, high] = level.mesh.bounds();
            assert!(low.z.abs() < 0.03 && (0.8..1.1).contains(&high.z), "{low} to {high}");
            assert!((high.x - low.x - LENGTH_M).abs() < 0.06, "{low} to {high}");
        }
        // Of a wheel, the faces of the left side look to the left.
        let mut wheel = Mesh::default();
        hoop(&mut wheel, Vec3::Z * WHEEL_M, 12, true);
        for v in &wheel.vertices {
            let out = v.position - Vec3::Z * WHEEL_M;
            let is_side = v.normal.y.abs() > 0.9;
            assert!(!is_side || v.normal.y * v.position.y > 0.0, "{v:?}");
            let is_tread = !is_side && out.length() > WHEEL_M - 0.01;
            assert!(!is_tread || v.normal.dot(out) > 0.0, "{v:?}");
        }
        let counts: Vec<usize> = object.levels.iter().map(|level| level.mesh.triangle_count()).collect();
        assert!(counts.len() == 2 && counts[0] < 320 && counts[1] < 110, "{counts:?}");
    }
}
