//! Writes the files of a run on a writer thread, behind a bounded channel. What a full channel does is the caller's
//! choice: a run without a clock waits for the disk (back-pressure), a city that keeps real time goes on without files.

use super::decisions::encode_decisions;
use super::plans::encode_plans;
use super::{LogOrigin, LogTopic, LogWriter, NetworkCommand, VehicleTable};
use city3d_outputs::OutputFolder;
use city3d_protocol::snapshot::{
    ControlDecision, CoordinationUpdate, Event, FrameSnapshot, SimCommand, VehicleState,
};
use city3d_simulation::scenario::Experiment;
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use thiserror::Error;

/// A file of a run that cannot be written or read.
#[derive(Debug, Error)]
pub enum RecordError {
    /// A file cannot be created or written.
    #[error("{path}: cannot be written: {reason}")]
    File {
        /// Path of the file, or the folder of the run where the writer thread cannot start.
        path: PathBuf,
        /// Reason of the failure, in words.
        reason: String,
        /// What the file's writer or the operating system says.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
    /// The writer thread has ended before the run.
    #[error("the recorder's thread ended early")]
    Thread,
    /// The disk takes less than the run writes, so that its files end early.
    #[error("{path}: the disk is too slow for this run; the files end at {time_s:.2} s")]
    Slow {
        /// The folder of the run.
        path: PathBuf,
        /// Simulated time up to which the files are whole.
        time_s: f64,
    },
    /// What comes before or after the files could not be done.
    #[error(transparent)]
    Around(AroundError),
    /// A table of poses cannot be read, or has a fault in this line.
    #[error("{path}: line {line}: {reason}")]
    Poses {
        /// Path of the table.
        path: PathBuf,
        /// Line of the file, counted from 1; 1 where the file cannot be opened.
        line: u64,
        /// Fault of that line, in words.
        reason: String,
    },
    /// A file cannot be read at all.
    #[error("{path}: cannot be read: {reason}")]
    Unreadable {
        /// Path of the file.
        path: PathBuf,
        /// What the operating system says, or why the file is refused.
        reason: std::io::Error,
    },
    /// A file cannot be read as a log.
    #[error("{path}: not a log of City3D: {reason}")]
    NoLog {
        /// Path of the file.
        path: PathBuf,
        /// What makes it unreadable as a log, in words.
        reason: String,
    },
    /// A file cannot be read as a bag, or has no pose of the named vehicles.
    #[error("{path}: not a bag of poses: {reason}")]
    NoBag {
        /// Path of the file.
        path: PathBuf,
        /// What is damaged or missing in it, in words.
        reason: String,
    },
}

#[derive(Debug)]
enum Item {
    Snapshot {
        snapshot: FrameSnapshot,
        in_log: bool,
        in_table: bool,
    },
    Event(Event),
    /// The message is the next `length` bytes of the batch.
    Command {
        topic: LogTopic,
        time_s: f64,
        length: usize,
    },
    Tick {
        tick: u64,
        time_s: f64,
        state_hash: u64,
    },
    Network {
        time_s: f64,
        command: NetworkCommand,
    },
    Flush,
}

/// Items that are sent at once. Batches come back empty for reuse (object pool).
///
/// Commands are encoded before they are sent: copies would be allocated by one thread and freed by the other, which
/// costs the run more than the encoding.
#[derive(Debug, Default)]
struct Batch {
    items: Vec<Item>,
    /// The encoded commands, concatenated.
    bytes: Vec<u8>,
    /// Number of vehicles in its snapshots.
    vehicles: usize,
    /// Written snapshots, for reuse of their memory.
    recycled: Vec<FrameSnapshot>,
}

impl Batch {
    fn is_full(&self) -> bool {
        self.size() >= BATCH_BYTES || self.items.len() >= BATCH_ITEMS
    }

    /// Memory of its contents, bytes.
    fn size(&self) -> usize {
        self.bytes.len() + self.vehicles * size_of::<VehicleState>() + self.items.len() * size_of::<Item>()
    }
}

/// What a run does when its disk is slower than it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Backpressure {
    /// It waits: nothing is lost, and the run takes longer.
    #[default]
    Wait,
    /// It goes on, and its files end: for a city that keeps real time.
    GiveUp,
}

/// Gives the folder of the files, which the writer thread keeps locked until they are closed.
pub type FolderWork = Box<dyn FnOnce() -> Result<Arc<OutputFolder>, AroundError> + Send>;

/// Something that the writer thread does after the files.
pub type FileWork = Box<dyn FnOnce() -> Result<(), AroundError> + Send>;

/// Why work before or after the files cannot be done.
pub type AroundError = Box<dyn std::error::Error + Send + Sync>;

