//! Measures of the traffic of a run for a window, from each of its snapshots: they are the same at every speed, and the
//! same of a run and of its log.

use city3d_control::Mainframe;
use city3d_protocol::snapshot::{Event, FrameSnapshot, VehicleId};
use city3d_roadmap::LaneId;
use city3d_simulation::measures::TrafficMeasures;
use city3d_simulation::runner::Observer;
use city3d_simulation::scenario::Experiment;
use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

/// Time span of the space-time diagram, simulated seconds.
pub const DIAGRAM_S: f64 = 60.0;
/// Least time between two samples of the diagram.
const EVERY_S: f64 = 0.1;
/// After a longer gap between two snapshots, as of a city elsewhere that was not seen, the measures begin anew.
const GAP_S: f64 = 5.0;
/// A run that is first seen later than this was on its way before, simulated seconds.
const AT_START_S: f64 = 0.1;
/// Rounding error of times.
const ROUNDING_S: f64 = 1e-6;

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

/// The traffic of a run as it was measured up to an instant.
#[derive(Clone, Debug)]
pub struct RunTraffic {
    measures: TrafficMeasures,
    since_s: Option<f64>,
    places: BTreeMap<VehicleId, VecDeque<LanePlace>>,
}

impl RunTraffic {
    /// Nothing has been seen of this experiment yet.
    pub fn new(experiment: &Experiment) -> Self {
        Self { measures: TrafficMeasures::new(experiment), since_s: None, places: BTreeMap::new() }
    }

    /// What has been measured.
    pub fn measures(&self) -> &TrafficMeasures {
        &self.measures
    }

    /// Simulated time at which the measures begin; `None` where nothing has been seen.
    pub fn since_s(&self) -> Option<f64> {
        self.since_s
    }

    /// Simulated time up to which it was measured.
    pub fn until_s(&self) -> f64 {
        self.measures.now_s()
    }

    /// The places of every vehicle over the last [`DIAGRAM_S`], in order of time.
    pub fn places(&self) -> impl Iterator<Item = (VehicleId, &VecDeque<LanePlace>)> {
        self.places.iter().map(|(id, places)| (*id, places))
    }
}

/// Measures a run, snapshot by snapshot.
#[derive(Clone, Debug)]
pub struct TrafficRecorder {
    experiment: Arc<Experiment>,
    observer: Observer,
    /// What was seen before the first step: summaries measure from that step on, and so does this.
    before_start: Option<Box<Observer>>,
    since_s: Option<f64>,
    last_s: f64,
    places: BTreeMap<VehicleId, VecDeque<LanePlace>>,
    sampled_s: f64,
}

impl TrafficRecorder {
    /// Nothing has been seen of this experiment yet.
    pub fn new(experiment: &Arc<Experiment>) -> Self {
        Self {
            experiment: Arc::clone(experiment),
            observer: Observer::new(experiment),
            before_start: None,
            since_s: None,
            last_s: 0.0,
            places: BTreeMap::new(),
            sampled_s: f64::NEG_INFINITY,
        }
    }

    /// Simulated time of the last snapshot; `None` before the first one.
    pub fn until_s(&self) -> Option<f64> {
        self.since_s.map(|_| self.last_s)
    }

    /// Takes the next snapshot of a run, and returns its merges, which only routes show. A time before the last one, or far
    /// behind it, begins anew. Without a control framework, routes stay those of the scenario.
    pub fn observe(&mut self, mainframe: Option<&Mainframe>, snapshot: &FrameSnapshot) -> Vec<Event> {
        let now_s = snapshot.time_s;
        match self.until_s() {
            Some(last_s) if (now_s - last_s).abs() < ROUNDING_S => return Vec::new(),
            Some(last_s) if !(0.0..GAP_S).contains(&(now_s - last_s)) => {
                *self = Self::new(&Arc::clone(&self.experiment));
            }
            _ => {}
        }
        let since_s = *self.since_s.get_or_insert(now_s);
        self.last_s = now_s;
        let mut merges = Vec::new();
        if snapshot.tick == 0 {
            let mut observer = self.observer.clone();
            observer.observe(mainframe, snapshot, &mut merges);
            self.before_start = Some(Box::new(observer));
            return Vec::new();
        }
        self.before_start = None;
        self.observer.observe(mainframe, snapshot, &mut merges);
        if now_s - self.sampled_s >= EVERY_S - ROUNDING_S {
            self.sampled_s = now_s;
            self.sample(now_s);
        }
        // Of a run that was on its way before, it is not known which merges its vehicles have behind them.
        if since_s > AT_START_S { Vec::new() } else { merges }
    }

