//! Demand: lets the vehicles of inflows into the city, holds those for which there is no room, and takes out vehicles that
//! have come to the end of their routes.
//!
//! It is part of the laboratory's computer. It knows the true poses, because entries and exits are no matter of
//! communication: its commands pass no environment. They are repeated until the poses show them carried out.

mod entry;
mod sightings;

use crate::scenario::{Experiment, PlannedArrival, PlannedVehicle};
use city3d_control::{Cav, Mainframe, SetupError};
use city3d_geometry::LengthScale;
use city3d_protocol::snapshot::VehicleId;
use city3d_protocol::wire::{Measurement, Message};
use city3d_roadmap::{CityMap, LabMap};
use entry::Entry;
use sightings::{Sighting, Sightings, VehicleTraits};
use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

/// A command that the poses do not show carried out is repeated after this time.
const REPEAT_S: f64 = 0.1;
/// A vehicle leaves when its front bumper has come this close to the end of its route, laboratory metres.
const AT_END_M: f64 = 1e-3;
/// It must be this near to the end by the estimate of the control framework too: a route may pass a lane twice.
const NEAR_END_M: f64 = 0.5;
/// Others this far from an entry do not matter, laboratory metres.
const AROUND_ENTRY_M: f64 = 8.0;
/// Rounding of times.
const ROUNDING_S: f64 = 1e-9;

/// What has become of an arrival.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ArrivalState {
    /// Its time has not come.
    Planned,
    /// It waits for room at its entry.
    Held,
    /// It was let in, and no pose has shown it yet.
    Entering,
    Inside,
    Left,
}

/// An arrival that was let in and has not been seen.
#[derive(Clone, Debug)]
struct Pending {
    index: usize,
    vehicle: PlannedVehicle,
    asked_s: f64,
}

/// The front of an inflow's queue: the arrival, and its entry.
#[derive(Clone, Debug)]
struct Candidate {
    index: usize,
    entry: Entry,
}

/// Vehicles that come and go.
#[derive(Clone, Debug)]
pub struct Demand {
    map: Arc<LabMap>,
    city_map: Arc<CityMap>,
    scale: LengthScale,
    arrivals: Arc<Vec<PlannedArrival>>,
    /// By arrival.
    states: Vec<ArrivalState>,
    /// The first arrival whose time has not come.
    next: usize,
    /// Held arrivals by inflow, in order of time.
    queues: Vec<VecDeque<usize>>,
    /// Fronts of the queues, by inflow.
    candidates: Vec<Option<Candidate>>,
    pending: Vec<Pending>,
    /// Vehicles that are there from the beginning; those that leave have a state.
    planned: BTreeMap<VehicleId, (VehicleTraits, Option<ArrivalState>)>,
    sightings: Sightings,
    /// The vehicles that enter in this step, each at its entry speed.
    entering: Vec<PlannedVehicle>,
    /// The next step is the first one of a city that has been running.
    is_resumed: bool,
    /// Nobody comes and nobody leaves.
    is_idle: bool,
}

impl Demand {
    /// Before the first step: everybody is yet to come.
    ///
    /// # Errors
    /// When an arrival names an unknown control algorithm or has no route.
    pub fn new(experiment: &Experiment) -> Result<Self, SetupError> {
        let arrivals = Arc::clone(&experiment.arrivals);
        for vehicle in arrivals.iter().map(|arrival| &arrival.vehicle) {
            let drivers = &experiment.algorithms.drivers;
            if !drivers.knows(&vehicle.controller) {
                let (name, known) =
                    (vehicle.controller.clone(), drivers.names().map(str::to_owned).collect());
                return Err(SetupError::UnknownController { vehicle: vehicle.id, name, known });
            }
            if vehicle.route.is_empty() {
                return Err(SetupError::EmptyRoute { vehicle: vehicle.id });
            }
        }
        let planned = experiment.vehicles.iter().map(|planned| {
            let state = planned.leaves.then_some(ArrivalState::Inside);
            (planned.id, (VehicleTraits::of(planned, experiment.scale), state))
        });
        let inflows = experiment.inflows.len();
        Ok(Self {
            map: Arc::clone(&experiment.lab_map),
            city_map: Arc::clone(&experiment.city_map),
            scale: experiment.scale,
            states: vec![ArrivalState::Planned; arrivals.len()],
            next: 0,
            queues: vec![VecDeque::new(); inflows],
            candidates: vec![None; inflows],
            pending: Vec::new(),
            planned: planned.collect(),
            sightings: Sightings::default(),
            entering: Vec::new(),
            is_resumed: false,
            is_idle: arrivals.is_empty() && !experiment.vehicles.iter().any(|planned| planned.leaves),
            arrivals,
        })
    }

