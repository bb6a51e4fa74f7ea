//! Position and speed of a vehicle along its route, estimated from measured poses by the Kalman filter of
//! [`estimation`](city3d_estimation).

use super::off_route::METRES_PER_RAD;
use super::{CavGeometry, Route};
use city3d_estimation::{MotionEstimate, MotionFilter, NoiseModel};
use city3d_geometry::lab::Pose2;
use city3d_geometry::{CurveProjection, Lab, trig, wrap_angle};
use city3d_protocol::wire::Measurement;
use city3d_roadmap::LabMap;
use glam::DVec2;

/// Search window around the expected position on the route, laboratory metres.
const SEARCH_BEHIND_M: f64 = 0.15;
const SEARCH_AHEAD_M: f64 = 0.40;
/// A vehicle not measured for longer than this is lost.
const LOST_AFTER_S: f64 = 0.5;
/// A lost vehicle counts as stopped where it was predicted this long after its last pose, as in the city.
const STANDS_AFTER_S: f64 = 0.25;
/// By then a vehicle that has lost its link brakes.
const NOTICES_S: f64 = 1.0;
/// Largest distance from the first lanes of the route at the start.
const BEGINS_WITHIN_M: f64 = 0.1;

/// Filter of a vehicle, and its state along the route at the newest stamp.
#[derive(Clone, Debug)]
pub struct RouteEstimate {
    filter: MotionFilter<Lab>,
    /// Motion at the newest stamp; `None` before the first pose.
    motion: Option<MotionEstimate<Lab>>,
    /// Stamp of the newest pose.
    pub stamp_s: f64,
    /// Time of arrival of that pose.
    heard_s: f64,
    /// Front-axle centre along the route at that time.
    pub axle_s: f64,
    /// Speed of the front axle along the route; 0 in reverse.
    pub speed_mps: f64,
    /// Front-axle centre from the route, left-positive.
    pub lateral_m: f64,
    /// Unit vector along the route at the front axle.
    along: DVec2,
    front_axle_m: f64,
}

/// State along the route at a time.
#[derive(Clone, Copy, Debug)]
pub struct RouteState {
    /// Front-axle centre along the route.
    pub axle_s: f64,
    /// Speed along the route; 0 if the vehicle is lost.
    pub speed_mps: f64,
    /// Standard deviation of the arc length.
    pub position_std_m: f64,
}

/// Difference of the same place in two passages by rounding.
const SAME_PLACE_M: f64 = 1e-6;

/// The nearest place of a route for a vehicle, by its front axle and its heading: where lanes overlap, as before an exit of
/// a roundabout, the heading tells them apart. Of several passages the first.
fn nearest_along(map: &LabMap, (route, body): (&Route, CavGeometry), pose: Pose2) -> Option<CurveProjection> {
    let axle = pose.point_at(body.front_axle_m(), 0.0);
    // The rear axle trails behind on the same way.
    let heading_at = |axle_s: f64| {
        let [front, rear] = [axle_s, axle_s - body.wheelbase_m].map(|s| route.at(map, s).pose.position);
        let way = front - rear;
        trig::atan2(way.y, way.x)
    };
    let places: Vec<_> = (0..route.lanes().len())
        .map(|lane| {
            let foot = route.project(map, axle, route.lane_start(lane), route.lane_end(lane + 1));
            let turn_rad = wrap_angle(pose.yaw_rad - heading_at(foot.s)).abs();
            (foot.distance + turn_rad * METRES_PER_RAD, foot)
        })
        .collect();
    let least_m = places.iter().map(|(cost_m, _)| *cost_m).min_by(f64::total_cmp)?;
    places.iter().find(|(cost_m, _)| *cost_m <= least_m + SAME_PLACE_M).map(|(_, foot)| *foot)
}

impl RouteEstimate {
    /// Starts from the first pose of a vehicle; its speed is that of its setup, or unknown.
    pub fn first(
        map: &LabMap,
        (route, body): (&Route, CavGeometry),
        now_s: f64,
        seen: &Measurement,
        speed_mps: Option<f64>,
    ) -> Self {
        let pose = seen.pose_in_lab();
        let axle = pose.point_at(body.front_axle_m(), 0.0);
        let mut foot = route.project(map, axle, 0.0, route.lane_end(1));
        if foot.distance > BEGINS_WITHIN_M {
            // Control has started while the vehicle was under way.
            foot = nearest_along(map, (route, body), pose).unwrap_or(foot);
        }
        let filter = match speed_mps {
            Some(speed_mps) => MotionFilter::moving(NoiseModel::LABORATORY, seen.stamp_s, pose, speed_mps),
            None => {
                let mut filter = MotionFilter::new(NoiseModel::LABORATORY);
                filter.update(seen.stamp_s, pose);
                filter
            }
        };
        Self {
            motion: filter.at(seen.stamp_s),
            filter,
            stamp_s: seen.stamp_s,
            heard_s: now_s,
            axle_s: foot.s,
            speed_mps: speed_mps.unwrap_or(0.0),
            lateral_m: foot.lateral,
            along: route.at(map, foot.s).pose.forward(),
            front_axle_m: body.front_axle_m(),
        }
    }

    /// Finds a vehicle that was under way at its first pose again, anywhere on its route.
    pub fn locate(&mut self, map: &LabMap, (route, body): (&Route, CavGeometry)) {
        let Some(motion) = self.motion else { return };
        if let Some(foot) = nearest_along(map, (route, body), motion.pose) {
            (self.axle_s, self.lateral_m) = (foot.s, foot.lateral);
            self.along = route.at(map, foot.s).pose.forward();
            self.speed_mps = self.speed_along(&motion, motion.pose.forward());
        }
    }

