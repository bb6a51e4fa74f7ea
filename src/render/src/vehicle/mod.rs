//! Vehicle meshes: models fitted to the dimensions of each vehicle, with parts identified by material name.

mod models;

use super::geometry::pack_normal;
use super::passes::city::gpu_data::Vertex;
use city3d_models::Material;
use city3d_protocol::snapshot::{BodyType, Dimensions};
use city3d_scene::{clustered, reach};
use glam::Vec3;
use std::collections::BTreeMap;

pub(super) use models::{FittedVehicle, VehicleModels};

/// Lamps of a vehicle that shine; a model may have more faces of lamps.
const MOST_LENSES: usize = 256;

/// Half width of the body without mirrors, as a share of that of the outline.
pub(super) const SHEET_METAL: f32 = 0.88;

/// Part of a vehicle that a face belongs to. Shaders get the numbers as constants ([`Shader`](super::shader::Shader)).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u32)]
pub(super) enum VehiclePart {
    Dull = 0,
    Paint = 1,
    Glass = 2,
    Head = 3,
    Tail = 4,
    IndicatorLeft = 5,
    IndicatorRight = 6,
    Reverse = 7,
    Bright = 8,
    /// Clear cover of a lamp.
    Lens = 9,
    /// The digits on a number plate.
    Number = 10,
}

impl VehiclePart {
    /// Parts that are lamps.
    pub(super) const LAMPS: [Self; 5] =
        [Self::Head, Self::Tail, Self::IndicatorLeft, Self::IndicatorRight, Self::Reverse];

    /// Lamp that a vertex with this packed material belongs to.
    fn lamp_of(material: u32) -> Option<Self> {
        Self::LAMPS.into_iter().find(|&lamp| lamp as u32 == material & 0xff)
    }

    /// Whether a vertex with this packed material belongs to a lamp.
    fn is_lamp(material: u32) -> bool {
        Self::lamp_of(material).is_some()
    }

