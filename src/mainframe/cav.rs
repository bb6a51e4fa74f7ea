//! One connected and automated vehicle as the control framework knows it.

use super::estimate::Estimate;
use super::right_of_way::Passage;
use super::stray;
use super::{Ahead, Controller, Decision, DriverParams, OwnMotion, Route, SetupError, controller};
use crate::city::{LabMap, LaneId};
use crate::geom::Pose2;
use crate::snapshot::{Indicator, VehicleId};
use crate::wire::Measurement;
use serde::{Deserialize, Serialize};

/// The measures of a vehicle that control needs, laboratory metres. The overhangs are equal and the
/// measured pose is that of the outline's middle.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Body {
    pub length_m: f64,
    pub wheelbase_m: f64,
    /// Of the front axle's track at the steering limit.
    pub min_turn_radius_m: f64,
}

impl Body {
    /// From the middle of the outline to the front axle.
    pub fn front_axle_m(&self) -> f64 {
        self.wheelbase_m / 2.0
    }

    /// From the front axle to the front bumper.
    pub fn overhang_m(&self) -> f64 {
        (self.length_m - self.wheelbase_m) / 2.0
    }
}

/// What the control framework is told of a vehicle.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CavSetup {
    pub id: VehicleId,
    /// Name of the control algorithm, see [`CONTROLLERS`](super::CONTROLLERS).
    pub controller: String,
    pub driver: DriverParams,
    pub body: Body,
    /// Lanes to drive, each a successor of the one before.
    pub route: Vec<LaneId>,
    pub speed_mps: f64,
}

/// The plan model: a double integrator along the route (the paper, eq. 7).
#[derive(Clone, Copy, Debug, Default)]
pub struct Reference {
    pub axle_s: f64,
    pub speed_mps: f64,
    pub acceleration_mps2: f64,
}

/// Whether a vehicle gives way, and where.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Yielding {
    #[default]
    No,
    /// It is held back at a section, not yet for long.
    Held {
        section: usize,
        since_s: f64,
    },
    At {
        section: usize,
        since_s: f64,
    },
}

/// A vehicle that is held back for less than this has not given way: nobody would notice it.
const YIELDS_AFTER_S: f64 = 0.4;
/// And one that has given way is shown to do so for this time at least.
const YIELDS_FOR_S: f64 = 1.0;

#[derive(Debug)]
pub struct Cav {
    pub id: VehicleId,
    pub driver: DriverParams,
    pub body: Body,
    pub route: Route,
    pub passage: Passage,
    pub reference: Reference,
    pub indicator: Indicator,
    /// It gives way to others at a section of its route, from when that has held it back until it may go.
    pub yielding: Yielding,
    /// How often it has been sent another way.
    pub reroutes: u32,
    /// Counts the messages to the vehicle.
    pub sequence: u32,
    controller: Box<dyn Controller>,
    setup_speed_mps: f64,
    estimate: Option<Estimate>,
    /// It is on no lane in the direction of travel: a person drives it as no route does.
    is_astray: bool,
    /// As measured.
    pub pose: Pose2,
    /// Along its heading, wherever that leads: what it is told goes by it while it is on no lane.
    pub(super) heading_mps: f64,
    /// The estimate brought to the time of the control step.
    axle_s: f64,
    speed_mps: f64,
    position_std_m: f64,
    /// It has not been seen for long, and may be this far ahead of there.
    is_lost: bool,
    ahead_m: f64,
}

/// How far the plan may run ahead of, or fall behind, what is measured.
const REFERENCE_SLACK_M: f64 = 0.04;
const REFERENCE_SLACK_MPS: f64 = 0.08;

/// Distance that is kept to whatever is ahead in the worst case, and standard deviations of the own position that are
/// added to it.
const SAFE_GAP_M: f64 = 0.02;
const SIGMAS: f64 = 3.0;

/// What lies just behind a section is looked for this far on.
const BEHIND_SECTION_M: f64 = 1e-6;
/// A route is driven when its vehicle stands this near to its end.
const FINISHED_WITHIN_M: f64 = 0.05;
const FINISHED_MPS: f64 = 0.004;

impl Cav {
    pub(super) fn new(map: &LabMap, setup: CavSetup) -> Result<Self, SetupError> {
        if setup.route.is_empty() {
            return Err(SetupError::EmptyRoute { vehicle: setup.id });
        }
        let controller = controller(&setup.controller, setup.driver)
            .ok_or(SetupError::UnknownController { vehicle: setup.id, name: setup.controller })?;
        Ok(Self {
            id: setup.id,
            driver: setup.driver,
            body: setup.body,
            route: Route::new(map, &setup.route, setup.body, &setup.driver),
            passage: Passage::default(),
            reference: Reference::default(),
            indicator: Indicator::Off,
            yielding: Yielding::default(),
            reroutes: 0,
            sequence: 0,
            controller,
            setup_speed_mps: setup.speed_mps,
            estimate: None,
            is_astray: false,
            pose: Pose2::default(),
            heading_mps: setup.speed_mps,
            axle_s: 0.0,
            speed_mps: 0.0,
            position_std_m: 0.0,
            is_lost: false,
            ahead_m: 0.0,
        })
    }

