//! UDP server of the link: a socket, a thread that receives and checks datagrams, and a bounded queue for the
//! simulation. On a host without threads the reader of the queue reads the socket.

use super::LinkError;
use super::inbound_filter::{InboundFilter, LinkState};
use super::receive_queue::{Inbound, ReceiveQueue, WakeCondition};
use super::senders::SenderId;
use super::warmup::SendPathWarmup;
use crate::host::{Clock, DatagramSocket, Host};
use city3d_protocol::wire::{
    Authenticator, Body, DatagramHeader, DropCounts, DropReason, MAX_DATAGRAM_BYTES,
};
use std::io::{self, ErrorKind};
use std::net::{IpAddr, SocketAddr, ToSocketAddrs};
use std::str::FromStr;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

/// One byte more than the longest datagram, to notice longer ones.
const BUFFER_BYTES: usize = MAX_DATAGRAM_BYTES + 1;
/// Interval at which the thread checks whether it shall stop.
const STOP_CHECK_INTERVAL: Duration = Duration::from_millis(100);

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

/// Who reads the socket of a server.
#[derive(Debug)]
enum Reader {
    /// A thread, until it is told to stop.
    Thread { stop: Arc<AtomicBool>, thread: Option<JoinHandle<()>> },
    /// The caller, while it asks for datagrams.
    Caller { clock: Arc<dyn Clock>, filter: Box<Mutex<InboundFilter>> },
}

/// UDP server of a city or of a vehicle. It stops its thread when it is dropped.
#[derive(Debug)]
pub struct Server {
    socket: Box<dyn DatagramSocket>,
    address: SocketAddr,
    queue: Arc<ReceiveQueue>,
    shared: Arc<Mutex<LinkState>>,
    header: DatagramHeader,
    authenticator: Authenticator,
    warmup: Option<SendPathWarmup>,
    reader: Reader,
}

impl Server {
    /// Opens a socket of this machine and begins to read it.
    ///
    /// # Errors
    /// When the address is malformed or in use.
    pub fn bind(options: &ServerOptions) -> Result<Self, LinkError> {
        Self::on(&Host::system(), options)
    }

    /// Opens a socket of a host and begins to read it.
    ///
    /// # Errors
    /// When the address is malformed or in use.
    pub fn on(host: &Host, options: &ServerOptions) -> Result<Self, LinkError> {
        let address = || options.address.clone();
        let no_socket = |source| LinkError::Socket { address: address(), source };
        let found = options.address.to_socket_addrs().ok().and_then(|mut found| found.next());
        let found = found.ok_or_else(|| LinkError::Address { address: address() })?;
        let socket = host.network.bind(found).map_err(no_socket)?;
        let queue = Arc::new(ReceiveQueue::default());
        let shared = Arc::new(Mutex::new(LinkState::new(options.rate_per_s)));
        let session = host.network.session();
        let header = DatagramHeader { session, world: options.world, ..DatagramHeader::default() };
        let filter = InboundFilter::new(options, host, header, Arc::clone(&queue), Arc::clone(&shared));
        let clock = Arc::clone(&host.clock);
        let reader = if host.network.has_threads() {
            let socket = socket.try_clone().map_err(no_socket)?;
            Reader::thread(socket, clock, filter).map_err(no_socket)?
        } else {
            Reader::Caller { clock, filter: Box::new(Mutex::new(filter)) }
        };
        let warmup = host.network.has_threads().then(SendPathWarmup::new).transpose()?;
        let address = socket.local_address().map_err(no_socket)?;
        let authenticator = options.authenticator.clone();
        Ok(Self { socket, address, queue, shared, header, authenticator, warmup, reader })
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
        match &self.reader {
            Reader::Thread { .. } => self.queue.receive(wait),
            Reader::Caller { .. } => {
                if !self.queue.has(WakeCondition::Anything) {
                    self.read(WakeCondition::Anything, wait);
                }
                self.queue.receive(Duration::ZERO)
            }
        }
    }

    /// Waits at most this long for a datagram that wants an answer, or for many datagrams. Trajectories wait for the
    /// next tick.
    pub fn wait_for_urgent(&self, wait: Duration) {
        match &self.reader {
            Reader::Thread { .. } => self.queue.wait_for_urgent(wait),
            Reader::Caller { .. } => self.read(WakeCondition::Urgent, wait),
        }
    }

    /// Reads the socket in the place of the thread: all that has come, and what comes until the queue has what is waited
    /// for, or until the wait is over.
    fn read(&self, waiting: WakeCondition, wait: Duration) {
        let Reader::Caller { clock, filter } = &self.reader else { return };
        let mut filter = filter.lock().unwrap_or_else(PoisonError::into_inner);
        let begun = clock.now();
        let mut bytes = [0; BUFFER_BYTES];
        loop {
            let left = wait.saturating_sub(clock.now().saturating_duration_since(begun));
            let left = if self.queue.has(waiting) { Duration::ZERO } else { left };
            match self.socket.receive(&mut bytes, left) {
                Ok(Some((length, from))) => {
                    let answer = filter.take(&bytes[..length], from, &**clock);
                    send_answer(&*self.socket, from, answer);
                }
                // A wait that is over needs no poll behind it.
                Ok(None) if left.is_zero() || clock.now().saturating_duration_since(begun) >= wait => return,
                Ok(None) => {}
                Err(error) if is_of_peer(&error) => {}
                Err(error) => {
                    tracing::warn!("the link's socket cannot be read: {error}");
                    return clock.sleep(left);
                }
            }
        }
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
            && let Err(error) = self.socket.send_burst(address, &datagrams)
        {
            tracing::debug!("{address}: a datagram is not sent: {error}");
        }
    }

