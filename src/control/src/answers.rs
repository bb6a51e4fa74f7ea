//! What the vehicles of a control step decide, and what they are told. They decide side by side, by what they see and by who
//! followed a plan in the step before; who relied on somebody that has begun or ceased to, and who hears of a decision of the
//! same step in a platoon, decides in order.

use super::cav::{Reads, Yielding, fetch_ahead};
use super::coordination::filter::{FilterCounts, SafetyFilter};
use super::decision::{Decision, Obstacle, ObstacleKind, StopPlace};
use super::limit::Limit;
use super::plan::PlanAhead;
use super::platooning::Platooning;
use super::right_of_way::{ConstraintKind, RightOfWay, VehicleSet, WayLeft, YieldConstraint};
use super::strangers::Strangers;
use super::traffic::Occupancy;
use super::{Cav, SIGHT_M, plan};
use city3d_geometry::Lab;
use city3d_protocol::snapshot::{DecisionReason, Trajectory, TrajectoryPoint};
use city3d_roadmap::LabMap;

/// What a vehicle decides from.
#[derive(Clone, Copy)]
pub(super) struct Surroundings<'s> {
    pub map: &'s LabMap,
    pub cavs: &'s [Cav],
    pub occupancy: &'s Occupancy,
    pub right_of_way: &'s RightOfWay,
    pub strangers: &'s Strangers,
    pub platooning: Option<&'s Platooning>,
}

/// What a vehicle heeds; buffers.
#[derive(Debug, Default)]
pub(super) struct Heeded {
    ahead: Vec<Obstacle>,
    constraints: Vec<YieldConstraint>,
}

/// The decision of one vehicle, with what else it has seen.
#[derive(Clone, Copy, Debug)]
pub(super) struct Decided {
    decision: Decision,
    left: WayLeft,
    /// What the safety filter did.
    filtered: FilterCounts,
    /// Whether somebody has priority where it has been yielding.
    still_gives_way: bool,
}

/// The answer to one vehicle in a control step.
#[derive(Debug, Default)]
pub(super) struct Answer {
    decided: Option<Decided>,
    is_applied: bool,
    trajectory: Option<Trajectory<Lab>>,
    /// Space for points.
    pub points: Vec<TrajectoryPoint<Lab>>,
}

impl Surroundings<'_> {
    /// What a vehicle decides, on its plan where it has one, else as its driver.
    pub fn vehicle_decides(&self, index: usize, now_s: f64, heeded: &mut Heeded) -> Decided {
        let (cav, left) = (&self.cavs[index], self.look_ahead(index, heeded));
        let mut filter = SafetyFilter::default();
        let decision = match cav.planned_acceleration(now_s) {
            Some(planned) => Decision::of_plan(planned, cav, &heeded.ahead, &mut filter),
            None => Decision::of_driver(cav, &heeded.ahead),
        };
        let still_gives_way = match cav.yielding {
            Yielding::At { section, .. } => {
                heeded.constraints.iter().any(|held| held.gives_way && held.section == section)
            }
            _ => false,
        };
        Decided { decision, left, filtered: filter.counts(), still_gives_way }
    }

    /// Collects what a vehicle has to heed.
    fn look_ahead(&self, index: usize, heeded: &mut Heeded) -> WayLeft {
        let Heeded { ahead, constraints } = heeded;
        let cav = &self.cavs[index];
        ahead.clear();
        if let Some(leader) = self.occupancy.leader(self.cavs, index, SIGHT_M) {
            let told = self.platooning.and_then(|platooning| platooning.broadcast(self.cavs, index, &leader));
            let (kind, reason) = match told {
                Some(platoon) => (ObstacleKind::Predecessor(leader.ahead, platoon), DecisionReason::Platoon),
                None => (ObstacleKind::Leader(leader.ahead), DecisionReason::Leader),
            };
            let limit = Limit::behind(reason, Some(leader.id), leader.ahead.gap_m);
            ahead.push(Obstacle { kind, gives_way_at: None, limit });
        }
        ahead.extend(self.strangers.leader(cav, SIGHT_M).map(|stranger| {
            Obstacle::leader(stranger, Limit::behind(DecisionReason::Leader, None, stranger.gap_m))
        }));
        ahead.extend(cav.end_of_route().map(Obstacle::route_end));
        constraints.clear();
        let left = self.right_of_way.yield_constraints(self.map, index, self.cavs, constraints);
        ahead.extend(constraints.iter().map(|constraint| self.obstacle_of(cav, constraint)));
        left
    }

    fn obstacle_of(&self, cav: &Cav, constraint: &YieldConstraint) -> Obstacle {
        let keeps_gap = constraint.section == cav.passage.next_section;
        let place = |gap_m| StopPlace { gap_m, keeps_gap };
        let kind = match constraint.kind {
            ConstraintKind::Stop { gap_m } => ObstacleKind::Stop(place(gap_m)),
            ConstraintKind::Merging { leader, wait_gap_m } => {
                ObstacleKind::Merging(leader, (wait_gap_m > 0.0).then(|| place(wait_gap_m)))
            }
        };
        let gives_way_at = constraint.gives_way.then_some(constraint.section);
        Obstacle { kind, gives_way_at, limit: Limit::of_constraint(cav, self.cavs, constraint) }
    }
}

