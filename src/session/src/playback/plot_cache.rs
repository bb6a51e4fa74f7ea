//! A bounded cache of speed and lateral error of all vehicles around the playhead, for the running plots.

use city3d_protocol::snapshot::{FrameSnapshot, VehicleId};
use std::collections::BTreeMap;
use std::sync::Arc;

/// One sample of the running plots of a vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlotSample {
    /// Simulated time.
    pub time_s: f64,
    /// Along the heading, city m/s; negative in reverse.
    pub speed_mps: f64,
    /// Front-axle centre from the desired path, city metres, left-positive; 0 without a path.
    pub lateral_error_m: f64,
}

/// Least time between two samples, seconds.
const SAMPLE_INTERVAL_S: f64 = 0.05;
/// Capacity in chunks; the chunk farthest from the wanted one is evicted.
const CAPACITY_CHUNKS: usize = 2000;

/// Time, and `(id, speed, lateral error)` of each vehicle in id order.
type PlotRow = (f64, Vec<(VehicleId, f32, f32)>);

/// Samples by the numbers of their chunks.
#[derive(Debug, Default)]
pub(super) struct PlotCache(BTreeMap<usize, Vec<PlotRow>>);

impl PlotCache {
    pub(super) fn has(&self, chunk: usize) -> bool {
        self.0.contains_key(&chunk)
    }

    pub(super) fn insert(&mut self, chunk: usize, snapshots: &[Arc<FrameSnapshot>], wanted: usize) {
        let mut rows: Vec<PlotRow> = Vec::new();
        for snapshot in snapshots {
            if rows.last().is_none_or(|(time_s, _)| snapshot.time_s - time_s >= SAMPLE_INTERVAL_S - 1e-6) {
                let sample = |v: &city3d_protocol::snapshot::VehicleState| {
                    (v.id, v.speed_mps as f32, v.lateral_error_m as f32)
                };
                rows.push((snapshot.time_s, snapshot.vehicles.iter().map(sample).collect()));
            }
        }
        self.0.insert(chunk, rows);
        while self.0.len() > CAPACITY_CHUNKS {
            let farthest = self.0.keys().copied().max_by_key(|chunk| chunk.abs_diff(wanted));
            farthest.map(|chunk| self.0.remove(&chunk));
        }
    }

    /// The samples of a vehicle between two times, in order.
    pub(super) fn of(&self, vehicle: VehicleId, from_s: f64, to_s: f64) -> Vec<PlotSample> {
        let rows = self.0.values().flatten().filter(|(time_s, _)| (from_s..=to_s).contains(time_s));
        let sample = |(time_s, row): &PlotRow| {
            let index = row.binary_search_by_key(&vehicle, |(id, ..)| *id).ok()?;
            let (_, speed_mps, lateral_error_m) = row[index];
            let (speed_mps, lateral_error_m) = (f64::from(speed_mps), f64::from(lateral_error_m));
            Some(PlotSample { time_s: *time_s, speed_mps, lateral_error_m })
        };
        rows.filter_map(sample).collect()
    }
}
