//! The control framework of the laboratory: from measured poses to a trajectory for each vehicle. Laboratory
//! metres throughout.
//!
//! It runs in lockstep with the city, or in its own process across the network.

mod advance;
mod answers;
mod cacc;
mod cav;
mod controller;
pub mod coordination;
mod decision;
mod drivers;
mod estimate;
mod idm;
mod limit;
mod loops;
mod off_route;
mod plan;
mod platooning;
mod ploeg;
mod reroute;
mod right_of_way;
mod route;
mod rules;
mod signals;
mod strangers;
mod traffic;

pub use cacc::{CaccGains, CaccInputs};
pub use cav::{Cav, CavGeometry, CavSetup, PLAN_SLACK_M, Role};
pub use controller::{
    CONTROLLERS, CRUISE, Controller, OwnMotion, PARKED, PlatoonBroadcast, controller, heeds_nobody,
};
pub use drivers::Drivers;
pub use idm::{DriverParams, LeaderState};
pub use limit::Limit;
pub use ploeg::{PloegGains, PloegInputs};
pub use right_of_way::RightOfWayParams;
pub use route::{JunctionSection, Route, turn_of};
pub use rules::{Algorithms, CoordinationRules, TrafficRules};
pub use signals::{
    ActuatedControl, ApproachingVehicle, CountedControl, HeadState, SignalControl, SignalPhase, SignalPlan,
    Signals, WebsterLimits, WebsterTiming, all_red_time_s, webster, yellow_time_s,
};

use advance::VehicleGroup;
use answers::{Answer, Heeded, Surroundings};
use cav::{Reads, fetch_ahead};
use city3d_geometry::Lab;
use city3d_protocol::snapshot::{TrajectoryPoint, VehicleId};
use city3d_protocol::wire::{Measurement, Message};
use city3d_roadmap::{LabMap, LaneIndex};
use city3d_workers::Workers;
use coordination::filter::SafetyFilter;
use coordination::platoon::{PlatoonParams, Platoons};
use coordination::{CoordinationReport, ZoneCoordination};
use platooning::Platooning;
use right_of_way::{RightOfWay, VehicleSet};
use std::sync::Arc;
use strangers::Strangers;
use thiserror::Error;
use traffic::Occupancy;

/// A setup that the control framework rejects.
#[derive(Debug, Error, PartialEq)]
pub enum SetupError {
    /// The algorithm `name` of `vehicle` is not one of the program's [`Drivers`].
    #[error("vehicle {vehicle}: no control algorithm is called \"{name}\"; there are {known:?}")]
    UnknownController {
        /// The vehicle whose setup is rejected.
        vehicle: VehicleId,
        /// Name of the algorithm that was asked for.
        name: String,
        /// Names of those that the program knows.
        known: Vec<String>,
    },
    /// The route of `vehicle` has no lanes.
    #[error("vehicle {vehicle}: its route is empty; give it at least one lane")]
    EmptyRoute {
        /// The vehicle whose setup is rejected.
        vehicle: VehicleId,
    },
    /// The coordination algorithm `name` is not one of the program's [`Coordinators`](coordination::Coordinators).
    #[error("no coordination algorithm is called \"{name}\"; there are {known:?}")]
    UnknownCoordinator {
        /// Name of the algorithm that was asked for.
        name: String,
        /// Names of those that the program knows.
        known: Vec<String>,
    },
}

/// All vehicles under control with their occupancy and right of way.
#[derive(Debug)]
pub struct Mainframe {
    map: Arc<LabMap>,
    /// Its lanes by place.
    lanes: LaneIndex,
    /// In id order.
    cavs: Vec<Cav>,
    occupancy: Occupancy,
    /// A buffer.
    groups: Vec<VehicleGroup>,
    right_of_way: RightOfWay,
    coordination: Option<ZoneCoordination>,
    /// Of a vehicle that decides in order; a buffer.
    heeded: Heeded,
    /// By vehicle; a buffer.
    answers: Vec<Answer>,
    /// Empty lists for the points of coming trajectories.
    spare: Vec<Vec<TrajectoryPoint<Lab>>>,
    /// Safety filter of planned accelerations, with its counts.
    safety_filter: SafetyFilter,
    /// Vehicles that somebody else controls.
    strangers: Strangers,
    /// Algorithms by name.
    algorithms: Algorithms,
    /// Platoons, where they are formed.
    platooning: Option<Platooning>,
    signals: Signals,
    last_step_s: Option<f64>,
    /// While it only estimates the motion of vehicles that were under way when it came.
    estimates_until_s: Option<f64>,
    workers: Workers,
}

