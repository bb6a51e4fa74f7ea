//! The adapter that tests of pictures draw with, and what stands in front of their cameras.

use city3d_geometry::trig;
use city3d_protocol::snapshot::{
    Appearance, BodyType, Dimensions, FrameSnapshot, VehicleId, VehicleInfo, VehicleState,
};
use city3d_render::{AdapterPreference, Context};
use glam::{DQuat, DVec2};
use std::sync::Arc;

/// The software adapter; without one a test is skipped loudly, and fails in CI.
pub fn software() -> Option<Context> {
    match Context::headless(&AdapterPreference::Software) {
        Ok(context) => Some(context),
        Err(error) => {
            assert!(std::env::var_os("CI").is_none(), "pictures cannot be tested: {error}");
            eprintln!("SKIPPED: {error}");
            None
        }
    }
}

pub const DIMENSIONS: Dimensions = Dimensions {
    length_m: 5.0,
    width_m: 2.5,
    height_m: 1.5,
    wheelbase_m: 3.0,
    track_m: 2.1,
    wheel_radius_m: 0.35,
};

/// A sedan of [`DIMENSIONS`] and of a colour in sRGB.
pub fn car(id: u32, at: DVec2, yaw_rad: f64, colour: [u8; 3]) -> (VehicleState, VehicleInfo) {
    let state = VehicleState {
        id: VehicleId(id),
        position: at.extend(0.0),
        orientation: DQuat::from_xyzw(0.0, 0.0, trig::sin(yaw_rad / 2.0), trig::cos(yaw_rad / 2.0)),
        ..VehicleState::default()
    };
    let info = VehicleInfo {
        id: VehicleId(id),
        name: format!("cav{id}"),
        dimensions: DIMENSIONS,
        appearance: Appearance { body: BodyType::Sedan, colour },
        model: "test".into(),
    };
    (state, info)
}

pub fn snapshot(cars: Vec<(VehicleState, VehicleInfo)>) -> FrameSnapshot {
    let (vehicles, roster): (Vec<_>, Vec<_>) = cars.into_iter().unzip();
    FrameSnapshot { vehicles, roster: Arc::new(roster), ..FrameSnapshot::default() }
}
