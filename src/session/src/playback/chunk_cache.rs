//! A bounded cache of decoded MCAP chunks around the playhead. It evicts the chunk farthest from the requested one,
//! not the least recently used (LRU): playback moves along the log.

use super::playhead::{SeekTarget, TIME_TOLERANCE_S};
use city3d_logbook::record::{LoggedDecisions, LoggedPlans};
use city3d_protocol::snapshot::FrameSnapshot;
use city3d_simulation::runner::{HeldControl, HeldPlans};
use std::collections::BTreeMap;
use std::sync::Arc;

/// What is decoded of one chunk.
#[derive(Debug, Default)]
pub(super) struct ChunkContents {
    /// In order of time.
    pub(super) snapshots: Vec<Arc<FrameSnapshot>>,
    /// In order of time.
    pub(super) decisions: Vec<LoggedDecisions>,
    /// In order of time.
    pub(super) plans: Vec<LoggedPlans>,
}

/// A decoded chunk, which is shared.
pub(super) type DecodedChunk = Arc<ChunkContents>;

/// Capacity of the cache, in snapshots.
const CAPACITY_SNAPSHOTS: usize = 600;

/// A recorded snapshot and its predecessor: `(before, now)`.
pub(super) type SnapshotPair = (Arc<FrameSnapshot>, Arc<FrameSnapshot>);

/// The decoded chunks by their numbers.
#[derive(Clone, Debug, Default)]
pub(super) struct ChunkCache(BTreeMap<usize, DecodedChunk>);

impl ChunkCache {
    pub(super) fn get(&self, chunk: usize) -> Option<DecodedChunk> {
        self.0.get(&chunk).cloned()
    }

    pub(super) fn clear(&mut self) {
        self.0.clear();
    }

    /// Inserts a decoded chunk and evicts the chunks farthest from the wanted one.
    pub(super) fn insert(&mut self, chunk: usize, decoded: DecodedChunk, wanted: usize) {
        self.0.insert(chunk, decoded);
        // Chunks without snapshots count too: there may be many.
        let weight = |decoded: &DecodedChunk| decoded.snapshots.len().max(1);
        while self.0.len() > 4 && self.0.values().map(weight).sum::<usize>() > CAPACITY_SNAPSHOTS {
            let farthest = self.0.keys().copied().max_by_key(|chunk| chunk.abs_diff(wanted));
            farthest.map(|chunk| self.0.remove(&chunk));
        }
    }

    pub(super) fn snapshots(&self) -> usize {
        self.0.values().map(|decoded| decoded.snapshots.len()).sum()
    }
}

/// Binary search for the chunk that holds a time: the last one that begins no later.
pub(super) fn chunk_at(begins_s: &[f64], time_s: f64) -> usize {
    begins_s.partition_point(|begin_s| *begin_s <= time_s + TIME_TOLERANCE_S).saturating_sub(1)
}

/// The snapshots that bracket a time for interpolation: the last one not after it and the first one after it, where
/// they exist.
///
/// # Errors
/// The number of a chunk that is not in the cache.
pub(super) fn bracketing(
    begins_s: &[f64],
    time_s: f64,
    decoded: &mut impl FnMut(usize) -> Option<DecodedChunk>,
) -> Result<[Option<Arc<FrameSnapshot>>; 2], usize> {
    let here = chunk_at(begins_s, time_s);
    let is_before = |snapshot: &Arc<FrameSnapshot>| snapshot.time_s <= time_s + TIME_TOLERANCE_S;
    let (mut before, mut after) = (None, None);
    for chunk in (0..begins_s.len().min(here + 1)).rev() {
        let snapshots = &decoded(chunk).ok_or(chunk)?.snapshots;
        before = snapshots.iter().rev().find(|snapshot| is_before(snapshot)).cloned();
        if before.is_some() {
            break;
        }
    }
    for chunk in here..begins_s.len() {
        let snapshots = &decoded(chunk).ok_or(chunk)?.snapshots;
        after = snapshots.iter().find(|snapshot| !is_before(snapshot)).cloned();
        if after.is_some() {
            break;
        }
    }
    Ok([before, after])
}

