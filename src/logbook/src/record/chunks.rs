//! Random access to the chunks of an MCAP log. It uses the chunk index in the summary section; a log without one, or with
//! a damaged one, is scanned by record headers.

use super::budget::DecompressionBudget;
use super::decisions::DECISIONS_TOPIC;
use super::log::{COMMAND_TOPIC, EVENT_TOPIC, NETWORK_TOPIC, SNAPSHOT_TOPIC};
use super::plans::PLANS_TOPIC;
use super::reader::{LogEntry, LogReader, decode, no_log};
use super::records::{
    ChunkHead, HEAD, LARGEST_RECORD, Truncation, chunk_reader, describe, is_ended, parse_checked,
};
use super::{RecordError, input};
use mcap::records::{Record, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use std::collections::{BTreeSet, HashMap};
use std::fs::File;
use std::io::{ErrorKind, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// Which entries of a chunk to decode.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EntryFilter {
    /// States of all vehicles at one tick, and what the control framework tells.
    Snapshots,
    /// Events, commands of persons, and datagrams of the laboratory's link.
    Events,
    /// What the control framework tells alone: decisions and plans.
    Control,
}

impl EntryFilter {
    fn topics(self) -> &'static [&'static str] {
        match self {
            Self::Snapshots => &[SNAPSHOT_TOPIC, DECISIONS_TOPIC, PLANS_TOPIC],
            Self::Events => &[EVENT_TOPIC, COMMAND_TOPIC, NETWORK_TOPIC],
            Self::Control => &[DECISIONS_TOPIC, PLANS_TOPIC],
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
    /// Place of the record in the file.
    offset: u64,
    /// Length of the record with its opcode and length, bytes.
    length: u64,
    head: ChunkHead,
    /// Channels of its messages, where the index tells them.
    channels: Option<BTreeSet<u16>>,
}

impl ChunkInfo {
    /// A chunk at a place, with a record of so many bytes.
    ///
    /// # Errors
    /// What cannot be right, in words.
    fn new(offset: u64, length: u64, head: ChunkHead) -> Result<Self, String> {
        if head.from_ns > head.to_ns {
            return Err(format!("the chunk at byte {offset} ends before it begins"));
        }
        if length < HEAD + ChunkHead::SIZE as u64 || length > HEAD + LARGEST_RECORD as u64 {
            return Err(format!("the chunk at byte {offset} has {length} bytes"));
        }
        let (from_s, to_s) = (seconds(head.from_ns), seconds(head.to_ns));
        Ok(Self { from_s, to_s, offset, length, head, channels: None })
    }

    /// Whether a snapshot of a time may be in it.
    fn has(&self, time_s: f64) -> bool {
        /// Times of messages are in nanoseconds.
        const TOLERANCE_S: f64 = 1e-6;
        (self.from_s - TOLERANCE_S..=self.to_s + TOLERANCE_S).contains(&time_s)
    }
}

/// An MCAP log with random access to its chunks.
#[derive(Debug)]
pub struct ChunkedLog {
    path: PathBuf,
    file: File,
    topics: HashMap<u16, String>,
    /// In order of time.
    chunks: Vec<ChunkInfo>,
    truncation: Option<Truncation>,
}

impl ChunkedLog {
    /// Finds the chunks of a log that a reader has opened.
    ///
    /// # Errors
    /// [`RecordError::NoLog`] where the file cannot be read, or its chunks grow too large.
    pub fn of(reader: &LogReader, path: &Path) -> Result<Self, RecordError> {
        let failed = |error: std::io::Error| no_log(path, error);
        let (mut file, size) = input::open(path).map_err(failed)?;
        let mut topics = reader.topics().clone();
        let index = indexed(&mut file, size).unwrap_or_else(|damage| {
            tracing::warn!(
                "{}: the index of the log is damaged: {damage}; the log is read from its front",
                path.display()
            );
            None
        });
        let (mut chunks, truncation) = match index {
            Some(index) => {
                topics.extend(index.topics);
                (index.chunks, None)
            }
            None => walked(&mut file, size).map_err(failed)?,
        };
        let mut budget = DecompressionBudget::of_file(size);
        for chunk in &chunks {
            budget.take(chunk.head.uncompressed_size).map_err(|error| no_log(path, error))?;
        }
        chunks.sort_by(|a, b| a.from_s.total_cmp(&b.from_s));
        Ok(Self { path: path.to_path_buf(), file, topics, chunks, truncation })
    }

    /// The chunks in order of their first times.
    pub fn chunks(&self) -> &[ChunkInfo] {
        &self.chunks
    }

    /// Why the log was not read up to its end, if it was not.
    pub fn truncation(&self) -> Option<&Truncation> {
        self.truncation.as_ref()
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
        let Some(chunk) = self.chunks.get(chunk) else { return Ok(Vec::new()) };
        let damaged =
            |reason: String| no_log(&self.path, format!("the chunk at byte {}: {reason}", chunk.offset));
        let mut bytes = vec![0; chunk.length as usize];
        let read =
            self.file.seek(SeekFrom::Start(chunk.offset)).and_then(|_| self.file.read_exact(&mut bytes));
        read.map_err(|error| no_log(&self.path, error))?;
        let body = body_of(chunk, &bytes).map_err(damaged)?;
        let mut reader = chunk_reader(chunk.head, body);
        let mut entries = Vec::new();
        while let Some(event) = reader.next_event() {
            match event.map_err(|error| damaged(describe(&error)))? {
                LinearReadEvent::ReadRequest(_) => reader.notify_read(0),
                LinearReadEvent::Record { data, opcode: op::MESSAGE } => {
                    entries.extend(self.entry(data, part).map_err(damaged)?);
                }
                LinearReadEvent::Record { .. } => {}
            }
        }
        let times = entries.iter().filter_map(|entry| match entry {
            LogEntry::Snapshot(snapshot) => Some(snapshot.time_s),
            _ => None,
        });
        match times.into_iter().find(|time_s| !chunk.has(*time_s)) {
            Some(time_s) => {
                Err(damaged(format!("it has a snapshot of {time_s} s, which is not in its time")))
            }
            None => Ok(entries),
        }
    }

    /// Decodes a message, where it is of the part.
    ///
    /// # Errors
    /// What is wrong with it, in words.
    fn entry(&self, message: &[u8], part: EntryFilter) -> Result<Option<LogEntry>, String> {
        /// Channel, sequence, and the times of logging and publishing.
        const MESSAGE_HEAD: usize = 2 + 4 + 8 + 8;
        let (Some(&[low, high]), Some(body)) = (message.first_chunk::<2>(), message.get(MESSAGE_HEAD..))
        else {
            return Err("a message ends in its head".to_owned());
        };
        let channel = u16::from_le_bytes([low, high]);
        if !self.is_of(channel, part) {
            return Ok(None);
        }
        let topic = self.topics.get(&channel).map_or("", String::as_str);
        let entry = decode(topic, body).flatten();
        entry.map(Some).ok_or_else(|| format!("a message of {topic} is damaged"))
    }
}

/// The body of a chunk's record.
///
/// # Errors
/// In words, where it is another record than the index, or the scan, has found there.
fn body_of<'a>(chunk: &ChunkInfo, record: &'a [u8]) -> Result<&'a [u8], String> {
    let (start, body) = record.split_at_checked(HEAD as usize).unwrap_or_default();
    let length = (body.len() as u64).to_le_bytes();
    let is_there = start.split_first() == Some((&op::CHUNK, &length[..]));
    if is_there && ChunkHead::read(body)? == chunk.head {
        Ok(body)
    } else {
        Err("it is not what the index of the log states".to_owned())
    }
}

