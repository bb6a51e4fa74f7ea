//! A planar pose: position and heading.

use super::trig;
use glam::DVec2;
use serde::{Deserialize, Serialize};

/// A planar pose: position and heading (SE(2)). Frame and unit are those of the owner.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Pose2 {
    pub position: DVec2,
    /// Counter-clockwise from the x axis (east).
    pub yaw_rad: f64,
}

impl Pose2 {
    pub fn new(x: f64, y: f64, yaw_rad: f64) -> Self {
        Self { position: DVec2::new(x, y), yaw_rad }
    }

    /// Unit vector of the heading.
    pub fn forward(&self) -> DVec2 {
        let (sin, cos) = trig::sin_cos(self.yaw_rad);
        DVec2::new(cos, sin)
    }

    /// Unit vector a quarter turn to the left of the heading.
    pub fn left(&self) -> DVec2 {
        self.forward().perp()
    }

    /// The point `ahead` metres in front of the pose and `left` metres to its left.
    pub fn point_at(&self, ahead: f64, left: f64) -> DVec2 {
        let forward = self.forward();
        self.position + forward * ahead + forward.perp() * left
    }

    /// The pose moved along its own heading.
    pub fn advanced(&self, ahead: f64) -> Self {
        Self { position: self.point_at(ahead, 0.0), yaw_rad: self.yaw_rad }
    }

    /// The pose at another length scale; the heading is kept.
    pub fn scaled(&self, factor: f64) -> Self {
        Self { position: self.position * factor, yaw_rad: self.yaw_rad }
    }

    pub fn is_finite(&self) -> bool {
        self.position.is_finite() && self.yaw_rad.is_finite()
    }
}
