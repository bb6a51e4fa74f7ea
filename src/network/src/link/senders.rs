//! Table of senders: their sessions, with the address, replay protection and rate limit of each.

use super::AntiReplayWindow;
use super::challenges::LIFETIME;
use city3d_protocol::wire::{DatagramHeader, DropReason};
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::net::{IpAddr, SocketAddr};
use std::time::Instant;

/// Sessions that are known at once, at most.
const MAX_SENDERS: usize = 256;
/// Ended sessions that are remembered at most; each for as long as a challenge could begin it again.
const MAX_ENDED: usize = 65_536;

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
    session: u64,
    address: SocketAddr,
    /// What its datagrams name as `peer`.
    challenge: u64,
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
///
/// A session begins when its sender has answered a challenge. From then on it is known by its number, wherever it comes
/// from: it moves to another address only when that address answers a challenge with a new sequence number, and no other
/// session displaces it, except when the table is full: then one that nobody has [kept](Senders::keep) makes room.
#[derive(Debug)]
pub struct Senders {
    by_id: BTreeMap<SenderId, SenderState>,
    by_session: BTreeMap<u64, SenderId>,
    kept: BTreeSet<SenderId>,
    ended: BTreeSet<u64>,
    /// The same sessions with their ends, oldest first.
    ended_in_order: VecDeque<(Instant, u64)>,
    next: u32,
    rate_per_s: f64,
    /// Lost datagrams of senders that are no longer known.
    missing: u64,
}

impl Senders {
    /// An empty table; each sender may send so many datagrams per second.
    pub fn new(rate_per_s: f64) -> Self {
        Self {
            by_id: BTreeMap::new(),
            by_session: BTreeMap::new(),
            kept: BTreeSet::new(),
            ended: BTreeSet::new(),
            ended_in_order: VecDeque::new(),
            next: 1,
            rate_per_s,
            missing: 0,
        }
    }

    /// The sender of an authentic datagram, if its session is known at this address by this challenge.
    pub fn find(&self, address: SocketAddr, header: &DatagramHeader) -> Option<SenderId> {
        let id = *self.by_session.get(&header.session)?;
        let sender = self.by_id.get(&id)?;
        (sender.address == address && sender.challenge == header.peer).then_some(id)
    }

    /// Begins the session of an authentic datagram that answers a fresh challenge, or moves it to this address.
    ///
    /// # Errors
    /// The reason to drop the datagram: it is old, or there is no room.
    pub fn begin(
        &mut self,
        address: SocketAddr,
        header: &DatagramHeader,
        now: Instant,
    ) -> Result<SenderId, DropReason> {
        if header.session == 0 {
            return Err(DropReason::Malformed);
        }
        if let Some(id) = self.by_session.get(&header.session)
            && let Some(sender) = self.by_id.get_mut(id)
        {
            if header.sequence <= sender.window.newest() {
                return Err(DropReason::Stale);
            }
            (sender.address, sender.challenge) = (address, header.peer);
            return Ok(*id);
        }
        self.forget_ended(now);
        if self.ended.contains(&header.session) {
            return Err(DropReason::Stale);
        }
        if self.by_id.len() >= MAX_SENDERS || self.ended.len() >= MAX_ENDED {
            let evicted = self.least_wanted().ok_or(DropReason::Full)?;
            self.end(evicted, now);
        }
        let same_address = self.by_id.values().find(|sender| sender.address == address);
        let bucket = match same_address {
            Some(other) => other.bucket,
            None => TokenBucket::full(now, self.rate_per_s),
        };
        let id = SenderId(self.next);
        self.next += 1;
        let sender = SenderState {
            session: header.session,
            address,
            challenge: header.peer,
            window: AntiReplayWindow::default(),
            bucket,
            last_seen: now,
            sequence: 0,
        };
        self.by_id.insert(id, sender);
        self.by_session.insert(header.session, id);
        Ok(id)
    }

    /// Whether the rate limit lets a sender send now.
    pub fn may_send(&mut self, id: SenderId, now: Instant) -> bool {
        self.by_id.get_mut(&id).is_some_and(|sender| sender.bucket.take(now, self.rate_per_s))
    }

    /// Checks the sequence number of an authentic datagram.
    ///
    /// # Errors
    /// The reason to drop it.
    pub fn check(&mut self, id: SenderId, sequence: u64, now: Instant) -> Result<(), DropReason> {
        let sender = self.by_id.get_mut(&id).ok_or(DropReason::Full)?;
        sender.window.check(sequence)?;
        sender.last_seen = now;
        Ok(())
    }

    /// Marks the sequence number of a datagram that was checked as received.
    pub fn mark_received(&mut self, id: SenderId, sequence: u64) {
        if let Some(sender) = self.by_id.get_mut(&id) {
            sender.window.mark_received(sequence);
        }
    }

    /// Whether `count` datagrams of a sender have come, from sequence number `first` on.
    pub fn has_all(&self, id: SenderId, first: u64, count: u32) -> bool {
        self.by_id.get(&id).is_some_and(|sender| sender.window.has_all(first, count))
    }

    /// These senders keep their places in a full table, and no others.
    pub fn keep(&mut self, kept: BTreeSet<SenderId>) {
        self.kept = kept;
    }

    /// Whom to evict from a full table: of the machine with the most senders that nobody keeps, the one that has been
    /// silent for the longest.
    fn least_wanted(&self) -> Option<SenderId> {
        let others = || self.by_id.iter().filter(|(id, _)| !self.kept.contains(id));
        let mut counts = BTreeMap::<IpAddr, usize>::new();
        others().for_each(|(_, sender)| *counts.entry(sender.address.ip()).or_default() += 1);
        let (machine, _) = counts.into_iter().max_by_key(|(_, count)| *count)?;
        others()
            .filter(|(_, sender)| sender.address.ip() == machine)
            .min_by_key(|(_, sender)| sender.last_seen)
            .map(|(id, _)| *id)
    }

