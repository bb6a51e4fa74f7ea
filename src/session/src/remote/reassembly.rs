//! Puts the poses of a tick together, which come in several datagrams.

use city3d_protocol::wire::{ObservedVehicle, Poses};
use std::collections::BTreeMap;

/// Reassembly buffer for the poses of a tick that come in several datagrams, in any order.
#[derive(Debug, Default)]
pub(super) struct PoseReassembly {
    parts: BTreeMap<u64, Vec<Option<Vec<ObservedVehicle>>>>,
}

/// Incomplete ticks that the buffer holds; the oldest is dropped for another.
const MAX_INCOMPLETE: usize = 8;

impl PoseReassembly {
    /// Adds a part; returns all poses of its tick when that is complete.
    pub(super) fn add(&mut self, poses: &Poses) -> Option<Vec<ObservedVehicle>> {
        let parts = self.parts.entry(poses.tick).or_default();
        parts.resize(poses.parts.into(), None);
        if let Some(part) = parts.get_mut(usize::from(poses.part)) {
            *part = Some(poses.vehicles.clone());
        }
        if parts.iter().all(Option::is_some) {
            let whole = self.parts.remove(&poses.tick)?;
            self.parts.retain(|tick, _| *tick > poses.tick);
            return Some(whole.into_iter().flatten().flatten().collect());
        }
        if self.parts.len() > MAX_INCOMPLETE {
            self.parts.pop_first();
        }
        None
    }
}
