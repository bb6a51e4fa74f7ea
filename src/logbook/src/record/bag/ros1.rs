//! Reader of ROS 1 bags, format 2.0. An unclosed or truncated bag is read up to its last whole record.
//!
//! Format: <http://wiki.ros.org/Bags/Format/2.0>. A record has a header of named fields, and data; chunks hold
//! connections and messages, and may be compressed.

use crate::record::Truncation;
use crate::record::budget::{DecompressionBudget, TooCompressed};
use crate::record::input::{self, ROS1_MAGIC};
use std::collections::HashMap;
use std::io::{BufReader, Error, ErrorKind, Read, Result};
use std::path::Path;

/// Largest part of a record: a damaged length must not exhaust the memory.
const LARGEST: u64 = 256 << 20;

/// Opcodes of records.
const MESSAGE: u8 = 2;
const CHUNK: u8 = 5;
const CONNECTION: u8 = 7;

/// Calls `take` with type, topic and bytes of each message. Returns why the bag was not read up to its end, if it was not.
///
/// # Errors
/// When the file cannot be read.
pub fn read(path: &Path, take: impl FnMut(&str, &str, &[u8])) -> Result<Option<Truncation>> {
    let (file, size) = input::open(path)?;
    let mut file = CountingReader { from: BufReader::new(file).take(size), count: 0 };
    file.read_exact(&mut [0; ROS1_MAGIC.len()])?;
    let mut messages =
        MessageReader { connections: HashMap::new(), budget: DecompressionBudget::of_file(size), take };
    loop {
        let offset = file.count;
        let outcome = Record::read(&mut file).and_then(|record| match record {
            Some(record) => messages.read(&record).map(|()| true),
            None => Ok(false),
        });
        match outcome {
            Ok(true) => {}
            Ok(false) => return Ok(None),
            Err(error) if error.kind() == ErrorKind::UnexpectedEof => return Ok(Some(Truncation::Torn)),
            Err(error) if error.kind() == ErrorKind::InvalidData => {
                return Ok(Some(Truncation::Damaged { offset, reason: error.to_string() }));
            }
            Err(error) => return Err(error),
        }
    }
}

/// Counts the bytes that are read.
struct CountingReader<R> {
    from: R,
    count: u64,
}

impl<R: Read> Read for CountingReader<R> {
    fn read(&mut self, buffer: &mut [u8]) -> Result<usize> {
        let read = self.from.read(buffer)?;
        self.count += read as u64;
        Ok(read)
    }
}

/// Header fields and data.
struct Record {
    header: Vec<u8>,
    data: Vec<u8>,
    /// `false` for a chunk of which only the beginning is in the file.
    is_whole: bool,
}

impl Record {
    /// `None` at the end.
    fn read(from: &mut impl Read) -> Result<Option<Self>> {
        let Some(header) = whole_part(from)? else { return Ok(None) };
        let (data, is_whole) = part(from)?.ok_or(ErrorKind::UnexpectedEof)?;
        let record = Self { header, data, is_whole };
        if is_whole || record.op()? == CHUNK {
            Ok(Some(record))
        } else {
            Err(ErrorKind::UnexpectedEof.into())
        }
    }

    fn op(&self) -> Result<u8> {
        let op = field(&self.header, "op")?.and_then(<[u8]>::first);
        op.copied().ok_or_else(|| damaged("a record without a kind"))
    }

    fn connection(&self) -> Result<u32> {
        let number = field(&self.header, "conn")?.and_then(<[u8]>::first_chunk);
        number.map(|bytes| u32::from_le_bytes(*bytes)).ok_or_else(|| damaged("a record without a connection"))
    }
}

fn damaged(why: &str) -> Error {
    Error::new(ErrorKind::InvalidData, why.to_owned())
}

/// A length-prefixed part and whether it is whole; `None` at the end.
fn part(from: &mut impl Read) -> Result<Option<(Vec<u8>, bool)>> {
    let mut length = Vec::new();
    from.take(4).read_to_end(&mut length)?;
    let length = match length.first_chunk() {
        Some(bytes) => u64::from(u32::from_le_bytes(*bytes)),
        None if length.is_empty() => return Ok(None),
        None => return Err(ErrorKind::UnexpectedEof.into()),
    };
    if length > LARGEST {
        return Err(damaged("a record that is too large"));
    }
    let mut bytes = Vec::new();
    from.take(length).read_to_end(&mut bytes)?;
    let is_whole = bytes.len() as u64 == length;
    Ok(Some((bytes, is_whole)))
}

