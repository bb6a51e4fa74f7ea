//! A vehicle in traffic from the poses of one instant: its lane, its leader, gap and headway. Full scale. It needs no past
//! and no control framework, so every source of snapshots has it.

use super::surrogate::Following;
use city3d_geometry::{Pose2, wrap_angle};
use city3d_protocol::snapshot::{FrameSnapshot, Status, VehicleId, VehicleInfo, VehicleState};
use city3d_roadmap::{CityMap, LaneId, LaneIndex};
use glam::DVec2;
use std::collections::VecDeque;

/// Finds the lanes of a map by place: map matching of single poses.
#[derive(Clone, Debug, Default)]
pub struct LaneFinder {
    lanes: LaneIndex,
}

/// A pose on a lane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LanePose {
    /// The lane.
    pub lane: LaneId,
    /// Along its centre line.
    pub at_m: f64,
    /// From its centre line, left-positive.
    pub lateral_m: f64,
    /// From its direction, left-positive.
    pub turn_rad: f64,
}

/// The vehicle ahead on the same way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LeaderAhead {
    /// Its id.
    pub vehicle: VehicleId,
    /// Gap and speeds, full scale.
    pub following: Following,
    /// Its nearest point on the way.
    pub rear: DVec2,
}

impl LeaderAhead {
    /// Time headway: gap over own speed; `None` for a vehicle that stands.
    pub fn headway_s(&self) -> Option<f64> {
        let Following { gap_m, speed_mps, .. } = self.following;
        (speed_mps > STANDS_MPS).then(|| gap_m.max(0.0) / speed_mps)
    }
}

/// A vehicle in traffic.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrafficPlace {
    /// Where its front axle is.
    pub axle: LanePose,
    /// The front bumper, city frame.
    pub front: DVec2,
    /// The nearest vehicle ahead within [`SIGHT_M`].
    pub leader: Option<LeaderAhead>,
}

/// How far ahead a leader is looked for, full scale.
pub const SIGHT_M: f64 = 62.5;
/// Slower vehicles stand, full scale.
const STANDS_MPS: f64 = 0.5;
/// A lane is farther than this from a vehicle that is not on it.
const ON_LANE_M: f64 = 2.5;
/// A vehicle across a lane at a larger angle does not drive along it.
const ALONG_RAD: f64 = 1.0;
/// A radian off a lane's direction counts as much as so many metres beside it.
const METRES_PER_RADIAN: f64 = 2.0;
/// A lane that is not on the route has to be nearer by so much.
const OFF_ROUTE_M: f64 = 1.5;
/// Most lanes that are searched ahead.
const MOST_LANES: usize = 64;

/// Who waits for its start stands; its state has the speed at which it will begin.
fn speed_of(state: &VehicleState) -> f64 {
    if state.status == Status::Waiting { 0.0 } else { state.speed_mps }
}

impl LaneFinder {
    /// Finds lanes of this map.
    pub fn new(map: &CityMap) -> Self {
        Self { lanes: LaneIndex::new(map) }
    }

    /// The nearest lane under a point, whichever way it leads, within half its width.
    pub fn lane_under(&self, map: &CityMap, point: DVec2) -> Option<(LaneId, f64)> {
        let under = self.lanes_under(map, point).into_iter().min_by(|a, b| a.2.total_cmp(&b.2));
        under.map(|(lane, at_m, _)| (lane, at_m))
    }

    /// All lanes under a point, within half their width: where along each it is, and how far beside its centre line.
    pub fn lanes_under(&self, map: &CityMap, point: DVec2) -> Vec<(LaneId, f64, f64)> {
        let under = self.lanes.near(point, ON_LANE_M).into_iter().filter_map(|lane| {
            let (foot, lane) = (map.lane(lane).curve.project(point), map.lane(lane));
            (foot.distance <= lane.width_m / 2.0).then_some((lane.id, foot.s, foot.distance))
        });
        under.collect()
    }

    /// Map matching of a single pose: the lane that fits best in place and direction, of the route where one does.
    pub fn lane_pose(&self, map: &CityMap, pose: &Pose2, route: &[LaneId]) -> Option<LanePose> {
        let fits = self.lanes.near(pose.position, ON_LANE_M).into_iter().filter_map(|lane| {
            let curve = &map.lane(lane).curve;
            let foot = curve.project(pose.position);
            let turn_rad = wrap_angle(pose.yaw_rad - curve.at(foot.s).pose.yaw_rad);
            let is_on = foot.distance < ON_LANE_M && turn_rad.abs() < ALONG_RAD;
            let off_route_m = if route.contains(&lane) { 0.0 } else { OFF_ROUTE_M };
            let cost_m = foot.distance + METRES_PER_RADIAN * turn_rad.abs() + off_route_m;
            let found = LanePose { lane, at_m: foot.s, lateral_m: foot.lateral, turn_rad };
            is_on.then_some((cost_m, found))
        });
        fits.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, found)| found)
    }
}

