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
    /// What it measures, and how.
    pub kind: SensorKind,
}

/// The type of a sensor.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SensorKind {
    /// A camera, which takes pictures.
    Camera(CameraSensor),
}

/// A camera: mount (extrinsics), lens (intrinsics) and picture kinds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CameraSensor {
    /// Pose on the vehicle.
    pub mount: Mount,
    /// Field of view, clip planes and resolution.
    pub lens: Lens,
    /// Kinds of the pictures, which all show the same instant.
    pub kinds: PictureKinds,
}
