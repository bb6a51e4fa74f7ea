//! Decisions of the control framework, as it tells them to people: what limits a vehicle, and why. No state depends on
//! them.

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

impl DecisionReason {
    /// All of them, each at the place of its number.
    pub const ALL: [Self; 16] = [
        Self::FreeRoad,
        Self::RoadSpeed,
        Self::Leader,
        Self::Platoon,
        Self::RouteEnd,
        Self::StopLine,
        Self::YieldLine,
        Self::Signal,
        Self::Junction,
        Self::NoRoom,
        Self::Crossing,
        Self::Merging,
        Self::Plan,
        Self::SafetyFilter,
        Self::NotMeasured,
        Self::OffRoute,
    ];

    /// Whether the place of the decision is the rear of a vehicle, and so drives on.
    pub fn has_moving_place(self) -> bool {
        matches!(self, Self::Leader | Self::Platoon | Self::Merging)
    }
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
    /// Its pose as it was measured last; `None` where the decision comes from a log or over the link, which tell decisions
    /// too seldom for it.
    pub measured: Option<Pose2>,
}

impl ControlDecision {
    /// The part that still holds some time later, as logs and the link tell it: without the places of what moves.
    #[must_use]
    pub fn lasting(self) -> Self {
        let place = self.place.filter(|_| !self.reason.has_moving_place());
        Self { place, measured: None, ..self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reasons_have_their_numbers() {
        let numbers = DecisionReason::ALL.map(|reason| usize::from(reason as u8));
        assert!(numbers.iter().enumerate().all(|(place, number)| place == *number));
    }

    #[test]
    fn what_moves_does_not_last() {
        let told = |reason| ControlDecision {
            reason,
            place: Some(DVec2::ONE),
            measured: Some(Pose2::default()),
            ..ControlDecision::default()
        };
        assert_eq!(told(DecisionReason::YieldLine).lasting().place, Some(DVec2::ONE));
        let following = told(DecisionReason::Leader).lasting();
        assert_eq!((following.place, following.measured), (None, None));
    }
}
