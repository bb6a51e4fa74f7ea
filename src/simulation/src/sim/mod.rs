//! The simulated world: vehicles, physics and the experiment's clock. Commands in, snapshots out.
//!
//! A run is a function of the experiment and the command stream. No wall clock, static or random draw affects it, nor the
//! number of threads.

mod collision;
mod neighbours;
mod step;
mod vehicle;

use crate::scenario::Experiment;
use city3d_dynamics::physics::Physics;
use city3d_geometry::digest::{Digest, StateHash};
use city3d_protocol::snapshot::{
    Aspect, Event, EventKind, FrameSnapshot, Pedals, Setup, SignalAspects, SimCommand, Trajectory, VehicleId,
    VehicleInfo, VehicleState,
};
use collision::{Collisions, StaticObstacles};
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use step::{Buffers, follow_own};
use vehicle::SimVehicle;

/// The whole simulation.
///
/// A world and its copy stay equal under the same commands:
///
/// ```
/// use city3d_simulation::scenario::{Library, Overrides, read_experiment};
/// use city3d_simulation::sim::World;
/// use city3d_protocol::snapshot::SimCommand;
/// use std::sync::Arc;
///
/// let (text, library) = Library::scenario("straight")?;
/// let experiment = read_experiment("straight", &text, &library, Overrides::default())?;
/// let mut world = World::new(Arc::new(experiment));
/// let mut copy = world.clone();
/// let (mut one, mut other) = (world.snapshot(), copy.snapshot());
/// world.tick_into(&[SimCommand::Start], &mut one);
/// copy.tick_into(&[SimCommand::Start], &mut other);
/// assert_eq!((one.tick, one.state_hash), (1, other.state_hash));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct World {
    experiment: Arc<Experiment>,
    solids: Arc<StaticObstacles>,
    roster: Arc<Vec<VehicleInfo>>,
    state: WorldState,
    buffers: Buffers,
}

/// The mutable state: with the experiment it restores the world at any tick.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct WorldState {
    tick: u64,
    is_running: bool,
    physics: Physics,
    /// In id order.
    vehicles: Vec<SimVehicle>,
    /// Setups of the vehicles that commands added, in the order of arrival.
    setups: Vec<Setup>,
    collisions: Collisions,
    signals: ShownSignals,
    /// Events since the last snapshot, outside of a step.
    pending: Vec<Event>,
}

/// What the signal heads show.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct ShownSignals {
    /// Of the newest command.
    stamp_s: f64,
    /// By head.
    aspects: Vec<Aspect>,
}

impl ShownSignals {
    fn new(heads: usize) -> Self {
        Self { stamp_s: 0.0, aspects: vec![Aspect::Dark; heads] }
    }

    /// Shows aspects, unless newer ones have come; heads that the map does not have are ignored.
    fn show(&mut self, command: &SignalAspects) {
        if command.stamp_s < self.stamp_s {
            return;
        }
        self.stamp_s = command.stamp_s;
        for (head, aspect) in &command.heads {
            if let Some(shown) = self.aspects.get_mut(head.index()) {
                *shown = *aspect;
            }
        }
    }
}

/// Writes the states of vehicles into a snapshot and begins the digest of the world with them, for they are read for both;
/// [`Collisions`] end it.
///
/// The digest is without whether the clock runs: a world that is paused has no ticks. And without the signals: an aspect moves
/// no vehicle, for the control framework decides who goes, and the trajectories that come of it are covered.
fn describe_vehicles(
    tick: u64,
    (vehicles, physics): (&[SimVehicle], &Physics),
    states: &mut Vec<VehicleState>,
) -> StateHash {
    states.clear();
    let mut hash = StateHash::default();
    hash.word(tick);
    for vehicle in vehicles {
        states.push(vehicle.state.clone());
        vehicle.digest(&mut hash);
        vehicle.body_state(physics).digest(&mut hash);
        // Commands that come before the first step belong to it.
        if tick > 0 {
            vehicle.digest_commands(&mut hash);
        }
    }
    hash
}

impl World {
    /// The world at the initial conditions of an experiment; its clock is stopped.
    pub fn new(experiment: Arc<Experiment>) -> Self {
        let solids = Arc::new(StaticObstacles::of(&experiment.city_map));
        let state = WorldState::initial(&experiment, &solids);
        let roster = state.roster(&experiment);
        Self { experiment, solids, roster, state, buffers: Buffers::default() }
    }

    /// The experiment that sets the initial conditions.
    pub fn experiment(&self) -> &Arc<Experiment> {
        &self.experiment
    }

    /// Physics steps since the start or the last reset.
    pub fn tick(&self) -> u64 {
        self.state.tick
    }

    /// Simulated time of the present tick, seconds.
    pub fn time_s(&self) -> f64 {
        self.experiment.rates.time_s(self.state.tick)
    }

    /// Whether the experiment's clock runs.
    pub fn is_running(&self) -> bool {
        self.state.is_running
    }