/// What the control framework had told by a time, in the part of the log in which it may still hold. `telling` says which
/// chunks may have something of it.
///
/// # Errors
/// As for [`bracketing`].
pub(super) fn told_by(
    (begins_s, telling): (&[f64], &[bool]),
    time_s: f64,
    decoded: &mut impl FnMut(usize) -> Option<DecodedChunk>,
) -> Result<HeldControl, usize> {
    let mut held = HeldControl::default();
    // Plans hold for longer than decisions.
    let (first, last) = (chunk_at(begins_s, time_s - HeldPlans::HOLD_S), chunk_at(begins_s, time_s));
    let is_telling = |chunk: &usize| telling.get(*chunk).is_some_and(|is_telling| *is_telling);
    let is_before = |told_s: f64| told_s <= time_s + TIME_TOLERANCE_S;
    for chunk in (first..begins_s.len().min(last + 1)).filter(is_telling) {
        let contents = decoded(chunk).ok_or(chunk)?;
        for told in contents.decisions.iter().filter(|told| is_before(told.time_s)) {
            told.decisions.iter().for_each(|decision| _ = held.decisions.take(told.time_s, *decision));
        }
        for told in contents.plans.iter().filter(|told| is_before(told.time_s)) {
            held.plans.take(told.time_s, told.update.clone());
        }
    }
    Ok(held)
}

