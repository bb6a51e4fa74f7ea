//! A wheel: tyre, rim and spokes; its axle along y, its outer face towards +y.

use super::super::{MeshPrimitive, PrimitiveBuilder, StaticMaterial};
use super::SEAM;
use glam::Vec3;
use std::f32::consts::TAU;

pub(super) const WIDTH_M: f32 = 0.22;
const TYRE: StaticMaterial = StaticMaterial::new("tyre", [27, 27, 28]);
const RIM: StaticMaterial = StaticMaterial::new("rim", [176, 180, 185]).metal().rough(0.3);
/// Brake dust dulls the inner parts.
const LIP: StaticMaterial = StaticMaterial::new("lip", [96, 98, 101]).rough(0.7);
const DISC: StaticMaterial = StaticMaterial::new("disc", [34, 35, 37]);
const BRAKE: StaticMaterial = StaticMaterial::new("brake", [128, 130, 134]).metal().rough(0.4);
const SPOKES: u32 = 5;

const SIDES: u32 = 16;
/// Rim and spokes as one, from a distance.
const FAR_RIM: StaticMaterial = StaticMaterial::new("far_rim", [112, 114, 118]).rough(0.5);

fn turned(angle: f32, y: f32, r: f32) -> Vec3 {
    let (sin, cos) = angle.sin_cos();
    Vec3::new(r * sin, y, r * cos)
}

pub(super) fn wheel(radius: f32, width: f32) -> Vec<MeshPrimitive> {
    let mut builder = PrimitiveBuilder::default();
    let sides = SIDES;
    let half = width / 2.0;
    let rim = 0.68 * radius;
    let angle = |k: u32| TAU * k as f32 / sides as f32;
    // Tread, shoulder and side wall of the tyre, then the lip of the rim.
    let ring = |y: f32, r: f32| (0..=sides).map(|k| turned(angle(k), y, r)).collect::<Vec<_>>();
    let tyre = [
        ring(-0.85 * half, radius),
        ring(0.78 * half, radius),
        ring(half, 0.90 * radius),
        ring(half - 0.006, rim),
    ];
    builder.grid(&tyre, |_| 190, |_, _| Some(TYRE));
    let lip = [ring(half - 0.006, rim), ring(half - 0.045, 0.90 * rim)];
    // It lies inside: the ground and the well around it keep most of the sky from it.
    builder.grid(&lip, |_| 60, |_, _| Some(LIP));
    builder.plate(&inner_side(radius, -0.85 * half, SIDES), TYRE, 60);
    builder.plate(&circle(half - 0.05, 0.90 * rim, SIDES), DISC, 150);
    for k in 0..SPOKES {
        let middle = TAU * k as f32 / SPOKES as f32;
        let (wide, narrow) = (0.40, 0.15);
        let corners = [
            turned(middle + wide, half - 0.02, 0.26 * rim),
            turned(middle + narrow, half - 0.012, 0.92 * rim),
            turned(middle - narrow, half - 0.012, 0.92 * rim),
            turned(middle - wide, half - 0.02, 0.26 * rim),
        ];
        builder.plate(&[corners[3], corners[2], corners[1], corners[0]], RIM, 230);
    }
    builder.plate(&circle(half - 0.016, 0.30 * rim, 12), RIM, 240);
    builder.finish()
}

/// Wheel for what is near: a tyre with shoulders and grooves, spokes with sides, a brake disc behind them.
pub(super) fn near_wheel(radius: f32, width: f32) -> Vec<MeshPrimitive> {
    const SIDES: u32 = 32;
    let mut builder = PrimitiveBuilder::default();
    let half = width / 2.0;
    let rim = 0.69 * radius;
    let ring = |(y, r): (f32, f32)| -> Vec<Vec3> {
        (0..=SIDES).map(|k| turned(TAU * k as f32 / SIDES as f32, y, r)).collect()
    };
    // From the inner side over the tread to the rim; pairs keep the shoulders sharp.
    let tyre = [
        (-0.97 * half, 0.93 * radius),
        (-0.80 * half, 0.995 * radius),
        (-0.74 * half, radius),
        (0.66 * half, radius),
        (0.74 * half, 0.995 * radius),
        (0.93 * half, 0.945 * radius),
        (half, 0.86 * radius),
        (0.99 * half, 0.78 * radius),
        (half - 0.008, rim),
    ]
    .map(ring);
    builder.grid(&tyre, |_| 190, |_, _| Some(TYRE));
    let flange = [(half - 0.008, rim), (half - 0.004, 0.965 * rim), (half - 0.014, 0.93 * rim)].map(ring);
    builder.grid(&flange, |_| 220, |_, _| Some(RIM));
    let barrel = [(half - 0.014, 0.93 * rim), (half - 0.09, 0.88 * rim)].map(ring);
    builder.grid(&barrel, |_| 70, |_, _| Some(LIP));
    builder.plate(&inner_side(0.93 * radius, -0.97 * half, 32), TYRE, 60);
    builder.plate(&circle(half - 0.088, 0.89 * rim, 20), DISC, 90);
    builder.plate(&circle(half - 0.075, 0.66 * rim, 20), BRAKE, 130);
    for k in 0..SPOKES {
        let middle = TAU * k as f32 / SPOKES as f32;
        let edge = |turn: f32, y: f32, r: f32| turned(middle + turn, half - y, r * rim);
        let (wide, narrow) = (0.30, 0.13);
        let outer = [
            edge(-wide, 0.028, 0.24),
            edge(-narrow, 0.012, 0.94),
            edge(narrow, 0.012, 0.94),
            edge(wide, 0.028, 0.24),
        ];
        let inner = [
            edge(-wide, 0.07, 0.24),
            edge(-narrow, 0.06, 0.94),
            edge(narrow, 0.06, 0.94),
            edge(wide, 0.07, 0.24),
        ];
        builder.plate(&outer, RIM, 230);
        builder.plate(&[inner[0], inner[1], outer[1], outer[0]], RIM, 130);
        builder.plate(&[outer[3], outer[2], inner[2], inner[3]], RIM, 130);
    }
    let hub = [(half - 0.03, 0.30 * rim), (half - 0.018, 0.27 * rim), (half - 0.014, 0.15 * rim)].map(ring);
    builder.grid(&hub, |_| 230, |_, _| Some(RIM));
    builder.plate(&circle(half - 0.014, 0.15 * rim, 14), LIP, 220);
    builder.finish()
}