    /// The state that [`World::with_state`] restores.
    pub fn state(&self) -> &WorldState {
        &self.state
    }

    /// The world of the same experiment at a saved state.
    pub fn with_state(&self, state: WorldState) -> Self {
        let roster = state.roster(&self.experiment);
        Self {
            experiment: Arc::clone(&self.experiment),
            solids: Arc::clone(&self.solids),
            roster,
            state,
            buffers: Buffers::default(),
        }
    }

    /// Applies commands, advances by one physics step if the clock runs, and writes the snapshot. Commands
    /// are applied in the order of (vehicle, sequence); experiment commands come first.
    pub fn tick_into(&mut self, commands: &[SimCommand], out: &mut FrameSnapshot) {
        if commands.is_sorted_by_key(SimCommand::order) {
            return self.tick_as_given(commands, out);
        }
        let mut ordered = commands.to_vec();
        ordered.sort_by_key(SimCommand::order);
        self.tick_as_given(&ordered, out);
    }

    /// [`Self::tick_into`] without sorting: a log has commands in the order in which they were applied, while
    /// the clock was stopped perhaps one by one.
    pub fn tick_as_given(&mut self, commands: &[SimCommand], out: &mut FrameSnapshot) {
        let experiment = Arc::clone(&self.experiment);
        let hash = experiment.workers.at_hand(self.state.vehicles.len(), || {
            let trajectories = self.apply_all(commands);
            out.events.clear();
            if self.state.is_running {
                // Events before the start belong to the first tick, also after a reset.
                out.events.append(&mut self.state.pending);
                self.step(&trajectories, out)
            } else {
                self.follow_all(&trajectories);
                self.state.describe_vehicles(&mut out.vehicles)
            }
        });
        self.describe(out, hash);
    }

    /// The present snapshot without events.
    pub fn snapshot(&self) -> FrameSnapshot {
        let mut out = FrameSnapshot::default();
        let hash = self.state.describe_vehicles(&mut out.vehicles);
        self.describe(&mut out, hash);
        out
    }

    /// Applies commands in their order; trajectories that most vehicles get together are shared out. Returns those that come last,
    /// in the order of ids, which are left to the step: with it a vehicle is read from memory once for both.
    fn apply_all<'c>(&mut self, commands: &'c [SimCommand]) -> Vec<&'c Trajectory> {
        let mut rest = commands;
        while !rest.is_empty() {
            let count = rest.iter().map_while(followed_trajectory).count();
            let (next, others) = rest.split_at(count.max(1));
            let is_in_order = || next.is_sorted_by_key(SimCommand::vehicle);
            if count > self.state.vehicles.len() / 2 && is_in_order() {
                let trajectories = next.iter().filter_map(followed_trajectory).collect();
                if others.is_empty() {
                    return trajectories;
                }
                self.follow_all(&trajectories);
            } else {
                next.iter().for_each(|command| self.apply(command));
            }
            rest = others;
        }
        Vec::new()
    }

    /// Gives vehicles their trajectories, which are in the order of ids.
    fn follow_all(&mut self, trajectories: &[&Trajectory]) {
        let (time_s, timeout_s) = (self.time_s(), self.experiment.link_timeout_s);
        self.experiment.workers.each(&mut self.state.vehicles, |index, vehicle| {
            follow_own((index, vehicle), trajectories, time_s, timeout_s);
        });
    }

    fn apply(&mut self, command: &SimCommand) {
        let (time_s, timeout_s) = (self.time_s(), self.experiment.link_timeout_s);
        match command {
            SimCommand::Start => self.state.is_running = true,
            SimCommand::Pause => self.state.is_running = false,
            SimCommand::Reset => {
                let mut setups = std::mem::take(&mut self.state.setups);
                // Arrivals come again when their time comes.
                setups.retain(|setup| !self.experiment.is_arrival(setup.id, &setup.name));
                self.state = WorldState::initial(&self.experiment, &self.solids);
                setups.into_iter().for_each(|setup| self.state.spawn(&self.experiment, setup));
                self.roster = self.state.roster(&self.experiment);
            }
            SimCommand::Spawn(setup) => match self.vehicle_mut(setup.id) {
                Some(vehicle) => vehicle.reset_sequence(),
                None => {
                    self.state.spawn(&self.experiment, Setup::clone(setup));
                    self.roster = self.state.roster(&self.experiment);
                }
            },
            SimCommand::Remove(id) => self.remove(*id),
            SimCommand::Measure(id, pose) => {
                let state = &mut self.state;
                if let Ok(index) = state.vehicles.binary_search_by_key(id, |vehicle| vehicle.state.id) {
                    state.vehicles[index].measure(pose, &state.physics, time_s, state.is_running);
                }
            }
            SimCommand::Follow(trajectory) => {
                if let Some(vehicle) = self.vehicle_mut(trajectory.vehicle) {
                    vehicle.follow(trajectory, time_s, timeout_s);
                }
            }
            SimCommand::Drive(id, pedals) => self.drive(*id, Some(*pedals)),
            SimCommand::Release(id) => self.drive(*id, None),
            SimCommand::Signals(aspects) => self.state.signals.show(aspects),
        }
    }

    fn drive(&mut self, id: VehicleId, pedals: Option<Pedals>) {
        let (vehicles, contacts) = (&mut self.state.vehicles, &self.state.collisions);
        if let Ok(index) = vehicles.binary_search_by_key(&id, |vehicle| vehicle.state.id) {
            vehicles[index].drive(pedals, contacts);
        }
    }

    fn vehicle_mut(&mut self, id: VehicleId) -> Option<&mut SimVehicle> {
        let index = self.state.vehicles.binary_search_by_key(&id, |vehicle| vehicle.state.id).ok()?;
        Some(&mut self.state.vehicles[index])
    }

    fn remove(&mut self, id: VehicleId) {
        let Ok(index) = self.state.vehicles.binary_search_by_key(&id, |vehicle| vehicle.state.id) else {
            return;
        };
        self.state.vehicles.remove(index).leave(&mut self.state.physics);
        self.state.setups.retain(|setup| setup.id != id);
        let time_s = self.time_s();
        self.state.pending.push(Event { time_s, vehicle: id, kind: EventKind::Remove });
        self.roster = self.state.roster(&self.experiment);
    }

    /// Writes what a snapshot has beside its events and vehicles, whose digest is given.
    fn describe(&self, out: &mut FrameSnapshot, mut hash: StateHash) {
        out.tick = self.state.tick;
        out.time_s = self.time_s();
        out.signals.clone_from(&self.state.signals.aspects);
        if !Arc::ptr_eq(&out.roster, &self.roster) {
            out.roster = Arc::clone(&self.roster);
        }
        self.state.collisions.digest(&mut hash);
        out.state_hash = hash.finish();
    }
}

