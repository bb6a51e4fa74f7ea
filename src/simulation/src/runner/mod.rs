//! Runs world, environment and control framework in lockstep, without clocks or threads: a run is exactly repeatable
//! and as fast as the machine.

mod control;
mod held;
mod inflow_totals;
mod observed;
mod observer;
mod outcome;
mod poses;
mod server_world;
mod summary;

pub use city3d_control::coordination::CoordinationReport;
pub use control::ControlLoop;
pub use held::{HeldControl, HeldDecisions, HeldPlans};
pub use inflow_totals::{InflowObserver, InflowTotals};
pub use observed::{ObservedCity, ObservedMotion};
pub use observer::{LaneUse, Observer, VehicleTotals};
pub use outcome::{MergingStreams, RunMetrics, TrafficMetrics};
pub use poses::pose_bodies;
pub use server_world::{
    AppliedBody, FIRST_PAGE_GUEST, MOTION_CAPTURE, OPERATOR, SenderNumber, ServerRules, ServerWorld, TOPICS,
};
pub use summary::{
    ArrivalSummary, EndSummary, LinkSummary, PicturesSummary, RosSummary, Summary, TickLateness,
    VehicleSummary,
};

use crate::demand::Demand;
use crate::scenario::Experiment;
use crate::sim::World;
use crate::testbed::{ExperimentClock, Testbed};
use city3d_control::{Mainframe, SetupError};
use city3d_protocol::snapshot::{FrameSnapshot, SimCommand, Status, VehicleId};
use city3d_protocol::wire::{Measurement, Message};
use city3d_workers::prefetch_slice;
use std::collections::BTreeSet;
use std::sync::Arc;

/// So many messages before its turn a message's points are asked for.
const MESSAGES_AHEAD: usize = 4;

/// One run of an experiment in lockstep.
///
/// Robots of [`testbed`](crate::testbed) stand in for physical vehicles.
///
/// ```
/// use city3d_simulation::runner::Run;
/// use city3d_simulation::scenario::{Library, Overrides, read_experiment};
/// use std::sync::Arc;
///
/// let (text, library) = Library::scenario("straight")?;
/// let experiment = read_experiment("straight", &text, &library, Overrides::default())?;
/// let mut run = Run::new(Arc::new(experiment))?;
/// for _ in 0..100 {
///     run.step();
/// }
/// let snapshot = run.snapshot();
/// assert_eq!((snapshot.tick, snapshot.time_s), (100, 1.0));
/// assert!(snapshot.vehicles.iter().all(|vehicle| vehicle.speed_mps > 0.0));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Run {
    world: World,
    control: ControlLoop,
    snapshot: FrameSnapshot,
    commands: Vec<SimCommand>,
    /// External commands for the next tick.
    injected: Vec<SimCommand>,
    /// Vehicles whose trajectories come from outside.
    withheld: BTreeSet<VehicleId>,
    delivered: Vec<Message>,
    /// Emulates the physical vehicles, where there are any.
    testbed: Option<Testbed>,
    /// Poses of the physical vehicles.
    measured: Vec<Measurement>,
}

impl Run {
    /// A run at its initial conditions.
    ///
    /// # Errors
    /// When the control framework cannot take a vehicle's setup.
    pub fn new(experiment: Arc<Experiment>) -> Result<Self, SetupError> {
        let world = World::new(experiment);
        let control = ControlLoop::new(world.experiment())?;
        let testbed = testbed_of(world.experiment());
        Ok(Self {
            snapshot: world.snapshot(),
            world,
            control,
            commands: Vec::new(),
            injected: vec![SimCommand::Start],
            withheld: BTreeSet::new(),
            delivered: Vec::new(),
            testbed,
            measured: Vec::new(),
        })
    }

    /// Resumes a run: from a world without physical vehicles, and its control loop.
    pub fn resume(world: World, control: ControlLoop) -> Self {
        Self {
            snapshot: world.snapshot(),
            world,
            control,
            commands: Vec::new(),
            injected: Vec::new(),
            withheld: BTreeSet::new(),
            delivered: Vec::new(),
            testbed: None,
            measured: Vec::new(),
        }
    }

    /// Resets to the initial conditions; the run after it repeats the first one exactly.
    ///
    /// # Errors
    /// As for [`Run::new`].
    pub fn reset(&mut self) -> Result<(), SetupError> {
        self.control = ControlLoop::new(self.world.experiment())?;
        self.testbed = testbed_of(self.world.experiment());
        self.measured.clear();
        self.world.tick_into(&[SimCommand::Reset], &mut self.snapshot);
        self.injected = vec![SimCommand::Start];
        self.withheld.clear();
        Ok(())
    }

