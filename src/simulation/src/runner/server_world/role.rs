//! Permissions: what a sender is to the experiment or to a vehicle, and what it may do for that reason.

use super::{OPERATOR, OwnedVehicle, SenderNumber, ServerWorld};

/// What a sender is to the experiment, or to one vehicle of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Role {
    /// The person at the city's own window.
    Operator,
    /// Has set up the vehicle.
    Owner,
    /// Leads the experiment; the vehicle, if it is about one, is another sender's.
    Leader,
    /// Anyone else.
    Stranger,
}

/// What a body asks for, with the circumstances that decide.
#[derive(Clone, Copy, Debug)]
pub(super) enum Act {
    /// To start, pause or reset the experiment, or to set its signals.
    Command {
        /// Somebody leads it.
        has_leader: bool,
    },
    /// To set up a new vehicle.
    SetUp {
        /// The rules allow another guest.
        has_room: bool,
    },
    /// To set up a vehicle that is there.
    TakeOver {
        /// The owner is silent for longer than the timeout.
        is_orphaned: bool,
    },
    /// To remove a vehicle.
    Remove {
        /// The owner is silent for longer than the timeout.
        is_orphaned: bool,
    },
    /// To have a vehicle follow a trajectory.
    Follow,
    /// To say what happens in control zones.
    TellZones,
    /// To drive a vehicle by its pedals, or to hand it back.
    Drive {
        /// The laboratory's vehicles have their own drivers.
        is_physical: bool,
        /// The operator drives it.
        has_operator: bool,
    },
}

impl Role {
    /// Whether a sender in this role may do it.
    pub fn may(self, act: Act) -> bool {
        match (self, act) {
            (Self::Operator | Self::Leader, Act::Command { .. }) => true,
            (Self::Operator, Act::Drive { is_physical, .. }) => !is_physical,
            (Self::Operator, _) => false,
            (Self::Owner, Act::Drive { is_physical, has_operator }) => !is_physical && !has_operator,
            (Self::Owner, Act::TakeOver { .. } | Act::Remove { .. } | Act::Follow) => true,
            (Self::Leader, Act::SetUp { .. } | Act::TellZones) => true,
            (Self::Leader, Act::Remove { is_orphaned }) => is_orphaned,
            (Self::Leader | Self::Stranger, Act::TakeOver { is_orphaned }) => is_orphaned,
            (Self::Stranger, Act::SetUp { has_room }) => has_room,
            // Whoever starts an experiment that nobody leads does not lead it: a watcher may go on watching.
            (Self::Stranger, Act::Command { has_leader }) => !has_leader,
            (Self::Owner | Self::Leader | Self::Stranger, _) => false,
        }
    }
}

impl ServerWorld {
    /// The role of a sender towards a vehicle, or towards the experiment.
    pub(super) fn role(&self, sender: SenderNumber, vehicle: Option<&OwnedVehicle>) -> Role {
        match vehicle {
            _ if sender == OPERATOR => Role::Operator,
            Some(owned) if owned.owner == sender => Role::Owner,
            _ if self.leader == Some(sender) => Role::Leader,
            _ => Role::Stranger,
        }
    }
}
