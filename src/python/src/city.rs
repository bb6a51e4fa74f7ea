//! The simulated city behind a world of Python: a run in lockstep, and what is ordered of its vehicles.

use crate::actions::{Acceleration, Order};
use crate::commanded::CommandedAccelerations;
use crate::convert::bad_input;
use crate::coordinators::PythonCoordinators;
use crate::drivers::PythonDrivers;
use crate::pictures::{self, SharedRenderer};
use city3d_control::coordination::Coordinators;
use city3d_dynamics::vehicle::{Motion, throttle_for_acceleration};
use city3d_protocol::snapshot::{Event, FrameSnapshot, Pedals, SimCommand, Trajectory, VehicleId};
use city3d_simulation::runner::Run;
use city3d_simulation::scenario::{Experiment, Library, MapCache, Overrides, ScenarioRequest};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use std::collections::BTreeMap;
use std::sync::{Arc, LazyLock};

/// Trajectories of arrays are numbered from here on: whoever counts from far behind is a restarted sender, so that a vehicle
/// takes trajectories of the control framework, of arrays, and of the control framework again.
const FIRST_NUMBER: u32 = 1 << 30;

/// The maps of all worlds of this process.
static MAPS: LazyLock<MapCache> = LazyLock::new(MapCache::default);

/// Algorithms of Python, and accelerations that are ordered of those of the library.
#[derive(Debug)]
pub struct Algorithms {
    pub drivers: PythonDrivers,
    pub coordinators: PythonCoordinators,
    pub commanded: CommandedAccelerations,
}

impl Algorithms {
    /// Raises what one of them has raised since the last call.
    fn raise(&self) -> PyResult<()> {
        self.drivers.raise()?;
        self.coordinators.raise()
    }

    /// Reads a scenario, and begins a run of it.
    fn start(&self, request: &ScenarioRequest) -> PyResult<Run> {
        let (text, library) = Library::scenario(&request.scenario).map_err(bad_input)?;
        let drivers = self.drivers.beside(self.commanded.drivers(), &self.commanded);
        let coordinators = self.coordinators.beside(Coordinators::standard());
        let library =
            library.with_drivers(drivers).with_coordinators(coordinators).with_map_cache(MAPS.clone());
        let experiment = request.read_text(&text, &library).map_err(bad_input)?;
        self.commanded.clear();
        let run = Run::new(Arc::new(experiment)).map_err(bad_input)?;
        self.raise()?;
        Ok(run)
    }
}

/// A state that a city can come back to.
#[derive(Debug)]
pub struct SavedCity {
    request: ScenarioRequest,
    tick: u64,
    state_hash: u64,
    orders: Vec<(u64, Order)>,
}

/// A run, its orders from outside, and the renderer of its pictures.
pub struct City {
    pub request: ScenarioRequest,
    algorithms: Algorithms,
    run: Run,
    /// What was ordered from outside, with the tick before which it was.
    orders: Vec<(u64, Order)>,
    /// Accelerations that hold until the next order of the vehicle.
    accelerations: BTreeMap<VehicleId, Acceleration>,
    /// Trajectories that vehicles follow until their next order. They are sent again with each control step, as those of the
    /// control framework are: a vehicle that hears nothing for a while has lost its link.
    trajectories: BTreeMap<VehicleId, Trajectory>,
    /// Number of the next trajectory.
    next_number: u32,
    events: Vec<Event>,
    quality: String,
    renderer: Option<SharedRenderer>,
}

impl City {
    pub fn new(request: ScenarioRequest, algorithms: Algorithms, quality: String) -> PyResult<Self> {
        let run = algorithms.start(&request)?;
        Ok(Self {
            request,
            algorithms,
            run,
            orders: Vec::new(),
            accelerations: BTreeMap::new(),
            trajectories: BTreeMap::new(),
            next_number: FIRST_NUMBER,
            events: Vec::new(),
            quality,
            renderer: None,
        })
    }

    pub fn snapshot(&self) -> &FrameSnapshot {
        self.run.snapshot()
    }

    pub fn experiment(&self) -> &Experiment {
        self.run.experiment()
    }

    /// Whether the duration of the scenario is over.
    pub fn is_over(&self) -> bool {
        self.snapshot().tick >= self.experiment().ticks()
    }

    /// The events since the last call.
    pub fn take_events(&mut self) -> Vec<Event> {
        std::mem::take(&mut self.events)
    }

    /// Back to the start, with another seed perhaps.
    pub fn reset(&mut self, seed: Option<u64>) -> PyResult<()> {
        match seed.filter(|seed| *seed != self.experiment().seed) {
            Some(seed) => {
                let overrides = Overrides { seed: Some(seed), ..self.request.overrides };
                let request = ScenarioRequest { overrides, ..self.request.clone() };
                self.run = self.algorithms.start(&request)?;
                self.request = request;
            }
            None => {
                self.algorithms.commanded.clear();
                self.run.reset().map_err(bad_input)?;
                self.algorithms.raise()?;
            }
        }
        self.orders.clear();
        self.accelerations.clear();
        self.trajectories.clear();
        self.next_number = FIRST_NUMBER;
        self.events.clear();
        Ok(())
    }

    /// Simulates a time span, seconds.
    pub fn simulate(&mut self, seconds: f64) -> PyResult<()> {
        for _ in 0..self.ticks(seconds)? {
            self.tick()?;
            self.events.extend_from_slice(&self.run.snapshot().events);
        }
        Ok(())
    }

