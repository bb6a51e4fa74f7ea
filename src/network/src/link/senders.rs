//! Table of senders: their sessions by address, replay protection and rate limit of each.

use super::AntiReplayWindow;
use city3d_protocol::wire::{DatagramHeader, DropReason};
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::net::SocketAddr;
use std::time::{Duration, Instant};

/// Addresses that are known at once, at most.
const MAX_SENDERS: usize = 256;
/// Retired sessions that are remembered, and never accepted again.
const MAX_RETIRED: usize = 4096;
/// When the table is full, a sender that has been silent for this long is evicted for another.
const EVICTION_TIMEOUT: Duration = Duration::from_secs(10);

/// Identifies one session of a sender within this process.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct SenderId(pub u32);

/// Token bucket: rate limiter with `rate_per_s` tokens per second and a burst of as many (Tanenbaum, *Computer Networks*,
/// traffic shaping).
///
/// ```
/// use city3d_network::link::TokenBucket;
/// use std::time::{Duration, Instant};
///
/// let start = Instant::now();
/// let mut bucket = TokenBucket::full(start, 2.0);
/// assert!(bucket.take(start, 2.0) && bucket.take(start, 2.0));
/// assert!(!bucket.take(start, 2.0));
/// assert!(bucket.take(start + Duration::from_millis(500), 2.0));
/// ```
#[derive(Clone, Copy, Debug)]
pub struct TokenBucket {
    tokens: f64,
    refilled: Instant,
}

impl TokenBucket {
    /// A bucket with all its tokens at this instant: it lets a whole burst pass.
    pub fn full(now: Instant, rate_per_s: f64) -> Self {
        Self { tokens: rate_per_s, refilled: now }
    }

    /// Takes a token; `false` when the bucket is empty.
    pub fn take(&mut self, now: Instant, rate_per_s: f64) -> bool {
        let elapsed_s = now.saturating_duration_since(self.refilled).as_secs_f64();
        self.tokens = (self.tokens + elapsed_s * rate_per_s).min(rate_per_s);
        self.refilled = now;
        let passes = self.tokens >= 1.0;
        self.tokens -= f64::from(u8::from(passes));
        passes
    }
}

#[derive(Debug)]
struct SenderState {
    id: SenderId,
    session: u64,
    window: AntiReplayWindow,
    bucket: TokenBucket,
    last_seen: Instant,
    /// Sequence number of the last datagram to it.
    sequence: u64,
}

/// Address of a reply, with the session and sequence number of its datagram.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReplyAddress {
    /// IP address and port of the sender.
    pub address: SocketAddr,
    /// Session of the sender, by which it recognises its replies.
    pub session: u64,
    /// Sequence number of the reply; it counts from 1 in each session.
    pub sequence: u64,
}

/// The known senders, bounded in number.
#[derive(Debug)]
pub struct Senders {
    by_address: BTreeMap<SocketAddr, SenderState>,
    addresses: BTreeMap<SenderId, SocketAddr>,
    retired: BTreeSet<(SocketAddr, u64)>,
    /// The same sessions, oldest first.
    retired_in_order: VecDeque<(SocketAddr, u64)>,
    next: u32,
    rate_per_s: f64,
    /// Lost datagrams of senders that are no longer known.
    missing: u64,
}

impl Senders {
    /// An empty table; each address may send so many datagrams per second.
    pub fn new(rate_per_s: f64) -> Self {
        Self {
            by_address: BTreeMap::new(),
            addresses: BTreeMap::new(),
            retired: BTreeSet::new(),
            retired_in_order: VecDeque::new(),
            next: 1,
            rate_per_s,
            missing: 0,
        }
    }

    /// Whether the rate limit lets an address send now; unknown addresses have no limit yet.
    pub fn may_send(&mut self, address: SocketAddr, now: Instant) -> bool {
        self.by_address.get_mut(&address).is_none_or(|sender| sender.bucket.take(now, self.rate_per_s))
    }

    /// Checks session and sequence number of an authentic datagram, and gives its sender.
    ///
    /// # Errors
    /// The reason to drop it.
    pub fn admit(
        &mut self,
        address: SocketAddr,
        header: &DatagramHeader,
        now: Instant,
    ) -> Result<SenderId, DropReason> {
        if self.by_address.get(&address).is_none_or(|sender| sender.session != header.session) {
            self.begin_session(address, header.session, now)?;
        }
        let Some(sender) = self.by_address.get_mut(&address) else { return Err(DropReason::Full) };
        sender.window.check(header.sequence)?;
        sender.last_seen = now;
        Ok(sender.id)
    }

    /// Marks the sequence number of an admitted datagram as received.
    pub fn mark_received(&mut self, address: SocketAddr, sequence: u64) {
        if let Some(sender) = self.by_address.get_mut(&address) {
            sender.window.mark_received(sequence);
        }
    }