/// A stretch of the way ahead: a lane, and the distance from the front bumper to its beginning.
#[derive(Clone, Copy, Debug)]
struct WayAhead {
    lane: LaneId,
    begins_m: f64,
}

/// The way ahead of a place: the lanes of the route where the lane is on it, else all lanes that follow, breadth first.
fn way_ahead(map: &CityMap, from: WayAhead, route: &[LaneId]) -> Vec<WayAhead> {
    if let Some(index) = route.iter().position(|lane| *lane == from.lane) {
        let mut begins_m = from.begins_m;
        let stretch = |lane: &LaneId| {
            let here = WayAhead { lane: *lane, begins_m };
            begins_m += map.lane(*lane).curve.length();
            here
        };
        let lanes = route[index..].iter().map(stretch);
        return lanes.take_while(|stretch| stretch.begins_m < SIGHT_M).take(MOST_LANES).collect();
    }
    let (mut open, mut way) = (VecDeque::from([from]), Vec::<WayAhead>::new());
    while let Some(stretch) = open.pop_front() {
        let is_known = way.iter().any(|known| known.lane == stretch.lane);
        if is_known || stretch.begins_m > SIGHT_M || way.len() >= MOST_LANES {
            continue;
        }
        way.push(stretch);
        let lane = map.lane(stretch.lane);
        let begins_m = stretch.begins_m + lane.curve.length();
        open.extend(lane.successors.iter().map(|lane| WayAhead { lane: *lane, begins_m }));
    }
    way
}

/// Points of a body along its axis, from the rear bumper to the front bumper.
fn body_points(state: &VehicleState, info: &VehicleInfo) -> [DVec2; 4] {
    let (pose, half_m) = (state.pose(), info.dimensions.length_m / 2.0);
    [-1.0, -0.34, 0.34, 1.0].map(|share| pose.point_at(share * half_m, 0.0))
}

impl TrafficPlace {
    /// The place of a vehicle, with the vehicle ahead on its way; `None` where it is on no lane. Without a route, its way is
    /// any that leads on.
    pub fn of(
        (map, finder): (&CityMap, &LaneFinder),
        snapshot: &FrameSnapshot,
        id: VehicleId,
        route: &[LaneId],
    ) -> Option<Self> {
        let (state, info) = (snapshot.vehicle(id)?, snapshot.info(id)?);
        let (pose, dimensions) = (state.pose(), &info.dimensions);
        let axle_pose = Pose2::at(pose.point_at(dimensions.front_axle_m(), 0.0), pose.yaw_rad);
        let axle = finder.lane_pose(map, &axle_pose, route)?;
        let overhang_m = dimensions.length_m / 2.0 - dimensions.front_axle_m();
        let begins_m = -(axle.at_m + overhang_m);
        let way = way_ahead(map, WayAhead { lane: axle.lane, begins_m }, route);
        let front = pose.point_at(dimensions.length_m / 2.0, 0.0);
        let in_sight = |other: &VehicleState| {
            other.id != id && other.position.truncate().distance(front) < SIGHT_M + dimensions.length_m
        };
        let others = snapshot.iter().filter(|(other, _)| in_sight(other));
        let nearest = others.filter_map(|(other, info)| {
            let rear = nearest_point(map, &way, &body_points(other, info))?;
            // Along the way where it is: in a bend both drive along it in different directions.
            let along = other.forward().dot(rear.direction).max(0.0);
            let (gap_m, leader_mps) = (rear.at_m, speed_of(other) * along);
            let following = Following { gap_m, speed_mps: speed_of(state), leader_mps };
            Some(LeaderAhead { vehicle: other.id, following, rear: rear.point })
        });
        let leader = nearest.min_by(|a, b| a.following.gap_m.total_cmp(&b.following.gap_m));
        Some(Self { axle, front, leader })
    }
}

