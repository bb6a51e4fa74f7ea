//! UDP server of the link: a socket, a thread that receives and checks datagrams, and a bounded queue for the
//! simulation.

use super::LinkError;
use super::burst::BurstSender;
use super::receive_queue::{Inbound, ReceiveQueue};
use super::senders::{SenderId, Senders};
use super::warmup::SendPathWarmup;
use city3d_protocol::wire::{
    Authenticator, Body, DatagramHeader, DropCounts, DropReason, MAX_DATAGRAM_BYTES,
};
use std::io::ErrorKind;
use std::net::{IpAddr, SocketAddr, ToSocketAddrs, UdpSocket};
use std::str::FromStr;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Receive buffer of the socket: holds a burst of all trajectories of a large fleet.
const SOCKET_BYTES: usize = 4 << 20;
/// Interval at which the thread checks whether it shall stop.
const STOP_CHECK_INTERVAL: Duration = Duration::from_millis(100);
/// Dropped datagrams are logged no more often than this.
const LOG_INTERVAL: Duration = Duration::from_secs(1);

/// Entry of the allow list: an IP address or a network in CIDR notation (RFC 4632).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AllowedNetwork {
    network: IpAddr,
    prefix_bits: u32,
}

impl FromStr for AllowedNetwork {
    type Err = LinkError;

    fn from_str(text: &str) -> Result<Self, LinkError> {
        let no_network = || LinkError::Network { address: text.to_owned() };
        let (network, bits) = text.split_once('/').map_or((text, None), |(ip, bits)| (ip, Some(bits)));
        let network: IpAddr = network.parse().map_err(|_| no_network())?;
        let most = if network.is_ipv4() { 32 } else { 128 };
        let bits = bits.map_or(Ok(most), |bits| bits.parse().map_err(|_| no_network()))?;
        if bits > most { Err(no_network()) } else { Ok(Self { network, prefix_bits: bits }) }
    }
}

impl AllowedNetwork {
    /// Whether an address belongs to the network.
    pub fn contains(&self, address: IpAddr) -> bool {
        match (self.network, address) {
            (IpAddr::V4(a), IpAddr::V4(b)) => {
                same_prefix(a.to_bits().into(), b.to_bits().into(), 32 - self.prefix_bits)
            }
            (IpAddr::V6(a), IpAddr::V6(b)) => same_prefix(a.to_bits(), b.to_bits(), 128 - self.prefix_bits),
            _ => false,
        }
    }
}

/// Whether two addresses are equal but for their last `host_bits`.
fn same_prefix(a: u128, b: u128, host_bits: u32) -> bool {
    (a ^ b).checked_shr(host_bits).unwrap_or(0) == 0
}

/// Settings of a [`Server`].
#[derive(Clone, Debug)]
pub struct ServerOptions {
    /// Address and port to listen on.
    pub address: String,
    /// World number of the city; datagrams with another one are dropped, those with 0 are not.
    pub world: u32,
    /// Signs and checks the datagrams: with a shared key, or with a checksum alone.
    pub authenticator: Authenticator,
    /// Allow list of senders; empty allows all.
    pub allowed: Vec<AllowedNetwork>,
    /// Rate limit of each address, datagrams per second.
    pub rate_per_s: f64,
    /// Whether it accepts clock datagrams: a vehicle does, a city only sends them.
    pub takes_clock: bool,
}

/// Counters of a link.
#[derive(Clone, Debug, Default)]
pub struct LinkCounters {
    /// Datagrams that have come.
    pub received: u64,
    /// Of them, datagrams that have passed all checks.
    pub used: u64,
    /// Datagrams lost on their way, by the gaps in the sequence numbers.
    pub missing: u64,
    /// Dropped datagrams by reason.
    pub dropped: DropCounts,
}

/// What the server shares with its thread.
#[derive(Debug)]
struct LinkState {
    senders: Senders,
    drops: DropCounts,
    received: u64,
    used: u64,
}