    /// The city has been running: the vehicles that are there are taken over. Arrivals that have waited under `before` keep
    /// waiting; others that were due and are not there have left, or do not come.
    pub fn resume(&mut self, before: Option<&Self>) {
        self.is_resumed = true;
        if let Some(before) = before.filter(|before| before.states.len() == self.states.len()) {
            self.states.clone_from(&before.states);
        } else {
            self.states.fill(ArrivalState::Left);
        }
    }

    /// Goes on with the arrivals of another experiment, whose past is the same.
    pub fn change(&mut self, experiment: &Experiment) {
        let is_same = |index: usize| {
            let (old, new) = (&self.arrivals[index], experiment.arrivals.get(index));
            new.is_some_and(|new| old.time_s == new.time_s && old.vehicle.id == new.vehicle.id)
        };
        if !(0..self.next).all(is_same) || experiment.inflows.len() != self.queues.len() {
            return;
        }
        self.arrivals = Arc::clone(&experiment.arrivals);
        self.states.resize(self.arrivals.len(), ArrivalState::Planned);
        self.candidates.fill(None);
        self.is_idle &= self.arrivals.is_empty();
    }

    /// Forgets who has entered in the last step.
    pub fn begin_step(&mut self) {
        self.entering.clear();
    }

    /// One control step with the true poses: adds commands to take vehicles out, and tells the control framework who comes
    /// and goes. [`Self::entering`] has those who enter.
    pub fn step(
        &mut self,
        time_s: f64,
        seen: &[Measurement],
        mainframe: &mut Mainframe,
        messages: &mut Vec<Message>,
    ) {
        self.begin_step();
        if self.is_idle {
            return;
        }
        let (planned, arrivals, pending) = (&self.planned, &self.arrivals, &self.pending);
        self.sightings.update(seen, |id| {
            let entering = pending.iter().map(|pending| &pending.vehicle).find(|vehicle| vehicle.id == id);
            let arrival = || {
                let index = index_of(arrivals, id)?;
                Some(&arrivals[index].vehicle)
            };
            let known = planned.get(&id).map(|(traits, _)| *traits);
            let arrived = entering.or_else(arrival).map(|vehicle| VehicleTraits::of(vehicle, self.scale));
            known.or(arrived).unwrap_or_default()
        });
        if std::mem::take(&mut self.is_resumed) {
            self.take_over(time_s, mainframe);
        }
        self.settle_entries(time_s);
        self.let_out(mainframe, messages);
        self.let_in(time_s, mainframe);
    }

    /// The vehicles that enter the city in this step, each at its entry and with its entry speed.
    pub fn entering(&self) -> &[PlannedVehicle] {
        &self.entering
    }

    /// Whether a vehicle has left the city, so that late measurements of it do not count.
    pub fn has_left(&self, id: VehicleId) -> bool {
        if self.is_idle {
            return false;
        }
        let arrival = || Some(self.states[index_of(&self.arrivals, id)?]);
        let state = self.planned.get(&id).map_or_else(arrival, |(_, state)| *state);
        state == Some(ArrivalState::Left)
    }

    /// The arrivals that are in the city, in order of time.
    pub fn inside(&self) -> impl Iterator<Item = &PlannedVehicle> {
        let states = self.states.iter().zip(self.arrivals.iter());
        let inside = states.filter(|(state, _)| **state == ArrivalState::Inside);
        inside.map(|(_, arrival)| &arrival.vehicle)
    }

    /// Number of arrivals that wait at the entry of an inflow.
    pub fn held(&self, inflow: usize) -> usize {
        self.queues[inflow].len()
    }

    fn take_over(&mut self, time_s: f64, mainframe: &mut Mainframe) {
        self.next = self.arrivals.partition_point(|arrival| arrival.time_s <= time_s + ROUNDING_S);
        for index in 0..self.arrivals.len() {
            let arrival = &self.arrivals[index];
            let is_there = self.sightings.get(arrival.vehicle.id).is_some();
            self.states[index] = match self.states[index] {
                _ if index >= self.next => ArrivalState::Planned,
                _ if is_there => {
                    let setup = arrival.vehicle.cav_setup(self.scale);
                    // Checked when the demand was made.
                    let _ = mainframe.add(city3d_control::CavSetup { speed_mps: 0.0, ..setup });
                    ArrivalState::Inside
                }
                ArrivalState::Held | ArrivalState::Planned | ArrivalState::Entering => {
                    self.queues[arrival.inflow].push_back(index);
                    ArrivalState::Held
                }
                _ => ArrivalState::Left,
            };
        }
    }

    /// Entries that the poses show are done; others are asked for again.
    fn settle_entries(&mut self, time_s: f64) {
        for pending in &mut self.pending {
            if self.sightings.get(pending.vehicle.id).is_some() {
                self.states[pending.index] = ArrivalState::Inside;
            } else if time_s - pending.asked_s >= REPEAT_S - ROUNDING_S {
                pending.asked_s = time_s;
                self.entering.push(pending.vehicle.clone());
            }
        }
        let states = &self.states;
        self.pending.retain(|pending| states[pending.index] == ArrivalState::Entering);
    }