/// Intervals of log, table and flush, in ticks.
#[derive(Clone, Copy, Debug)]
pub struct Cadence {
    /// Ticks from one snapshot in the log to the next.
    pub log_ticks: u64,
    /// Ticks from one sample of the table to the next.
    pub table_ticks: u64,
    /// A killed process loses at most this many ticks.
    pub flush_ticks: u64,
}

/// A batch is sent at this size: waking the writer takes ten microseconds.
const BATCH_BYTES: usize = 512 << 10;
/// A batch is sent at this number of items, where they are small.
const BATCH_ITEMS: usize = 4096;
/// Capacity of the channel: the simulation does not wait for the compression of each chunk, but does not exhaust the
/// memory behind a slow disk either.
const BATCH_QUEUE: usize = 32;
/// Empty batches that are kept: what a slow disk has made necessary once is not needed for ever.
const RECYCLED_BATCHES: usize = 4;
/// Without back-pressure, this much waits behind a full channel before the files end.
const BACKLOG_BYTES: usize = 32 << 20;

/// Writes `run.mcap` and `vehicles.csv` into a folder.
#[derive(Debug)]
pub struct Recorder {
    folder: PathBuf,
    batches: Option<SyncSender<Batch>>,
    /// Not sent yet.
    batch: Batch,
    written: Receiver<Batch>,
    /// What the thread writes last.
    last: Arc<Mutex<Option<LastWork>>>,
    thread: Option<JoinHandle<Result<(), RecordError>>>,
    cadence: Cadence,
    backpressure: Backpressure,
    /// Simulated time of the last tick.
    time_s: f64,
}

/// The end of the files: it does not wait for room in the channel.
struct LastWork {
    batch: Batch,
    after: FileWork,
}

impl std::fmt::Debug for LastWork {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("LastWork").field("batch", &self.batch).finish_non_exhaustive()
    }
}

/// Files that are being closed by their writer thread.
#[derive(Debug)]
pub struct ClosingFiles(JoinHandle<Result<(), RecordError>>);

impl ClosingFiles {
    /// Does what is left to do for the files of a run on a thread of its own.
    ///
    /// # Errors
    /// When the operating system refuses the thread; `folder` is that of the run.
    pub fn by_thread(folder: &Path, work: FileWork) -> Result<Self, RecordError> {
        let thread = std::thread::Builder::new().name("recorder".to_owned());
        let thread = thread.spawn(move || work().map_err(RecordError::Around));
        thread.map(Self).map_err(|error| failed(folder, error))
    }

    /// Whether they are closed, so that [`ClosingFiles::join`] does not wait.
    pub fn is_closed(&self) -> bool {
        self.0.is_finished()
    }

    /// Waits until they are closed.
    ///
    /// # Errors
    /// What went wrong when a file could not be written.
    pub fn join(self) -> Result<(), RecordError> {
        self.0.join().unwrap_or(Err(RecordError::Thread))
    }
}

impl Recorder {
    /// Begins both files.
    ///
    /// `prepare` locks their folder. With [`Backpressure::GiveUp`] the writer thread does that and opens them, so that no
    /// disk delays the caller; an error shows with a later call.
    ///
    /// # Errors
    /// When a file cannot be created.
    pub fn new(
        folder: &Path,
        experiment: &Arc<Experiment>,
        origin: LogOrigin,
        cadence: Cadence,
        (backpressure, prepare): (Backpressure, FolderWork),
    ) -> Result<Self, RecordError> {
        let (batches, queue) = sync_channel(BATCH_QUEUE);
        let (recycle, written) = sync_channel(RECYCLED_BATCHES);
        let last = Arc::new(Mutex::new(None));
        let of_thread = Arc::clone(&last);
        let experiment = Arc::clone(experiment);
        let open = move || {
            let folder = prepare().map_err(RecordError::Around)?;
            RunFileWriter::create(folder, &experiment, origin)
        };
        let thread = std::thread::Builder::new().name("recorder".to_owned());
        let thread = match backpressure {
            Backpressure::Wait => {
                let files = open()?;
                thread.spawn(move || files.write_all(&queue, &recycle, &of_thread))
            }
            Backpressure::GiveUp => thread.spawn(move || open()?.write_all(&queue, &recycle, &of_thread)),
        };
        Ok(Self {
            folder: folder.to_path_buf(),
            batches: Some(batches),
            batch: Batch::default(),
            written,
            last,
            thread: Some(thread.map_err(|error| failed(folder, error))?),
            cadence,
            backpressure,
            time_s: 0.0,
        })
    }

