//! Fits a car model to the dimensions of a vehicle: bumpers and mirrors to its outline, wheel arches to its
//! axles and wheels.

use super::{MeshPrimitive, Model, ModelNode};
use glam::Vec3;

/// Full-scale dimensions of a vehicle, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measures {
    /// Length of the outline, from bumper to bumper.
    pub length: f32,
    /// Width of the outline, with the mirrors.
    pub width: f32,
    /// Height of the roof above the road.
    pub height: f32,
    /// Distance between the axles.
    pub wheelbase: f32,
    /// Radius of a wheel with its tyre.
    pub wheel_radius: f32,
}

/// A fitted car: bodies in the body frame, wheels about their own centres, the outer face towards +y.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FittedCar {
    /// Finer body for what is near, if the model has one.
    pub near_body: Option<Vec<MeshPrimitive>>,
    /// Finer wheel, if the model has one.
    pub near_wheel: Option<Vec<MeshPrimitive>>,
    /// Usual body, without wheels.
    pub body: Vec<MeshPrimitive>,
    /// Usual wheel, drawn four times; empty if the model has none.
    pub wheel: Vec<MeshPrimitive>,
    /// Coarser body, if the model has one.
    pub far_body: Option<Vec<MeshPrimitive>>,
    /// Still coarser body, including its wheels.
    pub farther_body: Option<Vec<MeshPrimitive>>,
    /// Coarsest body, including its wheels, if the model has one.
    pub distant_body: Option<Vec<MeshPrimitive>>,
    /// Coarser wheel, if the model has one.
    pub far_wheel: Option<Vec<MeshPrimitive>>,
    /// Half the track width; `None` without wheels.
    pub half_track: Option<f32>,
}

/// Name prefix of wheels.
const WHEEL: &str = "wheel";
/// Name prefix of the finer level of detail for what is near.
const NEAR: &str = "near_";
const NEAR_WHEEL: &str = "near_wheel";
/// Name prefix of distant levels of detail.
const FAR: &str = "far_";
const FAR_WHEEL: &str = "far_wheel";
/// Name prefixes of the farthest levels of detail, wheels included.
const FARTHER: &str = "farther_";
const DISTANT: &str = "distant_";

/// Whether a node belongs to a finer or coarser level of detail than the usual one.
pub fn is_other_lod(node: &ModelNode) -> bool {
    [NEAR, FAR, FARTHER, DISTANT].iter().any(|prefix| node.name.starts_with(prefix))
}

/// Whether a part of the near level of a shipped car is only for clear glass: seen through it, or the cover of a lamp.
/// Where glass is opaque it is left out.
pub fn is_for_clear_glass(material: &str) -> bool {
    const PARTS: [&str; 12] = [
        "lens",
        "lining",
        "seat",
        "carpet",
        "steering_wheel",
        "skin",
        "hair",
        "shirt",
        "dashboard",
        "floor",
        "bus_seat",
        "pole",
    ];
    PARTS.contains(&material.split('.').next().unwrap_or_default())
}

fn is_body(node: &ModelNode) -> bool {
    !node.name.starts_with(WHEEL) && !is_other_lod(node)
}

/// A piecewise linear function, extrapolated beyond its knots.
struct PiecewiseLinear {
    knots: Vec<(f32, f32)>,
}

impl PiecewiseLinear {
    /// Skips knots that do not grow by at least a centimetre.
    fn new(knots: &[(f32, f32)]) -> Self {
        let mut kept: Vec<(f32, f32)> = Vec::new();
        for &(from, to) in knots {
            if kept.last().is_none_or(|last| from > last.0 + 0.01 && to > last.1) {
                kept.push((from, to));
            }
        }
        Self { knots: kept }
    }

    /// Value and slope.
    fn at(&self, x: f32) -> (f32, f32) {
        let knots = &self.knots;
        if knots.len() < 2 {
            return (x, 1.0);
        }
        let after = knots.partition_point(|k| k.0 < x).clamp(1, knots.len() - 1);
        let (a, b) = (knots[after - 1], knots[after]);
        let slope = (b.1 - a.1) / (b.0 - a.0);
        (a.1 + (x - a.0) * slope, slope)
    }
}