    /// Takes out vehicles at the ends of their routes, and those that have no business in the city.
    fn let_out(&mut self, mainframe: &mut Mainframe, messages: &mut Vec<Message>) {
        for sighting in self.sightings.iter() {
            let id = sighting.id;
            let index = index_of(&self.arrivals, id);
            let planned = self.planned.get_mut(&id).map(|(_, state)| state);
            let state = match (planned, index) {
                (Some(Some(state)), _) => state,
                (None, Some(index)) => &mut self.states[index],
                _ => continue,
            };
            match *state {
                ArrivalState::Inside => {
                    let cav = mainframe.cav(id).filter(|cav| cav.leaves);
                    if cav.is_some_and(|cav| is_at_end(&self.map, cav, sighting)) {
                        *state = ArrivalState::Left;
                        mainframe.remove(id);
                        messages.push(Message::Remove(id));
                    }
                }
                ArrivalState::Entering => {}
                // It was told to leave, or is left over from a run before.
                ArrivalState::Planned | ArrivalState::Held | ArrivalState::Left => {
                    messages.push(Message::Remove(id));
                }
            }
        }
    }

    /// Admits those who have room, each inflow one vehicle at a time; of several at one entry the first to come is first.
    fn let_in(&mut self, time_s: f64, mainframe: &mut Mainframe) {
        while let Some(arrival) = self.arrivals.get(self.next) {
            if arrival.time_s > time_s + ROUNDING_S {
                break;
            }
            if self.states[self.next] == ArrivalState::Planned {
                self.states[self.next] = ArrivalState::Held;
                self.queues[arrival.inflow].push_back(self.next);
            }
            self.next += 1;
        }
        let mut fronts: Vec<usize> = self.queues.iter().filter_map(|queue| queue.front().copied()).collect();
        fronts.sort_unstable();
        for index in fronts {
            let inflow = self.arrivals[index].inflow;
            if self.candidates[inflow].as_ref().is_none_or(|candidate| candidate.index != index) {
                self.candidates[inflow] = Some(self.candidate(index));
            }
            let Some(candidate) = &self.candidates[inflow] else { continue };
            let vehicle = &self.arrivals[index].vehicle;
            let at = candidate.entry.position();
            let coming = self.pending.iter().map(|pending| self.at_entry(pending));
            let is_near = |other: &Sighting| {
                other.id != vehicle.id && other.pose.position.distance(at) < AROUND_ENTRY_M
            };
            let others: Vec<Sighting> =
                self.sightings.iter().copied().chain(coming).filter(is_near).collect();
            let Some(speed_mps) = candidate.entry.speed(&self.map, &others) else { continue };
            let mut vehicle = vehicle.clone();
            vehicle.start.speed_mps = speed_mps;
            // Checked when the demand was made.
            let _ = mainframe.add(vehicle.cav_setup(self.scale));
            self.queues[inflow].pop_front();
            self.candidates[inflow] = None;
            self.states[index] = ArrivalState::Entering;
            self.entering.push(vehicle.clone());
            self.pending.push(Pending { index, vehicle, asked_s: time_s });
        }
    }

    fn candidate(&self, index: usize) -> Candidate {
        let vehicle = &self.arrivals[index].vehicle;
        let pose = vehicle.pose_in_lab(&self.city_map, self.scale);
        let width_m = VehicleTraits::of(vehicle, self.scale).width_m;
        let entry = Entry::new(&self.map, vehicle, (pose, width_m, vehicle.body_in_lab(self.scale)));
        Candidate { index, entry }
    }

    /// A vehicle that has been let in and not been seen: at its entry, and perhaps standing.
    fn at_entry(&self, pending: &Pending) -> Sighting {
        let pose = pending.vehicle.pose_in_lab(&self.city_map, self.scale);
        let traits = VehicleTraits::of(&pending.vehicle, self.scale);
        Sighting { id: pending.vehicle.id, stamp_s: pending.asked_s, pose, speed_mps: Some(0.0), traits }
    }
}

fn index_of(arrivals: &[PlannedArrival], id: VehicleId) -> Option<usize> {
    arrivals.binary_search_by_key(&id, |arrival| arrival.vehicle.id).ok()
}

/// Whether the front bumper has come to the end of the route.
fn is_at_end(map: &LabMap, cav: &Cav, sighting: &Sighting) -> bool {
    let Some(&last) = cav.route.lanes().last() else { return false };
    if cav.front_s() < cav.route.length() - NEAR_END_M {
        return false;
    }
    let curve = &map.lane(last).curve;
    let front = sighting.pose.point_at(cav.body.length_m / 2.0, 0.0);
    curve.project(front).s >= curve.length() - AT_END_M
}
