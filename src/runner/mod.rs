//! Lockstep of world, environment and control framework, without clocks or threads: a run is exactly
//! repeatable and as fast as the machine.

mod observer;
mod summary;

pub use observer::{LaneUse, Observer, VehicleTotals};
pub use summary::{Summary, VehicleSummary};

use crate::environment::Environment;
use crate::mainframe::{Mainframe, SetupError};
use crate::scenario::Experiment;
use crate::sim::World;
use crate::snapshot::{FrameSnapshot, SimCommand};
use crate::wire::{Measurement, Message};
use std::sync::Arc;

/// One run of an experiment in lockstep.
#[derive(Debug)]
pub struct Run {
    world: World,
    mainframe: Mainframe,
    environment: Environment,
    snapshot: FrameSnapshot,
    commands: Vec<SimCommand>,
    /// Given from outside, for the next tick.
    injected: Vec<SimCommand>,
    measurements: Vec<Measurement>,
    messages: Vec<Message>,
    delivered: Vec<Message>,
}

impl Run {
    /// A run at its initial conditions.
    ///
    /// # Errors
    /// When the control framework cannot take a vehicle's setup.
    pub fn new(experiment: Arc<Experiment>) -> Result<Self, SetupError> {
        let world = World::new(experiment);
        let (mainframe, environment) = control_of(world.experiment())?;
        Ok(Self {
            snapshot: world.snapshot(),
            world,
            mainframe,
            environment,
            commands: Vec::new(),
            injected: vec![SimCommand::Start],
            measurements: Vec::new(),
            messages: Vec::new(),
            delivered: Vec::new(),
        })
    }

    /// Back to the initial conditions: the run that follows equals the first one exactly.
    ///
    /// # Errors
    /// As for [`Run::new`].
    pub fn reset(&mut self) -> Result<(), SetupError> {
        (self.mainframe, self.environment) = control_of(self.world.experiment())?;
        self.world.tick_into(&[SimCommand::Reset], &mut self.snapshot);
        self.injected = vec![SimCommand::Start];
        Ok(())
    }

    /// Adds a command to those of the next tick, after the ones of the control framework.
    pub fn inject(&mut self, command: SimCommand) {
        self.injected.push(command);
    }

    /// One physics step, with a control step before it when one is due.
    pub fn step(&mut self) -> &FrameSnapshot {
        let experiment = Arc::clone(self.world.experiment());
        let (time_s, scale) = (self.world.time_s(), experiment.scale);
        self.measurements.clear();
        self.messages.clear();
        self.delivered.clear();
        self.commands.clear();
        if self.world.tick().is_multiple_of(experiment.rates.ticks_per_control()) {
            let seen = Measurement::all(&self.snapshot, scale);
            self.environment.measure(time_s, seen, &mut self.measurements);
            self.mainframe.step(time_s, &self.measurements, &mut self.messages);
        }
        self.environment.command(time_s, self.messages.drain(..), &mut self.delivered);
        self.commands.extend(self.delivered.drain(..).map(|message| message.into_command(scale)));
        self.commands.append(&mut self.injected);
        self.world.tick_into(&self.commands, &mut self.snapshot);
        &self.snapshot
    }

    /// The commands of the last step.
    pub fn commands(&self) -> &[SimCommand] {
        &self.commands
    }

    pub fn snapshot(&self) -> &FrameSnapshot {
        &self.snapshot
    }

    pub fn world(&self) -> &World {
        &self.world
    }

    pub fn mainframe(&self) -> &Mainframe {
        &self.mainframe
    }

    pub fn experiment(&self) -> &Arc<Experiment> {
        self.world.experiment()
    }
}

fn control_of(experiment: &Experiment) -> Result<(Mainframe, Environment), SetupError> {
    let map = Arc::clone(&experiment.lab_map);
    let mainframe = Mainframe::new(map, experiment.cav_setups(), experiment.right_of_way)?;
    Ok((mainframe, Environment::new(experiment.environment, experiment.seed)))
}
