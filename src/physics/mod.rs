//! The rigid bodies of the city: the only door to rapier.

use glam::DVec2;
use rapier3d::prelude::*;
use serde::{Deserialize, Serialize};

/// All bodies of one world and what steps them.
#[derive(Clone, Serialize, Deserialize)]
pub struct Physics {
    dt_s: f64,
    bodies: RigidBodySet,
    colliders: ColliderSet,
}

impl std::fmt::Debug for Physics {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Physics").field("dt_s", &self.dt_s).field("bodies", &self.bodies.len()).finish()
    }
}

impl Physics {
    /// Flat ground at z = 0 and gravity; every step lasts `dt_s`.
    pub fn new(dt_s: f64) -> Self {
        Self { dt_s, bodies: RigidBodySet::new(), colliders: ColliderSet::new() }
    }

    /// Something that stands: a wall, a building. The simple polygon may be concave.
    pub fn add_static_polygon(&mut self, _polygon: &[DVec2], _height_m: f64) {}

    /// One step of all bodies.
    pub fn step(&mut self) {}
}
