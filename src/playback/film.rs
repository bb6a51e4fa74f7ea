//! Decoded stretches of a recorded run around the place that is shown.

use super::head::{Aim, SAME_S};
use crate::snapshot::FrameSnapshot;
use std::collections::BTreeMap;
use std::sync::Arc;

/// The snapshots of a chunk, in order of time.
pub(super) type Stretch = Arc<Vec<Arc<FrameSnapshot>>>;

/// So many snapshots are kept at most: what is farthest from the wanted place goes first.
const KEPT: usize = 600;

/// A recorded snapshot and the one before it.
pub(super) type Pair = (Arc<FrameSnapshot>, Arc<FrameSnapshot>);

/// Stretches by the numbers of their chunks.
#[derive(Clone, Debug, Default)]
pub(super) struct Film(BTreeMap<usize, Stretch>);

impl Film {
    pub(super) fn get(&self, chunk: usize) -> Option<Stretch> {
        self.0.get(&chunk).cloned()
    }

    pub(super) fn clear(&mut self) {
        self.0.clear();
    }

    /// Takes a stretch in, and lets others go that are farther from the wanted chunk than it is.
    pub(super) fn insert(&mut self, chunk: usize, stretch: Stretch, wanted: usize) {
        self.0.insert(chunk, stretch);
        // Chunks without snapshots weigh something too: there may be many.
        let weight = |stretch: &Stretch| stretch.len().max(1);
        while self.0.len() > 4 && self.0.values().map(weight).sum::<usize>() > KEPT {
            let farthest = self.0.keys().copied().max_by_key(|chunk| chunk.abs_diff(wanted));
            farthest.map(|chunk| self.0.remove(&chunk));
        }
    }

    pub(super) fn snapshots(&self) -> usize {
        self.0.values().map(|stretch| stretch.len()).sum()
    }
}

/// The chunk in which a time lies, by the times at which chunks begin: the last one that begins no later.
pub(super) fn chunk_at(begins_s: &[f64], time_s: f64) -> usize {
    begins_s.partition_point(|begin_s| *begin_s <= time_s + SAME_S).saturating_sub(1)
}

/// The last snapshot not after a time, and the first one after it; either may not be there.
///
/// # Errors
/// The number of a chunk that has to be decoded first.
pub(super) fn around(
    begins_s: &[f64],
    time_s: f64,
    stretch: &mut impl FnMut(usize) -> Option<Stretch>,
) -> Result<[Option<Arc<FrameSnapshot>>; 2], usize> {
    let here = chunk_at(begins_s, time_s);
    let is_before = |snapshot: &Arc<FrameSnapshot>| snapshot.time_s <= time_s + SAME_S;
    let (mut before, mut after) = (None, None);
    for chunk in (0..begins_s.len().min(here + 1)).rev() {
        let snapshots = stretch(chunk).ok_or(chunk)?;
        before = snapshots.iter().rev().find(|snapshot| is_before(snapshot)).cloned();
        if before.is_some() {
            break;
        }
    }
    for chunk in here..begins_s.len() {
        let snapshots = stretch(chunk).ok_or(chunk)?;
        after = snapshots.iter().find(|snapshot| !is_before(snapshot)).cloned();
        if after.is_some() {
            break;
        }
    }
    Ok([before, after])
}

