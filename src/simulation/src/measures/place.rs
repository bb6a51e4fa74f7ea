//! Position of a vehicle along its route, from its poses. Laboratory metres.

use city3d_control::{CavGeometry, Route};
use city3d_geometry::{Lab, Pose2};
use city3d_roadmap::LabMap;
use glam::DVec2;
use std::sync::Arc;

/// A vehicle at an instant, along its route.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Station {
    /// Simulated time.
    pub time_s: f64,
    /// Front bumper along the route.
    pub front_s: f64,
    /// Along its heading.
    pub speed_mps: f64,
}

impl Station {
    /// When the front passed a position between this instant and a later one, with the speed there: linear
    /// interpolation.
    pub fn passing(&self, later: &Self, front_s: f64) -> Self {
        let way = later.front_s - self.front_s;
        let share = if way > 0.0 { ((front_s - self.front_s) / way).clamp(0.0, 1.0) } else { 1.0 };
        Self {
            time_s: self.time_s + share * (later.time_s - self.time_s),
            front_s,
            speed_mps: self.speed_mps + share * (later.speed_mps - self.speed_mps),
        }
    }
}

/// A vehicle is on its route while its front axle is this close to it, laboratory metres: half a lane and a bit.
const ON_ROUTE_M: f64 = 0.11;
/// Longest way between two samples that is searched, laboratory metres.
const REACH_M: f64 = 0.5;
/// A later place of the route is taken where it is nearer by this much.
const CLEARLY_M: f64 = 0.02;
/// How far back a vehicle may be since the last sample.
const BACK_M: f64 = 0.1;

/// Follows a vehicle along its route.
#[derive(Clone, Debug)]
pub struct RoutePlace {
    /// The present route.
    pub route: Arc<Route>,
    /// Changes of the route that the control framework has counted.
    pub reroutes: u32,
    body: CavGeometry,
    axle_s: Option<f64>,
    /// Whether the route was compared with the control framework's.
    is_compared: bool,
}

impl RoutePlace {
    /// A vehicle that is somewhere on this route.
    pub fn new(route: Arc<Route>, body: CavGeometry, reroutes: u32) -> Self {
        Self { route, reroutes, body, axle_s: None, is_compared: false }
    }

    /// Another route that begins with the lanes of this one up to where the vehicle is: there it stays. On any other route
    /// it is looked for.
    pub fn rerouted(&self, route: Arc<Route>, reroutes: u32) -> Self {
        let is_kept = |axle_s: &f64| {
            let count = self.route.index_at(*axle_s) + 1;
            route.lanes().get(..count) == self.route.lanes().get(..count)
        };
        let axle_s = self.axle_s.filter(is_kept);
        Self { axle_s, ..Self::new(route, self.body, reroutes) }
    }

    /// Shares the control framework's copy of the route where it is the same: that of a day is large.
    pub fn share(&mut self, route: &Arc<Route>) {
        if !std::mem::replace(&mut self.is_compared, true) && **route == *self.route {
            self.route = Arc::clone(route);
        }
    }

    /// Dimensions of the vehicle.
    pub fn body(&self) -> CavGeometry {
        self.body
    }

    /// Front axle along the route for a position of the front bumper.
    pub fn axle_s(&self, front_s: f64) -> f64 {
        self.body.axle_of_front(front_s)
    }

    /// Arc length of the front bumper for a pose of the middle of the outline; `None` off the route.
    pub fn front_s(&mut self, map: &LabMap, pose: &Pose2<Lab>) -> Option<f64> {
        let axle = pose.point_at(self.body.front_axle_m(), 0.0);
        let near = self.axle_s.and_then(|last_s| self.near(map, axle, last_s));
        self.axle_s = near.or_else(|| self.anywhere(map, axle, pose.forward()));
        self.axle_s.map(|axle_s| axle_s + self.body.overhang_m())
    }

    /// Whether a vehicle can have come from one position to another between two samples.
    pub fn is_within_reach(from_s: f64, to_s: f64) -> bool {
        (-BACK_M..=REACH_M).contains(&(to_s - from_s))
    }

    fn near(&self, map: &LabMap, axle: DVec2, last_s: f64) -> Option<f64> {
        let foot = self.route.project(map, axle, last_s - BACK_M, last_s + REACH_M);
        (foot.distance < ON_ROUTE_M).then_some(foot.s)
    }

