//! MCAP writer (<https://mcap.dev/spec>) in constant memory: the index of the chunks, which the file has at its end, waits
//! in a temporary file. Chunks are compressed with Zstandard and have message indexes.

use mcap::MAGIC;
use mcap::records::{MessageHeader, op};
use std::collections::BTreeMap;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::Path;
use tempfile::SpooledTempFile;
use zstd::bulk::Compressor;

/// A chunk ends at this size, bytes before compression: the most that a killed process loses.
const CHUNK_BYTES: usize = 512 << 10;
/// Zstandard's quick levels lie below zero: this one takes two thirds of level 1's time for a sixteenth more of size.
const COMPRESSION_LEVEL: i32 = -3;
/// Index that stays in memory, bytes: that of a short run.
const INDEX_IN_MEMORY: usize = 256 << 10;
/// Name of Zstandard in chunks.
const COMPRESSION: &str = "zstd";

/// Writes an MCAP file record by record.
pub(super) struct McapWriter<W> {
    sink: ChecksumSink<W>,
    chunk: Chunk,
    compressor: Compressor<'static>,
    compressed: Vec<u8>,
    /// Encoded schemas and channels, which the summary repeats.
    schemas: Vec<Vec<u8>>,
    channels: Vec<Vec<u8>>,
    attachments: Vec<Vec<u8>>,
    metadata: Vec<Vec<u8>>,
    /// Encoded chunk indexes.
    chunk_index: SpooledTempFile,
    chunks: u32,
    times: Option<TimeSpan>,
    /// Messages by channel.
    messages: BTreeMap<u16, u64>,
}

/// Nanoseconds of the first and the last message.
#[derive(Clone, Copy, Debug, Default)]
struct TimeSpan {
    from: u64,
    to: u64,
}

impl TimeSpan {
    fn with(span: Option<Self>, time: u64) -> Self {
        let Self { from, to } = span.unwrap_or(Self { from: time, to: time });
        Self { from: from.min(time), to: to.max(time) }
    }
}

/// The chunk that is being filled. Its memory is reused.
#[derive(Debug, Default)]
struct Chunk {
    records: Vec<u8>,
    times: Option<TimeSpan>,
    /// Time and place of each message, by channel; empty for channels without messages.
    index: BTreeMap<u16, Vec<[u64; 2]>>,
}

/// A sink that counts its bytes and their CRC-32.
#[derive(Debug)]
struct ChecksumSink<W> {
    sink: W,
    position: u64,
    crc: crc32fast::Hasher,
}

impl<W: Write> ChecksumSink<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.sink.write_all(bytes)?;
        self.crc.update(bytes);
        self.position += bytes.len() as u64;
        Ok(())
    }

    fn record(&mut self, opcode: u8, body: &[u8]) -> io::Result<()> {
        self.write(&head(opcode, body.len()))?;
        self.write(body)
    }

    /// Writes the records of one opcode; returns it with their place and length.
    fn group(&mut self, opcode: u8, bodies: &[Vec<u8>]) -> io::Result<(u8, u64, u64)> {
        let start = self.position;
        bodies.iter().try_for_each(|body| self.record(opcode, body))?;
        Ok((opcode, start, self.position - start))
    }
}

/// Opcode and length of a record.
fn head(opcode: u8, length: usize) -> [u8; 9] {
    let mut head = [opcode; 9];
    head[1..].copy_from_slice(&(length as u64).to_le_bytes());
    head
}

/// The body of a record, field by field.
#[derive(Debug, Default)]
struct Body(Vec<u8>);

impl Body {
    fn u16(mut self, value: u16) -> Self {
        self.0.extend(value.to_le_bytes());
        self
    }

    fn u32(mut self, value: u32) -> Self {
        self.0.extend(value.to_le_bytes());
        self
    }

    fn u64(mut self, value: u64) -> Self {
        self.0.extend(value.to_le_bytes());
        self
    }

    fn string(self, text: &str) -> Self {
        self.bytes(text.as_bytes())
    }

    /// A length of 32 bits, and so many bytes.
    fn bytes(mut self, bytes: &[u8]) -> Self {
        self = self.u32(bytes.len() as u32);
        self.0.extend(bytes);
        self
    }
}