    /// Adds a newer pose and returns the heading of the route there; older ones are ignored.
    pub fn update(
        &mut self,
        map: &LabMap,
        (route, body): (&Route, CavGeometry),
        now_s: f64,
        seen: &Measurement,
    ) -> Option<f64> {
        let dt_s = seen.stamp_s - self.stamp_s;
        if dt_s <= 0.0 {
            return None;
        }
        let expected_s = self.axle_s + self.speed_mps * dt_s;
        // A lost vehicle is re-localised where it is found.
        let earliest_s = if self.is_lost(now_s) { self.axle_s } else { expected_s };
        self.filter.update(seen.stamp_s, seen.pose_in_lab());
        self.motion = self.filter.at(seen.stamp_s);
        let motion = self.motion?;
        let forward = motion.pose.forward();
        let axle = motion.pose.point_towards(forward, body.front_axle_m(), 0.0);
        let foot = route.project(map, axle, earliest_s - SEARCH_BEHIND_M, expected_s + SEARCH_AHEAD_M);
        let along = route.at(map, foot.s).pose;
        self.along = along.forward();
        self.axle_s = foot.s;
        self.speed_mps = self.speed_along(&motion, forward);
        (self.stamp_s, self.heard_s, self.lateral_m) = (seen.stamp_s, now_s, foot.lateral);
        Some(along.yaw_rad)
    }

    /// Speed of the front axle along the route; 0 in reverse. With the unit vector of the heading.
    fn speed_along(&self, motion: &MotionEstimate<Lab>, forward: DVec2) -> f64 {
        let turning = forward.perp() * (motion.yaw_rate_radps * self.front_axle_m);
        (motion.velocity_mps + turning).dot(self.along).max(0.0)
    }

    /// Speed of the middle of the vehicle along its heading.
    pub fn heading_mps(&self) -> f64 {
        self.motion.map_or(0.0, |motion| motion.speed_mps)
    }

    /// Whether it has not been measured for too long.
    pub fn is_lost(&self, now_s: f64) -> bool {
        now_s - self.heard_s > LOST_AFTER_S
    }

    /// Predicted position and speed at a later time.
    pub fn at(&self, time_s: f64) -> RouteState {
        let is_lost = self.is_lost(time_s);
        let until_s = if is_lost { self.heard_s + STANDS_AFTER_S } else { time_s };
        let dt_s = until_s - self.stamp_s;
        let expected = self.filter.at(until_s);
        let std = expected.map_or(0.0, |motion| motion.std.position_m);
        // It has turned with the route since the pose.
        let gained_mps = expected.map_or(0.0, |motion| motion.velocity_mps.length())
            - self.motion.map_or(0.0, |motion| motion.velocity_mps.length());
        let speed_mps = (self.speed_mps + gained_mps).max(0.0);
        let axle_s = self.axle_s + (self.speed_mps + speed_mps) / 2.0 * dt_s;
        RouteState { axle_s, speed_mps: if is_lost { 0.0 } else { speed_mps }, position_std_m: std }
    }

    /// Farthest position of a lost vehicle that stops within a distance.
    pub fn farthest_if_lost(&self, stopping_m: f64) -> f64 {
        let goes_on_s = self.heard_s + NOTICES_S - self.stamp_s;
        self.axle_s + self.speed_mps * goes_on_s + stopping_m
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use city3d_roadmap::load_map;

    fn map() -> LabMap {
        load_map(include_bytes!("../../../assets/maps/ids3c.dxf")).unwrap().map
    }

    const BODY: CavGeometry =
        CavGeometry { length_m: 0.19, width_m: 0.08, wheelbase_m: 0.11, min_turn_radius_m: 0.2 };

    /// Two laps of a roundabout, and out of it.
    fn route(map: &LabMap) -> Route {
        let id = |name: &str| map.lane_by_name(name).unwrap().id;
        let lap = |from: &str, to: &str| map.shortest_route(id(from), id(to), |_| true).unwrap();
        let ring = "east-roundabout/ring/inner/2";
        let out = "south-boulevard/west/inner/1";
        let round = lap(map.lane(map.lane(id(ring)).successors[0]).name.as_str(), ring);
        let mut lanes = vec![id(ring)];
        lanes.extend([&round[..], &round[..], &lap(ring, out)[1..]].concat());
        Route::without_speeds(map, &lanes, BODY)
    }

    #[test]
    fn a_vehicle_under_way_is_found_in_the_first_passage_of_its_place() {
        let map = map();
        let route = route(&map);
        for k in 0..route.lanes().len() {
            let lane = route.lanes()[k];
            let first = route.lanes().iter().position(|other| *other == lane).unwrap();
            let length_m = route.lane_end(k + 1) - route.lane_start(k);
            for part in [0.2, 0.4, 0.6, 0.8] {
                let expected_s = route.lane_start(first) + part * length_m;
                if expected_s < BODY.wheelbase_m {
                    // Before the route there is no way.
                    continue;
                }
                let axle_s = route.lane_start(k) + part * length_m;
                let [axle, rear] =
                    [axle_s, axle_s - BODY.wheelbase_m].map(|s| route.at(&map, s).pose.point_at(0.0, 0.01));
                let pose = Pose2::at((axle + rear) / 2.0, trig::atan2(axle.y - rear.y, axle.x - rear.x));
                let foot = nearest_along(&map, (&route, BODY), pose).unwrap();
                assert!(
                    (foot.s - expected_s).abs() < 0.02,
                    "{} {part}: {} {expected_s}",
                    map.lane(lane).name,
                    foot.s
                );
            }
        }
    }
}
