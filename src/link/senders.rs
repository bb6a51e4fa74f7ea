//! Who sends: sessions by address, what has come of each, and how fast each may send.

use super::Window;
use crate::wire::{DropReason, Header};
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::net::SocketAddr;
use std::time::{Duration, Instant};

/// Addresses that are known at once, at most.
const MOST_SENDERS: usize = 256;
/// So many of the sessions that were given up last are remembered, and not taken again.
const MOST_RETIRED: usize = 4096;
/// A sender that has been silent for so long makes room for another.
const SILENT: Duration = Duration::from_secs(10);

/// A sender in one of its sessions, by a number of this process.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Origin(pub u32);

/// Lets so many pass a second, and as many at once after a rest.
#[derive(Clone, Copy, Debug)]
pub struct Bucket {
    left: f64,
    filled: Instant,
}

impl Bucket {
    pub fn full(now: Instant, rate_per_s: f64) -> Self {
        Self { left: rate_per_s, filled: now }
    }

    pub fn take(&mut self, now: Instant, rate_per_s: f64) -> bool {
        let rest_s = now.saturating_duration_since(self.filled).as_secs_f64();
        self.left = (self.left + rest_s * rate_per_s).min(rate_per_s);
        self.filled = now;
        let passes = self.left >= 1.0;
        self.left -= f64::from(u8::from(passes));
        passes
    }
}

#[derive(Debug)]
struct Sender {
    origin: Origin,
    session: u64,
    window: Window,
    bucket: Bucket,
    heard: Instant,
    /// Of the datagrams to it.
    sequence: u64,
}

/// Whom to answer, and by which number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Told {
    pub address: SocketAddr,
    pub session: u64,
    pub sequence: u64,
}

/// The senders that are known.
#[derive(Debug)]
pub struct Senders {
    by_address: BTreeMap<SocketAddr, Sender>,
    addresses: BTreeMap<Origin, SocketAddr>,
    retired: BTreeSet<(SocketAddr, u64)>,
    /// The same in the order in which they were given up.
    retired_in_order: VecDeque<(SocketAddr, u64)>,
    next: u32,
    rate_per_s: f64,
    /// Of senders that are no longer known.
    missing: u64,
}

impl Senders {
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

    /// Whether a known address may send now; of others nothing is known yet.
    pub fn may_send(&mut self, address: SocketAddr, now: Instant) -> bool {
        self.by_address.get_mut(&address).is_none_or(|sender| sender.bucket.take(now, self.rate_per_s))
    }

    /// Whether a datagram that has been read may be used, and whose it is.
    ///
    /// # Errors
    /// Why not.
    pub fn admit(
        &mut self,
        address: SocketAddr,
        header: &Header,
        now: Instant,
    ) -> Result<Origin, DropReason> {
        if self.by_address.get(&address).is_none_or(|sender| sender.session != header.session) {
            self.begin(address, header.session, now)?;
        }
        let Some(sender) = self.by_address.get_mut(&address) else { return Err(DropReason::Full) };
        sender.window.check(header.sequence)?;
        sender.heard = now;
        Ok(sender.origin)
    }

    /// Notes that an admitted datagram is used.
    pub fn note(&mut self, address: SocketAddr, sequence: u64) {
        if let Some(sender) = self.by_address.get_mut(&address) {
            sender.window.note(sequence);
        }
    }

    /// Whether so many datagrams of a sender have come, from a sequence on.
    pub fn has_all(&self, address: SocketAddr, first: u64, count: u32) -> bool {
        self.by_address.get(&address).is_some_and(|sender| sender.window.has_all(first, count))
    }

    fn begin(&mut self, address: SocketAddr, session: u64, now: Instant) -> Result<(), DropReason> {
        if session == 0 {
            return Err(DropReason::Malformed);
        }
        if self.retired.contains(&(address, session)) {
            return Err(DropReason::Stale);
        }
        let bucket = match self.forget(address) {
            Some(old) => old.bucket,
            None => Bucket::full(now, self.rate_per_s),
        };
        if self.by_address.len() >= MOST_SENDERS {
            let quietest = self.by_address.iter().min_by_key(|(_, sender)| sender.heard);
            let quietest = quietest.map(|(address, sender)| (*address, sender.heard));
            match quietest.filter(|(_, heard)| now.saturating_duration_since(*heard) > SILENT) {
                Some((address, _)) => drop(self.forget(address)),
                None => return Err(DropReason::Full),
            }
        }
        let origin = Origin(self.next);
        self.next += 1;
        let sender = Sender { origin, session, window: Window::default(), bucket, heard: now, sequence: 0 };
        self.by_address.insert(address, sender);
        self.addresses.insert(origin, address);
        Ok(())
    }

    fn forget(&mut self, address: SocketAddr) -> Option<Sender> {
        let old = self.by_address.remove(&address)?;
        self.addresses.remove(&old.origin);
        if self.retired_in_order.len() == MOST_RETIRED
            && let Some(oldest) = self.retired_in_order.pop_front()
        {
            self.retired.remove(&oldest);
        }
        self.retired.insert((address, old.session));
        self.retired_in_order.push_back((address, old.session));
        self.missing += old.window.missing();
        Some(old)
    }

    /// The address of a sender and the number of the next datagram to it; `None` where it has begun anew.
    pub fn tell(&mut self, origin: Origin) -> Option<Told> {
        let address = *self.addresses.get(&origin)?;
        let sender = self.by_address.get_mut(&address)?;
        sender.sequence += 1;
        Some(Told { address, session: sender.session, sequence: sender.sequence })
    }

    pub fn address(&self, origin: Origin) -> Option<SocketAddr> {
        self.addresses.get(&origin).copied()
    }

    /// Datagrams that were sent and have not come, as the sequences tell.
    pub fn missing(&self) -> u64 {
        self.missing + self.by_address.values().map(|sender| sender.window.missing()).sum::<u64>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn header(session: u64, sequence: u64) -> Header {
        Header { session, sequence, ..Header::default() }
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
        assert_eq!(senders.tell(second).unwrap().sequence, 1);
        assert_eq!(senders.admit(address(1), &header(0, 1), now), Err(DropReason::Malformed));
    }

    #[test]
    fn the_number_of_senders_is_bounded_and_silent_ones_make_room() {
        let (mut senders, now) = (Senders::new(100.0), Instant::now());
        for port in 1..=MOST_SENDERS as u16 {
            assert!(senders.admit(address(port), &header(1, 1), now).is_ok());
        }
        assert_eq!(senders.admit(address(999), &header(1, 1), now), Err(DropReason::Full));
        let later = now + SILENT + Duration::from_secs(1);
        assert!(senders.admit(address(999), &header(1, 1), later).is_ok());
        assert!(senders.by_address.len() <= MOST_SENDERS);
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
