//! Camera models: extrinsics (mounts on vehicles, chase, orbit and overhead cameras), and pinhole intrinsics with
//! perspective or orthographic projection; the weather that they see. No GPU code: pictures, panels and logs use the same
//! numbers.
//!
//! Camera frame as in OpenCV: x right, y down, z forward; a pixel's integer coordinates are its
//! middle, so that the image spans -0.5 to `width - 0.5`.

#![allow(clippy::disallowed_methods, reason = "cameras draw; no state of a run depends on them")]

mod bounding_box;
mod kind;
mod mount;
mod projection;
mod sensor;
mod weather;

pub use bounding_box::{BoundingBox, PixelRect};
pub use kind::{PictureKind, PictureKinds};
pub use mount::{Camera, CameraError, Mount, MountPoint};
pub use projection::{Extrinsics, Intrinsics, Lens, Projection, View};
pub use sensor::{CameraSensor, Sensor, SensorKind};
pub use weather::Weather;
