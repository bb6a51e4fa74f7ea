//! Trim of a bus or truck: lamps, mirrors, the box of the truck, plates, wipers and joints.

use super::heavy::{HeavyShape, end_at, on_end, on_side};
use super::{
    CHROME, CarDetail, GRILLE, HEAD, INDICATOR, PAINT, PLASTIC, PLATE, PrimitiveBuilder, REVERSE, SEAM,
    StaticMaterial, TAIL, WELL, WIPER, trim,
};
use glam::Vec3;

/// The closed sides of the cargo space: white plastic.
pub(super) const BOX: StaticMaterial = StaticMaterial::new("box", [222, 224, 226]).rough(0.45);
/// Of the destination display.
pub(super) const AMBER: StaticMaterial = StaticMaterial::new("amber", [236, 160, 40]).rough(0.6);

pub(super) fn lamps(builder: &mut PrimitiveBuilder, shape: &HeavyShape, detail: CarDetail) {
    let near = detail.is_near();
    let front = shape.hull.rows[2].half - 0.10;
    let z = 0.72;
    let rear = if shape.is_truck { 1.08 } else { shape.hull.rows[2].half - 0.12 };
    // The tail lamps of a truck are below its box.
    let (low, high) = if shape.is_truck { (0.66, 0.80) } else { (0.95, 1.55) };
    for side in [1.0_f32, -1.0] {
        let indicator = INDICATOR[usize::from(side < 0.0)];
        let across = |a: f32, b: f32| if side > 0.0 { [b, a] } else { [-a, -b] };
        let out = if near { 0.012 } else { 0.03 };
        if near {
            on_end(
                builder,
                shape,
                (1.0, 0.006),
                [across(front + 0.03, front - 0.51), [z - 0.20, z + 0.05]],
                SEAM,
            );
        }
        on_end(builder, shape, (1.0, out), [across(front - 0.14, front - 0.30), [z - 0.17, z + 0.02]], HEAD);
        on_end(builder, shape, (1.0, out), [across(front - 0.32, front - 0.48), [z - 0.17, z + 0.02]], HEAD);
        on_end(builder, shape, (1.0, out), [across(front, front - 0.12), [z - 0.17, z + 0.02]], indicator);
        let part = (high - low) / 3.0;
        if shape.is_truck {
            let wide = 0.16;
            for (k, lamp) in [indicator, TAIL, REVERSE].into_iter().enumerate() {
                let from = rear - k as f32 * (wide + 0.02);
                on_end(builder, shape, (-1.0, out), [across(from, from - wide), [low, high]], lamp);
            }
        } else {
            for (k, lamp) in [REVERSE, TAIL, indicator].into_iter().enumerate() {
                let from = low + k as f32 * part;
                on_end(
                    builder,
                    shape,
                    (-1.0, out),
                    [across(rear, rear - 0.16), [from, from + part - 0.03]],
                    lamp,
                );
            }
        }
    }
}

/// Housings before the upper corners, on arms.
pub(super) fn mirrors(builder: &mut PrimitiveBuilder, shape: &HeavyShape, detail: CarDetail) {
    let out = shape.width / 2.0;
    let (x, z, inner) = if shape.is_truck { (3.05, 1.52, 1.07) } else { (5.42, 1.75, 1.24) };
    for side in [1.0_f32, -1.0] {
        let span = |a: f32, b: f32| if side > 0.0 { [a, b] } else { [-b, -a] };
        let [low, high] = span(inner, out);
        if detail == CarDetail::Farther {
            // What is seen from the front and from behind.
            for y in [[low, high], [high, low]] {
                let corners = [(y[0], z), (y[1], z), (y[1], z + 0.42), (y[0], z + 0.42)];
                builder.plate(&corners.map(|(y, z)| Vec3::new(x, y, z)), PLASTIC, 230);
            }
            continue;
        }
        builder.block(Vec3::new(x - 0.05, low, z), Vec3::new(x + 0.06, high, z + 0.42), PLASTIC, 230);
        if detail.is_near() {
            let [low, high] = span(inner - 0.22, inner + 0.04);
            builder.block(
                Vec3::new(x - 0.02, low, z + 0.34),
                Vec3::new(x + 0.02, high, z + 0.38),
                PLASTIC,
                230,
            );
            let y = if side > 0.0 { [high + 0.10, inner + 0.02] } else { [-inner - 0.02, low - 0.10] };
            let y = [y[0].max(y[1]).min(out - 0.015), y[0].min(y[1]).max(-out + 0.015)];
            let glass = [(y[0], z + 0.03), (y[1], z + 0.03), (y[1], z + 0.39), (y[0], z + 0.39)];
            builder.plate(&glass.map(|(y, z)| Vec3::new(x - 0.052, y, z)), CHROME, 255);
        }
    }
}