/// Look-ahead distance to the leader, laboratory metres.
const SIGHT_M: f64 = 2.5;
/// Time in which the speed of a vehicle that was under way is estimated from its poses. A city brakes without commands
/// only later.
const ESTIMATION_S: f64 = 0.2;
/// Speed below which a vehicle counts as stopped, laboratory metres a second.
pub const STANDS_MPS: f64 = 0.02;

impl Mainframe {
    /// A mainframe for these vehicles, none of which has been measured yet, with the standard algorithms.
    ///
    /// # Errors
    /// When a vehicle or the rules name an unknown algorithm, or a vehicle has no route.
    pub fn new(map: Arc<LabMap>, setups: Vec<CavSetup>, rules: TrafficRules) -> Result<Self, SetupError> {
        Self::with_algorithms(map, setups, rules, Algorithms::default())
    }

    /// A mainframe whose vehicles and control zones have their algorithms from these.
    ///
    /// # Errors
    /// As for [`Mainframe::new`].
    pub fn with_algorithms(
        map: Arc<LabMap>,
        setups: Vec<CavSetup>,
        rules: TrafficRules,
        algorithms: Algorithms,
    ) -> Result<Self, SetupError> {
        let mut cavs = setups
            .into_iter()
            .map(|setup| Cav::new(&map, setup, &algorithms.drivers))
            .collect::<Result<Vec<_>, _>>()?;
        cavs.sort_by_key(|cav| cav.id);
        let coordination =
            rules.coordination.map(|rules| rules.start(&algorithms.coordinators)).transpose()?;
        let signals = Signals::new(rules.signals, &map);
        Ok(Self {
            right_of_way: RightOfWay::new(rules.right_of_way, &map),
            coordination,
            lanes: LaneIndex::new(&map),
            map,
            cavs,
            occupancy: Occupancy::default(),
            groups: Vec::new(),
            heeded: Heeded::default(),
            answers: Vec::new(),
            spare: Vec::new(),
            safety_filter: SafetyFilter::default(),
            strangers: Strangers::default(),
            algorithms,
            platooning: rules.platoons.map(Platooning::new),
            signals,
            last_step_s: None,
            estimates_until_s: None,
            workers: Workers::alone(),
        })
    }

    /// Forms platoons by these parameters from now on, or none. Present platoons go on with changed parameters.
    fn set_platoons(&mut self, params: Option<PlatoonParams>) {
        match (&mut self.platooning, params) {
            (Some(platooning), Some(params)) => platooning.set_params(params),
            (platooning, params) => *platooning = params.map(Platooning::new),
        }
        if params.is_none() {
            self.cavs.iter_mut().for_each(|cav| cav.set_speed_factor(&self.map, 1.0));
        }
    }

    /// The platoons, where they are formed.
    pub fn platoons(&self) -> Option<&Platoons> {
        self.platooning.as_ref().map(Platooning::platoons)
    }

    /// Takes a vehicle under control that has come to the city. One with its id is replaced.
    ///
    /// # Errors
    /// When it names an unknown algorithm or has no route.
    pub fn add(&mut self, setup: CavSetup) -> Result<(), SetupError> {
        let cav = Cav::new(&self.map, setup, &self.algorithms.drivers)?;
        self.strangers.forget(cav.id);
        match self.cavs.binary_search_by_key(&cav.id, |cav| cav.id) {
            Ok(index) => self.cavs[index] = cav,
            Err(index) => self.cavs.insert(index, cav),
        }
        Ok(())
    }

