//! State of one connected and automated vehicle (CAV) in the control framework.

mod coordinated;
mod fetch;

pub(super) use fetch::{Reads, fetch_ahead};

use super::coordination::CoordinatedState;
use super::decision::Decision;
use super::estimate::RouteEstimate;
use super::limit::Limit;
use super::off_route;
use super::right_of_way::RightOfWayState;
use super::{Controller, DriverParams, Drivers, LeaderState, OwnMotion, Route, SetupError, heeds_nobody};
use city3d_geometry::lab::Pose2;
use city3d_protocol::snapshot::{Indicator, VehicleId};
use city3d_protocol::wire::Measurement;
use city3d_roadmap::{LabMap, LaneId, LaneIndex};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Dimensions of a vehicle for control, laboratory metres. The overhangs are equal, and the measured pose is
/// the middle of the outline.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CavGeometry {
    /// Of the outline, from bumper to bumper.
    pub length_m: f64,
    /// Of the outline.
    pub width_m: f64,
    /// From the rear axle to the front axle.
    pub wheelbase_m: f64,
    /// Of the front-axle centre at the steering limit.
    pub min_turn_radius_m: f64,
}

impl CavGeometry {
    /// From the middle of the outline to the front axle.
    pub fn front_axle_m(&self) -> f64 {
        self.wheelbase_m / 2.0
    }

    /// From the front axle to the front bumper.
    pub fn overhang_m(&self) -> f64 {
        (self.length_m - self.wheelbase_m) / 2.0
    }

    /// Front-axle centre along a route for a position of the front bumper.
    pub fn axle_of_front(&self, front_s: f64) -> f64 {
        front_s - self.overhang_m()
    }

    /// Front-axle centre along a route for a position of the rear bumper.
    pub fn axle_of_rear(&self, rear_s: f64) -> f64 {
        rear_s + self.length_m - self.overhang_m()
    }
}

/// What a vehicle is to coordination.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Role {
    /// Connected and automated: it may be coordinated.
    #[default]
    Cav,
    /// Driven by a model of a human driver, and never coordinated.
    Human,
}

/// Setup of a vehicle for the control framework.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CavSetup {
    /// Id in its measurements and trajectories.
    pub id: VehicleId,
    /// Name of the control algorithm, see [`Drivers`].
    pub controller: String,
    /// Parameters of car following, and bounds on speed and acceleration.
    pub driver: DriverParams,
    /// Dimensions at the scale of the laboratory.
    pub body: CavGeometry,
    /// Lanes of the route, each a successor of the one before.
    pub route: Vec<LaneId>,
    /// Speed at the start, laboratory m/s; the estimate begins with it.
    pub speed_mps: f64,
    /// Whether it is coordinated.
    #[serde(default)]
    pub role: Role,
    /// It leaves the city at the end of its route, and does not stop there.
    #[serde(default)]
    pub leaves: bool,
}

/// State of the plan model: a double integrator along the route (the paper, eq. 7).
#[derive(Clone, Copy, Debug, Default)]
pub struct PlanState {
    /// Front-axle centre along the route, laboratory metres.
    pub axle_s: f64,
    /// Speed along the route, laboratory m/s.
    pub speed_mps: f64,
    /// Acceleration of the last control step, laboratory m/s2.
    pub acceleration_mps2: f64,
}

/// Yielding state of a vehicle.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Yielding {
    /// It does not give way.
    #[default]
    No,
    /// Held at a section, but not yet for long.
    Held {
        /// Index in [`Route::sections`].
        section: usize,
        /// Time of the control step at which the hold began.
        since_s: f64,
    },
    /// It counts as yielding.
    At {
        /// Index in [`Route::sections`].
        section: usize,
        /// Time of the control step from which it counts as yielding.
        since_s: f64,
    },
}

/// Shorter holds do not count as yielding.
const YIELDS_AFTER_S: f64 = 0.4;
/// Shortest time for which yielding is shown.
const YIELDS_FOR_S: f64 = 1.0;

