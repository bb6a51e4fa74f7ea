//! The body of a vehicle in the physics, and by itself while nothing is near.

use super::{Motion, VehicleSpec};
use crate::physics::{BodyId, BodyState, BoxBody, FreeBody, Physics};
use city3d_geometry::Pose2;
use glam::DVec3;
use serde::{Deserialize, Serialize};

/// Ground clearance of the collision box.
const CLEARANCE_M: f64 = 0.2;
/// Inset of the collision box from the outline: contacts would otherwise hold slow vehicles apart before
/// their outlines overlap, and a collision is the overlap of outlines.
const BUMPER_M: f64 = 0.03;
/// A box this high above the ground, with its way in a step, does not touch it.
const ABOVE_GROUND_M: f64 = 0.05;
/// Cosine of 5.7 degrees: the outline of a box that is tilted by less covers the box but for 0.15 m.
const LEVEL: f64 = 0.995;

/// The body of a vehicle.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(super) struct Chassis {
    body: BodyId,
    /// `None` while the physics has it.
    free: Option<FreeBody>,
}

impl Chassis {
    /// A body that is in the physics.
    pub(super) fn of(body: BodyId) -> Self {
        Self { body, free: None }
    }

    pub(super) fn body(&self) -> BodyId {
        self.body
    }

    pub(super) fn is_free(&self) -> bool {
        self.free.is_some()
    }

    /// `None` where the physics does not have it.
    pub(super) fn state(&self, physics: &Physics) -> Option<BodyState> {
        self.free.as_ref().map_or_else(|| physics.body(self.body), |free| Some(free.state()))
    }

    pub(super) fn release(&mut self, physics: &mut Physics) {
        if self.free.is_none() {
            self.free = physics.release(self.body);
        }
    }

    pub(super) fn hold(&mut self, physics: &mut Physics) {
        if let Some(free) = self.free.take() {
            physics.hold(self.body, &free);
        }
    }

    /// `None` while the physics has it.
    pub(super) fn free_mut(&mut self) -> Option<&mut FreeBody> {
        self.free.as_mut()
    }
}

/// The collision box of a vehicle, inset from its outline, with its mass and the inertia of a homogeneous
/// block of the outline.
pub(super) fn collision_box(spec: &VehicleSpec, pose: Pose2, speed_mps: f64) -> BoxBody {
    let d = &spec.dimensions;
    let size = DVec3::new(d.length_m, d.width_m, d.height_m);
    let square = size * size;
    let block = DVec3::new(square.y + square.z, square.x + square.z, square.x + square.y) / 12.0;
    BoxBody {
        position: pose.position.extend(0.0),
        yaw_rad: pose.yaw_rad,
        velocity_mps: pose.forward().extend(0.0) * speed_mps,
        size_m: size - DVec3::new(2.0 * BUMPER_M, 2.0 * BUMPER_M, 0.0),
        clearance_m: CLEARANCE_M.min(0.5 * d.height_m),
        mass_kg: spec.mass_kg,
        centre_of_mass_m: DVec3::new(spec.centre_of_mass.ahead_m, 0.0, spec.centre_of_mass.height_m),
        inertia_kgm2: block * DVec3::new(1.0, 1.0, spec.yaw_inertia_factor) * spec.mass_kg,
    }
}

/// Whether the collision box of a vehicle is level and so high above the ground that it touches it neither now nor in the
/// next step of `dt_s`.
pub fn clears_ground(spec: &VehicleSpec, motion: &Motion, dt_s: f64) -> bool {
    let d = &spec.dimensions;
    let axes = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| (motion.orientation * axis).z);
    let lowest = motion.position.z + CLEARANCE_M.min(0.5 * d.height_m) * axes[2]
        - (axes[0].abs() * d.length_m + axes[1].abs() * d.width_m) / 2.0;
    axes[2] > LEVEL && lowest > ABOVE_GROUND_M + 2.0 * dt_s * motion.velocity_mps.z.abs()
}
