//! TCP servers beside a city: each has a thread of its own, a limit of connections, and counters. What a connection says
//! is up to its server.

use std::io;
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr, ToSocketAddrs};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{Semaphore, watch};
use tokio::time::sleep;

/// Send buffer of a connection, bytes: what a slow peer has not read stays little.
const SEND_BUFFER: usize = 128 << 10;
/// Pause after an error of the listening socket, such as too many open files.
const ACCEPT_PAUSE: Duration = Duration::from_millis(100);

/// Why nobody can connect.
#[derive(Debug, thiserror::Error)]
pub enum ListenError {
    /// The address is in use, or is none of this machine.
    #[error("{address}: {error}")]
    Address {
        /// The address that was asked for.
        address: String,
        /// What the system says.
        error: io::Error,
    },
    /// The operating system refuses a thread or a runtime.
    #[error("no thread can be started: {0}")]
    Thread(io::Error),
}

/// How long a server waits for its peers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Patience {
    /// For the request of a peer, and its first message where it has to send one.
    pub request: Duration,
    /// For a peer that has to read what it is sent.
    pub send: Duration,
    /// For any sign of life.
    pub silence: Duration,
}

/// A bound address that nobody listens on yet.
#[derive(Debug)]
pub struct BoundListener {
    listener: std::net::TcpListener,
    address: SocketAddr,
}

impl BoundListener {
    /// Binds an address and port, or a host name and port.
    ///
    /// # Errors
    /// When the address is in use, or none of this machine.
    pub fn bind(address: &str) -> Result<Self, ListenError> {
        let bind = || {
            let found = address.to_socket_addrs()?.next();
            let listener = std::net::TcpListener::bind(found.ok_or(io::ErrorKind::AddrNotAvailable)?)?;
            listener.set_nonblocking(true)?;
            let address = listener.local_addr()?;
            Ok(Self { listener, address })
        };
        bind().map_err(|error| ListenError::Address { address: address.to_owned(), error })
    }

    /// Accepts connections on a thread of this name, `most` at once: `serve` makes what a connection does. `beside` is done on
    /// the same thread.
    ///
    /// # Errors
    /// When the operating system refuses the thread.
    pub fn listen<S: Future<Output = ()> + Send + 'static>(
        self,
        (name, most): (&'static str, usize),
        counters: Arc<PeerCounters>,
        serve: impl Fn(TcpStream) -> S + Send + 'static,
        beside: impl Future<Output = ()> + Send + 'static,
    ) -> Result<Listening, ListenError> {
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .build()
            .map_err(ListenError::Thread)?;
        let (stop, mut stopped) = watch::channel(false);
        let Self { listener, address } = self;
        let work = async move {
            let listener = match TcpListener::from_std(listener) {
                Ok(listener) => listener,
                Err(error) => return tracing::warn!("nobody can connect to {address}: {error}"),
            };
            tokio::select! {
                _ = stopped.wait_for(|is_stopped| *is_stopped) => {}
                () = accept(listener, most, &counters, serve) => {}
                () = beside => {}
            }
        };
        let thread = std::thread::Builder::new().name(name.to_owned()).spawn(move || runtime.block_on(work));
        Ok(Listening { address, stop, thread: Some(thread.map_err(ListenError::Thread)?) })
    }
}

/// A server that listens. Dropping it ends its thread and disconnects all.
#[derive(Debug)]
pub struct Listening {
    address: SocketAddr,
    stop: watch::Sender<bool>,
    thread: Option<JoinHandle<()>>,
}

impl Listening {
    /// The address that it listens on.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// An address by which this machine reaches it.
    pub fn reachable(&self) -> SocketAddr {
        let mut shown = self.address;
        if shown.ip().is_unspecified() {
            shown.set_ip(match shown {
                SocketAddr::V4(_) => Ipv4Addr::LOCALHOST.into(),
                SocketAddr::V6(_) => Ipv6Addr::LOCALHOST.into(),
            });
        }
        shown
    }
}

impl Drop for Listening {
    fn drop(&mut self) {
        self.stop.send_replace(true);
        if let Some(thread) = self.thread.take() {
            // It has nothing to say.
            let _ = thread.join();
        }
    }
}

async fn accept<S: Future<Output = ()> + Send + 'static>(
    listener: TcpListener,
    most: usize,
    counters: &PeerCounters,
    serve: impl Fn(TcpStream) -> S,
) {
    let room = Arc::new(Semaphore::new(most));
    loop {
        let Ok((stream, _)) = listener.accept().await else {
            sleep(ACCEPT_PAUSE).await;
            continue;
        };
        let Ok(place) = Arc::clone(&room).try_acquire_owned() else {
            count(&counters.refused, 1);
            continue;
        };
        // Larger buffers and later packets work too.
        let _ = stream.set_nodelay(true);
        let _ = socket2::SockRef::from(&stream).set_send_buffer_size(SEND_BUFFER);
        let connection = serve(stream);
        tokio::spawn(async move {
            connection.await;
            drop(place);
        });
    }
}

/// Counts more.
pub fn count(counter: &AtomicU64, more: u64) {
    counter.fetch_add(more, Ordering::Relaxed);
}

/// What a server has sent to its peers, refused and dropped.
#[derive(Debug, Default)]
#[allow(missing_docs, reason = "as in the counts")]
pub struct PeerCounters {
    pub messages: AtomicU64,
    pub refused: AtomicU64,
    pub wrong_tokens: AtomicU64,
    pub invalid: AtomicU64,
    pub slow: AtomicU64,
    pub forbidden: AtomicU64,
    pub lost_orders: AtomicU64,
    pub connected: AtomicU64,
}

impl PeerCounters {
    /// A peer has connected.
    pub fn enter(&self) {
        self.connected.fetch_add(1, Ordering::Relaxed);
    }

    /// It has gone.
    pub fn leave(&self) {
        self.connected.fetch_sub(1, Ordering::Relaxed);
    }

    /// What was counted.
    pub fn counts(&self) -> PeerCounts {
        let of = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        PeerCounts {
            messages: of(&self.messages),
            refused: of(&self.refused),
            wrong_tokens: of(&self.wrong_tokens),
            invalid: of(&self.invalid),
            slow: of(&self.slow),
            forbidden: of(&self.forbidden),
            lost_orders: of(&self.lost_orders),
            connected: of(&self.connected),
        }
    }
}

/// Counts since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PeerCounts {
    /// Messages that were sent, of all kinds.
    pub messages: u64,
    /// Connections and requests that were refused: wrong host, origin or protocol, too many.
    pub refused: u64,
    /// Peers with a wrong token.
    pub wrong_tokens: u64,
    /// Peers that were disconnected for messages which are too large, too many or no messages.
    pub invalid: u64,
    /// Peers that were disconnected because they did not read, or were silent.
    pub slow: u64,
    /// Orders of peers without the token.
    pub forbidden: u64,
    /// Orders that found no room.
    pub lost_orders: u64,
    /// Peers that are connected now.
    pub connected: u64,
}

impl PeerCounts {
    /// What was dropped, of any kind.
    pub fn dropped(&self) -> u64 {
        self.refused + self.wrong_tokens + self.invalid + self.slow + self.forbidden + self.lost_orders
    }
}
