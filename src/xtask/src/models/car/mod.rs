//! Procedural car models: a shell with wheel arches, bonnet and boot, and a cabin of glass and pillars.

mod body;
mod cabin;
mod close;
mod distant;
mod heavy;
mod heavy_close;
mod heavy_trim;
mod interior;
mod shape;
mod trim;
mod wheel;

use super::{MeshPrimitive, Model, PrimitiveBuilder, StaticMaterial};
use city3d_models::ModelNode;
use glam::{Affine3A, Quat, Vec3};
use std::f32::consts::PI;

pub use heavy::{BUS, HeavyShape, TRUCK};
pub use shape::{CarShape, ESTATE, HATCHBACK, PICKUP, SEDAN, SUV, TAXI, VAN};

/// Length of all cars but bus and truck, from bumper to bumper.
pub const LENGTH_M: f32 = 5.0;
/// From mirror to mirror.
pub const WIDTH_M: f32 = 2.5;
pub const WHEELBASE_M: f32 = 3.0;
pub const WHEEL_RADIUS_M: f32 = 0.34;
/// Half the width of the sheet metal.
pub(super) const HALF_M: f32 = 1.10;

pub(super) const PAINT: StaticMaterial = StaticMaterial::new("paint", [255, 255, 255]).rough(0.35);
pub(super) const GLASS: StaticMaterial = StaticMaterial::new("glass", [22, 27, 32]).rough(0.05);
/// Darker glass behind the front doors; shaders know it by its roughness.
pub(super) const TINTED: StaticMaterial = StaticMaterial::new("glass.tinted", [22, 27, 32]).rough(0.12);
/// Clear cover of a lamp.
pub(super) const LENS: StaticMaterial = StaticMaterial::new("lens", [200, 204, 208]).rough(0.05);
pub(super) const PLASTIC: StaticMaterial = StaticMaterial::new("plastic", [28, 30, 33]);
pub(super) const DASHBOARD: StaticMaterial = StaticMaterial::new("dashboard", [46, 49, 54]);
pub(super) const SEAM: StaticMaterial = StaticMaterial::new("seam", [12, 12, 13]);
pub(super) const WIPER: StaticMaterial = StaticMaterial::new("wiper", [12, 12, 13]);
pub(super) const WELL: StaticMaterial = StaticMaterial::new("well", [14, 14, 15]);
pub(super) const GRILLE: StaticMaterial = StaticMaterial::new("grille", [20, 20, 22]).rough(0.5);
pub(super) const CHROME: StaticMaterial = StaticMaterial::new("chrome", [190, 194, 198]).metal().rough(0.2);
pub(super) const PLATE: StaticMaterial = StaticMaterial::new("number_plate", [226, 226, 220]);
/// The digits on a number plate: as grey as plate and ink are in the mean, where no shader draws them.
pub(super) const NUMBER: StaticMaterial = StaticMaterial::new("number", [160, 160, 155]);
pub(super) const HEAD: StaticMaterial = StaticMaterial::new("head", [214, 220, 226]).rough(0.1);
pub(super) const TAIL: StaticMaterial = StaticMaterial::new("tail", [98, 8, 10]).rough(0.2);
pub(super) const REVERSE: StaticMaterial = StaticMaterial::new("reverse", [132, 130, 128]).rough(0.2);
pub(super) const INDICATOR: [StaticMaterial; 2] = [
    StaticMaterial::new("indicator_left", [176, 104, 48]).rough(0.2),
    StaticMaterial::new("indicator_right", [176, 104, 48]).rough(0.2),
];

/// Level of detail of a car.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum CarDetail {
    /// For light per pixel: lamps with depth and an interior behind clear glass.
    Close,
    Near,
    Far,
    /// Its wheels are painted on.
    Farther,
}

impl CarDetail {
    fn is_near(self) -> bool {
        matches!(self, Self::Close | Self::Near)
    }
}