    fn tick(&mut self) -> PyResult<()> {
        let (run, accelerations) = (&mut self.run, &mut self.accelerations);
        accelerations.retain(|id, wanted| {
            let Some(pedals) = pedals_of(run, *id, *wanted) else { return false };
            run.inject(SimCommand::Drive(*id, pedals));
            true
        });
        let (tick, rates) = (run.snapshot().tick, run.experiment().rates);
        let is_due = tick.is_multiple_of(rates.ticks_per_control());
        self.trajectories.retain(|id, _| run.snapshot().vehicle(*id).is_some());
        for trajectory in self.trajectories.values_mut() {
            if is_due || trajectory.sequence < FIRST_NUMBER {
                trajectory.sequence = self.next_number;
                self.next_number = self.next_number.wrapping_add(1).max(FIRST_NUMBER);
                run.inject(SimCommand::Follow(trajectory.clone()));
            }
        }
        run.step();
        self.algorithms.raise()
    }

    /// Ticks of a time span.
    fn ticks(&self, seconds: f64) -> PyResult<u64> {
        let dt_s = self.experiment().rates.dt_s();
        let ticks = (seconds / dt_s).round();
        if !(1.0..=1e9).contains(&ticks) || (ticks * dt_s - seconds).abs() > 1e-6 * dt_s.max(seconds) {
            return Err(bad_input(format!("{seconds} s are no whole number of steps of {dt_s} s")));
        }
        Ok(ticks as u64)
    }

    /// Carries out orders of vehicles that have been checked.
    pub fn order(&mut self, orders: Vec<Order>) {
        let tick = self.snapshot().tick;
        for order in orders {
            self.carry_out(&order);
            self.orders.push((tick, order));
        }
    }

    fn carry_out(&mut self, order: &Order) {
        let id = order.vehicle();
        self.run.withhold(id, matches!(order, Order::Follow(_)));
        self.accelerations.remove(&id);
        self.trajectories.remove(&id);
        let along_mps2 = if let Order::AlongRoute(_, mps2) = order { Some(*mps2) } else { None };
        let scale = self.experiment().scale;
        self.algorithms.commanded.set(id, along_mps2.map(|mps2| scale.lab_from_city(mps2)));
        match order {
            Order::Drive(_, pedals) => self.run.inject(SimCommand::Drive(id, **pedals)),
            Order::Accelerate(_, wanted) => {
                self.accelerations.insert(id, *wanted);
            }
            Order::AlongRoute(..) | Order::Release(_) => self.run.inject(SimCommand::Release(id)),
            Order::Follow(trajectory) => {
                self.run.inject(SimCommand::Release(id));
                self.trajectories.insert(id, (**trajectory).clone());
            }
        }
    }

    /// Largest deceleration (negative) and acceleration of a vehicle's driver, full-scale m/s2.
    pub fn limits(&self, id: VehicleId) -> Option<[f64; 2]> {
        let (driver, scale) = (self.experiment().planned(id)?.driver, self.experiment().scale);
        Some(
            [driver.min_acceleration_mps2, driver.max_acceleration_mps2]
                .map(|mps2| scale.city_from_lab(mps2)),
        )
    }

    pub fn save(&self) -> SavedCity {
        let snapshot = self.snapshot();
        SavedCity {
            request: self.request.clone(),
            tick: snapshot.tick,
            state_hash: snapshot.state_hash,
            orders: self.orders.clone(),
        }
    }

    pub fn restore(&mut self, saved: &SavedCity) -> PyResult<()> {
        if self.request != saved.request {
            return Err(bad_input("the saved world is one of another scenario, seed or environment"));
        }
        self.reset(None)?;
        let mut orders = saved.orders.iter().peekable();
        for tick in 0..=saved.tick {
            while let Some((_, order)) = orders.next_if(|(at, _)| *at == tick) {
                self.carry_out(order);
            }
            if tick < saved.tick {
                self.tick()?;
            }
        }
        self.orders.clone_from(&saved.orders);
        if self.snapshot().state_hash != saved.state_hash {
            return Err(PyRuntimeError::new_err(
                "the run did not repeat: an algorithm of Python has answered otherwise than before",
            ));
        }
        Ok(())
    }

    /// The renderer of its scene, which worlds of one scene share.
    ///
    /// # Errors
    /// Where there is no adapter.
    pub fn renderer(&mut self) -> PyResult<SharedRenderer> {
        if let Some(renderer) = &self.renderer {
            return Ok(Arc::clone(renderer));
        }
        let renderer = pictures::shared_renderer(&self.request, &self.quality, self.run.experiment())?;
        Ok(Arc::clone(self.renderer.insert(renderer)))
    }
}

/// Pedals that accelerate a vehicle as wanted, by the inverse model of its dynamics; `None` for one that has left. It stops, and
/// does not reverse, where a deceleration outlasts its speed.
fn pedals_of(run: &Run, id: VehicleId, wanted: Acceleration) -> Option<Pedals> {
    let state = run.snapshot().vehicle(id)?;
    let spec = &run.experiment().planned(id)?.spec;
    let throttle = throttle_for_acceleration(spec, &Motion::of(state), wanted.mps2);
    let (gas, brake) = (throttle.max(0.0), (-throttle).max(0.0));
    Some(Pedals { gas, brake, steering_rad: wanted.steering_rad, ..Pedals::default() }.clamped())
}
