//! Decisions that the senders of a served city's vehicles tell: checked, held for some time, and shown to people. No state
//! depends on them.

use super::role::Act;
use super::{HeldDecisions, SenderNumber, ServerWorld};
use city3d_protocol::wire::{Decisions, DropReason, MAX_AHEAD_S, VehicleDecision};

impl ServerWorld {
    /// Takes the decisions of a sender; each that is not good is dropped and counted.
    pub(super) fn hear_decisions(&mut self, sender: SenderNumber, told: &Decisions) {
        let age_s = self.snapshot.time_s - told.time_s;
        let refusal = if age_s < -MAX_AHEAD_S {
            Some(DropReason::Ahead)
        } else if age_s > HeldDecisions::HOLD_S {
            Some(DropReason::Stale)
        } else {
            None
        };
        if let Some(refusal) = refusal {
            return self.dropped.push(refusal);
        }
        for decision in &told.vehicles {
            let refusal = self.hear_decision(sender, told.time_s, decision).err();
            self.dropped.extend(refusal);
        }
    }

    fn hear_decision(
        &mut self,
        sender: SenderNumber,
        time_s: f64,
        decision: &VehicleDecision,
    ) -> Result<(), DropReason> {
        let Some(owned) = self.vehicles.get(&decision.vehicle) else {
            return Err(DropReason::UnknownVehicle);
        };
        // Whoever may say where it drives may say why.
        if !self.role(sender, Some(owned)).may(Act::Follow) {
            return Err(DropReason::NotYours);
        }
        if decision.other.is_some_and(|other| !self.vehicles.contains_key(&other)) {
            return Err(DropReason::UnknownVehicle);
        }
        let in_city = decision.in_city(self.experiment().scale);
        if self.decisions.take(time_s, in_city) { Ok(()) } else { Err(DropReason::Reordered) }
    }

    /// What the senders of the vehicles have told of their decisions.
    pub fn decisions(&self) -> &HeldDecisions {
        &self.decisions
    }
}