    /// Gives up a vehicle that leaves the city, with its admissions. Poses of it that come later are those of a stranger.
    pub fn remove(&mut self, id: VehicleId) {
        self.cavs.retain(|cav| cav.id != id);
    }

    /// The vehicles are somewhere on their way, and may stand: the speeds of their setups do not hold. Decides nothing until
    /// their motion has been estimated.
    pub fn expect_under_way(&mut self) {
        self.cavs.iter_mut().for_each(Cav::expect_under_way);
        self.estimates_until_s = Some(f64::INFINITY);
    }

    /// Whether the motion of vehicles under way is still being estimated; once it is, they are located on their routes.
    fn still_estimates(&mut self, time_s: f64) -> bool {
        let Some(until_s) = self.estimates_until_s else { return false };
        if until_s.is_infinite() && self.cavs.iter().any(Cav::is_seen) {
            self.estimates_until_s = Some(time_s + ESTIMATION_S);
        }
        if time_s < until_s {
            return true;
        }
        self.estimates_until_s = None;
        self.cavs.iter_mut().for_each(|cav| cav.locate(&self.map));
        false
    }

    /// Steps are worked on by these from now on; they come out the same, whatever the number of threads.
    pub fn set_workers(&mut self, workers: Workers) {
        self.workers = workers;
    }

    /// One control step at `time_s`: takes the poses that have arrived and returns a message for every
    /// vehicle that has been measured.
    pub fn step(&mut self, time_s: f64, arrived: &[Measurement], messages: &mut Vec<Message>) {
        let workers = self.workers.clone();
        workers.at_hand(self.cavs.len(), || self.step_at_hand(time_s, arrived, messages));
    }

    fn step_at_hand(&mut self, time_s: f64, arrived: &[Measurement], messages: &mut Vec<Message>) {
        if !self.advance_to(time_s, arrived) {
            return;
        }
        let dt_s = self.last_step_s.map_or(0.0, |last_s| time_s - last_s);
        self.last_step_s = Some(time_s);
        let under = self.groups.iter().flat_map(|group| &group.under);
        self.occupancy.fill((&self.map, &self.lanes), &self.cavs, under);
        if let Some(coordination) = &mut self.coordination {
            coordination.update(time_s, &mut self.cavs);
        }
        self.signals.update(time_s, &self.map, &self.cavs, &self.strangers);
        messages.extend(self.signals.messages(time_s).map(Message::Signals));
        let around = (&*self.map, &self.occupancy, &self.signals);
        self.right_of_way.update(time_s, around, (&mut self.cavs, &mut self.groups), &self.workers);
        reroute::reroute_blocked(time_s, &self.map, &mut self.cavs, &mut self.right_of_way, &self.occupancy);
        if let Some(platooning) = &mut self.platooning {
            platooning.update(time_s, &self.map, &mut self.cavs, &self.occupancy, &self.strangers);
        }
        self.answer(time_s, dt_s, messages);
    }

    /// Takes empty lists for the points of the trajectories of the next step; without them it makes its own.
    pub fn reuse(&mut self, spare: impl Iterator<Item = Vec<TrajectoryPoint<Lab>>>) {
        self.spare.extend(spare);
    }

    /// Lets the vehicles decide, and adds the messages to them.
    fn answer(&mut self, time_s: f64, dt_s: f64, messages: &mut Vec<Message>) {
        let mut answers = std::mem::take(&mut self.answers);
        answers.resize_with(self.cavs.len(), Answer::default);
        let around = self.surroundings();
        self.workers.each_with(&mut answers, Heeded::default, |heeded, index, answer| {
            fetch_ahead(around.cavs, index, Reads::Traffic(around.occupancy));
            answer.begin(&around, index, time_s, heeded);
        });
        if self.coordination.is_some() || self.platooning.is_some() {
            self.decide_in_order((time_s, dt_s), &mut answers);
        }
        let map = &*self.map;
        for (answer, points) in answers.iter_mut().zip(self.spare.drain(..)) {
            answer.points = points;
        }
        self.workers.each_group_of_two((&mut self.cavs, &mut answers), |cavs, answers| {
            Answer::finish_all(map, cavs, answers, (time_s, dt_s));
        });
        messages.extend((0..self.cavs.len()).filter_map(|place| {
            let trajectory = answers[self.decides_at(place)].take_trajectory();
            trajectory.map(Message::Follow)
        }));
        self.answers = answers;
    }

