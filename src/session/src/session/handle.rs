//! A session on a thread of its own: its handle, which a window watches and gives orders by.

use super::super::event_feed::EventCollector;
use super::super::state::LatestState;
use super::super::{FilesWritten, Order, OrderSender, RunState, SessionError};
use super::{Session, Source, View};
use std::fmt;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError, Weak};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Is told of each published state; it must not block.
pub type OnUpdate = Arc<dyn Fn() + Send + Sync>;

/// Tells a window that there is something new. The window may come after the session.
#[derive(Clone, Default)]
pub(super) struct UpdateSignal(Arc<Mutex<Option<OnUpdate>>>);

impl UpdateSignal {
    fn set(&self, on_update: OnUpdate) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(on_update);
    }

    pub(super) fn give(&self) {
        let on_update = self.0.lock().unwrap_or_else(PoisonError::into_inner).clone();
        if let Some(on_update) = on_update {
            on_update();
        }
    }
}

impl fmt::Debug for UpdateSignal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("UpdateSignal")
    }
}

/// Handle of a session on its own thread. Dropping it ends the session and finishes its files.
#[derive(Debug)]
pub struct SessionHandle {
    sender: Option<Arc<OrderSender>>,
    latest_state: Arc<LatestState>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<Result<(), SessionError>>>,
    files: Option<Arc<Mutex<FilesWritten>>>,
    updates: UpdateSignal,
}

impl<S: Source + 'static> Session<S> {
    /// Runs on a thread of its own, which a window watches; `files` is what its files have come to, where it has some.
    ///
    /// # Errors
    /// When the operating system refuses the thread.
    pub fn spawn(mut self, files: Option<Arc<Mutex<FilesWritten>>>) -> Result<SessionHandle, SessionError> {
        let (latest_state, updates) = self.open_view(files.clone());
        let (sender, stop) = (self.sender.take().map(Arc::new), Arc::clone(&self.stop));
        let (ended, told) = (Arc::clone(&latest_state), updates.clone());
        let work = move || {
            let on_end = EndNotice(ended, told);
            let outcome = self.run().map(drop);
            drop(on_end);
            outcome
        };
        let thread = std::thread::Builder::new().name("simulation".to_owned()).spawn(work);
        Ok(SessionHandle {
            sender,
            latest_state,
            stop,
            thread: Some(thread.map_err(SessionError::Thread)?),
            files,
            updates,
        })
    }
}

impl<S: Source> Session<S> {
    /// Publishes its states to a reader, in a session that its caller runs on the thread of its own choice.
    #[must_use]
    pub fn publishing(mut self) -> (Self, PublishedState) {
        let (latest_state, _) = self.open_view(None);
        (self, PublishedState(latest_state))
    }

    /// Begins to publish states.
    fn open_view(&mut self, files: Option<Arc<Mutex<FilesWritten>>>) -> (Arc<LatestState>, UpdateSignal) {
        let first = Arc::new(self.source.snapshot().clone());
        let link = self.source.link_status().map(Arc::new);
        let written = files.as_ref().map(|files| files.lock().unwrap_or_else(PoisonError::into_inner));
        let next_folder = written.and_then(|written| written.next_folder.clone());
        let state = RunState {
            speed: self.speed,
            link: link.clone(),
            next_folder,
            ..RunState::standing(Arc::clone(&first), self.source.phase())
        };
        let latest_state = Arc::new(LatestState::new(state));
        let updates = UpdateSignal::default();
        self.view = Some(View {
            latest_state: Arc::clone(&latest_state),
            updates: updates.clone(),
            latest: first,
            is_stale: false,
            published_at: self.host.clock.now(),
            measured_at: self.host.clock.now(),
            arrival_clock: None,
            files,
            link,
            ends: Arc::default(),
            events: EventCollector::new(self.source.origin().has_world()),
        });
        (latest_state, updates)
    }
}

/// The latest state that a session has published.
#[derive(Clone, Debug)]
pub struct PublishedState(Arc<LatestState>);

