//! Where pictures are taken from: mounts on vehicles, chase, orbit and overhead cameras, and the
//! projection of each. Nothing of the GPU here: the same numbers go into pictures, panels and logs.
//!
//! Camera frame as in OpenCV: x right, y down, z forward; a pixel's integer coordinates are its
//! middle, so that the image spans -0.5 to `width - 0.5`.

#![allow(clippy::disallowed_methods, reason = "cameras draw; no state of a run depends on them")]

mod kind;
mod mount;
mod projection;

pub use kind::{Kinds, PictureKind};
pub use mount::{Camera, CameraError, Mount, Place};
pub use projection::{Extrinsics, Intrinsics, Lens, Projection, View};