fn whole_part(from: &mut impl Read) -> Result<Option<Vec<u8>>> {
    match part(from)? {
        Some((bytes, true)) => Ok(Some(bytes)),
        Some((_, false)) => Err(ErrorKind::UnexpectedEof.into()),
        None => Ok(None),
    }
}

/// The value of a field among those of a header; `None` where it has no such field.
fn field<'a>(mut header: &'a [u8], name: &str) -> Result<Option<&'a [u8]>> {
    while let Some((length, rest)) = header.split_first_chunk() {
        let length = u32::from_le_bytes(*length) as usize;
        let (field, rest) =
            rest.split_at_checked(length).ok_or_else(|| damaged("a field beyond its header"))?;
        let equals = field.iter().position(|&byte| byte == b'=');
        let (found, value) = field.split_at(equals.ok_or_else(|| damaged("a field without a value"))?);
        if found == name.as_bytes() {
            return Ok(Some(&value[1..]));
        }
        header = rest;
    }
    Ok(None)
}

fn text_field(header: &[u8], name: &str) -> Result<Option<String>> {
    Ok(field(header, name)?.map(|text| String::from_utf8_lossy(text).into_owned()))
}

/// Reads the messages of records, also of those in chunks.
struct MessageReader<T> {
    /// Types and topics by connection number.
    connections: HashMap<u32, (String, String)>,
    budget: DecompressionBudget,
    take: T,
}

impl<T: FnMut(&str, &str, &[u8])> MessageReader<T> {
    fn read(&mut self, record: &Record) -> Result<()> {
        match record.op()? {
            CHUNK => {
                let chunk = inflate(record, &mut self.budget)?;
                let mut from = chunk.as_slice();
                while let Some(record) = Record::read(&mut from)? {
                    // Chunks do not nest.
                    if record.op()? != CHUNK {
                        self.read(&record)?;
                    }
                }
                if !record.is_whole {
                    return Err(ErrorKind::UnexpectedEof.into());
                }
            }
            CONNECTION => {
                let topic = text_field(&record.header, "topic")?;
                let topic =
                    topic.map_or_else(|| text_field(&record.data, "topic"), |topic| Ok(Some(topic)))?;
                let kind = text_field(&record.data, "type")?;
                let of = (kind.unwrap_or_default(), topic.unwrap_or_default());
                self.connections.insert(record.connection()?, of);
            }
            MESSAGE => {
                if let Some((kind, topic)) = self.connections.get(&record.connection()?) {
                    (self.take)(kind, topic, &record.data);
                }
            }
            _ => {}
        }
        Ok(())
    }
}

