//! Camera extrinsics from a snapshot: each camera gives a [`View`] of one instant.

use super::{Extrinsics, Lens, View};
use city3d_protocol::snapshot::{FrameSnapshot, VehicleId, VehicleInfo, VehicleState};
use glam::{DMat3, DQuat, DVec2, DVec3};
use serde::{Deserialize, Serialize};

/// Pose of a camera on a vehicle (extrinsics in the body frame).
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Mount {
    /// Behind the mirror, looking slightly down over the bonnet.
    #[default]
    Windscreen,
    /// In the middle of the front bumper.
    Bumper,
    /// Any mount point and direction. Angles turn the camera from straight ahead: yaw to the left, then pitch
    /// upwards, then roll with the right side down.
    Custom {
        /// Where the centre of the camera is on the vehicle.
        place: MountPoint,
        /// Turn to the left from straight ahead, about the vertical axis of the body, radians.
        yaw_rad: f64,
        /// Turn upwards after the yaw, about the camera's own horizontal axis, radians.
        pitch_rad: f64,
        /// Turn about the direction of view after yaw and pitch, right side down, radians.
        roll_rad: f64,
    },
}

/// Position of a camera on a vehicle.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MountPoint {
    /// Behind the mirror, as far ahead and as high as the vehicle's body, length and height imply.
    Windscreen,
    /// In the middle of the front bumper.
    Bumper,
    /// In the body frame, city metres: x forward, y left, z up, origin on the ground under the middle
    /// of the outline.
    Point(DVec3),
}

impl MountPoint {
    fn in_body(self, info: &VehicleInfo) -> DVec3 {
        let (d, body) = (&info.dimensions, info.appearance.body);
        match self {
            Self::Windscreen => {
                // A van's driver sits higher than a sedan's.
                let [ahead, up] = body.windscreen_shares();
                DVec3::new(ahead * d.length_m, 0.0, up * body.height_m(d))
            }
            Self::Bumper => DVec3::new(0.5 * d.length_m + 0.03, 0.0, 0.55),
            Self::Point(point) => point,
        }
    }

    /// Default pitch of a camera at this point.
    pub fn usual_pitch_rad(self) -> f64 {
        match self {
            Self::Windscreen => -0.06,
            Self::Bumper | Self::Point(_) => 0.0,
        }
    }
}

/// A camera that can give a view of every snapshot.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Camera {
    /// Fixed to a vehicle, with its roll and pitch.
    Onboard {
        /// The vehicle that carries the camera.
        vehicle: VehicleId,
        /// Where it is fixed to the vehicle, and which way it looks.
        mount: Mount,
    },
    /// Behind and above a vehicle, horizon level.
    Chase {
        /// The vehicle that the camera follows.
        vehicle: VehicleId,
        /// Horizontal distance behind the vehicle's position, against its heading, city metres.
        distance_m: f64,
        /// Height above the vehicle's position, city metres.
        height_m: f64,
    },
    /// Orbits a point. The azimuth is the direction from the target to the camera, counter-clockwise from east.
    Orbit {
        /// The point in the middle of the picture, city metres.
        target: DVec3,
        /// Straight distance from the target to the camera, city metres.
        distance_m: f64,
        /// Horizontal direction from the target to the camera, counter-clockwise from east, radians.
        azimuth_rad: f64,
        /// Angle of the camera above the horizontal plane through the target, radians.
        elevation_rad: f64,
    },
    /// Looks straight down, north at the top.
    Overhead {
        /// The point straight below the camera, city metres (x east, y north).
        centre: DVec2,
        /// Height of the camera above z = 0 of the city, city metres.
        height_m: f64,
    },
    /// Fixed in the city.
    Fixed(Extrinsics),
}

/// Why a camera has no view of a snapshot.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CameraError {
    /// The carrying vehicle `wanted` is not in the snapshot of `tick`; `present` lists those that are.
    #[error("no vehicle {wanted} carries a camera at tick {tick}: the vehicles there are {present}")]
    NoVehicle {
        /// The vehicle that should carry the camera.
        wanted: VehicleId,
        /// Simulation tick of the snapshot.
        tick: u64,
        /// Ids of the vehicles in the snapshot, separated by commas; "none" where it has none.
        present: String,
    },
}

