//! UDP client of a city: sends datagrams, checks the ones that come back, repeats requests.

use super::{AntiReplayWindow, LinkError};
use crate::host::{DatagramSocket, Host};
use city3d_protocol::wire::{
    Authenticator, Body, DatagramHeader, Denial, DenialReason, MAX_DATAGRAM_BYTES, RequestOutcome,
};
use std::io::{self, ErrorKind};
use std::net::ToSocketAddrs;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// A request without an answer is retransmitted after this time.
const RETRANSMIT_INTERVAL: Duration = Duration::from_millis(100);
/// How long it waits before it asks an address again where nothing listens.
const REFUSED_INTERVAL: Duration = Duration::from_millis(5);

/// What a client receives.
#[derive(Clone, Debug, PartialEq)]
pub enum ClientEvent {
    /// A datagram of the city that has passed all checks.
    Body(Body),
    /// The city has been restarted, or has forgotten this session: it knows nothing of what this client has set up.
    Restarted,
}

/// A handshake that the city has not answered.
#[derive(Clone, Debug)]
struct Handshake {
    /// Random token of the datagrams that ask for a challenge.
    nonce: u64,
    /// What the session begins with.
    first: Body,
}

/// Challenges that were answered without effect, after which the city has forgotten this session.
const MAX_VAIN_CHALLENGES: u32 = 3;

/// Client of a city, with a session of its own. It answers the city's challenge by itself.
#[derive(Debug)]
pub struct Client {
    host: Host,
    socket: Box<dyn DatagramSocket>,
    authenticator: Authenticator,
    /// Its `peer` is the city's challenge, 0 before the first.
    header: DatagramHeader,
    /// Session of the city; 0 before its first answer.
    city: u64,
    window: AntiReplayWindow,
    handshake: Option<Handshake>,
    /// Challenges since the city has last answered otherwise.
    vain_challenges: u32,
    last_request: u32,
    /// Own session before this one: a denial may still answer it.
    previous_session: Option<u64>,
    /// Why the city has rejected a handshake since it last answered.
    denial: Option<DenialReason>,
    /// Nothing listened at the address since then; atomic, for it also shows while the client only sends.
    is_refused: AtomicBool,
}

impl Client {
    /// Opens a socket of this machine to a city; nothing is sent yet.
    ///
    /// # Errors
    /// When the address is malformed, or cannot be reached from here.
    pub fn new(city: &str, world: u32, authenticator: Authenticator) -> Result<Self, LinkError> {
        Self::on(&Host::system(), city, world, authenticator)
    }

    /// Opens a socket of a host to a city; nothing is sent yet.
    ///
    /// # Errors
    /// When the address is malformed, or cannot be reached from there.
    pub fn on(host: &Host, city: &str, world: u32, authenticator: Authenticator) -> Result<Self, LinkError> {
        let address = || city.to_owned();
        let found = city.to_socket_addrs().ok().and_then(|mut found| found.next());
        let found = found.ok_or_else(|| LinkError::Address { address: address() })?;
        let socket =
            host.network.connect(found).map_err(|source| LinkError::Socket { address: address(), source })?;
        let header = DatagramHeader { session: host.network.session(), world, ..DatagramHeader::default() };
        let window = AntiReplayWindow::default();
        Ok(Self {
            host: host.clone(),
            socket,
            authenticator,
            header,
            city: 0,
            window,
            handshake: None,
            vain_challenges: 0,
            last_request: 0,
            previous_session: None,
            denial: None,
            is_refused: AtomicBool::new(false),
        })
    }

    /// Why the city cannot be reached, as a clause; `None` while it answers or nothing is known.
    pub fn trouble(&self) -> Option<String> {
        if self.is_refused.load(Ordering::Relaxed) {
            return Some("nothing listens there".to_owned());
        }
        self.denial.map(|reason| clause(reason).to_owned())
    }

    /// Starts a new session and forgets that of the city; the next handshake learns it again.
    pub fn reset_session(&mut self) {
        self.previous_session = Some(self.header.session);
        self.header =
            DatagramHeader { session: self.host.network.session(), peer: 0, sequence: 0, ..self.header };
        (self.city, self.handshake, self.vain_challenges) = (0, None, 0);
        self.window = AntiReplayWindow::default();
    }

    /// Whether the city has let this session begin, so that it takes more than a `Hello`.
    pub fn is_connected(&self) -> bool {
        self.header.peer != 0
    }

    /// Sends a datagram without delivery guarantee, and gives its sequence number. While the city has not let this session
    /// begin, a `Hello` goes in its place, and the last such datagram follows when the session begins.
    pub fn send(&mut self, body: &Body) -> u64 {
        if self.is_connected() {
            self.send_now(body);
        } else {
            self.ask_for_challenge(body.clone());
        }
        self.header.sequence
    }

    fn send_now(&mut self, body: &Body) {
        self.header.sequence += 1;
        match body.encode(self.header, &self.authenticator) {
            Ok(bytes) => self.resend(&bytes),
            Err(error) => tracing::warn!("a datagram is not sent: {error}"),
        }
    }

    /// Sends a `Hello` that any city answers, also one that has been restarted or sees another address than before.
    pub fn probe(&mut self) {
        self.ask_for_challenge(Body::Hello { token: 0 });
    }

