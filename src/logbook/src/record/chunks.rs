//! Random access to the chunks of an MCAP log. It uses the chunk index in the summary section; a truncated log
//! without one is scanned by record headers.

use super::RecordError;
use super::log::{COMMAND_TOPIC, EVENT_TOPIC, NETWORK_TOPIC, SNAPSHOT_TOPIC};
use super::reader::{LARGEST_RECORD, LogEntry, LogReader, decode, no_log, why};
use mcap::McapError;
use mcap::records::op;
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use mcap::sans_io::summary_reader::{SummaryReadEvent, SummaryReader, SummaryReaderOptions};
use std::collections::{BTreeSet, HashMap};
use std::fs::File;
use std::io::{ErrorKind, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// Which entries of a chunk to decode.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EntryFilter {
    /// States of all vehicles at one tick.
    Snapshots,
    /// Events, commands of persons, and datagrams of the laboratory's link.
    Events,
}

impl EntryFilter {
    fn topics(self) -> &'static [&'static str] {
        match self {
            Self::Snapshots => &[SNAPSHOT_TOPIC],
            Self::Events => &[EVENT_TOPIC, COMMAND_TOPIC, NETWORK_TOPIC],
        }
    }
}

/// An entry of the MCAP chunk index: time span, place and channels of messages that are compressed together.
#[derive(Clone, Debug, PartialEq)]
pub struct ChunkInfo {
    /// Simulated time of its first and of its last message.
    pub from_s: f64,
    /// Simulated time of its last message, seconds.
    pub to_s: f64,
    offset: u64,
    /// Length of the record with its header, bytes.
    length: u64,
    /// Channels of its messages, where the index tells them.
    channels: Option<BTreeSet<u16>>,
}

/// An MCAP log with random access to its chunks.
#[derive(Debug)]
pub struct ChunkedLog {
    path: PathBuf,
    file: File,
    topics: HashMap<u16, String>,
    /// In order of time.
    chunks: Vec<ChunkInfo>,
    truncation: Option<String>,
}

/// Bytes of a record header: opcode and length.
const HEAD: u64 = 9;

impl ChunkedLog {
    /// Finds the chunks of a log that a reader has opened.
    ///
    /// # Errors
    /// [`RecordError::NoLog`] where the file cannot be read.
    pub fn of(reader: &LogReader, path: &Path) -> Result<Self, RecordError> {
        let failed = |error: std::io::Error| no_log(path, error);
        let mut file = File::open(path).map_err(failed)?;
        let mut topics = reader.topics().clone();
        let size = file.metadata().map_err(failed)?.len();
        let (mut chunks, truncation) = match indexed(&mut file, size, &mut topics) {
            Some(chunks) => (chunks, None),
            None => walked(&mut file, size).map_err(failed)?,
        };
        chunks.sort_by(|a, b| a.from_s.total_cmp(&b.from_s));
        Ok(Self { path: path.to_path_buf(), file, topics, chunks, truncation })
    }

    /// The chunks in order of their first times.
    pub fn chunks(&self) -> &[ChunkInfo] {
        &self.chunks
    }

    /// Why the log has no end, where it is torn.
    pub fn truncation(&self) -> Option<&str> {
        self.truncation.as_deref()
    }

    /// Whether a chunk may have something of a part; it is not read for that.
    pub fn may_have(&self, chunk: usize, part: EntryFilter) -> bool {
        let is_wanted = |id: &u16| self.is_of(*id, part);
        let channels = self.chunks.get(chunk).map(|chunk| chunk.channels.as_ref());
        channels.is_some_and(|known| known.is_none_or(|channels| channels.iter().any(is_wanted)))
    }

    fn is_of(&self, channel: u16, part: EntryFilter) -> bool {
        self.topics.get(&channel).is_some_and(|topic| part.topics().contains(&topic.as_str()))
    }

    /// What a chunk has of a part, in the order in which it was written. Nothing else of it is decoded.
    ///
    /// # Errors
    /// [`RecordError::NoLog`] where it cannot be read or is damaged.
    pub fn read(&mut self, chunk: usize, part: EntryFilter) -> Result<Vec<LogEntry>, RecordError> {
        let Some(place) = self.chunks.get(chunk) else { return Ok(Vec::new()) };
        let mut bytes = vec![0; place.length as usize];
        let read =
            self.file.seek(SeekFrom::Start(place.offset)).and_then(|_| self.file.read_exact(&mut bytes));
        read.map_err(|error| no_log(&self.path, error))?;
        let options = LinearReaderOptions::default()
            .with_skip_start_magic(true)
            .with_skip_end_magic(true)
            .with_prevalidate_chunk_crcs(true)
            .with_record_length_limit(LARGEST_RECORD);
        let mut reader = LinearReader::new_with_options(options);
        let (mut rest, mut entries) = (&bytes[..], Vec::new());
        while let Some(event) = reader.next_event() {
            match event.map_err(|error| no_log(&self.path, why(&error)))? {
                LinearReadEvent::ReadRequest(wanted) => {
                    let taken = wanted.min(rest.len());
                    reader.insert(taken).copy_from_slice(&rest[..taken]);
                    reader.notify_read(taken);
                    rest = &rest[taken..];
                }
                LinearReadEvent::Record { data, opcode: op::MESSAGE } => {
                    entries.extend(self.entry(data, part)?);
                }
                LinearReadEvent::Record { .. } => {}
            }
        }
        Ok(entries)
    }