impl Mount {
    /// `body_from_camera` as position and rotation.
    fn in_body(self, info: &VehicleInfo) -> (DVec3, DQuat) {
        let (place, [yaw_rad, pitch_rad, roll_rad]) = match self {
            Self::Windscreen => {
                (MountPoint::Windscreen, [0.0, MountPoint::Windscreen.usual_pitch_rad(), 0.0])
            }
            Self::Bumper => (MountPoint::Bumper, [0.0, MountPoint::Bumper.usual_pitch_rad(), 0.0]),
            Self::Custom { place, yaw_rad, pitch_rad, roll_rad } => (place, [yaw_rad, pitch_rad, roll_rad]),
        };
        (place.in_body(info), body_from_camera(yaw_rad, pitch_rad, roll_rad))
    }
}

/// Body axes (forward, left, up) from camera axes (right, down, forward), turned by the angles of a mount.
fn body_from_camera(yaw_rad: f64, pitch_rad: f64, roll_rad: f64) -> DQuat {
    let looking_ahead = DQuat::from_mat3(&DMat3::from_cols(-DVec3::Y, -DVec3::Z, DVec3::X));
    DQuat::from_axis_angle(DVec3::Z, yaw_rad)
        * DQuat::from_axis_angle(DVec3::Y, -pitch_rad)
        * DQuat::from_axis_angle(DVec3::X, roll_rad)
        * looking_ahead
}

impl Camera {
    /// A chase camera at the usual distance.
    pub fn chase(vehicle: VehicleId) -> Self {
        Self::Chase { vehicle, distance_m: 9.0, height_m: 3.6 }
    }

    /// A camera fixed to a vehicle.
    pub fn onboard(vehicle: VehicleId, mount: Mount) -> Self {
        Self::Onboard { vehicle, mount }
    }

