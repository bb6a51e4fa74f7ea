//! Motion from measured poses: the one place where speeds, yaw rates and accelerations are made of poses, and where
//! it is decided whether a vehicle stands.
//!
//! [`MotionFilter`] is for poses as they come, [`smooth`] for recorded ones, [`StandDetector`] for stands.
//! `docs/estimation.md` has the model and how well it does.

mod filter;
mod noise;
mod odometer;
mod singer;
mod smoother;
mod stand;

pub use filter::{MotionFilter, Taken};
pub use noise::NoiseModel;
pub use odometer::Odometer;
pub use smoother::{LONGEST_GAP_S, smooth};
pub use stand::{LEFT_M, MOVES_MPS, Observed, STANDS_MPS, StandChange, StandDetector};

use crate::geom::Pose2;
use glam::DVec2;

/// How a vehicle moves at a time as its poses tell it, and how well that is known. Lengths are of the unit of the poses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionEstimate {
    pub time_s: f64,
    pub pose: Pose2,
    pub velocity_mps: DVec2,
    /// Along the heading; negative backwards.
    pub speed_mps: f64,
    /// Of the speed: along the heading, without the centripetal one.
    pub acceleration_mps2: f64,
    /// Counter-clockwise.
    pub yaw_rate_radps: f64,
    pub std: MotionStd,
}

/// Standard deviations of a motion.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MotionStd {
    /// Of each coordinate.
    pub position_m: f64,
    pub heading_rad: f64,
    /// Of each component of the velocity, and so of the speed.
    pub speed_mps: f64,
    pub yaw_rate_radps: f64,
    pub acceleration_mps2: f64,
}

#[cfg(test)]
mod accuracy;
#[cfg(test)]
mod stand_tests;
#[cfg(test)]
mod tests;