    /// From now on a vehicle does not get the trajectories of the control framework, because others come for it by
    /// [`Self::inject`], or gets them again. The control framework goes on to plan for it. A reset ends it.
    pub fn withhold(&mut self, vehicle: VehicleId, is_withheld: bool) {
        if is_withheld {
            self.withheld.insert(vehicle);
        } else {
            self.withheld.remove(&vehicle);
        }
    }

    /// Adds a command to those of the next tick, after the ones of the control framework.
    pub fn inject(&mut self, command: SimCommand) {
        self.injected.push(command);
    }

    /// One physics step, with a control step before it when one is due.
    pub fn step(&mut self) -> &FrameSnapshot {
        let experiment = Arc::clone(self.world.experiment());
        let vehicles = self.snapshot.vehicles.len();
        experiment.workers.at_hand(vehicles, || self.step_at_hand(&experiment));
        &self.snapshot
    }

    fn step_at_hand(&mut self, experiment: &Experiment) {
        let scale = experiment.scale;
        self.delivered.clear();
        self.control.reuse(self.commands.drain(..));
        let now = (self.world.tick(), self.world.time_s());
        // Motion capture measures only the visible vehicles.
        let seen = self.snapshot.vehicles.iter().filter(|state| state.status != Status::Unseen);
        let seen = seen.map(|state| Measurement::of(state, now.1, scale));
        self.control.step(now, seen, &mut self.delivered);
        if !self.withheld.is_empty() {
            let withheld = &self.withheld;
            let is_withheld = |message: &Message| matches!(message, Message::Follow(trajectory) if withheld.contains(&trajectory.vehicle));
            self.delivered.retain(|message| !is_withheld(message));
        }
        self.commands.extend(self.measured.drain(..).map(|pose| pose.into_command(scale)));
        if let Some(testbed) = &mut self.testbed {
            testbed.set_clock(ExperimentClock { time_s: now.1, is_running: true });
            for message in &self.delivered {
                if let Message::Follow(trajectory) = message {
                    testbed.follow(trajectory);
                }
            }
            testbed.step(&mut self.measured);
        }
        self.add_delivered(experiment);
        let city_map = &experiment.city_map;
        let entering = self.control.entering().iter().map(|vehicle| vehicle.setup(city_map, scale));
        self.commands.extend(entering.map(|setup| SimCommand::Spawn(Box::new(setup))));
        self.commands.append(&mut self.injected);
        self.commands.sort_by_key(SimCommand::order);
        self.world.tick_into(&self.commands, &mut self.snapshot);
    }

    /// Makes the delivered messages into commands, which is a pass over all their points, on all threads.
    fn add_delivered(&mut self, experiment: &Experiment) {
        let Self { delivered, commands, .. } = self;
        let first = commands.len();
        // Both lists keep their places while the threads exchange what is in them.
        commands.resize_with(first + delivered.len(), || SimCommand::Pause);
        experiment.workers.each_group_of_two((delivered, &mut commands[first..]), |delivered, commands| {
            for (k, command) in commands.iter_mut().enumerate() {
                if let Some(Message::Follow(coming)) = delivered.get(k + MESSAGES_AHEAD) {
                    prefetch_slice(&coming.points);
                }
                let taken = Message::Remove(VehicleId::default());
                *command = std::mem::replace(&mut delivered[k], taken).into_command(experiment.scale);
            }
        });
        delivered.clear();
    }

    /// The commands of the last step, in the order in which they were applied.
    pub fn commands(&self) -> &[SimCommand] {
        &self.commands
    }

    /// Snapshot after the last step, or of the initial conditions.
    pub fn snapshot(&self) -> &FrameSnapshot {
        &self.snapshot
    }

    /// The simulated vehicles, their physics and the clock.
    pub fn world(&self) -> &World {
        &self.world
    }

    /// The control framework, with the vehicles and their present routes.
    pub fn mainframe(&self) -> &Mainframe {
        self.control.mainframe()
    }

    /// Who comes and goes.
    pub fn demand(&self) -> &Demand {
        self.control.demand()
    }

    /// The validated scenario of the run.
    pub fn experiment(&self) -> &Arc<Experiment> {
        self.world.experiment()
    }
}

/// Emulates the physical vehicles of an experiment, where it has any.
fn testbed_of(experiment: &Experiment) -> Option<Testbed> {
    experiment.physical().next().map(|_| Testbed::new(experiment))
}

#[cfg(test)]
mod tests;
