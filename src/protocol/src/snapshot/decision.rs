//! Decisions of the control framework, as it tells them to people: what limits a vehicle, and why. Nothing depends on them.

use super::VehicleId;
use city3d_geometry::Pose2;
use glam::DVec2;
use serde::{Deserialize, Serialize};

/// What limits a vehicle in a control step: the active constraint of its decision.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[repr(u8)]
pub enum DecisionReason {
    /// Nothing: it drives at its desired speed, or accelerates to it.
    #[default]
    FreeRoad = 0,
    /// The speed limit or a bend, here or ahead.
    RoadSpeed = 1,
    /// The vehicle ahead.
    Leader = 2,
    /// Its predecessor in a platoon.
    Platoon = 3,
    /// The end of its route.
    RouteEnd = 4,
    /// A stop line.
    StopLine = 5,
    /// A yield line.
    YieldLine = 6,
    /// A traffic signal.
    Signal = 7,
    /// A junction without a line, where others have the right of way.
    Junction = 8,
    /// Traffic that leaves no room behind the junction.
    NoRoom = 9,
    /// A crossing conflict zone that another vehicle has yet to leave.
    Crossing = 10,
    /// A vehicle that merges ahead of it.
    Merging = 11,
    /// Its coordinated plan.
    Plan = 12,
    /// The safety filter, which brakes harder than its plan.
    SafetyFilter = 13,
    /// It has not been measured for too long: it is planned to a stop.
    NotMeasured = 14,
    /// It is on no lane in the direction of travel: it is stopped.
    OffRoute = 15,
}

/// The decision of the control framework for one vehicle, city units.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ControlDecision {
    /// The vehicle that it is about.
    pub vehicle: VehicleId,
    /// What limits it.
    pub reason: DecisionReason,
    /// The vehicle that it follows or gives way to, where there is one.
    pub other: Option<VehicleId>,
    /// Where it has to stop, or the rear of the vehicle that it follows, as seen along its route.
    pub place: Option<DVec2>,
    /// Speed that its route and its driver allow where it is.
    pub target_mps: f64,
    /// Planned acceleration.
    pub acceleration_mps2: f64,
    /// How far its plan is ahead of its measured pose, along the route.
    pub longitudinal_error_m: f64,
    /// Its pose as it was measured last.
    pub measured: Pose2,
}
