//! Parked cars in the bays of car parks.

use super::car_parks::{CAR_PARK_M, ParkingBay, bays_of};
use super::mesh::{Class, Finish, Mesh, Surface, Vertex};
use super::{CloseUp, NEAR_ERROR_M, SceneObject};
use city3d_models::{Measures, MeshPrimitive, fitted, glb, is_for_clear_glass, shipped};
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
    let (surface, colour) = match part.material.name.split('.').next().unwrap_or_default() {
        "paint" => (Surface::CarPaint, [255, 255, 255]),
        "glass" => (Surface::Glass, [255, 255, 255]),
        "number" => (Surface::Number, colour),
        name if name.starts_with("indicator") => (Surface::Plain, [150, 84, 30]),
        _ if part.material.metallic > 0.5 => (Surface::Metal, colour),
        _ => (Surface::Plain, colour),
    };
    Finish::new(surface, colour, Class::Vehicle)
}

fn add<'a>(
    mesh: &mut Mesh,
    parts: impl IntoIterator<Item = &'a MeshPrimitive>,
    place: impl Fn(Vec3) -> Vec3,
    turn: impl Fn(Vec3) -> Vec3,
) {
    for part in parts {
        let finish = finish_of(part);
        let base = mesh.vertices.len() as u32;
        mesh.vertices.extend(part.vertices.iter().map(|v| Vertex {
            position: place(v.position),
            normal: turn(v.normal),
            uv: if finish.surface == Surface::Number { v.uv } else { v.position.truncate() },
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

/// A car of this colour at a place.
fn painted(body: &SceneObject, place: Affine3A, colour: [u8; 3]) -> SceneObject {
    body.placed(place, |finish| match finish.surface {
        Surface::CarPaint => Finish { colour, ..finish },
        _ => finish,
    })
}

/// A white car at all levels of detail, origin at the middle of its outline on the ground. That for cameras close by is the one of
/// moving cars, with opaque glass.
fn car_body((file, height): (&str, f32)) -> SceneObject {
    let height = SIZE.height * height / SEDAN_M * if height > 2.0 { 0.95 } else { 1.0 };
    let model = shipped(file).and_then(|bytes| glb::read(bytes).ok()).unwrap_or_default();
    let model = fitted(&model, &Measures { height, ..SIZE });
    let half_track = model.half_track.unwrap_or(0.8);
    let assembled = |body: &[MeshPrimitive], wheel: &[MeshPrimitive]| {
        let mut mesh = Mesh::default();
        let is_seen = |part: &&MeshPrimitive| !is_for_clear_glass(&part.material.name);
        add(&mut mesh, body.iter().filter(is_seen), |v| v, |n| n);
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
    let near_wheel = model.near_wheel.as_ref().unwrap_or(&model.wheel);
    let near = model.near_body.as_ref().map(|body| assembled(body, near_wheel)).unwrap_or_default();
    // Details of that level count for no error of the usual one, as with moving cars.
    let close_up = CloseUp { mesh: near, usual_error_m: NEAR_ERROR_M, is_measured: false };
    object.with_close_up(close_up)
}

/// Parks cars in some bays of car parks with these driveways.
pub(super) fn cars(map: &CityMap, drives: &[&Footprint]) -> Vec<SceneObject> {
    let mut parked = Vec::new();
    let bodies = BODIES.map(car_body);
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
            parked.push(painted(body, place, colour));
        }
    }
    parked
}

#[cfg(test)]
mod tests {
    use super::super::tests::city;
    use super::*;

    #[test]
    fn a_parked_car_has_the_near_level_of_moving_ones_where_it_is_near() {
        let mut parked = cars(&city(), &[]);
        parked.iter_mut().for_each(SceneObject::show_close_up);
        assert!(parked.len() > 5);
        for car in &parked {
            let counts: Vec<usize> = car.levels.iter().map(|level| level.mesh.triangle_count()).collect();
            assert!(counts[0] > 2 * counts[1] && counts.len() >= 5, "{counts:?}");
            assert_eq!(car.levels[1].error_m, NEAR_ERROR_M);
            let [near, usual] = [0, 1].map(|level| &car.levels[level].mesh);
            let paint = |mesh: &Mesh| {
                mesh.vertices.iter().find(|v| v.finish.surface == Surface::CarPaint).map(|v| v.finish.colour)
            };
            assert!(paint(near).is_some() && paint(near) == paint(usual));
            // All windows are glass, the tinted ones too, and nobody sits behind it.
            let glass_area = |mesh: &Mesh| -> f32 {
                let faces = mesh
                    .indices
                    .chunks_exact(3)
                    .map(|t| [t[0], t[1], t[2]].map(|k| &mesh.vertices[k as usize]));
                let glass = faces.filter(|face| face[0].finish.surface == Surface::Glass);
                glass
                    .map(|[a, b, c]| (b.position - a.position).cross(c.position - a.position).length() / 2.0)
                    .sum()
            };
            let [near_m2, usual_m2] = [near, usual].map(glass_area);
            assert!(
                (near_m2 - usual_m2).abs() < 0.1 * usual_m2,
                "{near_m2} m2 of glass, {usual_m2} from afar"
            );
        }
    }
}
