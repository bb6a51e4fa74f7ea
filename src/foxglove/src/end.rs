//! The end of the session: it hands moments over to the server's thread through a bounded queue, and only what somebody
//! listens to.

#[cfg(feature = "render")]
use crate::cameras::Cameras;
use crate::counters::Counters;
use crate::hub::Hub;
use city3d_logbook::record::LogTopic;
use city3d_logbook::record::message::nanoseconds;
use city3d_network::listener::count;
use city3d_protocol::snapshot::FrameSnapshot;
use city3d_session::{EncodedMessages, End, EndHealth, LogMessages, Moment, MomentKind};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};
use tokio::sync::mpsc::{Receiver, Sender, channel};

/// Moments on their way to the server's thread, at most.
const QUEUE: usize = 64;
/// Bytes of their messages, at most.
const MAX_BYTES: usize = 16 << 20;
/// Snapshots whose memory is kept.
const SPARE_SNAPSHOTS: usize = 8;
/// Least time on the wall between two snapshots, for cities that run many times as fast.
const SNAPSHOT_INTERVAL: Duration = Duration::from_millis(4);

/// What the server is told of a moment.
#[derive(Debug)]
pub(crate) struct Told {
    /// Simulated time, nanoseconds.
    pub time_ns: u64,
    pub messages: EncodedMessages,
    /// Where one is due.
    pub snapshot: Option<FrameSnapshot>,
}

/// The way from the session to the server's thread.
#[derive(Debug, Default)]
struct Way {
    /// Bytes of messages that wait.
    bytes: AtomicUsize,
    spare: Mutex<Vec<FrameSnapshot>>,
}

/// The server's end of the way.
#[derive(Debug)]
pub(crate) struct ToldReceiver {
    queue: Receiver<Told>,
    way: Arc<Way>,
}

impl ToldReceiver {
    /// The next moment; `None` when the session has ended.
    pub(crate) async fn next(&mut self) -> Option<Told> {
        let told = self.queue.recv().await?;
        self.way.bytes.fetch_sub(told.messages.size(), Ordering::Relaxed);
        Some(told)
    }

    /// Gives the memory of a moment back.
    pub(crate) fn recycle(&self, told: Told) {
        let mut spare = self.way.spare.lock().unwrap_or_else(PoisonError::into_inner);
        if spare.len() < SPARE_SNAPSHOTS {
            spare.extend(told.snapshot);
        }
    }
}

/// Foxglove as an end of a session.
#[derive(Debug)]
pub struct FoxgloveEnd {
    hub: Arc<Hub>,
    counters: Arc<Counters>,
    queue: Sender<Told>,
    way: Arc<Way>,
    messages: LogMessages,
    /// Ticks from one snapshot to the next.
    snapshot_ticks: u64,
    snapshot_at: Option<Instant>,
    #[cfg(feature = "render")]
    cameras: Option<Cameras>,
}

impl FoxgloveEnd {
    pub(crate) fn new(hub: Arc<Hub>, counters: Arc<Counters>, snapshot_ticks: u64) -> (Self, ToldReceiver) {
        let (queue, receiver) = channel(QUEUE);
        let way = Arc::<Way>::default();
        let end = Self {
            hub,
            counters,
            queue,
            way: Arc::clone(&way),
            messages: LogMessages::default(),
            snapshot_ticks,
            snapshot_at: None,
            #[cfg(feature = "render")]
            cameras: None,
        };
        (end, ToldReceiver { queue: receiver, way })
    }

    /// Offers pictures of cameras; the renderer is opened when somebody first looks.
    ///
    /// # Errors
    /// When the system refuses the thread that draws.
    #[cfg(feature = "render")]
    pub fn with_cameras(
        mut self,
        cameras: Vec<crate::NamedCamera>,
        open: city3d_session::pictures::OpenRenderer,
    ) -> Result<Self, city3d_session::pictures::PictureError> {
        self.cameras = Some(Cameras::start(&self.hub, cameras, open)?);
        Ok(self)
    }

    /// A copy of the snapshot, where one is due and somebody listens to what it becomes.
    fn snapshot(&mut self, moment: &Moment<'_>) -> Option<FrameSnapshot> {
        let city = &self.hub.city;
        let is_wanted = city.scene.is_wanted()
            || city.transforms.is_wanted()
            || self.hub.wants(LogTopic::Snapshot)
            || self.hub.wants_vicon();
        let now = moment.timing.done;
        let is_soon =
            self.snapshot_at.is_some_and(|at| now.saturating_duration_since(at) < SNAPSHOT_INTERVAL);
        let is_due = match moment.kind {
            MomentKind::Tick => moment.snapshot.tick.is_multiple_of(self.snapshot_ticks) && !is_soon,
            _ => true,
        };
        if !is_wanted || !is_due {
            return None;
        }
        self.snapshot_at = Some(now);
        // Memory that the other thread just gives back is not worth waiting for.
        let spare = self.way.spare.try_lock().ok().and_then(|mut spare| spare.pop());
        let mut copy = spare.unwrap_or_default();
        copy.assign(moment.snapshot);
        Some(copy)
    }

    fn send(&self, told: Told) {
        let size = told.messages.size();
        let waiting = self.way.bytes.fetch_add(size, Ordering::Relaxed);
        if waiting + size > MAX_BYTES || self.queue.try_send(told).is_err() {
            self.way.bytes.fetch_sub(size, Ordering::Relaxed);
            count(&self.counters.lost_moments, 1);
        }
    }
}

impl End for FoxgloveEnd {
    fn name(&self) -> &'static str {
        "foxglove"
    }

    fn take(&mut self, moment: &Moment<'_>) {
        #[cfg(feature = "render")]
        if let Some(cameras) = &mut self.cameras {
            cameras.look();
            cameras.thread.take(moment);
        }
        if !self.hub.is_wanted() || moment.kind == MomentKind::Still {
            return;
        }
        let hub = Arc::clone(&self.hub);
        let messages = self.messages.of_moment(moment, |topic| hub.wants(topic));
        let snapshot = self.snapshot(moment);
        if snapshot.is_some() || !messages.is_empty() {
            self.send(Told { time_ns: nanoseconds(moment.snapshot.time_s), messages, snapshot });
        }
    }

    fn health(&self) -> EndHealth {
        let counts = self.counters.counts();
        let health = EndHealth { delivered: counts.peers.messages, dropped: counts.dropped(), failure: None };
        #[cfg(feature = "render")]
        if let Some(cameras) = &self.cameras {
            let EndHealth { dropped, failure, .. } = cameras.thread.health();
            return EndHealth { dropped: health.dropped + dropped, failure, ..health };
        }
        health
    }
}
