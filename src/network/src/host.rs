//! What the link needs of its machine: a clock and datagram sockets (dependency injection). [`Host::system`] has those of
//! the machine, [`crate::simulated`] those of a simulation in virtual time.

use crate::link::burst::BurstSender;
use std::collections::hash_map::RandomState;
use std::fmt;
use std::hash::BuildHasher;
use std::io::{self, ErrorKind};
use std::net::{SocketAddr, UdpSocket};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant, SystemTime};

/// Receive buffer of a socket: holds a burst of all trajectories of a large fleet.
const SOCKET_BYTES: usize = 4 << 20;

/// A clock, and waiting by it.
pub trait Clock: fmt::Debug + Send + Sync {
    /// The present instant; it never goes back.
    fn now(&self) -> Instant;

    /// The wall clock: seconds since 1970-01-01 00:00 UTC.
    fn unix_s(&self) -> f64;

    /// Waits for this long.
    fn sleep(&self, wait: Duration);
}

/// Opens sockets, and draws the session numbers of those who use them.
pub trait Network: fmt::Debug + Send + Sync {
    /// Opens a socket at an address; port 0 stands for any free one.
    ///
    /// # Errors
    /// When the address is in use, or is none of this machine.
    fn bind(&self, address: SocketAddr) -> io::Result<Box<dyn DatagramSocket>>;

    /// Opens a socket at any free port that exchanges datagrams with one peer.
    ///
    /// # Errors
    /// When the peer cannot be reached from here.
    fn connect(&self, to: SocketAddr) -> io::Result<Box<dyn DatagramSocket>>;

    /// Draws a session number that no other process has had, with overwhelming probability; never 0.
    fn session(&self) -> u64;

    /// Whether a server reads its socket in a thread of its own. If not, it reads it while it is asked for datagrams.
    fn has_threads(&self) -> bool;
}

/// A socket for datagrams (UDP). At most one of its clones receives.
pub trait DatagramSocket: fmt::Debug + Send + Sync {
    /// The address that it is bound to.
    ///
    /// # Errors
    /// When the system does not tell it.
    fn local_address(&self) -> io::Result<SocketAddr>;

    /// Sends a datagram to the peer that the socket is connected to.
    ///
    /// # Errors
    /// When it has no peer, when nothing listened there when an earlier datagram came, or when the system refuses.
    fn send(&self, datagram: &[u8]) -> io::Result<()>;

    /// Sends datagrams to an address in their order, as one burst where the system can do that.
    ///
    /// # Errors
    /// When a datagram cannot be sent; the ones behind it are not tried.
    fn send_burst(&self, to: SocketAddr, datagrams: &[Vec<u8>]) -> io::Result<()>;

    /// Receives a datagram into `bytes`, and waits for it at most this long: gives its length and its source. A wait of
    /// zero polls. `None` when nothing has come; an interrupted wait may end early.
    ///
    /// # Errors
    /// [`ErrorKind::ConnectionRefused`] when nothing listened where an earlier datagram came, or what the system reports.
    fn receive(&self, bytes: &mut [u8], wait: Duration) -> io::Result<Option<(usize, SocketAddr)>>;

    /// Another handle of the same socket.
    ///
    /// # Errors
    /// When the system refuses it.
    fn try_clone(&self) -> io::Result<Box<dyn DatagramSocket>>;
}

/// The machine as the link sees it.
#[derive(Clone, Debug)]
pub struct Host {
    /// Its clock.
    pub clock: Arc<dyn Clock>,
    /// Its sockets.
    pub network: Arc<dyn Network>,
}

impl Host {
    /// The machine that the program runs on.
    pub fn system() -> Self {
        Self { clock: Arc::new(SystemClock), network: Arc::new(SystemNetwork) }
    }
}

impl Default for Host {
    fn default() -> Self {
        Self::system()
    }
}

/// The clocks of this machine.
#[derive(Clone, Copy, Debug, Default)]
pub struct SystemClock;

impl Clock for SystemClock {
    fn now(&self) -> Instant {
        Instant::now()
    }

    fn unix_s(&self) -> f64 {
        SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).map_or(0.0, |since| since.as_secs_f64())
    }

    fn sleep(&self, wait: Duration) {
        std::thread::sleep(wait);
    }
}

/// The UDP sockets of this machine.
#[derive(Clone, Copy, Debug, Default)]
pub struct SystemNetwork;

impl Network for SystemNetwork {
    fn bind(&self, address: SocketAddr) -> io::Result<Box<dyn DatagramSocket>> {
        Ok(Box::new(SystemSocket::new(open(address)?, None)))
    }

    fn connect(&self, to: SocketAddr) -> io::Result<Box<dyn DatagramSocket>> {
        let own = if to.is_ipv4() { ([0; 4], 0).into() } else { ([0_u16; 8], 0).into() };
        let socket = open(own)?;
        socket.connect(to)?;
        Ok(Box::new(SystemSocket::new(socket, Some(to))))
    }

