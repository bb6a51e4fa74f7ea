//! The prefetch thread of a log. Priorities: the requested chunk and its neighbours, then the running plots, then the
//! traffic up to the shown time, then the scan for events.

use super::chunk_cache::{ChunkCache, ChunkContents, DecodedChunk, chunk_at};
use super::log_traffic::LogTraffic;
use super::marks::{MarkCollector, Occurrence, TimelineMark, with_priority};
use super::past_cache::PastCache;
use super::registry::VehicleRegistry;
use crate::{PoseWatch, RoadWatch, RunTraffic};
use city3d_logbook::record::{ChunkedLog, EntryFilter, LogEntry, LoggedDecisions, RecordError};
use city3d_protocol::snapshot::EventKind;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

/// What the player requests from the prefetch thread.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ReadRequest {
    /// The missing chunk, or the one on display.
    pub(super) chunk: usize,
    /// Predicted time of the next frame, seconds.
    pub(super) next_s: f64,
    /// Plots and figures are open: they need this many seconds before `at_s`, the whole log where it is infinite.
    pub(super) past_s: f64,
    pub(super) at_s: f64,
    /// The traffic is on display: it is measured up to this time.
    pub(super) traffic_s: Option<f64>,
}

/// State shared between the player and the prefetch thread. The lock is held only to exchange pointers.
#[derive(Debug, Default)]
pub(super) struct SharedState {
    pub(super) request: Option<ReadRequest>,
    pub(super) is_closing: bool,
    pub(super) cache: ChunkCache,
    pub(super) past: PastCache,
    /// Measures up to the time that was requested, or the last ones that were found.
    pub(super) traffic: Option<Arc<RunTraffic>>,
    /// In order of time.
    pub(super) marks: Arc<Vec<TimelineMark>>,
    /// Number of chunks that have been scanned for events.
    pub(super) searched: usize,
    /// Chunks from this one on are damaged.
    pub(super) readable: usize,
    pub(super) truncation: Option<String>,
    /// The prefetch thread waits for a request.
    pub(super) is_idle: bool,
    /// Chunks decoded so far.
    pub(super) decoded: u64,
}

#[derive(Debug, Default)]
pub(super) struct ReaderMonitor {
    state: Mutex<SharedState>,
    wake: Condvar,
}

impl ReaderMonitor {
    pub(super) fn new(state: SharedState) -> Self {
        Self { state: Mutex::new(state), wake: Condvar::new() }
    }

    pub(super) fn lock(&self) -> MutexGuard<'_, SharedState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn request(&self, request: ReadRequest) {
        let mut state = self.lock();
        (state.request, state.is_idle) = (Some(request), false);
        drop(state);
        self.wake.notify_one();
    }

    pub(super) fn end(&self) {
        self.lock().is_closing = true;
        self.wake.notify_one();
    }
}

/// Chunks prefetched ahead of the playhead, and behind it.
const PREFETCH_CHUNKS: usize = 2;
/// Decisions are logged when they change, at some times a second; a yield is near one of them, seconds.
const DECISION_LAG_S: f64 = 0.5;
/// The window is notified after this many scanned chunks.
const NOTIFY_EVERY_CHUNKS: usize = 50;

/// The next task of the thread.
enum NextTask {
    Serve(ReadRequest),
    /// Background work: plots, traffic and events.
    Other,
    End,
}

/// Decodes chunks into the shared cache.
pub(super) struct ChunkPrefetcher {
    pub(super) log: ChunkedLog,
    pub(super) begins_s: Arc<Vec<f64>>,
    pub(super) registry: VehicleRegistry,
    pub(super) marker: MarkCollector,
    pub(super) traffic: LogTraffic,
    /// Finds in the snapshots what a log of poses alone has no events of.
    pub(super) watch: Option<PoseWatch>,
    /// Finds in the snapshots who leaves the road.
    pub(super) road: RoadWatch,
    pub(super) shared: Arc<ReaderMonitor>,
    /// The time up to which the traffic was told last.
    pub(super) measured_to_s: Option<f64>,
    /// Time of the last snapshot.
    pub(super) end_s: Option<f64>,
    pub(super) on_update: Box<dyn Fn() + Send>,
}

impl ChunkPrefetcher {
    /// Runs until the player is dropped.
    pub(super) fn work(mut self) {
        let mut last: Option<ReadRequest> = None;
        loop {
            let back =
                last.and_then(|request| self.missing_plot_chunk(request).map(|chunk| (chunk, request)));
            let unmeasured = last.and_then(|request| self.missing_traffic_chunk(request));
            match (self.next(back.is_some() || unmeasured.is_some()), back, unmeasured) {
                (NextTask::End, ..) => return,
                (NextTask::Serve(request), ..) => {
                    self.serve(request);
                    last = Some(request);
                }
                (NextTask::Other, Some((chunk, request)), _) => self.read_plot_chunk(chunk, request),
                (NextTask::Other, None, Some((chunk, to_s))) => self.measure(chunk, to_s),
                (NextTask::Other, None, None) => self.search(),
            }
        }
    }

