//! Plans of coordinated vehicles through control zones, as the control framework tells them to people. No state depends on
//! them.

use super::VehicleId;
use city3d_geometry::{City, Frame, Pose2};
use glam::DVec2;
use serde::{Deserialize, Serialize};

/// Counts of a control zone.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ZoneCounts {
    /// Plans given.
    pub plans: u64,
    /// Plans that were dropped because the vehicle, or another one, did not do what was expected.
    pub replans: u64,
    /// Requests for which no plan was feasible; a vehicle asks more than once.
    pub infeasible: u64,
}

/// A control zone, and what has happened in it so far.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ZoneState {
    /// Its number, from 0 in the order of the scenario of the control framework.
    pub number: u16,
    /// Its name in that scenario.
    pub name: String,
    /// What has happened so far.
    pub counts: ZoneCounts,
}

/// Why a vehicle in a control zone has no plan: it drives by the rules of the road.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum NoPlan {
    /// It is not coordinated: a human driver, or one that keeps its speed.
    NotCoordinated = 1,
    /// It has left its plans several times in a row, as where a person drives it.
    LeftItsPlans = 2,
    /// Vehicles that are not coordinated are in its zone.
    AmongUncoordinated = 3,
    /// No plan keeps bounds and gaps; it asks again.
    Infeasible = 4,
}

impl NoPlan {
    /// All of them, in the order of their numbers, which begin with 1.
    pub const ALL: [Self; 4] =
        [Self::NotCoordinated, Self::LeftItsPlans, Self::AmongUncoordinated, Self::Infeasible];
}

/// A vehicle inside a control zone.
#[derive(Clone, Debug, PartialEq)]
pub struct ZoneVehicle<F: Frame = City> {
    /// Its id.
    pub id: VehicleId,
    /// Number of the control zone.
    pub zone: u16,
    /// Simulated time at which it entered the zone, seconds.
    pub entered_s: f64,
    /// Whether it stands.
    pub is_standing: bool,
    /// Its plan, or why it has none.
    pub plan: Result<PlannedPassage<F>, NoPlan>,
}

/// A planned way through a control zone. Times are simulated seconds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PlannedPassage<F: Frame = City> {
    /// When the front bumper enters the first conflict.
    pub enters_s: f64,
    /// When the rear bumper leaves the last conflict.
    pub leaves_s: f64,
    /// Where the front bumper enters the first conflict.
    pub entry: Pose2<F>,
    /// Motion of the front bumper, in order of time: from when the plan was told until the vehicle leaves, but no longer
    /// than [`Self::LONGEST_S`]. Up to [`Self::MAX_POINTS`].
    pub motion: Vec<PlanPoint<F>>,
}

/// Where the front bumper of a vehicle will be at one time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PlanPoint<F: Frame = City> {
    /// Simulated time, seconds.
    pub time_s: f64,
    /// The middle of the front bumper, heading along the route.
    pub pose: Pose2<F>,
    /// Along the heading, metres of the frame per second.
    pub speed_mps: f64,
}

impl<F: Frame> PlannedPassage<F> {
    /// Most points of a motion: a plan has to fit in a datagram.
    pub const MAX_POINTS: usize = 25;
    /// A plan is told for so long ahead, seconds.
    pub const LONGEST_S: f64 = 30.0;

    /// Where the front bumper will be at a time, between two points by the cubic that has their positions and velocities
    /// (Hermite interpolation); `None` where the plan does not tell.
    pub fn position_at(&self, time_s: f64) -> Option<DVec2> {
        let after = self.motion.partition_point(|point| point.time_s < time_s);
        let to = self.motion.get(after)?;
        if to.time_s == time_s {
            return Some(to.pose.position);
        }
        let from = self.motion.get(after.checked_sub(1)?)?;
        let span_s = to.time_s - from.time_s;
        let u = (time_s - from.time_s) / span_s;
        let v = 1.0 - u;
        let between = from.pose.position.lerp(to.pose.position, u * u * (3.0 - 2.0 * u));
        Some(between + (from.velocity() * v - to.velocity() * u) * (span_s * u * v))
    }
}

impl<F: Frame> PlanPoint<F> {
    fn velocity(&self) -> DVec2 {
        self.pose.forward() * self.speed_mps
    }
}