/// UDP server of a city or of a vehicle. It stops its thread when it is dropped.
#[derive(Debug)]
pub struct Server {
    socket: UdpSocket,
    address: SocketAddr,
    queue: Arc<ReceiveQueue>,
    shared: Arc<Mutex<LinkState>>,
    header: DatagramHeader,
    authenticator: Authenticator,
    bursts: BurstSender,
    warmup: SendPathWarmup,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Server {
    /// Opens the socket and begins to read it.
    ///
    /// # Errors
    /// When the address is malformed or in use.
    pub fn bind(options: &ServerOptions) -> Result<Self, LinkError> {
        let address = || options.address.clone();
        let no_socket = |source| LinkError::Socket { address: address(), source };
        let found = options.address.to_socket_addrs().ok().and_then(|mut found| found.next());
        let socket = UdpSocket::bind(found.ok_or_else(|| LinkError::Address { address: address() })?)
            .map_err(no_socket)?;
        // A smaller buffer works too.
        let _ = socket2::SockRef::from(&socket).set_recv_buffer_size(SOCKET_BYTES);
        socket.set_read_timeout(Some(STOP_CHECK_INTERVAL)).map_err(no_socket)?;
        let queue = Arc::new(ReceiveQueue::default());
        let senders = Senders::new(options.rate_per_s);
        let shared = LinkState { senders, drops: DropCounts::default(), received: 0, used: 0 };
        let shared = Arc::new(Mutex::new(shared));
        let stop = Arc::new(AtomicBool::new(false));
        let header = DatagramHeader {
            session: super::client::new_session(),
            world: options.world,
            ..DatagramHeader::default()
        };
        let reader = ReceiveThread {
            socket: socket.try_clone().map_err(no_socket)?,
            queue: Arc::clone(&queue),
            shared: Arc::clone(&shared),
            header,
            authenticator: options.authenticator.clone(),
            allowed: options.allowed.clone(),
            takes_clock: options.takes_clock,
            stop: Arc::clone(&stop),
            drop_log: DropLog { dropped: 0, logged_at: None },
        };
        let thread = std::thread::Builder::new().name("link".to_owned()).spawn(move || reader.run());
        let thread = Some(thread.map_err(no_socket)?);
        let address = socket.local_addr().map_err(no_socket)?;
        let authenticator = options.authenticator.clone();
        Ok(Self {
            socket,
            address,
            queue,
            shared,
            header,
            authenticator,
            bursts: BurstSender::default(),
            warmup: SendPathWarmup::new()?,
            stop,
            thread,
        })
    }

    /// The address that it listens on.
    pub fn address(&self) -> String {
        self.address.to_string()
    }

    /// Whether only this machine can reach it.
    pub fn is_loopback(&self) -> bool {
        self.address.ip().is_loopback()
    }

    /// Takes the next datagram, and waits for it at most this long.
    pub fn receive(&self, wait: Duration) -> Option<Inbound> {
        self.queue.receive(wait)
    }

    /// Waits at most this long for a datagram that wants an answer, or for many datagrams. Trajectories wait for the
    /// next tick.
    pub fn wait_for_urgent(&self, wait: Duration) {
        self.queue.wait_for_urgent(wait);
    }

    /// Sends a body to a sender. It is lost when the session of the sender has ended or its address is unreachable.
    pub fn send(&self, sender: SenderId, body: &Body) {
        self.send_all(sender, std::slice::from_ref(body));
    }

    /// Sends several bodies to a sender in one burst.
    pub fn send_all(&self, sender: SenderId, bodies: &[Body]) {
        let mut datagrams = Vec::with_capacity(bodies.len());
        let mut address = None;
        for body in bodies {
            let Some(reply) = self.lock().senders.next_reply(sender) else { return };
            let header = DatagramHeader { peer: reply.session, sequence: reply.sequence, ..self.header };
            match body.encode(header, &self.authenticator) {
                Ok(bytes) => datagrams.push(bytes),
                Err(error) => tracing::warn!("{}: a datagram is not sent: {error}", reply.address),
            }
            address = Some(reply.address);
        }
        if let Some(address) = address
            && let Err(error) = self.bursts.send(&self.socket, address, &datagrams)
        {
            tracing::debug!("{address}: a datagram is not sent: {error}");
        }
    }

    /// Dry run of [`Server::send_all`] that warms the caches, so that the real call soon after is faster.
    pub fn warm_up(&self, bodies: &[Body]) {
        for body in bodies {
            if let Ok(bytes) = body.encode(self.header, &self.authenticator) {
                self.warmup.run(&bytes);
            }
        }
    }

    /// The address of a sender for logs and messages.
    pub fn label(&self, sender: SenderId) -> String {
        self.lock().senders.address(sender).map_or_else(|| "gone".to_owned(), |address| address.to_string())
    }

    /// Whether the session of a sender still exists.
    pub fn knows(&self, sender: SenderId) -> bool {
        self.lock().senders.address(sender).is_some()
    }

    /// Counts a drop that happened after the datagram had left the queue.
    pub fn count_drop(&self, reason: DropReason) {
        self.lock().drops.count(reason);
    }

    /// The counters of the link since its start.
    pub fn counters(&self) -> LinkCounters {
        let shared = self.lock();
        LinkCounters {
            received: shared.received,
            used: shared.used,
            missing: shared.senders.missing(),
            dropped: shared.drops.clone(),
        }
    }

    fn lock(&self) -> MutexGuard<'_, LinkState> {
        self.shared.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // A panic of the thread has been reported already.
            let _ = thread.join();
        }
    }
}

/// Thread that receives datagrams, checks them and queues them.
struct ReceiveThread {
    socket: UdpSocket,
    queue: Arc<ReceiveQueue>,
    shared: Arc<Mutex<LinkState>>,
    /// Session and world of this server.
    header: DatagramHeader,
    authenticator: Authenticator,
    allowed: Vec<AllowedNetwork>,
    takes_clock: bool,
    stop: Arc<AtomicBool>,
    drop_log: DropLog,
}

