//! Measures of the traffic of a log up to a time: chunks are measured one by one in the background, from the start on, and
//! the measures at some of them are kept for jumps back.

use super::chunk_cache::{DecodedChunk, chunk_at};
use super::playhead::TIME_TOLERANCE_S;
use crate::{RunTraffic, TrafficRecorder};
use city3d_simulation::scenario::Experiment;
use std::sync::Arc;

/// Least time between two kept measures at first, simulated seconds.
const KEPT_EVERY_S: f64 = 10.0;
/// Most kept measures; of more, every second one is dropped.
const MOST_KEPT: usize = 48;

/// The traffic of a log as far as it has been measured.
#[derive(Debug)]
pub(super) struct LogTraffic {
    recorder: TrafficRecorder,
    /// The chunk that is measured next.
    next_chunk: usize,
    /// Measures at the beginnings of chunks, from that of the first one on.
    kept: Vec<(usize, TrafficRecorder)>,
    kept_every_s: f64,
}

impl LogTraffic {
    pub(super) fn new(experiment: &Arc<Experiment>) -> Self {
        let recorder = TrafficRecorder::new(experiment);
        Self { kept: vec![(0, recorder.clone())], recorder, next_chunk: 0, kept_every_s: KEPT_EVERY_S }
    }

    /// The chunk that the measures up to a time still need, of those that begin at these times; `None` where they are
    /// complete. A time before the measured one takes up kept measures.
    pub(super) fn missing(&mut self, begins_s: &[f64], to_s: f64) -> Option<usize> {
        let is_ahead = self.recorder.until_s().is_some_and(|until_s| until_s > to_s + TIME_TOLERANCE_S);
        if is_ahead {
            let wanted = chunk_at(begins_s, to_s);
            let place = self.kept.partition_point(|(chunk, _)| *chunk <= wanted).max(1) - 1;
            let (chunk, recorder) = &self.kept[place];
            (self.next_chunk, self.recorder) = (*chunk, recorder.clone());
        }
        let begin_s = begins_s.get(self.next_chunk)?;
        (*begin_s <= to_s + TIME_TOLERANCE_S).then_some(self.next_chunk)
    }

    /// Takes the snapshots of the missing chunk up to a time; returns whether there is nothing more to measure.
    pub(super) fn take(&mut self, chunk: &DecodedChunk, (to_s, begins_s): (f64, &[f64])) -> bool {
        let measured_s = self.recorder.until_s().unwrap_or(f64::NEG_INFINITY);
        for snapshot in chunk.snapshots.iter().filter(|snapshot| snapshot.time_s > measured_s) {
            if snapshot.time_s > to_s + TIME_TOLERANCE_S {
                return true;
            }
            self.recorder.observe(None, snapshot);
        }
        self.next_chunk += 1;
        self.keep(begins_s);
        begins_s.get(self.next_chunk).is_none_or(|begin_s| *begin_s > to_s + TIME_TOLERANCE_S)
    }

    fn keep(&mut self, begins_s: &[f64]) {
        let Some(begin_s) = begins_s.get(self.next_chunk) else { return };
        let last = self.kept.last().map_or(0, |(chunk, _)| *chunk);
        if self.next_chunk <= last || begin_s - begins_s[last] < self.kept_every_s {
            return;
        }
        self.kept.push((self.next_chunk, self.recorder.clone()));
        if self.kept.len() > MOST_KEPT {
            let mut place = 0;
            self.kept.retain(|_| {
                place += 1;
                place % 2 == 1
            });
            self.kept_every_s *= 2.0;
        }
    }

    /// What has been measured so far.
    pub(super) fn traffic(&self) -> RunTraffic {
        self.recorder.traffic()
    }
}
