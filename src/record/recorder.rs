//! Writes the files of a run off the simulation's thread, through a bounded channel.

use super::{LogWriter, NetworkCommand, Origin, VehicleTable};
use crate::scenario::Experiment;
use crate::snapshot::{Event, FrameSnapshot, SimCommand};
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;
use thiserror::Error;

/// A file of a run that cannot be written.
#[derive(Debug, Error)]
pub enum RecordError {
    #[error("{path}: cannot be written: {reason}")]
    File { path: PathBuf, reason: String },
    #[error("the recorder's thread ended early")]
    Thread,
    #[error("{path}: line {line}: {reason}")]
    Poses { path: PathBuf, line: u64, reason: String },
    #[error("{path}: no log of City3D: {reason}")]
    NoLog { path: PathBuf, reason: String },
    #[error("{path}: no bag of poses: {reason}")]
    NoBag { path: PathBuf, reason: String },
}

#[derive(Debug)]
enum Item {
    Snapshot { snapshot: Box<FrameSnapshot>, in_log: bool, in_table: bool },
    Event(Event),
    Commands { tick: u64, time_s: f64, commands: Vec<SimCommand> },
    Tick { tick: u64, time_s: f64, state_hash: u64 },
    Network { time_s: f64, command: NetworkCommand },
    Flush,
}

/// What is written how often, in ticks.
#[derive(Clone, Copy, Debug)]
pub struct Cadence {
    pub log_ticks: u64,
    pub table_ticks: u64,
    /// What has come is on the disk after so many ticks at the latest, as far as a killed process is
    /// concerned.
    pub flush_ticks: u64,
}

/// Items are handed over so many at a time: waking the writer for each costs more than making it.
const BATCH: usize = 16;
/// Batches that may wait to be written, some hundred ticks: the simulation waits for the disk rather than fill memory, but
/// not for each chunk that is compressed.
const QUEUE: usize = 64;

/// Writes `run.mcap` and `vehicles.csv` into a folder.
#[derive(Debug)]
pub struct Recorder {
    items: Option<SyncSender<Vec<Item>>>,
    /// Not yet handed over.
    batch: Vec<Item>,
    spent: Receiver<Box<FrameSnapshot>>,
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
        origin: Origin,
        cadence: Cadence,
    ) -> Result<Self, RecordError> {
        let (log_path, table_path) = (folder.join("run.mcap"), folder.join("vehicles.csv"));
        let create = |path: &Path| File::create(path).map(BufWriter::new).map_err(|e| failed(path, e));
        let log = LogWriter::new(create(&log_path)?, experiment, origin).map_err(|e| failed(&log_path, e))?;
        let table = VehicleTable::new(create(&table_path)?).map_err(|e| failed(&table_path, e))?;
        let (items, queue) = sync_channel(QUEUE);
        let (give_back, spent) = sync_channel(QUEUE * BATCH);
        let files = Files { log, table, log_path, table_path };
        let thread = std::thread::Builder::new()
            .name("recorder".to_owned())
            .spawn(move || files.write_all(&queue, &give_back))
            .map_err(|error| failed(folder, error))?;
        Ok(Self { items: Some(items), batch: Vec::new(), spent, thread: Some(thread), cadence })
    }

    /// Takes a tick in: its snapshot when one is due, and its events.
    ///
    /// # Errors
    /// What went wrong when a file could not be written.
    pub fn record(&mut self, snapshot: &FrameSnapshot, events: &[Event]) -> Result<(), RecordError> {
        for event in events {
            self.send(Item::Event(event.clone()))?;
        }
        let FrameSnapshot { tick, time_s, state_hash, .. } = *snapshot;
        self.send(Item::Tick { tick, time_s, state_hash })?;
        let in_log = snapshot.tick.is_multiple_of(self.cadence.log_ticks);
        let in_table = snapshot.tick.is_multiple_of(self.cadence.table_ticks);
        if in_log || in_table {
            let mut copy = self.spent.try_recv().unwrap_or_default();
            copy.assign(snapshot);
            self.send(Item::Snapshot { snapshot: copy, in_log, in_table })?;
        }
        if snapshot.tick.is_multiple_of(self.cadence.flush_ticks) {
            self.send(Item::Flush)?;
            self.hand_over()?;
        }
        Ok(())
    }

    /// Takes the commands in that the step which begins at a tick applies, in their order.
    ///
    /// # Errors
    /// What went wrong when a file could not be written.
    pub fn commands(&mut self, tick: u64, time_s: f64, commands: &[SimCommand]) -> Result<(), RecordError> {
        if commands.is_empty() {
            return Ok(());
        }
        self.send(Item::Commands { tick, time_s, commands: commands.to_vec() })
    }

    /// Takes in what came over the laboratory's link.
    ///
    /// # Errors
    /// What went wrong when a file could not be written.
    pub fn network(&mut self, time_s: f64, command: NetworkCommand) -> Result<(), RecordError> {
        self.send(Item::Network { time_s, command })
    }

    fn send(&mut self, item: Item) -> Result<(), RecordError> {
        self.batch.push(item);
        if self.batch.len() < BATCH { Ok(()) } else { self.hand_over() }
    }

    fn hand_over(&mut self) -> Result<(), RecordError> {
        let batch = std::mem::take(&mut self.batch);
        let is_sent = self.items.as_ref().is_some_and(|items| items.send(batch).is_ok());
        if is_sent { Ok(()) } else { self.join().and(Err(RecordError::Thread)) }
    }

    /// Writes what is left and closes the files.
    ///
    /// # Errors
    /// What went wrong when a file could not be written.
    pub fn finish(mut self) -> Result<(), RecordError> {
        self.hand_over()?;
        self.join()
    }

    fn join(&mut self) -> Result<(), RecordError> {
        self.items = None;
        let Some(thread) = self.thread.take() else { return Ok(()) };
        thread.join().unwrap_or(Err(RecordError::Thread))
    }
}

