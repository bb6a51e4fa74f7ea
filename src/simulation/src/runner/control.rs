//! Control loop: control framework and environment, the part of a run in the laboratory's computer, whether the city is
//! in the same process or not.

use crate::demand::Demand;
use crate::environment::Environment;
use crate::scenario::{Experiment, PlannedVehicle};
use city3d_control::{Mainframe, SetupError};
use city3d_protocol::snapshot::{SimCommand, VehicleId};
use city3d_protocol::wire::{Measurement, Message};
use std::collections::BTreeSet;
use std::sync::Arc;

/// Control framework of an experiment with its environment, stepped once per tick.
#[derive(Debug)]
pub struct ControlLoop {
    mainframe: Mainframe,
    /// Who comes and goes.
    demand: Demand,
    environment: Environment,
    ticks_per_control: u64,
    /// Physical vehicles: their real link replaces the environment.
    physical: BTreeSet<VehicleId>,
    /// True poses of the present control step.
    seen: Vec<Measurement>,
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
        let mut mainframe = Mainframe::with_algorithms(map, setups, rules, algorithms)?;
        mainframe.set_workers(experiment.workers.clone());
        Ok(Self {
            mainframe,
            demand: Demand::new(experiment)?,
            environment: Environment::new(experiment.environment, experiment.seed),
            ticks_per_control: experiment.rates.ticks_per_control(),
            physical: experiment.physical().map(|(planned, _)| planned.id).collect(),
            seen: Vec::new(),
            measurements: Vec::new(),
            messages: Vec::new(),
        })
    }

    /// The vehicles are on their way already, and may stand. `before` is the control loop that they had in this process, if
    /// there was one: whom it has held waits on.
    pub fn resume(&mut self, before: Option<&Self>) {
        self.mainframe.expect_under_way();
        self.demand.resume(before.map(|before| &before.demand));
    }

    /// Steps one tick: makes a control step with the visible poses when one is due, and adds to `delivered` the
    /// messages that arrive at the vehicles now, and commands to take vehicles out of the city. [`Self::entering`] has those
    /// who enter it.
    pub fn step(
        &mut self,
        (tick, time_s): (u64, f64),
        seen: impl Iterator<Item = Measurement>,
        delivered: &mut Vec<Message>,
    ) {
        self.messages.clear();
        self.demand.begin_step();
        if tick.is_multiple_of(self.ticks_per_control) {
            self.measurements.clear();
            self.seen.clear();
            self.seen.extend(seen);
            self.demand.step(time_s, &self.seen, &mut self.mainframe, delivered);
            let is_physical = |seen: &&Measurement| self.physical.contains(&seen.vehicle);
            let virtual_ones = self.seen.iter().filter(|seen| !is_physical(seen)).copied();
            self.environment.measure(time_s, virtual_ones, &mut self.measurements);
            self.measurements.extend(self.seen.iter().filter(is_physical));
            // What is late may be of a vehicle that has left meanwhile.
            self.measurements.retain(|measured| !self.demand.has_left(measured.vehicle));
            self.mainframe.step(time_s, &self.measurements, &mut self.messages);
        }
        // Signals are wired.
        let is_direct =
            |message: &mut Message| message.vehicle().is_none_or(|vehicle| self.physical.contains(&vehicle));
        delivered.extend(self.messages.extract_if(.., is_direct));
        self.environment.command(time_s, self.messages.drain(..), delivered);
    }

    /// Takes back commands that have been applied, for the space of their points.
    pub fn reuse(&mut self, applied: impl Iterator<Item = SimCommand>) {
        self.mainframe.reuse(applied.filter_map(|command| match command {
            SimCommand::Follow(trajectory) => Some(trajectory.into_spare()),
            _ => None,
        }));
    }

    /// The vehicles that enter the city with the present tick, each at its entry and with its entry speed.
    pub fn entering(&self) -> &[PlannedVehicle] {
        self.demand.entering()
    }

    /// Who comes and goes.
    pub fn demand(&self) -> &Demand {
        &self.demand
    }

    /// Switches to the drivers, rules, environment, seed and coming arrivals of another experiment.
    ///
    /// # Errors
    /// When a vehicle names an unknown algorithm.
    pub fn change(&mut self, experiment: &Experiment) -> Result<(), SetupError> {
        self.environment.change(experiment.environment, experiment.seed);
        self.demand.change(experiment);
        let mut setups = experiment.cav_setups();
        let inside = self.demand.inside().filter_map(|vehicle| experiment.arrival(vehicle.id));
        setups.extend(inside.map(|arrival| arrival.vehicle.cav_setup(experiment.scale)));
        self.mainframe.change(setups, experiment.rules())
    }

    /// The control framework, with the vehicles and their present routes.
    pub fn mainframe(&self) -> &Mainframe {
        &self.mainframe
    }
}