    fn entry(&self, message: &[u8], part: EntryFilter) -> Result<Option<LogEntry>, RecordError> {
        /// Channel, sequence, and the times of logging and publishing.
        const MESSAGE_HEAD: usize = 2 + 4 + 8 + 8;
        let (Some(&[low, high]), Some(body)) = (message.first_chunk::<2>(), message.get(MESSAGE_HEAD..))
        else {
            return Err(no_log(&self.path, why(&McapError::UnexpectedEof)));
        };
        let channel = u16::from_le_bytes([low, high]);
        if !self.is_of(channel, part) {
            return Ok(None);
        }
        let topic = self.topics.get(&channel).map_or("", String::as_str);
        let entry = decode(topic, body).flatten();
        entry.map(Some).ok_or_else(|| no_log(&self.path, format!("a message of {topic} is damaged")))
    }
}

fn seconds(nanoseconds: u64) -> f64 {
    nanoseconds as f64 * 1e-9
}

/// The chunks by the chunk index of the summary section; `None` without a complete one.
fn indexed(file: &mut File, size: u64, topics: &mut HashMap<u16, String>) -> Option<Vec<ChunkInfo>> {
    let options =
        SummaryReaderOptions::default().with_file_size(size).with_record_length_limit(LARGEST_RECORD);
    let mut reader = SummaryReader::new_with_options(options);
    while let Some(event) = reader.next_event() {
        match event.ok()? {
            SummaryReadEvent::ReadRequest(wanted) => {
                let read = file.read(reader.insert(wanted)).ok()?;
                reader.notify_read(read);
            }
            SummaryReadEvent::SeekRequest(to) => reader.notify_seeked(file.seek(to).ok()?),
        }
    }
    let summary = reader.finish()?;
    let stated = summary.stats.as_ref().map(|stats| stats.chunk_count as usize);
    if summary.chunk_indexes.is_empty() || stated.is_some_and(|count| count != summary.chunk_indexes.len()) {
        return None;
    }
    topics.extend(summary.channels.iter().map(|(id, channel)| (*id, channel.topic.clone())));
    let fits = |index: &mcap::records::ChunkIndex| {
        let is_sane = index.chunk_length <= LARGEST_RECORD as u64;
        is_sane && index.chunk_start_offset.checked_add(index.chunk_length).is_some_and(|end| end <= size)
    };
    let chunk = |index: &mcap::records::ChunkIndex| ChunkInfo {
        from_s: seconds(index.message_start_time),
        to_s: seconds(index.message_end_time),
        offset: index.chunk_start_offset,
        length: index.chunk_length,
        channels: (!index.message_index_offsets.is_empty())
            .then(|| index.message_index_offsets.keys().copied().collect()),
    };
    summary.chunk_indexes.iter().all(fits).then(|| summary.chunk_indexes.iter().map(chunk).collect())
}

/// The complete chunks of a file without an index, and why it is truncated.
fn walked(file: &mut File, size: u64) -> std::io::Result<(Vec<ChunkInfo>, Option<String>)> {
    let truncation = |chunks, error: McapError| Ok((chunks, Some(why(&error))));
    let mut chunks: Vec<ChunkInfo> = Vec::new();
    let mut offset = mcap::MAGIC.len() as u64;
    loop {
        // Opcode and length; for a chunk also the times of its messages.
        let mut head = [0; HEAD as usize + 16];
        file.seek(SeekFrom::Start(offset))?;
        let there = fill(file, &mut head)?;
        let number =
            |from: usize| head[from..from + 8].iter().rev().fold(0, |sum, byte| sum << 8 | u64::from(*byte));
        let length = number(1);
        if (there as u64) < HEAD || length > size - offset - HEAD {
            return truncation(chunks, McapError::UnexpectedEof);
        }
        match head[0] {
            op::DATA_END => return Ok((chunks, None)),
            op::CHUNK if length > LARGEST_RECORD as u64 || length < 16 => {
                return truncation(chunks, McapError::UnexpectedEoc);
            }
            op::CHUNK => chunks.push(ChunkInfo {
                from_s: seconds(number(HEAD as usize)),
                to_s: seconds(number(HEAD as usize + 8)),
                offset,
                length: HEAD + length,
                channels: None,
            }),
            _ => {}
        }
        offset += HEAD + length;
    }
}

/// Fills the buffer as far as the file goes.
fn fill(file: &mut File, buffer: &mut [u8]) -> std::io::Result<usize> {
    let mut there = 0;
    while there < buffer.len() {
        match file.read(&mut buffer[there..]) {
            Ok(0) => break,
            Ok(read) => there += read,
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    Ok(there)
}