    /// Records a tick: its digest, its events, and its snapshot when one is due. The log has that of a collision besides, so
    /// that the moment of the impact can be shown.
    ///
    /// # Errors
    /// What went wrong when a file could not be written.
    pub fn record(&mut self, snapshot: &FrameSnapshot, events: &[Event]) -> Result<(), RecordError> {
        let FrameSnapshot { tick, time_s, state_hash, .. } = *snapshot;
        self.time_s = time_s;
        let items = &mut self.batch.items;
        items.extend(events.iter().cloned().map(Item::Event));
        items.push(Item::Tick { tick, time_s, state_hash });
        let in_log = tick.is_multiple_of(self.cadence.log_ticks)
            || events.iter().any(|event| event.kind.is_collision());
        let in_table = tick.is_multiple_of(self.cadence.table_ticks);
        if in_log || in_table {
            let mut copy = self.batch.recycled.pop().unwrap_or_default();
            copy.assign(snapshot);
            items.push(Item::Snapshot { snapshot: copy, in_log, in_table });
            self.batch.vehicles += snapshot.vehicles.len();
        }
        let is_flushed = tick.is_multiple_of(self.cadence.flush_ticks);
        if is_flushed {
            items.push(Item::Flush);
        }
        if is_flushed || self.batch.is_full() { self.send_batch() } else { Ok(()) }
    }

    /// Records the commands that the step after a tick applies, in their order.
    pub fn commands(&mut self, tick: u64, time_s: f64, commands: &[SimCommand]) {
        for command in commands {
            let bytes = &mut self.batch.bytes;
            let start = bytes.len();
            if let Some(topic) = LogTopic::encode(tick, command, bytes) {
                let length = bytes.len() - start;
                self.batch.items.push(Item::Command { topic, time_s, length });
            }
        }
    }

    /// Records decisions of the control framework that hold in the snapshot of a tick, before that is recorded; none where
    /// there are none.
    pub fn decisions(&mut self, (tick, time_s): (u64, f64), decisions: &[ControlDecision]) {
        if !decisions.is_empty() {
            self.note(LogTopic::Decisions, time_s, |bytes| encode_decisions(tick, time_s, decisions, bytes));
        }
    }

    /// Records plans through control zones that hold in the snapshot of a tick, before that is recorded; none where there
    /// are none.
    pub fn plans(&mut self, (tick, time_s): (u64, f64), update: &CoordinationUpdate) {
        if !update.is_empty() {
            self.note(LogTopic::Plans, time_s, |bytes| encode_plans(tick, time_s, update, bytes));
        }
    }

    fn note(&mut self, topic: LogTopic, time_s: f64, encode: impl FnOnce(Vec<u8>) -> Vec<u8>) {
        let bytes = &mut self.batch.bytes;
        let start = bytes.len();
        *bytes = encode(std::mem::take(bytes));
        let length = bytes.len() - start;
        self.batch.items.push(Item::Command { topic, time_s, length });
    }

    /// Records a datagram that was carried out.
    ///
    /// # Errors
    /// What went wrong when a file could not be written.
    pub fn network(&mut self, time_s: f64, command: NetworkCommand) -> Result<(), RecordError> {
        self.batch.items.push(Item::Network { time_s, command });
        // A paused city has no ticks that would send the batch.
        if self.batch.is_full() { self.send_batch() } else { Ok(()) }
    }

    fn send_batch(&mut self) -> Result<(), RecordError> {
        let Some(batches) = &self.batches else { return Err(RecordError::Thread) };
        let empty = self.written.try_recv().unwrap_or_default();
        let full = std::mem::replace(&mut self.batch, empty);
        let sent = match self.backpressure {
            Backpressure::Wait => batches.send(full).map_err(|_| None),
            Backpressure::GiveUp => batches.try_send(full).map_err(|error| match error {
                TrySendError::Full(full) => Some(full),
                TrySendError::Disconnected(_) => None,
            }),
        };
        match sent {
            Ok(()) => Ok(()),
            // The thread has ended, and says why.
            Err(None) => self.join().and(Err(RecordError::Thread)),
            Err(Some(full)) => {
                self.batch = full;
                if self.batch.size() < BACKLOG_BYTES {
                    return Ok(());
                }
                // What waits is lost; what was sent is written whole.
                self.batch = Batch::default();
                self.batches = None;
                Err(RecordError::Slow { path: self.folder.clone(), time_s: self.time_s })
            }
        }
    }

    /// Writes what is left and closes the files.
    ///
    /// # Errors
    /// What went wrong when a file could not be written.
    pub fn finish(self) -> Result<(), RecordError> {
        self.close(Box::new(|| Ok(())))?.join()
    }