/// A vehicle under control, with its route, right of way, plan and estimated motion.
#[derive(Debug)]
pub struct Cav {
    /// Id in its measurements and trajectories.
    pub id: VehicleId,
    /// Present parameters of car following, and bounds on speed and acceleration.
    pub driver: DriverParams,
    /// Dimensions at the scale of the laboratory.
    pub body: CavGeometry,
    /// Whether it is coordinated.
    pub role: Role,
    /// It leaves the city at the end of its route, and does not stop there.
    pub leaves: bool,
    /// Present route; another one replaces it when the vehicle leaves it or is rerouted.
    pub route: Arc<Route>,
    /// Admissions to the junction sections of the route.
    pub passage: RightOfWayState,
    /// Plan of the last control step.
    pub plan: PlanState,
    /// Control zones on its route, and its plan through the one that it is in.
    pub coordination: CoordinatedState,
    /// Indicators in its last trajectory; off before the first one.
    pub indicator: Indicator,
    /// Yielding at a section of its route, from when it was held until it may go.
    pub yielding: Yielding,
    /// Number of reroutes.
    pub reroutes: u32,
    /// Sequence number of messages to the vehicle.
    pub sequence: u32,
    controller: Box<dyn Controller>,
    heeds_others: bool,
    /// Its desired speed outside of platoons.
    own_desired_mps: f64,
    /// Duration of the last control step.
    step_s: f64,
    /// Time of the present control step.
    now_s: f64,
    setup_speed_mps: Option<f64>,
    /// Apart from the rest, for only the beginning of a step reads it.
    estimate: Option<Box<RouteEstimate>>,
    /// Off its route and on no lane in the direction of travel, as a person may drive.
    is_off_route: bool,
    /// It stands at the end of its route.
    is_finished: bool,
    /// As measured.
    pub pose: Pose2,
    /// Speed along its heading; used while it is on no lane.
    pub(super) heading_mps: f64,
    /// Index of the lane under its rear at the control step.
    lane_index: usize,
    /// The estimate at the time of the control step.
    axle_s: f64,
    speed_mps: f64,
    position_std_m: f64,
    /// Not measured for too long; it may be up to `ahead_m` farther.
    is_lost: bool,
    ahead_m: f64,
    /// Distance from the front bumper to the nearest place where it has no right of way yet; infinite without one.
    pub(super) wait_m: f64,
    /// What limited it in the last control step.
    pub(super) limit: Limit,
}

/// Largest deviation of the plan from the measurement, laboratory metres and m/s.
pub const PLAN_SLACK_M: f64 = 0.04;
const PLAN_SLACK_MPS: f64 = 0.08;

/// Worst-case gap to the leader, and standard deviations of the own position that are added.
const SAFE_GAP_M: f64 = 0.02;
const SAFETY_SIGMAS: f64 = 3.0;

/// Least step and response time of the safety filter: the first control step has no duration.
const LEAST_STEP_S: f64 = 1e-3;

/// Distance behind a section at which its exit is looked up.
const BEHIND_SECTION_M: f64 = 1e-6;
/// A route is finished when its vehicle stands this close to its end, and until it is farther or moves: poses have errors.
const FINISHED_WITHIN_M: f64 = 0.05;
const FINISHED_MPS: f64 = 0.004;
const FINISHED_UNTIL_M: f64 = 2.0 * FINISHED_WITHIN_M;

impl Cav {
    pub(super) fn new(map: &LabMap, setup: CavSetup, drivers: &Drivers) -> Result<Self, SetupError> {
        if setup.route.is_empty() {
            return Err(SetupError::EmptyRoute { vehicle: setup.id });
        }
        let heeds_others = !heeds_nobody(&setup.controller);
        let controller = controller_of(drivers, setup.id, setup.controller, setup.driver)?;
        Ok(Self {
            id: setup.id,
            driver: setup.driver,
            body: setup.body,
            role: setup.role,
            leaves: setup.leaves,
            route: Arc::new(Route::new(map, &setup.route, setup.body, &setup.driver)),
            passage: RightOfWayState::default(),
            plan: PlanState::default(),
            coordination: CoordinatedState::default(),
            indicator: Indicator::Off,
            yielding: Yielding::default(),
            reroutes: 0,
            sequence: 0,
            controller,
            heeds_others,
            own_desired_mps: setup.driver.desired_speed_mps,
            step_s: 0.0,
            now_s: 0.0,
            setup_speed_mps: Some(setup.speed_mps),
            estimate: None,
            is_off_route: false,
            is_finished: false,
            pose: Pose2::default(),
            heading_mps: setup.speed_mps,
            lane_index: 0,
            axle_s: 0.0,
            speed_mps: 0.0,
            position_std_m: 0.0,
            is_lost: false,
            ahead_m: 0.0,
            wait_m: f64::INFINITY,
            limit: Limit::default(),
        })
    }

    /// Whether a pose has arrived.
    pub fn is_seen(&self) -> bool {
        self.estimate.is_some()
    }

