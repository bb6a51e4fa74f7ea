//! Checks datagrams that have come to a server: allow list, authentication, challenge, rate limit, replay window, room.
//! A handshake gets a challenge, or a denial with the wrong key, world or version; neither is longer than the handshake.
//! The filter knows no socket, so whoever reads the socket can call it.

use super::challenges::Challenges;
use super::receive_queue::{Inbound, ReceiveQueue};
use super::senders::{SenderId, Senders, TokenBucket};
use super::{AllowedNetwork, ServerOptions};
use crate::host::{Clock, Host};
use city3d_protocol::wire::{
    Authenticator, Body, DatagramHeader, DecodeError, DecodeFault, Denial, DenialReason, DropCounts,
    DropReason,
};
use std::net::SocketAddr;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Dropped datagrams are logged no more often than this.
const LOG_INTERVAL: Duration = Duration::from_secs(1);
/// Rate limit of the denials to all addresses together: a rejected sender has no limit of its own.
const MAX_DENIALS_PER_S: f64 = 100.0;
/// Rate limit of the challenges to all addresses together.
const MAX_CHALLENGES_PER_S: f64 = 5000.0;

/// What a server shares with who reads its socket.
#[derive(Debug)]
pub(super) struct LinkState {
    pub senders: Senders,
    pub drops: DropCounts,
    pub received: u64,
    pub used: u64,
}

impl LinkState {
    pub fn new(rate_per_s: f64) -> Self {
        Self { senders: Senders::new(rate_per_s), drops: DropCounts::default(), received: 0, used: 0 }
    }

    fn count_used(&mut self) {
        self.received += 1;
        self.used += 1;
    }

    fn count_dropped(&mut self, reason: DropReason) {
        self.received += 1;
        self.drops.count(reason);
    }
}

/// Checks datagrams and queues those that pass.
#[derive(Debug)]
pub(super) struct InboundFilter {
    queue: Arc<ReceiveQueue>,
    shared: Arc<Mutex<LinkState>>,
    /// Session and world of this server.
    header: DatagramHeader,
    authenticator: Authenticator,
    allowed: Vec<AllowedNetwork>,
    takes_clock: bool,
    drop_log: DropLog,
    challenges: Challenges,
    /// Rate limiters of what is sent without a session.
    denials: TokenBucket,
    challenged: TokenBucket,
}

/// Why a datagram is dropped, and what its sender is told if it was a handshake.
#[derive(Debug)]
struct Rejection {
    reason: DropReason,
    /// The fault and its place, for the log.
    why: String,
    denial: Option<DenialReason>,
}

impl From<DropReason> for Rejection {
    fn from(reason: DropReason) -> Self {
        Self { reason, why: String::new(), denial: None }
    }
}

/// Rate limiter of the log messages about dropped datagrams.
#[derive(Debug)]
struct DropLog {
    /// Drops since the last message.
    dropped: u64,
    logged_at: Option<Instant>,
}

impl InboundFilter {
    pub fn new(
        options: &ServerOptions,
        host: &Host,
        header: DatagramHeader,
        queue: Arc<ReceiveQueue>,
        shared: Arc<Mutex<LinkState>>,
    ) -> Self {
        let now = host.clock.now();
        Self {
            queue,
            shared,
            header,
            authenticator: options.authenticator.clone(),
            allowed: options.allowed.clone(),
            takes_clock: options.takes_clock,
            drop_log: DropLog { dropped: 0, logged_at: None },
            challenges: Challenges::new(&*host.network, now),
            denials: TokenBucket::full(now, MAX_DENIALS_PER_S),
            challenged: TokenBucket::full(now, MAX_CHALLENGES_PER_S),
        }
    }

    /// Checks a datagram that comes now, and queues it or counts its drop. Gives what to send back at once, if anything.
    pub fn take(&mut self, bytes: &[u8], from: SocketAddr, clock: &dyn Clock) -> Option<Vec<u8>> {
        let now = clock.now();
        let rejection = match self.accept(bytes, from, clock) {
            Ok(challenge) => return challenge,
            Err(rejection) => rejection,
        };
        self.note_drop(&rejection, from, now);
        let denial = Denial { reason: rejection.denial? }.answer(bytes, self.header.world)?;
        self.denials.take(now, MAX_DENIALS_PER_S).then_some(denial)
    }

