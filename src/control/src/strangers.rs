//! Vehicles that others control, such as a guest's car: they are followed like leaders, on whatever lane they are.

use super::{Cav, LeaderState};
use city3d_estimation::{MotionEstimate, MotionFilter, NoiseModel};
use city3d_geometry::{Lab, wrap_angle};
use city3d_protocol::snapshot::VehicleId;
use city3d_protocol::wire::Measurement;
use city3d_roadmap::{LabMap, LaneId, LaneIndex};
use std::collections::BTreeMap;

/// Half of the length and of the width that strangers are taken to have: those of the laboratory's largest cars.
const HALF_LENGTH_M: f64 = 0.11;
const HALF_WIDTH_M: f64 = 0.05;
/// A stranger that has not been measured for this long is gone.
const FORGOTTEN_AFTER_S: f64 = 5.0;
/// A stranger that crosses a lane at more than this angle does not drive along it.
const ALONG_RAD: f64 = 0.8;

/// The vehicles that are measured and not controlled.
#[derive(Debug, Default)]
pub(super) struct Strangers {
    filters: BTreeMap<VehicleId, MotionFilter<Lab>>,
    /// Where they are on the lanes at the present step.
    on_lanes: BTreeMap<LaneId, Vec<Occupant>>,
}

/// A stranger on a lane: its bumpers and its speed along that lane.
#[derive(Clone, Copy, Debug)]
struct Occupant {
    front_m: f64,
    rear_m: f64,
    speed_mps: f64,
}

impl Strangers {
    pub fn update(&mut self, seen: &Measurement) {
        let filter =
            self.filters.entry(seen.vehicle).or_insert_with(|| MotionFilter::new(NoiseModel::LABORATORY));
        filter.update(seen.stamp_s, seen.pose_in_lab());
    }

    /// Forgets a vehicle that is controlled from now on.
    pub fn forget(&mut self, id: VehicleId) {
        self.filters.remove(&id);
    }

    /// Finds them on the lanes at a time.
    pub fn advance_to(&mut self, (map, lanes): (&LabMap, &LaneIndex), time_s: f64) {
        self.on_lanes.clear();
        self.filters.retain(|_, filter| {
            filter.last_stamp_s().is_some_and(|stamp_s| time_s - stamp_s < FORGOTTEN_AFTER_S)
        });
        for motion in self.filters.values().filter_map(|filter| filter.at(time_s)) {
            for lane in lanes.near(motion.pose.position, reach_m(lanes.widest_m())) {
                if let Some(occupant) = occupant(map.lane(lane), &motion) {
                    self.on_lanes.entry(lane).or_default().push(occupant);
                }
            }
        }
    }

    /// Front and rear bumper along a lane, and speed along it, of the strangers on it.
    pub fn on(&self, lane: LaneId) -> impl Iterator<Item = (f64, f64, f64)> + '_ {
        let here = self.on_lanes.get(&lane).into_iter().flatten();
        here.map(|other| (other.front_m, other.rear_m, other.speed_mps))
    }

    /// The nearest one ahead on the route of a vehicle.
    pub fn leader(&self, cav: &Cav, within_m: f64) -> Option<LeaderState> {
        if self.on_lanes.is_empty() {
            return None;
        }
        let (route, front_s) = (&cav.route, cav.front_s());
        let mut nearest: Option<(f64, f64)> = None;
        for index in route.index_at(front_s)..route.lanes().len() {
            let start = route.lane_start(index);
            if start > front_s + within_m {
                break;
            }
            for other in self.on_lanes.get(&route.lanes()[index]).into_iter().flatten() {
                let (rear_s, is_ahead) = (start + other.rear_m, start + other.front_m > front_s);
                if is_ahead && rear_s < front_s + within_m && nearest.is_none_or(|(least, _)| rear_s < least)
                {
                    nearest = Some((rear_s, other.speed_mps));
                }
            }
        }
        nearest.map(|(rear_s, speed_mps)| LeaderState { gap_m: rear_s - front_s, speed_mps })
    }
}

/// From the centre line of a lane, how far the middle of a stranger on it may be.
fn reach_m(width_m: f64) -> f64 {
    width_m / 2.0 + HALF_WIDTH_M / 2.0
}

/// Where a stranger is on a lane; `None` where it is not on it.
fn occupant(lane: &city3d_roadmap::Lane<Lab>, motion: &MotionEstimate<Lab>) -> Option<Occupant> {
    let foot = lane.curve.project(motion.pose.position);
    if foot.distance > reach_m(lane.width_m) {
        return None;
    }
    let angle = wrap_angle(motion.pose.yaw_rad - lane.curve.at(foot.s).pose.yaw_rad).abs();
    // Who crosses a lane, or comes the other way, is an obstacle that stands.
    let speed_mps = if angle < ALONG_RAD { motion.speed_mps.max(0.0) } else { 0.0 };
    Some(Occupant { front_m: foot.s + HALF_LENGTH_M, rear_m: foot.s - HALF_LENGTH_M, speed_mps })
}
