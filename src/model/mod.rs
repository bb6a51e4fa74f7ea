//! Meshes that come from files or are made for them: cars, buildings, what stands in the streets.
//!
//! Everything here is in the frame of the project: metres, x forward (of a building: to the right of
//! someone who looks at its front from above), y left, z up, origin on the ground.

#![allow(clippy::disallowed_methods, reason = "only draws; no state of a run depends on it")]

pub mod car;
mod fit;
pub mod glb;
mod shipped;
pub mod street;

pub use fit::{Fitted, Measures, fitted, is_stand_in};
pub use glb::ModelError;
pub use shipped::{SHIPPED, made, shipped};

use glam::{Affine3A, Vec2, Vec3};

/// What faces are made of. What a material is for is told by its name.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    pub name: String,
    /// sRGB.
    pub colour: [u8; 3],
    /// 0 or 1: bare metal mirrors in its own colour.
    pub metallic: f32,
    /// 0 mirror-like to 1 dull.
    pub roughness: f32,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vertex {
    pub position: Vec3,
    pub normal: Vec3,
    pub uv: Vec2,
    /// How much of the sky's light reaches it, 255 for all.
    pub openness: u8,
}

/// Indexed triangles of one material, counter-clockwise seen from outside.
#[derive(Clone, Debug, PartialEq)]
pub struct Part {
    pub material: Material,
    pub vertices: Vec<Vertex>,
    pub indices: Vec<u32>,
}

/// A mesh at a place.
#[derive(Clone, Debug, PartialEq)]
pub struct Node {
    pub name: String,
    /// Index into [`Model::meshes`].
    pub mesh: usize,
    pub model_from_mesh: Affine3A,
}

/// What one file holds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Model {
    pub meshes: Vec<Vec<Part>>,
    pub nodes: Vec<Node>,
}

impl Model {
    /// The first node whose name begins like this.
    pub fn node(&self, name: &str) -> Option<&Node> {
        self.nodes.iter().find(|node| node.name.starts_with(name))
    }

    /// Parts of a node.
    pub fn parts(&self, node: &Node) -> &[Part] {
        self.meshes.get(node.mesh).map_or(&[], Vec::as_slice)
    }

    /// The smallest box around the nodes that a filter lets through; `None` where they are empty.
    pub fn bounds(&self, wanted: impl Fn(&Node) -> bool) -> Option<[Vec3; 2]> {
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

/// Material of a face that is made in code.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Skin {
    pub name: &'static str,
    pub colour: [u8; 3],
    pub metallic: f32,
    pub roughness: f32,
}

impl Skin {
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

/// Gathers faces by material.
#[derive(Clone, Debug, Default)]
pub struct Builder {
    parts: Vec<Part>,
}

impl Builder {
    pub fn finish(self) -> Vec<Part> {
        self.parts
    }

    fn part(&mut self, skin: Skin) -> &mut Part {
        let known = self.parts.iter().position(|part| part.material.name == skin.name);
        let index = known.unwrap_or_else(|| {
            let Skin { name, colour, metallic, roughness } = skin;
            let material = Material { name: name.to_owned(), colour, metallic, roughness };
            self.parts.push(Part { material, vertices: Vec::new(), indices: Vec::new() });
            self.parts.len() - 1
        });
        &mut self.parts[index]
    }

    pub fn vertex(&mut self, skin: Skin, position: Vec3, normal: Vec3, openness: u8) -> u32 {
        let part = self.part(skin);
        part.vertices.push(Vertex { position, normal, uv: Vec2::ZERO, openness });
        part.vertices.len() as u32 - 1
    }

    pub fn triangle(&mut self, skin: Skin, corners: [u32; 3]) {
        self.part(skin).indices.extend(corners);
    }

    /// A flat convex face, corners counter-clockwise seen from outside.
    pub fn plate(&mut self, corners: &[Vec3], skin: Skin, openness: u8) {
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or(Vec3::Z);
        let first = corners.iter().map(|&corner| self.vertex(skin, corner, normal, openness)).min();
        for k in 2..corners.len() as u32 {
            let base = first.unwrap_or_default();
            self.triangle(skin, [base, base + k - 1, base + k]);
        }
    }

    /// A closed box.
    pub fn block(&mut self, low: Vec3, high: Vec3, skin: Skin, openness: u8) {
        let at = |k: usize| {
            Vec3::new(
                if k & 1 == 0 { low.x } else { high.x },
                if k & 2 == 0 { low.y } else { high.y },
                if k & 4 == 0 { low.z } else { high.z },
            )
        };
        for face in [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]] {
            self.plate(&face.map(at), skin, openness);
        }
    }

    /// A grid of points as a smooth surface. Rows of `points` have equal length; the face between rows
    /// r, r + 1 and columns c, c + 1 has what `skin` says, `None` leaves it out. It faces along
    /// (next column) x (next row).
    pub fn grid(
        &mut self,
        points: &[Vec<Vec3>],
        openness: impl Fn(Vec3) -> u8,
        skin: impl Fn(usize, usize) -> Option<Skin>,
    ) {
        let (rows, columns) = (points.len(), points.first().map_or(0, Vec::len));
        let at = |r: usize, c: usize| points[r][c];
        // Of the four faces around a point, so that folded ones weigh nothing.
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
                let Some(skin) = skin(r, c) else { continue };
                let corners = [(r, c), (r, c + 1), (r + 1, c + 1), (r + 1, c)];
                let place = corners.map(|(r, c)| at(r, c));
                let [p, q, s, t] = corners.map(|(r, c)| {
                    *slots
                        .entry((r, c, skin.name))
                        .or_insert_with(|| self.vertex(skin, at(r, c), normal(r, c), openness(at(r, c))))
                });
                let flat = |a: usize, b: usize, c: usize| {
                    (place[b] - place[a]).cross(place[c] - place[a]).length_squared() < 1e-10
                };
                if !flat(0, 1, 2) {
                    self.triangle(skin, [p, q, s]);
                }
                if !flat(0, 2, 3) {
                    self.triangle(skin, [p, s, t]);
                }
            }
        }
    }
}
