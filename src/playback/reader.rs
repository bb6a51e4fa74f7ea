//! The thread that reads a log: what is wanted first, then what running plots show, then all that has happened.

use super::cast::Cast;
use super::film::{Film, Stretch, chunk_at};
use super::marks::{Mark, Marker};
use super::past::Past;
use crate::record::{ChunkedLog, Entry, Part, RecordError};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

/// What is wanted of the log.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Want {
    /// Of the chunk that is missing, or of the one that is shown.
    pub(super) chunk: usize,
    /// Where the next pass will be, if nothing changes.
    pub(super) next_s: f64,
    /// Running plots are seen: this many seconds before `at_s` are wanted too.
    pub(super) past_s: f64,
    pub(super) at_s: f64,
}

/// What the thread and who watches have in common. Its lock is held for the exchange of pointers.
#[derive(Debug, Default)]
pub(super) struct Shelf {
    pub(super) wanted: Option<Want>,
    pub(super) ends: bool,
    pub(super) film: Film,
    pub(super) past: Past,
    /// In order of time.
    pub(super) marks: Arc<Vec<Mark>>,
    /// Chunks that have been looked through for what happened.
    pub(super) searched: usize,
    /// The log can be read up to this chunk.
    pub(super) readable: usize,
    pub(super) torn: Option<String>,
    /// The thread has nothing left to do.
    pub(super) is_idle: bool,
    /// Chunks of which snapshots have been decoded, since the beginning.
    pub(super) decoded: u64,
}

#[derive(Debug, Default)]
pub(super) struct Shared {
    shelf: Mutex<Shelf>,
    wake: Condvar,
}

impl Shared {
    pub(super) fn new(shelf: Shelf) -> Self {
        Self { shelf: Mutex::new(shelf), wake: Condvar::new() }
    }

    pub(super) fn lock(&self) -> MutexGuard<'_, Shelf> {
        self.shelf.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn want(&self, want: Want) {
        let mut shelf = self.lock();
        (shelf.wanted, shelf.is_idle) = (Some(want), false);
        drop(shelf);
        self.wake.notify_one();
    }

    pub(super) fn end(&self) {
        self.lock().ends = true;
        self.wake.notify_one();
    }
}

/// Chunks that are decoded ahead of where it plays, and behind.
const AHEAD: usize = 2;
/// Chunks that are looked through before who watches is told.
const NEWS_EVERY: usize = 50;

/// What the thread does next.
enum Next {
    Serve(Want),
    /// What nobody waits for.
    Other,
    End,
}

/// Reads a log and puts what it finds on the shelf.
pub(super) struct Reader {
    pub(super) log: ChunkedLog,
    pub(super) begins_s: Arc<Vec<f64>>,
    pub(super) cast: Cast,
    pub(super) marker: Marker,
    pub(super) shared: Arc<Shared>,
    pub(super) on_news: Box<dyn Fn() + Send>,
}

impl Reader {
    /// Works until nobody watches any more.
    pub(super) fn work(mut self) {
        let mut last: Option<Want> = None;
        loop {
            let back = last.and_then(|want| self.missing_past(want).map(|chunk| (chunk, want)));
            match (self.next(back.is_some()), back) {
                (Next::End, _) => return,
                (Next::Serve(want), _) => {
                    self.serve(want);
                    last = Some(want);
                }
                (Next::Other, Some((chunk, want))) => self.look_back(chunk, want),
                (Next::Other, None) => self.search(),
            }
        }
    }