    /// The view of this camera at the instant of a snapshot.
    ///
    /// # Errors
    /// [`CameraError::NoVehicle`] where the vehicle that carries it is not in the snapshot.
    pub fn view(&self, snapshot: &FrameSnapshot, lens: &Lens) -> Result<View, CameraError> {
        let extrinsics = match *self {
            Self::Onboard { vehicle, mount } => {
                let (state, info) = carrier(snapshot, vehicle)?;
                let (position, body_from_camera) = mount.in_body(info);
                let extrinsics = Extrinsics {
                    position: state.position + state.orientation * position,
                    orientation: state.orientation * body_from_camera,
                };
                let extrinsics = outside_of_others(snapshot, (state, extrinsics));
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

/// Room between a camera and the body of another vehicle, city metres.
const CLEARANCE_M: f64 = 0.15;

/// The pose of an onboard camera, drawn back along its vehicle out of the bodies of others, which it is in after a crash:
/// from inside, a body would be an empty shell.
fn outside_of_others(
    snapshot: &FrameSnapshot,
    (own, mut extrinsics): (&VehicleState, Extrinsics),
) -> Extrinsics {
    let back = -own.forward().extend(0.0);
    for (other, info) in snapshot.iter().filter(|(other, _)| other.id != own.id) {
        let d = &info.dimensions;
        let reach_m = d.length_m + CLEARANCE_M;
        if other.position.distance_squared(extrinsics.position) > reach_m * reach_m {
            continue;
        }
        let into_body = other.orientation.inverse();
        let eye = into_body * (extrinsics.position - other.position);
        let height_m = info.appearance.body.height_m(d);
        let half = DVec2::new(d.length_m, d.width_m) / 2.0 + CLEARANCE_M;
        if eye.x.abs() < half.x && eye.y.abs() < half.y && (0.0..height_m).contains(&eye.z) {
            // To the nearer of the faces that lie on the way back (slab test).
            let way = into_body * back;
            let to_face = |at: f64, half: f64, way: f64| {
                if way.abs() < 1e-6 { f64::INFINITY } else { (half * way.signum() - at) / way }
            };
            let out_m = to_face(eye.x, half.x, way.x).min(to_face(eye.y, half.y, way.y));
            extrinsics.position += back * out_m;
        }
    }
    extrinsics
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
    use city3d_protocol::snapshot::{Appearance, Dimensions};
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
    fn after_a_crash_a_camera_is_not_inside_of_the_other_body() {
        let mut seen = snapshot(0.0);
        let free = Camera::onboard(VehicleId(7), Mount::Bumper).view(&seen, &Lens::default()).unwrap();
        let eye = free.extrinsics.position;
        // The other one stands across, and its side lies behind the camera.
        let other = VehicleState {
            id: VehicleId(8),
            position: eye.with_z(0.0) + DVec3::X * 1.0,
            orientation: DQuat::from_axis_angle(DVec3::Z, std::f64::consts::FRAC_PI_2),
            ..VehicleState::default()
        };
        seen.vehicles.push(other);
        let info = VehicleInfo { id: VehicleId(8), ..seen.roster[0].clone() };
        Arc::make_mut(&mut seen.roster).push(info);
        let view = Camera::onboard(VehicleId(7), Mount::Bumper).view(&seen, &Lens::default()).unwrap();
        let into_side_m = eye.x + 1.0 - 1.25 - view.extrinsics.position.x;
        assert!((into_side_m - CLEARANCE_M).abs() < 1e-9, "{into_side_m} m before its side");
        assert_eq!(view.extrinsics.orientation, free.extrinsics.orientation);
        // One that only stands near changes nothing.
        seen.vehicles[1].position.x += 1.0;
        let view = Camera::onboard(VehicleId(7), Mount::Bumper).view(&seen, &Lens::default()).unwrap();
        assert_eq!(view.extrinsics, free.extrinsics);
    }

    #[test]
    fn angles_of_a_mount_turn_it_to_the_left_upwards_and_to_the_right() {
        let snapshot = snapshot(0.0);
        let eye = DVec3::new(1.0, 0.5, 1.2);
        let look = |[yaw_deg, pitch_deg, roll_deg]: [f64; 3]| {
            let [yaw_rad, pitch_rad, roll_rad] = [yaw_deg, pitch_deg, roll_deg].map(f64::to_radians);
            let mount = Mount::Custom { place: MountPoint::Point(eye), yaw_rad, pitch_rad, roll_rad };
            let view = Camera::onboard(VehicleId(7), mount).view(&snapshot, &Lens::default()).unwrap();
            assert!(view.extrinsics.position.distance(DVec3::new(11.0, 20.5, 1.2)) < 1e-9);
            let axes = view.extrinsics.orientation;
            [axes * DVec3::X, axes * DVec3::Y, axes * DVec3::Z]
        };
        let is = |a: [DVec3; 3], b: [DVec3; 3]| {
            assert!(a.iter().zip(&b).all(|(a, b)| a.distance(*b) < 1e-9), "{a:?} {b:?}");
        };
        // Where right, down and forward of the camera point to.
        is(look([90.0, 0.0, 0.0]), [DVec3::X, -DVec3::Z, DVec3::Y]);
        is(look([0.0, 90.0, 0.0]), [-DVec3::Y, DVec3::X, DVec3::Z]);
        is(look([0.0, 0.0, 90.0]), [-DVec3::Z, DVec3::Y, DVec3::X]);
        // Pitch is about the camera's own axis after yaw, roll about the one along which it looks then.
        let (sin, cos) = 30_f64.to_radians().sin_cos();
        let ahead = DVec3::new(0.0, cos, sin);
        is(look([90.0, 30.0, 0.0]), [DVec3::X, DVec3::new(0.0, sin, -cos), ahead]);
        is(look([90.0, 30.0, 90.0]), [DVec3::new(0.0, sin, -cos), -DVec3::X, ahead]);
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