/// The nearest of some points of a body that are ahead on a way, with its distance along it. A body whose front is beside or
/// behind the front bumper is not ahead.
fn nearest_point(map: &CityMap, way: &[WayAhead], points: &[DVec2; 4]) -> Option<PointOnWay> {
    let on_way = |point: DVec2| {
        let feet = way.iter().filter_map(|stretch| {
            let lane = map.lane(stretch.lane);
            let foot = lane.curve.project(point);
            let is_beside = foot.s > 0.0 && foot.s < lane.curve.length();
            let direction = || lane.curve.at(foot.s).pose.forward();
            (is_beside && foot.distance < lane.width_m / 2.0).then(|| PointOnWay {
                at_m: stretch.begins_m + foot.s,
                point,
                direction: direction(),
            })
        });
        feet.filter(|found| found.at_m < SIGHT_M).min_by(|a, b| a.at_m.total_cmp(&b.at_m))
    };
    let found: Vec<PointOnWay> = points.iter().filter_map(|point| on_way(*point)).collect();
    let farthest_m = found.iter().map(|found| found.at_m).fold(f64::NEG_INFINITY, f64::max);
    (farthest_m > 0.0).then_some(())?;
    found.into_iter().min_by(|a, b| a.at_m.total_cmp(&b.at_m))
}

/// A point of a body on a way: how far ahead it is, and where the way leads there.
#[derive(Clone, Copy, Debug)]
struct PointOnWay {
    at_m: f64,
    point: DVec2,
    direction: DVec2,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::runner::Run;
    use crate::scenario::{Library, Overrides, read_experiment};
    use std::sync::Arc;

    fn run(name: &str) -> Run {
        let (text, library) = Library::scenario(name).unwrap();
        let experiment = read_experiment("test", &text, &library, Overrides::default()).unwrap();
        Run::new(Arc::new(experiment)).unwrap()
    }

    #[test]
    fn leaders_and_gaps_are_those_of_the_control_framework() {
        let mut run = run("roundabout");
        let experiment = Arc::clone(run.experiment());
        let (map, scale) = (&experiment.city_map, experiment.scale);
        let finder = LaneFinder::new(map);
        let (mut compared, mut missed) = (0, 0);
        for tick in 1..=3000_u64 {
            run.step();
            if tick % 50 != 0 {
                continue;
            }
            for cav in run.mainframe().cavs().iter().filter(|cav| cav.is_on_route()) {
                let limit = run.mainframe().limit_of(cav.id).unwrap();
                let is_leader = limit.reason == city3d_protocol::snapshot::DecisionReason::Leader;
                let Some(leader) = limit.other.filter(|_| is_leader) else { continue };
                let place = TrafficPlace::of((map, &finder), run.snapshot(), cav.id, cav.route.lanes());
                let place = place.unwrap_or_else(|| panic!("{} is on its route", cav.id));
                let gap_m = scale.city_from_lab(limit.gap_m.unwrap());
                compared += 1;
                let is_same = place.leader.is_some_and(|found| {
                    found.vehicle == leader && (found.following.gap_m - gap_m).abs() < 1.0
                });
                missed += u32::from(!is_same);
            }
        }
        // Where ways part or meet, the framework heeds bodies that still reach into the lane.
        assert!(compared > 100 && missed * 20 < compared, "{missed} of {compared} differ");
    }

    #[test]
    fn a_vehicle_ahead_in_a_bend_counts_with_all_of_its_speed() {
        let mut run = run("roundabout");
        let experiment = Arc::clone(run.experiment());
        let (map, finder) = (&experiment.city_map, LaneFinder::new(&experiment.city_map));
        let mut in_bends = 0;
        for _ in 0..3000 {
            run.step();
            let snapshot = run.snapshot();
            for cav in run.mainframe().cavs().iter().filter(|cav| cav.is_on_route()) {
                let place = TrafficPlace::of((map, &finder), snapshot, cav.id, cav.route.lanes());
                let Some(leader) = place.and_then(|place| place.leader) else { continue };
                let [own, ahead] = [cav.id, leader.vehicle].map(|id| snapshot.vehicle(id).unwrap());
                let follows = run.mainframe().cav(leader.vehicle).unwrap().route.lanes();
                // Who crosses the way does not drive along it.
                if own.forward().dot(ahead.forward()) > 0.9 || !cav.route.lanes().ends_with(&follows[1..]) {
                    continue;
                }
                in_bends += 1;
                let leader_mps = leader.following.leader_mps;
                assert!((leader_mps - ahead.speed_mps).abs() < 0.05 * ahead.speed_mps + 0.05, "{leader:?}");
            }
        }
        assert!(in_bends > 100, "{in_bends}");
    }

    #[test]
    fn headway_is_gap_over_speed_and_a_standing_vehicle_has_none() {
        let leader = |speed_mps: f64| LeaderAhead {
            vehicle: VehicleId(2),
            following: Following { gap_m: 20.0, speed_mps, leader_mps: 5.0 },
            rear: DVec2::ZERO,
        };
        assert_eq!(leader(10.0).headway_s(), Some(2.0));
        assert_eq!(leader(10.0).following.ttc_s(), Some(4.0));
        assert_eq!(leader(0.1).headway_s(), None);
    }
}
