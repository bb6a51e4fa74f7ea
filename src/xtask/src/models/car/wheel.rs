//! A wheel: tyre, rim and spokes; its axle along y, its outer face towards +y.

use super::super::{MeshPrimitive, PrimitiveBuilder, StaticMaterial};
use glam::Vec3;
use std::f32::consts::TAU;

pub(super) const WIDTH_M: f32 = 0.22;
const TYRE: StaticMaterial = StaticMaterial::new("tyre", [27, 27, 28]);
const RIM: StaticMaterial = StaticMaterial::new("rim", [176, 180, 185]).metal().rough(0.3);
/// Brake dust dulls the inner parts.
const LIP: StaticMaterial = StaticMaterial::new("lip", [96, 98, 101]).rough(0.7);
const DISC: StaticMaterial = StaticMaterial::new("disc", [34, 35, 37]);
const SPOKES: u32 = 5;

const SIDES: u32 = 16;
/// Rim and spokes as one, from a distance.
pub(super) const FAR_RIM: StaticMaterial = StaticMaterial::new("far_rim", [112, 114, 118]).rough(0.5);

fn turned(angle: f32, y: f32, r: f32) -> Vec3 {
    let (sin, cos) = angle.sin_cos();
    Vec3::new(r * sin, y, r * cos)
}

pub(super) fn wheel(radius: f32) -> Vec<MeshPrimitive> {
    let mut builder = PrimitiveBuilder::default();
    let sides = SIDES;
    let half = WIDTH_M / 2.0;
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
    builder.plate(&circle(half - 0.016, 0.30 * rim, 10), RIM, 240);
    builder.finish()
}

/// Coarse wheel. It is set slightly inwards, since the arch of a far body covers its top.
pub(super) fn far_wheel(radius: f32) -> Vec<MeshPrimitive> {
    const SIDES: u32 = 8;
    let mut builder = PrimitiveBuilder::default();
    let (half, rim) = (WIDTH_M / 2.0, 0.68 * radius);
    let outer = half - 0.03;
    let ring = |y: f32, r: f32| (0..=SIDES).map(|k| turned(TAU * k as f32 / SIDES as f32, y, r)).collect();
    let tyre: [Vec<Vec3>; 3] = [ring(-half, radius), ring(outer, radius), ring(outer, rim)];
    builder.grid(&tyre, |_| 170, |_, _| Some(TYRE));
    builder.plate(&circle(outer, rim, SIDES), FAR_RIM, 200);
    builder.plate(&inner_side(radius, -half, SIDES), TYRE, 60);
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
