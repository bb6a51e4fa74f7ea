//! The player of a log: resolves seeks, interpolates between snapshots, and requests chunks from the prefetch thread.

use super::PlaybackError;
use super::chunk_cache::{SnapshotPair, bracketing, chunk_at, find, told_by};
use super::log_traffic::LogTraffic;
use super::marks::{MarkCollector, TimelineMark};
use super::past_cache::PastCache;
use super::playhead::{FrameTimer, PlaybackCommand, Playhead, SeekTarget};
use super::prefetch::{ChunkPrefetcher, ReadRequest, ReaderMonitor, SharedState};
use super::registry::VehicleRegistry;
use crate::{ControlInsight, PoseWatch, RoadWatch, RunHistory, RunPhase, RunState, Speed};
use city3d_logbook::record::{ChunkedLog, EntryFilter, LogOrigin, LogReader};
use city3d_simulation::scenario::Experiment;
use std::path::Path;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Instant;

/// What the window shows of a log beside its snapshots.
#[derive(Clone, Debug, Default)]
pub struct LogInfo {
    /// In order of time.
    pub marks: Arc<Vec<TimelineMark>>,
    /// Fraction of the log that has been scanned for events, 0 to 1.
    pub searched: f64,
    /// Why the log is truncated, if it is.
    pub truncation: Option<String>,
}

/// Counters of the playback: chunks decoded and snapshots in memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PlaybackStats {
    /// Chunks of the log.
    pub chunks: usize,
    /// Decoded chunks; one that was evicted and decoded again counts twice.
    pub decoded: u64,
    /// Snapshots in memory.
    pub kept: usize,
}

/// How often the traffic is measured anew while a log is played, a second.
const TRAFFIC_PER_S: f64 = 10.0;

/// Lookup of what the control framework has told that holds at the shown time.
#[derive(Debug)]
struct ControlLookup {
    /// Which chunks may have something of it; empty where none has.
    telling: Vec<bool>,
    /// That of the shown snapshot is not known yet.
    is_pending: bool,
}

/// Plays a log: takes commands and returns the state to show.
#[derive(Debug)]
pub struct Player {
    shared: Arc<ReaderMonitor>,
    thread: Option<JoinHandle<()>>,
    experiment: Arc<Experiment>,
    origin: LogOrigin,
    begins_s: Arc<Vec<f64>>,
    head: Playhead,
    ticker: FrameTimer,
    /// A seek that is not resolved yet.
    target: Option<SeekTarget>,
    /// Time to which it plays while the chunk of that time is still missing (buffering).
    pending_s: Option<f64>,
    run_state: Arc<RunState>,
    weight: f64,
    requested: Option<(ReadRequest, u64)>,
    control: ControlLookup,
    past_s: f64,
    /// The traffic is on display.
    shows_traffic: bool,
    /// Revision of the past states that were read last.
    past_read: Option<u64>,
}

