//! City3D: the digital twin of a 1:25 scaled smart city for connected and automated vehicles.
//!
//! `ARCHITECTURE.md` says which module does what and which may use which.

pub mod camera;
pub mod city;
pub mod geom;
#[cfg(feature = "render")]
pub mod render;
pub mod snapshot;
