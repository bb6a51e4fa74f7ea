//! 3D models from glTF files: cars and street furniture.
//!
//! Frame: metres, x forward (of a building: to the right of an observer in front of it), y left, z up, origin
//! on the ground.

#![allow(clippy::disallowed_methods, reason = "only draws; no state of a run depends on it")]

mod fit;
pub mod glb;
mod shipped;

pub use fit::{FittedCar, Measures, fitted, is_for_clear_glass, is_other_lod};
pub use glb::ModelError;
pub use shipped::{BENCH, BIN, FUEL_PUMP, FURNITURE, LAMP, PICNIC_TABLE, SHIPPED, shipped};

use glam::{Affine3A, Vec2, Vec3};

/// A material. Its name states its purpose.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// As in the file; empty if the file has none.
    pub name: String,
    /// sRGB.
    pub colour: [u8; 3],
    /// 0 or 1: metals reflect in their own colour.
    pub metallic: f32,
    /// From 0 (mirror) to 1 (matt).
    pub roughness: f32,
}

/// A corner of a triangle, in the frame of its mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ModelVertex {
    /// Metres, before [`ModelNode::model_from_mesh`] is applied.
    pub position: Vec3,
    /// Outward unit vector.
    pub normal: Vec3,
    /// Texture coordinates of glTF, v downwards; 0 if the file has none.
    pub uv: Vec2,
    /// How much of the sky's light reaches it, 255 for all.
    pub openness: u8,
}

/// A mesh primitive (glTF): indexed triangles of one material, counter-clockwise seen from outside.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshPrimitive {
    /// Colour and gloss of all its triangles.
    pub material: Material,
    /// Corners that the triangles share.
    pub vertices: Vec<ModelVertex>,
    /// Three for each triangle, into `vertices`.
    pub indices: Vec<u32>,
}

/// A node (glTF): a mesh with a transform.
#[derive(Clone, Debug, PartialEq)]
pub struct ModelNode {
    /// As in the file, where it states the purpose; `node_` and the index if the file has none.
    pub name: String,
    /// Index into [`Model::meshes`].
    pub mesh: usize,
    /// Transform of vertices into the frame of the model, metres.
    pub model_from_mesh: Affine3A,
}

/// A 3D model: meshes and nodes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Model {
    /// Meshes of the file, each with its primitives.
    pub meshes: Vec<Vec<MeshPrimitive>>,
    /// Nodes with a mesh, in the order of the scene.
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

    /// Triangles of all nodes; a mesh counts once for each node that shows it.
    pub fn triangle_count(&self) -> usize {
        self.nodes.iter().flat_map(|node| self.parts(node)).map(|part| part.indices.len() / 3).sum()
    }
}
