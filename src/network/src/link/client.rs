//! UDP client of a city: sends datagrams, checks the ones that come back, repeats requests.

use super::{AntiReplayWindow, LinkError};
use city3d_protocol::wire::{Authenticator, Body, DatagramHeader, MAX_DATAGRAM_BYTES, RequestOutcome};
use std::collections::hash_map::RandomState;
use std::hash::BuildHasher;
use std::io::ErrorKind;
use std::net::{ToSocketAddrs, UdpSocket};
use std::time::{Duration, Instant, SystemTime};

/// A request without an answer is retransmitted after this time.
const RETRANSMIT_INTERVAL: Duration = Duration::from_millis(100);
const SOCKET_BYTES: usize = 4 << 20;

/// Draws a session number that no other process has had, with overwhelming probability.
pub(super) fn new_session() -> u64 {
    // The hasher's keys come from the system's source of randomness.
    RandomState::new().hash_one((SystemTime::now(), std::process::id())).max(1)
}

/// What a client receives.
#[derive(Clone, Debug, PartialEq)]
pub enum ClientEvent {
    /// A datagram of the city that has passed all checks.
    Body(Body),
    /// The city has another session than before: it has been restarted and has lost its state.
    Restarted,
}

/// Client of a city, with a session of its own.
#[derive(Debug)]
pub struct Client {
    socket: UdpSocket,
    authenticator: Authenticator,
    header: DatagramHeader,
    window: AntiReplayWindow,
    last_request: u32,
}

impl Client {
    /// Opens a socket to a city; nothing is sent yet.
    ///
    /// # Errors
    /// When the address is malformed, or cannot be reached from here.
    pub fn new(city: &str, world: u32, authenticator: Authenticator) -> Result<Self, LinkError> {
        let address = || city.to_owned();
        let no_socket = |source| LinkError::Socket { address: address(), source };
        let found = city.to_socket_addrs().ok().and_then(|mut found| found.next());
        let found = found.ok_or_else(|| LinkError::Address { address: address() })?;
        let own = if found.is_ipv4() { "0.0.0.0:0" } else { "[::]:0" };
        let socket = UdpSocket::bind(own).map_err(no_socket)?;
        let _ = socket2::SockRef::from(&socket).set_recv_buffer_size(SOCKET_BYTES);
        socket.connect(found).map_err(no_socket)?;
        let header = DatagramHeader { session: new_session(), world, ..DatagramHeader::default() };
        Ok(Self { socket, authenticator, header, window: AntiReplayWindow::default(), last_request: 0 })
    }

    /// Starts a new session and forgets that of the city; the next handshake learns it again.
    pub fn reset_session(&mut self) {
        self.header = DatagramHeader { session: new_session(), peer: 0, sequence: 0, ..self.header };
        self.window = AntiReplayWindow::default();
    }

    /// Sends a datagram without delivery guarantee, and gives its sequence number.
    pub fn send(&mut self, body: &Body) -> u64 {
        self.header.sequence += 1;
        match body.encode(self.header, &self.authenticator) {
            Ok(bytes) => self.resend(&bytes),
            Err(error) => tracing::warn!("a datagram is not sent: {error}"),
        }
        self.header.sequence
    }

    /// Sends a heartbeat `Hello` that a restarted city answers too: it names no session of the city.
    pub fn probe(&mut self) {
        let peer = std::mem::take(&mut self.header.peer);
        self.send(&Body::Hello { token: 0 });
        self.header.peer = peer;
    }

    /// Encodes the next datagram for [`Client::resend`]; gives its sequence number and bytes.
    pub fn prepare(&mut self, body: &Body) -> Option<(u64, Vec<u8>)> {
        self.header.sequence += 1;
        match body.encode(self.header, &self.authenticator) {
            Ok(bytes) => Some((self.header.sequence, bytes)),
            Err(error) => {
                tracing::warn!("a datagram is not sent: {error}");
                None
            }
        }
    }

    /// Sends the bytes of an encoded datagram, once more if it has been sent before.
    pub fn resend(&self, bytes: &[u8]) {
        // The error of an absent city does not matter: its next answer shows that it is back.
        let _ = self.socket.send(bytes);
    }

    /// Receives the next event, and waits for it at most this long.
    pub fn receive(&mut self, wait: Duration) -> Option<ClientEvent> {
        if wait.is_zero() {
            return self.poll();
        }
        let until = Instant::now() + wait;
        let mut bytes = [0; MAX_DATAGRAM_BYTES + 1];
        loop {
            let left = until.saturating_duration_since(Instant::now());
            // A timeout of zero would mean to wait for ever.
            let _ = self.socket.set_read_timeout(Some(left.max(Duration::from_micros(1))));
            match self.socket.recv(&mut bytes) {
                Ok(length) => {
                    if let Some(event) = self.accept(&bytes[..length]) {
                        return Some(event);
                    }
                }
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {}
                // Nothing listens at the address: asking again at once would spin.
                Err(_) => std::thread::sleep(left.min(Duration::from_millis(5))),
            }
            if Instant::now() >= until {
                return None;
            }
        }
    }

    /// Receives without waiting. A timeout would last some milliseconds at least, a tick of the system's timer.
    fn poll(&mut self) -> Option<ClientEvent> {
        let mut bytes = [0; MAX_DATAGRAM_BYTES + 1];
        self.socket.set_nonblocking(true).ok()?;
        let mut event = None;
        while event.is_none() {
            match self.socket.recv(&mut bytes) {
                Ok(length) => event = self.accept(&bytes[..length]),
                // The error of an earlier send; datagrams may wait behind it.
                Err(error) if error.kind() == ErrorKind::ConnectionRefused => {}
                Err(_) => break,
            }
        }
        // A socket that stayed non-blocking would turn waiting into spinning.
        if let Err(error) = self.socket.set_nonblocking(false) {
            tracing::warn!("the socket cannot be set to wait: {error}");
        }
        event
    }

    fn accept(&mut self, bytes: &[u8]) -> Option<ClientEvent> {
        let (header, body) = match Body::decode(bytes, &self.authenticator) {
            Ok(read) => read,
            Err(error) => {
                tracing::debug!("a datagram from the city is dropped: {error}");
                return None;
            }
        };
        if body.is_to_city() || header.peer != self.header.session {
            return None;
        }
        if self.header.peer == 0 {
            self.header.peer = header.session;
        }
        if header.session != self.header.peer {
            return Some(ClientEvent::Restarted);
        }
        self.window.check(header.sequence).ok()?;
        self.window.mark_received(header.sequence);
        Some(ClientEvent::Body(body))
    }

    /// Sends a request, with retransmissions, until its acknowledgement comes; `None` after the timeout. Requests are
    /// idempotent by their number.
    pub fn request(
        &mut self,
        timeout: Duration,
        body: impl Fn(u32) -> Body,
    ) -> Option<(RequestOutcome, String)> {
        self.last_request += 1;
        let number = self.last_request;
        let body = body(number);
        let until = Instant::now() + timeout;
        while Instant::now() < until {
            self.send(&body);
            let retransmit_at = Instant::now() + RETRANSMIT_INTERVAL;
            while let Some(left) = retransmit_at.checked_duration_since(Instant::now()) {
                match self.receive(left) {
                    Some(ClientEvent::Body(Body::Ack { request, outcome, detail, .. }))
                        if request == number =>
                    {
                        return Some((outcome, detail));
                    }
                    Some(ClientEvent::Restarted) => return None,
                    _ => {}
                }
            }
        }
        None
    }
}