    /// Members of platoons are told what their predecessors have decided, and a vehicle on a plan relies on those of others that
    /// still follow theirs.
    fn decide_in_order(&mut self, (time_s, dt_s): (f64, f64), answers: &mut [Answer]) {
        let mut heeded = std::mem::take(&mut self.heeded);
        // Who has begun or ceased to follow a plan in this step.
        let mut changed = VehicleSet::default();
        for place in 0..self.cavs.len() {
            let index = self.decides_at(place);
            if !self.cavs[index].is_on_route() {
                continue;
            }
            let decided = answers[index]
                .decided_without(changed)
                .unwrap_or_else(|| self.surroundings().vehicle_decides(index, time_s, &mut heeded));
            let cav = &mut self.cavs[index];
            let followed_plan = cav.coordination.follows_plan;
            decided.apply(cav, time_s, dt_s);
            if cav.coordination.follows_plan != followed_plan {
                changed.add(index);
            }
            self.safety_filter.add(decided.filtered());
            answers[index].set_applied();
        }
        self.heeded = heeded;
    }

    /// Index of the vehicle that decides at this place of the order.
    fn decides_at(&self, place: usize) -> usize {
        self.platooning.as_ref().map_or(place, |platooning| platooning.decides_at(place))
    }

    /// What vehicles decide from.
    fn surroundings(&self) -> Surroundings<'_> {
        Surroundings {
            map: &self.map,
            cavs: &self.cavs,
            occupancy: &self.occupancy,
            right_of_way: &self.right_of_way,
            strangers: &self.strangers,
            platooning: self.platooning.as_ref(),
        }
    }

    /// What coordination has done so far; `None` without it.
    pub fn coordination_report(&self) -> Option<CoordinationReport> {
        let coordination = self.coordination.as_ref()?;
        let names = coordination.zones().iter().map(|zone| zone.name.clone());
        let zones = names.zip(coordination.counts().iter().copied()).collect();
        Some(CoordinationReport { zones, safety_filter: self.safety_filter.counts() })
    }

    /// Replaces drivers and rules for the present vehicles; admissions stay. Vehicles in control zones get new plans.
    ///
    /// # Errors
    /// When a vehicle or the rules name an unknown algorithm.
    pub fn change(&mut self, setups: Vec<CavSetup>, rules: TrafficRules) -> Result<(), SetupError> {
        self.right_of_way.set_params(rules.right_of_way);
        let coordination = rules.coordination.map(|rules| rules.start(&self.algorithms.coordinators));
        self.coordination = coordination.transpose()?;
        self.set_platoons(rules.platoons);
        self.cavs.iter_mut().for_each(Cav::forget_coordination);
        if !self.signals.follow(&rules.signals) {
            self.signals = Signals::new(rules.signals, &self.map);
        }
        for setup in setups {
            if let Ok(index) = self.cavs.binary_search_by_key(&setup.id, |cav| cav.id) {
                self.cavs[index].change_driver(
                    &self.map,
                    setup.controller,
                    setup.driver,
                    &self.algorithms.drivers,
                )?;
            }
        }
        Ok(())
    }

    /// The traffic signals.
    pub fn signals(&self) -> &Signals {
        &self.signals
    }

    /// The vehicle under control with this id.
    pub fn cav(&self, id: VehicleId) -> Option<&Cav> {
        self.cavs.binary_search_by_key(&id, |cav| cav.id).ok().map(|index| &self.cavs[index])
    }

    /// The vehicles under control, in id order.
    pub fn cavs(&self) -> &[Cav] {
        &self.cavs
    }

    /// Coordination in control zones, where there is any.
    pub fn coordination(&self) -> Option<&ZoneCoordination> {
        self.coordination.as_ref()
    }
}
