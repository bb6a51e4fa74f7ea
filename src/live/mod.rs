//! A run at the pace of a clock, on a thread of its own. Orders go in through a bounded channel, the
//! latest moment comes out of a slot: neither the run nor who watches it ever waits for the other.

mod engine;
mod pace;
mod recording;

pub use pace::{Clock, Speed};

use crate::runner::Run;
use crate::scenario::Experiment;
use crate::snapshot::{FrameSnapshot, SimCommand};
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
    #[error(transparent)]
    Setup(#[from] crate::mainframe::SetupError),
    #[error("the simulation's thread cannot be started: {0}")]
    Thread(std::io::Error),
    #[error("the simulation's thread ended early; the log holds what was written until then")]
    Ended,
    #[error(transparent)]
    Record(#[from] crate::record::RecordError),
    #[error("{path}: cannot be written: {source}", path = path.display())]
    File { path: PathBuf, source: std::io::Error },
}

/// What a run is told to do.
#[derive(Clone, Debug, PartialEq)]
pub enum Order {
    Start,
    Pause,
    /// One tick, and a pause behind it.
    Step,
    /// Back to the initial conditions, paused; what was recorded so far is finished first.
    Reset,
    Speed(Speed),
    /// A command of a person, for the next tick. Of several for one vehicle before that tick the last counts.
    Command(SimCommand),
    /// To end the thread; [`Live::stop`] sends it.
    Stop,
}

/// Where a run stands.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Phase {
    /// At its initial conditions.
    #[default]
    Ready,
    Running,
    Paused,
    /// The scenario's duration is over. It can be started again to go on beyond it.
    Over,
    /// It cannot go on, for this reason; a reset may help.
    Failed(String),
}

impl Phase {
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

/// What is known of a run at the latest tick that was published.
#[derive(Clone, Debug)]
pub struct Moment {
    /// The one that was published before `now`; the same where there is none.
    pub before: Arc<FrameSnapshot>,
    pub now: Arc<FrameSnapshot>,
    pub phase: Phase,
    pub speed: Speed,
    /// Simulated time by the clock of the machine while the run keeps pace with it.
    pub clock: Option<Clock>,
    /// Simulated seconds in a second, over the last half second; 0 while it stands.
    pub real_time_factor: f64,
    /// Counts the runs since the beginning, the first is 1.
    pub run: u32,
    /// Where this run is recorded, once it has begun.
    pub folder: Option<PathBuf>,
}

impl Moment {
    /// How far from `before` (0) to `now` (1) the run is at an instant. What stands is at `now`.
    pub fn weight_at(&self, instant: Instant) -> f64 {
        let (from_s, to_s) = (self.before.time_s, self.now.time_s);
        match self.clock {
            Some(clock) if to_s > from_s => {
                ((clock.simulated_s(instant) - from_s) / (to_s - from_s)).clamp(0.0, 1.0)
            }
            _ => 1.0,
        }
    }
}

/// Holds the latest moment. Its lock is held for the exchange of a pointer.
#[derive(Debug)]
struct Slot(Mutex<Arc<Moment>>);

impl Slot {
    fn put(&self, moment: Moment) {
        let moment = Arc::new(moment);
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = moment;
    }

    fn get(&self) -> Arc<Moment> {
        Arc::clone(&self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

/// How a run is recorded and who hears of it.
#[derive(Default)]
pub struct Options {
    /// Folder in which each run gets one of its own: `run-1`, after a reset `run-2`. Nothing is
    /// written without it, and nothing before the first tick.
    pub record: Option<PathBuf>,
    /// Runs that lie in that folder already: the first is numbered after them.
    pub runs_before: u32,
    /// Called on the run's thread after each new moment; it must not wait.
    pub on_news: Option<Box<dyn Fn() + Send>>,
}

impl fmt::Debug for Options {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Options").field("record", &self.record).finish_non_exhaustive()
    }
}

/// A run on its thread. Dropped, it ends and finishes its log.
#[derive(Debug)]
pub struct Live {
    orders: SyncSender<Order>,
    slot: Arc<Slot>,
    thread: Option<JoinHandle<Result<Vec<PathBuf>, LiveError>>>,
}

/// Orders that may wait for the thread: a second of pedals of a person and some clicks.
const ORDERS: usize = 256;

impl Live {
    /// Makes the run at its initial conditions; it waits for [`Order::Start`].
    ///
    /// # Errors
    /// [`LiveError::Setup`] for a vehicle that the control framework cannot take, [`LiveError::Thread`].
    pub fn new(experiment: Arc<Experiment>, options: Options) -> Result<Self, LiveError> {
        let run = Run::new(experiment)?;
        let first = Arc::new(run.snapshot().clone());
        let moment = Moment {
            before: Arc::clone(&first),
            now: first,
            phase: Phase::Ready,
            speed: Speed::default(),
            clock: None,
            real_time_factor: 0.0,
            run: options.runs_before + 1,
            folder: None,
        };
        let slot = Arc::new(Slot(Mutex::new(Arc::new(moment))));
        let (orders, inbox) = sync_channel(ORDERS);
        let recording = Recording::new(options.record, options.runs_before + 1);
        let engine = Engine::new(run, recording, (Arc::clone(&slot), options.on_news));
        let thread = std::thread::Builder::new()
            .name("simulation".to_owned())
            .spawn(move || engine.live(&inbox))
            .map_err(LiveError::Thread)?;
        Ok(Self { orders, slot, thread: Some(thread) })
    }

    /// Gives an order without waiting. `false` where it could not be taken: the thread has ended, or is
    /// hundreds of orders behind.
    pub fn order(&self, order: Order) -> bool {
        match self.orders.try_send(order) {
            Ok(()) => true,
            Err(TrySendError::Full(_) | TrySendError::Disconnected(_)) => false,
        }
    }

    /// The latest moment.
    pub fn moment(&self) -> Arc<Moment> {
        self.slot.get()
    }

    /// Ends the run and waits until its files are whole: the folders of the runs that were recorded, in order.
    ///
    /// # Errors
    /// What went wrong with them.
    pub fn stop(mut self) -> Result<Vec<PathBuf>, LiveError> {
        self.join()
    }

    fn join(&mut self) -> Result<Vec<PathBuf>, LiveError> {
        let Some(thread) = self.thread.take() else { return Ok(Vec::new()) };
        // A thread that has ended already does not hear it.
        let _ = self.orders.send(Order::Stop);
        thread.join().unwrap_or(Err(LiveError::Ended))
    }
}

impl Drop for Live {
    fn drop(&mut self) {
        if let Err(error) = self.join() {
            tracing::warn!("{error}");
        }
    }
}