impl Player {
    /// Opens a log, paused at its first snapshot. `on_update` is called on the prefetch thread when there is
    /// something new to show; it must not block.
    ///
    /// # Errors
    /// Where it is no log, or one without snapshots.
    pub fn open(path: &Path, on_update: Box<dyn Fn() + Send>) -> Result<Self, PlaybackError> {
        let reader = LogReader::open(path)?;
        let experiment = Arc::new(reader.experiment()?);
        let log = ChunkedLog::of(&reader, path)?;
        let begins_s: Arc<Vec<f64>> = Arc::new(log.chunks().iter().map(|chunk| chunk.from_s).collect());
        let state = SharedState {
            readable: log.chunks().len(),
            truncation: log.truncation().map(ToString::to_string),
            past: PastCache::default(),
            ..SharedState::default()
        };
        let shared = Arc::new(ReaderMonitor::new(state));
        let may_tell = |chunk| log.may_have(chunk, EntryFilter::Control);
        let mut telling: Vec<bool> = (0..log.chunks().len()).map(may_tell).collect();
        if !telling.contains(&true) {
            telling.clear();
        }
        let is_pending = !telling.is_empty();
        let control = ControlLookup { telling, is_pending };
        let mut prefetcher = ChunkPrefetcher {
            log,
            begins_s: Arc::clone(&begins_s),
            registry: VehicleRegistry::of(Arc::clone(&experiment)),
            marker: MarkCollector::of(&experiment),
            traffic: LogTraffic::new(&experiment),
            measured_to_s: None,
            road: RoadWatch::new(&experiment),
            watch: (!reader.origin().has_world()).then(PoseWatch::default),
            shared: Arc::clone(&shared),
            end_s: None,
            on_update,
        };
        if reader.origin() == LogOrigin::Served {
            prefetcher.register_first();
        }
        let empty = || PlaybackError::Empty(path.to_path_buf());
        let (first, last) = prefetcher.first_and_last().ok_or_else(empty)?;
        prefetcher.end_s = Some(last.time_s);
        let run_state = RunState::standing(Arc::clone(&first), RunPhase::Paused);
        let thread = std::thread::Builder::new().name("log".to_owned()).spawn(move || prefetcher.work());
        Ok(Self {
            shared,
            thread: Some(thread.map_err(PlaybackError::Thread)?),
            experiment,
            origin: reader.origin(),
            begins_s,
            head: Playhead::new(first.time_s, last.time_s),
            ticker: FrameTimer::stopped(),
            target: None,
            pending_s: None,
            run_state: Arc::new(run_state),
            weight: 1.0,
            requested: None,
            control,
            past_s: 0.0,
            shows_traffic: false,
            past_read: None,
        })
    }

    /// The experiment, from the scenario and the map in the log.
    pub fn experiment(&self) -> &Arc<Experiment> {
        &self.experiment
    }

    /// The program that wrote the log.
    pub fn origin(&self) -> LogOrigin {
        self.origin
    }

    /// Position, direction and speed of the playback.
    pub fn head(&self) -> Playhead {
        self.head
    }

    /// Whether the picture changes without further commands.
    pub fn is_moving(&self) -> bool {
        self.head.is_playing || self.target.is_some()
    }

    /// Whether it waits for a chunk (buffering).
    pub fn is_late(&self) -> bool {
        self.target.is_some() || self.pending_s.is_some()
    }

    /// Whether the prefetch thread is idle and no seek is pending.
    pub fn is_settled(&self) -> bool {
        let state = self.shared.lock();
        !self.is_late() && !self.control.is_pending && state.is_idle && state.request.is_none()
    }

    /// The state that was shown last.
    pub fn run_state(&self) -> Arc<RunState> {
        Arc::clone(&self.run_state)
    }

    /// Events found so far, and damage of the log.
    pub fn info(&self) -> LogInfo {
        let state = self.shared.lock();
        let searched = state.searched as f64 / state.readable.max(1) as f64;
        LogInfo {
            marks: Arc::clone(&state.marks),
            searched: searched.min(1.0),
            truncation: state.truncation.clone(),
        }
    }

    /// Chunks decoded since the log was opened, and snapshots in memory.
    pub fn stats(&self) -> PlaybackStats {
        let state = self.shared.lock();
        PlaybackStats { chunks: self.begins_s.len(), decoded: state.decoded, kept: state.cache.snapshots() }
    }

    /// Applies a transport command; a seek is shown once its chunk is decoded.
    pub fn command(&mut self, command: PlaybackCommand) {
        // The command is relative to the resolved position.
        if let Some(target) = self.target {
            self.resolve_seek(target);
        }
        if let Some(target) = self.head.apply(command) {
            self.target = Some(target);
        }
        self.pending_s = None;
        if !self.head.is_playing {
            self.ticker.stop();
        }
    }

    /// Reads the past states that are loaded. The prefetch thread keeps those of the last `past_s` seconds loaded from
    /// now on, and of the whole log where that is infinite.
    pub fn read_history(&mut self, history: &mut RunHistory, past_s: f64) {
        self.past_s = past_s;
        let state = self.shared.lock();
        if self.past_read != Some(state.past.revision()) {
            self.past_read = Some(state.past.revision());
            state.past.read(history);
        }
    }

    /// The traffic is measured up to the shown time from now on, or no longer.
    pub fn show_traffic(&mut self, shows_traffic: bool) {
        self.shows_traffic = shows_traffic;
    }

