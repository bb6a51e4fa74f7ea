//! Capacity of short loops of lanes (roundabouts, small blocks), which prevents gridlock. On a full loop each
//! vehicle waits for the space of the next. Entering vehicles wait outside while a loop is half full, which
//! is also about where its flow is largest.

use super::Cav;
use city3d_roadmap::{LabMap, LaneId};
use std::collections::BTreeSet;

/// Longest loop that can fill up, laboratory metres.
const LONGEST_M: f64 = 8.0;
/// Space of one standing vehicle.
const PLACE_M: f64 = 0.28;
/// Share of the spaces that may be occupied.
const TAKEN: f64 = 0.5;
/// Distance behind a section at which its exit is looked up.
pub(super) const BEHIND_SECTION_M: f64 = 0.05;

/// Vehicles on each short loop of a map, and the most that may be on it.
#[derive(Clone, Debug)]
pub struct LoopCapacity {
    most: Vec<u32>,
    of_lane: Vec<Vec<usize>>,
    /// Vehicles on each loop or admitted to it, recounted each control step.
    count: Vec<u32>,
}

impl LoopCapacity {
    /// Finds the short loops of a map, without vehicles.
    pub fn new(map: &LabMap) -> Self {
        let loops: BTreeSet<Vec<LaneId>> =
            map.lanes.iter().filter_map(|lane| short_loop(map, lane.id)).collect();
        let mut of_lane = vec![Vec::new(); map.lanes.len()];
        let mut most = Vec::new();
        for lanes in &loops {
            let length_m: f64 = lanes.iter().map(|lane| map.lane(*lane).curve.length()).sum();
            for lane in lanes {
                of_lane[lane.index()].push(most.len());
            }
            most.push(((TAKEN * length_m / PLACE_M) as u32).max(2));
        }
        Self { count: vec![0; most.len()], most, of_lane }
    }

    /// Forgets all vehicles.
    pub(super) fn clear(&mut self) {
        self.count.fill(0);
    }

    /// Counts vehicles on these loops, each as often as it is listed.
    pub(super) fn count(&mut self, loops: &[usize]) {
        loops.iter().for_each(|&entered| self.count[entered] += 1);
    }

    /// Whether every loop entered with the next section has space.
    pub fn have_room(&self, cav: &Cav) -> bool {
        self.would_enter(cav).iter().all(|&entered| self.count[entered] < self.most[entered])
    }

    /// Adds a vehicle to the loops of its next section.
    pub fn enter(&mut self, cav: &Cav) {
        self.would_enter(cav).into_iter().for_each(|entered| self.count[entered] += 1);
    }

    fn would_enter(&self, cav: &Cav) -> Vec<usize> {
        let (mut already, mut then) = (Vec::new(), Vec::new());
        self.list(cav, None, &mut already);
        self.list(cav, Some(cav.passage.next_section), &mut then);
        then.retain(|entered| !already.contains(entered));
        then
    }

    /// Adds the loops that a vehicle is on or was admitted to, each once; with one more section, those it would
    /// also enter.
    fn list(&self, cav: &Cav, section: Option<usize>, out: &mut Vec<usize>) {
        let admitted = cav.passage.admissions.iter().map(|admission| admission.section);
        let sections = admitted.chain(section).filter_map(|section| cav.route.sections.get(section));
        let end_s = sections.map(|section| section.to_s + BEHIND_SECTION_M).fold(cav.front_s(), f64::max);
        let lanes = cav.route.index_at(cav.rear_s())..=cav.route.index_at(end_s);
        let before = out.len();
        for lane in &cav.route.lanes()[lanes] {
            for &entered in &self.of_lane[lane.index()] {
                if !out[before..].contains(&entered) {
                    out.push(entered);
                }
            }
        }
    }

    /// Adds the loops that a vehicle is on or was admitted to, each once.
    pub(super) fn add_to(&self, cav: &Cav, out: &mut Vec<usize>) {
        self.list(cav, None, out);
    }
}

/// The lanes of the shortest cycle through a lane, in id order, if it is short.
fn short_loop(map: &LabMap, lane: LaneId) -> Option<Vec<LaneId>> {
    let mut lanes = map.shortest_loop(lane)?;
    let length_m: f64 = lanes.iter().map(|lane| map.lane(*lane).curve.length()).sum();
    lanes.sort_unstable();
    (length_m <= LONGEST_M).then_some(lanes)
}
