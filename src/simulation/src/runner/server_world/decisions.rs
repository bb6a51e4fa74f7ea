//! Decisions that the senders of a served city's vehicles tell: checked, held for some time, and shown to people. No state
//! depends on them.

use super::role::Act;
use super::{HeldControl, SenderNumber, ServerWorld};
use crate::runner::HeldDecisions;
use city3d_protocol::snapshot::VehicleId;
use city3d_protocol::wire::{Decisions, DropReason, MAX_AHEAD_S, VehicleDecision};

impl ServerWorld {
    /// Takes the decisions of a sender; each that is not good is dropped and counted.
    pub(super) fn hear_decisions(&mut self, sender: SenderNumber, told: &Decisions) {
        if let Err(refusal) = self.is_timely(told.time_s, HeldDecisions::HOLD_S) {
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
        self.may_tell_of(sender, decision.vehicle)?;
        if decision.other.is_some_and(|other| !self.vehicles.contains_key(&other)) {
            return Err(DropReason::UnknownVehicle);
        }
        let in_city = decision.in_city(self.experiment().scale);
        if self.heard.decisions.take(time_s, in_city) { Ok(()) } else { Err(DropReason::Reordered) }
    }

    /// Whether something that holds for a while was told neither too long ago nor too far ahead of the clock.
    pub(super) fn is_timely(&self, told_s: f64, hold_s: f64) -> Result<(), DropReason> {
        let age_s = self.snapshot.time_s - told_s;
        if age_s < -MAX_AHEAD_S {
            Err(DropReason::Ahead)
        } else if age_s > hold_s {
            Err(DropReason::Stale)
        } else {
            Ok(())
        }
    }

    /// Whoever may say where a vehicle drives may say why.
    pub(super) fn may_tell_of(&self, sender: SenderNumber, vehicle: VehicleId) -> Result<(), DropReason> {
        let owned = self.vehicles.get(&vehicle).ok_or(DropReason::UnknownVehicle)?;
        if self.role(sender, Some(owned)).may(Act::Follow) { Ok(()) } else { Err(DropReason::NotYours) }
    }

    /// What the senders of the vehicles have told of their decisions and plans.
    pub fn heard(&self) -> &HeldControl {
        &self.heard
    }
}