/// The model of a body type: nodes `near_body`, `near_wheel`, `body`, four wheels, `far_body`, `far_wheel`, and `farther_body` and
/// `distant_body` with wheels of their own.
pub fn model(shape: &CarShape) -> Model {
    let bodies = [CarDetail::Near, CarDetail::Far, CarDetail::Farther, CarDetail::Close].map(|detail| {
        let mut builder = PrimitiveBuilder::default();
        body::shell(&mut builder, shape, detail);
        cabin::cabin(&mut builder, shape, detail);
        let mut inside = Vec::new();
        if detail == CarDetail::Close {
            let mut lined = interior::lining(&builder.clone().finish(), shape);
            interior::interior(&mut lined, shape);
            inside = lined.finish();
        }
        trim::trim(&mut builder, shape, detail);
        let mut parts = evened(builder.finish());
        parts.append(&mut inside);
        parts
    });
    assembled(
        bodies,
        distant::car(shape),
        WheelPlaces {
            radius: WHEEL_RADIUS_M,
            width: wheel::WIDTH_M,
            wheelbase: WHEELBASE_M,
            out: HALF_M - 0.012,
        },
    )
}

/// The model of a bus or truck, with the same nodes.
pub fn heavy_model(shape: &HeavyShape) -> Model {
    let bodies = [CarDetail::Near, CarDetail::Far, CarDetail::Farther, CarDetail::Close].map(|detail| {
        let mut builder = PrimitiveBuilder::default();
        heavy::hull(&mut builder, shape, detail);
        let mut inside = Vec::new();
        if detail == CarDetail::Close {
            let ceiling_m = heavy_close::ceiling_m(shape);
            let mut lined = interior::lined(&builder.clone().finish(), |at| at.z < ceiling_m + 0.001);
            heavy_close::interior(&mut lined, shape);
            inside = lined.finish();
        }
        heavy::body(&mut builder, shape, detail);
        let mut parts = evened(builder.finish());
        parts.append(&mut inside);
        parts
    });
    assembled(
        bodies,
        distant::heavy(shape),
        WheelPlaces {
            radius: shape.wheel_radius,
            width: shape.wheel_width,
            wheelbase: shape.wheelbase,
            out: shape.wheel_out,
        },
    )
}

/// Size of the wheels, and where they are, metres.
struct WheelPlaces {
    radius: f32,
    width: f32,
    wheelbase: f32,
    /// From the middle to the outer faces.
    out: f32,
}

/// A model with wheels of its bodies: the usual one, the coarser ones, the near one, and the coarsest.
fn assembled(bodies: [Vec<MeshPrimitive>; 4], distant: Vec<MeshPrimitive>, places: WheelPlaces) -> Model {
    let WheelPlaces { radius, width, wheelbase, out } = places;
    let standing = |name: &str, mesh, height| ModelNode {
        name: name.to_owned(),
        mesh,
        model_from_mesh: Affine3A::from_translation(Vec3::Z * height),
    };
    let names = ["body", "far_body", "farther_body", "near_body"];
    let mut nodes: Vec<ModelNode> =
        names.iter().zip(0..).map(|(name, mesh)| standing(name, mesh, 0.0)).collect();
    let first = bodies.len();
    nodes.push(standing("far_wheel", first + 1, radius));
    nodes.push(standing("near_wheel", first + 2, radius));
    let (axle, out) = (wheelbase / 2.0, out - width / 2.0);
    for (name, x, y) in [
        ("front_left", axle, out),
        ("front_right", axle, -out),
        ("rear_left", -axle, out),
        ("rear_right", -axle, -out),
    ] {
        let turn = if y > 0.0 { 0.0 } else { PI };
        let place = Affine3A::from_rotation_translation(Quat::from_rotation_z(turn), Vec3::new(x, y, radius));
        nodes.push(ModelNode { name: format!("wheel_{name}"), mesh: first, model_from_mesh: place });
    }
    let wheels =
        [wheel::wheel(radius, width), wheel::far_wheel(radius, width), wheel::near_wheel(radius, width)];
    nodes.push(standing("distant_body", first + wheels.len(), 0.0));
    let meshes = bodies.into_iter().chain(wheels).chain([distant]).collect();
    Model { meshes, nodes }
}

