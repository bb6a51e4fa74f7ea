//! Sockets and datagrams of a simulated network: delay, jitter, loss, duplicates, partitions and bounded buffers.

use super::{SimulatedCounters, SimulatedOptions};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::io::{Error, ErrorKind, Result};
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};
use std::sync::Arc;
use std::time::Duration;

/// First of the ports for sockets that ask for any (RFC 6335, section 6).
const FIRST_DYNAMIC_PORT: u16 = 49152;

#[derive(Debug)]
struct SocketState {
    /// Name of the participant that has opened it.
    owner: Arc<str>,
    address: SocketAddr,
    peer: Option<SocketAddr>,
    buffer: VecDeque<(SocketAddr, Vec<u8>)>,
    /// Nothing listened where an earlier datagram of it came.
    is_refused: bool,
}

#[derive(Debug)]
struct Datagram {
    sender: u64,
    owner: Arc<str>,
    from: SocketAddr,
    to: SocketAddr,
    bytes: Vec<u8>,
}

/// All sockets, and the datagrams between them.
#[derive(Debug)]
pub(super) struct Traffic {
    pub options: SimulatedOptions,
    pub counters: SimulatedCounters,
    rng: ChaCha8Rng,
    sockets: BTreeMap<u64, SocketState>,
    last_socket: u64,
    next_port: u16,
    /// By time of arrival and number.
    in_flight: BTreeMap<(Duration, u64), Datagram>,
    /// Pairs of participants that do not hear each other, in the order of their names.
    partitions: BTreeSet<[String; 2]>,
    isolated: BTreeSet<String>,
}

impl Traffic {
    pub fn new(options: SimulatedOptions) -> Self {
        Self {
            rng: ChaCha8Rng::seed_from_u64(options.seed),
            options,
            counters: SimulatedCounters::default(),
            sockets: BTreeMap::new(),
            last_socket: 0,
            next_port: FIRST_DYNAMIC_PORT,
            in_flight: BTreeMap::new(),
            partitions: BTreeSet::new(),
            isolated: BTreeSet::new(),
        }
    }

    pub fn draw_session(&mut self) -> u64 {
        self.rng.next_u64().max(1)
    }

