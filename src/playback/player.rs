//! A log that is watched.

use super::PlaybackError;
use super::cast::Cast;
use super::film::{Pair, around, chunk_at, find};
use super::head::{Aim, Cue, Playhead, SAME_S, Ticker};
use super::marks::{Mark, Marker};
use super::past::{Glimpse, Past};
use super::reader::{Reader, Shared, Shelf, Want};
use crate::live::{Moment, Phase, Speed};
use crate::record::{ChunkedLog, LogReader, Origin, Part};
use crate::scenario::Experiment;
use crate::snapshot::VehicleId;
use std::path::Path;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Instant;

/// What is known of a log besides its snapshots.
#[derive(Clone, Debug, Default)]
pub struct Told {
    /// In order of time.
    pub marks: Arc<Vec<Mark>>,
    /// How much of the log has been looked through for them, 0 to 1.
    pub searched: f64,
    /// Why the log has no end, where it is torn.
    pub torn: Option<String>,
}

/// What showing a log has cost so far.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Effort {
    /// Of the log.
    pub chunks: usize,
    /// Chunks of which snapshots have been decoded; one that was let go and wanted again counts twice.
    pub decoded: u64,
    /// Snapshots in memory.
    pub kept: usize,
}

/// A log that is watched: it is told where to go, and says what is to be seen there.
#[derive(Debug)]
pub struct Player {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
    experiment: Arc<Experiment>,
    origin: Origin,
    begins_s: Arc<Vec<f64>>,
    head: Playhead,
    ticker: Ticker,
    /// A place that is wanted and not shown yet.
    aim: Option<Aim>,
    /// Where it plays to, and what is there has not come yet.
    ahead_s: Option<f64>,
    moment: Arc<Moment>,
    weight: f64,
    asked: Option<(Want, u64)>,
    past_s: f64,
}

impl Player {
    /// Opens a log, standing at its first snapshot. `on_news` is called on the log's thread when there is something
    /// new to be seen; it must not wait.
    ///
    /// # Errors
    /// Where it is no log, or one without snapshots.
    pub fn open(path: &Path, on_news: Box<dyn Fn() + Send>) -> Result<Self, PlaybackError> {
        let reader = LogReader::open(path)?;
        let experiment = Arc::new(reader.experiment()?);
        let log = ChunkedLog::of(&reader, path)?;
        let begins_s: Arc<Vec<f64>> = Arc::new(log.chunks().iter().map(|chunk| chunk.from_s).collect());
        let shelf = Shelf {
            readable: log.chunks().len(),
            torn: log.torn().map(str::to_owned),
            past: Past::default(),
            ..Shelf::default()
        };
        let shared = Arc::new(Shared::new(shelf));
        let mut reading = Reader {
            log,
            begins_s: Arc::clone(&begins_s),
            cast: Cast::of(Arc::clone(&experiment)),
            marker: Marker::new(experiment.rates),
            shared: Arc::clone(&shared),
            on_news,
        };
        if reader.origin() == Origin::Served {
            reading.meet_first();
        }
        let empty = || PlaybackError::Empty(path.to_path_buf());
        let (first, last) = reading.ends().ok_or_else(empty)?;
        let moment = Moment {
            before: Arc::clone(&first),
            now: Arc::clone(&first),
            phase: Phase::Paused,
            speed: Speed::default(),
            clock: None,
            real_time_factor: 0.0,
            run: 1,
            folder: None,
        };
        let thread = std::thread::Builder::new().name("log".to_owned()).spawn(move || reading.work());
        Ok(Self {
            shared,
            thread: Some(thread.map_err(PlaybackError::Thread)?),
            experiment,
            origin: reader.origin(),
            begins_s,
            head: Playhead::new(first.time_s, last.time_s),
            ticker: Ticker::stopped(),
            aim: None,
            ahead_s: None,
            moment: Arc::new(moment),
            weight: 1.0,
            asked: None,
            past_s: 0.0,
        })
    }

    pub fn experiment(&self) -> &Arc<Experiment> {
        &self.experiment
    }

    /// What has made the log.
    pub fn origin(&self) -> Origin {
        self.origin
    }

    pub fn head(&self) -> Playhead {
        self.head
    }

    /// Whether what is shown goes on changing by itself.
    pub fn is_moving(&self) -> bool {
        self.head.is_playing || self.aim.is_some()
    }

    /// Whether a place is wanted that is not shown yet.
    pub fn is_late(&self) -> bool {
        self.aim.is_some() || self.ahead_s.is_some()
    }

    /// Whether nothing is left to be read: the place that is wanted, what running plots show, what happened.
    pub fn is_settled(&self) -> bool {
        let shelf = self.shared.lock();
        !self.is_late() && shelf.is_idle && shelf.wanted.is_none()
    }

    /// What was shown last.
    pub fn moment(&self) -> Arc<Moment> {
        Arc::clone(&self.moment)
    }

    pub fn told(&self) -> Told {
        let shelf = self.shared.lock();
        let searched = shelf.searched as f64 / shelf.readable.max(1) as f64;
        Told { marks: Arc::clone(&shelf.marks), searched: searched.min(1.0), torn: shelf.torn.clone() }
    }

    pub fn effort(&self) -> Effort {
        let shelf = self.shared.lock();
        Effort { chunks: self.begins_s.len(), decoded: shelf.decoded, kept: shelf.film.snapshots() }
    }