#[allow(clippy::needless_pass_by_value, reason = "the shape that map_err wants")]
fn failed(path: &Path, reason: impl ToString) -> RecordError {
    RecordError::File { path: path.to_path_buf(), reason: reason.to_string() }
}

struct Files {
    log: LogWriter<BufWriter<File>>,
    table: VehicleTable<BufWriter<File>>,
    log_path: PathBuf,
    table_path: PathBuf,
}

impl Files {
    fn write_all(
        mut self,
        queue: &Receiver<Vec<Item>>,
        give_back: &SyncSender<Box<FrameSnapshot>>,
    ) -> Result<(), RecordError> {
        for item in queue.iter().flatten() {
            match item {
                Item::Event(event) => self.log.event(&event).map_err(|e| failed(&self.log_path, e))?,
                Item::Commands { tick, time_s, commands } => {
                    for command in &commands {
                        self.log.command(tick, time_s, command).map_err(|e| failed(&self.log_path, e))?;
                    }
                }
                Item::Tick { tick, time_s, state_hash } => {
                    self.log.tick(tick, time_s, state_hash).map_err(|e| failed(&self.log_path, e))?;
                }
                Item::Network { time_s, command } => {
                    self.log.network(time_s, &command).map_err(|e| failed(&self.log_path, e))?;
                }
                Item::Flush => {
                    self.log.flush().map_err(|e| failed(&self.log_path, e))?;
                    self.table.flush().map_err(|e| failed(&self.table_path, e))?;
                }
                Item::Snapshot { snapshot, in_log, in_table } => {
                    if in_log {
                        self.log.snapshot(&snapshot).map_err(|e| failed(&self.log_path, e))?;
                    }
                    if in_table {
                        self.table.rows(&snapshot).map_err(|e| failed(&self.table_path, e))?;
                    }
                    // A full return channel only means that the buffer is made anew.
                    let _ = give_back.try_send(snapshot);
                }
            }
        }
        self.log.finish().map_err(|e| failed(&self.log_path, e))?;
        self.table.finish().map_err(|e| failed(&self.table_path, e))
    }
}
