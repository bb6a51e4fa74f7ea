//! The trajectory message to a vehicle: its plan over the next seconds.

use super::cav::Yielding;
use super::coordination::MotionPlan;
use super::route::RouteWalk;
use super::{Cav, turn_of};
use city3d_geometry::lab::Pose2;
use city3d_geometry::{Lab, trig};
use city3d_protocol::snapshot::{Indicator, Trajectory, TrajectoryPoint};
use city3d_roadmap::{LabMap, LaneKind};

/// Waypoint times after now. At any permitted speed the distance covered by the last one exceeds the stopping
/// distance.
const OFFSETS_S: [f64; 13] = [0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.7, 0.9, 1.2, 1.5, 2.0, 2.5, 3.0];
/// Time of the last waypoint after now.
pub const HORIZON_S: f64 = OFFSETS_S[OFFSETS_S.len() - 1];
/// Assumed duration of an acceleration; braking lasts to the stop.
const ACCELERATION_LASTS_S: f64 = 1.0;
/// Distance before a turn at which indicators start, laboratory metres.
const INDICATE_M: f64 = 1.0;
/// Least angle of a turn.
const TURN_RAD: f64 = 0.7;

/// So many vehicles are planned for side by side: the waypoints of one wait for one another, and those of several do not.
pub const SIDE_BY_SIDE: usize = 4;

/// A trajectory that is being made: the plan of a vehicle up to one of its waypoints.
#[derive(Debug)]
pub struct PlanAhead {
    trajectory: Trajectory<Lab>,
    now_s: f64,
    /// Offset up to which its coordinated plan lasts, where it follows one.
    planned_until_s: f64,
    /// Arc length at which the vehicle waits.
    wait_s: f64,
    /// At the last waypoint.
    s: f64,
    speed_mps: f64,
    offset_s: f64,
    walk: RouteWalk,
}

impl PlanAhead {
    /// Begins the trajectory of a vehicle from now on, with its indicators.
    pub fn begin(map: &LabMap, cav: &mut Cav, now_s: f64, points: Vec<TrajectoryPoint<Lab>>) -> Self {
        cav.sequence = cav.sequence.wrapping_add(1);
        cav.indicator = indicator(map, cav);
        let mut trajectory =
            Trajectory { vehicle: cav.id, sequence: cav.sequence, points, ..Trajectory::default() };
        trajectory.yielding = matches!(cav.yielding, Yielding::At { .. });
        cav.note_arrival();
        trajectory.finished = cav.is_finished();
        trajectory.indicator = cav.indicator;
        let planned_until_s = followed_plan(cav).map_or(f64::NEG_INFINITY, |plan| plan.end().time_s - now_s);
        // A vehicle follows its last trajectory until the link times out: the end has to lie before the place of waiting.
        let wait_s = cav.axle_s() + cav.wait_m;
        let (s, speed_mps) = (cav.plan.axle_s, cav.plan.speed_mps);
        let walk = cav.route.walk(s);
        Self { trajectory, now_s, planned_until_s, wait_s, s, speed_mps, offset_s: 0.0, walk }
    }

    /// Makes the trajectories of several vehicles.
    pub fn finish_all(map: &LabMap, cavs: &[Cav], plans: &mut [Option<Self>]) {
        for offset_s in OFFSETS_S {
            for (plan, cav) in plans.iter_mut().zip(cavs) {
                if let Some(plan) = plan {
                    plan.add_waypoint(map, cav, offset_s);
                }
            }
        }
    }

    /// The trajectory up to the last waypoint.
    pub fn into_trajectory(self) -> Trajectory<Lab> {
        self.trajectory
    }

    fn add_waypoint(&mut self, map: &LabMap, cav: &Cav, offset_s: f64) {
        match followed_plan(cav) {
            Some(plan) if offset_s <= self.planned_until_s => {
                let here = plan.at(self.now_s + offset_s);
                (self.s, self.speed_mps) = (here.position_m, here.speed_mps);
            }
            Some(_) => self.accelerate(cav, 0.0, offset_s),
            None => self.accelerate(cav, cav.plan.acceleration_mps2, offset_s),
        }
        self.offset_s = offset_s;
        let pose = self.walk.at(map, &cav.route, self.s).pose;
        let time_s = self.now_s + offset_s;
        self.trajectory.points.push(TrajectoryPoint { time_s, pose, speed_mps: self.speed_mps });
    }

    fn accelerate(&mut self, cav: &Cav, u: f64, offset_s: f64) {
        let (s, speed_mps, dt_s) = (self.s, self.speed_mps, offset_s - self.offset_s);
        let u = if u > 0.0 && self.offset_s >= ACCELERATION_LASTS_S { 0.0 } else { u };
        let wanted_mps = (speed_mps + u * dt_s).max(0.0);
        // A bend that comes too soon is entered too fast: no plan brakes harder than u_min.
        let lowest_mps = (speed_mps + cav.driver.min_acceleration_mps2 * dt_s).max(0.0);
        let allowed_mps = cav.route.speed_at(s + speed_mps * dt_s).min(cav.driver.stopping_speed(
            self.wait_s - s,
            speed_mps,
            dt_s,
        ));
        let next_mps = wanted_mps.min(allowed_mps.max(lowest_mps));
        self.s += (speed_mps + next_mps) / 2.0 * dt_s;
        self.speed_mps = next_mps;
    }
}

/// The coordinated plan of a vehicle that follows it.
fn followed_plan(cav: &Cav) -> Option<&MotionPlan> {
    cav.coordinated_plan().filter(|_| cav.coordination.follows_plan)
}

/// Trajectory for a vehicle on no lane: straight on to a stop, with hazard lights.
pub fn stop_straight(cav: &mut Cav, now_s: f64, points: Vec<TrajectoryPoint<Lab>>) -> Trajectory<Lab> {
    cav.sequence = cav.sequence.wrapping_add(1);
    cav.indicator = Indicator::Hazard;
    let mut trajectory =
        Trajectory { vehicle: cav.id, sequence: cav.sequence, points, ..Trajectory::default() };
    trajectory.indicator = cav.indicator;
    let axle = cav.pose.point_at(cav.body.front_axle_m(), 0.0);
    let before_mps = if cav.heading_mps > super::STANDS_MPS { cav.heading_mps } else { 0.0 };
    let braking_mps2 = -cav.driver.min_acceleration_mps2;
    for offset_s in OFFSETS_S {
        let speed_mps = (before_mps - braking_mps2 * offset_s).max(0.0);
        let way_m = (trig::powi(before_mps, 2) - trig::powi(speed_mps, 2)) / (2.0 * braking_mps2);
        let pose = Pose2::at(axle + cav.pose.forward() * way_m, cav.pose.yaw_rad);
        trajectory.points.push(TrajectoryPoint { time_s: now_s + offset_s, pose, speed_mps });
    }
    trajectory
}

fn indicator(map: &LabMap, cav: &Cav) -> Indicator {
    let (from_s, to_s) = (cav.rear_s(), cav.front_s() + INDICATE_M);
    let route = &cav.route;
    for index in route.index_at(from_s)..=route.index_at(to_s) {
        let lane = map.lane(route.lanes()[index]);
        if lane.kind == LaneKind::Connector {
            let turn = turn_of(map, lane.id);
            if turn.abs() > TURN_RAD {
                return if turn > 0.0 { Indicator::Left } else { Indicator::Right };
            }
        }
    }
    Indicator::Off
}
