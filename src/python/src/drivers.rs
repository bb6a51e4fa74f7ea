//! Classes of Python as drivers.

use crate::commanded::CommandedAccelerations;
use crate::trouble::Trouble;
use city3d_control::{Controller, DriverParams, Drivers, LeaderState, OwnMotion, controller};
use city3d_protocol::snapshot::VehicleId;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::collections::BTreeMap;
use std::sync::Arc;

/// What drives a vehicle for which a class makes no object.
const USUAL: &str = "idm";

/// Drivers of one world by name; each makes an object for every vehicle that it drives, or `None` to leave it to [`USUAL`].
#[derive(Clone, Debug)]
pub struct PythonDrivers {
    by_name: BTreeMap<String, Arc<Py<PyAny>>>,
    trouble: Trouble,
}

impl PythonDrivers {
    pub fn new(by_name: BTreeMap<String, Py<PyAny>>) -> Self {
        let by_name = by_name.into_iter().map(|(name, make)| (name, Arc::new(make))).collect();
        Self { by_name, trouble: Trouble::default() }
    }

    /// These drivers beside others; they obey ordered accelerations.
    pub fn beside(&self, others: Drivers, commanded: &CommandedAccelerations) -> Drivers {
        self.by_name.iter().fold(others, |drivers, (name, make)| {
            let (make, trouble, commanded) = (Arc::clone(make), self.trouble.clone(), commanded.clone());
            drivers.with_each(name, move |vehicle, params| {
                let made = Python::attach(|py| make.call1(py, (vehicle.0, parameters(py, &params)?)));
                let object = made.map_err(|error| trouble.keep(error)).ok();
                let is_none = |object: &Py<PyAny>| Python::attach(|py| object.is_none(py));
                let usual =
                    object.as_ref().filter(|object| is_none(object)).and_then(|_| controller(USUAL, params));
                let own = usual.unwrap_or_else(|| {
                    Box::new(PythonDriver { vehicle, params, object, trouble: trouble.clone() })
                });
                commanded.obeying(own, (vehicle, params))
            })
        })
    }

    /// Raises what a driver has raised since the last call.
    ///
    /// # Errors
    /// That exception.
    pub fn raise(&self) -> PyResult<()> {
        self.trouble.raise()
    }
}

/// Parameters of a `[driver.NAME]`, laboratory metres.
fn parameters<'py>(py: Python<'py>, params: &DriverParams) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    for (name, value) in [
        ("desired_speed_mps", params.desired_speed_mps),
        ("max_acceleration_mps2", params.max_acceleration_mps2),
        ("min_acceleration_mps2", params.min_acceleration_mps2),
        ("headway_s", params.headway_s),
        ("standstill_gap_m", params.standstill_gap_m),
        ("response_time_s", params.response_time_s),
    ] {
        dict.set_item(name, value)?;
    }
    Ok(dict)
}

/// An object with a method `acceleration(speed_mps, desired_mps, gap_m, leader_mps)`. After an exception, and for NaN and
/// infinite answers, its vehicle brakes.
#[derive(Debug)]
struct PythonDriver {
    vehicle: VehicleId,
    params: DriverParams,
    object: Option<Py<PyAny>>,
    trouble: Trouble,
}

impl Controller for PythonDriver {
    fn acceleration(&self, own: OwnMotion, desired_mps: f64, ahead: Option<LeaderState>) -> f64 {
        let least = self.params.min_acceleration_mps2;
        let Some(object) = &self.object else { return least };
        let (gap_m, leader_mps) = (ahead.map(|leader| leader.gap_m), ahead.map(|leader| leader.speed_mps));
        let answer = Python::attach(|py| {
            let answer = object.call_method1(
                py,
                "acceleration",
                (own.measured_mps, desired_mps, gap_m, leader_mps),
            )?;
            answer.extract::<f64>(py)
        });
        match answer {
            Ok(mps2) if mps2.is_finite() => mps2.clamp(least, self.params.max_acceleration_mps2),
            Ok(mps2) => {
                let message = format!("the driver of vehicle {} answers {mps2} m/s2", self.vehicle);
                self.trouble.keep(pyo3::exceptions::PyValueError::new_err(message));
                least
            }
            Err(error) => {
                self.trouble.keep(error);
                least
            }
        }
    }
}
