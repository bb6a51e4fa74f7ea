//! Events of a run, for summaries and figures.

use super::VehicleId;
use serde::{Deserialize, Serialize};

/// An event of a vehicle.
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
    /// Its start overlapped another vehicle; it was moved back along the lane.
    Moved {
        behind: VehicleId,
        by_m: f64,
    },
    /// It stopped.
    Stop,
    /// It moved off after a stop of this duration.
    Go {
        stood_s: f64,
    },
    /// It began to give way.
    Yield,
    /// It passed a yield line, whether or not it had given way.
    Merge,
    /// It collided with a vehicle: first overlap of the outlines.
    Collision {
        with: VehicleId,
    },
    /// It collided with a static obstacle: a wall, a building.
    CollisionStatic {
        with: String,
    },
    LinkLost,
    LinkBack,
    /// A physical vehicle is no longer measured.
    Unseen,
    /// It is measured again.
    SeenAgain,
    /// It reached the end of its route.
    Finish,
    Remove,
}

impl EventKind {
    pub fn is_collision(&self) -> bool {
        matches!(self, Self::Collision { .. } | Self::CollisionStatic { .. })
    }
}
