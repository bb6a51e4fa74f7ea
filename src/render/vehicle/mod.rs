//! Meshes of vehicles, made in code to the measure of each: bodies as smooth lofts, wheels apart.

mod body;
mod loft;
mod wheel;

use super::passes::city::gpu_data::Vertex;
use super::standing::pack_normal;
use crate::snapshot::{BodyType, Dimensions};
use glam::Vec3;
use std::collections::BTreeMap;

pub(super) use body::{body, half_of_sheet_metal};
pub(super) use wheel::{SIDES as WHEEL_SIDES, WIDTH_M as WHEEL_WIDTH_M, wheel};

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

/// A part with its colour (sRGB) where the part does not give it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct Skin {
    pub(super) part: Part,
    pub(super) colour: [u8; 3],
}

impl Skin {
    pub(super) const fn new(part: Part, colour: [u8; 3]) -> Self {
        Self { part, colour }
    }
}

pub(super) const PAINT: Skin = Skin::new(Part::Paint, [255, 255, 255]);
pub(super) const GLASS: Skin = Skin::new(Part::Glass, [26, 32, 38]);
pub(super) const PLASTIC: Skin = Skin::new(Part::Dull, [30, 31, 33]);
pub(super) const HEAD: Skin = Skin::new(Part::Head, [225, 228, 232]);
pub(super) const TAIL: Skin = Skin::new(Part::Tail, [120, 10, 12]);
pub(super) const REVERSE: Skin = Skin::new(Part::Reverse, [190, 190, 190]);

/// Triangles of a vehicle in its body frame, metres.
#[derive(Clone, Debug, Default)]
pub(super) struct VehicleMesh {
    pub(super) vertices: Vec<Vertex>,
    pub(super) indices: Vec<u32>,
}

impl VehicleMesh {
    pub(super) fn vertex(&mut self, position: Vec3, normal: Vec3, skin: Skin, openness: u8) -> u32 {
        let [r, g, b] = skin.colour;
        self.vertices.push(Vertex {
            position: position.to_array(),
            normal: pack_normal(normal),
            colour: [r, g, b, openness],
            uv: [0.0; 2],
            material: skin.part as u32,
        });
        self.vertices.len() as u32 - 1
    }

    /// The same of fewer triangles, for a distance: vertices within a cube of an edge become one
    /// (Rossignac and Borrel 1993). Parts keep their own vertices at the common place, so that lamps and
    /// windows stay and nothing gapes.
    pub(super) fn simplified(&self, edge_m: f32) -> Self {
        let cube = |v: &Vertex| v.position.map(|x| (x / edge_m).round() as i32);
        let mut places: BTreeMap<[i32; 3], (Vec3, f32)> = BTreeMap::new();
        for vertex in &self.vertices {
            let place = places.entry(cube(vertex)).or_default();
            *place = (place.0 + Vec3::from(vertex.position), place.1 + 1.0);
        }
        let mut known = BTreeMap::new();
        let mut simple = Self::default();
        for corners in self.indices.chunks_exact(3) {
            let cubes = [0, 1, 2].map(|k| cube(&self.vertices[corners[k] as usize]));
            if cubes[0] == cubes[1] || cubes[1] == cubes[2] || cubes[2] == cubes[0] {
                continue;
            }
            for (&index, cube) in corners.iter().zip(cubes) {
                let vertex = self.vertices[index as usize];
                let facing = vertex.normal.map(|n| n / 48);
                let slot = *known.entry((cube, vertex.material, facing)).or_insert_with(|| {
                    let (sum, count) = places[&cube];
                    simple.vertices.push(Vertex { position: (sum / count).to_array(), ..vertex });
                    simple.vertices.len() as u32 - 1
                });
                simple.indices.push(slot);
            }
        }
        simple
    }

    /// A flat convex face, corners counter-clockwise seen from outside.
    pub(super) fn plate(&mut self, corners: &[Vec3], skin: Skin) {
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or(Vec3::Z);
        let base = self.vertices.len() as u32;
        for &corner in corners {
            self.vertex(corner, normal, skin, 255);
        }
        for k in 2..corners.len() as u32 {
            self.indices.extend([base, base + k - 1, base + k]);
        }
    }

    /// A plate that faces ahead (`facing` 1) or back (-1) at x, between two y and two z.
    pub(super) fn upright(&mut self, x: f32, facing: f32, y: [f32; 2], z: [f32; 2], skin: Skin) {
        let (a, b) = if facing > 0.0 { (y[0], y[1]) } else { (y[1], y[0]) };
        self.plate(
            &[Vec3::new(x, a, z[0]), Vec3::new(x, b, z[0]), Vec3::new(x, b, z[1]), Vec3::new(x, a, z[1])],
            skin,
        );
    }

    /// A closed box.
    pub(super) fn block(&mut self, low: Vec3, high: Vec3, skin: Skin) {
        let at = |k: usize| {
            Vec3::new(
                if k & 1 == 0 { low.x } else { high.x },
                if k & 2 == 0 { low.y } else { high.y },
                if k & 4 == 0 { low.z } else { high.z },
            )
        };
        for face in [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]] {
            self.plate(&face.map(at), skin);
        }
    }
}

/// What a body is made for; vehicles that share it share the mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct MeshKey {
    body: u8,
    /// Length, width, height, wheelbase, wheel radius in millimetres.
    measures: [u32; 5],
}

impl MeshKey {
    pub(super) fn new(body: BodyType, d: &Dimensions) -> Self {
        let measures = [d.length_m, d.width_m, d.height_m, d.wheelbase_m, d.wheel_radius_m]
            .map(|m| (m * 1000.0).round().clamp(1.0, 1e6) as u32);
        Self { body: body as u8, measures }
    }
}
