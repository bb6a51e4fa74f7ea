//! Wire format of the laboratory's link, in laboratory metres, and its conversion to and from the full-scale city.
//!
//! [`LengthScale`] is applied here for poses and messages. [`Body::encode`] and [`Body::decode`] implement the datagrams of
//! `docs/wire.md`; sockets are in `link`.

mod body;
mod bytes;
mod commands;
mod decisions;
mod denial;
mod description;
mod drive;
mod drops;
mod envelope;
mod plans;
mod setup;
mod signals;
mod trajectories;

pub use body::{
    Body, CityClock, ExperimentAction, ExperimentPhase, MAX_DETAIL_BYTES, MAX_LEASE_S, MAX_POSES,
    ObservedVehicle, Poses, RequestOutcome,
};
pub use bytes::{DecodeError, DecodeFault, EncodeError};
pub use decisions::{Decisions, MAX_ACCELERATION_MPS2, MAX_DECISIONS, VehicleDecision};
pub use denial::{Denial, DenialReason};
pub use description::{CityDescription, MAX_DESCRIBED};
pub use drops::{DropCounts, DropReason};
pub use envelope::{
    Authenticator, DatagramHeader, HEADER_BYTES, MAGIC, MAX_BODY_BYTES, MAX_DATAGRAM_BYTES, MIN_KEY_BYTES,
    VERSION,
};
pub use plans::{MAX_PLAN_AHEAD_S, MAX_PLAN_ENTRIES, MAX_ZONES, Plans};
pub use setup::{MAX_NAME_BYTES, MAX_PARAMETERS, MAX_TORQUE_POINTS, PERSON, VehicleBuild, VehicleSetup};
pub use trajectories::{MAX_POINTS, MAX_TRAJECTORIES, pack};

use crate::snapshot::{
    FrameSnapshot, MeasuredPose, SignalAspects, SimCommand, Trajectory, VehicleId, VehicleState,
};
use city3d_geometry::{Lab, LengthScale, Pose2};
use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};

/// Largest coordinate on the laboratory's floor.
pub const MAX_COORDINATE_M: f64 = 1000.0;
/// Largest angle; angles need not be wrapped.
pub const MAX_ANGLE_RAD: f64 = 1000.0;
/// Largest speed on the laboratory's floor.
pub const MAX_SPEED_MPS: f64 = 100.0;
/// Largest time.
pub const MAX_TIME_S: f64 = 1e9;

/// A measured pose may be stamped this far ahead of the clock of who receives it, seconds.
pub const MAX_AHEAD_S: f64 = 0.5;

/// Length of a quaternion that is taken for a rotation.
pub const UNIT_NORM: std::ops::RangeInclusive<f64> = 0.9..=1.1;

/// Name of the frame of VICON's measurements.
pub const VICON_WORLD: &str = "/vicon/world";

/// Name of the frame of a VICON subject; with a leading slash, the topic of its poses.
pub fn vicon_frame(subject: &str) -> String {
    format!("vicon/{subject}/{subject}")
}

/// A measured pose of motion capture, without speed. Laboratory metres.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Measurement {
    /// The measured vehicle.
    pub vehicle: VehicleId,
    /// When the pose was measured.
    pub stamp_s: f64,
    /// Middle of the outline, on the floor.
    pub position: DVec3,
    /// Laboratory from body, body axes forward, left, up.
    pub orientation: DQuat,
}

impl Measurement {
    /// The pose of a vehicle of the city as the laboratory would measure it.
    pub fn of(state: &VehicleState, time_s: f64, scale: LengthScale) -> Self {
        Self {
            vehicle: state.id,
            stamp_s: time_s,
            position: state.position / scale.factor(),
            orientation: state.orientation,
        }
    }

    /// All vehicles of a snapshot, in id order.
    pub fn all(snapshot: &FrameSnapshot, scale: LengthScale) -> impl Iterator<Item = Self> + '_ {
        snapshot.vehicles.iter().map(move |state| Self::of(state, snapshot.time_s, scale))
    }

    /// The command for the full-scale city.
    pub fn into_command(self, scale: LengthScale) -> SimCommand {
        let Self { vehicle, stamp_s, position, orientation } = self;
        SimCommand::Measure(
            vehicle,
            MeasuredPose { stamp_s, position: position * scale.factor(), orientation },
        )
    }

    /// Position and heading seen from above, on the laboratory's floor.
    pub fn pose_in_lab(&self) -> Pose2<Lab> {
        let forward = self.orientation * DVec3::X;
        Pose2::at(self.position.truncate(), city3d_geometry::trig::atan2(forward.y, forward.x))
    }
}

/// A message from the control framework to a vehicle or to the traffic signals. Laboratory metres.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Message {
    /// Desired motion of one vehicle: poses of the front-axle centre over a horizon that covers the
    /// stopping distance.
    Follow(Trajectory<Lab>),
    /// The vehicle leaves the city.
    Remove(VehicleId),
    /// Signal heads show these aspects.
    Signals(SignalAspects),
}

impl Message {
    /// The vehicle that the message is for; `None` for traffic signals.
    pub fn vehicle(&self) -> Option<VehicleId> {
        match self {
            Self::Follow(trajectory) => Some(trajectory.vehicle),
            Self::Remove(id) => Some(*id),
            Self::Signals(_) => None,
        }
    }

    /// The message as a command of the full-scale city.
    pub fn into_command(self, scale: LengthScale) -> SimCommand {
        match self {
            Self::Follow(trajectory) => SimCommand::Follow(trajectory.into_city(scale)),
            Self::Remove(id) => SimCommand::Remove(id),
            Self::Signals(aspects) => SimCommand::Signals(aspects),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::snapshot::TrajectoryPoint;

    #[test]
    fn the_scale_is_applied_to_lengths_and_speeds_and_not_to_time() {
        let point = TrajectoryPoint { time_s: 3.5, pose: Pose2::new(1.0, -2.0, 0.4), speed_mps: 0.35 };
        let lab =
            Trajectory { vehicle: VehicleId(3), sequence: 7, points: vec![point], ..Trajectory::default() };
        let SimCommand::Follow(city) = Message::Follow(lab).into_command(LengthScale::TESTBED) else {
            panic!("a trajectory stays one");
        };
        assert_eq!(city.points[0].time_s, 3.5);
        assert_eq!(city.points[0].pose, Pose2::new(25.0, -50.0, 0.4));
        assert!((city.points[0].speed_mps - 8.75).abs() < 1e-12);
    }

    #[test]
    fn the_points_of_an_applied_command_are_space_for_others() {
        let lab = Trajectory { points: vec![TrajectoryPoint::default(); 13], ..Trajectory::default() };
        let first = lab.points.as_ptr().addr();
        let spare = lab.into_city(LengthScale::TESTBED).into_spare();
        assert!(spare.is_empty());
        assert_eq!((spare.as_ptr().addr(), spare.capacity()), (first, 13), "no allocation");
    }
}
