//! Tracking control of one vehicle.

use super::{Actuation, Motion, VehicleSpec};
use crate::snapshot::Trajectory;
use serde::{Deserialize, Serialize};

/// Leads a vehicle's front axle along the newest trajectory.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Tracker {
    trajectory: Trajectory,
}

/// What the tracking control wants at one tick.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Tracking {
    pub actuation: Actuation,
    /// Front-axle centre from the path, left-positive; 0 without a path.
    pub lateral_error_m: f64,
    /// u_d of the paper, in [-1, 1].
    pub throttle: f64,
}

impl Tracker {
    /// The newest trajectory replaces the older one; the caller has checked its sequence.
    pub fn follow(&mut self, trajectory: Trajectory) {
        self.trajectory = trajectory;
    }

    /// The link is lost: from now on brake to a stop along the last path; the next trajectory ends it.
    pub fn stop_on_path(&mut self) {}

    /// One control step at simulated time `time_s`.
    pub fn step(&mut self, _spec: &VehicleSpec, _motion: &Motion, _time_s: f64, _dt_s: f64) -> Tracking {
        Tracking::default()
    }
}
