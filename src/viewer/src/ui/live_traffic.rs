//! Live measures of the shown run, and the samples of its time-space diagram.

use super::tracks::Tracks;
use city3d_protocol::snapshot::{FrameSnapshot, VehicleId};
use city3d_roadmap::LaneId;
use city3d_simulation::measures::{LaneFinder, TrafficMeasures};
use city3d_simulation::scenario::Experiment;
use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

/// Time span of the time-space diagram, simulated seconds.
pub const DIAGRAM_S: f64 = 60.0;
/// Least time between two samples of the diagram.
const EVERY_S: f64 = 0.1;
/// After a longer jump of the shown time, as by a seek in a log, the measures begin anew.
const JUMP_S: f64 = 5.0;

/// A vehicle on its lane at an instant, laboratory metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LanePlace {
    /// Simulated time.
    pub time_s: f64,
    /// The lane under its front bumper.
    pub lane: LaneId,
    /// The front bumper along that lane.
    pub at_m: f64,
}

/// Measures of the shown run from its snapshots, since it was first seen. Everything that a window shows has snapshots:
/// cities in this process and elsewhere, and logs.
#[derive(Clone, Debug)]
pub struct LiveTraffic {
    experiment: Arc<Experiment>,
    measures: TrafficMeasures,
    since_s: f64,
    last_s: Option<f64>,
    places: BTreeMap<VehicleId, VecDeque<LanePlace>>,
    sampled_s: f64,
    tracks: Tracks,
    lanes: Arc<LaneFinder>,
}

impl LiveTraffic {
    /// Nothing has been seen of this experiment yet.
    pub fn new(experiment: &Arc<Experiment>) -> Self {
        Self::with_lanes(experiment, Arc::new(LaneFinder::new(&experiment.city_map)))
    }

    fn with_lanes(experiment: &Arc<Experiment>, lanes: Arc<LaneFinder>) -> Self {
        Self {
            experiment: Arc::clone(experiment),
            measures: TrafficMeasures::new(experiment),
            since_s: 0.0,
            last_s: None,
            places: BTreeMap::new(),
            sampled_s: f64::NEG_INFINITY,
            tracks: Tracks::default(),
            lanes,
        }
    }

    /// Takes the snapshot that is shown now. A time before the last one, or far behind it, begins anew.
    pub fn observe(&mut self, snapshot: &FrameSnapshot) {
        let now_s = snapshot.time_s;
        match self.last_s {
            Some(last_s) if now_s == last_s => return,
            Some(last_s) if (0.0..JUMP_S).contains(&(now_s - last_s)) => {}
            _ => {
                *self =
                    Self { since_s: now_s, ..Self::with_lanes(&self.experiment, Arc::clone(&self.lanes)) };
            }
        }
        self.last_s = Some(now_s);
        self.measures.observe(None, snapshot);
        self.tracks.observe(snapshot);
        if now_s - self.sampled_s >= EVERY_S - 1e-6 {
            self.sampled_s = now_s;
            self.sample(now_s);
        }
    }

    fn sample(&mut self, now_s: f64) {
        for tracked in self.measures.vehicles() {
            let place = tracked.route().zip(tracked.station).filter(|(_, station)| station.time_s == now_s);
            if let Some((route, station)) = place {
                let index = route.index_at(station.front_s);
                let at_m = station.front_s - route.lane_start(index);
                let lane = route.lanes()[index];
                self.places.entry(tracked.id).or_default().push_back(LanePlace { time_s: now_s, lane, at_m });
            }
        }
        for places in self.places.values_mut() {
            while places.front().is_some_and(|first| first.time_s < now_s - DIAGRAM_S) {
                places.pop_front();
            }
        }
        self.places.retain(|_, places| !places.is_empty());
    }

    /// What has been measured.
    pub fn measures(&self) -> &TrafficMeasures {
        &self.measures
    }

    /// Driven paths and waiting times.
    pub fn tracks(&self) -> &Tracks {
        &self.tracks
    }

    /// Map matching on the lanes of the city.
    pub fn lanes(&self) -> &LaneFinder {
        &self.lanes
    }

    /// Simulated time at which the measures begin.
    pub fn since_s(&self) -> f64 {
        self.since_s
    }

    /// The last places of every vehicle in order of time, by vehicle.
    pub fn places(&self) -> impl Iterator<Item = (VehicleId, &VecDeque<LanePlace>)> {
        self.places.iter().map(|(id, places)| (*id, places))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use city3d_simulation::runner::Run;
    use city3d_simulation::scenario::{Library, Overrides, read_experiment};

    #[test]
    fn a_seek_begins_anew_and_a_pause_does_not() {
        let (text, library) = Library::scenario("straight").unwrap();
        let experiment = read_experiment("straight", &text, &library, Overrides::default()).unwrap();
        let experiment = Arc::new(experiment);
        let mut run = Run::new(Arc::clone(&experiment)).unwrap();
        let mut traffic = LiveTraffic::new(&experiment);
        for _ in 0..300 {
            run.step();
            traffic.observe(run.snapshot());
            traffic.observe(run.snapshot());
        }
        assert_eq!(traffic.since_s(), 0.01);
        let (id, places) = traffic.places().next().unwrap();
        assert_eq!(id, experiment.vehicles[0].id);
        assert!((29..=31).contains(&places.len()), "{}", places.len());
        assert!(places.iter().zip(places.iter().skip(1)).all(|(a, b)| a.time_s < b.time_s));
        assert!(traffic.measures().effort().fuel_ml > 0.0);
        for _ in 0..600 {
            run.step();
        }
        traffic.observe(run.snapshot());
        assert_eq!((traffic.since_s(), traffic.measures().effort().fuel_ml), (9.0, 0.0));
    }
}