/// The snapshot of a seek target, with its predecessor; `None` where the log has no snapshots.
///
/// # Errors
/// As for [`bracketing`].
pub(super) fn find(
    begins_s: &[f64],
    target: SeekTarget,
    decoded: &mut impl FnMut(usize) -> Option<DecodedChunk>,
) -> Result<Option<SnapshotPair>, usize> {
    let now = match target {
        SeekTarget::Nearest(time_s) => {
            let [before, after] = bracketing(begins_s, time_s, decoded)?;
            let distance = |snapshot: &Arc<FrameSnapshot>| (snapshot.time_s - time_s).abs();
            let both = before.into_iter().chain(after);
            both.min_by(|a, b| distance(a).total_cmp(&distance(b)))
        }
        SeekTarget::NotBefore(time_s) => {
            let [before, after] = bracketing(begins_s, time_s - 2.0 * TIME_TOLERANCE_S, decoded)?;
            after.or(before)
        }
        SeekTarget::After(time_s) => {
            let [before, after] = bracketing(begins_s, time_s, decoded)?;
            after.or(before)
        }
        SeekTarget::Before(time_s) => {
            let [before, after] = bracketing(begins_s, time_s - 2.0 * TIME_TOLERANCE_S, decoded)?;
            before.or(after)
        }
    };
    let Some(now) = now else { return Ok(None) };
    let [before, _] = bracketing(begins_s, now.time_s - 2.0 * TIME_TOLERANCE_S, decoded)?;
    Ok(Some((before.unwrap_or_else(|| Arc::clone(&now)), now)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use city3d_protocol::snapshot::{ControlDecision, CoordinationUpdate, NoPlan, VehicleId, ZoneVehicle};

    /// Chunks that begin at 0, 1 and 3 s; the second one has no snapshots.
    const BEGINS_S: [f64; 4] = [0.0, 1.0, 2.0, 3.0];

    fn decoded(times_s: &[f64]) -> DecodedChunk {
        let at = |time_s: &f64| Arc::new(FrameSnapshot { time_s: *time_s, ..FrameSnapshot::default() });
        let snapshots = times_s.iter().map(at).collect();
        Arc::new(ChunkContents { snapshots, ..ChunkContents::default() })
    }

    fn cache() -> [DecodedChunk; 4] {
        [decoded(&[0.0, 0.4, 1.0]), decoded(&[]), decoded(&[2.5]), decoded(&[3.0, 3.5])]
    }

    fn times(target: SeekTarget) -> (f64, f64) {
        let cache = cache();
        let (before, now) =
            find(&BEGINS_S, target, &mut |chunk| Some(Arc::clone(&cache[chunk]))).unwrap().unwrap();
        (before.time_s, now.time_s)
    }

    #[test]
    fn aims_are_found_over_the_edges_of_chunks() {
        for (target, found) in [
            (SeekTarget::Nearest(0.5), (0.0, 0.4)),
            (SeekTarget::Nearest(1.6), (0.4, 1.0)),
            (SeekTarget::Nearest(2.0), (1.0, 2.5)),
            (SeekTarget::Nearest(99.0), (3.0, 3.5)),
            (SeekTarget::NotBefore(1.0), (0.4, 1.0)),
            (SeekTarget::NotBefore(1.01), (1.0, 2.5)),
            (SeekTarget::NotBefore(9.0), (3.0, 3.5)),
            (SeekTarget::After(1.0), (1.0, 2.5)),
            (SeekTarget::After(3.5), (3.0, 3.5)),
            (SeekTarget::Before(2.5), (0.4, 1.0)),
            (SeekTarget::Before(3.0), (1.0, 2.5)),
            (SeekTarget::Before(0.0), (0.0, 0.0)),
        ] {
            assert_eq!(times(target), found, "{target:?}");
        }
    }

    #[test]
    fn only_what_is_needed_is_asked_for() {
        let cache = cache();
        let mut requested = Vec::new();
        let mut decode = |chunk: usize| {
            requested.push(chunk);
            Some(Arc::clone(&cache[chunk]))
        };
        bracketing(&BEGINS_S, 0.5, &mut decode).unwrap();
        assert_eq!(requested, [0, 0]);
        let missing =
            bracketing(&BEGINS_S, 2.1, &mut |chunk| (chunk != 1).then(|| Arc::clone(&cache[chunk])));
        assert_eq!(missing, Err(1), "what is missing is named");
    }

    #[test]
    fn nothing_is_found_where_there_is_nothing() {
        let nothing = find(&BEGINS_S, SeekTarget::Nearest(1.0), &mut |_| Some(decoded(&[])));
        assert_eq!(nothing, Ok(None));
    }

    /// A chunk that tells decisions and plans of vehicles at these times.
    fn telling(told: &[(f64, u32)]) -> DecodedChunk {
        let at = |(time_s, vehicle): &(f64, u32)| LoggedDecisions {
            tick: 0,
            time_s: *time_s,
            decisions: vec![ControlDecision {
                vehicle: VehicleId(*vehicle),
                target_mps: *time_s,
                ..ControlDecision::default()
            }],
        };
        let planned = |(time_s, vehicle): &(f64, u32)| {
            let vehicle = ZoneVehicle {
                id: VehicleId(*vehicle),
                zone: 0,
                entered_s: *time_s,
                is_standing: false,
                plan: Err(NoPlan::Infeasible),
            };
            let update = CoordinationUpdate { vehicles: vec![vehicle], ..CoordinationUpdate::default() };
            LoggedPlans { tick: 0, time_s: *time_s, update }
        };
        let (decisions, plans) = (told.iter().map(at).collect(), told.iter().map(planned).collect());
        Arc::new(ChunkContents { decisions, plans, snapshots: Vec::new() })
    }

    #[test]
    fn what_was_told_holds_over_the_edges_of_chunks_and_not_for_ever() {
        let cache =
            [telling(&[(0.2, 1), (0.7, 2)]), telling(&[]), telling(&[(2.0, 1), (2.5, 1)]), telling(&[])];
        let told = |time_s| {
            told_by((&BEGINS_S, &[true; 4]), time_s, &mut |chunk| Some(Arc::clone(&cache[chunk]))).unwrap()
        };
        let decided = |time_s| {
            let pair = |decision: ControlDecision| (decision.vehicle.0, decision.target_mps);
            let found = told(time_s).decisions.at(time_s);
            found.map(|found| found.into_iter().map(pair).collect::<Vec<_>>())
        };
        assert_eq!(decided(0.1), None, "nothing was told yet");
        assert_eq!(decided(0.2), Some(vec![(1, 0.2)]));
        assert_eq!(decided(1.2), Some(vec![(1, 0.2), (2, 0.7)]));
        assert_eq!(decided(1.6), Some(vec![(2, 0.7)]));
        assert_eq!(decided(1.9), None, "it was told too long ago");
        assert_eq!(decided(2.4), Some(vec![(1, 2.0)]));
        assert_eq!(decided(3.4), Some(vec![(1, 2.5)]));
        let planned = |time_s| {
            let pair = |vehicle: &ZoneVehicle| (vehicle.id.0, vehicle.entered_s);
            let found = told(time_s).plans.at(time_s);
            found.map(|found| found.vehicles.iter().map(pair).collect::<Vec<_>>())
        };
        assert_eq!(planned(0.1), None, "nothing was told yet");
        assert_eq!(planned(1.9), Some(vec![(1, 0.2), (2, 0.7)]), "plans hold for longer");
        assert_eq!(planned(2.6), Some(vec![(1, 2.5), (2, 0.7)]));
        assert_eq!(planned(3.4), Some(vec![(1, 2.5)]));
        let mut later = |chunk: usize| (chunk > 0).then(|| Arc::clone(&cache[chunk]));
        let missing = told_by((&BEGINS_S, &[true; 4]), 2.2, &mut later);
        assert_eq!(missing, Err(0), "the chunk before is wanted too");
        let silent = told_by((&BEGINS_S, &[false; 4]), 1.2, &mut later);
        assert_eq!(silent, Ok(HeldControl::default()), "nothing is wanted where nothing is told");
    }

    #[test]
    fn the_memory_of_film_is_bounded_and_keeps_what_is_near() {
        let mut cache = ChunkCache::default();
        let hundred: Vec<f64> = (0..100).map(f64::from).collect();
        for chunk in 0..50 {
            cache.insert(chunk, decoded(&hundred), chunk);
        }
        assert!(cache.snapshots() <= CAPACITY_SNAPSHOTS, "{}", cache.snapshots());
        assert!((45..50).all(|chunk| cache.get(chunk).is_some()) && cache.get(10).is_none());
    }
}