/// Air conditioning on the roof of a bus, flush with its highest point.
pub(super) fn roof_unit(builder: &mut PrimitiveBuilder, detail: CarDetail) {
    if detail.is_near() {
        builder.block(Vec3::new(-3.6, -0.75, 2.95), Vec3::new(-1.6, 0.75, 3.048), BOX, 240);
    }
}

/// Chassis, cargo box with a stripe of paint, rear doors, guards.
pub(super) fn cargo_box(builder: &mut PrimitiveBuilder, shape: &HeavyShape, detail: CarDetail) {
    let (rear, front) = (-shape.length / 2.0 + 0.02, 1.26);
    let (half, low, high) = (1.2, 0.94, shape.height);
    if detail != CarDetail::Farther {
        builder.block(Vec3::new(rear + 0.1, -0.5, 0.52), Vec3::new(1.5, 0.5, low + 0.02), WELL, 90);
    }
    let edge = 0.05;
    if !detail.is_near() {
        builder.block(Vec3::new(rear, -half, low), Vec3::new(front, half, high), BOX, 245);
    } else {
        chamfered(builder, [Vec3::new(rear, -half, low), Vec3::new(front, half, high)], edge, BOX);
    }
    for side in [1.0_f32, -1.0] {
        let strip = |builder: &mut PrimitiveBuilder, [x, z]: [[f32; 2]; 2], material| {
            let y = side * (half + 0.004);
            let x = if side > 0.0 { [x[1], x[0]] } else { x };
            let corners = [(x[0], z[0]), (x[1], z[0]), (x[1], z[1]), (x[0], z[1])];
            builder.plate(&corners.map(|(x, z)| Vec3::new(x, y, z)), material, 245);
        };
        strip(builder, [[rear + edge, front - edge], [low + 0.12, low + 0.52]], PAINT);
        if detail == CarDetail::Farther {
            continue;
        }
        // Side guards and the tank.
        let y = [side * 0.92, side * 0.98];
        let [a, b] = [y[0].min(y[1]), y[0].max(y[1])];
        for z in [0.48, 0.70] {
            builder.block(Vec3::new(-1.3, a, z), Vec3::new(1.2, b, z + 0.10), PLASTIC, 170);
        }
        if detail.is_near() {
            let y = [side * 0.52, side * 0.90];
            let [a, b] = [y[0].min(y[1]), y[0].max(y[1])];
            builder.block(Vec3::new(0.1, a, 0.46), Vec3::new(1.0, b, 0.86), CHROME, 150);
            // Mudguards.
            let (x, y) = (-shape.wheelbase / 2.0, [side * 0.72, side * 1.04]);
            let [a, b] = [y[0].min(y[1]), y[0].max(y[1])];
            builder.block(Vec3::new(x - 0.5, a, 0.86), Vec3::new(x + 0.5, b, 0.92), PLASTIC, 120);
            builder.block(Vec3::new(x - 0.54, a, 0.36), Vec3::new(x - 0.5, b, 0.92), PLASTIC, 120);
        }
    }
    // Bumper that carries the lamps.
    builder.block(Vec3::new(rear, -1.14, 0.56), Vec3::new(rear + 0.12, 1.14, 0.86), PLASTIC, 170);
    if detail.is_near() {
        for y in [-0.02, -half + 0.09, half - 0.11] {
            on_end(builder, shape, (-1.0, 0.012), [[y, y + 0.02], [low + 0.08, high - 0.10]], SEAM);
        }
        for y in [-0.42, -0.24, 0.22, 0.40] {
            on_end(builder, shape, (-1.0, 0.016), [[y, y + 0.02], [low + 0.05, high - 0.06]], CHROME);
        }
    }
}

