//! A simulated city: its vehicles, its clock and its control framework.

use crate::cameras::Camera;
use crate::convert::{bad_input, object, scenario_value};
use crate::drivers::PythonDrivers;
use crate::pictures::{self, PictureForm};
use crate::states;
use city3d_protocol::snapshot::{Event, Indicator, ModelKind, Pedals, SimCommand, VehicleId};
use city3d_render::Renderer;
use city3d_simulation::environment::EnvironmentProfile;
use city3d_simulation::runner::Run;
use city3d_simulation::scenario::{Library, Overrides, ScenarioChange, ScenarioRequest, shipped_scenarios};
use numpy::{PyArray1, PyArray2, PyArrayMethods as _, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, TryLockError};

/// Names of the shipped scenarios.
pub fn scenarios() -> Vec<String> {
    shipped_scenarios().map(str::to_owned).collect()
}

/// A city that is simulated in this process, with its control framework.
///
/// The vehicles are those of the scenario, driven by the algorithms that it names, unless they are driven by pedals
/// (`drive`, `act`). Two worlds of one scenario and seed that get the same orders at the same steps are equal to the bit,
/// and equal to a run of the program.
#[pyclass(module = "city3d", frozen)]
pub struct World {
    city: Mutex<City>,
}

/// What a world was at an instant; it belongs to worlds of the same scenario and seed.
#[pyclass(module = "city3d", frozen)]
#[derive(Debug)]
pub struct SavedWorld {
    request: ScenarioRequest,
    tick: u64,
    state_hash: u64,
    orders: Vec<(u64, SimCommand)>,
}

struct City {
    request: ScenarioRequest,
    drivers: PythonDrivers,
    run: Run,
    /// What was ordered from outside, with the tick before which it was.
    orders: Vec<(u64, SimCommand)>,
    events: Vec<Event>,
    quality: String,
    renderer: Option<Renderer>,
}

impl City {
    fn new(request: ScenarioRequest, drivers: PythonDrivers, quality: String) -> PyResult<Self> {
        let run = start(&request, &drivers)?;
        Ok(Self { request, drivers, run, orders: Vec::new(), events: Vec::new(), quality, renderer: None })
    }

    /// Back to the start, with another seed perhaps.
    fn reset(&mut self, seed: Option<u64>) -> PyResult<()> {
        match seed.filter(|seed| *seed != self.run.experiment().seed) {
            Some(seed) => {
                let overrides = Overrides { seed: Some(seed), ..self.request.overrides };
                let request = ScenarioRequest { overrides, ..self.request.clone() };
                self.run = start(&request, &self.drivers)?;
                self.request = request;
            }
            None => {
                self.run.reset().map_err(bad_input)?;
                self.drivers.raise()?;
            }
        }
        self.orders.clear();
        self.events.clear();
        Ok(())
    }

    /// Simulates a time span, seconds.
    fn simulate(&mut self, seconds: f64) -> PyResult<()> {
        for _ in 0..self.ticks(seconds)? {
            let snapshot = self.run.step();
            self.events.extend_from_slice(&snapshot.events);
            self.drivers.raise()?;
        }
        Ok(())
    }

    fn order(&mut self, command: SimCommand) -> PyResult<()> {
        if let Some(id) = command.vehicle().filter(|id| self.run.snapshot().vehicle(*id).is_none()) {
            let present: Vec<u32> = self.run.snapshot().vehicles.iter().map(|vehicle| vehicle.id.0).collect();
            return Err(bad_input(format!("no vehicle {id} in the city: there are {present:?}")));
        }
        let is_physical = |id| self.run.snapshot().info(id).is_some_and(|info| info.is_physical());
        if let Some(id) = command.vehicle().filter(|id| is_physical(*id)) {
            return Err(bad_input(format!("vehicle {id} is a physical one: nobody drives it from here")));
        }
        self.orders.push((self.run.snapshot().tick, command.clone()));
        self.run.inject(command);
        Ok(())
    }