    /// Whether it is on its route.
    pub fn is_on_route(&self) -> bool {
        self.is_seen() && !self.is_off_route
    }

    /// Whether it has not been measured for too long. It is then treated as stopped.
    pub fn is_lost(&self) -> bool {
        self.is_lost
    }

    /// Front-axle centre along the route, predicted to the current time.
    pub fn axle_s(&self) -> f64 {
        self.axle_s
    }

    /// Front-axle centre along the route at the last measured pose.
    pub(super) fn measured_s(&self) -> f64 {
        self.estimate.as_ref().map_or(0.0, |estimate| estimate.axle_s)
    }

    /// Front bumper along the route, predicted to the current time.
    pub fn front_s(&self) -> f64 {
        self.axle_s + self.body.overhang_m()
    }

    /// Farthest possible position of its front bumper, ahead of the estimate if the vehicle is lost.
    pub(super) fn farthest_front_s(&self) -> f64 {
        self.front_s() + self.ahead_m
    }

    /// Rear bumper along the route, predicted to the current time.
    pub fn rear_s(&self) -> f64 {
        self.front_s() - self.body.length_m
    }

    /// Estimated from the measured poses.
    pub fn speed_mps(&self) -> f64 {
        self.speed_mps
    }

    /// The speed that followers may rely on: none if the vehicle is on no lane.
    pub(super) fn speed_along_mps(&self) -> f64 {
        if self.is_off_route { 0.0 } else { self.speed_mps() }
    }

    /// The speed of its setup does not hold: it is under way.
    pub(super) fn expect_under_way(&mut self) {
        self.setup_speed_mps = None;
    }

    /// Finds a vehicle under way on its route, by its motion so far.
    pub(super) fn locate(&mut self, map: &LabMap) {
        if self.setup_speed_mps.is_none() {
            if let Some(estimate) = &mut self.estimate {
                estimate.locate(map, (&self.route, self.body));
                self.axle_s = estimate.axle_s;
            }
            self.plan_from_estimate();
            self.skip_sections_behind();
        }
        // Who has not been seen yet may stand.
        self.setup_speed_mps.get_or_insert(0.0);
    }

    /// Plans from its measured motion on.
    fn plan_from_estimate(&mut self) {
        if let Some(estimate) = &self.estimate {
            let (axle_s, speed_mps) = (estimate.axle_s, estimate.speed_mps);
            self.plan = PlanState { axle_s, speed_mps, acceleration_mps2: 0.0 };
        }
    }

    pub(super) fn update_pose(
        &mut self,
        (map, lanes): (&LabMap, &LaneIndex),
        now_s: f64,
        seen: &Measurement,
    ) {
        self.pose = seen.pose_in_lab();
        let mut along_rad = None;
        let speed_mps = match &mut self.estimate {
            None => {
                self.begin(map, now_s, seen, self.setup_speed_mps);
                self.setup_speed_mps.unwrap_or(0.0)
            }
            Some(estimate) => {
                let was_lost = estimate.is_lost(now_s);
                along_rad = estimate.update(map, (&self.route, self.body), now_s, seen);
                let speed_mps = estimate.speed_mps;
                self.heading_mps = estimate.heading_mps();
                if was_lost {
                    // It may have missed the messages meanwhile.
                    self.plan_from_estimate();
                }
                speed_mps
            }
        };
        if self.setup_speed_mps.is_none() || !off_route::has_left_route(map, self, along_rad) {
            self.is_off_route = false;
        } else {
            let way = off_route::route_from((map, lanes), self);
            self.is_off_route = way.is_none();
            if let Some(way) = way {
                self.route = Arc::new(Route::new(map, &way, self.body, &self.driver));
                self.reroutes += 1;
                self.begin(map, now_s, seen, Some(speed_mps));
            }
        }
    }

    /// Front-axle centre from the route, left-positive.
    pub(super) fn lateral_m(&self) -> f64 {
        self.estimate.as_ref().map_or(0.0, |estimate| estimate.lateral_m)
    }

    /// Starts on the first lane of its route, at a speed if it is known.
    fn begin(&mut self, map: &LabMap, now_s: f64, seen: &Measurement, speed_mps: Option<f64>) {
        let first = RouteEstimate::first(map, (&self.route, self.body), now_s, seen, speed_mps);
        self.passage = RightOfWayState::default();
        self.axle_s = first.axle_s;
        self.estimate = Some(Box::new(first));
        self.plan_from_estimate();
        self.skip_sections_behind();
    }