    fn sample(&mut self, now_s: f64) {
        for tracked in self.observer.traffic().vehicles() {
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

    /// What has been measured so far.
    pub fn traffic(&self) -> RunTraffic {
        RunTraffic {
            measures: self.before_start.as_deref().unwrap_or(&self.observer).traffic().clone(),
            since_s: self.since_s,
            places: self.places.clone(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use city3d_simulation::measures::TrafficReport;
    use city3d_simulation::runner::{Run, Summary};
    use city3d_simulation::scenario::{Library, Overrides, read_experiment};

    #[test]
    fn a_run_has_the_measures_of_its_summary() {
        let (text, library) = Library::scenario("roundabout").unwrap();
        let overrides = Overrides { duration_s: Some(12.0), ..Overrides::default() };
        let experiment = Arc::new(read_experiment("roundabout", &text, &library, overrides).unwrap());
        let mut run = Run::new(Arc::clone(&experiment)).unwrap();
        let (mut recorder, mut observer) = (TrafficRecorder::new(&experiment), Observer::new(&experiment));
        recorder.observe(Some(run.mainframe()), run.snapshot());
        assert_eq!(recorder.traffic().measures().vehicles().len(), 6, "they stand at their starts");
        let mut events = Vec::new();
        while run.snapshot().tick < experiment.ticks() {
            run.step();
            recorder.observe(Some(run.mainframe()), run.snapshot());
            // As the files of the run do.
            observer.observe(Some(run.mainframe()), run.snapshot(), &mut events);
        }
        let summary = Summary::new(&experiment, &observer, run.snapshot(), events, 1.0);
        let shown = TrafficReport::of(recorder.traffic().measures());
        assert!(summary.traffic.trips.mean_delay_s.is_some_and(|delay_s| delay_s > 0.0));
        assert_eq!(format!("{shown:?}"), format!("{:?}", summary.traffic));
    }

    #[test]
    fn a_gap_begins_anew_and_the_same_instant_counts_once() {
        let (text, library) = Library::scenario("straight").unwrap();
        let experiment = read_experiment("straight", &text, &library, Overrides::default()).unwrap();
        let experiment = Arc::new(experiment);
        let mut run = Run::new(Arc::clone(&experiment)).unwrap();
        let mut recorder = TrafficRecorder::new(&experiment);
        assert_eq!(recorder.traffic().since_s(), None);
        for _ in 0..300 {
            run.step();
            recorder.observe(None, run.snapshot());
            recorder.observe(None, run.snapshot());
        }
        let traffic = recorder.traffic();
        assert_eq!((traffic.since_s(), traffic.until_s()), (Some(0.01), 3.0));
        let (id, places) = traffic.places().next().unwrap();
        assert_eq!(id, experiment.vehicles[0].id);
        assert!((29..=31).contains(&places.len()), "{}", places.len());
        assert!(places.iter().zip(places.iter().skip(1)).all(|(a, b)| a.time_s < b.time_s));
        assert!(traffic.measures().effort().fuel_ml > 0.0);
        for _ in 0..600 {
            run.step();
        }
        recorder.observe(None, run.snapshot());
        let traffic = recorder.traffic();
        assert_eq!((traffic.since_s(), traffic.measures().effort().fuel_ml), (Some(9.0), 0.0));
    }
}
