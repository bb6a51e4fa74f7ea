//! The coarsest level of detail of a vehicle: flat sheets, and lamps, windows and wheels on them; some fifty triangles.

use super::heavy::HeavyShape;
use super::heavy_trim::BOX;
use super::shape::{CarShape, Rear};
use super::{
    GLASS, HALF_M, HEAD, INDICATOR, MeshPrimitive, PAINT, PLASTIC, PrimitiveBuilder, SEAM, StaticMaterial,
    TAIL, WHEEL_RADIUS_M, WHEELBASE_M,
};
use glam::Vec3;

/// How far what lies on a sheet stands out from it: more than depth is rounded by, a long way off.
const PROUD_M: f32 = 0.03;

/// Builds a body of sheets whose left and right halves mirror each other. Points are of the left half.
#[derive(Default)]
struct SheetBody(PrimitiveBuilder);

fn mirrored(at: Vec3) -> Vec3 {
    at.with_y(-at.y)
}

impl SheetBody {
    /// A sheet, counter-clockwise from outside, and its mirror image; with a material for each.
    fn twins(&mut self, corners: &[Vec3], [left, right]: [StaticMaterial; 2], openness: u8) {
        self.0.plate(corners, left, openness);
        let turned: Vec<Vec3> = corners.iter().rev().map(|&at| mirrored(at)).collect();
        self.0.plate(&turned, right, openness);
    }

    /// A sheet on both sides: its lower edge and its upper edge, each from the rear to the front.
    fn sides(&mut self, [low, high]: [[Vec3; 2]; 2], face_material: StaticMaterial) {
        self.twins(&[low[0], high[0], high[1], low[1]], [face_material; 2], 240);
    }

    /// A sheet across the whole width. It faces upwards where `to` is ahead of `from`, and forwards where `to` is below it.
    fn across(&mut self, from: Vec3, to: Vec3, face_material: StaticMaterial) {
        self.0.plate(&[from, mirrored(from), mirrored(to), to], face_material, 245);
    }

    /// Wheels: dark squares, so far from the middle.
    fn wheels(&mut self, wheelbase: f32, radius: f32, out: f32) {
        let out = out + PROUD_M;
        for axle in [-wheelbase / 2.0, wheelbase / 2.0] {
            let edge = |z: f32| [-0.9, 0.9].map(|part| Vec3::new(axle + part * radius, out, z));
            self.sides([edge(0.0), edge(1.9 * radius)], SEAM);
        }
    }

    /// Lamps on the front (1) or the rear (-1), the outer third of each an indicator: inner and outer edge, from below
    /// upwards.
    fn lamps(&mut self, facing: f32, [inner, outer]: [[Vec3; 2]; 2], lamp: StaticMaterial) {
        let middle = [0, 1].map(|k| outer[k].lerp(inner[k], 0.3));
        for ([from, to], face_materials) in [([inner, middle], [lamp; 2]), ([middle, outer], INDICATOR)] {
            let mut corners = [from[0], to[0], to[1], from[1]].map(|at| at + Vec3::X * facing * PROUD_M);
            if facing < 0.0 {
                corners.reverse();
            }
            self.twins(&corners, face_materials, 240);
        }
    }
}