    fn skip_sections_behind(&mut self) {
        let rear_s = self.rear_s();
        let behind = self.route.sections.iter().take_while(|section| section.to_s < rear_s);
        self.passage.next_section = behind.count();
    }

    pub(super) fn advance_to(&mut self, time_s: f64) {
        self.now_s = time_s;
        if let Some(estimate) = &self.estimate {
            let place = estimate.at(time_s);
            (self.axle_s, self.speed_mps) = (place.axle_s, place.speed_mps);
            self.lane_index = self.route.index_at(self.rear_s());
            self.position_std_m = place.position_std_m;
            self.is_lost = estimate.is_lost(time_s);
            let stopping_m = self.driver.stopping_distance(estimate.speed_mps);
            self.ahead_m =
                if self.is_lost { estimate.farthest_if_lost(stopping_m) - self.axle_s } else { 0.0 };
        }
    }

    /// Acceleration of the driver model with respect to one leader, or on a free road.
    pub(super) fn acceleration_for(&self, ahead: Option<LeaderState>) -> f64 {
        self.controller.acceleration(self.own_motion(), self.route.speed_at(self.axle_s), ahead)
    }

    /// Acceleration of the driver model towards the end of its route.
    pub(super) fn acceleration_to_end(&self, end: LeaderState) -> f64 {
        self.controller.acceleration_to_end(self.own_motion(), self.route.speed_at(self.axle_s), end)
    }

    /// Drives at this share of its desired speed from now on.
    pub(super) fn set_speed_factor(&mut self, map: &LabMap, factor: f64) {
        let desired_mps = self.own_desired_mps * factor;
        if self.driver.desired_speed_mps != desired_mps {
            self.driver.desired_speed_mps = desired_mps;
            Arc::make_mut(&mut self.route).plan_speeds(map, self.body, &self.driver);
        }
    }

    fn own_motion(&self) -> OwnMotion {
        OwnMotion {
            planned_mps: self.plan.speed_mps,
            planned_mps2: self.plan.acceleration_mps2,
            measured_mps: self.speed_mps,
            margin_m: self.margin_m(),
            step_s: self.step_s,
            now_s: self.now_s,
        }
    }

    /// Acceleration with which it can still stop before a place or behind a leader that brakes as hard as it can itself
    /// (Gipps), with `standstill_m` left.
    pub(super) fn safe_acceleration_for(&self, leader: LeaderState, standstill_m: f64) -> f64 {
        self.driver.safe_acceleration(self.speed_mps, leader, self.margin_m() + standstill_m)
    }

    /// Safety margin on measured distances.
    pub(super) fn margin_m(&self) -> f64 {
        SAFE_GAP_M + SAFETY_SIGMAS * self.position_std_m
    }

    /// The end of the route as a standing leader; the front bumper stops at the end. `None` of a vehicle that leaves
    /// there.
    pub(super) fn end_of_route(&self) -> Option<LeaderState> {
        if self.leaves {
            return None;
        }
        let gap_m = self.route.length() + self.driver.standstill_gap_m - self.front_s();
        (gap_m < super::SIGHT_M).then_some(LeaderState { gap_m, speed_mps: 0.0 })
    }

    /// Whether it stands at the end of its route.
    pub(super) fn is_finished(&self) -> bool {
        self.is_finished
    }

    /// Notes whether it stands at the end of its route.
    pub(super) fn note_arrival(&mut self) {
        let (within_m, below_mps) = match self.is_finished {
            false => (FINISHED_WITHIN_M, FINISHED_MPS),
            true => (FINISHED_UNTIL_M, super::STANDS_MPS),
        };
        let is_at_end = self.route.length() - self.front_s() < within_m;
        self.is_finished = is_at_end && !self.leaves && self.plan.speed_mps < below_mps;
    }

    /// Updates the yielding state. Yielding begins when right of way has held the vehicle for a while, and
    /// lasts until no vehicle has priority at that section, whatever else limits it meanwhile.
    pub(super) fn note_yielding(&mut self, now_s: f64, decision: &Decision, still_gives_way: bool) {
        self.yielding = match (self.yielding, decision.gives_way_at) {
            (Yielding::At { section, since_s }, _) if still_gives_way || now_s - since_s < YIELDS_FOR_S => {
                Yielding::At { section, since_s }
            }
            (Yielding::Held { section, since_s }, Some(at)) if at == section => {
                if now_s - since_s >= YIELDS_AFTER_S {
                    Yielding::At { section, since_s: now_s }
                } else {
                    Yielding::Held { section, since_s }
                }
            }
            (_, Some(section)) => Yielding::Held { section, since_s: now_s },
            (_, None) => Yielding::No,
        };
    }