    fn ask_for_challenge(&mut self, first: Body) {
        let nonce = match &self.handshake {
            Some(handshake) => handshake.nonce,
            None => self.host.network.session(),
        };
        self.handshake = Some(Handshake { nonce, first });
        // It belongs to no session yet, so that it is not counted.
        let header = DatagramHeader { peer: 0, sequence: 0, ..self.header };
        match (Body::Hello { token: nonce }).encode(header, &self.authenticator) {
            Ok(bytes) => self.resend(&bytes),
            Err(error) => tracing::warn!("a handshake is not sent: {error}"),
        }
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
        // Nothing is done about an absent city: its next answer shows that it is back.
        if let Err(error) = self.socket.send(bytes) {
            self.note_refusal(&error);
        }
    }

    /// Receives the next event, and waits for it at most this long.
    pub fn receive(&mut self, wait: Duration) -> Option<ClientEvent> {
        if wait.is_zero() {
            return self.poll();
        }
        let until = self.host.clock.now() + wait;
        let mut left = wait;
        let mut bytes = [0; MAX_DATAGRAM_BYTES + 1];
        while !left.is_zero() {
            match self.socket.receive(&mut bytes, left) {
                Ok(Some((length, _))) => {
                    if let Some(event) = self.accept(&bytes[..length]) {
                        return Some(event);
                    }
                }
                Ok(None) => {}
                // Nothing listens at the address: asking again at once would spin.
                Err(error) => {
                    self.note_refusal(&error);
                    self.host.clock.sleep(left.min(REFUSED_INTERVAL));
                }
            }
            left = until.saturating_duration_since(self.host.clock.now());
        }
        None
    }

    /// Receives without waiting.
    fn poll(&mut self) -> Option<ClientEvent> {
        let mut bytes = [0; MAX_DATAGRAM_BYTES + 1];
        loop {
            match self.socket.receive(&mut bytes, Duration::ZERO) {
                Ok(Some((length, _))) => {
                    if let Some(event) = self.accept(&bytes[..length]) {
                        return Some(event);
                    }
                }
                // The error of an earlier send; datagrams may wait behind it.
                Err(error) if error.kind() == ErrorKind::ConnectionRefused => self.note_refusal(&error),
                Ok(None) | Err(_) => return None,
            }
        }
    }

    fn accept(&mut self, bytes: &[u8]) -> Option<ClientEvent> {
        let (header, body) = match Body::decode(bytes, &self.authenticator) {
            Ok(read) => read,
            Err(error) => {
                if !self.note_denial(bytes) {
                    tracing::debug!("a datagram from the city is dropped: {error}");
                }
                return None;
            }
        };
        if body.is_to_city() || header.peer != self.header.session {
            return None;
        }
        if let Body::Challenge { token, challenge } = body {
            return self.answer_challenge(header.session, token, challenge);
        }
        if header.session != self.city {
            return None;
        }
        self.window.check(header.sequence).ok()?;
        self.window.mark_received(header.sequence);
        self.vain_challenges = 0;
        self.forget_trouble();
        Some(ClientEvent::Body(body))
    }

    /// Takes a challenge that was asked for, and begins the session with it.
    fn answer_challenge(&mut self, city: u64, nonce: u64, challenge: u64) -> Option<ClientEvent> {
        let Handshake { first, .. } = self.handshake.take_if(|handshake| handshake.nonce == nonce)?;
        self.vain_challenges += 1;
        let is_other = self.city != 0 && self.city != city;
        if is_other || self.vain_challenges > MAX_VAIN_CHALLENGES {
            return Some(ClientEvent::Restarted);
        }
        (self.city, self.header.peer) = (city, challenge);
        self.send_now(&first);
        None
    }

    /// Remembers a denial of the own handshake; `false` when the bytes are none. Anyone could have made it, so that
    /// nothing else depends on it.
    fn note_denial(&mut self, bytes: &[u8]) -> bool {
        let Ok((header, denial)) = Denial::decode(bytes) else { return false };
        let is_own = header.peer == self.header.session || Some(header.peer) == self.previous_session;
        if is_own {
            self.denial = Some(denial.reason);
            self.is_refused.store(false, Ordering::Relaxed);
        }
        is_own
    }

    fn note_refusal(&self, error: &io::Error) {
        if error.kind() == ErrorKind::ConnectionRefused {
            self.is_refused.store(true, Ordering::Relaxed);
        }
    }

    fn forget_trouble(&mut self) {
        self.denial = None;
        self.is_refused.store(false, Ordering::Relaxed);
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
        let until = self.host.clock.now() + timeout;
        while self.host.clock.now() < until {
            self.send(&body);
            if let Some(answer) = self.await_answer(number, RETRANSMIT_INTERVAL) {
                return answer;
            }
        }
        None
    }

    /// Waits for the acknowledgement of a request; `Some(None)` when the city has been restarted and will not send it.
    fn await_answer(&mut self, number: u32, wait: Duration) -> Option<Option<(RequestOutcome, String)>> {
        let until = self.host.clock.now() + wait;
        let mut left = wait;
        while !left.is_zero() {
            match self.receive(left) {
                Some(ClientEvent::Body(Body::Ack { request, outcome, detail, .. })) if request == number => {
                    return Some(Some((outcome, detail)));
                }
                Some(ClientEvent::Restarted) => return Some(None),
                _ => {}
            }
            left = until.saturating_duration_since(self.host.clock.now());
        }
        None
    }
}

/// A reason as a clause about the city, with what to do.
fn clause(reason: DenialReason) -> &'static str {
    match reason {
        DenialReason::KeyNeeded => "it requires a shared key: give --key FILE",
        DenialReason::NoKey => "it has no shared key: leave out --key",
        DenialReason::OtherKey => "it has another shared key: --key names the wrong file",
        DenialReason::OtherWorld => "it is another world: see --world",
        DenialReason::OtherVersion => {
            "it speaks another version of the protocol: use the same release of City3D"
        }
    }
}
