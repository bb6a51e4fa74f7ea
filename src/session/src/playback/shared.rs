//! A player of a log on a thread of its own, for those who watch from elsewhere: they share one playhead.

use super::{PlaybackCommand, PlaybackError, Player, Playhead};
use crate::session::PublishedState;
use crate::state::LatestState;
use crate::{EventFeed, RunState};
use city3d_simulation::scenario::Experiment;
use std::path::Path;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Commands that wait, at most.
const CAPACITY: usize = 64;
/// Interval at which a log that is played is shown.
const FRAME: Duration = Duration::from_millis(20);
/// A log that stands is looked at when a command comes, or a chunk is decoded.
const STILL: Duration = Duration::from_secs(1);

/// A log that is played for several viewers.
#[derive(Debug)]
pub struct SharedPlayer {
    experiment: Arc<Experiment>,
    remote: PlayerRemote,
    state: PublishedState,
    thread: Option<JoinHandle<()>>,
}

/// Gives commands to a shared player, and tells where its playhead is.
#[derive(Clone, Debug)]
pub struct PlayerRemote {
    news: SyncSender<News>,
    head: Arc<Mutex<Playhead>>,
}

#[derive(Clone, Copy, Debug)]
enum News {
    Command(PlaybackCommand),
    /// A chunk was decoded.
    Update,
    End,
}

impl PlayerRemote {
    /// Gives a command without blocking; `false` where there is no room.
    pub fn send(&self, command: PlaybackCommand) -> bool {
        self.news.try_send(News::Command(command)).is_ok()
    }

    /// Where the playhead is.
    pub fn head(&self) -> Playhead {
        *self.head.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl SharedPlayer {
    /// Opens a log, paused at its first snapshot.
    ///
    /// # Errors
    /// Where it is no log, or one without snapshots, or the system refuses a thread.
    pub fn open(path: &Path) -> Result<Self, PlaybackError> {
        let (news, inbox) = sync_channel(CAPACITY);
        let updates = news.clone();
        // Where the queue is full, the player looks soon anyway.
        let player = Player::open(path, Box::new(move || _ = updates.try_send(News::Update)))?;
        let (experiment, first) = (Arc::clone(player.experiment()), player.run_state());
        let head = Arc::new(Mutex::new(player.head()));
        let latest = Arc::new(LatestState::new(RunState::clone(&first)));
        let state = PublishedState::of(Arc::clone(&latest));
        let remote = PlayerRemote { news, head: Arc::clone(&head) };
        let work = move || {
            Screening { player, latest, head, shown: first, events: EventFeed::default() }.go_on(&inbox);
        };
        let thread = std::thread::Builder::new().name("shared log".to_owned()).spawn(work);
        Ok(Self { experiment, remote, state, thread: Some(thread.map_err(PlaybackError::Thread)?) })
    }

    /// The experiment, from the scenario and the map in the log.
    pub fn experiment(&self) -> &Arc<Experiment> {
        &self.experiment
    }

    /// What gives it commands.
    pub fn remote(&self) -> PlayerRemote {
        self.remote.clone()
    }

    /// The states that it shows.
    pub fn published(&self) -> PublishedState {
        self.state.clone()
    }
}

impl Drop for SharedPlayer {
    fn drop(&mut self) {
        // Commands are taken at once, so that there is room soon.
        let _ = self.remote.news.send(News::End);
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
        {
            tracing::warn!("the thread that plays the log ended early");
        }
    }
}

/// The player with what was published of it.
struct Screening {
    player: Player,
    latest: Arc<LatestState>,
    head: Arc<Mutex<Playhead>>,
    shown: Arc<RunState>,
    events: EventFeed,
}

impl Screening {
    fn go_on(mut self, inbox: &Receiver<News>) {
        let mut marks = self.player.info().marks;
        self.events = EventFeed::of(&marks);
        loop {
            let (state, _) = self.player.advance(Instant::now());
            let found = self.player.info().marks;
            let has_more = found.len() != marks.len();
            if has_more {
                marks = found;
                self.events = EventFeed::of(&marks);
            }
            let before = std::mem::replace(
                &mut *self.head.lock().unwrap_or_else(PoisonError::into_inner),
                self.player.head(),
            );
            if has_more || before != self.player.head() || !Arc::ptr_eq(&state, &self.shown) {
                self.latest.put(RunState { events: self.events.clone(), ..RunState::clone(&state) });
                self.shown = state;
            }
            let most = if self.player.is_moving() { FRAME } else { STILL };
            match inbox.recv_timeout(most) {
                Ok(News::Command(command)) => self.player.command(command),
                Ok(News::Update) | Err(RecvTimeoutError::Timeout) => {}
                Ok(News::End) | Err(RecvTimeoutError::Disconnected) => return,
            }
        }
    }
}
