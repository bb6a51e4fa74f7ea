//! Where the camera looks in the modes that go with a vehicle: turned and zoomed by the mouse, relative to the usual view.

#![allow(clippy::disallowed_methods, reason = "cameras draw; no state of a run depends on them")]

use city3d_protocol::snapshot::{Dimensions, VehicleState};
use city3d_sensors::{Extrinsics, Lens};
use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// The chase camera keeps so far away from the outline of its vehicle, metres.
const CLEAR_M: f64 = 2.5;
/// Usual place of the chase camera: behind the vehicle and above the ground, metres.
const CHASE_M: [f64; 2] = [9.0, 3.6];
/// The chase camera looks at a point so far ahead of the vehicle, metres, and at this share of its height.
const AHEAD_M: f64 = 3.0;
const OF_HEIGHT: f64 = 0.6;
/// Range of elevations of the chase camera.
const CHASE_RAD: [f64; 2] = [0.03, 1.45];
/// Range of the factor on the distance of the chase camera.
const CHASE_ZOOM: [f64; 2] = [0.45, 8.0];
/// Largest pitch of the onboard camera, and range of the factor on its field of view.
const ONBOARD_RAD: f64 = 1.2;
const ONBOARD_ZOOM: [f64; 2] = [0.15, 1.3];
/// Factor of a step of the mouse wheel.
const STEP: f64 = 0.88;

/// Rotation and zoom of a chase or onboard camera relative to its usual view.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Gaze {
    /// To the left of the usual view.
    yaw_rad: f64,
    /// Up from the usual view.
    pitch_rad: f64,
    /// Factor on the distance of a chase camera, or on the field of view of an onboard camera.
    zoom: f64,
}

impl Default for Gaze {
    fn default() -> Self {
        Self { yaw_rad: 0.0, pitch_rad: 0.0, zoom: 1.0 }
    }
}

impl Gaze {
    /// Turns a chase camera around its vehicle.
    pub fn turn_chase(&mut self, right_rad: f64, down_rad: f64) {
        let usual_rad = CHASE_M[1].atan2(CHASE_M[0]);
        self.turn_yaw(right_rad);
        let elevation_rad = usual_rad - self.pitch_rad + down_rad;
        self.pitch_rad = usual_rad - elevation_rad.clamp(CHASE_RAD[0], CHASE_RAD[1]);
    }

    /// Turns an onboard camera in its place.
    pub fn turn_onboard(&mut self, right_rad: f64, down_rad: f64) {
        self.turn_yaw(right_rad);
        self.pitch_rad = (self.pitch_rad - down_rad).clamp(-ONBOARD_RAD, ONBOARD_RAD);
    }

    fn turn_yaw(&mut self, right_rad: f64) {
        self.yaw_rad = (self.yaw_rad - right_rad + PI).rem_euclid(2.0 * PI) - PI;
    }

    /// Brings a chase camera nearer for positive steps of the mouse wheel.
    pub fn zoom_chase(&mut self, steps: f64) {
        self.zoom = (self.zoom * STEP.powf(steps)).clamp(CHASE_ZOOM[0], CHASE_ZOOM[1]);
    }

    /// Keeps a chase camera outside of its vehicle.
    pub fn keep_outside(&mut self, vehicle: &Dimensions) {
        self.zoom = self.zoom.max(least_zoom(vehicle));
    }

    /// Narrows the field of view of an onboard camera for positive steps of the mouse wheel.
    pub fn zoom_onboard(&mut self, steps: f64) {
        self.zoom = (self.zoom * STEP.powf(steps)).clamp(ONBOARD_ZOOM[0], ONBOARD_ZOOM[1]);
    }

    /// The same for a chase camera that is higher by an angle.
    pub fn raised(self, by_rad: f64) -> Self {
        let usual_rad = CHASE_M[1].atan2(CHASE_M[0]);
        let elevation_rad =
            (usual_rad - self.pitch_rad + by_rad).min(CHASE_RAD[1].max(usual_rad - self.pitch_rad));
        Self { pitch_rad: usual_rad - elevation_rad, ..self }
    }

    /// A chase camera around a vehicle, outside of its body.
    pub fn chase(self, vehicle: &VehicleState, dimensions: Option<&Dimensions>) -> Extrinsics {
        let heading = (vehicle.orientation * DVec3::X).with_z(0.0).normalize_or(DVec3::X);
        let ahead = DQuat::from_rotation_z(self.yaw_rad) * heading;
        let [behind_m, above_m] = CHASE_M;
        let usual_rad = above_m.atan2(behind_m);
        let (up, out) = (usual_rad - self.pitch_rad).sin_cos();
        let eye = (DVec3::Z * up - ahead * out)
            * (behind_m.hypot(above_m) * self.zoom.max(dimensions.map_or(0.0, least_zoom)));
        // From above it looks at the vehicle itself.
        let ahead_m = AHEAD_M * (out / usual_rad.cos()).powi(2);
        let target = ahead * ahead_m
            + DVec3::Z * (OF_HEIGHT * dimensions.map_or(0.0, |dimensions| dimensions.height_m));
        Extrinsics::looking_at(vehicle.position + eye, vehicle.position + target)
    }

    /// An onboard camera that is turned in its place.
    pub fn onboard(self, vehicle: &VehicleState, usual: Extrinsics) -> Extrinsics {
        let up = vehicle.orientation * DVec3::Z;
        let level = DQuat::from_axis_angle(up, self.yaw_rad) * usual.orientation;
        let tilt = DQuat::from_rotation_x(self.pitch_rad);
        Extrinsics { orientation: level * tilt, ..usual }
    }

    /// The lens of an onboard camera that is zoomed.
    pub fn lens(self, usual: Lens) -> Lens {
        let half = (usual.vertical_fov_rad / 2.0).tan() * self.zoom;
        Lens { vertical_fov_rad: 2.0 * half.atan(), ..usual }
    }
}

/// The factor on the distance at which a chase camera is just clear of its vehicle, from whichever side it looks.
fn least_zoom(vehicle: &Dimensions) -> f64 {
    let [behind_m, above_m] = CHASE_M;
    let reach_m = vehicle.length_m.hypot(vehicle.width_m) / 2.0;
    (reach_m + CLEAR_M) / behind_m.hypot(above_m)
}