impl<F: Frame> ZoneVehicle<F> {
    /// The same in another frame.
    pub(crate) fn in_frame<G: Frame>(
        &self,
        pose: impl Fn(Pose2<F>) -> Pose2<G>,
        speed: impl Fn(f64) -> f64,
    ) -> ZoneVehicle<G> {
        let point = |point: &PlanPoint<F>| PlanPoint {
            time_s: point.time_s,
            pose: pose(point.pose),
            speed_mps: speed(point.speed_mps),
        };
        let passage = |plan: &PlannedPassage<F>| PlannedPassage {
            enters_s: plan.enters_s,
            leaves_s: plan.leaves_s,
            entry: pose(plan.entry),
            motion: plan.motion.iter().map(point).collect(),
        };
        ZoneVehicle {
            id: self.id,
            zone: self.zone,
            entered_s: self.entered_s,
            is_standing: self.is_standing,
            plan: self.plan.as_ref().map(passage).map_err(|why| *why),
        }
    }
}

/// The control zones, and the vehicles in them with their plans.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CoordinationState {
    /// In the order of their numbers.
    pub zones: Vec<ZoneState>,
    /// Vehicles that are inside control zones, in id order.
    pub vehicles: Vec<ZoneVehicle>,
}

impl CoordinationState {
    /// A vehicle, where it is in a control zone.
    pub fn vehicle(&self, id: VehicleId) -> Option<&ZoneVehicle> {
        self.vehicles.iter().find(|vehicle| vehicle.id == id)
    }
}

/// What is told of a [`CoordinationState`] at one time: what has changed, and what was told some time ago.
#[derive(Clone, Debug, PartialEq)]
pub struct CoordinationUpdate<F: Frame = City> {
    /// Control zones, in the order of their numbers.
    pub zones: Vec<ZoneState>,
    /// Vehicles that are inside control zones, in id order.
    pub vehicles: Vec<ZoneVehicle<F>>,
    /// Vehicles that are in no control zone any more.
    pub left: Vec<VehicleId>,
}

impl<F: Frame> Default for CoordinationUpdate<F> {
    fn default() -> Self {
        Self { zones: Vec::new(), vehicles: Vec::new(), left: Vec::new() }
    }
}

impl<F: Frame> CoordinationUpdate<F> {
    /// Whether it tells nothing.
    pub fn is_empty(&self) -> bool {
        self.zones.is_empty() && self.vehicles.is_empty() && self.left.is_empty()
    }
}

impl From<CoordinationState> for CoordinationUpdate {
    /// Tells everything.
    fn from(state: CoordinationState) -> Self {
        Self { zones: state.zones, vehicles: state.vehicles, left: Vec::new() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use city3d_geometry::trig;

    #[test]
    fn reasons_have_their_numbers() {
        let numbers = NoPlan::ALL.map(|why| usize::from(why as u8));
        assert_eq!(numbers, [1, 2, 3, 4]);
    }

    /// A vehicle that brakes along an arc of 20 m: where it is and how fast, by the time.
    fn on_arc(time_s: f64) -> PlanPoint {
        let (radius_m, arc_m) = (20.0, 8.0 * time_s - 0.5 * time_s * time_s);
        let angle_rad = arc_m / radius_m;
        let (sin, cos) = trig::sin_cos(angle_rad);
        let pose = Pose2::new(radius_m * sin, radius_m * (1.0 - cos), angle_rad);
        PlanPoint { time_s, pose, speed_mps: 8.0 - time_s }
    }

    #[test]
    fn between_points_of_one_second_the_motion_is_that_of_the_vehicle() {
        let motion = (0..=5).map(|k| on_arc(f64::from(k))).collect();
        let plan = PlannedPassage { motion, ..PlannedPassage::<City>::default() };
        for k in 0..=50 {
            let time_s = f64::from(k) / 10.0;
            let miss_m = plan.position_at(time_s).unwrap().distance(on_arc(time_s).pose.position);
            assert!(miss_m < 0.01, "{miss_m} m at {time_s} s");
        }
        assert_eq!(plan.position_at(-0.1), None, "before it was told");
        assert_eq!(plan.position_at(5.1), None, "behind the zone");
        assert_eq!(PlannedPassage::<City>::default().position_at(0.0), None);
    }
}
