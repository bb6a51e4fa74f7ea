//! Parked cars in the bays of car parks.

use super::SceneObject;
use super::car_parks::{CAR_PARK_M, ParkingBay, bays_of};
use super::mesh::{Class, Finish, Mesh, Surface, Vertex};
use city3d_models::{Measures, MeshPrimitive, fitted, glb, shipped};
use city3d_roadmap::{CityMap, Footprint, SceneryKind};
use glam::{Affine3A, Mat3, Vec3};

/// Share of occupied bays.
const TAKEN: f32 = 0.42;
/// Bays are narrower than the lanes of the testbed's wide cars: parked cars have usual dimensions.
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

/// The finish of a car material, in white.
fn finish_of(part: &MeshPrimitive) -> Finish {
    let colour = part.material.colour;
    let (surface, colour) = match part.material.name.as_str() {
        "paint" => (Surface::CarPaint, [255, 255, 255]),
        "glass" => (Surface::Glass, [255, 255, 255]),
        name if name.starts_with("indicator") => (Surface::Plain, [150, 84, 30]),
        _ if part.material.metallic > 0.5 => (Surface::Metal, colour),
        _ => (Surface::Plain, colour),
    };
    Finish::new(surface, colour, Class::Vehicle)
}

fn add(mesh: &mut Mesh, parts: &[MeshPrimitive], place: impl Fn(Vec3) -> Vec3, turn: impl Fn(Vec3) -> Vec3) {
    for part in parts {
        let finish = finish_of(part);
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

/// Shipped bodies and their heights.
const BODIES: [(&str, f32); 4] =
    [("hatchback.glb", 1.48), ("sedan.glb", SEDAN_M), ("suv.glb", 1.74), ("van.glb", 2.10)];
const SEDAN_M: f32 = 1.45;

/// Errors of the coarser bodies: their corners are no farther off the finest one.
const COARSER_M: [f32; 3] = [0.16, 0.25, 0.4];

/// A white car at all levels of detail, origin at the middle of its outline on the ground.
fn car_object((file, height): (&str, f32)) -> SceneObject {
    let height = SIZE.height * height / SEDAN_M * if height > 2.0 { 0.95 } else { 1.0 };
    let model = shipped(file).and_then(|bytes| glb::read(bytes).ok()).unwrap_or_default();
    let model = fitted(&model, &Measures { height, ..SIZE });
    let half_track = model.half_track.unwrap_or(0.8);
    let assembled = |body: &[MeshPrimitive], wheel: &[MeshPrimitive]| {
        let mut mesh = Mesh::default();
        add(&mut mesh, body, |v| v, |n| n);
        for (x, side) in [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0_f32)] {
            let hub = Vec3::new(x * SIZE.wheelbase / 2.0, side * half_track, SIZE.wheel_radius);
            let about = |v: Vec3| Vec3::new(side * v.x, side * v.y, v.z);
            add(&mut mesh, wheel, |v| hub + about(v), about);
        }
        mesh
    };
    let mut object = SceneObject::of_one_level(assembled(&model.body, &model.wheel));
    let far_wheel = model.far_wheel.as_ref().unwrap_or(&model.wheel);
    let coarser = [(&model.far_body, &far_wheel[..]), (&model.farther_body, &[]), (&model.distant_body, &[])];
    for ((body, wheel), error_m) in coarser.into_iter().zip(COARSER_M) {
        let mesh = body.as_ref().map(|body| assembled(body, wheel)).unwrap_or_default();
        object.add_level(mesh, error_m);
    }
    object.add_coarser_levels();
    object
}

/// Parks cars in some bays of car parks with these driveways.
pub(super) fn cars(map: &CityMap, drives: &[&Footprint]) -> Vec<SceneObject> {
    let mut parked = Vec::new();
    let bodies = BODIES.map(car_object);
    /// Body types by frequency.
    const USUAL: [usize; 7] = [0, 1, 2, 0, 3, 2, 1];
    let parks = map.scenery.iter().enumerate().filter(|(_, piece)| piece.kind == SceneryKind::Parking);
    for (index, piece) in parks {
        let Footprint::Polygon(ring) = &piece.shape else { continue };
        let bays = bays_of(&super::polygon::counter_clockwise(ring), drives);
        for (number, ParkingBay { middle, ahead }) in bays.into_iter().enumerate() {
            let hash_to_unit = |salt: u32| super::hash_to_unit(index as u32 * 131 + number as u32, salt);
            // The first bay is for wheelchairs.
            if number == 0 || hash_to_unit(1) > TAKEN {
                continue;
            }
            let body = &bodies[USUAL[(hash_to_unit(2) * USUAL.len() as f32) as usize % USUAL.len()]];
            let colour = COLOURS[(hash_to_unit(3) * COLOURS.len() as f32) as usize % COLOURS.len()];
            // Some have backed in.
            let (middle, into) = (middle.as_vec2(), ahead.as_vec2());
            let ahead = into * if hash_to_unit(4) < 0.3 { -1.0 } else { 1.0 };
            let middle = middle
                + into * (0.3 * hash_to_unit(5) - 0.3)
                + into.perp() * (0.24 * (hash_to_unit(6) - 0.5));
            let turn = Mat3::from_cols(ahead.extend(0.0), ahead.perp().extend(0.0), Vec3::Z);
            let place = Affine3A::from_mat3_translation(turn, middle.extend(CAR_PARK_M));
            parked.push(body.placed(place, |finish| match finish.surface {
                Surface::CarPaint => Finish { colour, ..finish },
                _ => finish,
            }));
        }
    }
    parked
}
