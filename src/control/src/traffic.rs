//! Lane occupancy and leaders on the lane graph.

use super::{Cav, LeaderState};
use city3d_protocol::snapshot::VehicleId;
use city3d_roadmap::{LabMap, LaneId, LaneIndex};
use city3d_workers::{prefetch_at, prefetch_slice};

/// A vehicle on a lane: arc lengths of its front and rear bumper along that lane. A vehicle across a lane's
/// end is listed on both lanes, with arc lengths beyond their ends.
#[derive(Clone, Copy, Debug)]
struct LaneOccupant {
    front_m: f64,
    rear_m: f64,
    occupant: Occupant,
}

/// What others need to know of a vehicle: the vehicle itself is elsewhere in memory.
#[derive(Clone, Copy, Debug)]
struct Occupant {
    /// Index in the list of vehicles.
    vehicle: u32,
    id: VehicleId,
    /// That followers may rely on.
    speed_mps: f64,
}

/// The vehicles on each lane, rebuilt each control step.
#[derive(Clone, Debug, Default)]
pub struct Occupancy {
    on_lane: Vec<Vec<LaneOccupant>>,
    /// No rear bumper is farther before the beginning of a lane that it is listed on; not positive.
    least_rear_m: f64,
}

/// The lanes under a vehicle, found beside other work on it.
#[derive(Clone, Debug)]
pub struct LanesUnder {
    is_seen: bool,
    is_on_route: bool,
    occupant: Occupant,
    front_s: f64,
    rear_s: f64,
    /// Hangs over the beginning or the end of its route.
    hangs_over: bool,
    /// So many of the lanes are under it; more than there is space for: all of them are looked up again.
    count: usize,
    /// With where they begin along the route.
    lanes: [(LaneId, f64); 3],
}

impl LanesUnder {
    /// Of the vehicle at an index, where it is.
    pub fn of(vehicle: usize, cav: &Cav) -> Self {
        let mut under = Self {
            is_seen: cav.is_seen(),
            is_on_route: cav.is_on_route(),
            occupant: Occupant { vehicle: vehicle as u32, id: cav.id, speed_mps: cav.speed_along_mps() },
            front_s: cav.front_s(),
            rear_s: cav.rear_s(),
            hangs_over: cav.rear_s() < 0.0 || cav.front_s() > cav.route.length(),
            count: 0,
            lanes: [(LaneId(0), 0.0); 3],
        };
        if under.is_on_route {
            for (index, lane) in lanes_under(cav).enumerate() {
                under.lanes.get_mut(index).into_iter().for_each(|place| *place = lane);
                under.count = index + 1;
            }
        }
        under
    }
}

/// The lanes between the bumpers of a vehicle on its route, and where they begin along it.
fn lanes_under(cav: &Cav) -> impl Iterator<Item = (LaneId, f64)> {
    let route = &cav.route;
    let (first, last) = (route.index_at(cav.rear_s()), route.index_at(cav.front_s()));
    (first..=last).map(|index| (route.lanes()[index], route.lane_start(index)))
}

/// The lane at the front bumper of a vehicle and the one after it.
fn lanes_before(cav: &Cav) -> impl Iterator<Item = LaneId> {
    let lanes = cav.route.lanes();
    lanes[cav.route.index_at(cav.front_s()).min(lanes.len())..].iter().take(2).copied()
}

/// So many vehicles of a list are asked for.
const FETCHED: usize = 16;

/// The leader: the nearest vehicle ahead on the route.
#[derive(Clone, Copy, Debug)]
pub struct Leader {
    /// Index in the list of vehicles.
    pub vehicle: usize,
    /// Its id.
    pub id: VehicleId,
    /// Its rear bumper along the own route.
    pub rear_s: f64,
    /// Its gap and speed for the driver model.
    pub ahead: LeaderState,
}

/// Diverging lanes are clear of one another within this distance, laboratory metres.
pub const FORK_REACH_M: f64 = 2.0;

/// Clearance to a vehicle that is on no lane, laboratory metres: half of a vehicle's width.
const OBSTACLE_MARGIN_M: f64 = 0.05;

