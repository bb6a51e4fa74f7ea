//! Writes the files of a run on a writer thread. A bounded channel gives back-pressure: a full one blocks the
//! simulation until the disk catches up.

use super::log::CommandKind;
use super::{LogOrigin, LogWriter, NetworkCommand, VehicleTable};
use city3d_protocol::snapshot::{Event, FrameSnapshot, SimCommand, VehicleState};
use city3d_simulation::scenario::Experiment;
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
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
    },
    /// The writer thread has ended before the run.
    #[error("the recorder's thread ended early")]
    Thread,
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
        kind: CommandKind,
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
        let size = self.bytes.len() + self.vehicles * size_of::<VehicleState>();
        size >= BATCH_BYTES || self.items.len() >= BATCH_ITEMS
    }
}

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
/// Capacity of the channel: the simulation does not wait for the compression of each chunk, but for a slow disk
/// (back-pressure) rather than exhaust the memory.
const BATCH_QUEUE: usize = 32;

/// Writes `run.mcap` and `vehicles.csv` into a folder.
#[derive(Debug)]
pub struct Recorder {
    batches: Option<SyncSender<Batch>>,
    /// Not sent yet.
    batch: Batch,
    written: Receiver<Batch>,
    thread: Option<JoinHandle<Result<(), RecordError>>>,
    cadence: Cadence,
}

impl Recorder {
    /// Begins both files.
    ///
    /// # Errors
    /// When a file cannot be created.
    pub fn new(
        folder: &Path,
        experiment: &Experiment,
        origin: LogOrigin,
        cadence: Cadence,
    ) -> Result<Self, RecordError> {
        let (log_path, table_path) = (folder.join("run.mcap"), folder.join("vehicles.csv"));
        let create = |path: &Path| File::create(path).map(BufWriter::new).map_err(|e| failed(path, e));
        let log = LogWriter::new(create(&log_path)?, experiment, origin).map_err(|e| failed(&log_path, e))?;
        let table = VehicleTable::new(create(&table_path)?).map_err(|e| failed(&table_path, e))?;
        let (batches, queue) = sync_channel(BATCH_QUEUE);
        let (recycle, written) = sync_channel(BATCH_QUEUE);
        let files = RunFileWriter { log, table, log_path, table_path };
        let thread = std::thread::Builder::new()
            .name("recorder".to_owned())
            .spawn(move || files.write_all(&queue, &recycle))
            .map_err(|error| failed(folder, error))?;
        let batch = Batch::default();
        Ok(Self { batches: Some(batches), batch, written, thread: Some(thread), cadence })
    }

    /// Records a tick: its digest, its events, and its snapshot when one is due.
    ///
    /// # Errors
    /// What went wrong when a file could not be written.
    pub fn record(&mut self, snapshot: &FrameSnapshot, events: &[Event]) -> Result<(), RecordError> {
        let FrameSnapshot { tick, time_s, state_hash, .. } = *snapshot;
        let items = &mut self.batch.items;
        items.extend(events.iter().cloned().map(Item::Event));
        items.push(Item::Tick { tick, time_s, state_hash });
        let in_log = tick.is_multiple_of(self.cadence.log_ticks);
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
            if let Some(kind) = CommandKind::encode(tick, command, bytes) {
                let length = bytes.len() - start;
                self.batch.items.push(Item::Command { kind, time_s, length });
            }
        }
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
        let empty = self.written.try_recv().unwrap_or_default();
        let full = std::mem::replace(&mut self.batch, empty);
        let is_sent = self.batches.as_ref().is_some_and(|batches| batches.send(full).is_ok());
        if is_sent { Ok(()) } else { self.join().and(Err(RecordError::Thread)) }
    }

    /// Writes what is left and closes the files.
    ///
    /// # Errors
    /// What went wrong when a file could not be written.
    pub fn finish(mut self) -> Result<(), RecordError> {
        self.send_batch()?;
        self.join()
    }

    fn join(&mut self) -> Result<(), RecordError> {
        self.batches = None;
        let Some(thread) = self.thread.take() else { return Ok(()) };
        thread.join().unwrap_or(Err(RecordError::Thread))
    }
}

#[allow(clippy::needless_pass_by_value, reason = "the shape that map_err wants")]
fn failed(path: &Path, reason: impl ToString) -> RecordError {
    RecordError::File { path: path.to_path_buf(), reason: reason.to_string() }
}

struct RunFileWriter {
    log: LogWriter<BufWriter<File>>,
    table: VehicleTable<BufWriter<File>>,
    log_path: PathBuf,
    table_path: PathBuf,
}

impl RunFileWriter {
    fn write_all(mut self, queue: &Receiver<Batch>, recycle: &SyncSender<Batch>) -> Result<(), RecordError> {
        for mut batch in queue {
            self.write(&mut batch)?;
            // A full return channel only costs an allocation.
            let _ = recycle.try_send(batch);
        }
        self.log.finish().map_err(|e| failed(&self.log_path, e))?;
        self.table.finish().map_err(|e| failed(&self.table_path, e))
    }

    /// Writes a batch and leaves it empty.
    fn write(&mut self, batch: &mut Batch) -> Result<(), RecordError> {
        let (log_failed, mut messages) = (|error| failed(&self.log_path, error), &batch.bytes[..]);
        for item in batch.items.drain(..) {
            match item {
                Item::Event(event) => self.log.event(&event).map_err(log_failed)?,
                Item::Command { kind, time_s, length } => {
                    let (message, rest) = messages.split_at(length);
                    messages = rest;
                    self.log.encoded(kind, time_s, message).map_err(log_failed)?;
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
