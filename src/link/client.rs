//! The other end of the link: what sends to a city and hears it.

use super::{LinkError, Window};
use crate::wire::{Body, Header, LONGEST_DATAGRAM, Outcome, Seal};
use std::collections::hash_map::RandomState;
use std::hash::BuildHasher;
use std::io::ErrorKind;
use std::net::{ToSocketAddrs, UdpSocket};
use std::time::{Duration, Instant, SystemTime};

/// A request that is not answered is sent again after this.
const AGAIN: Duration = Duration::from_millis(100);
const SOCKET_BYTES: usize = 4 << 20;

/// A number for a session: no other process, and none before, has the same.
pub(super) fn new_session() -> u64 {
    // The hasher's keys come from the system's source of randomness.
    RandomState::new().hash_one((SystemTime::now(), std::process::id())).max(1)
}

/// What comes from the city.
#[derive(Clone, Debug, PartialEq)]
pub enum Heard {
    Body(Body),
    /// It has another session than before: it has been restarted, and knows nothing any more.
    Restarted,
}

/// One who sends to a city.
#[derive(Debug)]
pub struct Client {
    socket: UdpSocket,
    seal: Seal,
    header: Header,
    window: Window,
    request: u32,
}

impl Client {
    /// Opens a socket to a city; nothing is sent yet.
    ///
    /// # Errors
    /// When the address is none, or cannot be reached from here.
    pub fn new(city: &str, world: u32, seal: Seal) -> Result<Self, LinkError> {
        let address = || city.to_owned();
        let no_socket = |source| LinkError::Socket { address: address(), source };
        let found = city.to_socket_addrs().ok().and_then(|mut found| found.next());
        let found = found.ok_or_else(|| LinkError::Address { address: address() })?;
        let own = if found.is_ipv4() { "0.0.0.0:0" } else { "[::]:0" };
        let socket = UdpSocket::bind(own).map_err(no_socket)?;
        let _ = socket2::SockRef::from(&socket).set_recv_buffer_size(SOCKET_BYTES);
        socket.connect(found).map_err(no_socket)?;
        let header = Header { session: new_session(), world, ..Header::default() };
        Ok(Self { socket, seal, header, window: Window::default(), request: 0 })
    }

    /// Begins anew, as a sender that nobody has heard of yet.
    pub fn renew(&mut self) {
        self.header = Header { session: new_session(), peer: 0, sequence: 0, ..self.header };
        self.window = Window::default();
    }

    /// Sends something, and gives the sequence it has gone by. Nobody knows whether it arrives.
    pub fn send(&mut self, body: &Body) -> u64 {
        self.header.sequence += 1;
        match body.encode(self.header, &self.seal) {
            Ok(bytes) => self.resend(&bytes),
            Err(error) => tracing::warn!("not sent: {error}"),
        }
        self.header.sequence
    }

    /// Asks whoever is at the city's address whether it is there, a restarted one too.
    pub fn probe(&mut self) {
        let peer = std::mem::take(&mut self.header.peer);
        self.send(&Body::Hello { token: 0 });
        self.header.peer = peer;
    }

    /// Bytes of the next datagram, for [`Client::resend`].
    pub fn prepare(&mut self, body: &Body) -> Option<(u64, Vec<u8>)> {
        self.header.sequence += 1;
        match body.encode(self.header, &self.seal) {
            Ok(bytes) => Some((self.header.sequence, bytes)),
            Err(error) => {
                tracing::warn!("not sent: {error}");
                None
            }
        }
    }

    /// Sends a datagram as it is.
    pub fn resend(&self, bytes: &[u8]) {
        // A city that is away refuses; the next answer tells that it is back.
        let _ = self.socket.send(bytes);
    }

    /// The next thing that comes from the city, waiting no longer than this.
    pub fn receive(&mut self, wait: Duration) -> Option<Heard> {
        if wait.is_zero() {
            return self.poll();
        }
        let until = Instant::now() + wait;
        let mut bytes = [0; LONGEST_DATAGRAM + 1];
        loop {
            let left = until.saturating_duration_since(Instant::now());
            // A timeout of nothing would wait for ever.
            let _ = self.socket.set_read_timeout(Some(left.max(Duration::from_micros(1))));
            match self.socket.recv(&mut bytes) {
                Ok(length) => {
                    if let Some(heard) = self.take(&bytes[..length]) {
                        return Some(heard);
                    }
                }
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {}
                // Nobody is there: no reason to ask again at once.
                Err(_) => std::thread::sleep(left.min(Duration::from_millis(5))),
            }
            if Instant::now() >= until {
                return None;
            }
        }
    }

    /// What is there already. The shortest timeout of a socket is that of the system's clock, some milliseconds.
    fn poll(&mut self) -> Option<Heard> {
        let mut bytes = [0; LONGEST_DATAGRAM + 1];
        self.socket.set_nonblocking(true).ok()?;
        let mut heard = None;
        while heard.is_none() {
            match self.socket.recv(&mut bytes) {
                Ok(length) => heard = self.take(&bytes[..length]),
                // Somebody was not there; what comes after that may be.
                Err(error) if error.kind() == ErrorKind::ConnectionRefused => {}
                Err(_) => break,
            }
        }
        // A socket that waits no more would turn waiting into spinning.
        if let Err(error) = self.socket.set_nonblocking(false) {
            tracing::warn!("the link cannot be waited for: {error}");
        }
        heard
    }

    fn take(&mut self, bytes: &[u8]) -> Option<Heard> {
        let (header, body) = match Body::decode(bytes, &self.seal) {
            Ok(read) => read,
            Err(error) => {
                tracing::debug!("the city sent what cannot be read: {error}");
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
            return Some(Heard::Restarted);
        }
        self.window.check(header.sequence).ok()?;
        self.window.note(header.sequence);
        Some(Heard::Body(body))
    }

    /// Sends a request until it is answered, no longer than this. `None`: it was not.
    pub fn ask(&mut self, patience: Duration, body: impl Fn(u32) -> Body) -> Option<(Outcome, String)> {
        self.request += 1;
        let number = self.request;
        let body = body(number);
        let until = Instant::now() + patience;
        while Instant::now() < until {
            self.send(&body);
            let again = Instant::now() + AGAIN;
            while let Some(left) = again.checked_duration_since(Instant::now()) {
                match self.receive(left) {
                    Some(Heard::Body(Body::Ack { request, outcome, detail, .. })) if request == number => {
                        return Some((outcome, detail));
                    }
                    Some(Heard::Restarted) => return None,
                    _ => {}
                }
            }
        }
        None
    }
}