fn seconds(nanoseconds: u64) -> f64 {
    nanoseconds as f64 * 1e-9
}

/// What the summary section of a log tells.
#[derive(Default)]
struct LogIndex {
    chunks: Vec<ChunkInfo>,
    topics: HashMap<u16, String>,
    /// Chunks of the log by its statistics.
    stated: Option<usize>,
}

/// The index of a log by its summary section; `None` where it has none.
///
/// # Errors
/// What is damaged in it, in words.
fn indexed(file: &mut File, size: u64) -> Result<Option<LogIndex>, String> {
    let Some((start, section)) = summary_section(file, size)? else { return Ok(None) };
    let options = LinearReaderOptions::default()
        .with_skip_start_magic(true)
        .with_validate_summary_section_crc(true)
        .with_record_length_limit(section.len());
    let mut reader = LinearReader::new_with_options(options);
    reader.insert(section.len()).copy_from_slice(&section);
    reader.notify_read(section.len());
    let mut index = LogIndex::default();
    while let Some(event) = reader.next_event() {
        match event.map_err(|error| error.to_string())? {
            LinearReadEvent::ReadRequest(_) => reader.notify_read(0),
            LinearReadEvent::Record { data, opcode } => index.take(opcode, data, start)?,
        }
    }
    let known = index.chunks.len();
    match index.stated {
        Some(stated) if stated != known => Err(format!("it lists {known} of {stated} chunks")),
        _ => Ok((known > 0).then_some(index)),
    }
}

