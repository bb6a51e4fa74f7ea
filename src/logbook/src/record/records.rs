//! The records of an MCAP file in their order, also those inside chunks. Lengths are checked against the file and against
//! limits before memory is taken.

use super::budget::{DecompressionBudget, TooCompressed};
use super::input;
use mcap::McapError;
use mcap::records::{Record, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use std::fs::File;
use std::io::{BufReader, Error, Read, Seek, SeekFrom};
use std::path::Path;
use thiserror::Error;

/// Largest record or chunk, bytes: a damaged length must not exhaust the memory.
pub(super) const LARGEST_RECORD: usize = 256 << 20;

/// Bytes of a record's opcode and length.
pub(super) const HEAD: u64 = 9;

/// Why a log is read only in part; to follow its name.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum Truncation {
    /// The file stops where its writer was killed, or still writes. All records before that are whole.
    #[error("it ends in the middle of a record")]
    Torn,
    /// Bytes of the file are wrong, or missing in its middle.
    #[error("it is damaged at byte {offset}: {reason}")]
    Damaged {
        /// Place of the first damaged record in the file.
        offset: u64,
        /// What is wrong with it, in words.
        reason: String,
    },
}

impl Truncation {
    /// That of a file which ends inside the record at `offset`. A file that its writer has ended is damaged then.
    pub(super) fn of_cut(offset: u64, is_ended: bool) -> Self {
        let reason = || "a record reaches beyond the end of the file".to_owned();
        if is_ended { Self::Damaged { offset, reason: reason() } } else { Self::Torn }
    }

    /// Whether bytes of the file are wrong.
    pub fn is_damage(&self) -> bool {
        matches!(self, Self::Damaged { .. })
    }
}

/// Whether a file ends as its writer ends it.
pub(super) fn is_ended(file: &mut File, size: u64) -> std::io::Result<bool> {
    const MAGIC: u64 = mcap::MAGIC.len() as u64;
    let mut end = [0; MAGIC as usize];
    // It begins with the same bytes.
    let Some(start) = size.checked_sub(MAGIC).filter(|start| *start >= MAGIC) else { return Ok(false) };
    file.seek(SeekFrom::Start(start))?;
    file.read_exact(&mut end)?;
    file.seek(SeekFrom::Start(0))?;
    Ok(end == mcap::MAGIC)
}

/// Why no further record can be read.
enum RecordFault {
    Unreadable(Error),
    /// The file ends inside the record.
    Cut,
    Damaged(String),
}

impl From<McapError> for RecordFault {
    fn from(error: McapError) -> Self {
        Self::Damaged(describe(&error))
    }
}

impl From<TooCompressed> for RecordFault {
    fn from(error: TooCompressed) -> Self {
        Self::Damaged(error.to_string())
    }
}

/// What is wrong with a record, in words.
pub(super) fn describe(error: &McapError) -> String {
    match error {
        McapError::UnexpectedEof | McapError::UnexpectedEoc => {
            "a chunk ends in the middle of a record".to_owned()
        }
        McapError::BadMagic => "it is not an MCAP file".to_owned(),
        other => other.to_string(),
    }
}

/// The records of an MCAP file, also those inside chunks, up to its data end.
pub(super) struct RecordStream {
    file: BufReader<File>,
    /// Bytes of the file that have not been read yet.
    left: u64,
    is_ended: bool,
    reader: LinearReader,
    /// The records of the present chunk.
    chunk: Option<LinearReader>,
    budget: DecompressionBudget,
    /// Places of the present record outside of chunks, and of the next one.
    offset: u64,
    next_offset: u64,
    is_over: bool,
    truncation: Option<Truncation>,
}

impl std::fmt::Debug for RecordStream {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("RecordStream").field("truncation", &self.truncation).finish_non_exhaustive()
    }
}

impl RecordStream {
    /// Opens a file.
    ///
    /// # Errors
    /// When it is no regular file, or cannot be read.
    pub(super) fn open(path: &Path) -> std::io::Result<Self> {
        let (mut file, size) = input::open(path)?;
        let is_ended = is_ended(&mut file, size)?;
        let options = LinearReaderOptions::default()
            .with_skip_end_magic(true)
            .with_emit_chunks(true)
            .with_validate_data_section_crc(true)
            .with_record_length_limit(LARGEST_RECORD);
        Ok(Self {
            file: BufReader::new(file),
            left: size,
            is_ended,
            reader: LinearReader::new_with_options(options),
            chunk: None,
            budget: DecompressionBudget::of_file(size),
            offset: 0,
            next_offset: mcap::MAGIC.len() as u64,
            is_over: false,
            truncation: None,
        })
    }

    /// Why the file was not read up to its data end, if it was not.
    pub(super) fn truncation(&self) -> Option<&Truncation> {
        self.truncation.as_ref()
    }

