//! Bounds on what others can make this process keep. A participant of DDS listens to whoever reaches its ports, so everything that
//! grows with what others say is bounded here; what is beyond is dropped and counted.

use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};

use crate::{
  messages::submessages::submessages::{ReaderSubmessage, WriterSubmessage},
  rtps::{Submessage, SubmessageBody},
  structure::{guid::EntityId, locator::Locator, sequence_number::SequenceNumber},
};

/// Longest message that is put together from fragments, bytes.
pub const MAX_FRAGMENTED_BYTES: usize = 4 << 20;
/// The same of discovery's own messages, bytes.
pub const MAX_FRAGMENTED_BUILTIN_BYTES: usize = 64 << 10;
/// Half-assembled messages of a reader, and of the process, bytes.
pub(crate) const MAX_ASSEMBLY_BYTES_PER_READER: usize = 8 << 20;
pub(crate) const MAX_ASSEMBLY_BYTES: usize = 64 << 20;
/// Received messages that a topic keeps, bytes.
pub(crate) const MAX_CACHED_BYTES_PER_TOPIC: usize = 8 << 20;
/// What keeping anything costs beside its content, roughly, bytes.
pub(crate) const OVERHEAD_BYTES: usize = 512;

/// Participants that are listened to, and those among them that send from one socket.
pub(crate) const MAX_PEERS: usize = 1024;
pub(crate) const MAX_PEERS_PER_SOURCE: usize = 32;
/// Silence after which another participant may take the place of one.
pub(crate) const MAX_SILENCE: std::time::Duration = std::time::Duration::from_secs(30);
/// Longest lease that a participant can ask for, seconds.
pub(crate) const MAX_LEASE_S: i32 = 120;
/// Readers and writers that discovery knows, and those among them of one participant.
pub(crate) const MAX_ENDPOINTS: usize = 8192;
pub(crate) const MAX_ENDPOINTS_PER_PARTICIPANT: usize = 2048;
/// Readers matched to a writer or writers to a reader, and those among them of one participant.
pub(crate) const MAX_MATCHES: usize = 1024;
pub(crate) const MAX_MATCHES_PER_PARTICIPANT: usize = 64;
/// Names and addresses of an announcement, bytes.
const MAX_ANNOUNCED_BYTES: usize = 4096;
/// What discovery remembers of topics, and keys and writers that a reader remembers.
pub(crate) const MAX_TOPIC_RECORDS: usize = 16384;
pub(crate) const MAX_REMEMBERED: usize = 16384;
/// Datagrams that are read at a time, and before others have their turn.
pub(crate) const MAX_READ_AT_ONCE: usize = 64;
pub(crate) const MAX_READS_IN_A_ROW: usize = 16;
/// Missing messages that are asked for at a time: as many as fit into an ACKNACK.
pub(crate) const MAX_MISSING: usize = 256;
/// Datagrams of the protocol itself that wait for a socket.
pub(crate) const MAX_CONTROL_QUEUE: usize = 4096;
/// Messages of which a reader may ask for fragments at a time.
pub(crate) const MAX_FRAGMENT_REQUESTS: usize = 64;
/// Largest number of a message and of a fragment that anybody can have reached.
const MAX_SEQUENCE_NUMBER: i64 = 1 << 48;
const MAX_FRAGMENT_NUMBER: i64 = 1 << 20;

static DROPPED: AtomicU64 = AtomicU64::new(0);
static ASSEMBLY_BYTES: AtomicUsize = AtomicUsize::new(0);

/// What was dropped in this process because it was beyond a bound: datagrams, submessages, announcements and
/// half-assembled messages.
pub fn dropped() -> u64 {
  DROPPED.load(Ordering::Relaxed)
}

/// Counts something as dropped.
pub(crate) fn drop_one() {
  drop_some(1);
}

/// Counts so many as dropped.
pub(crate) fn drop_some(count: u64) {
  DROPPED.fetch_add(count, Ordering::Relaxed);
}

/// Memory of a half-assembled message.
#[derive(Debug)]
pub(crate) struct AssemblyShare(usize);

impl AssemblyShare {
  /// `None` where the process has no more for it.
  pub fn take(bytes: usize) -> Option<Self> {
    let fits = |used: usize| Some(used + bytes).filter(|used| *used <= MAX_ASSEMBLY_BYTES);
    let taken = ASSEMBLY_BYTES.fetch_update(Ordering::Relaxed, Ordering::Relaxed, fits);
    taken.ok().map(|_| Self(bytes))
  }

  pub fn bytes(&self) -> usize {
    self.0
  }
}

impl Drop for AssemblyShare {
  fn drop(&mut self) {
    ASSEMBLY_BYTES.fetch_sub(self.0, Ordering::Relaxed);
  }
}

/// Longest fragmented message that a reader takes, bytes.
pub(crate) fn max_fragmented_bytes(reader: EntityId) -> usize {
  match reader.entity_kind.is_user_defined() {
    true => MAX_FRAGMENTED_BYTES,
    false => MAX_FRAGMENTED_BUILTIN_BYTES,
  }
}

/// Whether the numbers of a submessage can be true. Arithmetic with others overflows.
pub(crate) fn is_plausible(submessage: &Submessage) -> bool {
  let is_number = |number: SequenceNumber| i64::from(number).abs() <= MAX_SEQUENCE_NUMBER;
  match &submessage.body {
    SubmessageBody::Writer(WriterSubmessage::Data(data, _)) => is_number(data.writer_sn),
    SubmessageBody::Writer(WriterSubmessage::DataFrag(frag, _)) => is_number(frag.writer_sn),
    SubmessageBody::Writer(WriterSubmessage::Heartbeat(heartbeat, _)) => {
      is_number(heartbeat.first_sn) && is_number(heartbeat.last_sn)
    }
    SubmessageBody::Writer(WriterSubmessage::Gap(gap, _)) => {
      is_number(gap.gap_start) && is_number(gap.gap_list.base())
    }
    SubmessageBody::Reader(ReaderSubmessage::AckNack(ack, _)) => {
      is_number(ack.reader_sn_state.base())
    }
    SubmessageBody::Reader(ReaderSubmessage::NackFrag(nack, _)) => {
      is_number(nack.writer_sn)
        && (1..=MAX_FRAGMENT_NUMBER).contains(&i64::from(nack.fragment_number_state.base()))
    }
    _ => true,
  }
}

/// Whether the texts, addresses and other data of an announcement are short enough to be kept.
pub(crate) fn is_short(texts: &[&str], locators: &[&[Locator]], data: &[u8]) -> bool {
  let texts: usize = texts.iter().map(|text| size_of::<String>() + text.len()).sum();
  let locators: usize = locators.iter().map(|list| size_of_val(*list)).sum();
  texts + locators + data.len() <= MAX_ANNOUNCED_BYTES
}