    /// Waits on the condition variable for the next task.
    fn next(&self, has_other: bool) -> NextTask {
        let mut state = self.shared.lock();
        loop {
            if state.is_closing {
                return NextTask::End;
            }
            if let Some(request) = state.request.take() {
                return NextTask::Serve(request);
            }
            if has_other || state.searched < state.readable {
                return NextTask::Other;
            }
            state.is_idle = true;
            state = self.shared.wake.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// Decodes the requested chunk and its neighbours; a newer request interrupts the neighbours.
    fn serve(&mut self, request: ReadRequest) {
        let next = chunk_at(&self.begins_s, request.next_s);
        // Fast playback skips chunks between frames: prefetch around the predicted position.
        let middle = if next.abs_diff(request.chunk) > PREFETCH_CHUNKS { next } else { request.chunk };
        let mut neighbours: Vec<usize> =
            (middle.saturating_sub(PREFETCH_CHUNKS)..=middle + PREFETCH_CHUNKS).collect();
        neighbours.sort_by_key(|chunk| chunk.abs_diff(next));
        neighbours.retain(|chunk| *chunk != request.chunk);
        for (count, chunk) in std::iter::once(request.chunk).chain(neighbours).enumerate() {
            let state = self.shared.lock();
            let is_over = state.is_closing || (count > 0 && state.request.is_some());
            let is_there = chunk >= state.readable || state.cache.get(chunk).is_some();
            drop(state);
            if is_over {
                return;
            }
            if !is_there && self.decode(chunk, request.chunk).is_some() && count == 0 {
                (self.on_update)();
            }
        }
    }

    fn decode(&mut self, chunk: usize, wanted: usize) -> Option<DecodedChunk> {
        let decoded = self.read_chunk(chunk)?;
        let mut state = self.shared.lock();
        state.decoded += 1;
        state.past.insert(chunk, &decoded.snapshots);
        state.cache.insert(chunk, Arc::clone(&decoded), wanted);
        Some(decoded)
    }

    /// Decodes the snapshots of a chunk and what the control framework tells; a damaged chunk truncates the log.
    pub(super) fn read_chunk(&mut self, chunk: usize) -> Option<DecodedChunk> {
        match self.log.read(chunk, EntryFilter::Snapshots) {
            Ok(entries) => {
                let mut contents = ChunkContents::default();
                for entry in entries {
                    match entry {
                        LogEntry::Snapshot(logged) => {
                            contents.snapshots.push(Arc::new(self.registry.snapshot(&logged)));
                        }
                        LogEntry::Decisions(told) => contents.decisions.push(told),
                        LogEntry::Plans(told) => contents.plans.push(told),
                        _ => {}
                    }
                }
                Some(Arc::new(contents))
            }
            Err(error) => {
                self.truncate_at(chunk, &error);
                None
            }
        }
    }

    fn truncate_at(&mut self, chunk: usize, error: &RecordError) {
        let reason = match error {
            RecordError::NoLog { reason, .. } => reason.clone(),
            other => other.to_string(),
        };
        let mut state = self.shared.lock();
        state.readable = state.readable.min(chunk);
        state.truncation = Some(reason);
        // Chunks behind the damage may have been searched before it was found.
        if let Some(end_s) = self.begins_s.get(chunk) {
            Arc::make_mut(&mut state.marks).retain(|mark| mark.time_s <= *end_s);
        }
        drop(state);
        (self.on_update)();
    }

    /// The latest chunk that the running plots lack.
    fn missing_plot_chunk(&self, request: ReadRequest) -> Option<usize> {
        if request.past_s <= 0.0 {
            return None;
        }
        let state = self.shared.lock();
        let end = state.readable.checked_sub(1)?;
        let (first, last) = if request.past_s.is_finite() {
            let from = chunk_at(&self.begins_s, request.at_s - request.past_s);
            (from, chunk_at(&self.begins_s, request.at_s).min(end))
        } else {
            (0, end)
        };
        (first..=last).rev().find(|chunk| !state.past.has(*chunk))
    }

    fn read_plot_chunk(&mut self, chunk: usize, request: ReadRequest) {
        let Some(decoded) = self.read_chunk(chunk) else { return };
        let mut state = self.shared.lock();
        state.decoded += 1;
        state.past.insert(chunk, &decoded.snapshots);
        drop(state);
        if chunk.is_multiple_of(16) || self.missing_plot_chunk(request).is_none() {
            (self.on_update)();
        }
    }

    /// The chunk that the traffic up to the wanted time still needs, and that time.
    fn missing_traffic_chunk(&mut self, request: ReadRequest) -> Option<(usize, f64)> {
        let to_s = request.traffic_s?;
        if self.measured_to_s == Some(to_s) {
            return None;
        }
        let readable = self.shared.lock().readable;
        let missing = self.traffic.missing(&self.begins_s[..readable], to_s);
        if missing.is_none() {
            self.tell_traffic(to_s);
        }
        missing.map(|chunk| (chunk, to_s))
    }

    /// Measures the traffic of a chunk up to a time.
    fn measure(&mut self, chunk: usize, to_s: f64) {
        let known = self.shared.lock().cache.get(chunk);
        let Some(decoded) = known.or_else(|| self.read_chunk(chunk)) else { return };
        let readable = self.shared.lock().readable;
        if self.traffic.take(&decoded, (to_s, &self.begins_s[..readable])) {
            self.tell_traffic(to_s);
        }
    }

    fn tell_traffic(&mut self, to_s: f64) {
        self.measured_to_s = Some(to_s);
        self.shared.lock().traffic = Some(Arc::new(self.traffic.traffic()));
        (self.on_update)();
    }

    /// Names whom vehicles yield to, by the decisions in a chunk: the first ones after each event, or the last before it.
    fn tell_priority(&mut self, chunk: usize, found: &mut [TimelineMark]) {
        let yields = |mark: &TimelineMark| mark.what == Occurrence::Event(EventKind::Yield);
        if !found.iter().any(yields) || !self.log.may_have(chunk, EntryFilter::Control) {
            return;
        }
        // What cannot be read is found where the snapshots are.
        let entries = self.log.read(chunk, EntryFilter::Control).unwrap_or_default();
        let told: Vec<&LoggedDecisions> = entries
            .iter()
            .filter_map(|entry| if let LogEntry::Decisions(told) = entry { Some(told) } else { None })
            .collect();
        for mark in found.iter_mut().filter(|mark| yields(mark)) {
            let (time_s, vehicle) = (mark.time_s, mark.vehicle);
            let is_near = |told: &&&LoggedDecisions| (told.time_s - time_s).abs() <= DECISION_LAG_S;
            let (before, after): (Vec<&LoggedDecisions>, Vec<_>) =
                told.iter().filter(is_near).copied().partition(|told| told.time_s < time_s);
            let in_order = after.into_iter().chain(before.into_iter().rev());
            let of_vehicle = in_order.flat_map(|told| &told.decisions).filter(|d| d.vehicle == vehicle);
            with_priority(mark, of_vehicle);
        }
    }

    /// Finds what the poses of a chunk tell. Long stops are found by the events of the log.
    fn watch_poses(&mut self, chunk: usize, found: &mut Vec<TimelineMark>) {
        let known = self.shared.lock().cache.get(chunk);
        let Some(decoded) = known.or_else(|| self.read_chunk(chunk)) else { return };
        for snapshot in &decoded.snapshots {
            found.extend(self.road.observe(snapshot));
            let marks = self.watch.as_mut().map(|watch| watch.observe(snapshot, false));
            found.extend(marks.into_iter().flatten().filter(|mark| mark.what != Occurrence::LongStop));
        }
    }

    /// Scans the next chunk for events.
    fn search(&mut self) {
        let chunk = self.shared.lock().searched;
        let mut found = Vec::new();
        let mut is_new_vehicle = false;
        if self.log.may_have(chunk, EntryFilter::Events) {
            match self.log.read(chunk, EntryFilter::Events) {
                Ok(entries) => {
                    for entry in &entries {
                        found.extend(self.marker.marks(entry));
                        is_new_vehicle |= self.registry.register(entry);
                    }
                }
                Err(error) => return self.truncate_at(chunk, &error),
            }
            self.tell_priority(chunk, &mut found);
        }
        self.watch_poses(chunk, &mut found);
        let mut state = self.shared.lock();
        state.searched = chunk + 1;
        if state.searched == state.readable
            && let Some(end_s) = self.end_s
        {
            found.extend(self.marker.finish(end_s));
        }
        if !found.is_empty() {
            let marks = Arc::make_mut(&mut state.marks);
            marks.append(&mut found);
            // Within a chunk, commands precede the events that they cause; the list is in order of time.
            marks.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        }
        if is_new_vehicle {
            // Cached snapshots show new vehicles with default properties.
            state.cache.clear();
            state.past.clear();
        }
        let is_news = state.searched == state.readable
            || state.searched.is_multiple_of(NOTIFY_EVERY_CHUNKS)
            || is_new_vehicle;
        drop(state);
        if is_news {
            (self.on_update)();
        }
    }
}