/// A box with broken edges along its length and around its ends.
fn chamfered(
    builder: &mut PrimitiveBuilder,
    [low, high]: [Vec3; 2],
    edge: f32,
    face_material: StaticMaterial,
) {
    let ring = |x: f32, inset: f32| -> Vec<Vec3> {
        let (y, z0, z1) = (high.y - inset, low.z + inset, high.z - inset);
        let e = edge;
        let half = [(y, z0 + e), (y, z1 - e), (y - e, z1)];
        let mut ring: Vec<Vec3> = half.iter().map(|&(y, z)| Vec3::new(x, y, z)).collect();
        ring.extend(half.iter().rev().map(|&(y, z)| Vec3::new(x, -y, z)));
        ring.extend([Vec3::new(x, -(y - e), z0), Vec3::new(x, y - e, z0)]);
        ring
    };
    let rings = [ring(low.x, edge), ring(low.x + edge, 0.0), ring(high.x - edge, 0.0), ring(high.x, edge)];
    let count = rings[0].len();
    for pair in rings.windows(2) {
        for k in 0..count {
            let n = (k + 1) % count;
            builder.plate(&[pair[0][k], pair[0][n], pair[1][n], pair[1][k]], face_material, 245);
        }
    }
    builder.plate(&rings[3], face_material, 230);
    let rear: Vec<Vec3> = rings[0].iter().rev().copied().collect();
    builder.plate(&rear, face_material, 240);
}

/// Half the width of a number plate.
const PLATE_HALF_M: f32 = 0.26;
/// The number plates: front (1) or rear (-1) and how proud of it, and z of their edges.
const PLATES: [((f32, f32), [f32; 2]); 2] = [((1.0, 0.012), [0.44, 0.55]), ((-1.0, 0.014), [0.62, 0.73])];

/// Letters and digits on the number plates.
pub(super) fn registrations(builder: &mut PrimitiveBuilder, shape: &HeavyShape) {
    for ((facing, out), z) in PLATES {
        let [low, high] = z.map(|z| end_at(shape, (facing, out), PLATE_HALF_M, z));
        // Upright, before the whole of a plate that leans.
        let x = facing * (facing * low.x).max(facing * high.x) + facing * 0.002;
        trim::registration(builder, facing, Vec3::new(x, 0.0, (low.z + high.z) / 2.0));
    }
}

/// Number plates, wipers, joints of the bumper, and the display of a bus.
pub(super) fn trim(builder: &mut PrimitiveBuilder, shape: &HeavyShape) {
    let hull = &shape.hull;
    for (end, z) in PLATES {
        on_end(builder, shape, end, [[-PLATE_HALF_M, PLATE_HALF_M], z], PLATE);
    }
    let joint = hull.rows[2].z + 0.06;
    for [a, b] in [[-0.9, -0.45], [-0.45, 0.0], [0.0, 0.45], [0.45, 0.9]] {
        on_end(builder, shape, (1.0, 0.004), [[a, b], [joint, joint + 0.012]], SEAM);
        on_end(builder, shape, (-1.0, 0.004), [[a, b], [joint, joint + 0.012]], SEAM);
    }
    let foot = hull.rows[hull.windscreen[0]].z;
    for y in [-0.55, 0.25] {
        // Wipers at rest.
        on_end(builder, shape, (1.0, 0.02), [[y, y + 0.28], [foot + 0.02, foot + 0.04]], WIPER);
        on_end(builder, shape, (1.0, 0.02), [[y + 0.28, y + 0.56], [foot + 0.03, foot + 0.05]], WIPER);
    }
    for side in [1.0_f32, -1.0] {
        let (from, to) = if shape.is_truck { (1.62, 2.72) } else { (-5.0, 5.0) };
        if shape.is_truck {
            for x in [1.56, 2.78] {
                on_side(builder, shape, (side, 0.004), [[x, x + 0.012], [0.98, 2.05]], SEAM);
            }
            on_side(builder, shape, (side, 0.012), [[1.66, 1.84], [1.18, 1.22]], PLASTIC);
        } else {
            for [a, b] in [[from, -3.45], [-2.15, 2.15], [3.45, to]] {
                on_side(builder, shape, (side, 0.004), [[a, b], [0.72, 0.732]], SEAM);
            }
        }
    }
    if !shape.is_truck {
        let z = [2.52, 2.72];
        on_end(builder, shape, (1.0, 0.012), [[-0.62, -0.48], z], AMBER);
        on_end(builder, shape, (1.0, 0.012), [[-0.40, 0.60], [2.57, 2.67]], AMBER);
        on_end(builder, shape, (-1.0, 0.012), [[-0.45, 0.45], [0.78, 0.92]], GRILLE);
    }
}
