//! Lane occupancy and leaders on the lane graph.

use super::{Cav, LeaderState};
use city3d_roadmap::{LabMap, LaneIndex};

/// A vehicle on a lane: arc lengths of its front and rear bumper along that lane. A vehicle across a lane's
/// end is listed on both lanes, with arc lengths beyond their ends.
#[derive(Clone, Copy, Debug)]
struct LaneOccupant {
    vehicle: usize,
    front_m: f64,
    rear_m: f64,
}

/// The vehicles on each lane, rebuilt each control step.
#[derive(Clone, Debug, Default)]
pub struct Occupancy {
    on_lane: Vec<Vec<LaneOccupant>>,
}

/// The leader: the nearest vehicle ahead on the route.
#[derive(Clone, Copy, Debug)]
pub struct Leader {
    /// Index in the list of vehicles.
    pub vehicle: usize,
    /// Its rear bumper along the own route.
    pub rear_s: f64,
    /// Its gap and speed for the driver model.
    pub ahead: LeaderState,
}

/// Diverging lanes are clear of one another within this distance, laboratory metres.
const FORK_REACH_M: f64 = 2.0;

/// Clearance to a vehicle that is on no lane, laboratory metres: half of a vehicle's width.
const OBSTACLE_MARGIN_M: f64 = 0.05;

impl Occupancy {
    /// Lists the vehicles anew. One that is on no lane blocks every lane within its reach.
    pub fn fill(&mut self, (map, lanes): (&LabMap, &LaneIndex), cavs: &[Cav]) {
        self.on_lane.resize_with(map.lanes.len(), Vec::new);
        self.on_lane.iter_mut().for_each(Vec::clear);
        for (vehicle, cav) in cavs.iter().enumerate().filter(|(_, cav)| cav.is_seen()) {
            if !cav.is_on_route() {
                self.add_obstacle((map, lanes), vehicle, cav);
                continue;
            }
            let (rear_s, front_s) = (cav.rear_s(), cav.front_s());
            let (first, last) = (cav.route.index_at(rear_s), cav.route.index_at(front_s));
            for index in first..=last {
                let start = cav.route.lane_start(index);
                let lane = cav.route.lanes()[index];
                let occupant = LaneOccupant { vehicle, front_m: front_s - start, rear_m: rear_s - start };
                self.on_lane[lane.index()].push(occupant);
            }
        }
    }

    /// Adds a vehicle that is on no lane, or across some, to all lanes within reach.
    fn add_obstacle(&mut self, (map, lanes): (&LabMap, &LaneIndex), vehicle: usize, cav: &Cav) {
        let reach_m = cav.body.length_m / 2.0;
        for lane in lanes.near(cav.pose.position, reach_m + OBSTACLE_MARGIN_M) {
            let foot = map.lane(lane).curve.project(cav.pose.position);
            if foot.distance < reach_m + OBSTACLE_MARGIN_M {
                let occupant = LaneOccupant { vehicle, front_m: foot.s + reach_m, rear_m: foot.s - reach_m };
                self.on_lane[lane.index()].push(occupant);
            }
        }
    }

    /// The leader within a distance of the own front bumper, including a vehicle that has just turned off and
    /// still reaches into the route.
    pub fn leader(&self, cavs: &[Cav], own: usize, within_m: f64) -> Option<Leader> {
        let cav = &cavs[own];
        let front_s = cav.front_s();
        let mut nearest: Option<Leader> = None;
        let mut consider = |vehicle: usize, other_front_s: f64, rear_s: f64| {
            let is_ahead = other_front_s > front_s || (other_front_s == front_s && vehicle < own);
            if vehicle == own || !is_ahead || rear_s > front_s + within_m {
                return;
            }
            if nearest.is_none_or(|leader| rear_s < leader.rear_s) {
                let ahead =
                    LeaderState { gap_m: rear_s - front_s, speed_mps: cavs[vehicle].speed_along_mps() };
                nearest = Some(Leader { vehicle, rear_s, ahead });
            }
        };
        let route = &cav.route;
        for index in route.index_at(front_s)..route.lanes().len() {
            let start = route.lane_start(index);
            if start > front_s + within_m {
                break;
            }
            for other in &self.on_lane[route.lanes()[index].index()] {
                consider(other.vehicle, start + other.front_m, start + other.rear_m);
            }
        }
        let first = route.diverging.partition_point(|fork| fork.from_s < front_s - FORK_REACH_M);
        for fork in &route.diverging[first..] {
            if fork.from_s > front_s + within_m {
                break;
            }
            if fork.to_s < front_s {
                continue;
            }
            for other in &self.on_lane[fork.other.index()] {
                if other.rear_m < fork.other_to_m {
                    consider(other.vehicle, fork.from_s + other.front_m, fork.from_s + other.rear_m);
                }
            }
        }
        nearest
    }

    /// The nearest rear bumper beyond a position of a route, at most `within_m` on, of the vehicles that
    /// `counts` accepts.
    pub fn first_rear_after(
        &self,
        cavs: &[Cav],
        own: usize,
        from_s: f64,
        within_m: f64,
        counts: impl Fn(usize) -> bool,
    ) -> Option<(usize, f64)> {
        let route = &cavs[own].route;
        let mut nearest: Option<(usize, f64)> = None;
        for index in route.index_at(from_s)..route.lanes().len() {
            let start = route.lane_start(index);
            if start > from_s + within_m {
                break;
            }
            for other in &self.on_lane[route.lanes()[index].index()] {
                let (rear_s, front_s) = (start + other.rear_m, start + other.front_m);
                let is_there = front_s > from_s && rear_s < from_s + within_m && other.vehicle != own;
                if is_there && nearest.is_none_or(|(_, least)| rear_s < least) && counts(other.vehicle) {
                    nearest = Some((other.vehicle, rear_s));
                }
            }
        }
        nearest
    }
}