/// A map as fields have it: pairs behind their length in bytes.
fn pairs<K, V>(entries: impl IntoIterator<Item = (K, V)>, encode: impl Fn(Body, K, V) -> Body) -> Vec<u8> {
    entries.into_iter().fold(Body::default(), |body, (key, value)| encode(body, key, value)).0
}

impl<W: Write> McapWriter<W> {
    /// Begins a file; the chunk index of a long one waits in a file without a name in `index_folder`.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn new(sink: W, (profile, library): (&str, &str), index_folder: &Path) -> io::Result<Self> {
        let mut sink = ChecksumSink { sink, position: 0, crc: crc32fast::Hasher::new() };
        sink.write(MAGIC)?;
        sink.record(op::HEADER, &Body::default().string(profile).string(library).0)?;
        Ok(Self {
            sink,
            chunk: Chunk::default(),
            compressor: Compressor::new(COMPRESSION_LEVEL)?,
            compressed: Vec::new(),
            schemas: Vec::new(),
            channels: Vec::new(),
            attachments: Vec::new(),
            metadata: Vec::new(),
            chunk_index: tempfile::spooled_tempfile_in(INDEX_IN_MEMORY, index_folder),
            chunks: 0,
            times: None,
            messages: BTreeMap::new(),
        })
    }

    /// Number of messages.
    pub fn messages(&self) -> u64 {
        self.messages.values().sum()
    }

    /// Adds named texts.
    ///
    /// # Errors
    /// When they cannot be written.
    pub fn metadata(&mut self, name: &str, texts: &BTreeMap<String, String>) -> io::Result<()> {
        self.end_chunk()?;
        let texts = pairs(texts, |body, key, value| body.string(key).string(value));
        let body = Body::default().string(name).bytes(&texts);
        let at = self.sink.position;
        self.sink.record(op::METADATA, &body.0)?;
        self.metadata.push(Body::default().u64(at).u64(self.sink.position - at).string(name).0);
        Ok(())
    }

    /// Adds a file.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn attachment(&mut self, name: &str, media_type: &str, data: &[u8]) -> io::Result<()> {
        self.end_chunk()?;
        // Times of logging and creation are not known.
        let start = Body::default().u64(0).u64(0).string(name).string(media_type).u64(data.len() as u64).0;
        let mut crc = crc32fast::Hasher::new();
        crc.update(&start);
        crc.update(data);
        let (at, crc) = (self.sink.position, crc.finalize().to_le_bytes());
        self.sink.write(&head(op::ATTACHMENT, start.len() + data.len() + crc.len()))?;
        for part in [&start, data, &crc] {
            self.sink.write(part)?;
        }
        let index = Body::default().u64(at).u64(self.sink.position - at).u64(0).u64(0);
        self.attachments.push(index.u64(data.len() as u64).string(name).string(media_type).0);
        Ok(())
    }

    /// Adds a schema; returns its number.
    pub fn schema(&mut self, name: &str, encoding: &str, data: &str) -> u16 {
        let id = self.schemas.len() as u16 + 1;
        let body = Body::default().u16(id).string(name).string(encoding).string(data).0;
        self.chunk.record(op::SCHEMA, &[&body]);
        self.schemas.push(body);
        id
    }

    /// Adds a channel of messages in CDR; returns its number.
    ///
    /// # Errors
    /// When there are too many.
    pub fn channel(&mut self, schema: u16, topic: &str) -> io::Result<u16> {
        let id = u16::try_from(self.channels.len() + 1);
        let id = id.map_err(|_| io::Error::other("a log has 65535 channels at most"))?;
        let body = Body::default().u16(id).u16(schema).string(topic).string("cdr").bytes(&[]).0;
        self.chunk.record(op::CHANNEL, &[&body]);
        self.channels.push(body);
        Ok(id)
    }

    /// Adds a message.
    ///
    /// # Errors
    /// When a whole chunk cannot be written.
    pub fn message(&mut self, header: &MessageHeader, data: &[u8]) -> io::Result<()> {
        let MessageHeader { channel_id, sequence, log_time, publish_time } = *header;
        let at = self.chunk.records.len() as u64;
        let (channel, sequence) = (channel_id.to_le_bytes(), sequence.to_le_bytes());
        let (logged, published) = (log_time.to_le_bytes(), publish_time.to_le_bytes());
        self.chunk.record(op::MESSAGE, &[&channel, &sequence, &logged, &published, data]);
        self.chunk.index.entry(channel_id).or_default().push([log_time, at]);
        self.chunk.times = Some(TimeSpan::with(self.chunk.times, log_time));
        *self.messages.entry(channel_id).or_default() += 1;
        if self.chunk.records.len() >= CHUNK_BYTES { self.end_chunk() } else { Ok(()) }
    }

    /// Ends the present chunk and hands all bytes on.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn flush(&mut self) -> io::Result<()> {
        self.end_chunk()?;
        self.sink.sink.flush()
    }

    /// Writes the present chunk with the indexes of its messages, at once.
    fn end_chunk(&mut self) -> io::Result<()> {
        let Chunk { records, times, index } = &mut self.chunk;
        if records.is_empty() {
            return Ok(());
        }
        let times = times.take();
        let TimeSpan { from, to } = times.unwrap_or_default();
        self.compressed.clear();
        self.compressed.reserve(zstd::zstd_safe::compress_bound(records.len()));
        let length = self.compressor.compress_to_buffer(records, &mut self.compressed)?;
        let raw = records.len() as u64;
        let start = Body::default().u64(from).u64(to).u64(raw).u32(crc32fast::hash(records));
        let start = start.string(COMPRESSION).u64(length as u64).0;
        let at = self.sink.position;
        self.sink.write(&head(op::CHUNK, start.len() + length))?;
        self.sink.write(&start)?;
        self.sink.write(&self.compressed)?;
        let indexes_at = self.sink.position;
        let mut places = Body::default();
        for (&channel, entries) in index.iter_mut().filter(|(_, entries)| !entries.is_empty()) {
            places = places.u16(channel).u64(self.sink.position);
            let entries = pairs(entries.drain(..).map(|[time, at]| (time, at)), |body, time, at| {
                body.u64(time).u64(at)
            });
            self.sink.record(op::MESSAGE_INDEX, &Body::default().u16(channel).bytes(&entries).0)?;
        }
        records.clear();
        let body = Body::default().u64(from).u64(to).u64(at).u64(indexes_at - at).bytes(&places.0);
        let body =
            body.u64(self.sink.position - indexes_at).string(COMPRESSION).u64(length as u64).u64(raw).0;
        self.chunk_index.write_all(&[&head(op::CHUNK_INDEX, body.len())[..], &body].concat())?;
        if let Some(TimeSpan { from, to }) = times {
            self.times = Some(TimeSpan::with(Some(TimeSpan::with(self.times, from)), to));
        }
        self.chunks += 1;
        Ok(())
    }

    /// Writes the summary and ends the file.
    ///
    /// # Errors
    /// When it cannot be written; the messages stay readable without their index.
    pub fn finish(mut self) -> io::Result<()> {
        self.end_chunk()?;
        let crc = self.sink.crc.clone().finalize();
        self.sink.record(op::DATA_END, &Body::default().u32(crc).0)?;
        let summary_at = self.sink.position;
        // The checksum of the summary section begins with it.
        self.sink.crc = crc32fast::Hasher::new();
        let statistics = self.statistics();
        let mut groups = vec![
            self.sink.group(op::SCHEMA, &self.schemas)?,
            self.sink.group(op::CHANNEL, &self.channels)?,
            self.sink.group(op::STATISTICS, &[statistics])?,
        ];
        groups.push(self.chunk_indexes()?);
        groups.push(self.sink.group(op::ATTACHMENT_INDEX, &self.attachments)?);
        groups.push(self.sink.group(op::METADATA_INDEX, &self.metadata)?);
        let offsets_at = self.sink.position;
        for (opcode, start, length) in groups.into_iter().filter(|(.., length)| *length > 0) {
            let body = [&[opcode][..], &start.to_le_bytes(), &length.to_le_bytes()].concat();
            self.sink.record(op::SUMMARY_OFFSET, &body)?;
        }
        let footer = Body::default().u64(summary_at).u64(offsets_at).0;
        // The checksum covers the footer as well, but itself.
        self.sink.write(&head(op::FOOTER, footer.len() + size_of::<u32>()))?;
        self.sink.write(&footer)?;
        let crc = self.sink.crc.clone().finalize();
        self.sink.write(&crc.to_le_bytes())?;
        self.sink.write(MAGIC)?;
        self.sink.sink.flush()
    }

    fn statistics(&self) -> Vec<u8> {
        let TimeSpan { from, to } = self.times.unwrap_or_default();
        let body = Body::default().u64(self.messages()).u16(self.schemas.len() as u16);
        let body = body.u32(self.channels.len() as u32).u32(self.attachments.len() as u32);
        let body = body.u32(self.metadata.len() as u32).u32(self.chunks).u64(from).u64(to);
        body.bytes(&pairs(&self.messages, |body, &channel, &count| body.u16(channel).u64(count))).0
    }

    /// Copies the chunk indexes from their temporary file.
    fn chunk_indexes(&mut self) -> io::Result<(u8, u64, u64)> {
        let start = self.sink.position;
        self.chunk_index.seek(SeekFrom::Start(0))?;
        let mut buffer = vec![0; INDEX_IN_MEMORY];
        loop {
            match self.chunk_index.read(&mut buffer) {
                Ok(0) => break,
                Ok(read) => self.sink.write(&buffer[..read])?,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        Ok((op::CHUNK_INDEX, start, self.sink.position - start))
    }
}

impl Chunk {
    fn record(&mut self, opcode: u8, parts: &[&[u8]]) {
        let length = parts.iter().map(|part| part.len()).sum();
        self.records.extend(head(opcode, length));
        parts.iter().for_each(|part| self.records.extend(*part));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mcap::{Attachment, Compression, WriteOptions};
    use std::borrow::Cow;

    /// Chunks of small messages on two channels, with a file and a text.
    fn written(messages: u32) -> Vec<u8> {
        let mut bytes = Vec::new();
        let folder = std::env::temp_dir();
        let mut writer = McapWriter::new(&mut bytes, ("ros2", "city3d"), &folder).unwrap();
        writer.metadata("city3d", &texts()).unwrap();
        writer.attachment("map.dxf", "image/vnd.dxf", b"a map").unwrap();
        let schema = writer.schema("pkg/msg/Kind", "ros2msg", "uint8 one");
        let channels = ["/a", "/b"].map(|topic| writer.channel(schema, topic).unwrap());
        for message in 0..messages {
            let header = header(channels[message as usize % 2], message);
            writer.message(&header, &message.to_le_bytes()).unwrap();
            if message % 100 == 99 {
                writer.flush().unwrap();
            }
        }
        writer.finish().unwrap();
        bytes
    }

    /// The same by the crate `mcap`.
    fn by_the_crate(messages: u32) -> Vec<u8> {
        let mut bytes = io::Cursor::new(Vec::new());
        let options = WriteOptions::new().profile("ros2").library("city3d").disable_seeking(true);
        let options = options.compression(Some(Compression::Zstd)).compression_threads(0);
        let mut writer = options.create(&mut bytes).unwrap();
        let texts = mcap::records::Metadata { name: "city3d".to_owned(), metadata: texts() };
        writer.write_metadata(&texts).unwrap();
        let file = Attachment {
            log_time: 0,
            create_time: 0,
            name: "map.dxf".to_owned(),
            media_type: "image/vnd.dxf".to_owned(),
            data: Cow::Borrowed(b"a map"),
        };
        writer.attach(&file).unwrap();
        let schema = writer.add_schema("pkg/msg/Kind", "ros2msg", b"uint8 one").unwrap();
        let channels =
            ["/a", "/b"].map(|topic| writer.add_channel(schema, topic, "cdr", &BTreeMap::new()).unwrap());
        for message in 0..messages {
            let header = header(channels[message as usize % 2], message);
            writer.write_to_known_channel(&header, &message.to_le_bytes()).unwrap();
            if message % 100 == 99 {
                writer.flush().unwrap();
            }
        }
        writer.finish().unwrap();
        drop(writer);
        bytes.into_inner()
    }

    fn texts() -> BTreeMap<String, String> {
        BTreeMap::from(
            [("format", "3"), ("seed", "7")].map(|(key, value)| (key.to_owned(), value.to_owned())),
        )
    }

    fn header(channel_id: u16, message: u32) -> MessageHeader {
        let log_time = u64::from(message) * 1000;
        MessageHeader { channel_id, sequence: message, log_time, publish_time: log_time }
    }

    #[test]
    fn the_file_is_that_of_the_crate_but_for_its_compression() {
        for messages in [0, 1, 250, 1000] {
            let [ours, theirs] = [written(messages), by_the_crate(messages)];
            let of = |bytes: &[u8]| mcap::Summary::read(bytes).unwrap().unwrap();
            let (summary, expected) = (of(&ours), of(&theirs));
            assert_eq!(summary.stats, expected.stats);
            assert_eq!(summary.schemas, expected.schemas);
            assert_eq!(summary.channels, expected.channels);
            assert_eq!(summary.attachment_indexes, expected.attachment_indexes);
            assert_eq!(summary.metadata_indexes, expected.metadata_indexes);
            let raw = |summary: &mcap::Summary| -> Vec<_> {
                let sizes = |chunk: &mcap::records::ChunkIndex| {
                    (chunk.uncompressed_size, chunk.message_start_time, chunk.message_end_time)
                };
                summary.chunk_indexes.iter().map(sizes).collect()
            };
            assert_eq!(raw(&summary), raw(&expected));
            // The reader of whole files holds all checksums against what it reads.
            let read = |bytes: &[u8]| -> Vec<_> {
                let messages = mcap::MessageStream::new(bytes).unwrap().map(Result::unwrap);
                messages
                    .map(|m| (m.channel.topic.clone(), m.sequence, m.log_time, m.data.into_owned()))
                    .collect()
            };
            assert_eq!(read(&ours).len(), messages as usize);
            assert_eq!(read(&ours), read(&theirs));
        }
    }

    #[test]
    fn each_message_is_found_by_the_index_of_its_chunk() {
        let bytes = written(1000);
        let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
        let mut found = 0;
        for chunk in &summary.chunk_indexes {
            let indexes = summary.read_message_indexes(&bytes, chunk).unwrap();
            for (channel, entries) in indexes {
                for entry in entries {
                    let message = summary.seek_message(&bytes, chunk, &entry).unwrap();
                    assert_eq!((message.log_time, &message.channel), (entry.log_time, &channel));
                    found += 1;
                }
            }
        }
        assert_eq!(found, 1000);
    }

    #[test]
    fn the_index_of_a_long_log_is_not_in_memory() {
        let mut bytes = Vec::new();
        let mut writer = McapWriter::new(&mut bytes, ("ros2", "city3d"), &std::env::temp_dir()).unwrap();
        let schema = writer.schema("pkg/msg/Kind", "ros2msg", "uint8 one");
        let channel = writer.channel(schema, "/a").unwrap();
        let chunks = 4000;
        for message in 0..chunks {
            writer.message(&header(channel, message), &message.to_le_bytes()).unwrap();
            writer.flush().unwrap();
        }
        assert!(writer.chunk_index.is_rolled());
        writer.finish().unwrap();
        let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
        assert_eq!(summary.chunk_indexes.len(), chunks as usize);
        assert!(summary.chunk_indexes.is_sorted_by_key(|chunk| chunk.message_start_time));
    }

    #[test]
    fn a_file_that_was_cut_keeps_its_whole_chunks() {
        let bytes = written(1000);
        let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
        let last = summary.chunk_indexes.iter().max_by_key(|chunk| chunk.chunk_start_offset).unwrap();
        let cut = &bytes[..last.chunk_start_offset as usize + 20];
        let options = mcap::read::Options::IgnoreEndMagic.into();
        let whole =
            mcap::MessageStream::new_with_options(cut, options).unwrap().map_while(Result::ok).count();
        assert_eq!(whole, 900);
    }
}
