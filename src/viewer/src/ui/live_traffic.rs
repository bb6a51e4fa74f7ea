//! The traffic of the shown run as the panels see it: measures by the session or from the log, driven paths from what is
//! shown.

use super::tracks::Tracks;
use city3d_protocol::snapshot::FrameSnapshot;
use city3d_session::{RunHistory, RunTraffic};
use city3d_simulation::measures::{LaneFinder, TrafficMeasures};
use city3d_simulation::scenario::Experiment;
use std::borrow::Cow;
use std::sync::Arc;

/// What vehicles have done in so long before the shown time is known after a jump to it, simulated seconds.
pub const TRACKS_KNOWN_S: f64 = 60.0;

/// Between the shown state and the kept one before it, at most, simulated seconds.
const BEFORE_S: f64 = 0.3;

/// What is known of the traffic of the shown run.
#[derive(Clone, Debug)]
pub struct LiveTraffic {
    measured: Arc<RunTraffic>,
    /// What is known before anything was measured.
    nothing: Arc<RunTraffic>,
    last_s: Option<f64>,
    /// The time that was jumped to, until it is known what was before it.
    jumped_to_s: Option<f64>,
    tracks: Tracks,
    lanes: Arc<LaneFinder>,
}

impl LiveTraffic {
    /// Nothing has been seen of this experiment yet.
    pub fn new(experiment: &Arc<Experiment>) -> Self {
        let nothing = Arc::new(RunTraffic::new(experiment));
        Self {
            measured: Arc::clone(&nothing),
            nothing,
            last_s: None,
            jumped_to_s: None,
            tracks: Tracks::default(),
            lanes: Arc::new(LaneFinder::new(&experiment.city_map)),
        }
    }

    /// Takes the snapshot that is shown now for driven paths and waiting times, with what the run has done since the last one, or
    /// before a time that was jumped to.
    pub fn observe(&mut self, snapshot: &FrameSnapshot, history: &RunHistory) {
        let now_s = snapshot.time_s;
        let is_told = |to_s: f64| !history.between(to_s - TRACKS_KNOWN_S, to_s - BEFORE_S).is_empty();
        let is_told_since = self.jumped_to_s.is_some_and(is_told);
        let since_s = match self.last_s {
            _ if is_told_since => now_s - TRACKS_KNOWN_S,
            Some(last_s) if now_s == last_s => return,
            Some(last_s) if (0.0..TRACKS_KNOWN_S).contains(&(now_s - last_s)) => last_s,
            // A log is read in the background.
            _ => {
                self.jumped_to_s = Some(now_s);
                now_s - TRACKS_KNOWN_S
            }
        };
        if since_s <= now_s - TRACKS_KNOWN_S {
            self.tracks = Tracks::default();
        }
        self.jumped_to_s = self.jumped_to_s.filter(|to_s| !is_told(*to_s));
        self.last_s = Some(now_s);
        let meanwhile = history.between(since_s, now_s).iter();
        for state in meanwhile.filter(|state| (since_s..now_s).contains(&state.time_s())) {
            self.tracks.observe(state.time_s(), state.vehicles().map(|(vehicle, _)| Cow::Owned(vehicle)));
        }
        self.tracks.observe(now_s, snapshot.vehicles.iter().map(Cow::Borrowed));
    }

    /// Takes the measures of the run; `None` before there are any.
    pub fn take(&mut self, measured: Option<&Arc<RunTraffic>>) {
        self.measured = Arc::clone(measured.unwrap_or(&self.nothing));
    }

    /// What has been measured of the run.
    pub fn measured(&self) -> &RunTraffic {
        &self.measured
    }

    /// The measures alone.
    pub fn measures(&self) -> &TrafficMeasures {
        self.measured.measures()
    }

    /// Driven paths and waiting times.
    pub fn tracks(&self) -> &Tracks {
        &self.tracks
    }

    /// Map matching on the lanes of the city.
    pub fn lanes(&self) -> &LaneFinder {
        &self.lanes
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use city3d_geometry::trig;
    use city3d_protocol::snapshot::{VehicleId, VehicleInfo, VehicleSpec, VehicleState};
    use city3d_simulation::scenario::{Library, Overrides, read_experiment};
    use glam::DVec3;

    fn at(time_s: f64) -> FrameSnapshot {
        // A quarter of a circle in a minute.
        let angle = time_s / 60.0 * std::f64::consts::FRAC_PI_2;
        let (sin, cos) = trig::sin_cos(angle);
        let position = DVec3::new(50.0 * cos, 50.0 * sin, 0.0);
        let vehicle = VehicleState { id: VehicleId(1), speed_mps: 1.3, position, ..VehicleState::default() };
        let tick = (time_s * 100.0).round() as u64;
        let info = VehicleInfo::of(VehicleId(1), "car", Default::default(), &VehicleSpec::default());
        let roster = Arc::new(vec![info]);
        FrameSnapshot { tick, time_s, vehicles: vec![vehicle], roster, ..FrameSnapshot::default() }
    }

    #[test]
    fn after_a_jump_the_driven_path_is_the_one_that_was_driven() {
        let experiment = experiment_of("straight");
        let mut traffic = LiveTraffic::new(&experiment);
        let mut history = RunHistory::default();
        let path = |traffic: &LiveTraffic| -> Vec<_> { traffic.tracks().path(VehicleId(1)).collect() };
        let is_driven = |traffic: &LiveTraffic| {
            let path = path(traffic);
            let is_fine = path.windows(2).all(|pair| pair[0].position.distance(pair[1].position) < 1.5);
            is_fine
                && path.len() > 30
                && path.iter().all(|point| (point.position.length() - 50.0).abs() < 1e-3)
        };
        (0..=600).for_each(|k| history.push(&at(f64::from(k) / 10.0)));
        for shown_s in [58.0, 59.0, 30.0, 34.0, 55.0, 25.0] {
            traffic.observe(&at(shown_s), &history);
            let path = path(&traffic);
            assert!(is_driven(&traffic), "{shown_s}: {path:?}");
            let last_s = path.last().unwrap().time_s;
            assert!((0.0..0.6).contains(&(shown_s - last_s)), "{shown_s}: {last_s}");
        }
        // What is before it may be read later, as of a log.
        let mut later = LiveTraffic::new(&experiment);
        later.observe(&at(40.0), &RunHistory::default());
        assert!(path(&later).len() < 2);
        later.observe(&at(40.0), &history);
        assert!(is_driven(&later), "{:?}", path(&later));
    }

    fn experiment_of(name: &str) -> Arc<Experiment> {
        let (text, library) = Library::scenario(name).unwrap();
        Arc::new(read_experiment(name, &text, &library, Overrides::default()).unwrap())
    }
}
