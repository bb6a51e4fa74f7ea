//! What has become of the arrivals of inflows: who has entered, who has left, and how long they were held.

use crate::scenario::{Experiment, PlannedArrival, PlannedVehicle};
use city3d_protocol::snapshot::{Event, FrameSnapshot, VehicleId};
use serde::Serialize;
use std::fmt;
use std::sync::Arc;

/// Totals of one inflow.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct InflowTotals {
    /// Vehicles that have arrived at the entry.
    pub arrived: u32,
    /// Those of them that have entered the city.
    pub entered: u32,
    /// Those of them that have left it.
    pub left: u32,
    /// Those that wait at the entry now.
    pub held: u32,
    /// Mean time at the entry of all that have arrived, also of those that still wait, simulated seconds.
    pub mean_held_s: f64,
    /// Longest time at the entry, likewise.
    pub max_held_s: f64,
}

impl fmt::Display for InflowTotals {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { arrived, entered, left, held, mean_held_s, max_held_s } = self;
        write!(
            f,
            "{arrived} arrived, {entered} entered, {left} left, {held} held; held for {mean_held_s:.1} s in the "
        )?;
        write!(f, "mean, {max_held_s:.1} s at most")
    }
}

/// Follows the arrivals of a run by its events.
#[derive(Clone, Debug)]
pub struct InflowObserver {
    names: Vec<String>,
    arrivals: Arc<Vec<PlannedArrival>>,
    /// By arrival: how long it was held, once it has entered.
    held_s: Vec<Option<f64>>,
    /// By inflow.
    left: Vec<u32>,
    control_step_s: f64,
    /// Times of the first and the last snapshot.
    span_s: Option<[f64; 2]>,
}

impl InflowObserver {
    pub(super) fn new(experiment: &Experiment) -> Self {
        Self {
            names: experiment.inflows.iter().map(|inflow| inflow.name.clone()).collect(),
            arrivals: Arc::clone(&experiment.arrivals),
            held_s: vec![None; experiment.arrivals.len()],
            left: vec![0; experiment.inflows.len()],
            control_step_s: experiment.rates.dt_s() * experiment.rates.ticks_per_control() as f64,
            span_s: None,
        }
    }

    /// The vehicle of an arrival, if this is one.
    pub(super) fn arrival(&self, id: VehicleId, name: &str) -> Option<&PlannedVehicle> {
        let vehicle = &self.arrivals[self.index_of(id)?].vehicle;
        (vehicle.name == name).then_some(vehicle)
    }

    fn index_of(&self, id: VehicleId) -> Option<usize> {
        self.arrivals.binary_search_by_key(&id, |arrival| arrival.vehicle.id).ok()
    }

    pub(super) fn advance_to(&mut self, snapshot: &FrameSnapshot) {
        // A run is observed from its first tick on.
        let begin_s = if snapshot.tick <= 1 { 0.0 } else { snapshot.time_s };
        self.span_s.get_or_insert([begin_s; 2])[1] = snapshot.time_s;
    }

    pub(super) fn note_entry(&mut self, event: &Event) {
        if let Some(index) = self.index_of(event.vehicle) {
            let due_s = self.due_s(self.arrivals[index].time_s);
            self.held_s[index] = Some((event.time_s - due_s).max(0.0));
        }
    }

    pub(super) fn note_leaving(&mut self, event: &Event) {
        if let Some(index) = self.index_of(event.vehicle).filter(|index| self.held_s[*index].is_some()) {
            self.left[self.arrivals[index].inflow] += 1;
        }
    }

    /// The control step at which an arrival can enter at the earliest.
    fn due_s(&self, time_s: f64) -> f64 {
        (time_s / self.control_step_s - 1e-6).ceil() * self.control_step_s
    }

    /// How long a vehicle was held at its entry; `None` of one that came by no inflow.
    pub fn held_s(&self, id: VehicleId) -> Option<f64> {
        self.held_s[self.index_of(id)?]
    }

    /// The arrival of a vehicle; `None` of one that came by no inflow.
    pub fn planned(&self, id: VehicleId) -> Option<&PlannedArrival> {
        Some(&self.arrivals[self.index_of(id)?])
    }

    /// Name of an inflow.
    ///
    /// # Panics
    /// If there is no inflow with this index.
    pub fn name(&self, inflow: usize) -> &str {
        &self.names[inflow]
    }

    /// Names and totals of the inflows, in the order of the scenario.
    pub fn totals(&self) -> Vec<(&str, InflowTotals)> {
        let [begin_s, now_s] = self.span_s.unwrap_or_default();
        let mut totals = vec![InflowTotals::default(); self.names.len()];
        let mut sums_s = vec![0.0; self.names.len()];
        for (arrival, entered_s) in self.arrivals.iter().zip(&self.held_s) {
            if arrival.time_s > now_s {
                break;
            }
            // Who was due before the run was observed, and did not enter since, is none of it.
            if entered_s.is_none() && arrival.time_s < begin_s {
                continue;
            }
            let of = &mut totals[arrival.inflow];
            of.arrived += 1;
            let held_s = entered_s.unwrap_or_else(|| (now_s - self.due_s(arrival.time_s)).max(0.0));
            if entered_s.is_some() {
                of.entered += 1;
            } else {
                of.held += 1;
            }
            sums_s[arrival.inflow] += held_s;
            of.max_held_s = of.max_held_s.max(held_s);
        }
        for ((of, sum_s), left) in totals.iter_mut().zip(sums_s).zip(&self.left) {
            of.left = *left;
            of.mean_held_s = sum_s / f64::from(of.arrived.max(1));
        }
        self.names.iter().map(String::as_str).zip(totals).collect()
    }
}
