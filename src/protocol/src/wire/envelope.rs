//! Envelope of a datagram: header, and a checksum or message authentication code at its end.

use super::bytes::{ByteReader, ByteWriter};
use super::{DecodeError, DecodeFault};
use hmac::{Hmac, KeyInit, Mac};
use sha2::Sha256;
use std::fmt;

/// Version of the wire format.
pub const VERSION: u8 = 2;
/// The first bytes of every datagram.
pub const MAGIC: [u8; 4] = *b"C3DL";
/// Longest datagram: it passes common networks without fragmentation.
pub const MAX_DATAGRAM_BYTES: usize = 1200;
/// Length of the header.
pub const HEADER_BYTES: usize = 36;
/// Length of a CRC-32.
const CHECKSUM_BYTES: usize = 4;
/// Length of the tag: HMAC-SHA-256 truncated to its left half (RFC 2104, section 5).
const TAG_BYTES: usize = 16;
/// Length of the shortest `Hello` of version 1, which had eight bytes and a checksum; that of this version is longer.
pub(super) const MIN_HELLO_BYTES: usize = HEADER_BYTES + 8 + CHECKSUM_BYTES;
/// Longest body, with either trailer.
pub const MAX_BODY_BYTES: usize = MAX_DATAGRAM_BYTES - HEADER_BYTES - TAG_BYTES;

/// Flag of a datagram that ends with a tag instead of a checksum.
const AUTHENTICATED: u16 = 1;
/// Shortest key.
pub const MIN_KEY_BYTES: usize = 16;

/// Header of a datagram: the sessions of sender and receiver, and a sequence number.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DatagramHeader {
    /// Kind of the body.
    pub kind: u8,
    /// Session of the sender: a random number drawn at its start.
    pub session: u64,
    /// To a city, its challenge to the sender; from a city, the session of the receiver. 0 while the sender has none.
    pub peer: u64,
    /// The world of the city; 0 is any.
    pub world: u32,
    /// Sequence number of the datagram to this peer, from 1.
    pub sequence: u64,
}

impl DatagramHeader {
    /// Header of a datagram that was not verified: anyone may have written it. `None` when the datagram is shorter.
    pub(super) fn unverified(bytes: &[u8]) -> Option<Self> {
        let mut read = ByteReader::new(bytes, MAGIC.len() + 1);
        let kind = read.u8("kind").ok()?;
        read.u16("flags").ok()?;
        Self::read(kind, &mut read).ok()
    }

    /// Reads the fields behind the flags.
    fn read(kind: u8, from: &mut ByteReader<'_>) -> Result<Self, DecodeError> {
        Ok(Self {
            kind,
            session: from.u64("session")?,
            peer: from.u64("peer")?,
            sequence: from.u64("sequence")?,
            world: from.u32("world")?,
        })
    }
}

/// Seals and verifies datagrams: by a CRC-32 against damage, or by a message authentication code (HMAC-SHA-256, RFC
/// 2104) with a shared key.
#[derive(Clone, Default)]
pub enum Authenticator {
    /// CRC-32: detects damage, but anyone can make one.
    #[default]
    Checksum,
    /// HMAC-SHA-256 with this key.
    Key(Vec<u8>),
}

impl fmt::Debug for Authenticator {
    /// Does not print the key.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Checksum => "Checksum",
            Self::Key(_) => "Key",
        })
    }
}

impl Authenticator {
    fn flags(&self) -> u16 {
        match self {
            Self::Checksum => 0,
            Self::Key(_) => AUTHENTICATED,
        }
    }

    fn tag(key: &[u8], bytes: &[u8]) -> Option<Hmac<Sha256>> {
        let mut mac = <Hmac<Sha256> as KeyInit>::new_from_slice(key).ok()?;
        mac.update(bytes);
        Some(mac)
    }

    /// Encloses a body in header and checksum or tag.
    pub(super) fn seal(&self, header: DatagramHeader, body: &[u8]) -> Vec<u8> {
        self.seal_as(VERSION, header, body)
    }

    /// The same for a receiver of another version, whose header is the same.
    pub(super) fn seal_as(&self, version: u8, header: DatagramHeader, body: &[u8]) -> Vec<u8> {
        let mut datagram = ByteWriter::default();
        datagram.bytes.reserve(HEADER_BYTES + body.len() + TAG_BYTES);
        datagram.bytes.extend_from_slice(&MAGIC);
        datagram.u8(version);
        datagram.u8(header.kind);
        datagram.u16(self.flags());
        datagram.u64(header.session);
        datagram.u64(header.peer);
        datagram.u64(header.sequence);
        datagram.u32(header.world);
        datagram.bytes.extend_from_slice(body);
        match self {
            Self::Checksum => datagram.u32(crc32fast::hash(&datagram.bytes)),
            Self::Key(key) => {
                // HMAC takes keys of any length.
                if let Some(mac) = Self::tag(key, &datagram.bytes) {
                    datagram.bytes.extend_from_slice(&mac.finalize().into_bytes()[..TAG_BYTES]);
                }
            }
        }
        datagram.bytes
    }

    /// Verifies a datagram, in constant time for a tag; returns the header and the offset of the end of the body.
    pub(super) fn verify(&self, bytes: &[u8]) -> Result<(DatagramHeader, usize), DecodeError> {
        let fail = |field, offset, fault| Err(DecodeError { field, offset, fault });
        let mut read = ByteReader::new(bytes, 0);
        let magic = [(); 4].map(|()| read.u8("magic"));
        if magic.iter().zip(MAGIC).any(|(found, byte)| *found != Ok(byte)) {
            return fail("magic", 0, DecodeFault::Magic);
        }
        if bytes.len() > MAX_DATAGRAM_BYTES {
            return fail("end", 0, DecodeFault::Long { found: bytes.len(), most: MAX_DATAGRAM_BYTES });
        }
        let version = read.u8("version")?;
        if version != VERSION {
            return fail("version", 4, DecodeFault::Version { found: version });
        }
        let kind = read.u8("kind")?;
        let flags = read.u16("flags")?;
        match (flags, self) {
            (0, Self::Checksum) | (AUTHENTICATED, Self::Key(_)) => {}
            (0, Self::Key(_)) => return fail("flags", 6, DecodeFault::Unauthenticated),
            (AUTHENTICATED, Self::Checksum) => return fail("flags", 6, DecodeFault::NoKey),
            _ => return fail("flags", 6, DecodeFault::Unknown { found: flags.into(), known: "0 and 1" }),
        }
        let header = DatagramHeader::read(kind, &mut read)?;
        let size = if flags == 0 { CHECKSUM_BYTES } else { TAG_BYTES };
        let left = bytes.len() - HEADER_BYTES;
        let Some(end) = bytes.len().checked_sub(size).filter(|end| *end >= HEADER_BYTES) else {
            return fail("check", HEADER_BYTES, DecodeFault::Short { needed: size, left });
        };
        let (checked, check) = bytes.split_at(end);
        let is_good = match self {
            Self::Checksum => crc32fast::hash(checked).to_le_bytes() == check,
            Self::Key(key) => {
                Self::tag(key, checked).is_some_and(|mac| mac.verify_truncated_left(check).is_ok())
            }
        };
        if is_good { Ok((header, end)) } else { fail("check", end, DecodeFault::Check) }
    }
}