    /// Takes the measures that have been found since.
    fn take_traffic(&mut self) {
        let found = self.shared.lock().traffic.clone();
        let is_known = match (&found, &self.run_state.traffic) {
            (Some(found), Some(known)) => Arc::ptr_eq(found, known),
            (None, _) => true,
            (Some(_), None) => false,
        };
        if !is_known {
            self.run_state = Arc::new(RunState { traffic: found, ..RunState::clone(&self.run_state) });
        }
    }

    /// Advances to an instant. Returns the state to show and the interpolation weight between `before` (0) and `now`
    /// (1). A chunk that is not decoded yet is shown in a later frame.
    pub fn advance(&mut self, now: Instant) -> (Arc<RunState>, f64) {
        self.clamp_to_readable();
        let passed_s = if self.head.is_playing { self.ticker.pass(now) } else { 0.0 };
        let missing = match self.target {
            Some(target) => self.resolve_seek(target),
            None if self.head.is_playing => self.play(passed_s),
            None => None,
        };
        let missing = missing.or_else(|| self.look_up_control());
        self.take_traffic();
        self.request_chunks(missing, passed_s);
        (Arc::clone(&self.run_state), self.weight)
    }

    /// Resolves a seek; returns the missing chunk, if any.
    fn resolve_seek(&mut self, target: SeekTarget) -> Option<usize> {
        let found = {
            let state = self.shared.lock();
            find(&self.begins_s[..state.readable], target, &mut |chunk| state.cache.get(chunk))
        };
        match found {
            Ok(pair) => {
                self.target = None;
                self.pending_s = None;
                if let Some(pair) = pair {
                    self.head.at_s = pair.1.time_s;
                    self.show(pair, 1.0);
                }
                None
            }
            Err(chunk) => Some(chunk),
        }
    }

    /// Plays on for some seconds. Returns the missing chunk, if any; the time spent waiting for it is skipped.
    fn play(&mut self, passed_s: f64) -> Option<usize> {
        let to_s = self.pending_s.unwrap_or_else(|| self.head.after(passed_s));
        let found = {
            let state = self.shared.lock();
            bracketing(&self.begins_s[..state.readable], to_s, &mut |chunk| state.cache.get(chunk))
        };
        let [before, after] = match found {
            Ok(found) => found,
            Err(chunk) => {
                self.pending_s = Some(to_s);
                return Some(chunk);
            }
        };
        self.pending_s = None;
        self.head.at_s = to_s;
        if self.is_over() {
            self.head.is_playing = false;
            self.ticker.stop();
            self.target = Some(SeekTarget::Nearest(to_s));
            return self.resolve_seek(SeekTarget::Nearest(to_s));
        }
        let (before, after) = match (before, after) {
            (Some(before), Some(after)) => (before, after),
            (Some(only), None) | (None, Some(only)) => (Arc::clone(&only), only),
            (None, None) => return None,
        };
        let span_s = after.time_s - before.time_s;
        let weight = if span_s > 0.0 { ((to_s - before.time_s) / span_s).clamp(0.0, 1.0) } else { 1.0 };
        self.show((before, after), weight);
        None
    }

    fn is_over(&self) -> bool {
        if self.head.is_reverse { self.head.is_at_start() } else { self.head.is_at_end() }
    }

    fn show(&mut self, (before, now): SnapshotPair, weight: f64) {
        self.head.before_s = before.time_s;
        self.weight = weight;
        let phase = if self.head.is_playing { RunPhase::Running } else { RunPhase::Paused };
        let speed = Speed::Times(self.head.speed);
        if now.tick != self.run_state.now.tick {
            self.control.is_pending = !self.control.telling.is_empty();
        }
        self.run_state = Arc::new(RunState { before, now, phase, speed, ..RunState::clone(&self.run_state) });
    }