    fn end(&mut self, id: SenderId, now: Instant) {
        let Some(sender) = self.by_id.remove(&id) else { return };
        self.by_session.remove(&sender.session);
        self.ended.insert(sender.session);
        self.ended_in_order.push_back((now, sender.session));
        self.missing += sender.window.missing();
    }

    /// Forgets the sessions that no challenge could begin any more.
    fn forget_ended(&mut self, now: Instant) {
        while let Some((ended, session)) = self.ended_in_order.front()
            && now.saturating_duration_since(*ended) > LIFETIME
        {
            self.ended.remove(session);
            self.ended_in_order.pop_front();
        }
    }

    /// Where to send the next datagram for a sender; `None` once its session has ended.
    pub fn next_reply(&mut self, id: SenderId) -> Option<ReplyAddress> {
        let sender = self.by_id.get_mut(&id)?;
        sender.sequence += 1;
        Some(ReplyAddress { address: sender.address, session: sender.session, sequence: sender.sequence })
    }

    /// The address of a sender; `None` once its session has ended.
    pub fn address(&self, id: SenderId) -> Option<SocketAddr> {
        self.by_id.get(&id).map(|sender| sender.address)
    }

    /// Datagrams lost on their way, by the gaps in the sequence numbers.
    pub fn missing(&self) -> u64 {
        self.missing + self.by_id.values().map(|sender| sender.window.missing()).sum::<u64>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    fn header(session: u64, sequence: u64) -> DatagramHeader {
        DatagramHeader { session, sequence, peer: 99, ..DatagramHeader::default() }
    }

    fn address(port: u16) -> SocketAddr {
        SocketAddr::from(([127, 0, 0, 1], port))
    }

    fn receive(senders: &mut Senders, id: SenderId, sequence: u64, now: Instant) {
        senders.check(id, sequence, now).unwrap();
        senders.mark_received(id, sequence);
    }

    #[test]
    fn a_session_moves_by_its_own_sequence_only() {
        let (mut senders, now) = (Senders::new(100.0), Instant::now());
        let id = senders.begin(address(1), &header(7, 3), now).unwrap();
        (3..=5).for_each(|sequence| receive(&mut senders, id, sequence, now));
        assert_eq!(senders.find(address(1), &header(7, 6)), Some(id));
        assert_eq!(senders.find(address(2), &header(7, 6)), None, "it has not answered there");
        for old in [1, 3, 5] {
            assert_eq!(senders.begin(address(2), &header(7, old), now), Err(DropReason::Stale));
        }
        assert_eq!(senders.address(id), Some(address(1)));
        let moved = DatagramHeader { peer: 98, ..header(7, 6) };
        assert_eq!(senders.begin(address(2), &moved, now), Ok(id));
        assert_eq!((senders.address(id), senders.find(address(1), &header(7, 7))), (Some(address(2)), None));
        assert_eq!(senders.check(id, 5, now), Err(DropReason::Duplicate), "its window goes with it");
        assert_eq!(senders.begin(address(1), &header(0, 1), now), Err(DropReason::Malformed));
    }

    #[test]
    fn another_session_of_the_same_address_ends_none() {
        let (mut senders, now) = (Senders::new(100.0), Instant::now());
        let first = senders.begin(address(1), &header(7, 1), now).unwrap();
        let second = senders.begin(address(1), &header(8, 1), now).unwrap();
        assert_eq!(senders.find(address(1), &header(7, 2)), Some(first));
        assert_eq!(senders.find(address(1), &header(8, 2)), Some(second));
        assert_eq!(senders.next_reply(second).unwrap().sequence, 1);
    }

    #[test]
    fn who_is_kept_stays_and_the_crowd_of_one_machine_makes_room() {
        let (mut senders, begun) = (Senders::new(100.0), Instant::now());
        let far = |port| SocketAddr::from(([10, 0, 0, 9], port));
        let leader = senders.begin(far(1), &header(1, 1), begun).unwrap();
        let guest = senders.begin(far(2), &header(2, 1), begun).unwrap();
        senders.keep(BTreeSet::from([leader]));
        let at = |number: u64| begun + Duration::from_millis(number);
        for number in 3..=10_000 {
            let port = number as u16;
            assert!(senders.begin(address(port), &header(number, 1), at(number)).is_ok(), "{number}");
        }
        assert_eq!(senders.by_id.len(), MAX_SENDERS);
        assert!(senders.address(leader).is_some() && senders.address(guest).is_some());
        // Those who went cannot begin again by the challenge that they had.
        assert_eq!(senders.begin(address(9), &header(9, 2), at(10_000)), Err(DropReason::Stale));
        senders.keep(senders.by_id.keys().copied().collect());
        let later = at(10_000) + LIFETIME + Duration::from_secs(1);
        assert_eq!(senders.begin(address(9), &header(20_000, 1), later), Err(DropReason::Full));
        assert!(senders.ended.is_empty(), "no challenge could begin them any more");
    }

    #[test]
    fn nobody_sends_faster_than_the_bucket_fills() {
        let (mut senders, now) = (Senders::new(50.0), Instant::now());
        let id = senders.begin(address(1), &header(7, 1), now).unwrap();
        assert_eq!((0..200).filter(|_| senders.may_send(id, now)).count(), 50);
        let later = now + Duration::from_millis(100);
        assert_eq!((0..200).filter(|_| senders.may_send(id, later)).count(), 5);
        // A new session of the same address begins with what is left.
        let other = senders.begin(address(1), &header(9, 1), later).unwrap();
        assert!(!senders.may_send(other, later));
    }
}
