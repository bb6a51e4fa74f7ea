//! Where a vehicle is on its route and how fast it goes, from measured poses alone.

use super::{Body, Route};
use crate::city::LabMap;
use crate::wire::Measurement;

/// Share of the residual that corrects the position.
const ALPHA: f64 = 0.6;
/// Share of the residual, over the time between two poses, that corrects the speed.
const BETA: f64 = 0.2;
/// Poses nearer to one another in time tell nothing about speed: stamps of several clocks jitter.
const SHORTEST_S: f64 = 0.005;
/// How far around the expected place the foot on the route is looked for, laboratory metres.
const SEARCH_BEHIND_M: f64 = 0.15;
const SEARCH_AHEAD_M: f64 = 0.40;
/// A vehicle farther than this from the first lanes of its route does not begin there.
const BEGINS_WITHIN_M: f64 = 0.1;

/// An alpha-beta filter over the arc length along the route.
#[derive(Clone, Copy, Debug)]
pub struct Estimate {
    /// Stamp of the newest pose.
    pub stamp_s: f64,
    /// Front-axle centre along the route at that time.
    pub axle_s: f64,
    pub speed_mps: f64,
    /// Front-axle centre from the route, left-positive.
    pub lateral_m: f64,
}

impl Estimate {
    /// From the first pose of a vehicle, whose speed is that of its setup.
    pub fn first(map: &LabMap, route: &Route, body: Body, seen: &Measurement, speed_mps: f64) -> Self {
        let axle = seen.pose_in_lab().point_at(body.front_axle_m(), 0.0);
        let mut foot = route.project(map, axle, 0.0, route.lane_end(1));
        if foot.distance > BEGINS_WITHIN_M {
            // Control has begun while the vehicle was on its way.
            foot = route.project(map, axle, 0.0, route.length());
        }
        Self { stamp_s: seen.stamp_s, axle_s: foot.s, speed_mps, lateral_m: foot.lateral }
    }

    /// Takes a newer pose in; one that is not newer is ignored.
    pub fn update(&mut self, map: &LabMap, route: &Route, body: Body, seen: &Measurement) {
        let dt_s = seen.stamp_s - self.stamp_s;
        if dt_s <= 0.0 {
            return;
        }
        let expected_s = self.axle_at(seen.stamp_s);
        let axle = seen.pose_in_lab().point_at(body.front_axle_m(), 0.0);
        let foot = route.project(map, axle, expected_s - SEARCH_BEHIND_M, expected_s + SEARCH_AHEAD_M);
        let residual = foot.s - expected_s;
        self.stamp_s = seen.stamp_s;
        self.axle_s = expected_s + ALPHA * residual;
        self.speed_mps = (self.speed_mps + BETA * residual / dt_s.max(SHORTEST_S)).max(0.0);
        self.lateral_m = foot.lateral;
    }

    /// Expected place at a later time.
    pub fn axle_at(&self, time_s: f64) -> f64 {
        self.axle_s + self.speed_mps * (time_s - self.stamp_s)
    }
}