/// The snapshot that an aim means, with the one before it; `None` where there is no snapshot at all.
///
/// # Errors
/// As for [`around`].
pub(super) fn find(
    begins_s: &[f64],
    aim: Aim,
    stretch: &mut impl FnMut(usize) -> Option<Stretch>,
) -> Result<Option<Pair>, usize> {
    let now = match aim {
        Aim::Nearest(time_s) => {
            let [before, after] = around(begins_s, time_s, stretch)?;
            let distance = |snapshot: &Arc<FrameSnapshot>| (snapshot.time_s - time_s).abs();
            let both = before.into_iter().chain(after);
            both.min_by(|a, b| distance(a).total_cmp(&distance(b)))
        }
        Aim::NotBefore(time_s) => {
            let [before, after] = around(begins_s, time_s - 2.0 * SAME_S, stretch)?;
            after.or(before)
        }
        Aim::After(time_s) => {
            let [before, after] = around(begins_s, time_s, stretch)?;
            after.or(before)
        }
        Aim::Before(time_s) => {
            let [before, after] = around(begins_s, time_s - 2.0 * SAME_S, stretch)?;
            before.or(after)
        }
    };
    let Some(now) = now else { return Ok(None) };
    let [before, _] = around(begins_s, now.time_s - 2.0 * SAME_S, stretch)?;
    Ok(Some((before.unwrap_or_else(|| Arc::clone(&now)), now)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Chunks that begin at 0, 1 and 3 s; the second one has no snapshots.
    const BEGINS_S: [f64; 4] = [0.0, 1.0, 2.0, 3.0];

    fn stretch(times_s: &[f64]) -> Stretch {
        let at = |time_s: &f64| Arc::new(FrameSnapshot { time_s: *time_s, ..FrameSnapshot::default() });
        Arc::new(times_s.iter().map(at).collect())
    }

    fn film() -> [Stretch; 4] {
        [stretch(&[0.0, 0.4, 1.0]), stretch(&[]), stretch(&[2.5]), stretch(&[3.0, 3.5])]
    }

    fn times(aim: Aim) -> (f64, f64) {
        let film = film();
        let (before, now) =
            find(&BEGINS_S, aim, &mut |chunk| Some(Arc::clone(&film[chunk]))).unwrap().unwrap();
        (before.time_s, now.time_s)
    }

    #[test]
    fn aims_are_found_over_the_edges_of_chunks() {
        for (aim, found) in [
            (Aim::Nearest(0.5), (0.0, 0.4)),
            (Aim::Nearest(1.6), (0.4, 1.0)),
            (Aim::Nearest(2.0), (1.0, 2.5)),
            (Aim::Nearest(99.0), (3.0, 3.5)),
            (Aim::NotBefore(1.0), (0.4, 1.0)),
            (Aim::NotBefore(1.01), (1.0, 2.5)),
            (Aim::NotBefore(9.0), (3.0, 3.5)),
            (Aim::After(1.0), (1.0, 2.5)),
            (Aim::After(3.5), (3.0, 3.5)),
            (Aim::Before(2.5), (0.4, 1.0)),
            (Aim::Before(3.0), (1.0, 2.5)),
            (Aim::Before(0.0), (0.0, 0.0)),
        ] {
            assert_eq!(times(aim), found, "{aim:?}");
        }
    }

    #[test]
    fn only_what_is_needed_is_asked_for() {
        let film = film();
        let mut asked = Vec::new();
        let mut decode = |chunk: usize| {
            asked.push(chunk);
            Some(Arc::clone(&film[chunk]))
        };
        around(&BEGINS_S, 0.5, &mut decode).unwrap();
        assert_eq!(asked, [0, 0]);
        let missing = around(&BEGINS_S, 2.1, &mut |chunk| (chunk != 1).then(|| Arc::clone(&film[chunk])));
        assert_eq!(missing, Err(1), "what is missing is named");
    }

    #[test]
    fn nothing_is_found_where_there_is_nothing() {
        let nothing = find(&BEGINS_S, Aim::Nearest(1.0), &mut |_| Some(stretch(&[])));
        assert_eq!(nothing, Ok(None));
    }

    #[test]
    fn the_memory_of_film_is_bounded_and_keeps_what_is_near() {
        let mut film = Film::default();
        let hundred: Vec<f64> = (0..100).map(f64::from).collect();
        for chunk in 0..50 {
            film.insert(chunk, stretch(&hundred), chunk);
        }
        assert!(film.snapshots() <= KEPT, "{}", film.snapshots());
        assert!((45..50).all(|chunk| film.get(chunk).is_some()) && film.get(10).is_none());
    }
}
