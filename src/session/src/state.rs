//! State of a session as a window shows it.

use super::{ControlInsight, DecisionFeed, EventFeed, HistoryFeed, PacingClock, RunGoal, RunTraffic, Speed};
use city3d_protocol::snapshot::{CoordinationState, FrameSnapshot, VehicleId};
use city3d_simulation::runner::Summary;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

/// The execution phase of a run.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum RunPhase {
    /// At its initial conditions.
    #[default]
    Ready,
    /// Its clock runs.
    Running,
    /// Its clock is stopped.
    Paused,
    /// The scenario's duration is over. It can be started again to go on beyond it.
    Over,
    /// It has failed for this reason; a reset may help.
    Failed(String),
}

impl RunPhase {
    /// Phase in one word, without the reason of a failure.
    pub fn label(&self) -> &str {
        match self {
            Self::Ready => "ready",
            Self::Running => "running",
            Self::Paused => "paused",
            Self::Over => "over",
            Self::Failed(_) => "failed",
        }
    }
}

/// Connection of a served city, or to a city elsewhere, for people.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LinkStatus {
    /// Address and port on which the city is served, or at which it is watched.
    pub address: String,
    /// Whether the city is elsewhere.
    pub is_remote: bool,
    /// Why a city elsewhere cannot be seen now, as a sentence.
    pub trouble: Option<String>,
    /// Who leads the experiment; nobody if `None`.
    pub leader: Option<String>,
    /// Senders that are subscribed to poses.
    pub subscribers: usize,
    /// Received datagrams per second.
    pub received_per_s: f64,
    /// Datagrams lost on their way since the start.
    pub missing: u64,
    /// Datagrams that were dropped since the start.
    pub dropped: u64,
    /// The car that this window has brought into a city elsewhere.
    pub own_vehicle: Option<VehicleId>,
    /// Name of the scenario, as a city elsewhere tells it.
    pub scenario: Option<String>,
    /// Guests who have come by the city's own web page; `None` where nobody can.
    pub page_guests: Option<Vec<GuestStatus>>,
}

/// A guest of the city's own web page, for people.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GuestStatus {
    /// The page's number for it.
    pub number: u16,
    /// Its car, once the city has it.
    pub vehicle: Option<VehicleId>,
    /// Why the city has not taken the car, as a sentence.
    pub trouble: Option<String>,
}

/// How one end of the session does, for people.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct EndStatus {
    /// Name of the end.
    pub name: String,
    /// Moments that were delivered.
    pub delivered: u64,
    /// Moments that were dropped.
    pub dropped: u64,
    /// Why it does not work now; `None` while it does.
    pub failure: Option<String>,
}

/// The latest state of a session: two snapshots to interpolate between, phase and speed.
#[derive(Clone, Debug)]
pub struct RunState {
    /// The snapshot published before `now`, or `now` itself.
    pub before: Arc<FrameSnapshot>,
    /// Latest published snapshot.
    pub now: Arc<FrameSnapshot>,
    /// Phase at the time of publication.
    pub phase: RunPhase,
    /// Target speed.
    pub speed: Speed,
    /// The pacing clock, while the run is paced.
    pub clock: Option<PacingClock>,
    /// Measured real-time factor over the last half second; 0 while paused.
    pub real_time_factor: f64,
    /// Number of the run, from 1; a reset begins the next one.
    pub run: u32,
    /// Folder of the recording, once the run has begun.
    pub folder: Option<PathBuf>,
    /// Folder of the run that begins next, where it is recorded; it may not be there yet.
    pub next_folder: Option<PathBuf>,
    /// What the run has come to at the scenario's duration; `None` before, and where the session has no files.
    pub outcome: Option<Arc<Summary>>,
    /// The link of a city that is served or elsewhere.
    pub link: Option<Arc<LinkStatus>>,
    /// The ends of the session.
    pub ends: Arc<Vec<EndStatus>>,
    /// Plans of coordinated vehicles, where they are asked for and told; of a log and of the past, what was told then.
    pub coordination: Option<Arc<CoordinationState>>,
    /// Decisions of the control framework and delays of its commands, where they are asked for; of a log, what it tells.
    pub insight: Option<Arc<ControlInsight>>,
    /// Events of the present run so far.
    pub events: EventFeed,
    /// Past states of the present run.
    pub history: HistoryFeed,
    /// Past decisions of the present run.
    pub decisions: DecisionFeed,
    /// Measures of the present run, a tenth of a second of the wall clock old at most; of a log, those up to the shown
    /// time, or the last ones that were found. `None` before there are any.
    pub traffic: Option<Arc<RunTraffic>>,
    /// Where the run is to pause by itself.
    pub goal: Option<RunGoal>,
    /// The last order that was refused, counted, and why.
    pub refusal: Option<(u64, Arc<str>)>,
    /// The session has ended.
    pub has_ended: bool,
}

impl RunState {
    /// A run that stands at a snapshot.
    pub fn standing(snapshot: Arc<FrameSnapshot>, phase: RunPhase) -> Self {
        Self {
            before: Arc::clone(&snapshot),
            now: snapshot,
            phase,
            speed: Speed::default(),
            clock: None,
            real_time_factor: 0.0,
            run: 1,
            folder: None,
            next_folder: None,
            outcome: None,
            link: None,
            ends: Arc::default(),
            coordination: None,
            insight: None,
            events: EventFeed::default(),
            history: HistoryFeed::default(),
            decisions: DecisionFeed::default(),
            traffic: None,
            goal: None,
            refusal: None,
            has_ended: false,
        }
    }

    /// Interpolation weight between `before` (0) and `now` (1) at an instant; 1 while paused.
    pub fn interpolation_weight(&self, instant: Instant) -> f64 {
        let (from_s, to_s) = (self.before.time_s, self.now.time_s);
        match self.clock {
            Some(clock) if to_s > from_s => {
                ((clock.simulated_s(instant) - from_s) / (to_s - from_s)).clamp(0.0, 1.0)
            }
            _ => 1.0,
        }
    }
}

/// A mailbox of size one: the latest published state. The lock is held only to exchange a pointer.
#[derive(Debug)]
pub(crate) struct LatestState(Mutex<Arc<RunState>>);

impl LatestState {
    pub(crate) fn new(state: RunState) -> Self {
        Self(Mutex::new(Arc::new(state)))
    }

    pub(crate) fn put(&self, state: RunState) {
        let state = Arc::new(state);
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = state;
    }

    pub(crate) fn get(&self) -> Arc<RunState> {
        Arc::clone(&self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}
