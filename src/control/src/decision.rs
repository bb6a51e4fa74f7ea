//! The decision of a driver for one control step: what is ahead of the vehicle, and the acceleration that it permits.

use crate::coordination::filter::{AccelerationBounds, Preceding, SafetyFilter};
use crate::limit::Limit;
use crate::{Cav, LeaderState, PlatoonBroadcast};
use city3d_protocol::snapshot::DecisionReason;

/// The decision of a driver for one control step.
#[derive(Clone, Copy, Debug)]
pub(super) struct Decision {
    pub acceleration_mps2: f64,
    /// The section at which the vehicle gives way, if that is the active limit.
    pub gives_way_at: Option<usize>,
    /// The acceleration is that of a coordinated plan.
    pub follows_plan: bool,
    /// What the acceleration is for.
    pub limit: Limit,
}

/// Something ahead of a vehicle that it heeds.
#[derive(Clone, Copy, Debug)]
pub(super) struct Obstacle {
    pub kind: ObstacleKind,
    /// The section at which the vehicle gives way by stopping for it.
    pub gives_way_at: Option<usize>,
    /// What it is, for people.
    pub limit: Limit,
}

/// What is ahead.
#[derive(Clone, Copy, Debug)]
pub(super) enum ObstacleKind {
    /// A vehicle on the way.
    Leader(LeaderState),
    /// The end of the route, as a leader at rest.
    RouteEnd(LeaderState),
    /// The predecessor in a platoon, with what it tells.
    Predecessor(LeaderState, PlatoonBroadcast),
    /// A place to stop at.
    Stop(StopPlace),
    /// A vehicle that merges ahead: follow it or, where there still is a place for it, wait, whichever brakes less.
    Merging(LeaderState, Option<StopPlace>),
}

/// A place to stop at.
#[derive(Clone, Copy, Debug)]
pub(super) struct StopPlace {
    pub gap_m: f64,
    /// The standstill gap is kept, as before a line without an admission, so as not to roll over it.
    pub keeps_gap: bool,
}

impl Obstacle {
    /// A vehicle ahead.
    pub(super) fn leader(leader: LeaderState, limit: Limit) -> Self {
        Self { kind: ObstacleKind::Leader(leader), gives_way_at: None, limit }
    }

    /// The end of the route.
    pub(super) fn route_end(end: LeaderState) -> Self {
        let limit = Limit::behind(DecisionReason::RouteEnd, None, end.gap_m);
        Self { kind: ObstacleKind::RouteEnd(end), gives_way_at: None, limit }
    }

    /// What permits most of the ways to heed it: `behind` answers for a leader and the gap to keep to it at standstill.
    fn best<T>(
        &self,
        cav: &Cav,
        behind: impl Fn(LeaderState, f64) -> T,
        acceleration: impl Fn(&T) -> f64,
    ) -> T {
        let standstill_m = cav.driver.standstill_gap_m;
        let at = |place: StopPlace| {
            let standing = LeaderState { gap_m: place.gap_m, speed_mps: 0.0 };
            behind(standing, if place.keeps_gap { standstill_m } else { 0.0 })
        };
        match self.kind {
            ObstacleKind::Stop(place) => at(place),
            ObstacleKind::Leader(leader)
            | ObstacleKind::RouteEnd(leader)
            | ObstacleKind::Predecessor(leader, _)
            | ObstacleKind::Merging(leader, None) => behind(leader, standstill_m),
            ObstacleKind::Merging(leader, Some(place)) => {
                let (follows, waits) = (behind(leader, standstill_m), at(place));
                if acceleration(&waits) > acceleration(&follows) { waits } else { follows }
            }
        }
    }

    /// The acceleration that it permits.
    fn acceleration(&self, cav: &Cav, behind: impl Fn(LeaderState, f64) -> f64) -> f64 {
        self.best(cav, behind, |u| *u)
    }
}

impl Decision {
    /// What the driver model decides.
    pub(super) fn of_driver(cav: &Cav, ahead: &[Obstacle]) -> Self {
        let mut decision = Self::wanting(cav.acceleration_for(None), false);
        for obstacle in ahead {
            match obstacle.kind {
                ObstacleKind::Predecessor(_, platoon) => {
                    decision.acceleration_mps2 = cav.platoon_acceleration(&platoon);
                    decision.limit = obstacle.limit;
                }
                ObstacleKind::RouteEnd(end) => decision.limit_by(cav.acceleration_to_end(end), obstacle),
                _ => {
                    let u = obstacle.acceleration(cav, |leader, _| cav.acceleration_for(Some(leader)));
                    decision.limit_by(u, obstacle);
                }
            }
        }
        decision
    }

    /// What a plan has, which keeps its gaps already: what is ahead limits it only where it would no longer be safe. The
    /// safety filter has the last word.
    pub(super) fn of_plan(
        planned_mps2: f64,
        cav: &Cav,
        ahead: &[Obstacle],
        filter: &mut SafetyFilter,
    ) -> Self {
        let mut decision = Self::wanting(planned_mps2, true);
        for obstacle in ahead {
            let safe = |leader, standstill_m| cav.safe_acceleration_for(leader, standstill_m);
            let u = obstacle.acceleration(cav, safe);
            decision.limit_by(u, obstacle);
        }
        decision.filter(cav, ahead, filter);
        decision
    }

    fn wanting(acceleration_mps2: f64, follows_plan: bool) -> Self {
        Self { acceleration_mps2, gives_way_at: None, follows_plan, limit: Limit::default() }
    }

    fn limit_by(&mut self, acceleration_mps2: f64, by: &Obstacle) {
        self.limit(acceleration_mps2, by.gives_way_at, by.limit);
    }

    fn limit(&mut self, acceleration_mps2: f64, gives_way_at: Option<usize>, limit: Limit) {
        if acceleration_mps2 < self.acceleration_mps2 {
            *self = Self { acceleration_mps2, gives_way_at, follows_plan: false, limit };
        }
    }

    fn filter(&mut self, cav: &Cav, ahead: &[Obstacle], filter: &mut SafetyFilter) {
        let params = cav.filter_params();
        let behind = |leader: LeaderState, _| {
            let preceding = Preceding {
                gap_m: leader.gap_m,
                speed_mps: leader.speed_mps,
                min_acceleration_mps2: params.min_acceleration_mps2,
                merging: None,
            };
            params.bounds(cav.speed_mps(), &[preceding])
        };
        let safely = |bounds: &AccelerationBounds| {
            if bounds.is_safe { bounds.high_mps2 } else { f64::NEG_INFINITY }
        };
        let bounds = ahead
            .iter()
            .map(|obstacle| obstacle.best(cav, behind, safely))
            .fold(params.bounds(cav.speed_mps(), &[]), AccelerationBounds::and);
        let limited_mps2 = filter.limit(self.acceleration_mps2, &params, bounds);
        self.limit(limited_mps2, None, Limit::of(DecisionReason::SafetyFilter));
    }
}