    /// The place of the route under the axle where it leads in the direction of travel. A later one has to be clearly nearer:
    /// lanes of later passages lie over one another.
    fn anywhere(&self, map: &LabMap, axle: DVec2, forward: DVec2) -> Option<f64> {
        let mut best: Option<(f64, f64)> = None;
        for (index, &lane) in self.route.lanes().iter().enumerate() {
            let curve = &map.lane(lane).curve;
            let foot = curve.project(axle);
            let leads_on = curve.at(foot.s).pose.forward().dot(forward) > 0.5;
            let is_nearer = best.is_none_or(|(distance, _)| foot.distance < distance - CLEARLY_M);
            if foot.distance < ON_ROUTE_M && leads_on && is_nearer {
                best = Some((foot.distance, self.route.lane_start(index) + foot.s));
            }
        }
        best.map(|(_, s)| s)
    }
}

/// A vehicle that drives the same way alone: from the same speed, with the greatest acceleration, at the speed profile
/// of the route. What it saves is the delay of the real one.
#[derive(Clone, Copy, Debug)]
pub struct FreeRun {
    at_s: f64,
    speed_mps: f64,
    /// Time since its start.
    pub time_s: f64,
}

/// Largest step of the integration along the route, the resolution of its speed profile.
const FREE_STEP_M: f64 = 0.02;
/// Least speed of the profile that is divided by.
const LEAST_MPS: f64 = 1e-3;

impl FreeRun {
    /// Starts at a position of the front bumper.
    pub fn new(front_s: f64, speed_mps: f64) -> Self {
        Self { at_s: front_s, speed_mps: speed_mps.max(0.0), time_s: 0.0 }
    }

    /// Drives on to a position of the front bumper.
    pub fn drive_to(&mut self, place: &RoutePlace, u_max_mps2: f64, front_s: f64) {
        while self.at_s < front_s {
            let next_s = (self.at_s + FREE_STEP_M).min(front_s);
            let step_m = next_s - self.at_s;
            let allowed_mps = place.route.speed_at(place.axle_s(next_s));
            let reached = (self.speed_mps * self.speed_mps + 2.0 * u_max_mps2 * step_m).sqrt();
            let next_mps = reached.min(allowed_mps);
            self.time_s += 2.0 * step_m / (self.speed_mps + next_mps).max(LEAST_MPS);
            (self.at_s, self.speed_mps) = (next_s, next_mps);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::{Library, Overrides, read_experiment};

    #[test]
    fn a_vehicle_keeps_its_place_on_a_route_with_the_same_beginning() {
        let (text, library) = Library::scenario("roundabout").unwrap();
        let experiment = read_experiment("roundabout", &text, &library, Overrides::default()).unwrap();
        let (map, setup) = (&experiment.lab_map, &experiment.cav_setups()[0]);
        // Two laps: each place of the second one is a place of the first, too.
        let lap = map.shortest_loop(setup.route[0]).unwrap();
        let lanes: Vec<_> = [&setup.route[..1], &lap, &lap].concat();
        let driver = setup.driver;
        let route = |lanes: &[_]| Arc::new(Route::new(map, lanes, setup.body, &driver));
        let (longer, shorter) = (route(&lanes), route(&lanes[..lanes.len() - 1]));
        let mut place = RoutePlace::new(Arc::clone(&longer), setup.body, 0);
        let second_s = longer.lane_start(lap.len()) + 0.2;
        place.axle_s = Some(second_s);
        assert_eq!(place.rerouted(shorter, 1).axle_s, Some(second_s));
        assert_eq!(place.rerouted(route(&lanes[1..]), 1).axle_s, None);
    }

    #[test]
    fn the_time_of_passing_is_interpolated() {
        let before = Station { time_s: 2.0, front_s: 1.0, speed_mps: 0.2 };
        let after = Station { time_s: 2.1, front_s: 1.04, speed_mps: 0.6 };
        let at = before.passing(&after, 1.01);
        assert!((at.time_s - 2.025).abs() < 1e-12 && (at.speed_mps - 0.3).abs() < 1e-12, "{at:?}");
    }
}