    /// Ends the stream at the present record, which is damaged.
    pub(super) fn end_damaged(&mut self, reason: String) {
        self.end(Truncation::Damaged { offset: self.offset, reason });
    }

    fn end(&mut self, truncation: Truncation) {
        self.is_over = true;
        self.truncation = Some(truncation);
    }

    /// The next record with a schema, a channel, a message, metadata or an attachment; `None` at the end, see
    /// [`Self::truncation`].
    ///
    /// # Errors
    /// When the file cannot be read.
    pub(super) fn next(&mut self) -> std::io::Result<Option<Record<'static>>> {
        while !self.is_over {
            let record = match &mut self.chunk {
                Some(chunk) => next_in_chunk(chunk).inspect(|record| {
                    if record.is_none() {
                        self.chunk = None;
                    }
                }),
                None => self.next_outside(),
            };
            match record {
                Ok(Some(record)) => return Ok(Some(record)),
                Ok(None) => {}
                Err(RecordFault::Unreadable(error)) => return Err(error),
                Err(RecordFault::Cut) => self.end(Truncation::of_cut(self.offset, self.is_ended)),
                Err(RecordFault::Damaged(reason)) => self.end_damaged(reason),
            }
        }
        Ok(None)
    }

    /// Takes one step outside of chunks.
    fn next_outside(&mut self) -> Result<Option<Record<'static>>, RecordFault> {
        self.offset = self.next_offset;
        match self.reader.next_event() {
            None | Some(Err(McapError::UnexpectedEof)) => Err(RecordFault::Cut),
            Some(Err(error)) => Err(error.into()),
            Some(Ok(LinearReadEvent::ReadRequest(wanted))) => {
                self.fill(wanted)?;
                Ok(None)
            }
            Some(Ok(LinearReadEvent::Record { data, opcode })) => {
                self.next_offset += HEAD + data.len() as u64;
                match opcode {
                    0 => Err(RecordFault::Damaged("a record of no kind".to_owned())),
                    op::DATA_END => {
                        self.is_over = true;
                        Ok(None)
                    }
                    op::CHUNK => {
                        let head = ChunkHead::read(data).map_err(RecordFault::Damaged)?;
                        self.budget.take(head.uncompressed_size)?;
                        self.chunk = Some(chunk_reader(head, data));
                        Ok(None)
                    }
                    _ => parse(opcode, data),
                }
            }
        }
    }

    /// Hands bytes of the file to the reader.
    fn fill(&mut self, wanted: usize) -> Result<(), RecordFault> {
        if wanted as u64 > self.left {
            return Err(RecordFault::Cut);
        }
        let read = self.file.read(self.reader.insert(wanted)).map_err(RecordFault::Unreadable)?;
        self.reader.notify_read(read);
        self.left -= read as u64;
        Ok(())
    }
}

/// The next record of a chunk that [`chunk_reader`] reads; `None` at its end.
fn next_in_chunk(chunk: &mut LinearReader) -> Result<Option<Record<'static>>, RecordFault> {
    while let Some(event) = chunk.next_event() {
        match event? {
            LinearReadEvent::ReadRequest(_) => chunk.notify_read(0),
            LinearReadEvent::Record { data, opcode } => {
                if let Some(record) = parse(opcode, data)? {
                    return Ok(Some(record));
                }
            }
        }
    }
    Ok(None)
}

/// Parses a record of the kinds that [`RecordStream::next`] returns; `None` for others.
fn parse(opcode: u8, data: &[u8]) -> Result<Option<Record<'static>>, RecordFault> {
    const KINDS: [u8; 5] = [op::SCHEMA, op::CHANNEL, op::MESSAGE, op::METADATA, op::ATTACHMENT];
    if !KINDS.contains(&opcode) {
        return Ok(None);
    }
    parse_checked(opcode, data).map(Some).map_err(RecordFault::Damaged)
}

/// Parses a record whose lengths fit into it.
///
/// # Errors
/// What is wrong with the record, in words.
pub(super) fn parse_checked(opcode: u8, data: &[u8]) -> Result<Record<'static>, String> {
    if !lengths_fit(opcode, data) {
        return Err("a length that exceeds its record".to_owned());
    }
    mcap::parse_record(opcode, data).map(Record::into_owned).map_err(|error| describe(&error))
}

