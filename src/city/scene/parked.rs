//! Cars that stand in the bays of car parks.

use super::grounds::{Bay, bays_of};
use super::mesh::{Class, Finish, Mesh, Surface, Vertex};
use crate::city::{CityMap, SceneryKind, Shape};
use crate::model::{Measures, Part, car, fitted};
use glam::Vec3;

/// How many of a hundred bays are taken.
const TAKEN: f32 = 0.52;
/// Height of a car park's asphalt.
const GROUND_M: f32 = 0.165;
/// Bays are narrower than the lanes of the testbed's wide cars: what stands in them is of usual size.
const SIZE: Measures =
    Measures { length: 4.35, width: 2.06, height: 1.46, wheelbase: 2.6, wheel_radius: 0.32 };

const COLOURS: [[u8; 3]; 8] = [
    [206, 208, 206],
    [60, 64, 70],
    [136, 142, 148],
    [28, 30, 34],
    [122, 30, 34],
    [38, 66, 110],
    [186, 178, 160],
    [74, 92, 80],
];

/// The look of a material of a car in the street.
fn finish_of(part: &Part, paint: [u8; 3]) -> Finish {
    let colour = part.material.colour;
    let (surface, colour) = match part.material.name.as_str() {
        "paint" => (Surface::CarPaint, paint),
        "glass" => (Surface::Glass, [255, 255, 255]),
        name if name.starts_with("indicator") => (Surface::Plain, [150, 84, 30]),
        _ if part.material.metallic > 0.5 => (Surface::Metal, colour),
        _ => (Surface::Plain, colour),
    };
    Finish::new(surface, colour, Class::Vehicle)
}

fn add(
    mesh: &mut Mesh,
    parts: &[Part],
    paint: [u8; 3],
    place: impl Fn(Vec3) -> Vec3,
    turn: impl Fn(Vec3) -> Vec3,
) {
    for part in parts {
        let finish = finish_of(part, paint);
        let base = mesh.vertices.len() as u32;
        mesh.vertices.extend(part.vertices.iter().map(|v| Vertex {
            position: place(v.position),
            normal: turn(v.normal),
            uv: v.position.truncate(),
            finish,
            openness: v.openness,
        }));
        mesh.indices.extend(part.indices.iter().map(|k| k + base));
    }
}

/// Parks cars in some bays.
pub(super) fn cars([near, far]: [&mut Mesh; 2], map: &CityMap) {
    let shapes = [car::HATCHBACK, car::SEDAN, car::SUV, car::HATCHBACK, car::VAN, car::SUV, car::SEDAN];
    let models = shapes.map(|shape| {
        let height =
            SIZE.height * shape.height / car::SEDAN.height * if shape.height > 2.0 { 0.95 } else { 1.0 };
        fitted(&car::model(&shape), &Measures { height, ..SIZE })
    });
    let parks = map.scenery.iter().enumerate().filter(|(_, piece)| piece.kind == SceneryKind::Parking);
    for (index, piece) in parks {
        let Shape::Polygon(ring) = &piece.shape else { continue };
        for (number, Bay { mouth, into }) in
            bays_of(&super::polygon::counter_clockwise(ring)).into_iter().enumerate()
        {
            let dice = |salt: u32| super::dice(index as u32 * 131 + number as u32, salt);
            if dice(1) > TAKEN {
                continue;
            }
            let model = &models[(dice(2) * models.len() as f32) as usize % models.len()];
            let paint = COLOURS[(dice(3) * COLOURS.len() as f32) as usize % COLOURS.len()];
            // Some have backed in.
            let ahead = into.as_vec2() * if dice(4) < 0.3 { -1.0 } else { 1.0 };
            let middle = mouth.as_vec2()
                + into.as_vec2() * (SIZE.length / 2.0 + 0.25 + 0.3 * dice(5))
                + into.as_vec2().perp() * (0.24 * (dice(6) - 0.5));
            let left = ahead.perp();
            let turn = |v: Vec3| (ahead * v.x + left * v.y).extend(v.z);
            let place = |v: Vec3| turn(v) + middle.extend(GROUND_M);
            let half_track = model.half_track.unwrap_or(0.8);
            // The bodies for a distance: a car park of full ones would cost more than the street.
            let (body, wheel) = (
                model.far_body.as_ref().unwrap_or(&model.body),
                model.far_wheel.as_ref().unwrap_or(&model.wheel),
            );
            for mesh in [&mut *near, &mut *far] {
                add(mesh, body, paint, place, turn);
                for (x, side) in [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0_f32)] {
                    let hub = Vec3::new(x * SIZE.wheelbase / 2.0, side * half_track, SIZE.wheel_radius);
                    let about = |v: Vec3| Vec3::new(side * v.x, side * v.y, v.z);
                    add(mesh, wheel, paint, |v| place(hub + about(v)), |n| turn(about(n)));
                }
            }
        }
    }
}
