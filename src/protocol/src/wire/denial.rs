//! Denial: tells the sender of a rejected handshake why the city does not answer it.
//!
//! It is no [`Body`](super::Body): a denial is always sealed with a checksum, never with a key, so that whoever has
//! another key or none can read it. It proves nothing for that reason, and only informs.

use super::bytes::{ByteReader, ByteWriter};
use super::envelope::{MAGIC, MIN_HELLO_BYTES, VERSION};
use super::{Authenticator, DatagramHeader, DecodeError, DecodeFault, HEADER_BYTES, body};

const DENIED: u8 = 69;
const KNOWN_REASONS: &str =
    "1 (key needed), 2 (no key), 3 (other key), 4 (other world) and 5 (other version)";
/// Versions whose header this program can read and write.
const SAME_HEADER: std::ops::RangeInclusive<u8> = 1..=VERSION;

/// Reason of a denial.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum DenialReason {
    /// The city requires a shared key, and the datagram had a checksum.
    KeyNeeded = 1,
    /// The city has no shared key, and the datagram had a tag.
    NoKey = 2,
    /// The tag was made with another key than the city's, or the datagram was damaged.
    OtherKey = 3,
    /// The datagram was for another world number.
    OtherWorld = 4,
    /// The datagram has another version of the wire format.
    OtherVersion = 5,
}

impl DenialReason {
    /// All reasons, by their numbers.
    pub const ALL: [Self; 5] =
        [Self::KeyNeeded, Self::NoKey, Self::OtherKey, Self::OtherWorld, Self::OtherVersion];
}

/// Denial of a handshake. The `peer` of its header is the session that the rejected datagram named.
///
/// ```
/// use city3d_protocol::wire::{Authenticator, Body, DatagramHeader, Denial, DenialReason};
///
/// let visitor = DatagramHeader { session: 7, ..DatagramHeader::default() };
/// let hello = Body::Hello { token: 1 }.encode(visitor, &Authenticator::Checksum)?;
/// let denial = Denial { reason: DenialReason::KeyNeeded };
/// let answer = denial.answer(&hello, 1).ok_or("no handshake")?;
/// let (header, read) = Denial::decode(&answer)?;
/// assert_eq!((header.peer, read), (7, denial));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Denial {
    /// Why the city rejects the handshake.
    pub reason: DenialReason,
}

impl Denial {
    /// Encodes the datagram, with a checksum. `header.kind` is ignored.
    pub fn encode(self, header: DatagramHeader) -> Vec<u8> {
        self.encode_as(VERSION, header)
    }

    fn encode_as(self, version: u8, header: DatagramHeader) -> Vec<u8> {
        let mut out = ByteWriter::default();
        out.u8(self.reason as u8);
        Authenticator::Checksum.seal_as(version, DatagramHeader { kind: DENIED, ..header }, &out.bytes)
    }

    /// Encodes the answer of the city of this world to the bytes of a rejected datagram. Only a `Hello` gets one, and none
    /// that is shorter than a whole one: the answer is never longer than the datagram, so that a forged source address
    /// amplifies nothing. It names no session of the city, lest its receiver take it for the handshake. It has the
    /// version of the rejected datagram, so that an old program can read it.
    pub fn answer(self, rejected: &[u8], world: u32) -> Option<Vec<u8>> {
        let header = DatagramHeader::unverified(rejected)?;
        let version = *rejected.get(MAGIC.len())?;
        let is_hello = rejected.starts_with(&MAGIC)
            && SAME_HEADER.contains(&version)
            && header.kind == body::HELLO
            && rejected.len() >= MIN_HELLO_BYTES;
        let header = DatagramHeader { peer: header.session, world, ..DatagramHeader::default() };
        is_hello.then(|| self.encode_as(version, header))
    }

    /// Verifies the checksum of a datagram and decodes it into its header and the denial.
    ///
    /// # Errors
    /// The fault and its place; any datagram of another kind is one.
    pub fn decode(bytes: &[u8]) -> Result<(DatagramHeader, Self), DecodeError> {
        let (header, end) = Authenticator::Checksum.verify(bytes)?;
        if header.kind != DENIED {
            let fault = DecodeFault::Unknown { found: header.kind.into(), known: "69" };
            return Err(DecodeError { field: "kind", offset: 5, fault });
        }
        let mut from = ByteReader::new(&bytes[..end], HEADER_BYTES);
        let found = from.u8("reason")?;
        let fault = DecodeFault::Unknown { found: found.into(), known: KNOWN_REASONS };
        let reason = DenialReason::ALL.into_iter().find(|reason| *reason as u8 == found);
        let reason = reason.ok_or_else(|| from.error("reason", 1, fault))?;
        from.finish()?;
        Ok((header, Self { reason }))
    }
}