    /// Whether `count` datagrams of a sender have come, from sequence number `first` on.
    pub fn has_all(&self, address: SocketAddr, first: u64, count: u32) -> bool {
        self.by_address.get(&address).is_some_and(|sender| sender.window.has_all(first, count))
    }

    fn begin_session(&mut self, address: SocketAddr, session: u64, now: Instant) -> Result<(), DropReason> {
        if session == 0 {
            return Err(DropReason::Malformed);
        }
        if self.retired.contains(&(address, session)) {
            return Err(DropReason::Stale);
        }
        let bucket = match self.retire(address) {
            Some(old) => old.bucket,
            None => TokenBucket::full(now, self.rate_per_s),
        };
        if self.by_address.len() >= MAX_SENDERS {
            let stalest = self.by_address.iter().min_by_key(|(_, sender)| sender.last_seen);
            let stalest = stalest.map(|(address, sender)| (*address, sender.last_seen));
            match stalest
                .filter(|(_, last_seen)| now.saturating_duration_since(*last_seen) > EVICTION_TIMEOUT)
            {
                Some((address, _)) => drop(self.retire(address)),
                None => return Err(DropReason::Full),
            }
        }
        let id = SenderId(self.next);
        self.next += 1;
        let sender = SenderState {
            id,
            session,
            window: AntiReplayWindow::default(),
            bucket,
            last_seen: now,
            sequence: 0,
        };
        self.by_address.insert(address, sender);
        self.addresses.insert(id, address);
        Ok(())
    }

    fn retire(&mut self, address: SocketAddr) -> Option<SenderState> {
        let old = self.by_address.remove(&address)?;
        self.addresses.remove(&old.id);
        if self.retired_in_order.len() == MAX_RETIRED
            && let Some(oldest) = self.retired_in_order.pop_front()
        {
            self.retired.remove(&oldest);
        }
        self.retired.insert((address, old.session));
        self.retired_in_order.push_back((address, old.session));
        self.missing += old.window.missing();
        Some(old)
    }

    /// Where to send the next datagram for a sender; `None` once its session has ended.
    pub fn next_reply(&mut self, id: SenderId) -> Option<ReplyAddress> {
        let address = *self.addresses.get(&id)?;
        let sender = self.by_address.get_mut(&address)?;
        sender.sequence += 1;
        Some(ReplyAddress { address, session: sender.session, sequence: sender.sequence })
    }

    /// The address of a sender; `None` once its session has ended.
    pub fn address(&self, id: SenderId) -> Option<SocketAddr> {
        self.addresses.get(&id).copied()
    }

    /// Datagrams lost on their way, by the gaps in the sequence numbers.
    pub fn missing(&self) -> u64 {
        self.missing + self.by_address.values().map(|sender| sender.window.missing()).sum::<u64>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn header(session: u64, sequence: u64) -> DatagramHeader {
        DatagramHeader { session, sequence, ..DatagramHeader::default() }
    }

    fn address(port: u16) -> SocketAddr {
        SocketAddr::from(([127, 0, 0, 1], port))
    }

    #[test]
    fn a_session_that_was_given_up_is_never_taken_again() {
        let (mut senders, now) = (Senders::new(100.0), Instant::now());
        let first = senders.admit(address(1), &header(7, 1), now).unwrap();
        let second = senders.admit(address(1), &header(8, 1), now).unwrap();
        assert_ne!(first, second);
        assert_eq!(senders.admit(address(1), &header(7, 2), now), Err(DropReason::Stale));
        assert_eq!(senders.address(first), None);
        assert_eq!(senders.next_reply(second).unwrap().sequence, 1);
        assert_eq!(senders.admit(address(1), &header(0, 1), now), Err(DropReason::Malformed));
    }

    #[test]
    fn the_number_of_senders_is_bounded_and_silent_ones_make_room() {
        let (mut senders, now) = (Senders::new(100.0), Instant::now());
        for port in 1..=MAX_SENDERS as u16 {
            assert!(senders.admit(address(port), &header(1, 1), now).is_ok());
        }
        assert_eq!(senders.admit(address(999), &header(1, 1), now), Err(DropReason::Full));
        let later = now + EVICTION_TIMEOUT + Duration::from_secs(1);
        assert!(senders.admit(address(999), &header(1, 1), later).is_ok());
        assert!(senders.by_address.len() <= MAX_SENDERS);
    }

    #[test]
    fn nobody_sends_faster_than_the_bucket_fills() {
        let (mut senders, now) = (Senders::new(50.0), Instant::now());
        senders.admit(address(1), &header(7, 1), now).unwrap();
        let passed = (0..200).filter(|_| senders.may_send(address(1), now)).count();
        assert_eq!(passed, 50);
        let later = now + Duration::from_millis(100);
        assert_eq!((0..200).filter(|_| senders.may_send(address(1), later)).count(), 5);
        // A new session of the same address begins with what is left.
        senders.admit(address(1), &header(9, 1), later).unwrap();
        assert!(!senders.may_send(address(1), later));
    }
}
