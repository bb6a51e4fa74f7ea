//! Plans that the senders of a served city's vehicles tell: checked, held for some time, and shown to people. No state
//! depends on them.

use super::role::Act;
use super::{SenderNumber, ServerWorld};
use crate::runner::HeldPlans;
use city3d_protocol::snapshot::{CoordinationUpdate, VehicleId, ZoneState, ZoneVehicle};
use city3d_protocol::wire::{DropReason, Plans};

impl ServerWorld {
    /// Takes the plans of a sender; each entry that is not good is dropped and counted.
    pub(super) fn hear_plans(&mut self, sender: SenderNumber, told: &Plans) {
        if let Err(refusal) = self.is_timely(told.time_s, HeldPlans::HOLD_S) {
            return self.dropped.push(refusal);
        }
        let CoordinationUpdate { zones, vehicles, left } = told.in_city(self.experiment().scale);
        for zone in zones {
            let refusal = self.hear_zone(sender, told.time_s, zone).err();
            self.dropped.extend(refusal);
        }
        for vehicle in vehicles {
            let refusal = self.hear_zone_vehicle(sender, told.time_s, vehicle).err();
            self.dropped.extend(refusal);
        }
        for vehicle in left {
            let refusal = self.hear_left(sender, told.time_s, vehicle).err();
            self.dropped.extend(refusal);
        }
    }

    /// Control zones are those of whoever leads.
    fn hear_zone(&mut self, sender: SenderNumber, time_s: f64, zone: ZoneState) -> Result<(), DropReason> {
        if !self.role(sender, None).may(Act::TellZones) {
            return Err(DropReason::NotYours);
        }
        in_order(self.heard.plans.take_zone(time_s, zone))
    }

    fn hear_zone_vehicle(
        &mut self,
        sender: SenderNumber,
        time_s: f64,
        vehicle: ZoneVehicle,
    ) -> Result<(), DropReason> {
        self.may_tell_of(sender, vehicle.id)?;
        in_order(self.heard.plans.take_vehicle(time_s, vehicle))
    }

    fn hear_left(&mut self, sender: SenderNumber, time_s: f64, vehicle: VehicleId) -> Result<(), DropReason> {
        self.may_tell_of(sender, vehicle)?;
        in_order(self.heard.plans.take_left(time_s, vehicle))
    }
}

fn in_order(is_newest: bool) -> Result<(), DropReason> {
    if is_newest { Ok(()) } else { Err(DropReason::Reordered) }
}
