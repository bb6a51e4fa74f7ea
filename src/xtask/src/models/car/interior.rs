//! What is seen through the glass of a near car: lining, seats, steering wheel and driver.

use super::shape::{CarShape, Rear};
use super::{PrimitiveBuilder, StaticMaterial, cabin};
use city3d_models::MeshPrimitive;
use glam::Vec3;
use std::f32::consts::TAU;

pub(super) const LINING: StaticMaterial = StaticMaterial::new("lining", [88, 86, 83]);
const BULKHEAD: StaticMaterial = StaticMaterial::new("bulkhead", [60, 62, 66]);
const SEAT: StaticMaterial = StaticMaterial::new("seat", [112, 106, 98]);
const CARPET: StaticMaterial = StaticMaterial::new("carpet", [48, 50, 55]);
const WHEEL: StaticMaterial = StaticMaterial::new("steering_wheel", [24, 24, 26]).rough(0.6);
const SKIN: StaticMaterial = StaticMaterial::new("skin", [206, 160, 132]);
const HAIR: StaticMaterial = StaticMaterial::new("hair", [62, 44, 34]);
const SHIRT: StaticMaterial = StaticMaterial::new("shirt", [92, 116, 150]);
const EYE: StaticMaterial = StaticMaterial::new("skin.eye", [226, 222, 216]);
const PUPIL: StaticMaterial = StaticMaterial::new("skin.pupil", [34, 28, 26]);
const LIPS: StaticMaterial = StaticMaterial::new("skin.lips", [158, 84, 78]);
/// Little of the sky's light comes in.
pub(super) const INSIDE: u8 = 150;

/// Lines what has been built of shell and cabin: their faces from inside, between the feet of the windows.
pub(super) fn lining(parts: &[MeshPrimitive], shape: &CarShape) -> PrimitiveBuilder {
    let [rear, .., front] = shape.cabin.stations;
    lined(parts, |at| (rear - 0.12..front + 0.06).contains(&at.x) && at.z > 0.3)
}

/// The faces of sheet metal and plastic from inside, a little further in, where all corners are to be lined.
pub(super) fn lined(parts: &[MeshPrimitive], is_lined: impl Fn(Vec3) -> bool) -> PrimitiveBuilder {
    let mut builder = PrimitiveBuilder::default();
    for part in parts.iter().filter(|part| matches!(part.material.name.as_str(), "paint" | "plastic")) {
        for triangle in part.indices.chunks_exact(3) {
            let corners = [triangle[0], triangle[2], triangle[1]].map(|k| &part.vertices[k as usize]);
            if corners.iter().all(|corner| is_lined(corner.position)) {
                let placed = corners.map(|corner| {
                    let inner = corner.position - 0.025 * corner.normal;
                    // At the ridge of a roof, where faces end in a point, normals lean anywhere.
                    let under = inner.with_z(inner.z.min(corner.position.z - 0.005));
                    builder.vertex(LINING, under, -corner.normal, 130)
                });
                builder.triangle(LINING, placed);
            }
        }
    }
    builder
}

pub(super) fn interior(builder: &mut PrimitiveBuilder, shape: &CarShape) {
    let [rear, _, _, pillar, _, front] = shape.cabin.stations;
    // Seats rise with the windows.
    let belt = shape.shoulder_at(0.0);
    let floor = belt - 0.58;
    let half = shape.half_at(0.0) * 0.9;
    let corners = [(rear, -half), (front, -half), (front, half), (rear, half)];
    builder.plate(&corners.map(|(x, y)| Vec3::new(x, y, floor)), CARPET, 60);
    // Housings of the rear wheels: through the arches one would see the road.
    let axle = -super::WHEELBASE_M / 2.0;
    if rear < axle && shape.rear != Rear::Cargo {
        for side in [-1.0_f32, 1.0] {
            let (inner, outer) = (side * 0.60, side * 0.93);
            let low = Vec3::new(axle - 0.48, inner.min(outer), floor);
            builder.block(low, Vec3::new(axle + 0.48, inner.max(outer), 0.84), CARPET, 90);
        }
    }
    let first = front - 1.14;
    let mut rows = vec![first];
    // A second row where there is a door for it.
    if first - 0.95 > rear + 0.45 && pillar - rear > 1.0 && shape.height < 2.0 {
        rows.push(first - 0.92);
    }
    for (k, x) in rows.into_iter().enumerate() {
        // Who sits behind sits higher, and most so in a high car, whose rear window one looks up to.
        let behind = if shape.height > 1.6 { 0.16 } else { 0.06 };
        let up = if k == 1 { behind } else { 0.0 };
        for y in [-0.42, 0.42] {
            seat(builder, Vec3::new(x, y, floor + up));
        }
        if k == 1 {
            bench(builder, Vec3::new(x, 0.0, floor + up));
            parcel_shelf(builder, shape, [rear, x - 0.34]);
        }
    }
    cabin::headers(builder, shape, LINING);
    driver(builder, Vec3::new(first, 0.42, floor));
    if shape.rear == Rear::Cargo {
        // The wall between the cab and the load.
        let (low, high) = (Vec3::new(pillar - 0.10, -0.80, floor), Vec3::new(pillar - 0.06, 0.80, 1.95));
        builder.block(low, high, BULKHEAD, INSIDE);
    }
}