    /// Whether a pose of it has arrived yet.
    pub fn is_seen(&self) -> bool {
        self.estimate.is_some()
    }

    /// Whether it is somewhere on its route.
    pub fn is_on_route(&self) -> bool {
        self.is_seen() && !self.is_astray
    }

    /// Whether it has not been seen for so long that nobody can say what it does. It counts as standing then.
    pub fn is_lost(&self) -> bool {
        self.is_lost
    }

    /// Front-axle centre along the route, as measured and brought to the current time.
    pub fn axle_s(&self) -> f64 {
        self.axle_s
    }

    /// Front-axle centre along the route at the last measured pose.
    pub(super) fn measured_s(&self) -> f64 {
        self.estimate.as_ref().map_or(0.0, |estimate| estimate.axle_s)
    }

    pub fn front_s(&self) -> f64 {
        self.axle_s + self.body.overhang_m()
    }

    /// The farthest place at which its front bumper may be: farther than it is expected where it is lost.
    pub(super) fn reach_s(&self) -> f64 {
        self.front_s() + self.ahead_m
    }

    pub fn rear_s(&self) -> f64 {
        self.front_s() - self.body.length_m
    }

    /// Estimated from the measured poses.
    pub fn speed_mps(&self) -> f64 {
        self.speed_mps
    }

    /// As those behind it may count on: nothing of one that is on no lane.
    pub(super) fn speed_along_mps(&self) -> f64 {
        if self.is_astray { 0.0 } else { self.speed_mps() }
    }

    pub(super) fn see(&mut self, map: &LabMap, now_s: f64, seen: &Measurement) {
        self.pose = seen.pose_in_lab();
        let Some(estimate) = &mut self.estimate else {
            self.begin(map, now_s, seen, self.setup_speed_mps);
            return;
        };
        let was_lost = estimate.is_lost(now_s);
        estimate.update(map, (&self.route, self.body), now_s, seen);
        let (axle_s, speed_mps) = (estimate.axle_s, estimate.speed_mps);
        self.heading_mps = estimate.heading_mps();
        if was_lost {
            // What it was told meanwhile it may not have heard.
            self.reference = Reference { axle_s, speed_mps, acceleration_mps2: 0.0 };
        }
        if !stray::has_left(map, self) {
            self.is_astray = false;
        } else {
            let way = stray::way_from(map, self);
            self.is_astray = way.is_none();
            if let Some(way) = way {
                self.route = Route::new(map, &way, self.body, &self.driver);
                self.reroutes += 1;
                self.begin(map, now_s, seen, speed_mps);
            }
        }
    }

    /// Front-axle centre from the route, left-positive.
    pub(super) fn lateral_m(&self) -> f64 {
        self.estimate.as_ref().map_or(0.0, |estimate| estimate.lateral_m)
    }

    /// Takes it to be on the first lane of its route.
    fn begin(&mut self, map: &LabMap, now_s: f64, seen: &Measurement, speed_mps: f64) {
        let first = Estimate::first(map, (&self.route, self.body), now_s, seen, speed_mps);
        self.passage = Passage::default();
        self.reference =
            Reference { axle_s: first.axle_s, speed_mps: first.speed_mps, acceleration_mps2: 0.0 };
        self.axle_s = first.axle_s;
        self.estimate = Some(first);
        let rear_s = self.rear_s();
        let behind = self.route.sections.iter().take_while(|section| section.to_s < rear_s);
        self.passage.next_section = behind.count();
    }

    pub(super) fn advance_to(&mut self, time_s: f64) {
        if let Some(estimate) = &self.estimate {
            let place = estimate.at(time_s);
            (self.axle_s, self.speed_mps) = (place.axle_s, place.speed_mps);
            self.position_std_m = place.position_std_m;
            self.is_lost = estimate.is_lost(time_s);
            let stopping_m = self.driver.stopping_distance(estimate.speed_mps);
            self.ahead_m =
                if self.is_lost { estimate.farthest_if_lost(stopping_m) - self.axle_s } else { 0.0 };
        }
    }

    /// What the driver does about one thing ahead, or about a free road.
    pub(super) fn acceleration_for(&self, ahead: Option<Ahead>) -> f64 {
        let desired = self.route.speed_at(self.axle_s);
        let own = OwnMotion {
            planned_mps: self.reference.speed_mps,
            measured_mps: self.speed_mps,
            margin_m: self.margin_m(),
        };
        self.controller.acceleration(own, desired, ahead)
    }

