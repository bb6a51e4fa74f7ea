//! The server: its thread, its connections, and the end of the session that counts for it.

use crate::client;
use crate::control::{Control, PageOrders};
use crate::counters::{Counters, WebCounts};
use crate::feed::{self, Feed, Told};
use crate::http::{self, Answer, MAX_HEAD_BYTES};
use crate::pictures::Pictures;
use city3d_session::{End, EndHealth, Moment, PublishedState, Token};
use city3d_simulation::scenario::Experiment;
use std::io;
use std::net::{SocketAddr, TcpListener, ToSocketAddrs};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};
use std::thread::JoinHandle;
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::sync::{Semaphore, watch};
use tokio::time::{MissedTickBehavior, interval, sleep, timeout};

/// Connections at once, at most; more are refused.
const MAX_CONNECTIONS: usize = 64;
/// A client that has not asked for anything by then is disconnected.
const HEAD_TIMEOUT: Duration = Duration::from_secs(5);
/// Interval at which the latest state is looked at: as often as a screen needs it.
const STATE_INTERVAL: Duration = Duration::from_millis(40);
/// Send buffer of a connection, bytes: what a slow client has not read stays little.
const SEND_BUFFER: usize = 128 << 10;
/// Pause after an error of the listening socket, such as too many open files.
const ACCEPT_PAUSE: Duration = Duration::from_millis(100);

/// How the page is served.
#[derive(Debug)]
pub struct WebOptions {
    /// Address and port to listen on.
    pub address: String,
    /// Who knows it gives orders.
    pub token: Token,
    /// The experiment that runs.
    pub experiment: Arc<Experiment>,
    /// Takes the orders of pages.
    pub orders: PageOrders,
}

/// Why the page cannot be served.
#[derive(Debug, thiserror::Error)]
pub enum WebError {
    /// The address is in use, or is none of this machine.
    #[error(
        "the web page cannot be served at {address}: {error}; give another one, such as --web=127.0.0.1:8081"
    )]
    Address {
        /// The address that was asked for.
        address: String,
        /// What the system says.
        error: io::Error,
    },
    /// The operating system refuses a thread or a runtime.
    #[error("no thread for the web page can be started: {0}")]
    Thread(io::Error),
}

/// What the connections of a server share.
#[derive(Debug)]
pub(crate) struct Shared {
    pub token: Token,
    pub control: Control,
    pub counters: Arc<Counters>,
    pub map: Arc<str>,
    pub told: watch::Sender<Option<Told>>,
    pub pictures: Pictures,
    state: Arc<OnceLock<PublishedState>>,
    /// A host name that the address was given by.
    name: Option<String>,
    next_page: AtomicU64,
}

impl Shared {
    pub(crate) fn next_page(&self) -> u64 {
        self.next_page.fetch_add(1, Ordering::Relaxed)
    }
}

/// A page that is served on a thread of its own. Dropping it ends the thread and disconnects all pages.
#[derive(Debug)]
pub struct WebServer {
    address: SocketAddr,
    shared: Arc<Shared>,
    stop: watch::Sender<bool>,
    thread: Option<JoinHandle<()>>,
}

impl WebServer {
    /// Binds the address and starts the thread. There is nothing to see before [`Self::watch`].
    ///
    /// # Errors
    /// When the address cannot be bound, or the system refuses the thread.
    pub fn start(options: WebOptions) -> Result<Self, WebError> {
        let WebOptions { address, token, experiment, orders } = options;
        let listener =
            bind(&address).map_err(|error| WebError::Address { address: address.clone(), error })?;
        let bound = listener.local_addr().map_err(WebError::Thread)?;
        let (counters, state) = (Arc::<Counters>::default(), Arc::<OnceLock<_>>::default());
        let shared = Arc::new(Shared {
            token,
            control: Control::new(orders, Arc::clone(&counters)),
            counters,
            map: feed::map(&experiment).into(),
            told: watch::Sender::new(None),
            pictures: Pictures::new(Arc::clone(&state)),
            state,
            name: address.rsplit_once(':').map(|(name, _)| name.to_owned()).filter(|name| !name.is_empty()),
            next_page: AtomicU64::new(1),
        });
        let runtime =
            tokio::runtime::Builder::new_current_thread().enable_all().build().map_err(WebError::Thread)?;
        let (stop, stopped) = watch::channel(false);
        let inner = Arc::clone(&shared);
        let work = move || runtime.block_on(run(listener, inner, stopped));
        let thread = std::thread::Builder::new().name("web".to_owned()).spawn(work);
        Ok(Self { address: bound, shared, stop, thread: Some(thread.map_err(WebError::Thread)?) })
    }

    /// Shows the states that a session publishes.
    pub fn watch(&self, state: PublishedState) {
        // A server has one session.
        let _ = self.shared.state.set(state);
    }

    /// Draws pictures for the pages with a renderer, which is opened on a thread of its own.
    #[cfg(feature = "render")]
    pub fn draw(&self, open: crate::PictureDrawer) {
        self.shared.pictures.start(open);
    }

    /// The end of the session that counts what the page does. It has no queue: pages are told the latest state.
    pub fn end(&self) -> WebEnd {
        WebEnd(Arc::clone(&self.shared.counters))
    }

