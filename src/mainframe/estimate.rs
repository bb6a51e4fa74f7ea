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
/// A vehicle that has not been seen for longer than this is lost: nobody knows what it does.
const LOST_AFTER_S: f64 = 0.5;
/// It is taken to stand then where it would have been so long after it was seen last, as in the city.
const STANDS_AFTER_S: f64 = 0.25;
/// By then a vehicle that has heard nothing any more has noticed that and brakes.
const NOTICES_S: f64 = 1.0;
/// A vehicle farther than this from the first lanes of its route does not begin there.
const BEGINS_WITHIN_M: f64 = 0.1;

/// An alpha-beta filter over the arc length along the route.
#[derive(Clone, Copy, Debug)]
pub struct Estimate {
    /// Stamp of the newest pose.
    pub stamp_s: f64,
    /// When that pose had come.
    heard_s: f64,
    /// Front-axle centre along the route at that time.
    pub axle_s: f64,
    pub speed_mps: f64,
    /// Front-axle centre from the route, left-positive.
    pub lateral_m: f64,
}

impl Estimate {
    /// From the first pose of a vehicle, whose speed is that of its setup.
    pub fn first(
        map: &LabMap,
        (route, body): (&Route, Body),
        now_s: f64,
        seen: &Measurement,
        speed_mps: f64,
    ) -> Self {
        let axle = seen.pose_in_lab().point_at(body.front_axle_m(), 0.0);
        let mut foot = route.project(map, axle, 0.0, route.lane_end(1));
        if foot.distance > BEGINS_WITHIN_M {
            // Control has begun while the vehicle was on its way.
            foot = route.project(map, axle, 0.0, route.length());
        }
        Self { stamp_s: seen.stamp_s, heard_s: now_s, axle_s: foot.s, speed_mps, lateral_m: foot.lateral }
    }

    /// Takes a newer pose in; one that is not newer is ignored.
    pub fn update(&mut self, map: &LabMap, (route, body): (&Route, Body), now_s: f64, seen: &Measurement) {
        let dt_s = seen.stamp_s - self.stamp_s;
        if dt_s <= 0.0 {
            return;
        }
        let axle = seen.pose_in_lab().point_at(body.front_axle_m(), 0.0);
        let expected_s = self.axle_s + self.speed_mps * dt_s;
        let was_lost = self.is_lost(now_s);
        let earliest_s = if was_lost { self.axle_s } else { expected_s };
        let foot = route.project(map, axle, earliest_s - SEARCH_BEHIND_M, expected_s + SEARCH_AHEAD_M);
        if was_lost {
            // It is where it is found, and has come there somehow.
            self.speed_mps = ((foot.s - self.axle_s) / dt_s).max(0.0);
            self.axle_s = foot.s;
        } else {
            let residual = foot.s - expected_s;
            self.axle_s = expected_s + ALPHA * residual;
            self.speed_mps = (self.speed_mps + BETA * residual / dt_s.max(SHORTEST_S)).max(0.0);
        }
        (self.stamp_s, self.heard_s, self.lateral_m) = (seen.stamp_s, now_s, foot.lateral);
    }

    /// Whether it has not been seen for too long to say what it does now.
    pub fn is_lost(&self, now_s: f64) -> bool {
        now_s - self.heard_s > LOST_AFTER_S
    }

    /// Expected place and speed at a later time.
    pub fn at(&self, time_s: f64) -> (f64, f64) {
        let is_lost = self.is_lost(time_s);
        let until_s = if is_lost { self.heard_s + STANDS_AFTER_S } else { time_s };
        let axle_s = self.axle_s + self.speed_mps * (until_s - self.stamp_s);
        (axle_s, if is_lost { 0.0 } else { self.speed_mps })
    }

    /// The farthest place at which it may be at a later time, for a vehicle that comes to a stand within a way.
    pub fn farthest_at(&self, time_s: f64, stopping_m: f64) -> f64 {
        if !self.is_lost(time_s) {
            return self.at(time_s).0;
        }
        let goes_on_s = self.heard_s + NOTICES_S - self.stamp_s;
        self.axle_s + self.speed_mps * goes_on_s + stopping_m
    }
}