/// Coarse wheel: a tread between discs, the rim a disc before the outer one. It is set slightly inwards, since the arch of a far
/// body covers its top.
pub(super) fn far_wheel(radius: f32, width: f32) -> Vec<MeshPrimitive> {
    const SIDES: u32 = 12;
    /// Hardly anything is seen of the inner side.
    const INNER_SIDES: u32 = 6;
    let mut builder = PrimitiveBuilder::default();
    let (half, rim) = (width / 2.0, 0.68 * radius);
    let outer = half - 0.03;
    let ring = |y: f32, r: f32| (0..=SIDES).map(|k| turned(TAU * k as f32 / SIDES as f32, y, r)).collect();
    let tread: [Vec<Vec3>; 2] = [ring(-half, radius), ring(outer, radius)];
    builder.grid(&tread, |_| 170, |_, _| Some(TYRE));
    builder.plate(&circle(outer, radius, SIDES), TYRE, 170);
    builder.plate(&circle(outer + 0.008, rim, SIDES), FAR_RIM, 200);
    builder.plate(&inner_side(radius, -half, INNER_SIDES), TYRE, 60);
    builder.finish()
}

/// Facing outwards.
fn circle(y: f32, r: f32, sides: u32) -> Vec<Vec3> {
    (0..sides).map(|k| turned(TAU * k as f32 / sides as f32, y, r)).collect()
}

/// Inner side of a wheel, visible from below the car.
fn inner_side(radius: f32, y: f32, sides: u32) -> Vec<Vec3> {
    circle(y, radius, sides).into_iter().rev().collect()
}

/// Wheels without depth, for the greatest distance; `face` is how far out they are.
pub(super) fn painted(builder: &mut PrimitiveBuilder, [wheelbase, wheel_radius, face, width]: [f32; 4]) {
    for axle in [-wheelbase / 2.0, wheelbase / 2.0] {
        for side in [-1.0_f32, 1.0] {
            let mut disc = |corners: u32, radius: f32, out: f32, face_material: StaticMaterial| {
                let at = |k: u32| {
                    let (sin, cos) = (side * TAU * (k as f32 + 0.5) / corners as f32).sin_cos();
                    let middle = Vec3::new(axle, side * (face + out), wheel_radius);
                    middle + Vec3::new(radius * sin, 0.0, radius * cos)
                };
                builder.plate(&(0..corners).map(at).collect::<Vec<_>>(), face_material, 150);
            };
            disc(6, 1.12 * wheel_radius, 0.004, SEAM);
            disc(4, 0.72 * wheel_radius, 0.012, FAR_RIM);
            // The tyre in front and rear view.
            let (outer, inner) = (face - 0.02, face - 0.02 - width);
            let (a, b) = if side * axle > 0.0 { (inner, outer) } else { (outer, inner) };
            let corner = |y: f32, z: f32| Vec3::new(axle, side * y, z);
            builder.plate(
                &[
                    corner(a, 0.0),
                    corner(b, 0.0),
                    corner(b, 1.47 * wheel_radius),
                    corner(a, 1.47 * wheel_radius),
                ],
                SEAM,
                120,
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn near_wheels_are_round() {
        let corners = |parts: &[MeshPrimitive]| {
            let vertices = parts.iter().flat_map(|part| &part.vertices);
            let tread = vertices.filter(|v| (v.position.with_y(0.0).length() - 0.34).abs() < 1e-4);
            let turns = tread.map(|v| (v.position.x.atan2(v.position.z).to_degrees() * 4.0).round() as i32);
            turns.map(|turn| turn.rem_euclid(4 * 360)).collect::<BTreeSet<_>>().len()
        };
        let counts = [near_wheel, wheel, far_wheel].map(|made| corners(&made(0.34, WIDTH_M)));
        assert_eq!(counts, [32, 16, 12]);
    }
}