/// Rate limiter of the log messages about dropped datagrams.
struct DropLog {
    /// Drops since the last message.
    dropped: u64,
    logged_at: Option<Instant>,
}

impl ReceiveThread {
    fn run(mut self) {
        // One byte more than the longest datagram, to notice longer ones.
        let mut bytes = [0; MAX_DATAGRAM_BYTES + 1];
        while !self.stop.load(Ordering::Relaxed) {
            match self.socket.recv_from(&mut bytes) {
                Ok((length, from)) => {
                    if let Err((reason, why)) = self.accept(&bytes[..length], from) {
                        self.note_drop(reason, from, &why);
                    }
                }
                Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {}
                // The error of an earlier send to a peer that is gone.
                Err(error)
                    if matches!(error.kind(), ErrorKind::ConnectionRefused | ErrorKind::ConnectionReset) => {}
                Err(error) => {
                    tracing::warn!("the link's socket cannot be read: {error}");
                    std::thread::sleep(STOP_CHECK_INTERVAL);
                }
            }
        }
    }

    /// Checks a datagram and queues it: allow list, rate limit, authentication, session, replay window, room.
    fn accept(&self, bytes: &[u8], from: SocketAddr) -> Result<(), (DropReason, String)> {
        let now = Instant::now();
        let plain = |reason| (reason, String::new());
        let is_allowed =
            self.allowed.is_empty() || self.allowed.iter().any(|allowed| allowed.contains(from.ip()));
        let mut shared = self.shared.lock().unwrap_or_else(PoisonError::into_inner);
        shared.received += 1;
        if !is_allowed {
            return Err(plain(DropReason::ForeignSender));
        }
        if !shared.senders.may_send(from, now) {
            return Err(plain(DropReason::TooFast));
        }
        drop(shared);
        let (header, body) = Body::decode(bytes, &self.authenticator)
            .map_err(|error| (DropReason::from(&error), format!(": {error}")))?;
        let is_clock = self.takes_clock && matches!(body, Body::Clock(_));
        if !body.is_to_city() && !is_clock {
            return Err(plain(DropReason::WrongWay));
        }
        let is_ours = header.peer == self.header.session
            || (header.peer == 0
                && (matches!(self.authenticator, Authenticator::Checksum)
                    || matches!(body, Body::Hello { .. })));
        if !is_ours || (header.world != 0 && header.world != self.header.world) {
            return Err(plain(DropReason::OtherCity));
        }
        let mut shared = self.shared.lock().unwrap_or_else(PoisonError::into_inner);
        let sender = shared.senders.admit(from, &header, now).map_err(plain)?;
        if let Body::Barrier { first, count, .. } = body
            && !shared.senders.has_all(from, first, count)
        {
            return Err(plain(DropReason::Incomplete));
        }
        // No other thread adds to the queue.
        if !self.queue.has_room() {
            return Err(plain(DropReason::Full));
        }
        shared.senders.mark_received(from, header.sequence);
        shared.used += 1;
        drop(shared);
        self.queue.push(Inbound { sender, body, at: Instant::now() });
        Ok(())
    }

    fn note_drop(&mut self, reason: DropReason, from: SocketAddr, why: &str) {
        self.shared.lock().unwrap_or_else(PoisonError::into_inner).drops.count(reason);
        self.drop_log.dropped += 1;
        let now = Instant::now();
        if self.drop_log.logged_at.is_none_or(|at| now.duration_since(at) >= LOG_INTERVAL) {
            let more = match self.drop_log.dropped {
                1 => String::new(),
                count => format!(" ({count} dropped since the last such message)"),
            };
            tracing::warn!("{from}: a datagram is dropped, {}{why}{more}", reason.label());
            self.drop_log = DropLog { dropped: 0, logged_at: Some(now) };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_list_of_senders_has_addresses_and_networks() {
        let allowed =
            |text: &str, ip: &str| text.parse::<AllowedNetwork>().unwrap().contains(ip.parse().unwrap());
        assert!(allowed("192.168.1.7", "192.168.1.7") && !allowed("192.168.1.7", "192.168.1.8"));
        assert!(allowed("192.168.1.0/24", "192.168.1.200") && !allowed("192.168.1.0/24", "192.168.2.1"));
        assert!(allowed("0.0.0.0/0", "8.8.8.8") && !allowed("0.0.0.0/0", "::1"));
        assert!(allowed("fe80::/10", "fe80::1") && allowed("::/0", "::1"));
        for wrong in ["", "lab", "192.168.1.7/33", "192.168.1.0/x", "1.2.3"] {
            let told = wrong.parse::<AllowedNetwork>().unwrap_err().to_string();
            assert!(told.contains("write it as"), "{told}");
        }
    }
}
