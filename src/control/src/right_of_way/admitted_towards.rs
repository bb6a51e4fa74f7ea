//! An index of admitted vehicles by the lanes that they were admitted to, so that room behind a section is found without
//! a look at every vehicle.

use crate::Cav;
use crate::loops::BEHIND_SECTION_M;
use city3d_roadmap::{LabMap, LaneId};
use std::ops::RangeInclusive;

/// The vehicles that have an admission to a section with a lane, by lane; rebuilt each control step. Admissions that ended
/// within the step are still there.
#[derive(Clone, Debug)]
pub(super) struct AdmittedTowards {
    by_lane: Vec<Vec<usize>>,
    /// Lanes with vehicles.
    used: Vec<LaneId>,
}

impl AdmittedTowards {
    pub(super) fn new(map: &LabMap) -> Self {
        Self { by_lane: vec![Vec::new(); map.lanes.len()], used: Vec::new() }
    }

    /// Forgets all vehicles.
    pub(super) fn clear(&mut self) {
        for lane in self.used.drain(..) {
            self.by_lane[lane.index()].clear();
        }
    }

    /// Adds the admissions of a vehicle.
    pub(super) fn add(&mut self, vehicle: usize, cav: &Cav) {
        for admission in &cav.passage.admissions {
            self.add_section(vehicle, cav, admission.section);
        }
    }

    /// Adds an admission to one section of its route.
    pub(super) fn add_section(&mut self, vehicle: usize, cav: &Cav, section: usize) {
        cav.route.lanes()[lanes_of(cav, section)].iter().for_each(|lane| self.add_lane(vehicle, *lane));
    }

    /// Adds a vehicle to those of a lane.
    pub(super) fn add_lane(&mut self, vehicle: usize, lane: LaneId) {
        let vehicles = &mut self.by_lane[lane.index()];
        if vehicles.is_empty() {
            self.used.push(lane);
        }
        vehicles.push(vehicle);
    }

    /// The vehicles listed for a lane, each once, in id order.
    pub(super) fn lane(&self, lane: LaneId) -> Vec<usize> {
        let mut vehicles = self.by_lane[lane.index()].clone();
        vehicles.sort_unstable();
        vehicles.dedup();
        vehicles
    }
}

/// Indices of the lanes of a route from the start of a section to its exit lane.
pub(super) fn lanes_of(cav: &Cav, section: usize) -> RangeInclusive<usize> {
    let there = &cav.route.sections[section];
    cav.route.index_at(there.from_s)..=cav.route.index_at(there.to_s + BEHIND_SECTION_M)
}

/// Where a lane of a section begins along the route; `None` where the section does not use it.
pub(super) fn lane_start(cav: &Cav, section: usize, lane: LaneId) -> Option<f64> {
    let index = lanes_of(cav, section).find(|index| cav.route.lanes()[*index] == lane)?;
    Some(cav.route.lane_start(index))
}
