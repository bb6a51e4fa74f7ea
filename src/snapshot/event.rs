//! Events: what a run's summary and figures tell.

use super::VehicleId;
use serde::{Deserialize, Serialize};

/// Something that happened to a vehicle.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Event {
    /// Simulated time.
    #[serde(rename = "t")]
    pub time_s: f64,
    pub vehicle: VehicleId,
    #[serde(flatten)]
    pub kind: EventKind,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum EventKind {
    Spawn,
    /// It overlapped another at the start and was put behind it along the lane.
    Moved {
        behind: VehicleId,
        by_m: f64,
    },
    /// It came to a stand.
    Stop,
    /// It moved off again after standing for so long.
    Go {
        stood_s: f64,
    },
    /// It began to give way.
    Yield,
    /// It went past the yield line in front of which it had given way, or drove through without.
    Merge,
    /// First overlap of two outlines.
    Collision {
        with: VehicleId,
    },
    /// First overlap with something that stands: a wall, a building.
    CollisionStatic {
        with: String,
    },
    LinkLost,
    LinkBack,
    /// A vehicle of the laboratory is no longer measured.
    Unseen,
    /// It is again.
    SeenAgain,
    /// At the end of its route.
    Finish,
    Remove,
}

impl EventKind {
    pub fn is_collision(&self) -> bool {
        matches!(self, Self::Collision { .. } | Self::CollisionStatic { .. })
    }
}