/// Whether texts and data of a record lie within it. [`mcap::parse_record`] takes memory for a text before it knows that.
fn lengths_fit(opcode: u8, data: &[u8]) -> bool {
    let mut rest = LengthChecker(data);
    let fits = match opcode {
        op::SCHEMA => rest.skip(2).and_then(|()| rest.texts(3)),
        op::CHANNEL => rest.skip(4).and_then(|()| rest.texts(2)).and_then(|()| rest.text_map()),
        op::METADATA => rest.texts(1).and_then(|()| rest.text_map()),
        op::ATTACHMENT => rest.skip(16).and_then(|()| rest.texts(2)).and_then(|()| rest.attachment()),
        op::CHUNK_INDEX => rest
            .skip(32)
            .and_then(|()| rest.texts(1))
            .and_then(|()| rest.skip(8))
            .and_then(|()| rest.texts(1))
            .and_then(|()| rest.skip(16)),
        _ => Some(()),
    };
    fits.is_some()
}

/// Walks over the fields of a record; `None` where one reaches beyond its end.
struct LengthChecker<'a>(&'a [u8]);

impl LengthChecker<'_> {
    fn skip(&mut self, bytes: u64) -> Option<()> {
        self.0 = self.0.get(usize::try_from(bytes).ok()?..)?;
        Some(())
    }

    fn length(&mut self) -> Option<u64> {
        let length = u32::from_le_bytes(*self.0.first_chunk()?);
        self.skip(4)?;
        Some(u64::from(length))
    }

    /// Texts or data, each behind its length.
    fn texts(&mut self, count: usize) -> Option<()> {
        for _ in 0..count {
            let length = self.length()?;
            self.skip(length)?;
        }
        Some(())
    }

    /// Pairs of texts behind the length of all.
    fn text_map(&mut self) -> Option<()> {
        let length = usize::try_from(self.length()?).ok()?;
        let mut pairs = LengthChecker(self.0.get(..length)?);
        while !pairs.0.is_empty() {
            pairs.texts(2)?;
        }
        self.skip(length as u64)
    }

    /// Data behind their length of eight bytes, and their checksum.
    fn attachment(&mut self) -> Option<()> {
        let length = u64::from_le_bytes(*self.0.first_chunk()?);
        self.skip(8)?;
        self.skip(length)?;
        self.skip(4)
    }
}

/// What a chunk states of itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct ChunkHead {
    /// Times of its first and of its last message, nanoseconds.
    pub(super) from_ns: u64,
    pub(super) to_ns: u64,
    /// Bytes of its records.
    pub(super) uncompressed_size: u64,
}

impl ChunkHead {
    /// Bytes up to the uncompressed size.
    pub(super) const SIZE: usize = 24;

    /// Reads times and size from the beginning of a chunk's body.
    pub(super) fn of_start(start: &[u8; Self::SIZE]) -> Self {
        let number =
            |at: usize| start[at..at + 8].iter().rev().fold(0, |sum, byte| sum << 8 | u64::from(*byte));
        Self { from_ns: number(0), to_ns: number(8), uncompressed_size: number(16) }
    }

    /// Reads and checks the head of a chunk's body, the record without opcode and length.
    ///
    /// # Errors
    /// What is wrong with it, in words.
    pub(super) fn read(body: &[u8]) -> Result<Self, String> {
        let cut = || "a chunk ends in its head".to_owned();
        let head = Self::of_start(body.first_chunk().ok_or_else(cut)?);
        let mut rest = LengthChecker(body);
        rest.skip(Self::SIZE as u64 + 4).and_then(|()| rest.texts(1)).ok_or_else(cut)?;
        let is_uncompressed = body[Self::SIZE + 4..Self::SIZE + 8] == [0; 4];
        let size = u64::from_le_bytes(*rest.0.first_chunk().ok_or_else(cut)?);
        let stated = rest.0.len() as u64 - 8;
        if size > stated || (is_uncompressed && (size != stated || size != head.uncompressed_size)) {
            return Err("the sizes of a chunk contradict each other".to_owned());
        }
        if head.uncompressed_size > LARGEST_RECORD as u64 {
            let most = LARGEST_RECORD >> 20;
            return Err(format!("a chunk of {} bytes; at most {most} MiB are read", head.uncompressed_size));
        }
        Ok(head)
    }
}

/// A reader of the records of a chunk, by its head and its body. It has all of it: a request for more means the end.
pub(super) fn chunk_reader(head: ChunkHead, body: &[u8]) -> LinearReader {
    // No record of the chunk can be larger, whatever it states.
    let most = body.len().max(usize::try_from(head.uncompressed_size).unwrap_or(LARGEST_RECORD));
    let options = LinearReaderOptions::default()
        .with_skip_start_magic(true)
        .with_skip_end_magic(true)
        .with_prevalidate_chunk_crcs(true)
        .with_record_length_limit(most);
    let mut reader = LinearReader::new_with_options(options);
    let length = HEAD as usize + body.len();
    let (head, rest) = reader.insert(length).split_at_mut(HEAD as usize);
    head[0] = op::CHUNK;
    head[1..].copy_from_slice(&(body.len() as u64).to_le_bytes());
    rest.copy_from_slice(body);
    reader.notify_read(length);
    reader
}
