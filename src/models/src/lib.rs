//! 3D models from files or made in code: cars and street furniture.
//!
//! Frame: metres, x forward (of a building: to the right of an observer in front of it), y left, z up, origin
//! on the ground.

#![allow(clippy::disallowed_methods, reason = "only draws; no state of a run depends on it")]

pub mod car;
mod fit;
pub mod glb;
mod shipped;
pub mod street;

pub use fit::{FittedCar, Measures, fitted, is_distant_lod};
pub use glb::ModelError;
pub use shipped::{SHIPPED, made, shipped};

use glam::{Affine3A, Vec2, Vec3};

/// A material. Its name states its purpose.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    pub name: String,
    /// sRGB.
    pub colour: [u8; 3],
    /// 0 or 1: metals reflect in their own colour.
    pub metallic: f32,
    /// From 0 (mirror) to 1 (matt).
    pub roughness: f32,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ModelVertex {
    pub position: Vec3,
    pub normal: Vec3,
    pub uv: Vec2,
    /// How much of the sky's light reaches it, 255 for all.
    pub openness: u8,
}

/// A mesh primitive (glTF): indexed triangles of one material, counter-clockwise seen from outside.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshPrimitive {
    pub material: Material,
    pub vertices: Vec<ModelVertex>,
    pub indices: Vec<u32>,
}

/// A node (glTF): a mesh with a transform.
#[derive(Clone, Debug, PartialEq)]
pub struct ModelNode {
    pub name: String,
    /// Index into [`Model::meshes`].
    pub mesh: usize,
    pub model_from_mesh: Affine3A,
}

/// A 3D model: meshes and nodes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Model {
    pub meshes: Vec<Vec<MeshPrimitive>>,
    pub nodes: Vec<ModelNode>,
}

impl Model {
    /// The first node whose name starts with `name`.
    pub fn node(&self, name: &str) -> Option<&ModelNode> {
        self.nodes.iter().find(|node| node.name.starts_with(name))
    }

    /// The primitives of a node.
    pub fn parts(&self, node: &ModelNode) -> &[MeshPrimitive] {
        self.meshes.get(node.mesh).map_or(&[], Vec::as_slice)
    }

    /// Bounding box of the nodes that pass a filter; `None` if they are empty.
    pub fn bounds(&self, wanted: impl Fn(&ModelNode) -> bool) -> Option<[Vec3; 2]> {
        let mut bounds: Option<[Vec3; 2]> = None;
        for node in self.nodes.iter().filter(|node| wanted(node)) {
            for vertex in self.parts(node).iter().flat_map(|part| &part.vertices) {
                let at = node.model_from_mesh.transform_point3(vertex.position);
                let [low, high] = bounds.get_or_insert([at, at]);
                (*low, *high) = (low.min(at), high.max(at));
            }
        }
        bounds
    }

    pub fn triangle_count(&self) -> usize {
        self.nodes.iter().flat_map(|node| self.parts(node)).map(|part| part.indices.len() / 3).sum()
    }
}

/// A constant material for faces made in code.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StaticMaterial {
    pub name: &'static str,
    pub colour: [u8; 3],
    pub metallic: f32,
    pub roughness: f32,
}

impl StaticMaterial {
    pub const fn new(name: &'static str, colour: [u8; 3]) -> Self {
        Self { name, colour, metallic: 0.0, roughness: 0.9 }
    }

    pub const fn rough(self, roughness: f32) -> Self {
        Self { roughness, ..self }
    }

    pub const fn metal(self) -> Self {
        Self { metallic: 1.0, ..self }
    }
}

/// Builds mesh primitives, one per material.
#[derive(Clone, Debug, Default)]
pub struct PrimitiveBuilder {
    parts: Vec<MeshPrimitive>,
}

impl PrimitiveBuilder {
    pub fn finish(self) -> Vec<MeshPrimitive> {
        self.parts
    }