    pub fn order(&mut self, cue: Cue) {
        // What can be shown already is where this one goes from.
        if let Some(aim) = self.aim {
            self.reach(aim);
        }
        if let Some(aim) = self.head.obey(cue) {
            self.aim = Some(aim);
        }
        self.ahead_s = None;
        if !self.head.is_playing {
            self.ticker.stop();
        }
    }

    /// What running plots show of a vehicle up to the shown time; `past_s` before it from now on.
    pub fn past(&mut self, vehicle: VehicleId, past_s: f64) -> Vec<Glimpse> {
        self.past_s = past_s;
        let to_s = self.head.at_s + SAME_S;
        self.shared.lock().past.of(vehicle, to_s - past_s, to_s)
    }

    /// Goes on to an instant: what is shown then, and how far it lies from `before` (0) to `now` (1). What has
    /// not been decoded yet is shown in a later pass.
    pub fn look(&mut self, now: Instant) -> (Arc<Moment>, f64) {
        self.keep_to_what_is_readable();
        let passed_s = if self.head.is_playing { self.ticker.pass(now) } else { 0.0 };
        let missing = match self.aim {
            Some(aim) => self.reach(aim),
            None if self.head.is_playing => self.play_on(passed_s),
            None => None,
        };
        self.ask(missing, passed_s);
        (Arc::clone(&self.moment), self.weight)
    }

    /// Shows the place that is aimed at; the chunk that it has to wait for, if there is one.
    fn reach(&mut self, aim: Aim) -> Option<usize> {
        let found = {
            let shelf = self.shared.lock();
            find(&self.begins_s[..shelf.readable], aim, &mut |chunk| shelf.film.get(chunk))
        };
        match found {
            Ok(pair) => {
                self.aim = None;
                self.ahead_s = None;
                if let Some(pair) = pair {
                    self.head.at_s = pair.1.time_s;
                    self.show(pair, 1.0);
                }
                None
            }
            Err(chunk) => Some(chunk),
        }
    }

    /// Plays on for some seconds, or waits for the chunk that comes back: then the lost time is let go.
    fn play_on(&mut self, passed_s: f64) -> Option<usize> {
        let to_s = self.ahead_s.unwrap_or_else(|| self.head.after(passed_s));
        let found = {
            let shelf = self.shared.lock();
            around(&self.begins_s[..shelf.readable], to_s, &mut |chunk| shelf.film.get(chunk))
        };
        let [before, after] = match found {
            Ok(found) => found,
            Err(chunk) => {
                self.ahead_s = Some(to_s);
                return Some(chunk);
            }
        };
        self.ahead_s = None;
        self.head.at_s = to_s;
        if self.is_over() {
            self.head.is_playing = false;
            self.ticker.stop();
            self.aim = Some(Aim::Nearest(to_s));
            return self.reach(Aim::Nearest(to_s));
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

    fn show(&mut self, (before, now): Pair, weight: f64) {
        self.head.before_s = before.time_s;
        self.weight = weight;
        let phase = if self.head.is_playing { Phase::Running } else { Phase::Paused };
        let speed = Speed::Times(self.head.speed);
        self.moment = Arc::new(Moment { before, now, phase, speed, ..Moment::clone(&self.moment) });
    }

    /// Asks the thread for what is missing and for what comes next, where it has not been asked for the same.
    fn ask(&mut self, missing: Option<usize>, passed_s: f64) {
        let at_s = self.ahead_s.unwrap_or(self.head.at_s);
        let next_s = if self.head.is_playing { at_s + self.head.rate() * passed_s.max(0.02) } else { at_s };
        let chunk = missing.unwrap_or_else(|| chunk_at(&self.begins_s, at_s));
        let want = Want { chunk, next_s, past_s: self.past_s, at_s };
        let next = chunk_at(&self.begins_s, next_s) as u64;
        let is_same = self.asked.is_some_and(|(asked, asked_next)| {
            asked.chunk == chunk && asked_next == next && asked.past_s == self.past_s
        });
        // What is missing may have been let go since.
        if missing.is_some() || !is_same {
            self.asked = Some((want, next));
            self.shared.want(want);
        }
    }

    /// A log that turns out to be damaged ends before that.
    fn keep_to_what_is_readable(&mut self) {
        let (readable, known) = (self.shared.lock().readable, self.begins_s.len());
        let end_s = self.begins_s.get(readable).copied();
        if let (true, Some(end_s)) = (readable < known, end_s)
            && self.head.to_s > end_s
        {
            self.head.to_s = end_s.max(self.head.from_s);
            self.aim = self.aim.or((self.head.at_s > end_s).then_some(Aim::Nearest(end_s)));
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

impl Reader {
    /// The first and the last snapshot of the log; they stay on the shelf.
    fn ends(&mut self) -> Option<Pair> {
        let count = self.begins_s.len();
        let first = (0..count).find_map(|chunk| self.keep(chunk)?.first().cloned())?;
        let last = (0..count).rev().find_map(|chunk| self.keep(chunk)?.last().cloned())?;
        Some((first, last))
    }

    fn keep(&mut self, chunk: usize) -> Option<super::film::Stretch> {
        let known = self.shared.lock().film.get(chunk);
        let stretch = known.or_else(|| self.stretch(chunk))?;
        self.shared.lock().film.insert(chunk, Arc::clone(&stretch), chunk);
        Some(stretch)
    }

    /// Makes the acquaintance of the vehicles that the first chunk brings: mostly all of them.
    fn meet_first(&mut self) {
        for entry in self.log.read(0, Part::Happenings).unwrap_or_default() {
            self.cast.meet(&entry);
        }
    }
}