impl Occupancy {
    /// Lists the vehicles anew, with the lanes under each of them. One that is on no lane blocks every lane within its reach.
    pub fn fill<'u>(
        &mut self,
        (map, lanes): (&LabMap, &LaneIndex),
        cavs: &[Cav],
        under: impl Iterator<Item = &'u LanesUnder>,
    ) {
        self.on_lane.resize_with(map.lanes.len(), Vec::new);
        self.on_lane.iter_mut().for_each(Vec::clear);
        self.least_rear_m = 0.0;
        for under in under.filter(|under| under.is_seen) {
            let occupant = under.occupant;
            let vehicle = occupant.vehicle as usize;
            let add = |(lane, start): (LaneId, f64)| {
                let front_m = under.front_s - start;
                self.add(lane, LaneOccupant { front_m, rear_m: under.rear_s - start, occupant });
            };
            if !under.is_on_route {
                self.add_obstacle((map, lanes), occupant, &cavs[vehicle]);
            } else if let Some(lanes) = under.lanes.get(..under.count) {
                lanes.iter().copied().for_each(add);
            } else {
                lanes_under(&cavs[vehicle]).for_each(add);
            }
            if under.is_on_route && under.hangs_over {
                self.add_overhang(map, occupant, &cavs[vehicle]);
            }
        }
    }

    /// Adds a vehicle that hangs over an end of its route to the lanes that lead to the first of it and from the last:
    /// those may be on the routes of others.
    fn add_overhang(&mut self, map: &LabMap, occupant: Occupant, cav: &Cav) {
        let (route, front_s, rear_s) = (&cav.route, cav.front_s(), cav.rear_s());
        let [Some(&first), Some(&last)] = [route.lanes().first(), route.lanes().last()] else { return };
        let mut add = |lane, start: f64| {
            self.add(lane, LaneOccupant { front_m: front_s - start, rear_m: rear_s - start, occupant });
        };
        if rear_s < 0.0 {
            map.lane(first).predecessors.iter().for_each(|&lane| add(lane, -map.lane(lane).curve.length()));
        }
        if front_s > route.length() {
            map.lane(last).successors.iter().for_each(|&lane| add(lane, route.length()));
        }
    }

    fn add(&mut self, lane: LaneId, occupant: LaneOccupant) {
        self.least_rear_m = self.least_rear_m.min(occupant.rear_m);
        self.on_lane[lane.index()].push(occupant);
    }

    /// Adds a vehicle that is on no lane, or across some, to all lanes within reach.
    fn add_obstacle(&mut self, (map, lanes): (&LabMap, &LaneIndex), occupant: Occupant, cav: &Cav) {
        let reach_m = cav.body.length_m / 2.0;
        for lane in lanes.near(cav.pose.position, reach_m + OBSTACLE_MARGIN_M) {
            let foot = map.lane(lane).curve.project(cav.pose.position);
            if foot.distance < reach_m + OBSTACLE_MARGIN_M {
                self.add(
                    lane,
                    LaneOccupant { front_m: foot.s + reach_m, rear_m: foot.s - reach_m, occupant },
                );
            }
        }
    }

    /// Asks for the lists of the lane at a vehicle's front bumper and the one after it.
    pub fn fetch_lanes(&self, cav: &Cav) {
        lanes_before(cav).for_each(|lane| prefetch_at(&self.on_lane, lane.index()));
    }

    /// Asks for what is in those lists.
    pub fn fetch_lists(&self, cav: &Cav) {
        let lists = lanes_before(cav).filter_map(|lane| self.on_lane.get(lane.index()));
        lists.for_each(|list| prefetch_slice(&list[..list.len().min(FETCHED)]));
    }

    /// The leader within a distance of the own front bumper, including a vehicle that has just turned off and
    /// still reaches into the route.
    pub fn leader(&self, cavs: &[Cav], own: usize, within_m: f64) -> Option<Leader> {
        let cav = &cavs[own];
        let front_s = cav.front_s();
        let mut nearest: Option<(Occupant, f64)> = None;
        // In dense traffic the leader is near, and nothing that begins behind it is looked at.
        let is_beyond = |start: f64, nearest: Option<(Occupant, f64)>| {
            nearest.is_some_and(|(_, least)| start + self.least_rear_m >= least)
        };
        let consider =
            |nearest: &mut Option<(Occupant, f64)>, occupant: Occupant, other_front_s: f64, rear_s: f64| {
                let vehicle = occupant.vehicle as usize;
                let is_ahead = other_front_s > front_s || (other_front_s == front_s && vehicle < own);
                if vehicle == own || !is_ahead || rear_s > front_s + within_m {
                    return;
                }
                if nearest.is_none_or(|(_, least)| rear_s < least) {
                    *nearest = Some((occupant, rear_s));
                }
            };
        let route = &cav.route;
        for index in route.index_at(front_s)..route.lanes().len() {
            let start = route.lane_start(index);
            if start > front_s + within_m || is_beyond(start, nearest) {
                break;
            }
            for other in &self.on_lane[route.lanes()[index].index()] {
                consider(&mut nearest, other.occupant, start + other.front_m, start + other.rear_m);
            }
        }
        for fork in route.diverging_from(front_s - FORK_REACH_M) {
            if fork.from_s > front_s + within_m || is_beyond(fork.from_s, nearest) {
                break;
            }
            if fork.to_s < front_s {
                continue;
            }
            for other in &self.on_lane[fork.other.index()] {
                if other.rear_m < fork.other_to_m {
                    let (other_front_s, rear_s) = (fork.from_s + other.front_m, fork.from_s + other.rear_m);
                    consider(&mut nearest, other.occupant, other_front_s, rear_s);
                }
            }
        }
        nearest.map(|(occupant, rear_s)| {
            let ahead = LeaderState { gap_m: rear_s - front_s, speed_mps: occupant.speed_mps };
            Leader { vehicle: occupant.vehicle as usize, id: occupant.id, rear_s, ahead }
        })
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
            if start > from_s + within_m
                || nearest.is_some_and(|(_, least)| start + self.least_rear_m >= least)
            {
                break;
            }
            for other in &self.on_lane[route.lanes()[index].index()] {
                let (rear_s, front_s) = (start + other.rear_m, start + other.front_m);
                let vehicle = other.occupant.vehicle as usize;
                let is_there = front_s > from_s && rear_s < from_s + within_m && vehicle != own;
                if is_there && nearest.is_none_or(|(_, least)| rear_s < least) && counts(vehicle) {
                    nearest = Some((vehicle, rear_s));
                }
            }
        }
        nearest
    }
}
