//! The control framework of the laboratory: from measured poses to a trajectory for each vehicle. Laboratory
//! metres throughout.
//!
//! It runs in lockstep with the city, or in its own process across the network.

mod cav;
mod controller;
mod estimate;
mod idm;
mod loops;
mod off_route;
mod plan;
mod reroute;
mod right_of_way;
mod route;
mod strangers;
mod traffic;

pub use cav::{Cav, CavGeometry, CavSetup, Role};
pub use controller::{CONTROLLERS, CRUISE, Controller, OwnMotion, controller};
pub use idm::{DriverParams, LeaderState};
pub use right_of_way::RightOfWayParams;
pub use route::{JunctionSection, Route, turn_of};

use city3d_protocol::snapshot::VehicleId;
use city3d_protocol::wire::{Measurement, Message};
use city3d_roadmap::LabMap;
use right_of_way::{ConstraintKind, RightOfWay, YieldConstraint};
use std::sync::Arc;
use strangers::Strangers;
use thiserror::Error;
use traffic::Occupancy;

/// A setup that the control framework rejects.
#[derive(Debug, Error, PartialEq)]
pub enum SetupError {
    /// The algorithm `name` of `vehicle` is not one of [`CONTROLLERS`].
    #[error("vehicle {vehicle}: no control algorithm is called \"{name}\"; there are {CONTROLLERS:?}")]
    UnknownController {
        /// The vehicle whose setup is rejected.
        vehicle: VehicleId,
        /// Name of the algorithm that was asked for.
        name: String,
    },
    /// The route of `vehicle` has no lanes.
    #[error("vehicle {vehicle}: its route is empty; give it at least one lane")]
    EmptyRoute {
        /// The vehicle whose setup is rejected.
        vehicle: VehicleId,
    },
}

/// All vehicles under control with their occupancy and right of way.
#[derive(Debug)]
pub struct Mainframe {
    map: Arc<LabMap>,
    /// In id order.
    cavs: Vec<Cav>,
    occupancy: Occupancy,
    right_of_way: RightOfWay,
    yield_constraints: Vec<YieldConstraint>,
    /// Vehicles that somebody else controls.
    strangers: Strangers,
    last_step_s: Option<f64>,
}

/// Look-ahead distance to the leader, laboratory metres.
const SIGHT_M: f64 = 2.5;
/// Speed below which a vehicle counts as stopped, laboratory metres a second.
const STANDS_MPS: f64 = 0.02;

impl Mainframe {
    /// A mainframe for these vehicles, none of which has been measured yet.
    ///
    /// # Errors
    /// When a vehicle names an unknown algorithm or has no route.
    pub fn new(map: Arc<LabMap>, setups: Vec<CavSetup>, rules: RightOfWayParams) -> Result<Self, SetupError> {
        let mut cavs =
            setups.into_iter().map(|setup| Cav::new(&map, setup)).collect::<Result<Vec<_>, _>>()?;
        cavs.sort_by_key(|cav| cav.id);
        Ok(Self {
            right_of_way: RightOfWay::new(rules, &map),
            map,
            cavs,
            occupancy: Occupancy::default(),
            yield_constraints: Vec::new(),
            strangers: Strangers::default(),
            last_step_s: None,
        })
    }

