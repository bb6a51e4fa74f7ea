//! Decisions of a control framework that were told at intervals.

use super::LatestValues;
use city3d_protocol::snapshot::{ControlDecision, VehicleId};

/// The latest decision of each vehicle.
#[derive(Clone, Debug, PartialEq)]
pub struct HeldDecisions(LatestValues<VehicleId, ControlDecision>);

/// A decision is told again after half a second at most: this lets one of those get lost.
const HOLD_S: f64 = 1.1;

impl Default for HeldDecisions {
    fn default() -> Self {
        Self(LatestValues::holding_for(HOLD_S))
    }
}

impl HeldDecisions {
    /// How long a decision holds after it was told, simulated seconds.
    pub const HOLD_S: f64 = HOLD_S;

    /// Takes a decision that was told at `told_s`; `false` where a newer one is known.
    pub fn take(&mut self, told_s: f64, decision: ControlDecision) -> bool {
        self.0.take(told_s, decision.vehicle, decision)
    }

    /// Forgets what does not hold at `now_s`: what was told too long ago, and, after a reset of the clock, what was told
    /// later.
    pub fn expire(&mut self, now_s: f64) {
        self.0.expire(now_s);
    }

    /// Forgets the decision for a vehicle.
    pub fn forget(&mut self, vehicle: VehicleId) {
        self.0.forget(&vehicle);
    }

    /// Those that hold at `now_s`, in id order; `None` where there are none, for then nobody tells any.
    pub fn at(&self, now_s: f64) -> Option<Vec<ControlDecision>> {
        let decisions: Vec<ControlDecision> = self.0.at(now_s).copied().collect();
        (!decisions.is_empty()).then_some(decisions)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(vehicle: u32, target_mps: f64) -> ControlDecision {
        ControlDecision { vehicle: VehicleId(vehicle), target_mps, ..ControlDecision::default() }
    }

    #[test]
    fn the_newest_decision_holds_and_no_longer_than_it_may() {
        let mut held = HeldDecisions::default();
        assert_eq!(held.at(0.0), None);
        assert!(held.take(1.0, of(2, 5.0)) && held.take(1.5, of(1, 6.0)));
        assert!(!held.take(0.5, of(2, 9.0)), "it was overtaken on its way");
        assert_eq!(held.at(1.5), Some(vec![of(1, 6.0), of(2, 5.0)]));
        assert_eq!(held.at(2.3), Some(vec![of(1, 6.0)]), "that of vehicle 2 is too old");
        held.expire(2.3);
        assert!(held.take(0.5, of(2, 9.0)), "it was forgotten");
        held.forget(VehicleId(1));
        assert_eq!(held.at(1.5), Some(vec![of(2, 9.0)]));
        assert_eq!(held.at(3.0), None);
    }

    #[test]
    fn after_a_reset_nothing_of_the_run_before_is_left() {
        let mut held = HeldDecisions::default();
        held.take(20.0, of(1, 5.0));
        assert_eq!(held.at(0.1), None);
        held.expire(0.1);
        assert!(held.take(0.1, of(1, 6.0)));
        assert_eq!(held.at(0.1), Some(vec![of(1, 6.0)]));
    }
}