    /// Dry run of [`Server::send_all`] that warms the caches, so that the real call soon after is faster.
    pub fn warm_up(&self, bodies: &[Body]) {
        let Some(warmup) = &self.warmup else { return };
        for body in bodies {
            if let Ok(bytes) = body.encode(self.header, &self.authenticator) {
                warmup.run(&bytes);
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

    /// These senders keep their places when there are too many, and no others.
    pub fn keep(&self, senders: impl Iterator<Item = SenderId>) {
        self.lock().senders.keep(senders.collect());
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

impl Reader {
    fn thread(
        socket: Box<dyn DatagramSocket>,
        clock: Arc<dyn Clock>,
        filter: InboundFilter,
    ) -> io::Result<Self> {
        let stop = Arc::new(AtomicBool::new(false));
        let reader = ReceiveThread { socket, clock, filter, stop: Arc::clone(&stop) };
        let thread = std::thread::Builder::new().name("link".to_owned()).spawn(move || reader.run())?;
        Ok(Self::Thread { stop, thread: Some(thread) })
    }
}

impl Drop for Reader {
    fn drop(&mut self) {
        let Self::Thread { stop, thread } = self else { return };
        stop.store(true, Ordering::Relaxed);
        if let Some(thread) = thread.take() {
            // A panic of the thread has been reported already.
            let _ = thread.join();
        }
    }
}

/// Thread that receives datagrams and gives them to the filter.
struct ReceiveThread {
    socket: Box<dyn DatagramSocket>,
    clock: Arc<dyn Clock>,
    filter: InboundFilter,
    stop: Arc<AtomicBool>,
}

impl ReceiveThread {
    fn run(mut self) {
        let mut bytes = [0; BUFFER_BYTES];
        while !self.stop.load(Ordering::Relaxed) {
            match self.socket.receive(&mut bytes, STOP_CHECK_INTERVAL) {
                Ok(Some((length, from))) => {
                    let answer = self.filter.take(&bytes[..length], from, &*self.clock);
                    send_answer(&*self.socket, from, answer);
                }
                Ok(None) => {}
                Err(error) if is_of_peer(&error) => {}
                Err(error) => {
                    tracing::warn!("the link's socket cannot be read: {error}");
                    self.clock.sleep(STOP_CHECK_INTERVAL);
                }
            }
        }
    }
}

/// Sends a challenge or a denial of the filter. It may be lost: a handshake is repeated.
fn send_answer(socket: &dyn DatagramSocket, to: SocketAddr, answer: Option<Vec<u8>>) {
    let Some(answer) = answer else { return };
    if let Err(error) = socket.send_burst(to, &[answer]) {
        tracing::debug!("{to}: a handshake is not answered: {error}");
    }
}

/// Whether it is the error of an earlier send to a peer that is gone.
fn is_of_peer(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::ConnectionRefused | ErrorKind::ConnectionReset)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::link::{Client, ClientEvent};
    use city3d_protocol::wire::{Denial, DenialReason, RequestOutcome};

    #[test]
    fn a_server_of_this_machine_reads_its_socket_in_a_thread() {
        let (authenticator, long) = (Authenticator::Checksum, Duration::from_secs(10));
        let server = Server::bind(&ServerOptions {
            address: "127.0.0.1:0".to_owned(),
            world: 1,
            authenticator: authenticator.clone(),
            allowed: Vec::new(),
            rate_per_s: 100.0,
            takes_clock: false,
        });
        let server = server.unwrap();
        let mut client = Client::new(&server.address(), 1, authenticator).unwrap();
        client.send(&Body::Hello { token: 7 });
        while !client.is_connected() {
            assert_eq!(client.receive(Duration::from_millis(10)), None);
        }
        server.wait_for_urgent(long);
        let inbound = server.receive(Duration::ZERO).unwrap();
        assert_eq!(inbound.body, Body::Hello { token: 7 });
        let ack =
            |request| Body::Ack { request, outcome: RequestOutcome::Done, tick: 0, detail: String::new() };
        server.send_all(inbound.sender, &[ack(1), ack(2)]);
        assert_eq!(client.receive(long), Some(ClientEvent::Body(ack(1))));
        assert_eq!(client.receive(long), Some(ClientEvent::Body(ack(2))));
        assert_eq!(client.receive(Duration::ZERO), None);
    }

    #[test]
    fn the_thread_denies_a_handshake_without_the_key() {
        let server = Server::bind(&ServerOptions {
            address: "127.0.0.1:0".to_owned(),
            world: 1,
            authenticator: Authenticator::Key(b"a key of the laboratory".to_vec()),
            allowed: Vec::new(),
            rate_per_s: 100.0,
            takes_clock: false,
        });
        let server = server.unwrap();
        let socket = Host::system().network.connect(server.address().parse().unwrap()).unwrap();
        let header = DatagramHeader { session: 7, ..DatagramHeader::default() };
        let hello = Body::Hello { token: 1 }.encode(header, &Authenticator::Checksum).unwrap();
        socket.send(&hello).unwrap();
        let mut bytes = [0; BUFFER_BYTES];
        let (length, _) = socket.receive(&mut bytes, Duration::from_secs(10)).unwrap().unwrap();
        let (header, denial) = Denial::decode(&bytes[..length]).unwrap();
        assert_eq!((header.peer, denial.reason), (7, DenialReason::KeyNeeded));
    }

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
