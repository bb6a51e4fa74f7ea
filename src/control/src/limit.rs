//! What limits a vehicle in a control step, noted beside the decision for people. No decision depends on it.

use super::decision::Decision;
use super::right_of_way::{ConstraintKind, YieldConstraint};
use super::route::{RANK_STOP, RANK_YIELD};
use super::{Cav, Mainframe};
use city3d_protocol::snapshot::{DecisionReason, VehicleId};

/// The active constraint of a decision, laboratory units.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Limit {
    /// What it is.
    pub reason: DecisionReason,
    /// The vehicle that it is about, where it is one.
    pub other: Option<VehicleId>,
    /// From the front bumper along the route to the place that it is about, where it has one.
    pub gap_m: Option<f64>,
}

/// Speeds that differ by less are the same, laboratory metres a second.
const SAME_MPS: f64 = 1e-3;

impl Limit {
    /// A limit without a vehicle and a place.
    pub(super) fn of(reason: DecisionReason) -> Self {
        Self { reason, other: None, gap_m: None }
    }

    /// A vehicle ahead.
    pub(super) fn behind(reason: DecisionReason, other: Option<VehicleId>, gap_m: f64) -> Self {
        Self { reason, other, gap_m: Some(gap_m) }
    }

    /// What the right of way of others demands of a vehicle.
    pub(super) fn of_constraint(cav: &Cav, cavs: &[Cav], constraint: &YieldConstraint) -> Self {
        let other = constraint.other.map(|other| cavs[other].id);
        match constraint.kind {
            ConstraintKind::Merging { leader, .. } => {
                Self::behind(DecisionReason::Merging, other, leader.gap_m)
            }
            ConstraintKind::Stop { gap_m } => {
                let is_at_next = constraint.section == cav.passage.next_section;
                let reason = if is_at_next { line_of(cav) } else { DecisionReason::Crossing };
                Self::behind(reason, other, gap_m)
            }
        }
    }

    /// What limits a vehicle after its decision was applied.
    pub(super) fn applied(cav: &Cav, decision: &Decision) -> Self {
        if cav.is_lost() {
            Self::of(DecisionReason::NotMeasured)
        } else if cav.coordination.follows_plan {
            Self::of(DecisionReason::Plan)
        } else if decision.limit.reason != DecisionReason::FreeRoad {
            decision.limit
        } else if cav.target_mps() < cav.driver.desired_speed_mps - SAME_MPS {
            Self::of(DecisionReason::RoadSpeed)
        } else {
            decision.limit
        }
    }
}

/// What keeps a vehicle out of the next section of its route.
fn line_of(cav: &Cav) -> DecisionReason {
    let rank = cav.route.sections[cav.passage.next_section].rank;
    match rank {
        _ if cav.passage.is_held_by_signal => DecisionReason::Signal,
        RANK_STOP => DecisionReason::StopLine,
        RANK_YIELD => DecisionReason::YieldLine,
        _ => DecisionReason::Junction,
    }
}

impl Cav {
    /// Speed that its route and its driver allow where it is, laboratory metres a second.
    pub fn target_mps(&self) -> f64 {
        self.route.speed_at(self.axle_s())
    }
}

impl Mainframe {
    /// What limits a vehicle in the last control step, with the vehicle that it gives way to at a line; `None` where the
    /// vehicle is not under control, or has not been measured.
    pub fn limit_of(&self, id: VehicleId) -> Option<Limit> {
        let index = self.cavs.binary_search_by_key(&id, |cav| cav.id).ok()?;
        let cav = &self.cavs[index];
        let mut limit = cav.is_seen().then_some(cav.limit)?;
        let is_line = matches!(
            limit.reason,
            DecisionReason::StopLine | DecisionReason::YieldLine | DecisionReason::Junction
        );
        if is_line && limit.other.is_none() {
            let holder = self.right_of_way.holder(index, &self.cavs);
            let in_the_way = || self.vehicle_behind_junction(index);
            if let Some(other) = holder {
                limit.other = Some(self.cavs[other].id);
            } else if let Some(other) = in_the_way() {
                (limit.reason, limit.other) = (DecisionReason::NoRoom, Some(self.cavs[other].id));
            }
        }
        Some(limit)
    }

    /// Who leaves a vehicle no room behind the next section of its route.
    fn vehicle_behind_junction(&self, index: usize) -> Option<usize> {
        let cav = &self.cavs[index];
        let section = cav.route.sections.get(cav.passage.next_section)?;
        let needed_m = cav.body.length_m + cav.driver.standstill_gap_m;
        let is_blocked = cav.passage.is_blocked();
        let found =
            self.occupancy.first_rear_after(&self.cavs, index, section.clear_s, needed_m, |_| is_blocked);
        found.map(|(other, _)| other)
    }
}
