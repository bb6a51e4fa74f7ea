//! What is around every datagram: its header, and the check value at its end.

use super::bytes::{Reader, Writer};
use super::{DecodeError, Fault};
use hmac::{Hmac, KeyInit, Mac};
use sha2::Sha256;
use std::fmt;

/// The version of the datagrams.
pub const VERSION: u8 = 1;
/// The first bytes of every datagram.
pub const MAGIC: [u8; 4] = *b"C3DL";
/// No datagram is longer: it passes every network in one piece.
pub const LONGEST_DATAGRAM: usize = 1200;
/// Bytes before the body.
pub const HEADER_BYTES: usize = 36;
/// Of a CRC-32.
const CHECKSUM_BYTES: usize = 4;
/// Of an HMAC-SHA-256, the first half.
const TAG_BYTES: usize = 16;
/// Bytes that a body may have, whatever check value is behind it.
pub const LONGEST_BODY: usize = LONGEST_DATAGRAM - HEADER_BYTES - TAG_BYTES;

/// Flag of a datagram that ends with a tag in place of a checksum.
const AUTHENTICATED: u16 = 1;
/// Keys are not shorter than this.
pub const SHORTEST_KEY: usize = 16;

/// Who sends, to whom, and which datagram of how many.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Header {
    /// What the body is.
    pub kind: u8,
    /// Of the sender: a number that it chooses anew each time that it starts.
    pub session: u64,
    /// The session of whom it is for; 0 while that is not known.
    pub peer: u64,
    /// The world of the city; 0 is any.
    pub world: u32,
    /// Of the sender, one up for each datagram to this peer, from 1.
    pub sequence: u64,
}

/// How datagrams prove that they are whole, and with a shared key from whom they are.
#[derive(Clone, Default)]
pub enum Seal {
    #[default]
    Checksum,
    /// The key of HMAC-SHA-256.
    Key(Vec<u8>),
}

impl fmt::Debug for Seal {
    /// Without the key.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Checksum => "Checksum",
            Self::Key(_) => "Key",
        })
    }
}

impl Seal {
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

    /// Puts header and check value around a body.
    pub(super) fn close(&self, header: Header, body: &[u8]) -> Vec<u8> {
        let mut datagram = Writer::default();
        datagram.bytes.reserve(HEADER_BYTES + body.len() + TAG_BYTES);
        datagram.bytes.extend_from_slice(&MAGIC);
        datagram.u8(VERSION);
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

    /// Header, and where the body ends; everything before the body has been checked then.
    pub(super) fn open(&self, bytes: &[u8]) -> Result<(Header, usize), DecodeError> {
        let fail = |field, offset, fault| Err(DecodeError { field, offset, fault });
        let mut read = Reader::new(bytes, 0);
        let magic = [(); 4].map(|()| read.u8("magic"));
        if magic.iter().zip(MAGIC).any(|(found, byte)| *found != Ok(byte)) {
            return fail("magic", 0, Fault::Magic);
        }
        if bytes.len() > LONGEST_DATAGRAM {
            return fail("end", 0, Fault::Long { found: bytes.len(), most: LONGEST_DATAGRAM });
        }
        let version = read.u8("version")?;
        if version != VERSION {
            return fail("version", 4, Fault::Version { found: version });
        }
        let kind = read.u8("kind")?;
        let flags = read.u16("flags")?;
        match (flags, self) {
            (0, Self::Checksum) | (AUTHENTICATED, Self::Key(_)) => {}
            (0, Self::Key(_)) => return fail("flags", 6, Fault::Unauthenticated),
            (AUTHENTICATED, Self::Checksum) => return fail("flags", 6, Fault::NoKey),
            _ => return fail("flags", 6, Fault::Unknown { found: flags.into(), known: "0 and 1" }),
        }
        let header = Header {
            kind,
            session: read.u64("session")?,
            peer: read.u64("peer")?,
            sequence: read.u64("sequence")?,
            world: read.u32("world")?,
        };
        let size = if flags == 0 { CHECKSUM_BYTES } else { TAG_BYTES };
        let left = bytes.len() - HEADER_BYTES;
        let Some(end) = bytes.len().checked_sub(size).filter(|end| *end >= HEADER_BYTES) else {
            return fail("check", HEADER_BYTES, Fault::Short { needed: size, left });
        };
        let (checked, check) = bytes.split_at(end);
        let is_good = match self {
            Self::Checksum => crc32fast::hash(checked).to_le_bytes() == check,
            Self::Key(key) => {
                Self::tag(key, checked).is_some_and(|mac| mac.verify_truncated_left(check).is_ok())
            }
        };
        if is_good { Ok((header, end)) } else { fail("check", end, Fault::Check) }
    }
}
