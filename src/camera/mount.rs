//! Cameras that follow the snapshot: each gives a [`View`] of one instant.

use super::{Extrinsics, Lens, View};
use crate::snapshot::{FrameSnapshot, VehicleId, VehicleInfo, VehicleState};
use glam::{DMat3, DQuat, DVec2, DVec3};
use serde::{Deserialize, Serialize};

/// Where a camera sits on a vehicle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Mount {
    /// Behind the mirror, looking slightly down over the bonnet.
    #[default]
    Windscreen,
    /// In the middle of the front bumper.
    Bumper,
    /// Anywhere: a point of the body frame (x forward, y left, z up, origin on the ground under the
    /// middle of the outline), and angles: yaw to the left, pitch upwards.
    Custom { position: DVec3, yaw_rad: f64, pitch_rad: f64 },
}

/// A camera that can give a view of every snapshot.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Camera {
    /// Carried by a vehicle, with its roll and pitch.
    Onboard { vehicle: VehicleId, mount: Mount },
    /// Behind and above a vehicle, horizon level.
    Chase { vehicle: VehicleId, distance_m: f64, height_m: f64 },
    /// Around a point. Azimuth is where the camera stands seen from the target, counter-clockwise
    /// from east.
    Orbit { target: DVec3, distance_m: f64, azimuth_rad: f64, elevation_rad: f64 },
    /// Straight down, north at the top.
    Overhead { centre: DVec2, height_m: f64 },
    /// Stands where it is.
    Fixed(Extrinsics),
}

/// Why a camera has no view of a snapshot.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CameraError {
    #[error("no vehicle {wanted} carries a camera at tick {tick}: the vehicles there are {present}")]
    NoVehicle { wanted: VehicleId, tick: u64, present: String },
}

impl Mount {
    fn in_body(self, info: &VehicleInfo) -> (DVec3, f64, f64) {
        let d = &info.dimensions;
        // A van's driver sits higher than a sedan's.
        let height_m = d.height_m * info.appearance.body.height_factor();
        match self {
            Self::Windscreen => (DVec3::new(0.14 * d.length_m, 0.0, 0.91 * height_m), 0.0, -0.06),
            Self::Bumper => (DVec3::new(0.5 * d.length_m + 0.03, 0.0, 0.55), 0.0, 0.0),
            Self::Custom { position, yaw_rad, pitch_rad } => (position, yaw_rad, pitch_rad),
        }
    }
}

/// Body axes (forward, left, up) from camera axes (right, down, forward), turned by yaw and pitch.
fn body_from_camera(yaw_rad: f64, pitch_rad: f64) -> DQuat {
    let looking_ahead = DQuat::from_mat3(&DMat3::from_cols(-DVec3::Y, -DVec3::Z, DVec3::X));
    DQuat::from_axis_angle(DVec3::Z, yaw_rad) * DQuat::from_axis_angle(DVec3::Y, -pitch_rad) * looking_ahead
}

impl Camera {
    /// A chase camera at the usual distance.
    pub fn chase(vehicle: VehicleId) -> Self {
        Self::Chase { vehicle, distance_m: 9.0, height_m: 3.6 }
    }

    pub fn onboard(vehicle: VehicleId, mount: Mount) -> Self {
        Self::Onboard { vehicle, mount }
    }

    /// What this camera sees at the instant of a snapshot.
    ///
    /// # Errors
    /// [`CameraError::NoVehicle`] where the vehicle that carries it is not in the snapshot.
    pub fn view(&self, snapshot: &FrameSnapshot, lens: &Lens) -> Result<View, CameraError> {
        let extrinsics = match *self {
            Self::Onboard { vehicle, mount } => {
                let (state, info) = carrier(snapshot, vehicle)?;
                let (position, yaw_rad, pitch_rad) = mount.in_body(info);
                let extrinsics = Extrinsics {
                    position: state.position + state.orientation * position,
                    orientation: state.orientation * body_from_camera(yaw_rad, pitch_rad),
                };
                return Ok(View { carrier: Some(vehicle), ..View::new(extrinsics, lens) });
            }
            Self::Chase { vehicle, distance_m, height_m } => {
                let (state, info) = carrier(snapshot, vehicle)?;
                let ahead = (state.orientation * DVec3::X).with_z(0.0).normalize_or(DVec3::X);
                let from = state.position - ahead * distance_m + DVec3::Z * height_m;
                let target = state.position + ahead * 3.0 + DVec3::Z * (0.6 * info.dimensions.height_m);
                Extrinsics::looking_at(from, target)
            }
            Self::Orbit { target, distance_m, azimuth_rad, elevation_rad } => {
                let (sin, cos) = azimuth_rad.sin_cos();
                let (up, out) = elevation_rad.sin_cos();
                let from = target + DVec3::new(cos * out, sin * out, up) * distance_m;
                Extrinsics::looking_at(from, target)
            }
            Self::Overhead { centre, height_m } => {
                Extrinsics::looking_at(centre.extend(height_m), centre.extend(0.0))
            }
            Self::Fixed(extrinsics) => extrinsics,
        };
        Ok(View::new(extrinsics, lens))
    }
}

