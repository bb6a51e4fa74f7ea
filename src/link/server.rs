//! The city's end of the link: a socket with a thread that reads it, and a bounded queue.

use super::LinkError;
use super::burst::Bursts;
use super::inbox::{Inbound, Inbox};
use super::rehearsal::Rehearsal;
use super::senders::{Origin, Senders};
use crate::wire::{Body, DropReason, Drops, Header, LONGEST_DATAGRAM, Seal};
use std::io::ErrorKind;
use std::net::{IpAddr, SocketAddr, ToSocketAddrs, UdpSocket};
use std::str::FromStr;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Asked of the system for the socket: a burst of all trajectories of a large fleet.
const SOCKET_BYTES: usize = 4 << 20;
/// So often the thread looks whether it shall end.
const LOOK_UP: Duration = Duration::from_millis(100);
/// What is dropped is logged no more often than this.
const TELL_EVERY: Duration = Duration::from_secs(1);

/// Addresses that may send: one, or a network.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Allowed {
    network: IpAddr,
    bits: u32,
}

impl FromStr for Allowed {
    type Err = LinkError;

    fn from_str(text: &str) -> Result<Self, LinkError> {
        let no_network = || LinkError::Network { address: text.to_owned() };
        let (network, bits) = text.split_once('/').map_or((text, None), |(ip, bits)| (ip, Some(bits)));
        let network: IpAddr = network.parse().map_err(|_| no_network())?;
        let most = if network.is_ipv4() { 32 } else { 128 };
        let bits = bits.map_or(Ok(most), |bits| bits.parse().map_err(|_| no_network()))?;
        if bits > most { Err(no_network()) } else { Ok(Self { network, bits }) }
    }
}

impl Allowed {
    pub fn holds(&self, address: IpAddr) -> bool {
        match (self.network, address) {
            (IpAddr::V4(a), IpAddr::V4(b)) => same(a.to_bits().into(), b.to_bits().into(), 32 - self.bits),
            (IpAddr::V6(a), IpAddr::V6(b)) => same(a.to_bits(), b.to_bits(), 128 - self.bits),
            _ => false,
        }
    }
}

/// Whether two addresses are the same but for so many bits at their end.
fn same(a: u128, b: u128, free: u32) -> bool {
    (a ^ b).checked_shr(free).unwrap_or(0) == 0
}

/// How the city's end is set up.
#[derive(Clone, Debug)]
pub struct ServerOptions {
    /// Where it listens.
    pub address: String,
    pub world: u32,
    pub seal: Seal,
    /// Who may send; everybody that reaches the address where it is empty.
    pub allowed: Vec<Allowed>,
    /// Datagrams that each address may send in a second.
    pub rate_per_s: f64,
    /// Whether it is told what the experiment's clock shows: a vehicle is, a city tells.
    pub takes_clock: bool,
}

#[derive(Debug)]
struct Shared {
    senders: Senders,
    drops: Drops,
    received: u64,
    used: u64,
}

