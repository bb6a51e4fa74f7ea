//! What vehicles carry to sense the city with: plain data that a scenario states. Nothing of it is
//! part of the world's state, for sensors look at snapshots and change nothing.

use crate::camera::{Kinds, Lens, Mount};
use serde::{Deserialize, Serialize};

/// A sensor of a vehicle.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Sensor {
    /// Different for each sensor of a vehicle; part of file names and topics.
    pub name: String,
    /// Measurements per second of simulated time.
    pub rate_hz: f64,
    pub kind: SensorKind,
}

/// What a sensor measures, and how.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SensorKind {
    Camera(CameraSensor),
}

/// A camera: where it sits, what it sees of the city, and which pictures it takes of each instant.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CameraSensor {
    pub mount: Mount,
    pub lens: Lens,
    pub kinds: Kinds,
}