impl PublishedState {
    /// A reader of a mailbox.
    pub(crate) fn of(latest: Arc<LatestState>) -> Self {
        Self(latest)
    }

    /// The latest published state.
    pub fn run_state(&self) -> Arc<RunState> {
        self.0.get()
    }
}

/// Marks the state as ended when the thread ends, however it does.
struct EndNotice(Arc<LatestState>, UpdateSignal);

impl Drop for EndNotice {
    fn drop(&mut self) {
        let state = RunState::clone(&self.0.get());
        self.0.put(RunState { has_ended: true, ..state });
        self.1.give();
    }
}

impl SessionHandle {
    /// Gives an order without blocking. `false` where the queue is full, or the session has ended.
    pub fn send(&self, order: Order) -> bool {
        self.sender.as_ref().is_some_and(|sender| sender.send(order))
    }

    /// The latest published state.
    pub fn run_state(&self) -> Arc<RunState> {
        self.latest_state.get()
    }

    /// The latest states, for a reader without the handle.
    pub fn published(&self) -> PublishedState {
        PublishedState(Arc::clone(&self.latest_state))
    }

    /// What ends the session without the handle.
    pub fn stopper(&self) -> SessionStopper {
        SessionStopper {
            sender: self.sender.as_ref().map(Arc::downgrade),
            latest_state: Arc::clone(&self.latest_state),
            stop: Arc::clone(&self.stop),
        }
    }

    /// Calls this on the session's thread after each published state; it must not block.
    pub fn on_update(&self, on_update: OnUpdate) {
        self.updates.set(on_update);
    }

    /// Ends the session and waits until its files are complete; tells what was written.
    ///
    /// # Errors
    /// When the source could not go on.
    pub fn stop(mut self) -> Result<FilesWritten, SessionError> {
        self.end();
        self.join()
    }

    /// Sets the flag that ends the session, and wakes it: somebody else may give it orders, too.
    fn end(&self) {
        self.stop.store(true, Ordering::Relaxed);
        // Any order wakes it; none is carried out any more.
        self.send(Order::Pause);
    }

    /// Waits until the session ends by itself or by its flag.
    ///
    /// # Errors
    /// When the source could not go on.
    pub fn wait(mut self) -> Result<FilesWritten, SessionError> {
        self.join()
    }

    fn join(&mut self) -> Result<FilesWritten, SessionError> {
        self.sender = None;
        let outcome = match self.thread.take() {
            Some(thread) => thread.join().unwrap_or(Err(SessionError::Ended)),
            None => Ok(()),
        };
        let written =
            self.files.as_ref().map(|files| files.lock().unwrap_or_else(PoisonError::into_inner).clone());
        outcome.map(|()| written.unwrap_or_default())
    }
}

/// Ends a session that somebody else holds the handle of.
#[derive(Clone, Debug)]
pub struct SessionStopper {
    /// The handle's, which closes the queue when it drops it.
    sender: Option<Weak<OrderSender>>,
    latest_state: Arc<LatestState>,
    stop: Arc<AtomicBool>,
}

impl SessionStopper {
    /// Ends the session, and waits for its files; `false` where they are not complete within the limit.
    pub fn stop_within(&self, limit: Duration) -> bool {
        const POLL: Duration = Duration::from_millis(5);
        self.stop.store(true, Ordering::Relaxed);
        if let Some(sender) = self.sender.as_ref().and_then(Weak::upgrade) {
            // Any order wakes it; none is carried out any more.
            sender.send(Order::Pause);
        }
        let start = Instant::now();
        while !self.latest_state.get().has_ended {
            if start.elapsed() > limit {
                return false;
            }
            std::thread::sleep(POLL);
        }
        true
    }
}

impl Drop for SessionHandle {
    fn drop(&mut self) {
        self.end();
        if self.thread.is_some()
            && let Err(error) = self.join()
        {
            tracing::warn!("{error}");
        }
    }
}