/// A car of this shape.
pub(super) fn car(shape: &CarShape) -> Vec<MeshPrimitive> {
    let mut body = SheetBody::default();
    let [rear_foot, rear_roof, _, pillar, front_roof, front_foot] = shape.cabin.stations;
    // The ends are bowed: between their middle and their corners.
    let end = |facing: f32, t: f32| {
        let x = shape.end_x(facing, 0.75, t);
        Vec3::new(x, 0.95 * HALF_M, shape.sill + t * (shape.shoulder_at(x) - shape.sill))
    };
    let shoulder = |x: f32| Vec3::new(x, 0.97 * HALF_M, shape.shoulder_at(x));
    let [front_low, front_high] = [0.0, 1.0].map(|t| end(1.0, t));
    let [rear_low, rear_high] = [0.0, 1.0].map(|t| end(-1.0, t));
    let (rear_foot, front_foot) = (shoulder(rear_foot.max(rear_high.x + 0.05)), shoulder(front_foot));
    let hull = [rear_low, rear_high, rear_foot, front_foot, front_high, front_low];
    body.twins(&hull, [PAINT; 2], 215);
    body.across(front_high, front_low, PAINT);
    body.across(rear_low, rear_high, PAINT);
    body.across(front_foot, front_high, PAINT);
    body.across(rear_high, rear_foot, if shape.rear == Rear::Bed { PLASTIC } else { PAINT });
    let roof = |x: f32, z: f32| Vec3::new(x, 0.96 * shape.cabin.roof_half, z);
    let [rear_high, middle_high, front_high] = shape.cabin.roof;
    let (rear_roof, front_roof) = (roof(rear_roof, rear_high), roof(front_roof, front_high));
    let is_cargo = shape.rear == Rear::Cargo;
    let behind = if is_cargo { PAINT } else { GLASS };
    body.sides([[rear_foot, front_foot], [rear_roof, front_roof]], behind);
    if is_cargo {
        let out = Vec3::Y * PROUD_M;
        let [rear, front] = [[shoulder(pillar), roof(pillar, middle_high)], [front_foot, front_roof]];
        let edge = |up: f32| [rear, front].map(|[low, high]| low.lerp(high, up) + out);
        body.sides([edge(0.05), edge(0.85)], GLASS);
    }
    body.across(front_roof, front_foot, GLASS);
    body.across(rear_foot, rear_roof, behind);
    body.across(rear_roof, front_roof, PAINT);
    body.wheels(WHEELBASE_M, WHEEL_RADIUS_M, HALF_M);
    for (facing, lamp) in [(1.0, HEAD), (-1.0, TAIL)] {
        let is_tall = facing < 0.0 && shape.has_tall_lamps();
        let (rows, inner) = if is_tall { ([0.35, 0.9], 0.78) } else { ([0.6, 0.9], 0.55) };
        let edge = |part: f32| rows.map(|t| end(facing, t) * Vec3::new(1.0, part, 1.0));
        body.lamps(facing, [edge(inner), edge(1.0)], lamp);
    }
    body.0.finish()
}

/// A bus or truck of this shape.
pub(super) fn heavy(shape: &HeavyShape) -> Vec<MeshPrimitive> {
    let mut body = SheetBody::default();
    let hull_rows = shape.hull.rows;
    let (first, top_m) = (hull_rows[0], hull_rows[hull_rows.len() - 1].z);
    let shoulder = shape.at(top_m - 0.15);
    let half = 0.98 * first.half.max(shoulder.half);
    let heights = [(first, first.z), (shoulder, top_m - 0.03)];
    let [rear_low, rear_high] = heights.map(|(row, z)| Vec3::new(row.rear, half, z));
    let [front_low, front_high] = heights.map(|(row, z)| Vec3::new(row.front - 0.03, half, z));
    let (low, high) = ([rear_low, front_low], [rear_high, front_high]);
    body.sides([low, high], PAINT);
    body.across(front_high, front_low, PAINT);
    body.across(rear_low, rear_high, PAINT);
    body.across(rear_high, front_high, PAINT);
    // A place on the side, and one on an end, proud of them.
    let on_side = |x: f32, z: f32| Vec3::new(x, half + PROUD_M, z);
    let on_end = |facing: f32, y: f32, z: f32| {
        let [low, high] = if facing > 0.0 { [front_low, front_high] } else { [rear_low, rear_high] };
        low.lerp(high, (z - low.z) / (high.z - low.z)).with_y(y)
    };
    let rows = |range: [usize; 2]| range.map(|k| hull_rows[k].z);
    let windows = shape.hull.windows;
    let [rear, front] = [windows[0][0], windows[windows.len() - 1][1]];
    body.sides(rows(shape.hull.side_glass).map(|z| [rear, front].map(|x| on_side(x, z))), GLASS);
    let pane = |facing: f32, z: f32| on_end(facing, 0.88 * half, z) + Vec3::X * facing * PROUD_M;
    let [low, high] = rows(shape.hull.windscreen);
    body.across(pane(1.0, high), pane(1.0, low), GLASS);
    if let Some([low, high]) = shape.hull.rear_window.map(rows) {
        body.across(pane(-1.0, low), pane(-1.0, high), GLASS);
    }
    body.wheels(shape.wheelbase, shape.wheel_radius, shape.wheel_out.max(half));
    let edge = |y: f32| [0.55, 0.75].map(|z| on_end(1.0, y, z));
    body.lamps(1.0, [edge(half - 0.55), edge(half - 0.05)], HEAD);
    if shape.is_truck {
        cargo_box(&mut body, shape);
    } else {
        let edge = |y: f32| [0.95, 1.55].map(|z| on_end(-1.0, y, z));
        body.lamps(-1.0, [edge(half - 0.28), edge(half - 0.08)], TAIL);
    }
    body.0.finish()
}