/// The middle of a rear bench, with its headrest.
fn bench(builder: &mut PrimitiveBuilder, at: Vec3) {
    let mut block = |[low, high]: [[f32; 3]; 2]| {
        builder.block(at + Vec3::from(low), at + Vec3::from(high), SEAT, INSIDE);
    };
    block([[-0.34, -0.3, 0.1], [-0.24, 0.3, 0.62]]);
    block([[-0.39, -0.24, 0.52], [-0.29, 0.24, 0.72]]);
    block([[-0.38, -0.10, 0.75], [-0.31, 0.10, 0.86]]);
}

/// The shelf between the rear bench and the rear window, which hides the boot: from behind one would look into a box.
fn parcel_shelf(builder: &mut PrimitiveBuilder, shape: &CarShape, [rear, front]: [f32; 2]) {
    const STEPS: u8 = 3;
    let row = |k: u8| {
        let x = rear - 0.02 + (front - rear + 0.02) * f32::from(k) / f32::from(STEPS);
        let (half, z) = (shape.half_at(x) * 0.88, shape.shoulder_at(x) - 0.015);
        vec![Vec3::new(x, half, z), Vec3::new(x, -half, z)]
    };
    let rows: Vec<Vec<Vec3>> = (0..=STEPS).rev().map(row).collect();
    builder.grid(&rows, |_| 110, |_, _| Some(CARPET));
}

pub(super) fn seat(builder: &mut PrimitiveBuilder, at: Vec3) {
    let mut block = |[x, y, z]: [[f32; 2]; 3]| {
        let [low, high] = [0, 1].map(|k| at + Vec3::new(x[k], y[k], z[k]));
        builder.block(low, high, SEAT, INSIDE);
    };
    block([[-0.26, 0.26], [-0.24, 0.24], [0.12, 0.26]]);
    block([[-0.36, -0.24], [-0.24, 0.24], [0.2, 0.52]]);
    block([[-0.39, -0.29], [-0.21, 0.21], [0.52, 0.74]]);
    block([[-0.39, -0.31], [-0.12, 0.12], [0.77, 0.92]]);
}

/// Torso, arms and head of a driver, and the steering wheel.
pub(super) fn driver(builder: &mut PrimitiveBuilder, at: Vec3) {
    const SIDES: usize = 8;
    person(builder, at, SIDES, [SHIRT, HAIR]);
    face(builder, at, SIDES, HAIR);
    wheel(builder, at);
}

/// Who sits on a bench: one of a few, by number.
pub(super) fn passenger(builder: &mut PrimitiveBuilder, at: Vec3, number: usize) {
    const COATS: [StaticMaterial; 4] = [
        StaticMaterial::new("shirt.red", [150, 62, 52]),
        StaticMaterial::new("shirt.sand", [196, 186, 160]),
        StaticMaterial::new("shirt.green", [58, 84, 70]),
        StaticMaterial::new("shirt.grey", [70, 72, 82]),
    ];
    const HAIRS: [StaticMaterial; 3] = [
        StaticMaterial::new("hair.fair", [128, 90, 56]),
        StaticMaterial::new("hair.grey", [150, 146, 140]),
        StaticMaterial::new("hair.dark", [36, 30, 28]),
    ];
    let [coat, hair] = [COATS[number % COATS.len()], HAIRS[number % HAIRS.len()]];
    person(builder, at, 6, [coat, hair]);
}

