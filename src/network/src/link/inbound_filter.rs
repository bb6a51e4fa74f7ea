//! Checks datagrams that have come to a server: allow list, rate limit, authentication, session, replay window, room.
//! A handshake with the wrong key or world gets a denial. The filter knows no socket, so whoever reads the socket can call it.

use super::receive_queue::{Inbound, ReceiveQueue};
use super::senders::{Senders, TokenBucket};
use super::{AllowedNetwork, ServerOptions};
use crate::host::Clock;
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
    /// Rate limiter of the denials, from the first one on.
    denials: Option<TokenBucket>,
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
        header: DatagramHeader,
        queue: Arc<ReceiveQueue>,
        shared: Arc<Mutex<LinkState>>,
    ) -> Self {
        Self {
            queue,
            shared,
            header,
            authenticator: options.authenticator.clone(),
            allowed: options.allowed.clone(),
            takes_clock: options.takes_clock,
            drop_log: DropLog { dropped: 0, logged_at: None },
            denials: None,
        }
    }

    /// Checks a datagram that comes now, and queues it or counts its drop. Gives the denial to send back, if any.
    pub fn take(&mut self, bytes: &[u8], from: SocketAddr, clock: &dyn Clock) -> Option<Vec<u8>> {
        let rejection = self.accept(bytes, from, clock).err()?;
        let now = clock.now();
        self.note_drop(&rejection, from, now);
        let denial = Denial { reason: rejection.denial? }.answer(bytes, self.header.world)?;
        let bucket = self.denials.get_or_insert_with(|| TokenBucket::full(now, MAX_DENIALS_PER_S));
        bucket.take(now, MAX_DENIALS_PER_S).then_some(denial)
    }

    fn accept(&self, bytes: &[u8], from: SocketAddr, clock: &dyn Clock) -> Result<(), Rejection> {
        let now = clock.now();
        let is_allowed =
            self.allowed.is_empty() || self.allowed.iter().any(|allowed| allowed.contains(from.ip()));
        let mut shared = self.lock();
        shared.received += 1;
        if !is_allowed {
            return Err(DropReason::ForeignSender.into());
        }
        if !shared.senders.may_send(from, now) {
            return Err(DropReason::TooFast.into());
        }
        drop(shared);
        let (header, body) =
            Body::decode(bytes, &self.authenticator).map_err(|error| self.rejection(&error))?;
        let is_clock = self.takes_clock && matches!(body, Body::Clock(_));
        if !body.is_to_city() && !is_clock {
            return Err(DropReason::WrongWay.into());
        }
        let is_ours = header.peer == self.header.session
            || (header.peer == 0
                && (matches!(self.authenticator, Authenticator::Checksum)
                    || matches!(body, Body::Hello { .. })));
        if header.world != 0 && header.world != self.header.world {
            let denial = Some(DenialReason::OtherWorld);
            return Err(Rejection { denial, ..DropReason::OtherCity.into() });
        }
        if !is_ours {
            return Err(DropReason::OtherCity.into());
        }
        let mut shared = self.lock();
        let sender = shared.senders.admit(from, &header, now)?;
        if let Body::Barrier { first, count, .. } = body
            && !shared.senders.has_all(from, first, count)
        {
            return Err(DropReason::Incomplete.into());
        }
        // Nobody else adds to the queue.
        if !self.queue.has_room() {
            return Err(DropReason::Full.into());
        }
        shared.senders.mark_received(from, header.sequence);
        shared.used += 1;
        drop(shared);
        self.queue.push(Inbound { sender, body, at: clock.now() });
        Ok(())
    }

    /// The rejection of a datagram that cannot be decoded.
    fn rejection(&self, error: &DecodeError) -> Rejection {
        let denial = match (&error.fault, &self.authenticator) {
            (DecodeFault::Unauthenticated, _) => Some(DenialReason::KeyNeeded),
            (DecodeFault::NoKey, _) => Some(DenialReason::NoKey),
            // With a checksum it is damaged.
            (DecodeFault::Check, Authenticator::Key(_)) => Some(DenialReason::OtherKey),
            _ => None,
        };
        Rejection { reason: error.into(), why: format!(": {error}"), denial }
    }

    fn note_drop(&mut self, rejection: &Rejection, from: SocketAddr, now: Instant) {
        let Rejection { reason, why, .. } = rejection;
        self.lock().drops.count(*reason);
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
