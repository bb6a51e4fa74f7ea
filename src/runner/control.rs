//! The control framework and what stands between it and the vehicles: the part of a run that is in the
//! laboratory's computer, whether the city is in the same process or not.

use crate::environment::Environment;
use crate::mainframe::{Mainframe, SetupError};
use crate::scenario::Experiment;
use crate::wire::{Measurement, Message};
use std::sync::Arc;

/// Control of an experiment, tick by tick.
#[derive(Debug)]
pub struct Control {
    mainframe: Mainframe,
    environment: Environment,
    ticks_per_control: u64,
    measurements: Vec<Measurement>,
    messages: Vec<Message>,
}

impl Control {
    /// # Errors
    /// When the control framework cannot take a vehicle's setup.
    pub fn new(experiment: &Experiment) -> Result<Self, SetupError> {
        let map = Arc::clone(&experiment.lab_map);
        Ok(Self {
            mainframe: Mainframe::new(map, experiment.cav_setups(), experiment.right_of_way)?,
            environment: Environment::new(experiment.environment, experiment.seed),
            ticks_per_control: experiment.rates.ticks_per_control(),
            measurements: Vec::new(),
            messages: Vec::new(),
        })
    }

    /// What happens at one tick: a control step with the poses seen then, when one is due, and in any case
    /// the messages that arrive at the vehicles now, added to `delivered`.
    pub fn step(
        &mut self,
        (tick, time_s): (u64, f64),
        seen: impl Iterator<Item = Measurement>,
        delivered: &mut Vec<Message>,
    ) {
        self.messages.clear();
        if tick.is_multiple_of(self.ticks_per_control) {
            self.measurements.clear();
            self.environment.measure(time_s, seen, &mut self.measurements);
            self.mainframe.step(time_s, &self.measurements, &mut self.messages);
        }
        self.environment.command(time_s, self.messages.drain(..), delivered);
    }

    /// Goes on as another experiment's control: its drivers, rules, environment and seed.
    ///
    /// # Errors
    /// When a vehicle names an unknown algorithm.
    pub fn change(&mut self, experiment: &Experiment) -> Result<(), SetupError> {
        self.environment.change(experiment.environment, experiment.seed);
        self.mainframe.change(experiment.cav_setups(), experiment.right_of_way)
    }

    pub fn mainframe(&self) -> &Mainframe {
        &self.mainframe
    }
}