    /// Advances the plan by a control step, within its bounds and close to the measurement.
    pub(super) fn apply(&mut self, decision: Decision, now_s: f64, dt_s: f64) {
        self.coordination.follows_plan = decision.follows_plan && !self.is_lost;
        self.step_s = dt_s;
        if self.is_lost {
            self.brake(dt_s);
            return;
        }
        if let Some(plan) = self.coordination.plan.as_ref().filter(|_| decision.follows_plan) {
            let here = plan.at(now_s);
            self.plan = PlanState {
                axle_s: here.position_m,
                speed_mps: here.speed_mps,
                acceleration_mps2: here.acceleration_mps2,
            };
            return;
        }
        let measured_mps = self.speed_mps();
        let old = self.plan;
        let base_mps =
            old.speed_mps.clamp((measured_mps - PLAN_SLACK_MPS).max(0.0), measured_mps + PLAN_SLACK_MPS);
        let allowed_mps = self.route.speed_at(old.axle_s + base_mps * dt_s);
        let lowest_mps = (base_mps + self.driver.min_acceleration_mps2 * dt_s).max(0.0);
        let wanted_mps = (base_mps + decision.acceleration_mps2 * dt_s).max(0.0);
        let speed_mps = wanted_mps.min(allowed_mps.max(lowest_mps));
        let ahead_m = old.axle_s + (base_mps + speed_mps) / 2.0 * dt_s - self.axle_s;
        let ahead_m = ahead_m.clamp(-PLAN_SLACK_M, PLAN_SLACK_M);
        let acceleration_mps2 =
            if dt_s > 0.0 { (speed_mps - base_mps) / dt_s } else { decision.acceleration_mps2 };
        self.plan = PlanState { axle_s: self.axle_s + ahead_m, speed_mps, acceleration_mps2 };
    }

    /// A lost vehicle is planned to a stop.
    fn brake(&mut self, dt_s: f64) {
        let PlanState { axle_s, speed_mps: before_mps, .. } = self.plan;
        let acceleration_mps2 = self.driver.min_acceleration_mps2;
        let speed_mps = (before_mps + acceleration_mps2 * dt_s).max(0.0);
        let axle_s = axle_s + (before_mps + speed_mps) / 2.0 * dt_s;
        self.plan = PlanState { axle_s, speed_mps, acceleration_mps2 };
    }

    /// Replaces the driver.
    pub(super) fn change_driver(
        &mut self,
        map: &LabMap,
        name: String,
        driver: DriverParams,
        drivers: &Drivers,
    ) -> Result<(), SetupError> {
        self.heeds_others = !heeds_nobody(&name);
        self.controller = controller_of(drivers, self.id, name, driver)?;
        self.own_desired_mps = driver.desired_speed_mps;
        if self.driver != driver {
            self.driver = driver;
            Arc::make_mut(&mut self.route).plan_speeds(map, self.body, &self.driver);
        }
        Ok(())
    }

    /// Installs another route that begins with the same lanes up to the present one; returns the old route.
    pub(super) fn set_route(&mut self, route: Arc<Route>) -> Arc<Route> {
        std::mem::replace(&mut self.route, route)
    }

    /// Commits the installed route.
    pub(super) fn commit_route(&mut self, map: &LabMap) {
        self.reroutes += 1;
        Arc::make_mut(&mut self.route).plan_speeds(map, self.body, &self.driver);
    }

    /// The admission number for a section, if it has one.
    pub(super) fn order_of(&self, section: usize) -> Option<u64> {
        self.passage.admissions.iter().find(|a| a.section == section).map(|a| a.order)
    }

    /// The lane of its route behind a section.
    pub(super) fn exit_lane_of(&self, section: usize) -> LaneId {
        let end_s = self.route.sections[section].to_s + BEHIND_SECTION_M;
        self.route.lanes()[self.route.index_at(end_s)]
    }
}

fn controller_of(
    drivers: &Drivers,
    vehicle: VehicleId,
    name: String,
    params: DriverParams,
) -> Result<Box<dyn Controller>, SetupError> {
    let known = || drivers.names().map(str::to_owned).collect();
    drivers.controller(&name, (vehicle, params)).ok_or_else(|| SetupError::UnknownController {
        vehicle,
        name,
        known: known(),
    })
}