/// The city's end of the link. Dropped, it ends its thread.
#[derive(Debug)]
pub struct Server {
    socket: UdpSocket,
    address: SocketAddr,
    inbox: Arc<Inbox>,
    shared: Arc<Mutex<Shared>>,
    header: Header,
    seal: Seal,
    bursts: Bursts,
    rehearsal: Rehearsal,
    ends: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Server {
    /// Opens the socket and begins to read it.
    ///
    /// # Errors
    /// When the address is none, or is taken.
    pub fn bind(options: &ServerOptions) -> Result<Self, LinkError> {
        let address = || options.address.clone();
        let no_socket = |source| LinkError::Socket { address: address(), source };
        let found = options.address.to_socket_addrs().ok().and_then(|mut found| found.next());
        let socket = UdpSocket::bind(found.ok_or_else(|| LinkError::Address { address: address() })?)
            .map_err(no_socket)?;
        // Less than asked for is no fault.
        let _ = socket2::SockRef::from(&socket).set_recv_buffer_size(SOCKET_BYTES);
        socket.set_read_timeout(Some(LOOK_UP)).map_err(no_socket)?;
        let inbox = Arc::new(Inbox::default());
        let senders = Senders::new(options.rate_per_s);
        let shared = Shared { senders, drops: Drops::default(), received: 0, used: 0 };
        let shared = Arc::new(Mutex::new(shared));
        let ends = Arc::new(AtomicBool::new(false));
        let header =
            Header { session: super::client::new_session(), world: options.world, ..Header::default() };
        let reader = Reader {
            socket: socket.try_clone().map_err(no_socket)?,
            inbox: Arc::clone(&inbox),
            shared: Arc::clone(&shared),
            header,
            seal: options.seal.clone(),
            allowed: options.allowed.clone(),
            takes_clock: options.takes_clock,
            ends: Arc::clone(&ends),
            report: Report { dropped: 0, told: None },
        };
        let thread = std::thread::Builder::new().name("link".to_owned()).spawn(move || reader.read());
        let thread = Some(thread.map_err(no_socket)?);
        let address = socket.local_addr().map_err(no_socket)?;
        let seal = options.seal.clone();
        Ok(Self {
            socket,
            address,
            inbox,
            shared,
            header,
            seal,
            bursts: Bursts::default(),
            rehearsal: Rehearsal::new()?,
            ends,
            thread,
        })
    }

    /// Where it listens.
    pub fn address(&self) -> String {
        self.address.to_string()
    }

    /// Whether only this machine can reach it.
    pub fn is_loopback(&self) -> bool {
        self.address.ip().is_loopback()
    }

    /// Waits for the next datagram, at most so long.
    pub fn receive(&self, wait: Duration) -> Option<Inbound> {
        self.inbox.receive(wait)
    }

    /// Waits until something has come that wants an answer, or much has come, but no longer than this. Trajectories
    /// are for the next tick.
    pub fn rest(&self, wait: Duration) {
        self.inbox.rest(wait);
    }

    /// Sends a sender something. One that has begun anew, or that cannot be reached, does not get it.
    pub fn tell(&self, origin: Origin, body: &Body) {
        self.tell_all(origin, std::slice::from_ref(body));
    }

    /// The same for several things at once.
    pub fn tell_all(&self, origin: Origin, bodies: &[Body]) {
        let mut datagrams = Vec::with_capacity(bodies.len());
        let mut address = None;
        for body in bodies {
            let Some(told) = self.lock().senders.tell(origin) else { return };
            let header = Header { peer: told.session, sequence: told.sequence, ..self.header };
            match body.encode(header, &self.seal) {
                Ok(bytes) => datagrams.push(bytes),
                Err(error) => tracing::warn!("{}: not sent: {error}", told.address),
            }
            address = Some(told.address);
        }
        if let Some(address) = address
            && let Err(error) = self.bursts.send(&self.socket, address, &datagrams)
        {
            tracing::debug!("{address}: not sent: {error}");
        }
    }

    /// Does everything that [`Server::tell_all`] does, but nobody gets it: what follows soon is faster then.
    pub fn rehearse(&self, bodies: &[Body]) {
        for body in bodies {
            if let Ok(bytes) = body.encode(self.header, &self.seal) {
                self.rehearsal.run(&bytes);
            }
        }
    }

    /// Where a sender is, in words.
    pub fn label(&self, origin: Origin) -> String {
        self.lock().senders.address(origin).map_or_else(|| "gone".to_owned(), |address| address.to_string())
    }

    /// Whether a sender can still be told something.
    pub fn knows(&self, origin: Origin) -> bool {
        self.lock().senders.address(origin).is_some()
    }

    /// Counts something that was dropped after it had been read.
    pub fn count(&self, reason: DropReason) {
        self.lock().drops.count(reason);
    }

    /// How many datagrams have come, how many of them were used, what was dropped, and how many were sent
    /// and have not come.
    pub fn figures(&self) -> (u64, u64, Drops, u64) {
        let shared = self.lock();
        (shared.received, shared.used, shared.drops.clone(), shared.senders.missing())
    }

    fn lock(&self) -> MutexGuard<'_, Shared> {
        self.shared.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.ends.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // It has nothing to say.
            let _ = thread.join();
        }
    }
}

/// The thread that reads the socket.
struct Reader {
    socket: UdpSocket,
    inbox: Arc<Inbox>,
    shared: Arc<Mutex<Shared>>,
    /// Of the city.
    header: Header,
    seal: Seal,
    allowed: Vec<Allowed>,
    takes_clock: bool,
    ends: Arc<AtomicBool>,
    report: Report,
}

/// What has been said of dropped datagrams.
struct Report {
    dropped: u64,
    told: Option<Instant>,
}