    /// By how much a distance from its front bumper may be shorter than measured.
    pub(super) fn margin_m(&self) -> f64 {
        SAFE_GAP_M + SIGMAS * self.position_std_m
    }

    /// The end of the route as a standing thing ahead; its front bumper comes to the end.
    pub(super) fn end_of_route(&self) -> Option<Ahead> {
        let gap_m = self.route.length() + self.driver.standstill_gap_m - self.front_s();
        (gap_m < super::SIGHT_M).then_some(Ahead { gap_m, speed_mps: 0.0 })
    }

    /// Whether it has come to the end of its route and stands there.
    pub(super) fn is_finished(&self) -> bool {
        self.route.length() - self.front_s() < FINISHED_WITHIN_M && self.reference.speed_mps < FINISHED_MPS
    }

    /// Whether it gives way. That begins when the right of way of others has held it back for a while, and lasts,
    /// whatever else limits it meanwhile, until nobody at that section is before it any more.
    pub(super) fn note_yielding(
        &mut self,
        now_s: f64,
        decision: &Decision,
        gives_way: impl Fn(usize) -> bool,
    ) {
        self.yielding = match (self.yielding, decision.gives_way_at) {
            (Yielding::At { section, since_s }, _)
                if gives_way(section) || now_s - since_s < YIELDS_FOR_S =>
            {
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

    /// Advances the plan by a control step, within its bounds and near to what is measured.
    pub(super) fn apply(&mut self, decision: Decision, dt_s: f64) {
        if self.is_lost {
            self.brake(dt_s);
            return;
        }
        let measured_mps = self.speed_mps();
        let old = self.reference;
        let base_mps = old
            .speed_mps
            .clamp((measured_mps - REFERENCE_SLACK_MPS).max(0.0), measured_mps + REFERENCE_SLACK_MPS);
        let allowed_mps = self.route.speed_at(old.axle_s + base_mps * dt_s);
        let lowest_mps = (base_mps + self.driver.min_acceleration_mps2 * dt_s).max(0.0);
        let wanted_mps = (base_mps + decision.acceleration_mps2 * dt_s).max(0.0);
        let speed_mps = wanted_mps.min(allowed_mps.max(lowest_mps));
        let ahead_m = old.axle_s + (base_mps + speed_mps) / 2.0 * dt_s - self.axle_s;
        let ahead_m = ahead_m.clamp(-REFERENCE_SLACK_M, REFERENCE_SLACK_M);
        let acceleration_mps2 =
            if dt_s > 0.0 { (speed_mps - base_mps) / dt_s } else { decision.acceleration_mps2 };
        self.reference = Reference { axle_s: self.axle_s + ahead_m, speed_mps, acceleration_mps2 };
    }

    /// Nobody sees what it does: it is told to come to a stand from where its plan is.
    fn brake(&mut self, dt_s: f64) {
        let Reference { axle_s, speed_mps: before_mps, .. } = self.reference;
        let acceleration_mps2 = self.driver.min_acceleration_mps2;
        let speed_mps = (before_mps + acceleration_mps2 * dt_s).max(0.0);
        let axle_s = axle_s + (before_mps + speed_mps) / 2.0 * dt_s;
        self.reference = Reference { axle_s, speed_mps, acceleration_mps2 };
    }

    /// Is driven otherwise from now on.
    pub(super) fn change_driver(
        &mut self,
        map: &LabMap,
        name: String,
        driver: DriverParams,
    ) -> Result<(), SetupError> {
        self.controller =
            controller(&name, driver).ok_or(SetupError::UnknownController { vehicle: self.id, name })?;
        if self.driver != driver {
            self.driver = driver;
            self.route.plan_speeds(map, self.body, &self.driver);
        }
        Ok(())
    }

    /// Tries another way that begins with the same lanes up to the one it is on; gives the old one.
    pub(super) fn set_route(&mut self, route: Route) -> Route {
        std::mem::replace(&mut self.route, route)
    }

    /// Drives the way that it has tried.
    pub(super) fn take_new_route(&mut self, map: &LabMap) {
        self.reroutes += 1;
        self.route.plan_speeds(map, self.body, &self.driver);
    }

    /// The admission number for a section, if it has one.
    pub(super) fn order_of(&self, section: usize) -> Option<u64> {
        self.passage.admissions.iter().find(|a| a.section == section).map(|a| a.order)
    }

    /// The lane that its route takes behind a section.
    pub(super) fn way_out_of(&self, section: usize) -> LaneId {
        let end_s = self.route.sections[section].to_s + BEHIND_SECTION_M;
        self.route.lanes()[self.route.index_at(end_s)]
    }

    /// Whether its route uses a lane between two arc lengths.
    pub(super) fn goes_over(&self, lane: LaneId, from_s: f64, to_s: f64) -> bool {
        (self.route.index_at(from_s)..=self.route.index_at(to_s))
            .any(|index| self.route.lanes()[index] == lane)
    }
}
