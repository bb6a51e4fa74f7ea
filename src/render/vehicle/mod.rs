//! Meshes of vehicles: models stretched to the measures of each, their materials told by name.

mod models;

use super::passes::city::gpu_data::Vertex;
use super::standing::pack_normal;
use crate::city::scene::clustered;
use crate::model::{self, Material};
use crate::snapshot::{BodyType, Dimensions};
use glam::Vec3;

pub(super) use models::{ERRORS_M, Models};

/// Half width of sheet metal over that of the outline, to which mirrors reach.
pub(super) const SHEET_METAL: f32 = 0.88;

/// What a face of a vehicle is; `shaders/vehicle.wgsl` has the same numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u32)]
pub(super) enum Part {
    Dull = 0,
    Paint = 1,
    Glass = 2,
    Head = 3,
    Tail = 4,
    IndicatorLeft = 5,
    IndicatorRight = 6,
    Reverse = 7,
    Bright = 8,
}

impl Part {
    /// What a material is by its name; endings that modelling programs add (".001") do not count.
    fn of(material: &Material) -> Self {
        let name = material.name.split('.').next().unwrap_or_default().to_ascii_lowercase();
        match name.as_str() {
            "paint" => Self::Paint,
            "glass" => Self::Glass,
            "head" => Self::Head,
            "tail" => Self::Tail,
            "indicator_left" => Self::IndicatorLeft,
            "indicator_right" => Self::IndicatorRight,
            "reverse" => Self::Reverse,
            _ if material.metallic > 0.5 || material.roughness < 0.3 => Self::Bright,
            _ => Self::Dull,
        }
    }
}

/// Part, roughness and metallic of a material, a byte each.
fn packed(material: &Material) -> u32 {
    let byte = |part: f32| (part.clamp(0.0, 1.0) * 255.0).round() as u32;
    Part::of(material) as u32 | byte(material.roughness) << 8 | byte(material.metallic) << 16
}

/// Triangles of a vehicle in its body frame, metres.
#[derive(Clone, Debug, Default)]
pub(super) struct VehicleMesh {
    pub(super) vertices: Vec<Vertex>,
    pub(super) indices: Vec<u32>,
}

impl VehicleMesh {
    pub(super) fn new(parts: &[model::Part]) -> Self {
        let mut mesh = Self::default();
        for part in parts {
            let base = mesh.vertices.len() as u32;
            let [r, g, b] = part.material.colour;
            let material = packed(&part.material);
            mesh.vertices.extend(part.vertices.iter().map(|v| Vertex {
                position: v.position.to_array(),
                normal: pack_normal(v.normal),
                colour: [r, g, b, v.openness],
                uv: [0.0; 2],
                material,
            }));
            mesh.indices.extend(part.indices.iter().map(|k| k + base));
        }
        mesh
    }

    /// The same of fewer triangles, for a distance; see [`clustered`]. Parts keep their own vertices, so that
    /// lamps and windows stay.
    pub(super) fn simplified(&self, edge_m: f32) -> Self {
        let kind = |v: &Vertex| (v.material, v.normal.map(|n| n / 48));
        let moved = |v: &Vertex, at: Vec3| Vertex { position: at.to_array(), ..*v };
        let place = (|v: &Vertex| Vec3::from(v.position), moved);
        let (vertices, indices) = clustered((&self.vertices, &self.indices), edge_m, place, kind);
        Self { vertices, indices }
    }
}

/// What a body is made for; vehicles that share it share the mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct MeshKey {
    body: BodyType,
    /// Length, width, height, wheelbase, wheel radius in millimetres.
    measures: [u32; 5],
}

impl MeshKey {
    pub(super) fn body(self) -> BodyType {
        self.body
    }

    pub(super) fn new(body: BodyType, d: &Dimensions) -> Self {
        let measures = [d.length_m, d.width_m, d.height_m, d.wheelbase_m, d.wheel_radius_m]
            .map(|m| (m * 1000.0).round().clamp(1.0, 1e6) as u32);
        Self { body, measures }
    }
}
