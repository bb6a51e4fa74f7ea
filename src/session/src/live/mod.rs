//! A run paced by the wall clock, on its own thread. Commands go in through a bounded channel; the latest state comes
//! out of a mailbox of size one. Neither side waits for the other.

mod engine;
mod pace;
mod recording;

pub use pace::{PacingClock, Speed};

use city3d_protocol::snapshot::{FrameSnapshot, SimCommand};
use city3d_simulation::runner::Run;
use city3d_simulation::scenario::Experiment;
use engine::Engine;
use recording::Recording;
use std::fmt;
use std::path::PathBuf;
use std::sync::mpsc::{SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Instant;

/// Why a run cannot begin or go on.
#[derive(Debug, thiserror::Error)]
pub enum LiveError {
    /// The control framework rejects a vehicle.
    #[error(transparent)]
    Setup(#[from] city3d_control::SetupError),
    /// The operating system refuses the simulation thread.
    #[error("the simulation's thread cannot be started: {0}")]
    Thread(std::io::Error),
    /// The simulation thread has panicked.
    #[error("the simulation's thread ended early; the log holds what was written until then")]
    Ended,
    /// The log or the table cannot be written.
    #[error(transparent)]
    Record(#[from] city3d_logbook::record::RecordError),
    /// The folder or the summary of a run cannot be written.
    #[error("{path}: cannot be written: {source}", path = path.display())]
    File {
        /// The folder or the file that was to be written.
        path: PathBuf,
        /// Reason of the operating system, or of the encoding as JSON.
        source: std::io::Error,
    },
}

/// A command to a run.
#[derive(Clone, Debug, PartialEq)]
pub enum RunCommand {
    /// Starts the clock, or lets it go on; a failed run needs a reset first.
    Start,
    /// Stops the clock of a running run.
    Pause,
    /// One tick, then pause.
    Step,
    /// Back to the initial conditions, paused; the present log is finished first.
    Reset,
    /// Sets the target speed.
    Speed(Speed),
    /// A vehicle command of a person, applied in the next tick. The last command for a vehicle before that tick wins.
    Vehicle(SimCommand),
    /// Ends the thread; [`LiveRun::stop`] sends it.
    Stop,
}

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

/// The latest published state of a run: two snapshots to interpolate between, phase and speed.
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
}

impl RunState {
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
struct LatestState(Mutex<Arc<RunState>>);

impl LatestState {
    fn put(&self, run_state: RunState) {
        let run_state = Arc::new(run_state);
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = run_state;
    }

    fn get(&self) -> Arc<RunState> {
        Arc::clone(&self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

/// Recording and notification of a run.
#[derive(Default)]
pub struct LiveOptions {
    /// Folder in which each run gets one of its own: `run-1`, after a reset `run-2`. Nothing is
    /// written without it, and nothing before the first tick.
    pub record: Option<PathBuf>,
    /// Runs that the folder holds already; numbering continues after them.
    pub runs_before: u32,
    /// Called on the run's thread after each published state; it must not block.
    pub on_update: Option<Box<dyn Fn() + Send>>,
}

impl fmt::Debug for LiveOptions {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Options").field("record", &self.record).finish_non_exhaustive()
    }
}

/// Handle of a run on its own thread. Dropping it ends the run and finishes the log.
#[derive(Debug)]
pub struct LiveRun {
    sender: SyncSender<RunCommand>,
    latest_state: Arc<LatestState>,
    thread: Option<JoinHandle<Result<Vec<PathBuf>, LiveError>>>,
}

/// Capacity of the command channel: a second of pedal commands and some clicks.
const COMMAND_QUEUE: usize = 256;

impl LiveRun {
    /// Starts the thread with the run at its initial conditions, waiting for [`RunCommand::Start`].
    ///
    /// # Errors
    /// [`LiveError::Setup`] for a vehicle that the control framework cannot take, [`LiveError::Thread`].
    pub fn new(experiment: Arc<Experiment>, options: LiveOptions) -> Result<Self, LiveError> {
        let run = Run::new(experiment)?;
        let first = Arc::new(run.snapshot().clone());
        let run_state = RunState {
            before: Arc::clone(&first),
            now: first,
            phase: RunPhase::Ready,
            speed: Speed::default(),
            clock: None,
            real_time_factor: 0.0,
            run: options.runs_before + 1,
            folder: None,
        };
        let latest_state = Arc::new(LatestState(Mutex::new(Arc::new(run_state))));
        let (sender, commands) = sync_channel(COMMAND_QUEUE);
        let recording = Recording::new(options.record, options.runs_before + 1);
        let engine = Engine::new(run, recording, (Arc::clone(&latest_state), options.on_update));
        let thread = std::thread::Builder::new()
            .name("simulation".to_owned())
            .spawn(move || engine.run_loop(&commands))
            .map_err(LiveError::Thread)?;
        Ok(Self { sender, latest_state, thread: Some(thread) })
    }

    /// Sends a command without blocking. `false` where the channel is full, and the command is refused, or the
    /// thread has ended.
    pub fn send(&self, command: RunCommand) -> bool {
        match self.sender.try_send(command) {
            Ok(()) => true,
            Err(TrySendError::Full(_) | TrySendError::Disconnected(_)) => false,
        }
    }

    /// The latest published state.
    pub fn run_state(&self) -> Arc<RunState> {
        self.latest_state.get()
    }

    /// Ends the run and waits until its files are complete; returns the folders of the recorded runs, in order.
    ///
    /// # Errors
    /// What went wrong with them.
    pub fn stop(mut self) -> Result<Vec<PathBuf>, LiveError> {
        self.join()
    }

    fn join(&mut self) -> Result<Vec<PathBuf>, LiveError> {
        let Some(thread) = self.thread.take() else { return Ok(Vec::new()) };
        // The thread may have ended already.
        let _ = self.sender.send(RunCommand::Stop);
        thread.join().unwrap_or(Err(LiveError::Ended))
    }
}

impl Drop for LiveRun {
    fn drop(&mut self) {
        if let Err(error) = self.join() {
            tracing::warn!("{error}");
        }
    }
}
