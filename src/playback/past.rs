//! Speed and lateral error of all vehicles around the place that is shown, for running plots.

use crate::snapshot::{FrameSnapshot, VehicleId};
use std::collections::BTreeMap;
use std::sync::Arc;

/// What running plots show of a vehicle at an instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Glimpse {
    /// Simulated time.
    pub time_s: f64,
    pub speed_mps: f64,
    pub lateral_error_m: f64,
}

/// Glimpses are at least this far apart.
const EVERY_S: f64 = 0.05;
/// Chunks further away from the wanted one are forgotten.
const KEPT_CHUNKS: usize = 2000;

/// One instant: in id order.
type Row = (f64, Vec<(VehicleId, f32, f32)>);

/// Glimpses by the numbers of the chunks that they are of.
#[derive(Debug, Default)]
pub(super) struct Past(BTreeMap<usize, Vec<Row>>);

impl Past {
    pub(super) fn has(&self, chunk: usize) -> bool {
        self.0.contains_key(&chunk)
    }

    pub(super) fn insert(&mut self, chunk: usize, snapshots: &[Arc<FrameSnapshot>], wanted: usize) {
        let mut rows: Vec<Row> = Vec::new();
        for snapshot in snapshots {
            if rows.last().is_none_or(|(time_s, _)| snapshot.time_s - time_s >= EVERY_S - 1e-6) {
                let glimpse =
                    |v: &crate::snapshot::VehicleState| (v.id, v.speed_mps as f32, v.lateral_error_m as f32);
                rows.push((snapshot.time_s, snapshot.vehicles.iter().map(glimpse).collect()));
            }
        }
        self.0.insert(chunk, rows);
        while self.0.len() > KEPT_CHUNKS {
            let farthest = self.0.keys().copied().max_by_key(|chunk| chunk.abs_diff(wanted));
            farthest.map(|chunk| self.0.remove(&chunk));
        }
    }

    /// What is known of a vehicle between two times, in order.
    pub(super) fn of(&self, vehicle: VehicleId, from_s: f64, to_s: f64) -> Vec<Glimpse> {
        let rows = self.0.values().flatten().filter(|(time_s, _)| (from_s..=to_s).contains(time_s));
        let glimpse = |(time_s, row): &Row| {
            let index = row.binary_search_by_key(&vehicle, |(id, ..)| *id).ok()?;
            let (_, speed_mps, lateral_error_m) = row[index];
            let (speed_mps, lateral_error_m) = (f64::from(speed_mps), f64::from(lateral_error_m));
            Some(Glimpse { time_s: *time_s, speed_mps, lateral_error_m })
        };
        rows.filter_map(glimpse).collect()
    }
}