/// The closed box of a truck and the bumper behind it.
fn cargo_box(body: &mut SheetBody, shape: &HeavyShape) {
    let (rear, front, half) = (-shape.length / 2.0 + 0.02, 1.26, 1.2);
    let edge = |z: f32| [rear, front].map(|x| Vec3::new(x, half, z));
    let (low, high) = (edge(0.9), edge(shape.height));
    body.sides([low, high], BOX);
    let strip = |z: f32| edge(z).map(|at| at + Vec3::Y * PROUD_M);
    body.sides([strip(1.06), strip(1.46)], PAINT);
    body.across(high[1], low[1], BOX);
    body.across(low[0], high[0], BOX);
    body.across(high[0], high[1], BOX);
    let bumper = |y: f32| [0.56, 0.86].map(|z| Vec3::new(rear, y, z));
    let [foot, top] = bumper(1.14);
    body.across(foot, top, PLASTIC);
    body.lamps(-1.0, [bumper(0.56), bumper(1.1)], TAIL);
}

#[cfg(test)]
mod tests {
    use super::super::{BUS, ESTATE, HATCHBACK, PICKUP, SEDAN, SUV, TAXI, TRUCK, VAN};
    use super::*;

    fn bodies() -> impl Iterator<Item = (&'static str, Vec<MeshPrimitive>)> {
        let cars = [SEDAN, HATCHBACK, SUV, VAN, PICKUP, TAXI, ESTATE];
        let cars = cars.into_iter().map(|shape| (shape.name, car(&shape)));
        cars.chain([BUS, TRUCK].into_iter().map(|shape| (shape.name, heavy(&shape))))
    }

    #[test]
    fn a_distant_body_is_some_fifty_triangles() {
        for (name, parts) in bodies() {
            let count: usize = parts.iter().map(|part| part.indices.len() / 3).sum();
            assert!((40..60).contains(&count), "{name}: {count}");
        }
    }

    /// From all around, and from above, the first sheet that a ray meets faces the eye: nobody looks into the body.
    #[test]
    fn a_distant_body_is_closed_but_below() {
        for (name, parts) in bodies() {
            let triangles: Vec<[Vec3; 3]> = parts
                .iter()
                .flat_map(|part| {
                    let corner = |&k: &u32| part.vertices[k as usize].position;
                    part.indices.chunks_exact(3).map(move |t| [corner(&t[0]), corner(&t[1]), corner(&t[2])])
                })
                .collect();
            for turn in 0..64 {
                let (sin, cos) = (std::f32::consts::TAU * (turn as f32 + 0.3) / 64.0).sin_cos();
                for (height, x, z) in [(1.2, -1.2, 0.95), (12.0, 0.1, 0.7), (30.0, 2.0, 0.5), (6.0, 0.9, 1.0)]
                {
                    let (eye, aim) = (Vec3::new(40.0 * cos, 40.0 * sin, height), Vec3::new(x, 0.13, z));
                    let hits = triangles.iter().filter_map(|t| hit(eye, aim - eye, t));
                    let first = hits.min_by(|a, b| a.0.total_cmp(&b.0));
                    assert!(
                        first.is_some_and(|(_, is_front)| is_front),
                        "{name}: from {eye} to {aim} {first:?}"
                    );
                }
            }
        }
    }

    /// Distance along a ray, and whether the triangle faces its start (Möller, Trumbore 1997).
    fn hit(eye: Vec3, along: Vec3, [a, b, c]: &[Vec3; 3]) -> Option<(f32, bool)> {
        let (u, v) = (b - a, c - a);
        let normal = u.cross(v);
        let facing = normal.dot(along);
        let at = normal.dot(a - eye) / facing;
        let on = eye + at * along - a;
        let [s, t] = [on.cross(v), u.cross(on)].map(|cross| cross.dot(normal) / normal.length_squared());
        (facing != 0.0 && at > 0.0 && s >= 0.0 && t >= 0.0 && s + t <= 1.0).then_some((at, facing < 0.0))
    }
}