/// Torso, arms and head of who sits, of so many sides.
fn person(builder: &mut PrimitiveBuilder, at: Vec3, sides: usize, [shirt, hair]: [StaticMaterial; 2]) {
    // Rings around an upright axis: height, half depth, half width.
    let body = |builder: &mut PrimitiveBuilder, rings: &[[f32; 4]], material: StaticMaterial| {
        let ring = |&[z, x, deep, wide]: &[f32; 4]| -> Vec<Vec3> {
            (0..=sides)
                .map(|k| {
                    let (sin, cos) = (TAU * k as f32 / sides as f32).sin_cos();
                    at + Vec3::new(x + deep * cos, wide * sin, z)
                })
                .collect()
        };
        let points: Vec<Vec<Vec3>> = rings.iter().map(ring).collect();
        builder.grid(&points, |_| 190, |_, _| Some(material));
    };
    body(
        builder,
        &[
            [0.24, -0.08, 0.14, 0.19],
            [0.45, -0.13, 0.13, 0.20],
            [0.66, -0.16, 0.12, 0.23],
            [0.74, -0.16, 0.06, 0.10],
        ],
        shirt,
    );
    body(builder, &[[0.72, -0.15, 0.05, 0.05], [0.80, -0.14, 0.055, 0.055]], SKIN);
    body(
        builder,
        &[
            [0.765, -0.100, 0.050, 0.034],
            [0.795, -0.115, 0.088, 0.060],
            [0.850, -0.120, 0.100, 0.077],
            [0.940, -0.125, 0.100, 0.079],
        ],
        SKIN,
    );
    body(
        builder,
        &[
            [0.86, -0.165, 0.075, 0.082],
            [0.915, -0.155, 0.100, 0.086],
            [0.955, -0.140, 0.106, 0.086],
            [0.985, -0.14, 0.085, 0.065],
            [1.005, -0.14, 0.0, 0.0],
        ],
        hair,
    );
    for y in [-0.21_f32, 0.21] {
        let (low, high) = (Vec3::new(-0.16, y - 0.045, 0.46), Vec3::new(0.02, y + 0.045, 0.60));
        builder.block(at + low, at + high, shirt, INSIDE);
        let (low, high) = (Vec3::new(0.0, 0.75 * y - 0.04, 0.50), Vec3::new(0.32, 0.75 * y + 0.04, 0.58));
        builder.block(at + low, at + high, SKIN, INSIDE);
    }
}

/// Eyes, brows, nose and mouth of who sits, before the front sides of the head.
fn face(builder: &mut PrimitiveBuilder, at: Vec3, sides: usize, brow: StaticMaterial) {
    let (sin, cos) = (TAU / sides as f32).sin_cos();
    let slope = (1.0 - cos) / sin * 0.100 / 0.078;
    let on = |[y, z]: [f32; 2], proud_m: f32| {
        let chin = (0.850 - z).max(0.0) * 0.22;
        at + Vec3::new(-0.021 - chin - slope * y.abs() + proud_m, y, z)
    };
    let mut patch = |[y, z]: [[f32; 2]; 2], proud_m: f32, material: StaticMaterial| {
        let corners = [[y[0], z[0]], [y[1], z[0]], [y[1], z[1]], [y[0], z[1]]];
        builder.plate(&corners.map(|corner| on(corner, proud_m)), material, 190);
    };
    for [inner, outer] in [[0.016_f32, 0.046], [-0.016, -0.046]] {
        let between = |from: f32, to: f32| {
            let ends = [from, to].map(|share| inner + (outer - inner) * share);
            [ends[0].min(ends[1]), ends[0].max(ends[1])]
        };
        patch([between(0.0, 1.0), [0.882, 0.896]], 0.003, EYE);
        patch([between(0.28, 0.74), [0.881, 0.897]], 0.004, PUPIL);
        patch([between(-0.1, 1.15), [0.905, 0.913]], 0.004, brow);
        patch([[inner.min(0.0) * 1.3, inner.max(0.0) * 1.3], [0.817, 0.826]], 0.003, LIPS);
    }
    let (bridge, tip) = (on([0.0, 0.893], 0.002), on([0.0, 0.852], 0.024));
    let [left, right] = [0.015, -0.015].map(|y| on([y, 0.845], 0.001));
    for corners in [[bridge, tip, left], [bridge, right, tip], [right, left, tip]] {
        builder.plate(&corners, SKIN, 190);
    }
}

/// The steering wheel before a driver.
fn wheel(builder: &mut PrimitiveBuilder, at: Vec3) {
    let middle = at + Vec3::new(0.34, 0.0, 0.55);
    let ring = |radius: f32, out: f32| -> Vec<Vec3> {
        (0..=14)
            .map(|k| {
                let (sin, cos) = (TAU * k as f32 / 14.0).sin_cos();
                // Leaning with its upper edge forward.
                middle + Vec3::new(0.35 * radius * sin + out, radius * cos, 0.94 * radius * sin)
            })
            .collect()
    };
    let tube = [ring(0.185, 0.0), ring(0.17, -0.018), ring(0.155, 0.0), ring(0.17, 0.018), ring(0.185, 0.0)];
    builder.grid(&tube, |_| INSIDE, |_, _| Some(WHEEL));
    let (low, high) = (Vec3::new(-0.01, -0.15, -0.03), Vec3::new(0.03, 0.15, 0.03));
    builder.block(middle + low, middle + high, WHEEL, INSIDE);
}