    /// Waits for something to do.
    fn next(&self, has_other: bool) -> Next {
        let mut shelf = self.shared.lock();
        loop {
            if shelf.ends {
                return Next::End;
            }
            if let Some(want) = shelf.wanted.take() {
                return Next::Serve(want);
            }
            if has_other || shelf.searched < shelf.readable {
                return Next::Other;
            }
            shelf.is_idle = true;
            shelf = self.shared.wake.wait(shelf).unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// Decodes the wanted chunk and what comes next, as long as nothing else is wanted.
    fn serve(&mut self, want: Want) {
        let next = chunk_at(&self.begins_s, want.next_s);
        // What plays fast is at another place by the next pass, and only about there.
        let middle = if next.abs_diff(want.chunk) > AHEAD { next } else { want.chunk };
        let mut around: Vec<usize> = (middle.saturating_sub(AHEAD)..=middle + AHEAD).collect();
        around.sort_by_key(|chunk| chunk.abs_diff(next));
        around.retain(|chunk| *chunk != want.chunk);
        for (count, chunk) in std::iter::once(want.chunk).chain(around).enumerate() {
            let shelf = self.shared.lock();
            let is_over = shelf.ends || (count > 0 && shelf.wanted.is_some());
            let is_there = chunk >= shelf.readable || shelf.film.get(chunk).is_some();
            drop(shelf);
            if is_over {
                return;
            }
            if !is_there && self.decode(chunk, want.chunk).is_some() && count == 0 {
                (self.on_news)();
            }
        }
    }

    fn decode(&mut self, chunk: usize, wanted: usize) -> Option<Stretch> {
        let stretch = self.stretch(chunk)?;
        let mut shelf = self.shared.lock();
        shelf.decoded += 1;
        shelf.past.insert(chunk, &stretch, wanted);
        shelf.film.insert(chunk, Arc::clone(&stretch), wanted);
        Some(stretch)
    }

    /// The snapshots of a chunk; one that is damaged ends the log.
    pub(super) fn stretch(&mut self, chunk: usize) -> Option<Stretch> {
        match self.log.read(chunk, Part::Snapshots) {
            Ok(entries) => {
                let snapshot = |entry| match entry {
                    Entry::Snapshot(logged) => Some(Arc::new(self.cast.snapshot(&logged))),
                    _ => None,
                };
                Some(Arc::new(entries.into_iter().filter_map(snapshot).collect()))
            }
            Err(error) => {
                self.tear(chunk, &error);
                None
            }
        }
    }

    fn tear(&mut self, chunk: usize, error: &RecordError) {
        let reason = match error {
            RecordError::NoLog { reason, .. } => reason.clone(),
            other => other.to_string(),
        };
        let mut shelf = self.shared.lock();
        shelf.readable = shelf.readable.min(chunk);
        shelf.torn = Some(reason);
        drop(shelf);
        (self.on_news)();
    }

    /// A chunk that running plots lack, the latest first.
    fn missing_past(&self, want: Want) -> Option<usize> {
        if want.past_s <= 0.0 {
            return None;
        }
        let shelf = self.shared.lock();
        let first = chunk_at(&self.begins_s, want.at_s - want.past_s);
        let last = chunk_at(&self.begins_s, want.at_s).min(shelf.readable.checked_sub(1)?);
        (first..=last).rev().find(|chunk| !shelf.past.has(*chunk))
    }

    fn look_back(&mut self, chunk: usize, want: Want) {
        let Some(stretch) = self.stretch(chunk) else { return };
        let mut shelf = self.shared.lock();
        shelf.decoded += 1;
        shelf.past.insert(chunk, &stretch, want.chunk);
        drop(shelf);
        if chunk.is_multiple_of(16) || self.missing_past(want).is_none() {
            (self.on_news)();
        }
    }

    /// Looks through the next chunk for what happened.
    fn search(&mut self) {
        let chunk = self.shared.lock().searched;
        let mut found = Vec::new();
        let mut is_new_cast = false;
        if self.log.may_have(chunk, Part::Happenings) {
            match self.log.read(chunk, Part::Happenings) {
                Ok(entries) => {
                    for entry in &entries {
                        found.extend(self.marker.mark(entry));
                        is_new_cast |= self.cast.meet(entry);
                    }
                }
                Err(error) => return self.tear(chunk, &error),
            }
        }
        let mut shelf = self.shared.lock();
        shelf.searched = chunk + 1;
        if !found.is_empty() {
            let marks = Arc::make_mut(&mut shelf.marks);
            marks.append(&mut found);
            // Within a chunk commands stand before what came of them; times are in order anyhow.
            marks.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        }
        if is_new_cast {
            // Those that are new were shown by default.
            shelf.film.clear();
        }
        let is_news =
            shelf.searched == shelf.readable || shelf.searched.is_multiple_of(NEWS_EVERY) || is_new_cast;
        drop(shelf);
        if is_news {
            (self.on_news)();
        }
    }
}
