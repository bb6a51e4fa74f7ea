//! Meshes of vehicles: models stretched to the measures of each, their materials told by name.

mod models;

use super::passes::city::gpu_data::Vertex;
use super::standing::pack_normal;
use crate::city::scene::{clustered, reach};
use crate::model::{self, Material};
use crate::snapshot::{BodyType, Dimensions};
use glam::Vec3;
use std::collections::BTreeSet;

pub(super) use models::Models;

/// Half width of sheet metal over that of the outline, to which mirrors reach.
pub(super) const SHEET_METAL: f32 = 0.88;

/// What a face of a vehicle is. Shaders get the numbers as constants ([`Shader`](super::shader::Shader)).
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
    /// Lamps; those that both sides have are lit as one.
    const LAMPS: [Self; 5] =
        [Self::Head, Self::Tail, Self::IndicatorLeft, Self::IndicatorRight, Self::Reverse];

    /// The lamp that a vertex of a material belongs to.
    fn lamp_of(material: u32) -> Option<Self> {
        Self::LAMPS.into_iter().find(|&lamp| lamp as u32 == material & 0xff)
    }

    /// Of the material of a vertex.
    fn is_lamp(material: u32) -> bool {
        Self::lamp_of(material).is_some()
    }

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

    /// Adds another, its axes turned over where `signs` say so, at a place.
    pub(super) fn append(&mut self, other: &Self, at: Vec3, signs: Vec3) {
        let base = self.vertices.len() as u32;
        let sign = signs.to_array();
        self.vertices.extend(other.vertices.iter().map(|v| Vertex {
            position: (at + signs * Vec3::from(v.position)).to_array(),
            normal: [0, 1, 2, 3].map(|k| if k < 3 && sign[k] < 0.0 { -v.normal[k] } else { v.normal[k] }),
            ..*v
        }));
        self.indices.extend(other.indices.iter().map(|k| k + base));
    }

    /// How far the outlines of two meshes lie apart at most.
    pub(super) fn outline_apart(&self, other: &Self) -> f32 {
        let [a, b] = [self, other].map(|mesh| reach(mesh.vertices.iter().map(|v| v.position.into())));
        a.iter().zip(&b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
    }

    /// The same of fewer triangles, for a distance; see [`clustered`]. Lamps, which are small and are seen
    /// from afar at night, become a face each.
    pub(super) fn simplified(&self, edge_m: f32) -> Self {
        let is_lamp = |v: &Vertex| Part::is_lamp(v.material);
        let dark = self.indices.chunks_exact(3).filter(|t| !is_lamp(&self.vertices[t[0] as usize]));
        let dark: Vec<u32> = dark.flatten().copied().collect();
        let kind = |v: &Vertex| (v.material, v.normal.map(|n| n / 48));
        let moved = |v: &Vertex, at: Vec3| Vertex { position: at.to_array(), ..*v };
        let place = (|v: &Vertex| Vec3::from(v.position), moved);
        let (vertices, indices, _) = clustered((&self.vertices, &dark), edge_m, place, kind);
        let mut mesh = Self { vertices, indices };
        let xs = mesh.vertices.iter().map(|v| v.position[0]);
        let [rear, front] = xs.fold([f32::INFINITY, f32::NEG_INFINITY], |[a, b], x| [a.min(x), b.max(x)]);
        for lamp in self.lamps() {
            // Before what has moved outwards.
            let x = if lamp.is_front {
                (lamp.high.x + edge_m / 2.0).min(front + 0.01)
            } else {
                (lamp.low.x - edge_m / 2.0).max(rear - 0.01)
            };
            mesh.add_lamp(&lamp, x);
        }
        mesh
    }

    /// Lamps, each of connected faces.
    fn lamps(&self) -> Vec<Lamp> {
        let corner = |k: u32| &self.vertices[k as usize];
        let place = |v: &Vertex| v.position.map(f32::to_bits);
        let mut lamps: Vec<(Lamp, BTreeSet<[u32; 3]>)> = Vec::new();
        for face in self.indices.chunks_exact(3).filter(|t| Part::is_lamp(corner(t[0]).material)) {
            let vertex = *corner(face[0]);
            let places: BTreeSet<_> = face.iter().map(|&k| place(corner(k))).collect();
            let at = face.iter().map(|&k| Vec3::from(corner(k).position));
            let (low, high) = at.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(a, b), p| (a.min(p), b.max(p)));
            let mut joined = (Lamp { vertex, low, high, is_front: low.x > 0.0 }, places);
            // All that it touches becomes one with it.
            lamps.retain(|(lamp, places)| {
                let touches = lamp.vertex.material == vertex.material && !places.is_disjoint(&joined.1);
                if touches {
                    (joined.0.low, joined.0.high) =
                        (joined.0.low.min(lamp.low), joined.0.high.max(lamp.high));
                    joined.1.extend(places);
                }
                !touches
            });
            lamps.push(joined);
        }
        lamps.into_iter().map(|(lamp, _)| lamp).collect()
    }

    /// Where its lamps shine from.
    pub(super) fn lenses(&self) -> Vec<Lens> {
        let lens = |lamp: Lamp| {
            let size = lamp.high - lamp.low;
            Some(Lens {
                part: Part::lamp_of(lamp.vertex.material)?,
                at: (lamp.low + lamp.high) / 2.0,
                area_m2: size.y * size.z,
                is_front: lamp.is_front,
            })
        };
        self.lamps().into_iter().filter_map(lens).collect()
    }

    /// An upright face as large as a lamp, across the vehicle.
    fn add_lamp(&mut self, Lamp { vertex, low, high, is_front }: &Lamp, x: f32) {
        let base = self.vertices.len() as u32;
        let normal = [if *is_front { 127 } else { -127 }, 0, 0, 0];
        let corners = [[x, low.y, low.z], [x, high.y, low.z], [x, high.y, high.z], [x, low.y, high.z]];
        self.vertices.extend(corners.map(|position| Vertex { position, normal, ..*vertex }));
        let turn = if *is_front { [0, 1, 2, 0, 2, 3] } else { [2, 1, 0, 3, 2, 0] };
        self.indices.extend(turn.map(|k| base + k));
    }
}

/// A lamp of a vehicle as a light, in the body frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lens {
    pub(super) part: Part,
    pub(super) at: Vec3,
    /// As seen along the vehicle.
    pub(super) area_m2: f32,
    pub(super) is_front: bool,
}

/// The box around a lamp of a vehicle.
struct Lamp {
    /// One of its vertices.
    vertex: Vertex,
    low: Vec3,
    high: Vec3,
    is_front: bool,
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
