//! Cameras as objects of Python.

use crate::convert::bad_input;
use crate::pictures::USUAL_FOV_DEG;
use city3d_geometry::trig;
use city3d_protocol::snapshot::VehicleId;
use city3d_roadmap::CityMap;
use city3d_sensors::{Camera as SensorCamera, Extrinsics, Mount};
use glam::{DVec2, DVec3};
use pyo3::prelude::*;

/// Where a picture is taken from. Full-scale metres, x to the east, y to the north, z up.
#[pyclass(module = "city3d", frozen, from_py_object)]
#[derive(Clone, Debug)]
pub struct Camera {
    pub camera: SensorCamera,
}

impl Camera {
    /// Straight above a city, so high that a picture of this size shows all of it.
    pub fn above(city: &CityMap, [width, height]: [u32; 2]) -> Self {
        let [low, high] = city.bounds();
        let half = (high - low) / 2.0;
        let aspect = f64::from(width) / f64::from(height.max(1));
        let slope = trig::tan(USUAL_FOV_DEG.to_radians() / 2.0);
        let height_m = (half.y / slope).max(half.x / (slope * aspect));
        Self { camera: SensorCamera::Overhead { centre: (low + high) / 2.0, height_m } }
    }
}

#[pymethods]
impl Camera {
    /// Fixed to a vehicle: behind the windscreen or at the bumper.
    #[staticmethod]
    #[pyo3(signature = (vehicle, mount = "windscreen"))]
    fn onboard(vehicle: u32, mount: &str) -> PyResult<Self> {
        let mount = match mount {
            "windscreen" => Mount::Windscreen,
            "bumper" => Mount::Bumper,
            other => {
                return Err(bad_input(format!("no mount {other:?}: it is \"windscreen\" or \"bumper\"")));
            }
        };
        Ok(Self { camera: SensorCamera::onboard(VehicleId(vehicle), mount) })
    }

    /// Behind and above a vehicle, horizon level.
    #[staticmethod]
    #[pyo3(signature = (vehicle, distance_m = 9.0, height_m = 3.6))]
    fn chase(vehicle: u32, distance_m: f64, height_m: f64) -> Self {
        Self { camera: SensorCamera::Chase { vehicle: VehicleId(vehicle), distance_m, height_m } }
    }

    /// Straight down, north at the top.
    #[staticmethod]
    #[pyo3(signature = (x_m = 0.0, y_m = 0.0, height_m = 200.0))]
    fn overhead(x_m: f64, y_m: f64, height_m: f64) -> Self {
        Self { camera: SensorCamera::Overhead { centre: DVec2::new(x_m, y_m), height_m } }
    }

    /// At a point, looking at another one.
    #[staticmethod]
    fn looking_at(eye_m: [f64; 3], target_m: [f64; 3]) -> Self {
        let extrinsics = Extrinsics::looking_at(DVec3::from(eye_m), DVec3::from(target_m));
        Self { camera: SensorCamera::Fixed(extrinsics) }
    }

    fn __repr__(&self) -> String {
        format!("city3d.Camera({:?})", self.camera)
    }
}