    /// Looks up the decisions and plans that hold in the shown snapshot; returns the missing chunk, if any. While it plays,
    /// nothing is read for them: chunks that were played are there, and leaps at high speed would be slower.
    fn look_up_control(&mut self) -> Option<usize> {
        if !self.control.is_pending {
            return None;
        }
        let time_s = self.run_state.now.time_s;
        let found = {
            let state = self.shared.lock();
            let log = (&self.begins_s[..state.readable], &self.control.telling[..]);
            told_by(log, time_s, &mut |chunk| state.cache.get(chunk))
        };
        // What was told of another time would be wrong.
        let (told, missing) = found.map_or_else(|chunk| (None, Some(chunk)), |told| (Some(told), None));
        self.control.is_pending = missing.is_some();
        let told = told.unwrap_or_default();
        let insight = told.decisions.at(time_s).map(|decisions| {
            Arc::new(ControlInsight { decisions: Some(decisions), ..ControlInsight::default() })
        });
        let coordination = told.plans.at(time_s).map(Arc::new);
        let is_shown = self.run_state.insight.is_some() || self.run_state.coordination.is_some();
        if insight.is_some() || coordination.is_some() || is_shown {
            let run_state = RunState::clone(&self.run_state);
            self.run_state = Arc::new(RunState { insight, coordination, ..run_state });
        }
        missing.filter(|_| !self.head.is_playing)
    }

    /// Requests the missing chunk and the prefetch of the next ones, unless the same request is pending.
    fn request_chunks(&mut self, missing: Option<usize>, passed_s: f64) {
        let at_s = self.pending_s.unwrap_or(self.head.at_s);
        let next_s = if self.head.is_playing { at_s + self.head.rate() * passed_s.max(0.02) } else { at_s };
        let chunk = missing.unwrap_or_else(|| chunk_at(&self.begins_s, at_s));
        let request =
            ReadRequest { chunk, next_s, past_s: self.past_s, at_s, traffic_s: self.traffic_time_s() };
        let next = chunk_at(&self.begins_s, next_s) as u64;
        let is_same = self.requested.is_some_and(|(requested, requested_next)| {
            requested.chunk == chunk
                && requested_next == next
                && (requested.past_s, requested.traffic_s) == (self.past_s, request.traffic_s)
        });
        // The missing chunk may have been evicted since.
        if missing.is_some() || !is_same {
            self.requested = Some((request, next));
            self.shared.request(request);
        }
    }

    /// The time up to which the traffic is wanted: while it plays, some times a second.
    fn traffic_time_s(&self) -> Option<f64> {
        let at_s = self.run_state.now.time_s;
        let per_s = TRAFFIC_PER_S * self.head.speed.recip().min(1.0);
        let wanted_s = if self.head.is_playing { (at_s * per_s).floor() / per_s } else { at_s };
        self.shows_traffic.then_some(wanted_s)
    }

    /// Ends the playback before the first damaged chunk.
    fn clamp_to_readable(&mut self) {
        let (readable, known) = (self.shared.lock().readable, self.begins_s.len());
        let end_s = self.begins_s.get(readable).copied();
        if let (true, Some(end_s)) = (readable < known, end_s)
            && self.head.to_s > end_s
        {
            self.head.to_s = end_s.max(self.head.from_s);
            self.target = self.target.or((self.head.at_s > end_s).then_some(SeekTarget::Nearest(end_s)));
        }
    }
}

impl Drop for Player {
    fn drop(&mut self) {
        self.shared.end();
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
        {
            tracing::warn!("the thread that reads the log ended early");
        }
    }
}

impl ChunkPrefetcher {
    /// The first and the last snapshot of the log; both stay in the cache.
    fn first_and_last(&mut self) -> Option<SnapshotPair> {
        let count = self.begins_s.len();
        let first = (0..count).find_map(|chunk| self.cache_chunk(chunk)?.snapshots.first().cloned())?;
        let last = (0..count).rev().find_map(|chunk| self.cache_chunk(chunk)?.snapshots.last().cloned())?;
        Some((first, last))
    }

    fn cache_chunk(&mut self, chunk: usize) -> Option<super::chunk_cache::DecodedChunk> {
        let known = self.shared.lock().cache.get(chunk);
        let decoded = known.or_else(|| self.read_chunk(chunk))?;
        self.shared.lock().cache.insert(chunk, Arc::clone(&decoded), chunk);
        Some(decoded)
    }

    /// Registers the vehicles of the first chunk: mostly all of them.
    fn register_first(&mut self) {
        for entry in self.log.read(0, EntryFilter::Events).unwrap_or_default() {
            self.registry.register(&entry);
        }
    }
}