impl LogIndex {
    /// Takes a record of a summary section that begins at byte `start`.
    fn take(&mut self, opcode: u8, data: &[u8], start: u64) -> Result<(), String> {
        if ![op::CHANNEL, op::CHUNK_INDEX, op::STATISTICS].contains(&opcode) {
            return Ok(());
        }
        match parse_checked(opcode, data)? {
            Record::Channel(channel) => drop(self.topics.insert(channel.id, channel.topic)),
            Record::Statistics(statistics) => self.stated = Some(statistics.chunk_count as usize),
            Record::ChunkIndex(index) => {
                let head = ChunkHead {
                    from_ns: index.message_start_time,
                    to_ns: index.message_end_time,
                    uncompressed_size: index.uncompressed_size,
                };
                let mut chunk = ChunkInfo::new(index.chunk_start_offset, index.chunk_length, head)?;
                if chunk.offset.checked_add(chunk.length).is_none_or(|end| end > start) {
                    return Err(format!("the chunk at byte {} reaches beyond the data", chunk.offset));
                }
                let channels = index.message_index_offsets;
                chunk.channels = (!channels.is_empty()).then(|| channels.into_keys().collect());
                self.chunks.push(chunk);
            }
            _ => {}
        }
        Ok(())
    }
}

/// The place of the summary section, and its bytes from the data end before it to the end of the file; `None` where the
/// log has none.
fn summary_section(file: &mut File, size: u64) -> Result<Option<(u64, Vec<u8>)>, String> {
    /// Data end with its checksum, before the section.
    const DATA_END: u64 = HEAD + 4;
    /// Footer with two places and a checksum, and the magic bytes.
    const FOOTER: u64 = HEAD + 8 + 8 + 4 + mcap::MAGIC.len() as u64;
    let failed = |error: std::io::Error| error.to_string();
    let Some(footer) = size.checked_sub(FOOTER).filter(|_| is_ended(file, size).unwrap_or_default()) else {
        return Ok(None);
    };
    let mut head = [0; HEAD as usize + 8];
    file.seek(SeekFrom::Start(footer)).and_then(|_| file.read_exact(&mut head)).map_err(failed)?;
    let start = head.last_chunk().map_or(0, |bytes| u64::from_le_bytes(*bytes));
    if head[0] != op::FOOTER {
        return Err("the file does not end with a footer".to_owned());
    }
    if start == 0 {
        return Ok(None);
    }
    if start < DATA_END || start > footer || footer - start > LARGEST_RECORD as u64 {
        return Err(format!("it begins at byte {start} of {size}"));
    }
    let mut section = vec![0; (size - (start - DATA_END)) as usize];
    file.seek(SeekFrom::Start(start - DATA_END))
        .and_then(|_| file.read_exact(&mut section))
        .map_err(failed)?;
    Ok(Some((start, section)))
}

/// The complete chunks of a file without an index, and why it was not read up to its end.
fn walked(file: &mut File, size: u64) -> std::io::Result<(Vec<ChunkInfo>, Option<Truncation>)> {
    let is_ended = is_ended(file, size)?;
    let mut chunks: Vec<ChunkInfo> = Vec::new();
    let mut offset = mcap::MAGIC.len() as u64;
    loop {
        let mut start = [0; HEAD as usize + ChunkHead::SIZE];
        file.seek(SeekFrom::Start(offset))?;
        let there = fill(file, &mut start)? as u64;
        let (opcode, rest) = (start[0], &start[1..]);
        let length = rest.first_chunk().map_or(0, |bytes| u64::from_le_bytes(*bytes));
        if there < HEAD || length > size - offset - HEAD {
            return Ok((chunks, Some(Truncation::of_cut(offset, is_ended))));
        }
        let head = rest.last_chunk().map(ChunkHead::of_start);
        let damage = match (opcode, head) {
            (op::DATA_END, _) => return Ok((chunks, None)),
            (op::CHUNK, Some(head)) => {
                ChunkInfo::new(offset, HEAD + length, head).map(|chunk| chunks.push(chunk)).err()
            }
            (0, _) => Some("a record of no kind".to_owned()),
            _ => None,
        };
        if let Some(reason) = damage {
            return Ok((chunks, Some(Truncation::Damaged { offset, reason })));
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
