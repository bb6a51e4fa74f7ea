//! Little-endian primitives of datagrams, and decoding errors.

use super::VERSION;
use thiserror::Error;

/// Decoding error: the fault, its field and its offset.
#[derive(Clone, Debug, Error, PartialEq)]
#[error("{field}, byte {offset}: {fault}")]
pub struct DecodeError {
    /// Name of the field in `docs/wire.md`.
    pub field: &'static str,
    /// Bytes from the start of the datagram.
    pub offset: usize,
    /// What is wrong with the field.
    pub fault: DecodeFault,
}

/// Fault of a field.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum DecodeFault {
    /// The datagram ends too early: bytes that the field takes, and bytes that are left.
    #[error("{needed} bytes are needed here, {left} are left")]
    Short {
        /// Bytes that the field takes.
        needed: usize,
        /// Bytes between its offset and the end of the datagram.
        left: usize,
    },
    /// The datagram or a text is too long: its bytes, and the limit.
    #[error("{found} bytes are longer than {most}")]
    Long {
        /// Length of the datagram or text, bytes.
        found: usize,
        /// Largest length allowed, bytes.
        most: usize,
    },
    /// Bytes follow the last field: their number.
    #[error("{found} bytes too many")]
    Trailing {
        /// Number of bytes after the last field.
        found: usize,
    },
    /// The first bytes are not [`MAGIC`](super::MAGIC).
    #[error("it does not begin with C3DL, as datagrams of this link do")]
    Magic,
    /// Another version of the wire format than [`VERSION`].
    #[error("version {found}; this program speaks version {VERSION}")]
    Version {
        /// Version that the header names.
        found: u8,
    },
    /// Checksum or tag does not match the bytes.
    #[error("its checksum or tag does not match: it was damaged on its way, or made with another key")]
    Check,
    /// A checksum where the receiver requires a tag made with the shared key.
    #[error("not authenticated, and this end requires the shared key")]
    Unauthenticated,
    /// A tag that the receiver cannot verify, for want of the shared key.
    #[error("authenticated with a shared key, and this end has none")]
    NoKey,
    /// A number is infinite or NaN.
    #[error("not a finite number")]
    NotFinite,
    /// A number outside of its range: the number and both limits, which are allowed.
    #[error("{found}; it must be between {least} and {most}")]
    OutOfRange {
        /// The number as read, in the unit of its field.
        found: f64,
        /// Smallest number allowed.
        least: f64,
        /// Largest number allowed.
        most: f64,
    },
    /// A number without a meaning: the number, and those that have one.
    #[error("{found} is unknown; there are {known}")]
    Unknown {
        /// The number as read.
        found: u64,
        /// The numbers that have a meaning, as text.
        known: &'static str,
    },
    /// A text is not valid UTF-8.
    #[error("not UTF-8 text")]
    NotText,
    /// The time of a waypoint does not exceed that of the one before.
    #[error("not later than the one before")]
    NotLater,
}

/// Encoding error: a value that does not fit in a datagram.
#[derive(Clone, Debug, Error, PartialEq)]
#[error("{what}: {found}; at most {most} fit in a datagram")]
pub struct EncodeError {
    /// Name of the text or list, or the whole body.
    pub what: &'static str,
    /// Its length in bytes, or its number of items.
    pub found: usize,
    /// Largest length or number that fits.
    pub most: usize,
}

/// Appends little-endian primitives to a datagram.
#[derive(Clone, Debug, Default)]
pub(super) struct ByteWriter {
    /// What has been written so far.
    pub bytes: Vec<u8>,
}

impl ByteWriter {
    pub fn u8(&mut self, value: u8) {
        self.bytes.push(value);
    }

    pub fn u16(&mut self, value: u16) {
        self.bytes.extend_from_slice(&value.to_le_bytes());
    }

    pub fn u32(&mut self, value: u32) {
        self.bytes.extend_from_slice(&value.to_le_bytes());
    }

    pub fn u64(&mut self, value: u64) {
        self.bytes.extend_from_slice(&value.to_le_bytes());
    }

    pub fn f64(&mut self, value: f64) {
        self.bytes.extend_from_slice(&value.to_le_bytes());
    }

    /// Writes the length in one byte, then the text in UTF-8.
    pub fn text(&mut self, what: &'static str, text: &str, most: usize) -> Result<(), EncodeError> {
        self.count(what, text.len(), most)?;
        self.bytes.extend_from_slice(text.as_bytes());
        Ok(())
    }