    fn session(&self) -> u64 {
        // The hasher's keys come from the system's source of randomness.
        RandomState::new().hash_one((SystemTime::now(), std::process::id())).max(1)
    }

    fn has_threads(&self) -> bool {
        true
    }
}

fn open(address: SocketAddr) -> io::Result<UdpSocket> {
    let socket = UdpSocket::bind(address)?;
    // A smaller buffer works too.
    let _ = socket2::SockRef::from(&socket).set_recv_buffer_size(SOCKET_BYTES);
    Ok(socket)
}

#[derive(Debug)]
struct SystemSocket {
    socket: UdpSocket,
    peer: Option<SocketAddr>,
    bursts: BurstSender,
    /// Read timeout that was set last, nanoseconds: setting it is a system call.
    timeout_ns: AtomicU64,
}

impl SystemSocket {
    fn new(socket: UdpSocket, peer: Option<SocketAddr>) -> Self {
        Self { socket, peer, bursts: BurstSender::default(), timeout_ns: AtomicU64::new(0) }
    }

    fn set_timeout(&self, wait: Duration) -> io::Result<()> {
        // A timeout of zero would mean to wait for ever.
        let wait = wait.max(Duration::from_micros(1));
        let wait_ns = u64::try_from(wait.as_nanos()).unwrap_or(u64::MAX);
        if self.timeout_ns.load(Ordering::Relaxed) != wait_ns {
            self.socket.set_read_timeout(Some(wait))?;
            self.timeout_ns.store(wait_ns, Ordering::Relaxed);
        }
        Ok(())
    }

    fn read(&self, bytes: &mut [u8]) -> io::Result<(usize, SocketAddr)> {
        match self.peer {
            Some(peer) => Ok((self.socket.recv(bytes)?, peer)),
            None => self.socket.recv_from(bytes),
        }
    }

    /// Receives without waiting. A timeout would last some milliseconds at least, a tick of the system's timer.
    fn poll(&self, bytes: &mut [u8]) -> io::Result<(usize, SocketAddr)> {
        #[cfg(target_os = "linux")]
        if let Some(peer) = self.peer {
            use nix::sys::socket::{MsgFlags, recv};
            use std::os::fd::AsRawFd;
            return Ok((recv(self.socket.as_raw_fd(), bytes, MsgFlags::MSG_DONTWAIT)?, peer));
        }
        self.socket.set_nonblocking(true)?;
        let read = self.read(bytes);
        // A socket that stayed non-blocking would turn waiting into spinning.
        if let Err(error) = self.socket.set_nonblocking(false) {
            tracing::warn!("the socket cannot be set to wait: {error}");
        }
        read
    }
}

impl DatagramSocket for SystemSocket {
    fn local_address(&self) -> io::Result<SocketAddr> {
        self.socket.local_addr()
    }

    fn send(&self, datagram: &[u8]) -> io::Result<()> {
        self.socket.send(datagram).map(drop)
    }

    fn send_burst(&self, to: SocketAddr, datagrams: &[Vec<u8>]) -> io::Result<()> {
        self.bursts.send(&self.socket, to, datagrams)
    }

    fn receive(&self, bytes: &mut [u8], wait: Duration) -> io::Result<Option<(usize, SocketAddr)>> {
        let read = if wait.is_zero() {
            self.poll(bytes)
        } else {
            self.set_timeout(wait)?;
            self.read(bytes)
        };
        match read {
            Ok(read) => Ok(Some(read)),
            Err(error)
                if matches!(
                    error.kind(),
                    ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted
                ) =>
            {
                Ok(None)
            }
            Err(error) => Err(error),
        }
    }

    fn try_clone(&self) -> io::Result<Box<dyn DatagramSocket>> {
        Ok(Box::new(Self::new(self.socket.try_clone()?, self.peer)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LONG: Duration = Duration::from_secs(10);

    #[test]
    fn sockets_of_the_system_exchange_datagrams() {
        let host = Host::system();
        let server = host.network.bind(([127, 0, 0, 1], 0).into()).unwrap();
        let client = host.network.connect(server.local_address().unwrap()).unwrap();
        let mut bytes = [0; 8];
        assert_eq!(client.receive(&mut bytes, Duration::ZERO).unwrap(), None);
        assert_eq!(server.receive(&mut bytes, Duration::ZERO).unwrap(), None);
        client.send(b"ask").unwrap();
        let reader = server.try_clone().unwrap();
        let (length, from) = reader.receive(&mut bytes, LONG).unwrap().unwrap();
        assert_eq!((&bytes[..length], from.port()), (&b"ask"[..], client.local_address().unwrap().port()));
        server.send_burst(from, &[b"one".to_vec(), b"two".to_vec()]).unwrap();
        for expected in [b"one", b"two"] {
            let (length, from) = client.receive(&mut bytes, LONG).unwrap().unwrap();
            assert_eq!((&bytes[..length], from), (&expected[..], server.local_address().unwrap()));
        }
        // A wait that ends without a datagram is no error.
        assert_eq!(client.receive(&mut bytes, Duration::from_micros(1)).unwrap(), None);
    }
}