/// Fits a model: the bounding box of its body and wheels becomes the vehicle's; wheels and axles move to
/// those of the vehicle.
pub fn fitted(model: &Model, measures: &Measures) -> FittedCar {
    let Some([low, high]) = model.bounds(|node| !is_other_lod(node)) else {
        return FittedCar::default();
    };
    let wheels: Vec<&ModelNode> = model.nodes.iter().filter(|node| node.name.starts_with(WHEEL)).collect();
    let middles = wheels.iter().map(|node| Vec3::from(node.model_from_mesh.translation));
    let (rear, front) =
        middles.clone().fold((f32::INFINITY, f32::NEG_INFINITY), |(a, b), m| (a.min(m.x), b.max(m.x)));
    let radius = wheels.first().map(|node| radius_of(model, node));
    let (half, axle) = (measures.length / 2.0, measures.wheelbase / 2.0);
    let x = PiecewiseLinear::new(&if wheels.is_empty() || front < rear + 0.1 {
        vec![(low.x, -half), (high.x, half)]
    } else {
        vec![(low.x, -half), (rear, -axle), (front, axle), (high.x, half)]
    });
    let widest = low.y.abs().max(high.y.abs()).max(1e-3);
    let across = measures.width / 2.0 / widest;
    let z = PiecewiseLinear::new(&match radius {
        Some(radius) => {
            vec![(0.0, 0.0), (2.0 * radius, 2.0 * measures.wheel_radius), (high.z, measures.height)]
        }
        None => vec![(low.z, 0.0), (high.z, measures.height)],
    });
    let stretched = |wanted: &dyn Fn(&ModelNode) -> bool| -> Vec<MeshPrimitive> {
        let mut parts = Vec::new();
        for node in model.nodes.iter().filter(|node| wanted(node)) {
            let turn = node.model_from_mesh.matrix3.inverse().transpose();
            for part in model.parts(node) {
                let mut part = part.clone();
                for vertex in &mut part.vertices {
                    let at = node.model_from_mesh.transform_point3(vertex.position);
                    let ((px, sx), (pz, sz)) = (x.at(at.x), z.at(at.z));
                    vertex.position = Vec3::new(px, at.y * across, pz);
                    let normal = Vec3::from(turn * glam::Vec3A::from(vertex.normal));
                    vertex.normal = (normal / Vec3::new(sx, across, sz)).normalize_or(Vec3::Z);
                }
                if node.model_from_mesh.matrix3.determinant() < 0.0 {
                    part.indices.chunks_exact_mut(3).for_each(|t| t.swap(1, 2));
                }
                parts.push(part);
            }
        }
        parts
    };
    let wheel = |node: &ModelNode| -> Vec<MeshPrimitive> {
        let scale = measures.wheel_radius / radius_of(model, node);
        // Made for the left side: for a right wheel the other face is the outer one.
        let left = node.model_from_mesh.translation.y >= 0.0;
        let side = if left { Vec3::ONE } else { Vec3::new(-1.0, -1.0, 1.0) };
        let mut parts = model.parts(node).to_vec();
        for vertex in parts.iter_mut().flat_map(|part| &mut part.vertices) {
            let turned = node.model_from_mesh.transform_vector3(vertex.position) * side;
            vertex.position = turned * scale;
            vertex.normal =
                (node.model_from_mesh.transform_vector3(vertex.normal) * side).normalize_or(Vec3::Y);
        }
        parts
    };
    let far = stretched(&|node| node.name.starts_with(FAR) && !node.name.starts_with(FAR_WHEEL));
    let farther = stretched(&|node| node.name.starts_with(FARTHER));
    let distant = stretched(&|node| node.name.starts_with(DISTANT));
    let near = stretched(&|node| node.name.starts_with(NEAR) && !node.name.starts_with(NEAR_WHEEL));
    FittedCar {
        near_body: (!near.is_empty()).then_some(near),
        near_wheel: model.node(NEAR_WHEEL).map(wheel),
        body: stretched(&is_body),
        wheel: wheels.first().map(|node| wheel(node)).unwrap_or_default(),
        far_body: (!far.is_empty()).then_some(far),
        farther_body: (!farther.is_empty()).then_some(farther),
        distant_body: (!distant.is_empty()).then_some(distant),
        far_wheel: model.node(FAR_WHEEL).map(wheel),
        half_track: middles.map(|m| m.y.abs() * across).reduce(f32::max),
    }
}

/// Half the height of a wheel's mesh.
fn radius_of(model: &Model, node: &ModelNode) -> f32 {
    let heights = model
        .parts(node)
        .iter()
        .flat_map(|part| &part.vertices)
        .map(|vertex| node.model_from_mesh.transform_vector3(vertex.position).z);
    let (low, high) = heights.fold((f32::INFINITY, f32::NEG_INFINITY), |(a, b), z| (a.min(z), b.max(z)));
    if high > low { ((high - low) / 2.0).max(1e-3) } else { 1.0 }
}
