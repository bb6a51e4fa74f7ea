//! What a vehicle is to coordination, platoons and the safety filter.

use super::super::coordination::filter::FilterParams;
use super::super::coordination::{CoordinatedState, MotionPlan};
use super::super::{DriverParams, PlatoonBroadcast};
use super::{Cav, LEAST_STEP_S, Role};

impl Cav {
    /// Acceleration behind the predecessor in a platoon.
    pub(crate) fn platoon_acceleration(&self, platoon: &PlatoonBroadcast) -> f64 {
        let desired_mps = self.route.speed_at(self.axle_s);
        self.controller.platoon_acceleration(self.own_motion(), desired_mps, platoon)
    }

    /// Whether its driver can be in a platoon.
    pub(crate) fn can_platoon(&self) -> bool {
        self.controller.can_platoon()
    }

    /// Parameters of the safety filter for this vehicle: the response time as headway, the margin on measured distances as gap.
    pub(crate) fn filter_params(&self) -> FilterParams {
        let DriverParams { response_time_s, min_acceleration_mps2, max_acceleration_mps2, .. } = self.driver;
        FilterParams {
            headway_s: response_time_s,
            standstill_gap_m: self.margin_m(),
            gain_per_s: 1.0 / response_time_s.max(LEAST_STEP_S),
            step_s: self.step_s.max(LEAST_STEP_S),
            min_acceleration_mps2,
            max_acceleration_mps2,
            min_mps: 0.0,
            max_mps: f64::INFINITY,
        }
    }

    /// Whether it takes part in coordination somewhere: persons do not, nor a driver that heeds nobody.
    pub(crate) fn may_take_part(&self) -> bool {
        self.role == Role::Cav && self.heeds_others
    }

    /// Whether it takes part in coordination where it is: a vehicle that does not follow its plans does not.
    pub(crate) fn is_coordinated(&self) -> bool {
        let state = &self.coordination;
        self.is_on_route() && self.may_take_part() && state.inside.is_some() && !state.is_distrusted
    }

    /// Whether a person drives it, or a model of one: it gets no plan.
    pub(crate) fn is_human(&self) -> bool {
        !self.may_take_part() || self.coordination.is_distrusted
    }

    /// Whether it gives way to all plans while it has none itself: it could have one, and asks for it.
    pub(crate) fn defers_to_plans(&self) -> bool {
        self.is_coordinated() && !self.coordination.is_among_uncoordinated
    }

    /// Its coordinated plan, while it is on it.
    pub(crate) fn coordinated_plan(&self) -> Option<&MotionPlan> {
        self.coordination.plan.as_ref().filter(|_| !self.is_lost)
    }

    /// Acceleration of its coordinated plan.
    pub(crate) fn planned_acceleration(&self, now_s: f64) -> Option<f64> {
        self.coordinated_plan().map(|plan| plan.at(now_s).acceleration_mps2)
    }

    /// Forgets plans and zones.
    pub(crate) fn forget_coordination(&mut self) {
        self.coordination = CoordinatedState::default();
    }
}
