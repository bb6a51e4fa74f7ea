//! A bounded cache of past states of a log, coarser than its snapshots, for running plots and figures.

use crate::{KEPT_EVERY_S, PastState, RunHistory};
use city3d_protocol::snapshot::{FrameSnapshot, Status};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Most memory of the states, bytes. Beyond it, all of them become coarser.
const LIMIT: usize = 128 << 20;
/// Rounding error of times.
const ROUNDING_S: f64 = 1e-6;

/// States by the numbers of their chunks.
#[derive(Debug)]
pub(super) struct PastCache {
    chunks: BTreeMap<usize, Vec<Arc<PastState>>>,
    bytes: usize,
    limit: usize,
    /// Least time between two states of a chunk.
    every_s: f64,
    revision: u64,
}

impl Default for PastCache {
    fn default() -> Self {
        Self { chunks: BTreeMap::new(), bytes: 0, limit: LIMIT, every_s: KEPT_EVERY_S, revision: 0 }
    }
}

impl PastCache {
    pub(super) fn has(&self, chunk: usize) -> bool {
        self.chunks.contains_key(&chunk)
    }

    /// Changes with the states.
    pub(super) fn revision(&self) -> u64 {
        self.revision
    }

    /// Keeps some of the snapshots of a chunk: those that are due, and those in which a vehicle has collided.
    pub(super) fn insert(&mut self, chunk: usize, snapshots: &[Arc<FrameSnapshot>]) {
        let mut states: Vec<Arc<PastState>> = Vec::new();
        let mut wrecks = None;
        for snapshot in snapshots {
            let collided = snapshot.vehicles.iter().filter(|vehicle| vehicle.status == Status::Collided);
            let now = collided.count();
            let is_impact = wrecks.replace(now).is_some_and(|before| now > before);
            if is_impact || is_due(states.last(), snapshot.time_s, self.every_s) {
                states.push(Arc::new(PastState::of(snapshot)));
            }
        }
        self.bytes += bytes(&states);
        let before = self.chunks.insert(chunk, states);
        self.bytes -= before.map_or(0, |states| bytes(&states));
        self.revision += 1;
        while self.bytes > self.limit && self.thin() {}
    }

    /// Doubles the time between states; `false` where no chunk has more than one state.
    fn thin(&mut self) -> bool {
        self.every_s *= 2.0;
        let mut has_thinned = false;
        for states in self.chunks.values_mut() {
            let mut last: Option<Arc<PastState>> = None;
            let before = states.len();
            states.retain(|state| {
                let is_kept = is_due(last.as_ref(), state.time_s(), self.every_s);
                if is_kept {
                    last = Some(Arc::clone(state));
                }
                is_kept
            });
            has_thinned |= states.len() < before;
        }
        self.bytes = self.chunks.values().map(|states| bytes(states)).sum();
        has_thinned || self.chunks.values().any(|states| states.len() > 1)
    }

    /// Drops all states: what they show of vehicles was wrong.
    pub(super) fn clear(&mut self) {
        self.chunks.clear();
        (self.bytes, self.revision) = (0, self.revision + 1);
    }

    /// Copies all states, in order of time.
    pub(super) fn read(&self, history: &mut RunHistory) {
        history.replace(self.chunks.values().flatten().cloned().collect());
    }
}

fn is_due(last: Option<&Arc<PastState>>, time_s: f64, every_s: f64) -> bool {
    last.is_none_or(|last| time_s - last.time_s() > every_s - ROUNDING_S)
}

fn bytes(states: &[Arc<PastState>]) -> usize {
    states.iter().map(|state| state.bytes()).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use city3d_protocol::snapshot::VehicleState;

    fn chunk(from_s: f64) -> Vec<Arc<FrameSnapshot>> {
        let at = |k: u32| FrameSnapshot { time_s: from_s + f64::from(k) * 0.02, ..FrameSnapshot::default() };
        (0..50).map(|k| Arc::new(at(k))).collect()
    }

    #[test]
    fn states_are_ten_a_second_and_fewer_where_memory_ends_but_every_chunk_has_some() {
        let mut cache = PastCache::default();
        cache.insert(3, &chunk(3.0));
        assert_eq!(cache.chunks[&3].len(), 10);
        cache.limit = 40 * cache.bytes / 10;
        (0..20).rev().for_each(|number| cache.insert(number, &chunk(number as f64)));
        assert!(cache.bytes <= cache.limit, "{} of {}", cache.bytes, cache.limit);
        let mut history = RunHistory::default();
        cache.read(&mut history);
        let times: Vec<f64> = history.states().iter().map(|state| state.time_s()).collect();
        assert!(times.is_sorted() && (20..=40).contains(&times.len()), "{times:?}");
        assert!((0..20).all(|number| cache.has(number) && !cache.chunks[&number].is_empty()));
    }

    #[test]
    fn the_state_of_an_impact_is_kept_between_those_that_are_due() {
        let mut snapshots = chunk(5.0);
        for snapshot in &mut snapshots[7..] {
            let wreck = VehicleState { status: Status::Collided, ..VehicleState::default() };
            Arc::make_mut(snapshot).vehicles.push(wreck);
        }
        let mut cache = PastCache::default();
        cache.insert(5, &snapshots);
        let times: Vec<f64> = cache.chunks[&5].iter().map(|state| state.time_s()).collect();
        assert!((times[2] - 5.14).abs() < 1e-9 && times.len() <= 11, "{times:?}");
    }
}