    /// Takes a vehicle under control that has come to the city. One with its id is replaced.
    ///
    /// # Errors
    /// When it names an unknown algorithm or has no route.
    pub fn add(&mut self, setup: CavSetup) -> Result<(), SetupError> {
        let cav = Cav::new(&self.map, setup)?;
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

    /// The vehicles are somewhere on their way, and may stand: the speeds of their setups do not hold.
    pub fn expect_standing(&mut self) {
        self.cavs.iter_mut().for_each(Cav::expect_standing);
    }

    /// One control step at `time_s`: takes the poses that have arrived and returns a message for every
    /// vehicle that has been measured.
    pub fn step(&mut self, time_s: f64, arrived: &[Measurement], messages: &mut Vec<Message>) {
        for seen in arrived {
            if let Ok(index) = self.cavs.binary_search_by_key(&seen.vehicle, |cav| cav.id) {
                self.cavs[index].update_pose(&self.map, time_s, seen);
            } else {
                self.strangers.update(seen);
            }
        }
        self.strangers.advance_to(&self.map, time_s);
        let dt_s = self.last_step_s.map_or(0.0, |last_s| time_s - last_s);
        self.last_step_s = Some(time_s);
        for cav in &mut self.cavs {
            cav.advance_to(time_s);
        }
        self.occupancy.fill(&self.map, &self.cavs);
        self.right_of_way.update(time_s, &mut self.cavs, &self.occupancy);
        reroute::reroute_blocked(time_s, &self.map, &mut self.cavs, &mut self.right_of_way, &self.occupancy);
        for index in 0..self.cavs.len() {
            if self.cavs[index].is_on_route() {
                let decision = self.decide(index);
                let gives_way =
                    |section| self.yield_constraints.iter().any(|h| h.gives_way && h.section == section);
                let cav = &mut self.cavs[index];
                cav.note_yielding(time_s, &decision, gives_way);
                cav.apply(decision, dt_s);
                messages.push(Message::Follow(plan::trajectory(&self.map, cav, time_s)));
            } else if self.cavs[index].is_seen() {
                // No route leads on from there.
                messages.push(Message::Follow(plan::stop_straight(&mut self.cavs[index], time_s)));
            }
        }
    }

    fn decide(&mut self, index: usize) -> Decision {
        let cav = &self.cavs[index];
        let mut decision = Decision { acceleration_mps2: cav.acceleration_for(None), gives_way_at: None };
        if let Some(leader) = self.occupancy.leader(&self.cavs, index, SIGHT_M) {
            decision.limit(cav.acceleration_for(Some(leader.ahead)), None);
        }
        if let Some(stranger) = self.strangers.leader(cav, SIGHT_M) {
            decision.limit(cav.acceleration_for(Some(stranger)), None);
        }
        if let Some(end) = cav.end_of_route() {
            decision.limit(cav.acceleration_for(Some(end)), None);
        }
        self.yield_constraints.clear();
        self.right_of_way.yield_constraints(index, &self.cavs, &mut self.yield_constraints);
        for constraint in &self.yield_constraints {
            let stop = |gap_m| cav.acceleration_for(Some(LeaderState { gap_m, speed_mps: 0.0 }));
            let u = match constraint.kind {
                ConstraintKind::Stop { gap_m } => stop(gap_m),
                ConstraintKind::Merging { leader, wait_gap_m } if wait_gap_m > 0.0 => {
                    cav.acceleration_for(Some(leader)).max(stop(wait_gap_m))
                }
                ConstraintKind::Merging { leader, .. } => cav.acceleration_for(Some(leader)),
            };
            decision.limit(u, constraint.gives_way.then_some(constraint.section));
        }
        decision
    }

    /// Replaces drivers and rules for the present vehicles; plans and admissions stay.
    ///
    /// # Errors
    /// When a vehicle names an unknown algorithm.
    pub fn change(&mut self, setups: Vec<CavSetup>, rules: RightOfWayParams) -> Result<(), SetupError> {
        self.right_of_way.set_params(rules);
        for setup in setups {
            if let Ok(index) = self.cavs.binary_search_by_key(&setup.id, |cav| cav.id) {
                self.cavs[index].change_driver(&self.map, setup.controller, setup.driver)?;
            }
        }
        Ok(())
    }

    /// The vehicle under control with this id.
    pub fn cav(&self, id: VehicleId) -> Option<&Cav> {
        self.cavs.binary_search_by_key(&id, |cav| cav.id).ok().map(|index| &self.cavs[index])
    }

    /// The vehicles under control, in id order.
    pub fn cavs(&self) -> &[Cav] {
        &self.cavs
    }
}

/// The decision of a driver for one control step.
#[derive(Clone, Copy, Debug)]
struct Decision {
    acceleration_mps2: f64,
    /// The section at which the vehicle gives way, if that is the active limit.
    gives_way_at: Option<usize>,
}

impl Decision {
    fn limit(&mut self, acceleration_mps2: f64, gives_way_at: Option<usize>) {
        if acceleration_mps2 < self.acceleration_mps2 {
            *self = Self { acceleration_mps2, gives_way_at };
        }
    }
}
