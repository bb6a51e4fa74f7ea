//! Sensor specifications of vehicles, as a scenario states them. Sensors read snapshots and are no part of the state.

use crate::{Lens, Mount, PictureKinds};
use serde::{Deserialize, Serialize};

/// A sensor on a vehicle.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Sensor {
    /// Unique on its vehicle; part of file names and topics.
    pub name: String,
    /// Measurements per second of simulated time.
    pub rate_hz: f64,
    pub kind: SensorKind,
}

/// The type of a sensor.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SensorKind {
    Camera(CameraSensor),
}

/// A camera: mount (extrinsics), lens (intrinsics) and picture kinds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CameraSensor {
    pub mount: Mount,
    pub lens: Lens,
    pub kinds: PictureKinds,
}