    /// The address that it listens on.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// The address for who may give orders. What follows the `#` stays in the browser.
    pub fn url(&self) -> String {
        let mut shown = self.address;
        if shown.ip().is_unspecified() {
            shown.set_ip(match shown {
                SocketAddr::V4(_) => std::net::Ipv4Addr::LOCALHOST.into(),
                SocketAddr::V6(_) => std::net::Ipv6Addr::LOCALHOST.into(),
            });
        }
        format!("http://{shown}/#{}", self.shared.token.text())
    }

    /// What it has counted.
    pub fn counts(&self) -> WebCounts {
        self.shared.counters.counts()
    }
}

impl Drop for WebServer {
    fn drop(&mut self) {
        self.stop.send_replace(true);
        self.shared.pictures.stop();
        if let Some(thread) = self.thread.take() {
            // It has nothing to say.
            let _ = thread.join();
        }
    }
}

/// The page as an end of a session.
#[derive(Debug)]
pub struct WebEnd(Arc<Counters>);

impl End for WebEnd {
    fn name(&self) -> &'static str {
        "web"
    }

    fn take(&mut self, _: &Moment<'_>) {}

    fn health(&self) -> EndHealth {
        let counts = self.0.counts();
        EndHealth { delivered: counts.messages, dropped: counts.dropped(), failure: None }
    }
}

fn bind(address: &str) -> io::Result<TcpListener> {
    let found = address.to_socket_addrs()?.next();
    let listener = TcpListener::bind(found.ok_or(io::ErrorKind::AddrNotAvailable)?)?;
    listener.set_nonblocking(true)?;
    Ok(listener)
}

async fn run(listener: TcpListener, shared: Arc<Shared>, mut stopped: watch::Receiver<bool>) {
    let listener = match tokio::net::TcpListener::from_std(listener) {
        Ok(listener) => listener,
        Err(error) => return tracing::warn!("the web page is not served: {error}"),
    };
    tokio::select! {
        _ = stopped.wait_for(|is_stopped| *is_stopped) => {}
        () = accept(listener, Arc::clone(&shared)) => {}
        () = tell(&shared) => {}
    }
}

async fn accept(listener: tokio::net::TcpListener, shared: Arc<Shared>) {
    let room = Arc::new(Semaphore::new(MAX_CONNECTIONS));
    loop {
        let Ok((stream, _)) = listener.accept().await else {
            sleep(ACCEPT_PAUSE).await;
            continue;
        };
        let Ok(place) = Arc::clone(&room).try_acquire_owned() else {
            Counters::add(&shared.counters.refused, 1);
            continue;
        };
        let shared = Arc::clone(&shared);
        tokio::spawn(async move {
            connection(stream, &shared).await;
            drop(place);
        });
    }
}

/// Makes the texts of the latest state while somebody looks, each once for all pages.
async fn tell(shared: &Shared) {
    let mut looks = interval(STATE_INTERVAL);
    looks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let (mut feed, mut last) = (Feed::default(), None);
    loop {
        looks.tick().await;
        let pages = shared.counters.counts().pages;
        let Some(state) = shared.state.get().map(PublishedState::run_state) else { continue };
        let is_new =
            last.as_ref().is_none_or(|(before, told_to)| !Arc::ptr_eq(before, &state) || *told_to != pages);
        if is_new && pages > 0 {
            shared.told.send_replace(Some(feed.tell(&state, pages, shared.control.head())));
            last = Some((state, pages));
        }
    }
}

async fn connection(mut stream: TcpStream, shared: &Shared) {
    // Larger buffers and later packets work too.
    let _ = stream.set_nodelay(true);
    let _ = socket2::SockRef::from(&stream).set_send_buffer_size(SEND_BUFFER);
    let answer = match timeout(HEAD_TIMEOUT, request(&mut stream, shared)).await {
        Ok(Some(answer)) => answer,
        // Whoever connects and says nothing is a browser that expects to ask later, or no browser.
        Ok(None) => return,
        Err(_) => http::refusal("408 Request Timeout"),
    };
    let (text, is_socket, is_refusal) = match answer {
        Answer::Upgrade(text) => (text, true, false),
        Answer::Response { text, is_refusal } => (text, false, is_refusal),
    };
    Counters::add(&shared.counters.refused, u64::from(is_refusal));
    match timeout(HEAD_TIMEOUT, stream.write_all(text.as_bytes())).await {
        Ok(Ok(())) if is_socket => client::serve(stream, shared).await,
        Ok(Ok(())) => drop(stream.shutdown().await),
        _ => Counters::add(&shared.counters.slow, 1),
    }
}

/// Reads a request up to the end of its head; `None` where the client has gone.
async fn request(stream: &mut TcpStream, shared: &Shared) -> Option<Answer> {
    let own = stream.local_addr().ok()?;
    let mut head = Vec::new();
    loop {
        let mut piece = [0; 1024];
        let room = piece.len().min(MAX_HEAD_BYTES - head.len());
        let count = stream.read(&mut piece[..room]).await.ok().filter(|count| *count > 0)?;
        head.extend_from_slice(&piece[..count]);
        if let Some(answer) = http::answer(&head, own, shared.name.as_deref()) {
            return Some(answer);
        }
    }
}
