//! Ring buffers of speed and lateral error of the watched vehicles, for the running plots.

use city3d_protocol::snapshot::{FrameSnapshot, VehicleId};
use std::collections::{BTreeMap, VecDeque};

/// One sample of the running plots of a vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HistorySample {
    /// Simulated time.
    pub time_s: f64,
    /// Speed along the heading, negative in reverse, city frame.
    pub speed_mps: f64,
    /// Front-axle centre from the desired path, left-positive, city metres; 0 without a path.
    pub lateral_error_m: f64,
}

impl From<city3d_session::playback::PlotSample> for HistorySample {
    fn from(sample: city3d_session::playback::PlotSample) -> Self {
        let city3d_session::playback::PlotSample { time_s, speed_mps, lateral_error_m } = sample;
        Self { time_s, speed_mps, lateral_error_m }
    }
}

/// Time span of the ring buffers, simulated seconds.
pub const KEPT_S: f64 = 30.0;
/// Least time between two samples, seconds.
const EVERY_S: f64 = 0.05;

/// One ring buffer per watched vehicle.
#[derive(Clone, Debug, Default)]
pub struct History {
    samples: BTreeMap<VehicleId, VecDeque<HistorySample>>,
}

impl History {
    /// Samples the watched vehicles and drops the others. A time before the last sample clears the buffer.
    pub fn record_samples(&mut self, snapshot: &FrameSnapshot, watched: impl Iterator<Item = VehicleId>) {
        let mut samples = BTreeMap::new();
        for id in watched {
            let mut kept = self.samples.remove(&id).unwrap_or_default();
            if let Some(vehicle) = snapshot.vehicle(id) {
                let time_s = snapshot.time_s;
                if kept.back().is_some_and(|last: &HistorySample| last.time_s > time_s) {
                    kept.clear();
                }
                if kept.back().is_none_or(|last| time_s - last.time_s >= EVERY_S) {
                    let (speed_mps, lateral_error_m) = (vehicle.speed_mps, vehicle.lateral_error_m);
                    kept.push_back(HistorySample { time_s, speed_mps, lateral_error_m });
                }
                while kept.front().is_some_and(|first| first.time_s < time_s - KEPT_S) {
                    kept.pop_front();
                }
            }
            samples.insert(id, kept);
        }
        self.samples = samples;
    }

    /// Replaces the samples of a vehicle by recorded ones, in order of time.
    pub fn set(&mut self, vehicle: VehicleId, samples: impl Iterator<Item = HistorySample>) {
        self.samples.insert(vehicle, samples.collect());
    }

    /// Samples of a vehicle in order of time; none for a vehicle that is not watched.
    pub fn of(&self, id: VehicleId) -> impl Iterator<Item = &HistorySample> {
        self.samples.get(&id).into_iter().flatten()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use city3d_protocol::snapshot::VehicleState;

    fn at(time_s: f64) -> FrameSnapshot {
        let vehicle = VehicleState { id: VehicleId(1), speed_mps: time_s, ..VehicleState::default() };
        FrameSnapshot { time_s, vehicles: vec![vehicle], ..FrameSnapshot::default() }
    }

    #[test]
    fn the_last_seconds_are_kept_and_a_reset_forgets() {
        let mut history = History::default();
        let watched = || std::iter::once(VehicleId(1));
        for tick in 0..5000 {
            history.record_samples(&at(f64::from(tick) * 0.01), watched());
        }
        let times: Vec<f64> = history.of(VehicleId(1)).map(|sample| sample.time_s).collect();
        assert!(times.len() <= (KEPT_S / EVERY_S) as usize + 2, "{}", times.len());
        assert!((times[times.len() - 1] - times[0] - KEPT_S).abs() < 0.2);
        history.record_samples(&at(0.0), watched());
        assert_eq!(history.of(VehicleId(1)).count(), 1);
        history.record_samples(&at(1.0), std::iter::empty());
        assert_eq!(history.of(VehicleId(1)).count(), 0);
    }
}
