//! A simulated city: its vehicles, its clock and its control framework.

use crate::actions::{Order, check_vehicle, orders};
use crate::animation::{Animation, png_of};
use crate::cameras::Camera;
use crate::city::{Algorithms, City, SavedCity};
use crate::commanded::CommandedAccelerations;
use crate::convert::{bad_input, object, scenario_value};
use crate::coordinators::PythonCoordinators;
use crate::drivers::PythonDrivers;
use crate::observations::{observations, size};
use crate::pictures::{self, PictureForm, PictureTaker, SharedRenderer, USUAL_FOV_DEG};
use crate::states;
use city3d_protocol::snapshot::{Indicator, ModelKind, Pedals, VehicleId};
use city3d_simulation::environment::EnvironmentProfile;
use city3d_simulation::scenario::{Overrides, ScenarioChange, ScenarioRequest, shipped_scenarios};
use numpy::{AllowTypeChange, PyArray1, PyArray2, PyArrayLike1, PyArrayLikeDyn, PyArrayMethods as _};
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyList};
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
#[pyclass(module = "city3d", frozen, weakref)]
pub struct World {
    city: Mutex<City>,
}

/// What a world was at an instant; it belongs to worlds of the same scenario and seed.
#[pyclass(module = "city3d", frozen)]
#[derive(Debug)]
pub struct SavedWorld {
    saved: SavedCity,
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
                "the world is in use: another thread steps it, or an algorithm asks for it while it is stepped",
            )),
        }
    }

    fn order(&self, order: Order) -> PyResult<()> {
        let mut city = self.city()?;
        check_vehicle(order.vehicle(), city.snapshot()).map_err(bad_input)?;
        city.order(vec![order]);
        Ok(())
    }
}

/// Most neighbours of an observation.
const MOST_NEIGHBOURS: usize = 1000;
/// Most pictures of an animation: they are kept in memory.
const MOST_PICTURES: f64 = 2000.0;

#[allow(clippy::too_many_arguments, reason = "Python gives them by name")]
#[pymethods]
impl World {
    #[new]
    #[pyo3(signature = (scenario, *, seed = None, duration_s = None, environment = None, model = None, set = None, drivers = None, coordinators = None, quality = "auto"))]
    fn new(
        py: Python<'_>,
        scenario: PathBuf,
        seed: Option<u64>,
        duration_s: Option<f64>,
        environment: Option<&str>,
        model: Option<&str>,
        set: Option<BTreeMap<String, Bound<'_, PyAny>>>,
        drivers: Option<BTreeMap<String, Py<PyAny>>>,
        coordinators: Option<BTreeMap<String, Py<PyAny>>>,
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
        let algorithms = Algorithms {
            drivers: PythonDrivers::new(drivers.unwrap_or_default()),
            coordinators: PythonCoordinators::new(coordinators.unwrap_or_default()),
            commanded: CommandedAccelerations::default(),
        };
        let city = py.detach(|| City::new(request, algorithms, quality.to_owned()))?;
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
        let values = states::rows(self.city()?.snapshot());
        let columns = states::COLUMNS.len();
        PyArray1::from_slice(py, &values).reshape([values.len() / columns, columns])
    }

    /// Ids of the vehicles that are in the city.
    #[getter]
    fn ids<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<u32>>> {
        let city = self.city()?;
        Ok(PyArray1::from_iter(py, city.snapshot().vehicles.iter().map(|vehicle| vehicle.id.0)))
    }

