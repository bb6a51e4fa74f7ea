//! Persons who drive vehicles by pedals and steering wheel: the operator, and owners over the link.

use super::role::Act;
use super::{OPERATOR, PendingCommand, SenderNumber, ServerWorld, note_sequence};
use city3d_protocol::snapshot::{Pedals, SimCommand, VehicleId};
use city3d_protocol::wire::{Body, DropReason};

/// The sender that holds the steering wheel of a vehicle.
#[derive(Clone, Copy, Debug)]
pub(super) struct Driver {
    pub sender: SenderNumber,
    /// Sequence number of its last pedals.
    sequence: u32,
    /// Wall-clock time of its last pedals, seconds.
    last_s: f64,
}

impl ServerWorld {
    /// The sender that drives a vehicle by its pedals.
    pub fn driver(&self, vehicle: VehicleId) -> Option<SenderNumber> {
        self.vehicles.get(&vehicle)?.driver.map(|driver| driver.sender)
    }

    /// Takes a person's pedals for a vehicle, or hands it back. What is refused changes nothing.
    pub(super) fn drive(
        &mut self,
        sender: SenderNumber,
        now_s: f64,
        vehicle: VehicleId,
        sequence: u32,
        pedals: Option<Pedals>,
    ) -> Result<(), DropReason> {
        let owned = self.vehicles.get(&vehicle).ok_or(DropReason::UnknownVehicle)?;
        let has_operator = owned.driver.is_some_and(|driver| driver.sender == OPERATOR);
        let act = Act::Drive { is_physical: owned.is_physical(), has_operator };
        if !self.role(sender, Some(owned)).may(act) {
            return Err(DropReason::NotYours);
        }
        let mut newest = owned.drive_sequence;
        if sender != OPERATOR {
            note_sequence(&mut newest, sequence)?;
        }
        if let Some(pedals) = pedals {
            // The log keeps what the world gets, and its format has these ranges.
            let pedals = pedals.clamped();
            let body = Body::Drive { vehicle, sequence, pedals: Some(pedals) };
            self.queue(PendingCommand { sender, body, command: SimCommand::Drive(vehicle, pedals) })?;
        } else if self.driver(vehicle) == Some(sender) {
            self.release(vehicle, sequence);
        }
        if let Some(owned) = self.vehicles.get_mut(&vehicle) {
            owned.drive_sequence = newest;
            if pedals.is_some() {
                owned.driver = Some(Driver { sender, sequence, last_s: now_s });
            }
        }
        Ok(())
    }

    /// Queues the release of a vehicle that somebody drives.
    fn release(&mut self, vehicle: VehicleId, sequence: u32) {
        let driver = self.vehicles.get_mut(&vehicle).and_then(|owned| owned.driver.take());
        let Some(Driver { sender, .. }) = driver else { return };
        let body = Body::Drive { vehicle, sequence, pedals: None };
        // Without a look at the queue's capacity: each release follows pedals that had room, and the vehicle would
        // keep going.
        self.pending.push(PendingCommand { sender, body, command: SimCommand::Release(vehicle) });
    }

    /// Releases a vehicle for a driver that can no longer do so.
    pub(super) fn release_lost(&mut self, vehicle: VehicleId) {
        if let Some(driver) = self.vehicles.get(&vehicle).and_then(|owned| owned.driver) {
            self.release(vehicle, driver.sequence);
        }
    }

    /// Takes the steering wheel from drivers over the link that have sent no pedals for the link timeout, at least one
    /// second. The vehicles follow their trajectories again.
    pub fn release_silent_drivers(&mut self, now_s: f64) {
        let timeout_s = self.heartbeat_timeout_s();
        let is_silent = |driver: &Driver| driver.sender != OPERATOR && now_s - driver.last_s > timeout_s;
        let silent: Vec<VehicleId> = self
            .vehicles
            .iter()
            .filter(|(_, owned)| owned.driver.as_ref().is_some_and(is_silent))
            .map(|(id, _)| *id)
            .collect();
        silent.into_iter().for_each(|vehicle| self.release_lost(vehicle));
    }

    /// Forgets all drivers and their waiting pedals: a reset returns the vehicles to their trajectories.
    pub(super) fn forget_drivers(&mut self) {
        // Within a tick commands without a vehicle come first, so that pedals from before would act after the reset.
        self.pending
            .retain(|pending| !matches!(pending.command, SimCommand::Drive(..) | SimCommand::Release(_)));
        for owned in self.vehicles.values_mut() {
            (owned.drive_sequence, owned.driver) = (None, None);
        }
    }
}