impl Reader {
    fn read(mut self) {
        // One byte more than a datagram may have tells those that are longer.
        let mut bytes = [0; LONGEST_DATAGRAM + 1];
        while !self.ends.load(Ordering::Relaxed) {
            match self.socket.recv_from(&mut bytes) {
                Ok((length, from)) => {
                    if let Err((reason, why)) = self.take(&bytes[..length], from) {
                        self.drop_one(reason, from, &why);
                    }
                }
                Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {}
                // Somebody who was told something is gone.
                Err(error)
                    if matches!(error.kind(), ErrorKind::ConnectionRefused | ErrorKind::ConnectionReset) => {}
                Err(error) => {
                    tracing::warn!("the link cannot be read: {error}");
                    std::thread::sleep(LOOK_UP);
                }
            }
        }
    }

    fn take(&self, bytes: &[u8], from: SocketAddr) -> Result<(), (DropReason, String)> {
        let now = Instant::now();
        let plain = |reason| (reason, String::new());
        let is_allowed =
            self.allowed.is_empty() || self.allowed.iter().any(|allowed| allowed.holds(from.ip()));
        let mut shared = self.shared.lock().unwrap_or_else(PoisonError::into_inner);
        shared.received += 1;
        if !is_allowed {
            return Err(plain(DropReason::ForeignSender));
        }
        if !shared.senders.may_send(from, now) {
            return Err(plain(DropReason::TooFast));
        }
        drop(shared);
        let (header, body) = Body::decode(bytes, &self.seal)
            .map_err(|error| (DropReason::from(&error), format!(": {error}")))?;
        let is_clock = self.takes_clock && matches!(body, Body::Clock(_));
        if !body.is_to_city() && !is_clock {
            return Err(plain(DropReason::WrongWay));
        }
        let is_ours = header.peer == self.header.session
            || (header.peer == 0
                && (matches!(self.seal, Seal::Checksum) || matches!(body, Body::Hello { .. })));
        if !is_ours || (header.world != 0 && header.world != self.header.world) {
            return Err(plain(DropReason::OtherCity));
        }
        let mut shared = self.shared.lock().unwrap_or_else(PoisonError::into_inner);
        let origin = shared.senders.admit(from, &header, now).map_err(plain)?;
        if let Body::Barrier { first, count, .. } = body
            && !shared.senders.has_all(from, first, count)
        {
            return Err(plain(DropReason::Incomplete));
        }
        // Nobody else puts anything there.
        if !self.inbox.has_room() {
            return Err(plain(DropReason::Full));
        }
        shared.senders.note(from, header.sequence);
        shared.used += 1;
        drop(shared);
        self.inbox.push(Inbound { origin, body, at: Instant::now() });
        Ok(())
    }

    fn drop_one(&mut self, reason: DropReason, from: SocketAddr, why: &str) {
        self.shared.lock().unwrap_or_else(PoisonError::into_inner).drops.count(reason);
        self.report.dropped += 1;
        let now = Instant::now();
        if self.report.told.is_none_or(|told| now.duration_since(told) >= TELL_EVERY) {
            let more = match self.report.dropped {
                1 => String::new(),
                count => format!(" ({count} dropped since the last such line)"),
            };
            tracing::warn!("{from}: a datagram is dropped, {}{why}{more}", reason.label());
            self.report = Report { dropped: 0, told: Some(now) };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_list_of_senders_has_addresses_and_networks() {
        let allowed = |text: &str, ip: &str| text.parse::<Allowed>().unwrap().holds(ip.parse().unwrap());
        assert!(allowed("192.168.1.7", "192.168.1.7") && !allowed("192.168.1.7", "192.168.1.8"));
        assert!(allowed("192.168.1.0/24", "192.168.1.200") && !allowed("192.168.1.0/24", "192.168.2.1"));
        assert!(allowed("0.0.0.0/0", "8.8.8.8") && !allowed("0.0.0.0/0", "::1"));
        assert!(allowed("fe80::/10", "fe80::1") && allowed("::/0", "::1"));
        for wrong in ["", "lab", "192.168.1.7/33", "192.168.1.0/x", "1.2.3"] {
            let told = wrong.parse::<Allowed>().unwrap_err().to_string();
            assert!(told.contains("write it as"), "{told}");
        }
    }
}
