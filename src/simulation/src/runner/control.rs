//! Control loop: control framework and environment, the part of a run in the laboratory's computer, whether the city is
//! in the same process or not.

use crate::environment::Environment;
use crate::scenario::Experiment;
use city3d_control::{Mainframe, SetupError};
use city3d_protocol::snapshot::VehicleId;
use city3d_protocol::wire::{Measurement, Message};
use std::collections::BTreeSet;
use std::sync::Arc;

/// Control framework of an experiment with its environment, stepped once per tick.
#[derive(Debug)]
pub struct ControlLoop {
    mainframe: Mainframe,
    environment: Environment,
    ticks_per_control: u64,
    /// Physical vehicles: their real link replaces the environment.
    physical: BTreeSet<VehicleId>,
    measurements: Vec<Measurement>,
    messages: Vec<Message>,
}

impl ControlLoop {
    /// Control loop before its first step, with nothing in transit.
    ///
    /// # Errors
    /// When the control framework cannot take a vehicle's setup.
    pub fn new(experiment: &Experiment) -> Result<Self, SetupError> {
        let (map, algorithms) = (Arc::clone(&experiment.lab_map), experiment.algorithms.clone());
        let (setups, rules) = (experiment.cav_setups(), experiment.rules());
        Ok(Self {
            mainframe: Mainframe::with_algorithms(map, setups, rules, algorithms)?,
            environment: Environment::new(experiment.environment, experiment.seed),
            ticks_per_control: experiment.rates.ticks_per_control(),
            physical: experiment.physical().map(|(planned, _)| planned.id).collect(),
            measurements: Vec::new(),
            messages: Vec::new(),
        })
    }

    /// The vehicles are on their way already, and may stand.
    pub fn resume(&mut self) {
        self.mainframe.expect_standing();
    }

    /// Steps one tick: makes a control step with the visible poses when one is due, and adds to `delivered` the
    /// messages that arrive at the vehicles now.
    pub fn step(
        &mut self,
        (tick, time_s): (u64, f64),
        seen: impl Iterator<Item = Measurement>,
        delivered: &mut Vec<Message>,
    ) {
        self.messages.clear();
        if tick.is_multiple_of(self.ticks_per_control) {
            self.measurements.clear();
            let (physical, mut measured) = (&self.physical, Vec::new());
            let seen = seen.filter(|seen| {
                let is_physical = physical.contains(&seen.vehicle);
                measured.extend(is_physical.then_some(*seen));
                !is_physical
            });
            self.environment.measure(time_s, seen, &mut self.measurements);
            self.measurements.append(&mut measured);
            self.mainframe.step(time_s, &self.measurements, &mut self.messages);
        }
        // Signals are wired.
        let is_direct =
            |message: &mut Message| message.vehicle().is_none_or(|vehicle| self.physical.contains(&vehicle));
        delivered.extend(self.messages.extract_if(.., is_direct));
        self.environment.command(time_s, self.messages.drain(..), delivered);
    }

    /// Switches to the drivers, right of way, platoons, environment and seed of another experiment.
    ///
    /// # Errors
    /// When a vehicle names an unknown algorithm.
    pub fn change(&mut self, experiment: &Experiment) -> Result<(), SetupError> {
        self.environment.change(experiment.environment, experiment.seed);
        self.mainframe.change(experiment.cav_setups(), experiment.rules())
    }

    /// The control framework, with the vehicles and their present routes.
    pub fn mainframe(&self) -> &Mainframe {
        &self.mainframe
    }
}