    /// Writes the number of following items in one byte.
    pub fn count(&mut self, what: &'static str, found: usize, most: usize) -> Result<(), EncodeError> {
        let byte = u8::try_from(found).ok().filter(|_| found <= most);
        self.u8(byte.ok_or(EncodeError { what, found, most })?);
        Ok(())
    }
}

/// Reads little-endian primitives of a datagram, with bounds checks.
#[derive(Clone, Debug)]
pub(super) struct ByteReader<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> ByteReader<'a> {
    /// Starts at a byte offset of a datagram.
    pub fn new(bytes: &'a [u8], at: usize) -> Self {
        Self { bytes, at }
    }

    /// The error of a field of `size` bytes that has just been read.
    pub fn error(&self, field: &'static str, size: usize, fault: DecodeFault) -> DecodeError {
        DecodeError { field, offset: self.at - size, fault }
    }

    fn take(&mut self, field: &'static str, needed: usize) -> Result<&'a [u8], DecodeError> {
        let left = self.bytes.len().saturating_sub(self.at);
        if needed > left {
            return Err(self.error(field, 0, DecodeFault::Short { needed, left }));
        }
        self.at += needed;
        Ok(&self.bytes[self.at - needed..self.at])
    }

    fn array<const N: usize>(&mut self, field: &'static str) -> Result<[u8; N], DecodeError> {
        let mut array = [0; N];
        array.copy_from_slice(self.take(field, N)?);
        Ok(array)
    }

    pub fn u8(&mut self, field: &'static str) -> Result<u8, DecodeError> {
        self.array::<1>(field).map(|[byte]| byte)
    }

    pub fn u16(&mut self, field: &'static str) -> Result<u16, DecodeError> {
        self.array(field).map(u16::from_le_bytes)
    }

    pub fn u32(&mut self, field: &'static str) -> Result<u32, DecodeError> {
        self.array(field).map(u32::from_le_bytes)
    }

    pub fn u64(&mut self, field: &'static str) -> Result<u64, DecodeError> {
        self.array(field).map(u64::from_le_bytes)
    }

    /// Reads a finite number within a range.
    pub fn number(&mut self, field: &'static str, least: f64, most: f64) -> Result<f64, DecodeError> {
        let found = self.array(field).map(f64::from_le_bytes)?;
        if !found.is_finite() {
            return Err(self.error(field, 8, DecodeFault::NotFinite));
        }
        if !(least..=most).contains(&found) {
            return Err(self.error(field, 8, DecodeFault::OutOfRange { found, least, most }));
        }
        Ok(found)
    }

    /// Checks the range of an integer that has just been read.
    pub fn within<T>(&self, field: &'static str, found: T, (least, most): (T, T)) -> Result<T, DecodeError>
    where
        T: Copy + PartialOrd + Into<u32>,
    {
        if found >= least && found <= most {
            return Ok(found);
        }
        let [found, least, most] = [found, least, most].map(|value| f64::from(value.into()));
        Err(self.error(field, size_of::<T>(), DecodeFault::OutOfRange { found, least, most }))
    }

    /// Reads a byte as an index into `all`.
    pub fn one_of<T: Copy>(
        &mut self,
        field: &'static str,
        all: &[T],
        known: &'static str,
    ) -> Result<T, DecodeError> {
        let found = self.u8(field)?;
        all.get(usize::from(found))
            .copied()
            .ok_or_else(|| self.error(field, 1, DecodeFault::Unknown { found: found.into(), known }))
    }

    /// Reads a text of at most `most` bytes: its length in one byte, then UTF-8.
    pub fn text(&mut self, field: &'static str, most: usize) -> Result<String, DecodeError> {
        let length = usize::from(self.u8(field)?);
        if length > most {
            return Err(self.error(field, 1, DecodeFault::Long { found: length, most }));
        }
        let bytes = self.take(field, length)?;
        let text = std::str::from_utf8(bytes).map_err(|_| self.error(field, length, DecodeFault::NotText))?;
        Ok(text.to_owned())
    }

    /// Checks that no bytes are left.
    pub fn finish(self) -> Result<(), DecodeError> {
        match self.bytes.len().saturating_sub(self.at) {
            0 => Ok(()),
            found => Err(self.error("end", 0, DecodeFault::Trailing { found })),
        }
    }
}
