//! The traffic of the shown run as the panels see it: measures by the session or from the log, driven paths from what is
//! shown.

use super::tracks::Tracks;
use city3d_protocol::snapshot::FrameSnapshot;
use city3d_session::RunTraffic;
use city3d_simulation::measures::{LaneFinder, TrafficMeasures};
use city3d_simulation::scenario::Experiment;
use std::sync::Arc;

/// After a longer jump of the shown time, as by a seek in a log, driven paths begin anew.
const JUMP_S: f64 = 5.0;

/// What is known of the traffic of the shown run.
#[derive(Clone, Debug)]
pub struct LiveTraffic {
    measured: Arc<RunTraffic>,
    /// What is known before anything was measured.
    nothing: Arc<RunTraffic>,
    last_s: Option<f64>,
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
            tracks: Tracks::default(),
            lanes: Arc::new(LaneFinder::new(&experiment.city_map)),
        }
    }

    /// Takes the snapshot that is shown now for driven paths. A time before the last one, or far behind it, begins anew.
    pub fn observe(&mut self, snapshot: &FrameSnapshot) {
        let now_s = snapshot.time_s;
        match self.last_s {
            Some(last_s) if now_s == last_s => return,
            Some(last_s) if (0.0..JUMP_S).contains(&(now_s - last_s)) => {}
            _ => self.tracks = Tracks::default(),
        }
        self.last_s = Some(now_s);
        self.tracks.observe(snapshot);
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