    /// Ticks of a time span.
    fn ticks(&self, seconds: f64) -> PyResult<u64> {
        let dt_s = self.run.experiment().rates.dt_s();
        let ticks = (seconds / dt_s).round();
        if !(1.0..=1e9).contains(&ticks) || (ticks * dt_s - seconds).abs() > 1e-6 * dt_s.max(seconds) {
            return Err(bad_input(format!("{seconds} s are no whole number of steps of {dt_s} s")));
        }
        Ok(ticks as u64)
    }

    fn restore(&mut self, saved: &SavedWorld) -> PyResult<()> {
        if self.request != saved.request {
            return Err(bad_input("the saved world is one of another scenario, seed or environment"));
        }
        self.reset(None)?;
        self.orders.clone_from(&saved.orders);
        let mut orders = saved.orders.iter().peekable();
        for tick in 0..=saved.tick {
            while let Some((_, command)) = orders.next_if(|(at, _)| *at == tick) {
                self.run.inject(command.clone());
            }
            if tick < saved.tick {
                self.run.step();
                self.drivers.raise()?;
            }
        }
        if self.run.snapshot().state_hash != saved.state_hash {
            return Err(PyRuntimeError::new_err(
                "the run did not repeat: a driver of Python has answered otherwise than before",
            ));
        }
        Ok(())
    }
}

fn start(request: &ScenarioRequest, drivers: &PythonDrivers) -> PyResult<Run> {
    let (text, library) = Library::scenario(&request.scenario).map_err(bad_input)?;
    let library = library.with_drivers(drivers.beside_standard());
    let experiment = request.read_text(&text, &library).map_err(bad_input)?;
    let run = Run::new(Arc::new(experiment)).map_err(bad_input)?;
    drivers.raise()?;
    Ok(run)
}

impl std::fmt::Debug for World {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("World").finish_non_exhaustive()
    }
}

impl World {
    /// The city, unless it is in use: whoever waited for it could wait for a driver that waits for Python.
    fn city(&self) -> PyResult<MutexGuard<'_, City>> {
        match self.city.try_lock() {
            Ok(city) => Ok(city),
            Err(TryLockError::Poisoned(poisoned)) => Ok(poisoned.into_inner()),
            Err(TryLockError::WouldBlock) => Err(PyRuntimeError::new_err(
                "the world is in use: another thread steps it, or a driver asks for it while it is stepped",
            )),
        }
    }
}

#[allow(clippy::too_many_arguments, reason = "Python gives them by name")]
#[pymethods]
impl World {
    #[new]
    #[pyo3(signature = (scenario, *, seed = None, duration_s = None, environment = None, model = None, set = None, drivers = None, quality = "auto"))]
    fn new(
        py: Python<'_>,
        scenario: PathBuf,
        seed: Option<u64>,
        duration_s: Option<f64>,
        environment: Option<&str>,
        model: Option<&str>,
        set: Option<BTreeMap<String, Bound<'_, PyAny>>>,
        drivers: Option<BTreeMap<String, Py<PyAny>>>,
        quality: &str,
    ) -> PyResult<Self> {
        let set = set.unwrap_or_default();
        let changes = set.iter().map(|(key, value)| {
            let text = format!("{key}={}", scenario_value(value)?);
            text.parse::<ScenarioChange>().map_err(bad_input)
        });
        let changes = changes.collect::<PyResult<Vec<_>>>()?;
        let environment = environment.map(|name| {
            let found = EnvironmentProfile::ALL.into_iter().find(|profile| profile.name() == name);
            found.ok_or_else(|| bad_input(format!("no environment {name:?}: it is \"ideal\" or \"testbed\"")))
        });
        let model = model.map(|name| match name {
            "raycast" => Ok(ModelKind::Raycast),
            "bicycle" => Ok(ModelKind::Bicycle),
            other => Err(bad_input(format!("no dynamics model {other:?}: it is \"raycast\" or \"bicycle\""))),
        });
        pictures::check_quality(quality)?;
        let overrides = Overrides {
            seed,
            duration_s,
            model: model.transpose()?,
            environment: environment.transpose()?,
            ..Overrides::default()
        };
        let request =
            ScenarioRequest { scenario: scenario.to_string_lossy().into_owned(), overrides, changes };
        let city = py.detach(|| {
            City::new(request, PythonDrivers::new(drivers.unwrap_or_default()), quality.to_owned())
        })?;
        Ok(Self { city: Mutex::new(city) })
    }