    /// Lets the writer thread write what is left, close the files, and do the work `after`; does not wait for it.
    ///
    /// # Errors
    /// What went wrong when the thread had ended before.
    pub fn close(mut self, after: FileWork) -> Result<ClosingFiles, RecordError> {
        let batch = std::mem::take(&mut self.batch);
        *self.last.lock().unwrap_or_else(PoisonError::into_inner) = Some(LastWork { batch, after });
        self.batches = None;
        self.thread.take().map(ClosingFiles).ok_or(RecordError::Thread)
    }

    /// Waits for the thread; only called where it has ended.
    fn join(&mut self) -> Result<(), RecordError> {
        self.batches = None;
        let Some(thread) = self.thread.take() else { return Ok(()) };
        thread.join().unwrap_or(Err(RecordError::Thread))
    }
}

fn failed(path: &Path, error: impl std::error::Error + Send + Sync + 'static) -> RecordError {
    let mut reason = error.to_string();
    // What the system says, such as that a disk is full, may be behind it.
    let mut cause = error.source();
    while let Some(behind) = cause {
        let words = behind.to_string();
        if !reason.contains(&words) {
            reason = format!("{reason}: {words}");
        }
        cause = behind.source();
    }
    RecordError::File { path: path.to_path_buf(), reason, source: Box::new(error) }
}

struct RunFileWriter {
    log: LogWriter<BufWriter<File>>,
    table: VehicleTable<BufWriter<File>>,
    log_path: PathBuf,
    table_path: PathBuf,
    /// Keeps other writers out.
    _folder: Arc<OutputFolder>,
}

impl RunFileWriter {
    fn create(
        folder: Arc<OutputFolder>,
        experiment: &Experiment,
        origin: LogOrigin,
    ) -> Result<Self, RecordError> {
        let (log_path, table_path) = (folder.path().join("run.mcap"), folder.path().join("vehicles.csv"));
        let create = |path: &Path| File::create(path).map(BufWriter::new).map_err(|e| failed(path, e));
        let log = LogWriter::new(create(&log_path)?, experiment, origin, folder.path());
        let log = log.map_err(|e| failed(&log_path, e))?;
        let table = VehicleTable::new(create(&table_path)?).map_err(|e| failed(&table_path, e))?;
        Ok(Self { log, table, log_path, table_path, _folder: folder })
    }

    fn write_all(
        mut self,
        queue: &Receiver<Batch>,
        recycle: &SyncSender<Batch>,
        last: &Mutex<Option<LastWork>>,
    ) -> Result<(), RecordError> {
        for mut batch in queue {
            self.write(&mut batch)?;
            // A full return channel only costs an allocation.
            let _ = recycle.try_send(batch);
        }
        let last = last.lock().unwrap_or_else(PoisonError::into_inner).take();
        let after = match last {
            Some(LastWork { mut batch, after }) => {
                self.write(&mut batch)?;
                Some(after)
            }
            None => None,
        };
        self.log.finish().map_err(|e| failed(&self.log_path, e))?;
        self.table.finish().map_err(|e| failed(&self.table_path, e))?;
        after.map_or(Ok(()), |after| after().map_err(RecordError::Around))
    }

    /// Writes a batch and leaves it empty.
    fn write(&mut self, batch: &mut Batch) -> Result<(), RecordError> {
        let (log_failed, mut messages) = (|error| failed(&self.log_path, error), &batch.bytes[..]);
        for item in batch.items.drain(..) {
            match item {
                Item::Event(event) => self.log.event(&event).map_err(log_failed)?,
                Item::Command { topic, time_s, length } => {
                    let (message, rest) = messages.split_at(length);
                    messages = rest;
                    self.log.encoded(topic, time_s, message).map_err(log_failed)?;
                }
                Item::Tick { tick, time_s, state_hash } => {
                    self.log.tick(tick, time_s, state_hash).map_err(log_failed)?;
                }
                Item::Network { time_s, command } => {
                    self.log.network(time_s, &command).map_err(log_failed)?;
                }
                Item::Flush => {
                    self.log.flush().map_err(log_failed)?;
                    self.table.flush().map_err(|e| failed(&self.table_path, e))?;
                }
                Item::Snapshot { snapshot, in_log, in_table } => {
                    if in_log {
                        self.log.snapshot(&snapshot).map_err(log_failed)?;
                    }
                    if in_table {
                        self.table.rows(&snapshot).map_err(|e| failed(&self.table_path, e))?;
                    }
                    batch.recycled.push(snapshot);
                }
            }
        }
        batch.bytes.clear();
        batch.vehicles = 0;
        Ok(())
    }
}