    /// Part by the name of a material, without suffixes of modelling programs (".001").
    fn of(material: &Material) -> Self {
        let name = material.name.split('.').next().unwrap_or_default().to_ascii_lowercase();
        match name.as_str() {
            "paint" => Self::Paint,
            "glass" => Self::Glass,
            "lens" => Self::Lens,
            "number" => Self::Number,
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

/// Packs part, roughness and metallic of a material, a byte each.
fn packed(material: &Material) -> u32 {
    let byte = |part: f32| (part.clamp(0.0, 1.0) * 255.0).round() as u32;
    VehiclePart::of(material) as u32 | byte(material.roughness) << 8 | byte(material.metallic) << 16
}

/// Triangle mesh of a vehicle in its body frame, metres.
#[derive(Clone, Debug, Default)]
pub(super) struct VehicleMesh {
    pub(super) vertices: Vec<Vertex>,
    pub(super) indices: Vec<u32>,
}

impl VehicleMesh {
    pub(super) fn new<'a>(parts: impl IntoIterator<Item = &'a city3d_models::MeshPrimitive>) -> Self {
        let mut mesh = Self::default();
        for part in parts {
            let base = mesh.vertices.len() as u32;
            let [r, g, b] = part.material.colour;
            let material = packed(&part.material);
            mesh.vertices.extend(part.vertices.iter().map(|v| Vertex {
                position: v.position.to_array(),
                normal: pack_normal(v.normal),
                colour: [r, g, b, v.openness],
                uv: v.uv.to_array(),
                material,
            }));
            mesh.indices.extend(part.indices.iter().map(|k| k + base));
        }
        mesh
    }

    /// Moves the triangles of glass behind all others, and counts the indices before them.
    pub(super) fn glass_last(&mut self) -> u32 {
        let is_glass = |k: u32| {
            let part = self.vertices[k as usize].material & 0xff;
            part == VehiclePart::Glass as u32 || part == VehiclePart::Lens as u32
        };
        let (faces, _) = self.indices.as_chunks::<3>();
        let (glass, opaque): (Vec<[u32; 3]>, Vec<[u32; 3]>) =
            faces.iter().partition(|face| is_glass(face[0]));
        let count = 3 * opaque.len() as u32;
        self.indices = opaque.into_iter().chain(glass).flatten().collect();
        count
    }

    /// Bytes of its vertices and of its indices.
    pub(super) fn bytes(&self) -> [usize; 2] {
        [size_of_val(&*self.vertices), size_of_val(&*self.indices)]
    }

    /// Appends another mesh at a position, its axes mirrored where `signs` is negative.
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

    /// Largest distance between the outlines of two meshes.
    pub(super) fn outline_apart(&self, other: &Self) -> f32 {
        let [a, b] = [self, other].map(|mesh| reach(mesh.vertices.iter().map(|v| v.position.into())));
        a.iter().zip(&b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
    }

    /// Coarser mesh for a distance, by vertex clustering; see [`clustered`]. Each lamp becomes a quad,
    /// because lamps are small and visible from afar at night.
    pub(super) fn simplified(&self, edge_m: f32) -> Self {
        let is_lamp = |v: &Vertex| VehiclePart::is_lamp(v.material);
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

    /// Lamps: connected components of lamp faces, in the order of their last faces.
    fn lamps(&self) -> Vec<LampBounds> {
        let corner = |k: u32| &self.vertices[k as usize];
        let is_lamp = |face: &&[u32; 3]| VehiclePart::is_lamp(corner(face[0]).material);
        let faces: Vec<&[u32; 3]> = self.indices.as_chunks::<3>().0.iter().filter(is_lamp).collect();
        // Faces of one material that share a corner are joined.
        let mut components = DisjointSets::new(faces.len());
        let mut face_at: BTreeMap<(u32, [u32; 3]), usize> = BTreeMap::new();
        for (index, face) in faces.iter().enumerate() {
            for place in face.map(|k| corner(k).position.map(f32::to_bits)) {
                let first = *face_at.entry((corner(face[0]).material, place)).or_insert(index);
                components.join(first, index);
            }
        }
        let mut lamps: BTreeMap<usize, (usize, LampBounds)> = BTreeMap::new();
        for (index, face) in faces.iter().enumerate() {
            let at = face.iter().map(|&k| Vec3::from(corner(k).position));
            let (low, high) = at.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(a, b), p| (a.min(p), b.max(p)));
            let lamp = LampBounds { vertex: *corner(face[0]), low, high, is_front: low.x > 0.0 };
            let known = lamps.entry(components.root(index)).or_insert((index, lamp));
            let (low, high) = (low.min(known.1.low), high.max(known.1.high));
            *known = (index, LampBounds { low, high, ..lamp });
        }
        let mut lamps: Vec<(usize, LampBounds)> = lamps.into_values().collect();
        lamps.sort_by_key(|(last_face, _)| *last_face);
        lamps.into_iter().map(|(_, lamp)| lamp).collect()
    }

    /// Lamps as light sources.
    pub(super) fn lenses(&self) -> Vec<LampLens> {
        let lens = |lamp: LampBounds| {
            let size = lamp.high - lamp.low;
            Some(LampLens {
                part: VehiclePart::lamp_of(lamp.vertex.material)?,
                at: (lamp.low + lamp.high) / 2.0,
                area_m2: size.y * size.z,
                is_front: lamp.is_front,
            })
        };
        self.lamps().into_iter().filter_map(lens).take(MOST_LENSES).collect()
    }

    /// Appends an upright quad of a lamp's size, across the vehicle.
    fn add_lamp(&mut self, LampBounds { vertex, low, high, is_front }: &LampBounds, x: f32) {
        let base = self.vertices.len() as u32;
        let normal = [if *is_front { 127 } else { -127 }, 0, 0, 0];
        let corners = [[x, low.y, low.z], [x, high.y, low.z], [x, high.y, high.z], [x, low.y, high.z]];
        self.vertices.extend(corners.map(|position| Vertex { position, normal, ..*vertex }));
        let turn = if *is_front { [0, 1, 2, 0, 2, 3] } else { [2, 1, 0, 3, 2, 0] };
        self.indices.extend(turn.map(|k| base + k));
    }
}

/// Lamp of a vehicle as a light source, body frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct LampLens {
    pub(super) part: VehiclePart,
    pub(super) at: Vec3,
    /// Area projected along the vehicle.
    pub(super) area_m2: f32,
    pub(super) is_front: bool,
}

/// Disjoint sets of indices: union and find with path halving (Tarjan and van Leeuwen 1984).
struct DisjointSets {
    parents: Vec<usize>,
}

impl DisjointSets {
    fn new(count: usize) -> Self {
        Self { parents: (0..count).collect() }
    }

    fn root(&mut self, mut index: usize) -> usize {
        while self.parents[index] != index {
            self.parents[index] = self.parents[self.parents[index]];
            index = self.parents[index];
        }
        index
    }

    fn join(&mut self, a: usize, b: usize) {
        let (a, b) = (self.root(a), self.root(b));
        self.parents[b] = a;
    }
}

/// Bounding box of a lamp.
#[derive(Clone, Copy)]
struct LampBounds {
    /// Any of its vertices.
    vertex: Vertex,
    low: Vec3,
    high: Vec3,
    is_front: bool,
}

/// Key of a mesh: vehicles with the same body type and dimensions share it.
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