/// Smooths normals along the middle, where the two halves of a body meet.
fn evened(mut parts: Vec<MeshPrimitive>) -> Vec<MeshPrimitive> {
    for vertex in parts.iter_mut().flat_map(|part| &mut part.vertices) {
        if vertex.position.y.abs() < 1e-4 {
            vertex.normal = vertex.normal.with_y(0.0).normalize_or(vertex.normal);
        }
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whether a front-facing face occludes a point.
    fn is_hidden(mesh: &[MeshPrimitive], eye: Vec3, point: Vec3) -> bool {
        let along = point - eye;
        mesh.iter().any(|part| {
            let corner = |k: &u32| part.vertices[*k as usize].position;
            part.indices.chunks_exact(3).any(|t| {
                let [a, b, c] = [&t[0], &t[1], &t[2]].map(corner);
                let normal = (b - a).cross(c - a);
                let towards = normal.dot(along);
                let at = normal.dot(a - eye) / towards;
                let hit = eye + along * at;
                let is_within = [(a, b), (b, c), (c, a)]
                    .iter()
                    .all(|(from, to)| (to - from).cross(hit - from).dot(normal) >= 0.0);
                towards < 0.0 && (0.0..1.0).contains(&at) && is_within
            })
        })
    }

    #[test]
    fn a_bonnet_has_a_bulge_between_creases_and_crests_of_the_wings() {
        for shape in [SEDAN, HATCHBACK, SUV, PICKUP, TAXI, ESTATE] {
            let x = shape.bonnet_foot() + 0.66;
            let rise = |from: f32, to: f32| shape.on_bonnet(x, to).z - shape.on_bonnet(x, from).z;
            assert!(rise(0.50, 0.38) > 0.015 && rise(0.86, 0.93) > 0.006, "{}", shape.name);
        }
    }

    /// Else one would look through the rear window into an empty box.
    #[test]
    fn what_is_behind_a_rear_window_is_filled_or_tinted() {
        for shape in [SEDAN, HATCHBACK, SUV, TAXI, ESTATE] {
            let car = model(&shape);
            let near = car.parts(car.node("near_body").unwrap());
            let [rear, ..] = shape.cabin.stations;
            let shelf =
                near.iter().filter(|part| part.material.name == "carpet").flat_map(|part| &part.vertices);
            let is_under_glass =
                |at: Vec3| at.x < rear + 0.3 && (shape.shoulder_at(at.x) - at.z).abs() < 0.05;
            assert!(shelf.map(|v| v.position).any(is_under_glass), "{} without a shelf", shape.name);
            let is_tinted = near.iter().any(|part| part.material.name == TINTED.name);
            assert_eq!(is_tinted, shape.rear == shape::Rear::Hatch, "{}", shape.name);
        }
    }

    #[test]
    fn nobody_sees_into_a_car_under_its_windows() {
        for shape in [SEDAN, HATCHBACK, SUV, VAN, PICKUP, TAXI, ESTATE] {
            let car = model(&shape);
            let [rear_foot, .., front_foot] = shape.cabin.stations;
            let mut open = Vec::new();
            // Behind the lower edges of the windows, and under bonnet and boot beside their edges.
            for x in [front_foot - 0.3, front_foot + 0.2, rear_foot + 0.3] {
                for y in [-0.79, -0.41, 0.03, 0.38, 0.81] {
                    let inside = Vec3::new(x, y, shape.shoulder_at(x) - 0.06);
                    for turn in 0..48 {
                        for height in [0.7, 1.0, 1.3, 2.2] {
                            let (sin, cos) = (PI * (turn as f32 + 0.3) / 24.0).sin_cos();
                            let eye = Vec3::new(7.0 * cos, 7.0 * sin, height);
                            if !is_hidden(&car.meshes[0], eye, inside) {
                                open.push((eye, inside));
                            }
                        }
                    }
                }
            }
            assert!(open.is_empty(), "{}: {} rays, {:?}", shape.name, open.len(), &open[..open.len().min(4)]);
        }
    }
}