    /// Queues a good datagram, or gives the challenge that answers it.
    fn accept(
        &mut self,
        bytes: &[u8],
        from: SocketAddr,
        clock: &dyn Clock,
    ) -> Result<Option<Vec<u8>>, Rejection> {
        let now = clock.now();
        let is_allowed =
            self.allowed.is_empty() || self.allowed.iter().any(|allowed| allowed.contains(from.ip()));
        if !is_allowed {
            return Err(DropReason::ForeignSender.into());
        }
        let (header, body) =
            Body::open(bytes, &self.authenticator).map_err(|error| self.rejection(&error))?;
        if header.world != 0 && header.world != self.header.world {
            let denial = Some(DenialReason::OtherWorld);
            return Err(Rejection { denial, ..DropReason::OtherCity.into() });
        }
        let mut shared = self.lock();
        let sender = match shared.senders.find(from, &header) {
            Some(sender) => sender,
            None if self.challenges.is_fresh(header.peer, from, header.session, now) => {
                shared.senders.begin(from, &header, now)?
            }
            // Nobody has answered a challenge at this address.
            None => {
                drop(shared);
                return match body {
                    Ok(Body::Hello { token }) => self.challenge(from, &header, token, now).map(Some),
                    _ => Err(DropReason::OtherCity.into()),
                };
            }
        };
        if !shared.senders.may_send(sender, now) {
            return Err(DropReason::TooFast.into());
        }
        shared.senders.check(sender, header.sequence, now)?;
        let body = body.map_err(|error| {
            // It is not missing: it has come.
            shared.senders.mark_received(sender, header.sequence);
            self.rejection(&error)
        })?;
        self.queue_up(shared, (sender, header.sequence), body, clock).map(|()| None)
    }

    /// The challenge to a handshake.
    fn challenge(
        &mut self,
        from: SocketAddr,
        header: &DatagramHeader,
        token: u64,
        now: Instant,
    ) -> Result<Vec<u8>, Rejection> {
        // Whoever knows a challenge has lost it: 0 asks for a new one.
        if header.peer != 0 || header.session == 0 {
            return Err(DropReason::OtherCity.into());
        }
        if !self.challenged.take(now, MAX_CHALLENGES_PER_S) {
            return Err(DropReason::TooFast.into());
        }
        let challenge = self.challenges.make(from, header.session, now);
        let header = DatagramHeader { peer: header.session, sequence: 0, ..self.header };
        let challenge = Body::Challenge { token, challenge }.encode(header, &self.authenticator);
        let challenge = challenge.map_err(|_| DropReason::Malformed)?;
        self.lock().count_used();
        Ok(challenge)
    }

    /// Queues a datagram of a sender that has passed the checks of its session.
    fn queue_up(
        &self,
        mut shared: MutexGuard<'_, LinkState>,
        (sender, sequence): (SenderId, u64),
        body: Body,
        clock: &dyn Clock,
    ) -> Result<(), Rejection> {
        let is_clock = self.takes_clock && matches!(body, Body::Clock(_));
        if !body.is_to_city() && !is_clock {
            return Err(DropReason::WrongWay.into());
        }
        if let Body::Barrier { first, count, .. } = body
            && !shared.senders.has_all(sender, first, count)
        {
            return Err(DropReason::Incomplete.into());
        }
        // Nobody else adds to the queue.
        if !self.queue.has_room() {
            return Err(DropReason::Full.into());
        }
        shared.senders.mark_received(sender, sequence);
        shared.count_used();
        drop(shared);
        self.queue.push(Inbound { sender, body, at: clock.now() });
        Ok(())
    }

    /// The rejection of a datagram that cannot be decoded.
    fn rejection(&self, error: &DecodeError) -> Rejection {
        let denial = match (&error.fault, &self.authenticator) {
            (DecodeFault::Unauthenticated, _) => Some(DenialReason::KeyNeeded),
            (DecodeFault::NoKey, _) => Some(DenialReason::NoKey),
            (DecodeFault::Version { .. }, _) => Some(DenialReason::OtherVersion),
            // With a checksum it is damaged.
            (DecodeFault::Check, Authenticator::Key(_)) => Some(DenialReason::OtherKey),
            _ => None,
        };
        Rejection { reason: error.into(), why: format!(": {error}"), denial }
    }

    fn note_drop(&mut self, rejection: &Rejection, from: SocketAddr, now: Instant) {
        let Rejection { reason, why, .. } = rejection;
        self.lock().count_dropped(*reason);
        self.drop_log.dropped += 1;
        if self.drop_log.logged_at.is_none_or(|at| now.duration_since(at) >= LOG_INTERVAL) {
            let more = match self.drop_log.dropped {
                1 => String::new(),
                count => format!(" ({count} dropped since the last such message)"),
            };
            tracing::warn!("{from}: a datagram is dropped, {}{why}{more}", reason.label());
            self.drop_log = DropLog { dropped: 0, logged_at: Some(now) };
        }
    }

    fn lock(&self) -> MutexGuard<'_, LinkState> {
        self.shared.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