fn followed_trajectory(command: &SimCommand) -> Option<&Trajectory> {
    if let SimCommand::Follow(trajectory) = command { Some(trajectory) } else { None }
}

impl WorldState {
    fn describe_vehicles(&self, states: &mut Vec<VehicleState>) -> StateHash {
        describe_vehicles(self.tick, (&self.vehicles, &self.physics), states)
    }

    fn initial(experiment: &Experiment, solids: &StaticObstacles) -> Self {
        let mut physics = Physics::new(experiment.rates.dt_s());
        for solid in solids.iter() {
            physics.add_static_polygon(&solid.polygon, solid.height_m);
        }
        let event = |vehicle, kind| Event { time_s: 0.0, vehicle, kind };
        let mut pending = Vec::new();
        let mut vehicles = Vec::with_capacity(experiment.vehicles.len());
        for planned in &experiment.vehicles {
            pending.push(event(planned.id, EventKind::Spawn));
            let setup = planned.setup(&experiment.city_map, experiment.scale);
            let mut vehicle = SimVehicle::spawn(&setup, &mut physics, experiment, vehicles.last());
            if planned.is_human {
                vehicle.start_manual();
            }
            vehicles.push(vehicle);
        }
        for moved in &experiment.moved {
            pending.push(event(moved.vehicle, EventKind::Moved { behind: moved.behind, by_m: moved.by_m }));
        }
        let (collisions, signals) =
            (Collisions::default(), ShownSignals::new(experiment.city_map.signals.len()));
        Self {
            tick: 0,
            is_running: false,
            physics,
            vehicles,
            setups: Vec::new(),
            collisions,
            signals,
            pending,
        }
    }

    /// Adds a vehicle with a new id.
    fn spawn(&mut self, experiment: &Experiment, setup: Setup) {
        let time_s = experiment.rates.time_s(self.tick);
        self.pending.push(Event { time_s, vehicle: setup.id, kind: EventKind::Spawn });
        let index = self.vehicles.partition_point(|vehicle| vehicle.state.id < setup.id);
        let vehicle = SimVehicle::spawn(&setup, &mut self.physics, experiment, self.vehicles.last());
        // It may come into the midst of others: who is really near is found after the next step.
        self.vehicles.iter_mut().for_each(|other| other.hold_if(true, &mut self.physics));
        self.vehicles.insert(index, vehicle);
        self.setups.push(setup);
    }

    /// The static data of the present vehicles.
    fn roster(&self, experiment: &Experiment) -> Arc<Vec<VehicleInfo>> {
        let is_there =
            |id| self.vehicles.binary_search_by_key(&id, |vehicle: &SimVehicle| vehicle.state.id).is_ok();
        let planned = experiment.vehicles.iter().filter(|planned| is_there(planned.id));
        let planned = planned
            .map(|planned| VehicleInfo::of(planned.id, &planned.name, planned.appearance, &planned.spec));
        let set_up = self
            .setups
            .iter()
            .map(|setup| VehicleInfo::of(setup.id, &setup.name, setup.appearance, &setup.spec));
        let mut roster: Vec<VehicleInfo> = planned.chain(set_up).collect();
        roster.sort_by_key(|info| info.id);
        Arc::new(roster)
    }
}