    fn part(&mut self, face_material: StaticMaterial) -> &mut MeshPrimitive {
        let known = self.parts.iter().position(|part| part.material.name == face_material.name);
        let index = known.unwrap_or_else(|| {
            let StaticMaterial { name, colour, metallic, roughness } = face_material;
            let material = Material { name: name.to_owned(), colour, metallic, roughness };
            self.parts.push(MeshPrimitive { material, vertices: Vec::new(), indices: Vec::new() });
            self.parts.len() - 1
        });
        &mut self.parts[index]
    }

    pub fn vertex(
        &mut self,
        face_material: StaticMaterial,
        position: Vec3,
        normal: Vec3,
        openness: u8,
    ) -> u32 {
        let part = self.part(face_material);
        part.vertices.push(ModelVertex { position, normal, uv: Vec2::ZERO, openness });
        part.vertices.len() as u32 - 1
    }

    pub fn triangle(&mut self, face_material: StaticMaterial, corners: [u32; 3]) {
        self.part(face_material).indices.extend(corners);
    }

    /// Adds a flat convex face, corners counter-clockwise seen from outside.
    pub fn plate(&mut self, corners: &[Vec3], face_material: StaticMaterial, openness: u8) {
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or(Vec3::Z);
        let first = corners.iter().map(|&corner| self.vertex(face_material, corner, normal, openness)).min();
        for k in 2..corners.len() as u32 {
            let base = first.unwrap_or_default();
            self.triangle(face_material, [base, base + k - 1, base + k]);
        }
    }

    /// Adds a closed box.
    pub fn block(&mut self, low: Vec3, high: Vec3, face_material: StaticMaterial, openness: u8) {
        let at = |k: usize| {
            Vec3::new(
                if k & 1 == 0 { low.x } else { high.x },
                if k & 2 == 0 { low.y } else { high.y },
                if k & 4 == 0 { low.z } else { high.z },
            )
        };
        for face in [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]] {
            self.plate(&face.map(at), face_material, openness);
        }
    }

    /// Adds a grid of points as a smooth surface. Rows of `points` have equal length. The face between rows
    /// r, r + 1 and columns c, c + 1 has the given material, or is left out where it is `None`. It faces
    /// along (next column) x (next row).
    pub fn grid(
        &mut self,
        points: &[Vec<Vec3>],
        openness: impl Fn(Vec3) -> u8,
        face_material: impl Fn(usize, usize) -> Option<StaticMaterial>,
    ) {
        let (rows, columns) = (points.len(), points.first().map_or(0, Vec::len));
        let at = |r: usize, c: usize| points[r][c];
        // Area-weighted mean normal of the four adjacent faces: degenerate ones have no weight.
        let normal = |r: usize, c: usize| {
            let mut sum = Vec3::ZERO;
            for (dr, dc) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                let (Some(r), Some(c)) = ((r + dr).checked_sub(1), (c + dc).checked_sub(1)) else { continue };
                if r + 1 < rows && c + 1 < columns {
                    sum += (at(r + 1, c + 1) - at(r, c)).cross(at(r + 1, c) - at(r, c + 1));
                }
            }
            sum.normalize_or(Vec3::Z)
        };
        let mut slots: std::collections::BTreeMap<(usize, usize, &'static str), u32> = Default::default();
        for r in 0..rows.saturating_sub(1) {
            for c in 0..columns.saturating_sub(1) {
                let Some(face_material) = face_material(r, c) else { continue };
                let corners = [(r, c), (r, c + 1), (r + 1, c + 1), (r + 1, c)];
                let place = corners.map(|(r, c)| at(r, c));
                let [p, q, s, t] = corners.map(|(r, c)| {
                    *slots.entry((r, c, face_material.name)).or_insert_with(|| {
                        self.vertex(face_material, at(r, c), normal(r, c), openness(at(r, c)))
                    })
                });
                let flat = |a: usize, b: usize, c: usize| {
                    (place[b] - place[a]).cross(place[c] - place[a]).length_squared() < 1e-10
                };
                if !flat(0, 1, 2) {
                    self.triangle(face_material, [p, q, s]);
                }
                if !flat(0, 2, 3) {
                    self.triangle(face_material, [p, s, t]);
                }
            }
        }
    }
}