/// The records of a chunk.
fn inflate(chunk: &Record, budget: &mut DecompressionBudget) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let data = chunk.data.as_slice();
    let most = LARGEST.min(budget.left()) + 1;
    let inflated = match field(&chunk.header, "compression")?.unwrap_or(b"none") {
        b"none" => return Ok(data.to_vec()),
        b"lz4" => lz4_flex::frame::FrameDecoder::new(data).take(most).read_to_end(&mut bytes),
        b"bz2" => bzip2::read::BzDecoder::new(data).take(most).read_to_end(&mut bytes),
        _ => return Err(damaged("an unknown compression")),
    };
    if inflated.is_err() && chunk.is_whole {
        return Err(damaged("compressed data that cannot be read"));
    }
    if bytes.len() as u64 > LARGEST {
        return Err(damaged("compressed data that is too large"));
    }
    budget.take(bytes.len() as u64).map_err(|TooCompressed| damaged(&TooCompressed.to_string()))?;
    let stated = field(&chunk.header, "size")?.and_then(<[u8]>::first_chunk);
    let stated = stated.map(|bytes| u32::from_le_bytes(*bytes) as usize);
    if chunk.is_whole && stated.is_some_and(|stated| stated != bytes.len()) {
        return Err(damaged("a chunk of another size than it states"));
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn part_of(bytes: &[u8]) -> Vec<u8> {
        [&(bytes.len() as u32).to_le_bytes()[..], bytes].concat()
    }

    fn record(fields: &[(&str, &[u8])], data: &[u8]) -> Vec<u8> {
        let field = |(name, value): &(&str, &[u8])| part_of(&[name.as_bytes(), b"=", value].concat());
        let header: Vec<u8> = fields.iter().flat_map(field).collect();
        [part_of(&header), part_of(data)].concat()
    }

    /// A bag with a connection and two messages in a chunk.
    fn bag(compression: &[u8]) -> Vec<u8> {
        let told = [part_of(b"type=a/B"), part_of(b"topic=/elsewhere")].concat();
        let connection =
            record(&[("op", &[CONNECTION]), ("conn", &[3, 0, 0, 0]), ("topic", b"/here")], &told);
        let message = |data: &[u8]| record(&[("op", &[MESSAGE]), ("conn", &[3, 0, 0, 0])], data);
        let chunk = [connection, message(b"one"), message(b"two")].concat();
        let chunk = record(&[("op", &[CHUNK]), ("compression", compression)], &chunk);
        [ROS1_MAGIC, &record(&[("op", &[3])], b"   "), &chunk].concat()
    }

    fn messages(bag: &[u8]) -> (Option<Truncation>, Vec<String>) {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), bag).unwrap();
        let mut found = Vec::new();
        let truncation = read(file.path(), |kind, topic, data| {
            found.push(format!("{kind} {topic} {}", String::from_utf8_lossy(data)));
        });
        (truncation.unwrap(), found)
    }

    #[test]
    fn messages_come_with_their_types_and_topics() {
        let (truncation, found) = messages(&bag(b"none"));
        assert_eq!((truncation, found), (None, vec!["a/B /here one".to_owned(), "a/B /here two".to_owned()]));
    }

    #[test]
    fn a_chunk_that_is_torn_gives_what_it_has() {
        let whole = bag(b"none");
        let (truncation, found) = messages(&whole[..whole.len() - 2]);
        assert_eq!(truncation, Some(Truncation::Torn));
        assert_eq!(found, ["a/B /here one"]);
        let (truncation, _) = messages(&bag(b"nine"));
        // Behind the magic bytes and the bag's header.
        let unknown = Truncation::Damaged { offset: 32, reason: "an unknown compression".to_owned() };
        assert_eq!(truncation, Some(unknown));
    }

    /// A bag whose chunk has `data`, compressed as LZ4, and states `size` bytes.
    fn lz4_bag(data: &[u8], size: u32) -> Vec<u8> {
        let mut encoder = lz4_flex::frame::FrameEncoder::new(Vec::new());
        std::io::Write::write_all(&mut encoder, data).unwrap();
        let fields: [(&str, &[u8]); 3] =
            [("op", &[CHUNK]), ("compression", b"lz4"), ("size", &size.to_le_bytes())];
        [ROS1_MAGIC, &record(&fields, &encoder.finish().unwrap())].concat()
    }

    fn damage(bag: &[u8]) -> String {
        messages(bag).0.filter(Truncation::is_damage).unwrap().to_string()
    }

    #[test]
    fn chunks_that_grow_too_large_or_to_another_size_are_refused() {
        let message = record(&[("op", &[MESSAGE]), ("conn", &[3, 0, 0, 0])], b"one");
        let size = message.len() as u32;
        assert_eq!(messages(&lz4_bag(&message, size)).0, None);
        assert!(damage(&lz4_bag(&message, size + 1)).contains("another size than it states"));
        let zeros = vec![0; 100 << 20];
        let said = damage(&lz4_bag(&zeros, zeros.len() as u32));
        assert!(said.contains("decompress the file first"), "{said}");
    }

    #[test]
    fn a_bag_of_nothing_but_zeros_ends_at_once() {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), ROS1_MAGIC).unwrap();
        file.as_file().set_len(20 << 30).unwrap();
        let truncation = read(file.path(), |_, _, _| ()).unwrap().unwrap();
        assert_eq!(truncation.to_string(), "it is damaged at byte 13: a record without a kind");
    }

    proptest! {
        #[test]
        fn no_damage_is_too_strange(at in 13_usize..200, byte: u8) {
            let mut bag = bag(b"none");
            let at = 13 + at % (bag.len() - 13);
            bag[at] = byte;
            // Read, or reported as damaged.
            let _ = messages(&bag);
        }
    }
}
