//! City3D: the digital twin of a 1:25 scaled smart city for connected and automated vehicles.
//!
//! *The paper*, in all modules: *A Digital Smart City for Emerging Mobility Systems* (Zayas, Beaver, Chalaki, Bang,
//! Malikopoulos).
//!
//! `ARCHITECTURE.md` describes the modules; `tests/architecture/modules.md` states which may use which.

pub mod app;
pub mod camera;
pub mod city;
pub mod cockpit;
pub mod digest;
pub mod environment;
pub mod estimation;
pub mod figures;
pub mod geom;
pub mod link;
pub mod live;
pub mod mainframe;
pub mod model;
pub mod physics;
pub mod playback;
pub mod record;
#[cfg(feature = "render")]
pub mod render;
pub mod replay;
#[cfg(feature = "ros")]
pub mod ros;
pub mod runner;
pub mod scenario;
pub mod sensor;
pub mod sim;
pub mod snapshot;
pub mod testbed;
#[cfg(feature = "window")]
pub mod ui;
pub mod vehicle;
pub mod wire;
