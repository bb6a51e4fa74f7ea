//! What the running plots show: speed and lateral error of vehicles over the last seconds.

use crate::snapshot::{FrameSnapshot, VehicleId};
use std::collections::{BTreeMap, VecDeque};

/// One sample of a vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Simulated time.
    pub time_s: f64,
    pub speed_mps: f64,
    pub lateral_error_m: f64,
}

impl From<crate::playback::Glimpse> for Sample {
    fn from(glimpse: crate::playback::Glimpse) -> Self {
        let crate::playback::Glimpse { time_s, speed_mps, lateral_error_m } = glimpse;
        Self { time_s, speed_mps, lateral_error_m }
    }
}

/// Simulated seconds that are kept.
pub const KEPT_S: f64 = 30.0;
/// Samples are at least this far apart.
const EVERY_S: f64 = 0.05;

/// Samples of the vehicles that are watched.
#[derive(Clone, Debug, Default)]
pub struct History {
    samples: BTreeMap<VehicleId, VecDeque<Sample>>,
}

impl History {
    /// Takes samples of some vehicles, and forgets the others. A time before the last sample begins anew.
    pub fn note(&mut self, snapshot: &FrameSnapshot, watched: impl Iterator<Item = VehicleId>) {
        let mut samples = BTreeMap::new();
        for id in watched {
            let mut kept = self.samples.remove(&id).unwrap_or_default();
            if let Some(vehicle) = snapshot.vehicle(id) {
                let time_s = snapshot.time_s;
                if kept.back().is_some_and(|last: &Sample| last.time_s > time_s) {
                    kept.clear();
                }
                if kept.back().is_none_or(|last| time_s - last.time_s >= EVERY_S) {
                    let (speed_mps, lateral_error_m) = (vehicle.speed_mps, vehicle.lateral_error_m);
                    kept.push_back(Sample { time_s, speed_mps, lateral_error_m });
                }
                while kept.front().is_some_and(|first| first.time_s < time_s - KEPT_S) {
                    kept.pop_front();
                }
            }
            samples.insert(id, kept);
        }
        self.samples = samples;
    }

    /// Takes the samples of a vehicle as they are recorded, in order of time, instead of those that it has.
    pub fn set(&mut self, vehicle: VehicleId, samples: impl Iterator<Item = Sample>) {
        self.samples.insert(vehicle, samples.collect());
    }

    pub fn of(&self, id: VehicleId) -> impl Iterator<Item = &Sample> {
        self.samples.get(&id).into_iter().flatten()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::snapshot::VehicleState;

    fn at(time_s: f64) -> FrameSnapshot {
        let vehicle = VehicleState { id: VehicleId(1), speed_mps: time_s, ..VehicleState::default() };
        FrameSnapshot { time_s, vehicles: vec![vehicle], ..FrameSnapshot::default() }
    }

    #[test]
    fn the_last_seconds_are_kept_and_a_reset_forgets() {
        let mut history = History::default();
        let watched = || std::iter::once(VehicleId(1));
        for tick in 0..5000 {
            history.note(&at(f64::from(tick) * 0.01), watched());
        }
        let times: Vec<f64> = history.of(VehicleId(1)).map(|sample| sample.time_s).collect();
        assert!(times.len() <= (KEPT_S / EVERY_S) as usize + 2, "{}", times.len());
        assert!((times[times.len() - 1] - times[0] - KEPT_S).abs() < 0.2);
        history.note(&at(0.0), watched());
        assert_eq!(history.of(VehicleId(1)).count(), 1);
        history.note(&at(1.0), std::iter::empty());
        assert_eq!(history.of(VehicleId(1)).count(), 0);
    }
}