impl Answer {
    /// Forgets the last step, and decides for a vehicle that hears of nobody's decision.
    pub fn begin(&mut self, around: &Surroundings<'_>, index: usize, now_s: f64, heeded: &mut Heeded) {
        let is_alone = around.cavs[index].is_on_route() && around.platooning.is_none();
        *self = Self {
            decided: is_alone.then(|| around.vehicle_decides(index, now_s, heeded)),
            is_applied: false,
            trajectory: None,
            points: Vec::new(),
        };
    }

    /// What the vehicle has decided by itself, unless it relied on the plan of one of these.
    pub fn decided_without(&self, changed: VehicleSet) -> Option<Decided> {
        self.decided.filter(|decided| !decided.left.relies_on.meets(changed))
    }

    /// Notes that the decision was applied.
    pub fn set_applied(&mut self) {
        self.is_applied = true;
    }

    /// Applies the decisions of neighbours in the list of vehicles, unless they have been applied in order, and makes the messages.
    pub fn finish_all(map: &LabMap, cavs: &mut [Cav], answers: &mut [Self], times: (f64, f64)) {
        for first in (0..cavs.len()).step_by(plan::SIDE_BY_SIDE) {
            let places = first..cavs.len().min(first + plan::SIDE_BY_SIDE);
            let mut plans: [Option<PlanAhead>; plan::SIDE_BY_SIDE] = Default::default();
            for (place, ahead) in places.clone().zip(&mut plans) {
                fetch_ahead(cavs, place, Reads::Way(map));
                *ahead = answers[place].begin_message(map, &mut cavs[place], times);
            }
            PlanAhead::finish_all(map, &cavs[places.clone()], &mut plans);
            for (answer, ahead) in answers[places].iter_mut().zip(plans) {
                if let Some(ahead) = ahead {
                    answer.trajectory = Some(ahead.into_trajectory());
                }
            }
        }
    }

    /// Returns the plan from which a vehicle on its route is told what to do; the message to another is made.
    fn begin_message(
        &mut self,
        map: &LabMap,
        cav: &mut Cav,
        (time_s, dt_s): (f64, f64),
    ) -> Option<PlanAhead> {
        if let Some(decided) = self.decided.filter(|_| !self.is_applied) {
            decided.apply(cav, time_s, dt_s);
        }
        let points = std::mem::take(&mut self.points);
        self.trajectory = None;
        if cav.is_on_route() {
            return Some(PlanAhead::begin(map, cav, time_s, points));
        }
        if cav.is_seen() {
            // No route leads on from there.
            cav.limit = Limit::of(DecisionReason::OffRoute);
            self.trajectory = Some(plan::stop_straight(cav, time_s, points));
        }
        None
    }

    /// The message, once.
    pub fn take_trajectory(&mut self) -> Option<Trajectory<Lab>> {
        self.trajectory.take()
    }
}

impl Decided {
    /// What the safety filter did for it.
    pub fn filtered(&self) -> &FilterCounts {
        &self.filtered
    }

    /// Advances the vehicle's plan by a control step.
    pub fn apply(&self, cav: &mut Cav, time_s: f64, dt_s: f64) {
        cav.wait_m = self.left.wait_m;
        cav.note_yielding(time_s, &self.decision, self.still_gives_way);
        cav.apply(self.decision, time_s, dt_s);
        cav.limit = Limit::applied(cav, &self.decision);
    }
}
