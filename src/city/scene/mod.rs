//! The city as triangles: what the renderer draws of a map. Pure data, a function of the map alone.

#![allow(clippy::disallowed_methods, reason = "only draws; no state of a run depends on it")]

mod mesh;
mod polygon;

pub use mesh::{Class, Finish, Mesh, Surface, Vertex};

use glam::Vec3;

/// Everything that stands in the city, in metres relative to the city's origin.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SceneDescription {
    pub meshes: Vec<Mesh>,
    /// The box that holds the city itself, without the plain around it.
    pub bounds: [Vec3; 2],
}