    /// Names of the vehicles that are in the city, by id.
    #[getter]
    fn names<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let names = PyDict::new(py);
        for (vehicle, info) in self.city()?.snapshot().iter() {
            names.set_item(vehicle.id.0, info.name.as_str())?;
        }
        Ok(names)
    }

    /// What happened since the last call, or since the start: a dict for each event, with `t` in seconds, `vehicle`, `kind`
    /// and what belongs to that kind, as in `events.jsonl`.
    fn events<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        let list = PyList::empty(py);
        for event in self.city()?.take_events() {
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
        self.order(Order::Drive(VehicleId(vehicle), Box::new(pedals.clamped())))
    }

    /// Vehicles do from the next step on what their rows say, until they get another action or are released;
    /// `city3d.ACTIONS` has the kinds and their columns. Either all rows are carried out or, with an error, none.
    #[pyo3(signature = (ids, actions, kind = "pedals"))]
    fn act(
        &self,
        ids: PyArrayLike1<'_, u32, AllowTypeChange>,
        actions: PyArrayLikeDyn<'_, f64, AllowTypeChange>,
        kind: &str,
    ) -> PyResult<()> {
        let mut city = self.city()?;
        let orders = orders(ids.as_array(), &actions.as_array(), kind, city.snapshot())?;
        city.order(orders);
        Ok(())
    }

    /// Hands a vehicle back to its algorithm.
    fn release(&self, vehicle: u32) -> PyResult<()> {
        self.order(Order::Release(VehicleId(vehicle)))
    }

    /// What vehicles observe, a row of `float32` for each id: own speed over 10 m/s, own acceleration over 3 m/s2, own steering
    /// angle (radians), time left as a share of the duration; then of each of the nearest vehicles whether it is there, its place
    /// in front and to the left over 50 m, and its velocity relative to the own one in the same directions over 10 m/s. Zeros
    /// for a vehicle that is not in the city.
    #[pyo3(signature = (ids, neighbours = 5))]
    fn observe<'py>(
        &self,
        py: Python<'py>,
        ids: PyArrayLike1<'py, u32, AllowTypeChange>,
        neighbours: usize,
    ) -> PyResult<Bound<'py, PyArray2<f32>>> {
        if neighbours > MOST_NEIGHBOURS {
            return Err(bad_input(format!("{neighbours} neighbours: 0 to {MOST_NEIGHBOURS} are possible")));
        }
        let (city, ids) = (self.city()?, ids.as_array());
        let snapshot = city.snapshot();
        let left = (1.0 - snapshot.time_s / city.experiment().duration_s).max(0.0);
        let vehicles = ids.iter().map(|id| VehicleId(*id));
        let values = observations(snapshot, vehicles, (neighbours, left));
        PyArray1::from_vec(py, values).reshape([ids.len(), size(neighbours)])
    }

    /// The largest deceleration (negative) and acceleration of the drivers of vehicles, m/s2: a row for each id, NaN for a vehicle
    /// that the scenario does not have.
    fn limits<'py>(
        &self,
        py: Python<'py>,
        ids: PyArrayLike1<'py, u32, AllowTypeChange>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let (city, ids) = (self.city()?, ids.as_array());
        let limits = ids.iter().flat_map(|id| city.limits(VehicleId(*id)).unwrap_or([f64::NAN; 2]));
        PyArray1::from_iter(py, limits).reshape([ids.len(), 2])
    }

    /// Keeps what the world is, to come back to it.
    fn save(&self) -> PyResult<SavedWorld> {
        Ok(SavedWorld { saved: self.city()?.save() })
    }

    /// Comes back to what was saved, by simulating it again from the start: as exact as the run, and as long as it takes.
    fn restore(&self, py: Python<'_>, saved: &SavedWorld) -> PyResult<()> {
        py.detach(|| self.city()?.restore(&saved.saved))
    }

    /// Simulates a time span and takes a picture of every `1 / fps` simulated seconds of it, for notebooks and files. It is shown
    /// `speed` times as fast; the camera is one above the city where none is given.
    #[pyo3(signature = (seconds, *, camera = None, width = 480, height = 360, fps = 10.0, speed = 1.0))]
    fn animation(
        &self,
        py: Python<'_>,
        seconds: f64,
        camera: Option<Camera>,
        width: u32,
        height: u32,
        fps: f64,
        speed: f64,
    ) -> PyResult<Animation> {
        PictureForm::new([width, height], USUAL_FOV_DEG, "rgb")?;
        if !(speed.is_finite() && (0.01..=1000.0).contains(&speed)) {
            return Err(bad_input(format!("{speed} times as fast: 0.01 to 1000 are possible")));
        }
        py.detach(|| {
            let mut city = self.city()?;
            let above = || Camera::above(&city.experiment().city_map, [width, height]);
            let camera = camera.unwrap_or_else(above);
            let dt_s = city.experiment().rates.dt_s();
            // Pictures are of whole steps.
            let period_s = ((1.0 / fps) / dt_s).round().max(1.0) * dt_s;
            let count = (seconds / period_s).round();
            if !(1.0..=MOST_PICTURES).contains(&count) {
                return Err(bad_input(format!(
                    "{seconds} s with {fps} pictures a second: 1 to {MOST_PICTURES} pictures are possible"
                )));
            }
            let renderer = city.renderer()?;
            let mut images = Vec::with_capacity(count as usize);
            for _ in 0..count as usize {
                city.simulate(period_s)?;
                let shot = (&camera, [width, height]);
                let mut taker = PictureTaker::new(&renderer, city.experiment());
                images.push(taker.draw_rgb(city.snapshot(), shot)?);
            }
            Ok(Animation::new(images, period_s, speed))
        })
    }

    /// A camera straight above the city, so high that a picture of this size shows all of it.
    #[pyo3(signature = (width = 640, height = 480))]
    fn overview(&self, width: u32, height: u32) -> PyResult<Camera> {
        Ok(Camera::above(&self.city()?.experiment().city_map, [width, height]))
    }

    /// The city from above, which notebooks show.
    fn _repr_png_<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let bytes = py.detach(|| {
            let mut city = self.city()?;
            let renderer = city.renderer()?;
            let extent = [640, 480];
            let camera = Camera::above(&city.experiment().city_map, extent);
            let mut taker = PictureTaker::new(&renderer, city.experiment());
            png_of(&taker.draw_rgb(city.snapshot(), (&camera, extent))?)
        })?;
        Ok(PyBytes::new(py, &bytes))
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
            let mut city = self.city()?;
            let renderer = city.renderer()?;
            PictureTaker::new(&renderer, city.experiment()).draw(city.snapshot(), (&cameras, form))
        })?;
        pictures::array(py, pictures, form)
    }

    /// Names of the control algorithms of the vehicles that are in the city, by id.
    #[getter]
    fn controllers<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let controllers = PyDict::new(py);
        let city = self.city()?;
        for vehicle in &city.snapshot().vehicles {
            if let Some(planned) = city.experiment().planned(vehicle.id) {
                controllers.set_item(vehicle.id.0, planned.controller.as_str())?;
            }
        }
        Ok(controllers)
    }

    /// Simulated time, seconds.
    #[getter]
    fn time_s(&self) -> PyResult<f64> {
        Ok(self.city()?.snapshot().time_s)
    }

    /// Steps of the physics since the start.
    #[getter]
    fn tick(&self) -> PyResult<u64> {
        Ok(self.city()?.snapshot().tick)
    }

    /// Simulated time of a step of the physics, seconds.
    #[getter]
    fn dt_s(&self) -> PyResult<f64> {
        Ok(self.city()?.experiment().rates.dt_s())
    }

    /// Duration of the scenario, simulated seconds.
    #[getter]
    fn duration_s(&self) -> PyResult<f64> {
        Ok(self.city()?.experiment().duration_s)
    }

    /// Whether the duration of the scenario is over.
    #[getter]
    fn is_over(&self) -> PyResult<bool> {
        Ok(self.city()?.is_over())
    }

    /// Seed of the run.
    #[getter]
    fn seed(&self) -> PyResult<u64> {
        Ok(self.city()?.experiment().seed)
    }

    /// Digest of the whole state: two runs are the same when it is equal at every step.
    #[getter]
    fn digest(&self) -> PyResult<String> {
        Ok(format!("{:016x}", self.city()?.snapshot().state_hash))
    }

    fn __repr__(&self) -> PyResult<String> {
        let city = self.city()?;
        let (request, snapshot) = (&city.request.scenario, city.snapshot());
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

/// What cameras see in many worlds, one camera for each world, as `World.pictures` returns it: worlds of one scene share a
/// renderer, and a picture is drawn while the one before is copied.
#[allow(clippy::too_many_arguments, reason = "Python gives them by name")]
#[pyfunction]
#[pyo3(signature = (worlds, cameras, width = 640, height = 480, *, kind = "rgb", vertical_fov_deg = USUAL_FOV_DEG))]
pub fn picture_worlds<'py>(
    py: Python<'py>,
    worlds: Vec<Py<World>>,
    cameras: Vec<Camera>,
    width: u32,
    height: u32,
    kind: &str,
    vertical_fov_deg: f64,
) -> PyResult<Bound<'py, PyAny>> {
    let form = PictureForm::new([width, height], vertical_fov_deg, kind)?;
    if worlds.len() != cameras.len() {
        let (worlds, cameras) = (worlds.len(), cameras.len());
        return Err(PyValueError::new_err(format!("{cameras} cameras for {worlds} worlds: each has one")));
    }
    let worlds: Vec<&World> = worlds.iter().map(Py::get).collect();
    let pictures = py.detach(|| {
        let mut cities = worlds.iter().map(|world| world.city()).collect::<PyResult<Vec<_>>>()?;
        let renderers =
            cities.iter_mut().map(|city| city.renderer()).collect::<PyResult<Vec<SharedRenderer>>>()?;
        let mut pictures = Vec::with_capacity(cities.len());
        let mut first = 0;
        // Neighbours of one scene are drawn together.
        for same in renderers.chunk_by(Arc::ptr_eq) {
            let range = first..first + same.len();
            let shots: Vec<_> =
                range.clone().map(|index| (cities[index].snapshot(), &cameras[index])).collect();
            let mut taker = PictureTaker::new(&same[0], cities[first].experiment());
            pictures.extend(taker.draw_each(&shots, form)?);
            first = range.end;
        }
        PyResult::Ok(pictures)
    })?;
    pictures::array(py, pictures, form)
}
