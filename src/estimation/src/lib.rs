//! State estimation: speeds, yaw rates, accelerations and standstill from measured poses. All other code
//! takes them from here.
//!
//! [`MotionFilter`] is a Kalman filter for poses as they arrive, [`smooth`] a Rauch-Tung-Striebel smoother
//! for recorded ones, [`StandstillDetector`] decides whether a vehicle stands. `docs/estimation.md` states
//! the model and its accuracy.

mod filter;
mod noise;
mod odometer;
mod singer;
mod smoother;
mod stand;

pub use filter::{MotionFilter, PoseUpdate};
pub use noise::NoiseModel;
pub use odometer::Odometer;
pub use smoother::{LONGEST_GAP_S, smooth};
pub use stand::{LEFT_M, MOVES_MPS, MotionSample, STANDS_MPS, StandstillChange, StandstillDetector};

use city3d_geometry::{City, Frame, Pose2};
use glam::DVec2;

/// Estimated motion of a vehicle at a time, with standard deviations. Lengths are in the unit of the poses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionEstimate<F: Frame = City> {
    /// Seconds of the clock that stamps the poses.
    pub time_s: f64,
    /// Frame and reference point are those of the measured poses.
    pub pose: Pose2<F>,
    /// Components along the axes of the frame.
    pub velocity_mps: DVec2,
    /// Along the heading; negative backwards.
    pub speed_mps: f64,
    /// Derivative of the speed along the heading, without the centripetal part.
    pub acceleration_mps2: f64,
    /// Counter-clockwise.
    pub yaw_rate_radps: f64,
    /// Standard deviations of the estimates above.
    pub std: MotionStd,
}

/// Standard deviations of a motion.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MotionStd {
    /// Of each coordinate.
    pub position_m: f64,
    /// Of the heading.
    pub heading_rad: f64,
    /// Of each velocity component, and so of the speed.
    pub speed_mps: f64,
    /// Of the yaw rate.
    pub yaw_rate_radps: f64,
    /// Of each acceleration component, and so of the acceleration along the heading.
    pub acceleration_mps2: f64,
}

#[cfg(test)]
mod accuracy;
#[cfg(test)]
mod stand_tests;
#[cfg(test)]
mod tests;