    /// A draw from 0 to 1, without 1.
    fn draw(&mut self) -> f64 {
        (self.rng.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Opens a socket, and gives its number.
    pub fn open(
        &mut self,
        owner: Arc<str>,
        mut address: SocketAddr,
        peer: Option<SocketAddr>,
    ) -> Result<u64> {
        if address.port() == 0 {
            address.set_port(self.free_port()?);
        }
        let is_taken = |socket: &SocketState| {
            let (ip, taken) = (address.ip(), socket.address.ip());
            socket.address.port() == address.port()
                && (ip == taken || ip.is_unspecified() || taken.is_unspecified())
        };
        if self.sockets.values().any(is_taken) {
            return Err(Error::new(ErrorKind::AddrInUse, format!("{address} is in use")));
        }
        self.last_socket += 1;
        let socket = SocketState { owner, address, peer, buffer: VecDeque::new(), is_refused: false };
        self.sockets.insert(self.last_socket, socket);
        Ok(self.last_socket)
    }

    /// The next port in turn that no socket has: a port that was given up is not drawn again at once.
    fn free_port(&mut self) -> Result<u16> {
        for _ in FIRST_DYNAMIC_PORT..=u16::MAX {
            let port = self.next_port;
            self.next_port = port.checked_add(1).unwrap_or(FIRST_DYNAMIC_PORT);
            if self.sockets.values().all(|socket| socket.address.port() != port) {
                return Ok(port);
            }
        }
        Err(Error::new(ErrorKind::AddrInUse, "no port is free"))
    }

    pub fn close(&mut self, socket: u64) {
        self.sockets.remove(&socket);
    }

    pub fn address(&self, socket: u64) -> Result<SocketAddr> {
        Ok(self.socket(socket)?.address)
    }

    fn socket(&self, socket: u64) -> Result<&SocketState> {
        self.sockets.get(&socket).ok_or_else(|| ErrorKind::NotConnected.into())
    }

    /// Sends a datagram to the peer of a socket. As on Linux, a pending error is told once and the datagram not sent.
    pub fn send_to_peer(&mut self, now: Duration, socket: u64, bytes: &[u8]) -> Result<()> {
        let sender = self.sockets.get_mut(&socket).ok_or(ErrorKind::NotConnected)?;
        if std::mem::take(&mut sender.is_refused) {
            return Err(ErrorKind::ConnectionRefused.into());
        }
        let to = sender.peer.ok_or(ErrorKind::NotConnected)?;
        self.send(now, socket, to, bytes)
    }

    pub fn send(&mut self, now: Duration, socket: u64, to: SocketAddr, bytes: &[u8]) -> Result<()> {
        let sender = self.socket(socket)?;
        let (owner, mut from) = (Arc::clone(&sender.owner), sender.address);
        if from.ip().is_unspecified() {
            from.set_ip(source_ip(to));
        }
        self.counters.sent += 1;
        let copies = if self.draw() < self.options.duplication { 2 } else { 1 };
        for _ in 0..copies {
            // Both are drawn for each datagram, so that a change of one condition leaves the draws of the others.
            let (loss, jitter) = (self.draw(), self.draw());
            if loss < self.options.loss {
                self.counters.lost += 1;
                continue;
            }
            let arrival = now + self.options.delay + self.options.jitter.mul_f64(jitter);
            self.counters.copies += 1;
            let bytes = bytes.to_vec();
            let datagram = Datagram { sender: socket, owner: Arc::clone(&owner), from, to, bytes };
            self.in_flight.insert((arrival, self.counters.copies), datagram);
        }
        Ok(())
    }

    /// When the next datagram arrives.
    pub fn next_arrival(&self) -> Option<Duration> {
        self.in_flight.first_key_value().map(|((at, _), _)| *at)
    }

    /// Delivers the datagrams that have arrived by now.
    pub fn deliver(&mut self, now: Duration) {
        while self.next_arrival().is_some_and(|at| at <= now) {
            if let Some((_, datagram)) = self.in_flight.pop_first() {
                self.deliver_one(datagram);
            }
        }
    }

    fn deliver_one(&mut self, Datagram { sender, owner, from, to, bytes }: Datagram) {
        let listens = |socket: &SocketState| {
            let ip = socket.address.ip();
            socket.address.port() == to.port()
                && (ip == to.ip() || (ip.is_unspecified() && ip.is_ipv4() == to.is_ipv4()))
                && socket.peer.is_none_or(|peer| peer == from)
        };
        let found = self.sockets.iter().find(|(_, socket)| listens(socket));
        let found = found.map(|(number, socket)| (*number, Arc::clone(&socket.owner)));
        let is_cut = match &found {
            Some((_, listener)) => self.is_cut(&owner, listener),
            None => self.isolated.contains(&*owner),
        };
        if is_cut {
            self.counters.lost += 1;
            return;
        }
        let Some(listener) = found.and_then(|(number, _)| self.sockets.get_mut(&number)) else {
            self.counters.refused += 1;
            if let Some(sender) = self.sockets.get_mut(&sender).filter(|sender| sender.peer.is_some()) {
                sender.is_refused = true;
            }
            return;
        };
        if listener.buffer.len() >= self.options.buffer_datagrams {
            self.counters.overflowed += 1;
        } else {
            self.counters.delivered += 1;
            listener.buffer.push_back((from, bytes));
        }
    }

    fn is_cut(&self, a: &str, b: &str) -> bool {
        a != b
            && (self.isolated.contains(a)
                || self.isolated.contains(b)
                || self.partitions.contains(&pair(a, b)))
    }

    pub fn partition(&mut self, a: &str, b: &str) {
        self.partitions.insert(pair(a, b));
    }

    pub fn isolate(&mut self, name: &str) {
        self.isolated.insert(name.to_owned());
    }

    pub fn repair(&mut self) {
        self.partitions.clear();
        self.isolated.clear();
    }

    /// Whether receiving from a socket would give something.
    pub fn is_readable(&self, socket: u64) -> bool {
        self.sockets.get(&socket).is_none_or(|socket| socket.is_refused || !socket.buffer.is_empty())
    }

    /// Takes the oldest datagram, as much of it as fits, or the pending error.
    pub fn take(&mut self, socket: u64, bytes: &mut [u8]) -> Result<Option<(usize, SocketAddr)>> {
        let socket = self.sockets.get_mut(&socket).ok_or(ErrorKind::NotConnected)?;
        if std::mem::take(&mut socket.is_refused) {
            return Err(ErrorKind::ConnectionRefused.into());
        }
        let Some((from, datagram)) = socket.buffer.pop_front() else { return Ok(None) };
        let length = datagram.len().min(bytes.len());
        bytes[..length].copy_from_slice(&datagram[..length]);
        Ok(Some((length, from)))
    }
}

/// The address from which one machine sends to an address of its own.
pub(super) fn source_ip(to: SocketAddr) -> IpAddr {
    match to.ip() {
        ip if !ip.is_unspecified() => ip,
        IpAddr::V4(_) => Ipv4Addr::LOCALHOST.into(),
        IpAddr::V6(_) => Ipv6Addr::LOCALHOST.into(),
    }
}

fn pair(a: &str, b: &str) -> [String; 2] {
    let mut pair = [a.to_owned(), b.to_owned()];
    pair.sort();
    pair
}
