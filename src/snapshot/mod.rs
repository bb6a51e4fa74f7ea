//! The plain data everyone shares: ids, the state of vehicles, one tick's snapshot, commands and events.
//!
//! City frame throughout: full-scale metres, x east, y north, z up, angles counter-clockwise from
//! east, seconds of simulated time. Bodies look along +x with +y to their left; the origin of a
//! vehicle is the middle of its outline, on the ground.

mod command;
mod event;
mod vehicle;

pub use command::{Appearance, BodyType, Pedals, Setup, SimCommand, Trajectory, TrajectoryPoint};
pub use event::{Event, EventKind};
pub use vehicle::{Dimensions, Indicator, Status, VehicleId, VehicleInfo, VehicleState, WheelState};

use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Everything that is known about one instant of a run. The renderer, the panels, the publishers
/// and the log read the same one.
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
    /// What does not change from tick to tick, in id order, one for each of `vehicles`.
    pub roster: Arc<Vec<VehicleInfo>>,
    /// What happened in this tick.
    pub events: Vec<Event>,
}

impl FrameSnapshot {
    pub fn vehicle(&self, id: VehicleId) -> Option<&VehicleState> {
        self.vehicles.binary_search_by_key(&id, |v| v.id).ok().map(|index| &self.vehicles[index])
    }

    pub fn info(&self, id: VehicleId) -> Option<&VehicleInfo> {
        self.roster.binary_search_by_key(&id, |v| v.id).ok().map(|index| &self.roster[index])
    }

    /// Becomes a copy of another snapshot, in the memory it already has.
    pub fn assign(&mut self, other: &Self) {
        (self.tick, self.time_s, self.state_hash) = (other.tick, other.time_s, other.state_hash);
        self.vehicles.clone_from(&other.vehicles);
        self.roster.clone_from(&other.roster);
        self.events.clone_from(&other.events);
    }

    /// Vehicles with their unchanging part, in id order.
    pub fn iter(&self) -> impl Iterator<Item = (&VehicleState, &VehicleInfo)> {
        self.vehicles.iter().zip(self.roster.iter())
    }
}
