//! Where a vehicle is on its route and how fast it goes along it, from measured poses alone: the filter of
//! [`estimation`](crate::estimation), seen along the route.

use super::{Body, Route};
use crate::city::LabMap;
use crate::estimation::{MotionEstimate, MotionFilter, NoiseModel};
use crate::wire::Measurement;

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

/// The filter of a vehicle, and its place on the route at the newest stamp.
#[derive(Clone, Debug)]
pub struct Estimate {
    filter: MotionFilter,
    /// At the newest stamp; none before the filter has one.
    motion: Option<MotionEstimate>,
    /// Stamp of the newest pose.
    pub stamp_s: f64,
    /// When that pose had come.
    heard_s: f64,
    /// Front-axle centre along the route at that time.
    pub axle_s: f64,
    pub speed_mps: f64,
    /// Front-axle centre from the route, left-positive.
    pub lateral_m: f64,
    /// Unit vector along the route at the front axle.
    along: glam::DVec2,
    front_axle_m: f64,
}

/// Along the route at a time.
#[derive(Clone, Copy, Debug)]
pub struct Place {
    pub axle_s: f64,
    pub speed_mps: f64,
    /// Standard deviation of the arc length.
    pub position_std_m: f64,
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
        let pose = seen.pose_in_lab();
        let axle = pose.point_at(body.front_axle_m(), 0.0);
        let mut foot = route.project(map, axle, 0.0, route.lane_end(1));
        if foot.distance > BEGINS_WITHIN_M {
            // Control has begun while the vehicle was on its way.
            foot = route.project(map, axle, 0.0, route.length());
        }
        let filter = MotionFilter::moving(NoiseModel::LABORATORY, seen.stamp_s, pose, speed_mps);
        Self {
            motion: filter.at(seen.stamp_s),
            filter,
            stamp_s: seen.stamp_s,
            heard_s: now_s,
            axle_s: foot.s,
            speed_mps,
            lateral_m: foot.lateral,
            along: route.at(map, foot.s).pose.forward(),
            front_axle_m: body.front_axle_m(),
        }
    }

    /// Takes a newer pose in; one that is not newer is ignored.
    pub fn update(&mut self, map: &LabMap, (route, body): (&Route, Body), now_s: f64, seen: &Measurement) {
        let dt_s = seen.stamp_s - self.stamp_s;
        if dt_s <= 0.0 {
            return;
        }
        let expected_s = self.axle_s + self.speed_mps * dt_s;
        // One that was lost is where it is found, and has come there somehow.
        let earliest_s = if self.is_lost(now_s) { self.axle_s } else { expected_s };
        self.filter.update(seen.stamp_s, seen.pose_in_lab());
        self.motion = self.filter.at(seen.stamp_s);
        let Some(motion) = self.motion else { return };
        let axle = motion.pose.point_at(body.front_axle_m(), 0.0);
        let foot = route.project(map, axle, earliest_s - SEARCH_BEHIND_M, expected_s + SEARCH_AHEAD_M);
        self.along = route.at(map, foot.s).pose.forward();
        self.axle_s = foot.s;
        self.speed_mps = self.speed_along(&motion);
        (self.stamp_s, self.heard_s, self.lateral_m) = (seen.stamp_s, now_s, foot.lateral);
    }

    /// Speed of the front axle along the route; 0 backwards.
    fn speed_along(&self, motion: &MotionEstimate) -> f64 {
        let turning = motion.pose.forward().perp() * (motion.yaw_rate_radps * self.front_axle_m);
        (motion.velocity_mps + turning).dot(self.along).max(0.0)
    }

    /// Of the middle of the vehicle along its heading.
    pub fn heading_mps(&self) -> f64 {
        self.motion.map_or(0.0, |motion| motion.speed_mps)
    }

    /// Whether it has not been seen for too long to say what it does now.
    pub fn is_lost(&self, now_s: f64) -> bool {
        now_s - self.heard_s > LOST_AFTER_S
    }

    /// Expected place and speed at a later time.
    pub fn at(&self, time_s: f64) -> Place {
        let is_lost = self.is_lost(time_s);
        let until_s = if is_lost { self.heard_s + STANDS_AFTER_S } else { time_s };
        let dt_s = until_s - self.stamp_s;
        let expected = self.filter.at(until_s);
        let std = expected.map_or(0.0, |motion| motion.std.position_m);
        // Until then it has turned about as its way has.
        let gained_mps = expected.map_or(0.0, |motion| motion.velocity_mps.length())
            - self.motion.map_or(0.0, |motion| motion.velocity_mps.length());
        let speed_mps = (self.speed_mps + gained_mps).max(0.0);
        let axle_s = self.axle_s + (self.speed_mps + speed_mps) / 2.0 * dt_s;
        Place { axle_s, speed_mps: if is_lost { 0.0 } else { speed_mps }, position_std_m: std }
    }

    /// The farthest place at which a vehicle that is lost may be, if it comes to a stand within a way.
    pub fn farthest_if_lost(&self, stopping_m: f64) -> f64 {
        let goes_on_s = self.heard_s + NOTICES_S - self.stamp_s;
        self.axle_s + self.speed_mps * goes_on_s + stopping_m
    }
}
