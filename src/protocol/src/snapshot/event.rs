//! Events of a run, for summaries and figures.

use super::VehicleId;
use serde::{Deserialize, Serialize};

/// An event of a vehicle.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Event {
    /// Simulated time.
    #[serde(rename = "t")]
    pub time_s: f64,
    /// The vehicle of the event; of two that collide, the one with the smaller id.
    pub vehicle: VehicleId,
    /// What happened to it.
    #[serde(flatten)]
    pub kind: EventKind,
}

/// Kind of an event, from the view of its vehicle.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum EventKind {
    /// It was added to the city.
    Spawn,
    /// Its start overlapped another vehicle; it was moved back along the lane.
    Moved {
        /// The vehicle that it overlapped first.
        behind: VehicleId,
        /// Distance back along the lane, city metres.
        by_m: f64,
    },
    /// It stopped.
    Stop,
    /// It moved off after a stop of this duration.
    Go {
        /// Simulated seconds from the stop until it exceeded the speed of moving off.
        stood_s: f64,
    },
    /// It began to give way.
    Yield,
    /// It passed a yield line, whether or not it had given way.
    Merge,
    /// It collided with a vehicle: first overlap of the outlines.
    Collision {
        /// The other vehicle, which gets no event of its own.
        with: VehicleId,
    },
    /// It collided with a static obstacle: a wall, a building.
    CollisionStatic {
        /// Name of the obstacle on the map, or its kind if it has none.
        with: String,
    },
    /// It got no trajectory for longer than the link timeout.
    LinkLost,
    /// It gets trajectories again.
    LinkBack,
    /// A physical vehicle is no longer measured.
    Unseen,
    /// It is measured again.
    SeenAgain,
    /// It reached the end of its route.
    Finish,
    /// It was taken out of the city.
    Remove,
}

impl EventKind {
    /// Whether it is a collision, with a vehicle or with a static obstacle.
    pub fn is_collision(&self) -> bool {
        matches!(self, Self::Collision { .. } | Self::CollisionStatic { .. })
    }
}
