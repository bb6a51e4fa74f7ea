//! The fixed cameras and times of the comparison.

use city3d_protocol::snapshot::VehicleId;
use city3d_render::Daylight;
use city3d_sensors::Camera;
use glam::DVec3;

/// A camera of the comparison.
#[derive(Clone, Copy, Debug)]
pub struct FixedCamera {
    /// Its name in files and tables.
    pub name: &'static str,
    /// Whether nobody may tune light or material by its pictures.
    pub is_held_out: bool,
    /// Angle between the upper and the lower edge of the picture, degrees.
    pub vertical_fov_deg: f64,
    /// Where it is at the first instant of the scenario.
    pub camera: Camera,
}

/// Times of day, by the names of tables: those of which the sun is above the horizon, because the sky of Mitsuba has
/// no dusk.
pub const TIMES: [(&str, Daylight); 3] =
    [("noon", Daylight::NOON), ("morning", Daylight { hours: 7.0 }), ("low_sun", Daylight::LOW_SUN)];

/// The cameras; the last two are not used for tuning.
pub const CAMERAS: [FixedCamera; 5] = [
    FixedCamera { name: "street", is_held_out: false, vertical_fov_deg: 50.0, camera: chase(20) },
    FixedCamera {
        name: "roundabout",
        is_held_out: false,
        vertical_fov_deg: 42.0,
        camera: orbit([-60.5, -39.0], 20.0, 332.0, 20.0),
    },
    FixedCamera {
        name: "above",
        is_held_out: false,
        vertical_fov_deg: 50.0,
        camera: orbit([0.0, 0.0], 130.0, 235.0, 35.0),
    },
    FixedCamera { name: "avenue", is_held_out: true, vertical_fov_deg: 50.0, camera: chase(12) },
    FixedCamera {
        name: "square",
        is_held_out: true,
        vertical_fov_deg: 50.0,
        camera: orbit([20.0, 20.0], 45.0, 60.0, 15.0),
    },
];

/// A chase camera at the usual distance.
const fn chase(vehicle: u32) -> Camera {
    Camera::Chase { vehicle: VehicleId(vehicle), distance_m: 9.0, height_m: 3.6 }
}

/// A camera that looks at a point of the ground. Angles in degrees.
const fn orbit([x, y]: [f64; 2], distance_m: f64, azimuth_deg: f64, elevation_deg: f64) -> Camera {
    Camera::Orbit {
        target: DVec3::new(x, y, 0.0),
        distance_m,
        azimuth_rad: azimuth_deg.to_radians(),
        elevation_rad: elevation_deg.to_radians(),
    }
}