    /// Goes back to the start, with another seed where one is given.
    #[pyo3(signature = (seed = None))]
    fn reset(&self, py: Python<'_>, seed: Option<u64>) -> PyResult<()> {
        py.detach(|| self.city()?.reset(seed))
    }

    /// Simulates a time span, seconds; other threads of Python run meanwhile.
    #[pyo3(signature = (seconds = 0.1))]
    fn step(&self, py: Python<'_>, seconds: f64) -> PyResult<()> {
        py.detach(|| self.city()?.simulate(seconds))
    }

    /// A row of numbers for each vehicle, in id order; `city3d.COLUMNS` names the columns.
    fn states<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let values = states::rows(self.city()?.run.snapshot());
        let columns = states::COLUMNS.len();
        PyArray1::from_slice(py, &values).reshape([values.len() / columns, columns])
    }

    /// Ids of the vehicles that are in the city.
    #[getter]
    fn ids<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<u32>>> {
        let city = self.city()?;
        Ok(PyArray1::from_iter(py, city.run.snapshot().vehicles.iter().map(|vehicle| vehicle.id.0)))
    }

    /// Names of the vehicles that are in the city, by id.
    #[getter]
    fn names<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let names = PyDict::new(py);
        for (vehicle, info) in self.city()?.run.snapshot().iter() {
            names.set_item(vehicle.id.0, info.name.as_str())?;
        }
        Ok(names)
    }

    /// What happened since the last call, or since the start: a dict for each event, with `t` in seconds, `vehicle`, `kind`
    /// and what belongs to that kind, as in `events.jsonl`.
    fn events<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        let list = PyList::empty(py);
        for event in std::mem::take(&mut self.city()?.events) {
            let value =
                serde_json::to_value(&event).map_err(|error| PyRuntimeError::new_err(error.to_string()))?;
            list.append(object(py, &value)?)?;
        }
        Ok(list)
    }

    /// A vehicle is driven by these pedals from the next step on, until it is released.
    #[pyo3(signature = (vehicle, *, gas = 0.0, brake = 0.0, steering_rad = 0.0, handbrake = 0.0, reverse = false))]
    fn drive(
        &self,
        vehicle: u32,
        gas: f64,
        brake: f64,
        steering_rad: f64,
        handbrake: f64,
        reverse: bool,
    ) -> PyResult<()> {
        let pedals = Pedals { gas, brake, handbrake, steering_rad, reverse, indicator: Indicator::Off };
        self.city()?.order(SimCommand::Drive(VehicleId(vehicle), pedals.clamped()))
    }

    /// Vehicles are driven by pedals: a row of gas, brake and steering angle (radians, left-positive) for each id.
    fn act(&self, ids: PyReadonlyArray1<'_, u32>, pedals: PyReadonlyArray2<'_, f64>) -> PyResult<()> {
        let (ids, pedals) = (ids.as_array(), pedals.as_array());
        if pedals.shape() != [ids.len(), 3] {
            let message =
                format!("pedals of shape {:?} for {} ids: one row of 3 for each", pedals.shape(), ids.len());
            return Err(PyValueError::new_err(message));
        }
        let mut city = self.city()?;
        for (id, row) in ids.iter().zip(pedals.outer_iter()) {
            let pedals = Pedals { gas: row[0], brake: row[1], steering_rad: row[2], ..Pedals::default() };
            city.order(SimCommand::Drive(VehicleId(*id), pedals.clamped()))?;
        }
        Ok(())
    }

    /// Hands a vehicle back to its algorithm.
    fn release(&self, vehicle: u32) -> PyResult<()> {
        self.city()?.order(SimCommand::Release(VehicleId(vehicle)))
    }

    /// Keeps what the world is, to come back to it.
    fn save(&self) -> PyResult<SavedWorld> {
        let city = self.city()?;
        let snapshot = city.run.snapshot();
        Ok(SavedWorld {
            request: city.request.clone(),
            tick: snapshot.tick,
            state_hash: snapshot.state_hash,
            orders: city.orders.clone(),
        })
    }

    /// Comes back to what was saved, by simulating it again from the start: as exact as the run, and as long as it takes.
    fn restore(&self, py: Python<'_>, saved: &SavedWorld) -> PyResult<()> {
        py.detach(|| self.city()?.restore(saved))
    }

    /// What cameras see: `uint8` of (cameras, height, width, 3) for "rgb", `float32` metres for "depth", numbers of
    /// `city3d.CLASSES` for "semantic", ids of vehicles for "instance".
    #[pyo3(signature = (cameras, width = 640, height = 480, *, kind = "rgb", vertical_fov_deg = 50.0))]
    fn pictures<'py>(
        &self,
        py: Python<'py>,
        cameras: Vec<Camera>,
        width: u32,
        height: u32,
        kind: &str,
        vertical_fov_deg: f64,
    ) -> PyResult<Bound<'py, PyAny>> {
        let form = PictureForm::new([width, height], vertical_fov_deg, kind)?;
        let pictures = py.detach(|| {
            let mut guard = self.city()?;
            let city = &mut *guard;
            if city.renderer.is_none() {
                city.renderer = Some(pictures::renderer(city.run.experiment(), &city.quality)?);
            }
            let renderer = city.renderer.as_mut().ok_or_else(|| PyRuntimeError::new_err("no renderer"))?;
            pictures::draw(renderer, city.run.snapshot(), (&cameras, form))
        })?;
        pictures::array(py, pictures, form)
    }

    /// Simulated time, seconds.
    #[getter]
    fn time_s(&self) -> PyResult<f64> {
        Ok(self.city()?.run.snapshot().time_s)
    }

    /// Steps of the physics since the start.
    #[getter]
    fn tick(&self) -> PyResult<u64> {
        Ok(self.city()?.run.snapshot().tick)
    }

    /// Simulated time of a step of the physics, seconds.
    #[getter]
    fn dt_s(&self) -> PyResult<f64> {
        Ok(self.city()?.run.experiment().rates.dt_s())
    }

    /// Duration of the scenario, simulated seconds.
    #[getter]
    fn duration_s(&self) -> PyResult<f64> {
        Ok(self.city()?.run.experiment().duration_s)
    }

    /// Whether the duration of the scenario is over.
    #[getter]
    fn is_over(&self) -> PyResult<bool> {
        let city = self.city()?;
        Ok(city.run.snapshot().tick >= city.run.experiment().ticks())
    }

    /// Seed of the run.
    #[getter]
    fn seed(&self) -> PyResult<u64> {
        Ok(self.city()?.run.experiment().seed)
    }

    /// Digest of the whole state: two runs are the same when it is equal at every step.
    #[getter]
    fn digest(&self) -> PyResult<String> {
        Ok(format!("{:016x}", self.city()?.run.snapshot().state_hash))
    }

    fn __repr__(&self) -> PyResult<String> {
        let city = self.city()?;
        let (request, snapshot) = (&city.request.scenario, city.run.snapshot());
        let vehicles = snapshot.vehicles.len();
        Ok(format!("<city3d.World {request:?} at {:.2} s, {vehicles} vehicles>", snapshot.time_s))
    }
}

/// Simulates a time span in many worlds side by side, on all cores.
#[pyfunction]
#[pyo3(signature = (worlds, seconds = 0.1))]
pub fn step_worlds(py: Python<'_>, worlds: Vec<Py<World>>, seconds: f64) -> PyResult<()> {
    let worlds: Vec<&World> = worlds.iter().map(Py::get).collect();
    py.detach(|| worlds.par_iter().try_for_each(|world| world.city()?.simulate(seconds)))
}
