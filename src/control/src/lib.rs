//! The control framework of the laboratory: from measured poses to a trajectory for each vehicle. Laboratory
//! metres throughout.
//!
//! It runs in lockstep with the city, or in its own process across the network.

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
pub use cav::{Cav, CavGeometry, CavSetup, Role};
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

use city3d_protocol::snapshot::{DecisionReason, VehicleId};
use city3d_protocol::wire::{Measurement, Message};
use city3d_roadmap::{LabMap, LaneIndex};
use coordination::filter::SafetyFilter;
use coordination::platoon::{PlatoonParams, Platoons};
use coordination::{CoordinationReport, ZoneCoordination};
use decision::{Decision, Obstacle, ObstacleKind, StopPlace};
use platooning::Platooning;
use right_of_way::{ConstraintKind, RightOfWay, YieldConstraint};
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
    right_of_way: RightOfWay,
    coordination: Option<ZoneCoordination>,
    yield_constraints: Vec<YieldConstraint>,
    /// Obstacles of the vehicle that is decided for; a buffer.
    ahead: Vec<Obstacle>,
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
            yield_constraints: Vec::new(),
            ahead: Vec::new(),
            safety_filter: SafetyFilter::default(),
            strangers: Strangers::default(),
            algorithms,
            platooning: rules.platoons.map(Platooning::new),
            signals,
            last_step_s: None,
            estimates_until_s: None,
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

    /// One control step at `time_s`: takes the poses that have arrived and returns a message for every
    /// vehicle that has been measured.
    pub fn step(&mut self, time_s: f64, arrived: &[Measurement], messages: &mut Vec<Message>) {
        let mut next = 0;
        for seen in arrived {
            // Poses come in the order of ids, as a rule.
            let is_next = self.cavs.get(next).is_some_and(|cav| cav.id == seen.vehicle);
            let found = || self.cavs.binary_search_by_key(&seen.vehicle, |cav| cav.id).ok();
            if let Some(index) = if is_next { Some(next) } else { found() } {
                next = index + 1;
                self.cavs[index].update_pose((&self.map, &self.lanes), time_s, seen);
            } else {
                self.strangers.update(seen);
            }
        }
        self.strangers.advance_to((&self.map, &self.lanes), time_s);
        if self.still_estimates(time_s) {
            return;
        }
        let dt_s = self.last_step_s.map_or(0.0, |last_s| time_s - last_s);
        self.last_step_s = Some(time_s);
        for cav in &mut self.cavs {
            cav.advance_to(time_s);
        }
        self.occupancy.fill((&self.map, &self.lanes), &self.cavs);
        if let Some(coordination) = &mut self.coordination {
            coordination.update(time_s, &mut self.cavs);
        }
        self.signals.update(time_s, &self.map, &self.cavs, &self.strangers);
        messages.extend(self.signals.messages(time_s).map(Message::Signals));
        self.right_of_way.update(time_s, &self.map, &mut self.cavs, &self.occupancy, &self.signals);
        reroute::reroute_blocked(time_s, &self.map, &mut self.cavs, &mut self.right_of_way, &self.occupancy);
        if let Some(platooning) = &mut self.platooning {
            platooning.update(time_s, &self.map, &mut self.cavs, &self.occupancy, &self.strangers);
        }
        for place in 0..self.cavs.len() {
            let index = self.platooning.as_ref().map_or(place, |platooning| platooning.decides_at(place));
            if self.cavs[index].is_on_route() {
                let decision = self.decide(index, time_s);
                let gives_way =
                    |section| self.yield_constraints.iter().any(|h| h.gives_way && h.section == section);
                let cav = &mut self.cavs[index];
                cav.note_yielding(time_s, &decision, gives_way);
                cav.apply(decision, time_s, dt_s);
                cav.limit = Limit::applied(cav, &decision);
                messages.push(Message::Follow(plan::trajectory(&self.map, cav, time_s)));
            } else if self.cavs[index].is_seen() {
                // No route leads on from there.
                self.cavs[index].limit = Limit::of(DecisionReason::OffRoute);
                messages.push(Message::Follow(plan::stop_straight(&mut self.cavs[index], time_s)));
            }
        }
    }

    fn decide(&mut self, index: usize, now_s: f64) -> Decision {
        self.look_ahead(index);
        let cav = &self.cavs[index];
        match cav.planned_acceleration(now_s) {
            Some(planned) => Decision::of_plan(planned, cav, &self.ahead, &mut self.safety_filter),
            None => Decision::of_driver(cav, &self.ahead),
        }
    }

    /// Collects what a vehicle has to heed.
    fn look_ahead(&mut self, index: usize) {
        let cav = &self.cavs[index];
        self.ahead.clear();
        if let Some(leader) = self.occupancy.leader(&self.cavs, index, SIGHT_M) {
            let told = self.platooning.as_ref().and_then(|p| p.broadcast(&self.cavs, index, &leader));
            let (kind, reason) = match told {
                Some(platoon) => (ObstacleKind::Predecessor(leader.ahead, platoon), DecisionReason::Platoon),
                None => (ObstacleKind::Leader(leader.ahead), DecisionReason::Leader),
            };
            let limit = Limit::behind(reason, Some(self.cavs[leader.vehicle].id), leader.ahead.gap_m);
            self.ahead.push(Obstacle { kind, gives_way_at: None, limit });
        }
        let others = [
            (self.strangers.leader(cav, SIGHT_M), DecisionReason::Leader),
            (cav.end_of_route(), DecisionReason::RouteEnd),
        ];
        self.ahead.extend(others.into_iter().filter_map(|(ahead, reason)| {
            let ahead = ahead?;
            Some(Obstacle::leader(ahead, Limit::behind(reason, None, ahead.gap_m)))
        }));
        self.yield_constraints.clear();
        let wait_m =
            self.right_of_way.yield_constraints(&self.map, index, &self.cavs, &mut self.yield_constraints);
        for constraint in &self.yield_constraints {
            let keeps_gap = constraint.section == cav.passage.next_section;
            let place = |gap_m| StopPlace { gap_m, keeps_gap };
            let kind = match constraint.kind {
                ConstraintKind::Stop { gap_m } => ObstacleKind::Stop(place(gap_m)),
                ConstraintKind::Merging { leader, wait_gap_m } => {
                    ObstacleKind::Merging(leader, (wait_gap_m > 0.0).then(|| place(wait_gap_m)))
                }
            };
            let gives_way_at = constraint.gives_way.then_some(constraint.section);
            let limit = Limit::of_constraint(cav, &self.cavs, constraint);
            self.ahead.push(Obstacle { kind, gives_way_at, limit });
        }
        self.cavs[index].wait_m = wait_m;
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
