//! The control framework of the laboratory: it sees measured poses, and sends each vehicle the
//! motion that its driver wants. Laboratory metres throughout.
//!
//! The same object runs in lockstep with the city and, in its own process, across the network.

mod cav;
mod controller;
mod estimate;
mod idm;
mod loops;
mod plan;
mod reroute;
mod right_of_way;
mod route;
mod stray;
mod traffic;

pub use cav::{Body, Cav, CavSetup};
pub use controller::{CONTROLLERS, CRUISE, Controller, OwnMotion, controller};
pub use idm::{Ahead, DriverParams};
pub use right_of_way::RightOfWayParams;
pub use route::{Route, Section, turn_of};

use crate::city::LabMap;
use crate::snapshot::VehicleId;
use crate::wire::{Measurement, Message};
use right_of_way::{Constraint, Hindrance, RightOfWay};
use std::sync::Arc;
use thiserror::Error;
use traffic::Occupancy;

/// A setup that the control framework cannot take.
#[derive(Debug, Error, PartialEq)]
pub enum SetupError {
    #[error("vehicle {vehicle}: no control algorithm is called \"{name}\"; there are {CONTROLLERS:?}")]
    UnknownController { vehicle: VehicleId, name: String },
    #[error("vehicle {vehicle}: its route is empty; give it at least one lane")]
    EmptyRoute { vehicle: VehicleId },
}

/// All vehicles under control, and the rules between them.
#[derive(Debug)]
pub struct Mainframe {
    map: Arc<LabMap>,
    /// In id order.
    cavs: Vec<Cav>,
    occupancy: Occupancy,
    right_of_way: RightOfWay,
    hindrances: Vec<Hindrance>,
    last_step_s: Option<f64>,
}

/// How far ahead a driver looks for the vehicle before it, laboratory metres.
const SIGHT_M: f64 = 2.5;
/// What moves no faster than this stands, as far as measured poses tell, laboratory metres a second.
const STANDS_MPS: f64 = 0.02;

impl Mainframe {
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
            hindrances: Vec::new(),
            last_step_s: None,
        })
    }

    /// One control step at `time_s`: takes the poses that have arrived since the last one, and gives
    /// a message for every vehicle that has been seen.
    pub fn step(&mut self, time_s: f64, arrived: &[Measurement], messages: &mut Vec<Message>) {
        for seen in arrived {
            if let Ok(index) = self.cavs.binary_search_by_key(&seen.vehicle, |cav| cav.id) {
                self.cavs[index].see(&self.map, time_s, seen);
            }
        }
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
                let gives_way = |section| self.hindrances.iter().any(|h| h.gives_way && h.section == section);
                let cav = &mut self.cavs[index];
                cav.note_yielding(time_s, &decision, gives_way);
                cav.apply(decision, dt_s);
                messages.push(Message::Follow(plan::trajectory(&self.map, cav, time_s)));
            } else if self.cavs[index].is_seen() {
                // Nobody knows a way for it from there.
                messages.push(Message::Follow(plan::stand(&mut self.cavs[index], time_s)));
            }
        }
    }

    fn decide(&mut self, index: usize) -> Decision {
        let cav = &self.cavs[index];
        let mut decision = Decision { acceleration_mps2: cav.acceleration_for(None), gives_way_at: None };
        if let Some(leader) = self.occupancy.leader(&self.cavs, index, SIGHT_M) {
            decision.limit(cav.acceleration_for(Some(leader.ahead)), None);
        }
        if let Some(end) = cav.end_of_route() {
            decision.limit(cav.acceleration_for(Some(end)), None);
        }
        self.hindrances.clear();
        self.right_of_way.hindrances(index, &self.cavs, &mut self.hindrances);
        for hindrance in &self.hindrances {
            let stop = |gap_m| cav.acceleration_for(Some(Ahead { gap_m, speed_mps: 0.0 }));
            let u = match hindrance.constraint {
                Constraint::Stop { gap_m } => stop(gap_m),
                Constraint::Merging { leader, wait_gap_m } if wait_gap_m > 0.0 => {
                    cav.acceleration_for(Some(leader)).max(stop(wait_gap_m))
                }
                Constraint::Merging { leader, .. } => cav.acceleration_for(Some(leader)),
            };
            decision.limit(u, hindrance.gives_way.then_some(hindrance.section));
        }
        decision
    }

    /// Other drivers and rules from now on, for vehicles that are there already; what they have been told and
    /// admitted to stays.
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

    /// The vehicles under control, in id order.
    pub fn cavs(&self) -> &[Cav] {
        &self.cavs
    }
}

/// What a driver does until the next control step.
#[derive(Clone, Copy, Debug)]
struct Decision {
    acceleration_mps2: f64,
    /// The section at which the vehicle gives way, where that is what limits it.
    gives_way_at: Option<usize>,
}

impl Decision {
    fn limit(&mut self, acceleration_mps2: f64, gives_way_at: Option<usize>) {
        if acceleration_mps2 < self.acceleration_mps2 {
            *self = Self { acceleration_mps2, gives_way_at };
        }
    }
}