fn carrier(
    snapshot: &FrameSnapshot,
    wanted: VehicleId,
) -> Result<(&VehicleState, &VehicleInfo), CameraError> {
    snapshot.vehicle(wanted).zip(snapshot.info(wanted)).ok_or_else(|| {
        let ids: Vec<_> = snapshot.vehicles.iter().map(|v| v.id.to_string()).collect();
        let present = if ids.is_empty() { "none".to_owned() } else { ids.join(", ") };
        CameraError::NoVehicle { wanted, tick: snapshot.tick, present }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::snapshot::{Appearance, Dimensions};
    use std::sync::Arc;

    fn snapshot(yaw_rad: f64) -> FrameSnapshot {
        let dimensions = Dimensions {
            length_m: 5.0,
            width_m: 2.5,
            height_m: 1.6,
            wheelbase_m: 3.0,
            track_m: 2.1,
            wheel_radius_m: 0.35,
        };
        let info = VehicleInfo {
            id: VehicleId(7),
            name: "cav7".into(),
            dimensions,
            appearance: Appearance::default(),
            model: String::new(),
        };
        let state = VehicleState {
            id: VehicleId(7),
            position: DVec3::new(10.0, 20.0, 0.0),
            orientation: DQuat::from_axis_angle(DVec3::Z, yaw_rad),
            ..VehicleState::default()
        };
        FrameSnapshot { vehicles: vec![state], roster: Arc::new(vec![info]), ..FrameSnapshot::default() }
    }

    #[test]
    fn onboard_cameras_look_where_the_vehicle_does() {
        let snapshot = snapshot(1.2);
        let ahead = DVec3::new(1.2_f64.cos(), 1.2_f64.sin(), 0.0);
        let at = DVec3::new(10.0, 20.0, 0.55) + ahead * 50.0;
        let view = Camera::onboard(VehicleId(7), Mount::Bumper).view(&snapshot, &Lens::default()).unwrap();
        assert!(view.project(at).unwrap().distance(DVec2::new(319.5, 239.5)) < 1e-6);
        // What is to the left of the vehicle is to the left of the middle of the picture.
        let left = ahead.cross(DVec3::Z) * -5.0;
        assert!(view.project(at + left).unwrap().x < 300.0);
        assert_eq!(view.carrier, Some(VehicleId(7)));
    }

    #[test]
    fn chase_sees_its_vehicle_and_orbit_its_target() {
        let snapshot = snapshot(-2.0);
        let lens = Lens::default();
        let chase = Camera::chase(VehicleId(7)).view(&snapshot, &lens).unwrap();
        let pixel = chase.project(DVec3::new(10.0, 20.0, 0.8)).unwrap();
        assert!((pixel.x - 319.5).abs() < 1e-6 && (240.0..400.0).contains(&pixel.y), "{pixel}");
        let target = DVec3::new(3.0, 4.0, 1.0);
        let orbit = Camera::Orbit { target, distance_m: 30.0, azimuth_rad: 2.0, elevation_rad: 0.5 };
        let view = orbit.view(&snapshot, &lens).unwrap();
        assert!(view.project(target).unwrap().distance(DVec2::new(319.5, 239.5)) < 1e-6);
        assert!((view.extrinsics.position.distance(target) - 30.0).abs() < 1e-9);
    }

    #[test]
    fn a_missing_vehicle_is_named_with_those_present() {
        let error = Camera::chase(VehicleId(3)).view(&snapshot(0.0), &Lens::default()).unwrap_err();
        assert!(
            error.to_string().contains("no vehicle 3") && error.to_string().ends_with("are 7"),
            "{error}"
        );
    }
}
