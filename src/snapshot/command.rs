//! Commands: the only way to change the world. A network packet, a key press and a replayed log
//! all become one of these.

use super::{Indicator, VehicleId, VehicleSpec};
use crate::geom::Pose2;
use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};

/// One desired state of a vehicle on its way, city frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TrajectoryPoint {
    /// Simulated time at which the vehicle shall be here.
    pub time_s: f64,
    /// Pose of the front-axle centre on its path: the point that the tracking control leads.
    pub pose: Pose2,
    pub speed_mps: f64,
}

/// The desired motion of one vehicle over a horizon that covers its stopping distance.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Trajectory {
    pub vehicle: VehicleId,
    /// Counted by the sender, one up for each message to this vehicle; older ones are dropped.
    pub sequence: u32,
    /// In time order.
    pub points: Vec<TrajectoryPoint>,
    /// The sender holds the vehicle back for a yield sign or the right of way of another.
    pub yielding: bool,
    /// The vehicle is at the end of its route.
    pub finished: bool,
    pub indicator: Indicator,
}

/// A sequence number this far behind the last one is a restarted sender's, not an old message.
const SENDER_RESTARTED: u32 = 1 << 16;

impl Trajectory {
    /// Whether it is newer than one of the same sender with this sequence.
    pub fn follows(&self, last: u32) -> bool {
        let ahead = self.sequence.wrapping_sub(last);
        ahead != 0 && (ahead < u32::MAX / 2 || ahead.wrapping_neg() > SENDER_RESTARTED)
    }

    /// Whether all of it lies before a time.
    pub fn is_over(&self, time_s: f64) -> bool {
        self.points.last().is_none_or(|point| point.time_s < time_s)
    }
}

/// Body shapes that the city can draw.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum BodyType {
    #[default]
    Sedan,
    Hatchback,
    Suv,
    Van,
    Pickup,
    /// A model of the user's: its place among those of the scenario.
    Own(u16),
}

impl BodyType {
    /// Height of the body as drawn over the vehicle's stated height: that is a sedan's, and a van on the
    /// same wheels stands higher. Physics does not know.
    pub fn height_factor(self) -> f64 {
        match self {
            Self::Sedan | Self::Own(_) => 1.0,
            Self::Hatchback => 1.02,
            Self::Suv => 1.18,
            Self::Pickup => 1.17,
            Self::Van => 1.40,
        }
    }
}

/// How a vehicle looks.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Appearance {
    pub body: BodyType,
    /// sRGB.
    pub colour: [u8; 3],
}

impl Default for Appearance {
    fn default() -> Self {
        Self { body: BodyType::Sedan, colour: [178, 34, 34] }
    }
}

/// What brings a vehicle into the world, city frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Setup {
    pub id: VehicleId,
    pub name: String,
    pub appearance: Appearance,
    /// Middle of the outline.
    pub pose: Pose2,
    /// Along the heading.
    pub speed_mps: f64,
    /// How the vehicle is built and controlled.
    pub spec: VehicleSpec,
}

/// Pedals and wheel of a human driver.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Pedals {
    pub gas: f64,
    pub brake: f64,
    pub handbrake: f64,
    /// Desired steering angle, left-positive.
    pub steering_rad: f64,
    pub reverse: bool,
    pub indicator: Indicator,
}

/// Where a vehicle of the laboratory was measured to be, city frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MeasuredPose {
    /// Simulated time of the measurement.
    pub stamp_s: f64,
    /// Middle of the outline, on the ground.
    pub position: DVec3,
    /// City from body.
    pub orientation: DQuat,
}

/// A change of the world, applied at the tick at which it arrives.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum SimCommand {
    Start,
    Pause,
    /// Back to the initial conditions: the run that follows equals the first one exactly.
    Reset,
    /// A vehicle is there from now on. One of that number that is there already stays as it is, and takes
    /// trajectories of any sequence again: its sender has begun anew.
    Spawn(Box<Setup>),
    Follow(Trajectory),
    Remove(VehicleId),
    /// A vehicle of the laboratory was seen; others are where their dynamics have brought them.
    Measure(VehicleId, MeasuredPose),
    /// A person takes the vehicle over, or drives on with new pedals.
    Drive(VehicleId, Pedals),
    /// The person gives it back to its algorithm.
    Release(VehicleId),
}

impl SimCommand {
    /// The vehicle it is for; commands are applied in the order of (vehicle, sequence).
    pub fn vehicle(&self) -> Option<VehicleId> {
        match self {
            Self::Start | Self::Pause | Self::Reset => None,
            Self::Spawn(setup) => Some(setup.id),
            Self::Follow(trajectory) => Some(trajectory.vehicle),
            Self::Remove(id) | Self::Measure(id, _) | Self::Drive(id, _) | Self::Release(id) => Some(*id),
        }
    }

    /// Commands of a tick are applied in this order; those that are equal in it, as they came.
    pub fn order(&self) -> (Option<VehicleId>, u32) {
        (self.vehicle(), if let Self::Follow(trajectory) = self { trajectory.sequence } else { 0 })
    }
}
