//! Plain data shared by all modules: ids, vehicle states, snapshots, commands and events.
//!
//! City frame throughout: full-scale metres, x east, y north, z up, angles counter-clockwise from east,
//! seconds of simulated time. Body frames have x forward and y left; a vehicle's origin is the middle of its
//! outline, on the ground.

mod check;
mod command;
mod decision;
mod event;
mod limits;
mod plan;
mod signal;
mod spec;
mod vehicle;

pub use check::SpecError;
pub use command::{
    Appearance, BodyType, MeasuredPose, Pedals, Setup, SimCommand, Trajectory, TrajectoryPoint, is_newer,
};
pub use decision::{ControlDecision, DecisionReason};
pub use event::{Event, EventKind};
pub use plan::{
    CoordinationState, CoordinationUpdate, NoPlan, PlanPoint, PlannedPassage, ZoneCounts, ZoneState,
    ZoneVehicle,
};
pub use signal::{Aspect, SignalAspects, SignalHeadId};
pub use spec::{
    CentreOfMass, ControlGains, Drive, GRAVITY_MPS2, ModelKind, Motor, Suspension, TorquePoint, VehicleSpec,
};
pub use vehicle::{Dimensions, Indicator, Status, VehicleId, VehicleInfo, VehicleState, WheelState};

use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Immutable snapshot of one instant of a run, shared by renderer, panels, publishers and log.
///
/// Invariant: `vehicles` and `roster` have the same ids in the same, increasing order.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FrameSnapshot {
    /// Physics steps since the start or the last reset.
    pub tick: u64,
    /// Simulated time at this tick.
    pub time_s: f64,
    /// Digest of the whole state: two runs are the same when it is equal at every tick.
    pub state_hash: u64,
    /// In id order.
    pub vehicles: Vec<VehicleState>,
    /// Static data, in id order, one for each of `vehicles`.
    pub roster: Arc<Vec<VehicleInfo>>,
    /// Events of this tick.
    pub events: Vec<Event>,
    /// Aspects of the signal heads, by [`SignalHeadId`]; empty in a city without signals.
    pub signals: Vec<Aspect>,
}

impl FrameSnapshot {
    /// State of a vehicle; `None` if the city has none of this id.
    pub fn vehicle(&self, id: VehicleId) -> Option<&VehicleState> {
        self.vehicles.binary_search_by_key(&id, |v| v.id).ok().map(|index| &self.vehicles[index])
    }

    /// Static data of a vehicle; `None` if the city has none of this id.
    pub fn info(&self, id: VehicleId) -> Option<&VehicleInfo> {
        self.roster.binary_search_by_key(&id, |v| v.id).ok().map(|index| &self.roster[index])
    }

    /// Copies another snapshot into the present buffers.
    pub fn assign(&mut self, other: &Self) {
        (self.tick, self.time_s, self.state_hash) = (other.tick, other.time_s, other.state_hash);
        self.vehicles.clone_from(&other.vehicles);
        self.roster.clone_from(&other.roster);
        self.events.clone_from(&other.events);
        self.signals.clone_from(&other.signals);
    }

    /// Interpolates between two snapshots for drawing: `weight` is 0 at `before` and 1 at `after`. Ticks,
    /// digests, events, signals, pedals and statuses are those of `after`; everything is, if the two have different
    /// vehicles.
    pub fn blend(&mut self, before: &Self, after: &Self, weight: f64) {
        self.assign(after);
        let ids = |snapshot: &Self| snapshot.vehicles.iter().map(|v| v.id).collect::<Vec<_>>();
        if weight >= 1.0 || before.tick >= after.tick || ids(before) != ids(after) {
            return;
        }
        self.time_s = lerp(before.time_s, after.time_s, weight);
        for (vehicle, earlier) in self.vehicles.iter_mut().zip(&before.vehicles) {
            vehicle.blend_from(earlier, weight);
        }
    }

    /// Vehicles with their static data, in id order.
    pub fn iter(&self) -> impl Iterator<Item = (&VehicleState, &VehicleInfo)> {
        self.vehicles.iter().zip(self.roster.iter())
    }
}

fn lerp(from: f64, to: f64, weight: f64) -> f64 {
    from + (to - from) * weight
}

#[cfg(test)]
mod tests {
    use super::*;
    use city3d_geometry::trig;
    use glam::{DQuat, DVec3};

    fn at(tick: u64, x: f64, yaw_rad: f64) -> FrameSnapshot {
        let vehicle = VehicleState {
            id: VehicleId(1),
            position: DVec3::new(x, 2.0, 0.0),
            orientation: DQuat::from_xyzw(0.0, 0.0, trig::sin(yaw_rad / 2.0), trig::cos(yaw_rad / 2.0)),
            gas: x,
            ..VehicleState::default()
        };
        FrameSnapshot { tick, time_s: tick as f64, vehicles: vec![vehicle], ..FrameSnapshot::default() }
    }

    #[test]
    fn poses_between_ticks_lie_between_and_pedals_are_the_later_ones() {
        // The short way round, over the jump of the angle.
        let (before, after) = (at(4, 1.0, 3.0), at(5, 2.0, -3.0));
        let mut between = FrameSnapshot::default();
        between.blend(&before, &after, 0.25);
        let vehicle = &between.vehicles[0];
        assert_eq!((vehicle.position.x, between.time_s, between.tick, vehicle.gas), (1.25, 4.25, 5, 2.0));
        let turn = std::f64::consts::TAU - 6.0;
        assert!((vehicle.pose().yaw_rad - (3.0 + turn / 4.0)).abs() < 1e-4, "{}", vehicle.pose().yaw_rad);
        between.blend(&before, &after, 1.0);
        assert_eq!(between, after);
    }

    #[test]
    fn nothing_is_blended_over_a_reset_or_between_other_vehicles() {
        let (late, early) = (at(500, 90.0, 0.0), at(0, 1.0, 0.0));
        let mut between = FrameSnapshot::default();
        between.blend(&late, &early, 0.5);
        assert_eq!(between, early);
        let mut other = at(501, 3.0, 0.0);
        other.vehicles[0].id = VehicleId(2);
        between.blend(&late, &other, 0.5);
        assert_eq!(between, other);
    }
}
