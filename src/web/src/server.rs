//! The server: what its connections share, and the end of the session that counts for it.

use crate::client::{self, PATIENCE};
use crate::control::{Control, PageOrders};
use crate::counters::{Counters, WebCounts};
use crate::feed::{self, Feed, Told};
use crate::http::{self, Answer, MAX_HEAD_BYTES};
use crate::pictures::Pictures;
use city3d_network::listener::{BoundListener, ListenError, Listening, Patience, count};
use city3d_session::{End, EndHealth, Moment, PublishedState, Token};
use city3d_simulation::scenario::Experiment;
use std::io;
use std::net::SocketAddr;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::sync::watch;
use tokio::time::{MissedTickBehavior, interval, timeout};

/// Connections at once, at most; more are refused.
const MAX_CONNECTIONS: usize = 64;
/// Interval at which the latest state is looked at: as often as a screen needs it.
const STATE_INTERVAL: Duration = Duration::from_millis(40);

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
    /// How long the server waits for a page.
    pub patience: Patience,
}

impl WebOptions {
    /// Usual options.
    pub fn new(address: String, token: Token, experiment: Arc<Experiment>, orders: PageOrders) -> Self {
        Self { address, token, experiment, orders, patience: PATIENCE }
    }
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

impl From<ListenError> for WebError {
    fn from(error: ListenError) -> Self {
        match error {
            ListenError::Address { address, error } => Self::Address { address, error },
            ListenError::Thread(error) => Self::Thread(error),
        }
    }
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
    pub patience: Patience,
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
    listening: Listening,
    shared: Arc<Shared>,
}

impl WebServer {
    /// Binds the address and starts the thread. There is nothing to see before [`Self::watch`].
    ///
    /// # Errors
    /// When the address cannot be bound, or the system refuses the thread.
    pub fn start(options: WebOptions) -> Result<Self, WebError> {
        let WebOptions { address, token, experiment, orders, patience } = options;
        let listener = BoundListener::bind(&address)?;
        let (counters, state) = (Arc::<Counters>::default(), Arc::<OnceLock<_>>::default());
        let shared = Arc::new(Shared {
            token,
            control: Control::new(orders, Arc::clone(&counters.peers)),
            counters: Arc::clone(&counters),
            map: feed::map(&experiment).into(),
            told: watch::Sender::new(None),
            pictures: Pictures::new(Arc::clone(&state)),
            patience,
            state,
            name: address.rsplit_once(':').map(|(name, _)| name.to_owned()).filter(|name| !name.is_empty()),
            next_page: AtomicU64::new(1),
        });
        let (of_pages, of_teller) = (Arc::clone(&shared), Arc::clone(&shared));
        let serve = move |stream| {
            let shared = Arc::clone(&of_pages);
            async move { connection(stream, &shared).await }
        };
        let beside = async move { tell(&of_teller).await };
        let listening =
            listener.listen(("web", MAX_CONNECTIONS), Arc::clone(&counters.peers), serve, beside)?;
        Ok(Self { listening, shared })
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
        self.listening.address()
    }

    /// The address for who may give orders. What follows the `#` stays in the browser.
    pub fn url(&self) -> String {
        let shown = self.listening.reachable();
        format!("http://{shown}/#{}", self.shared.token.text())
    }

    /// What it has counted.
    pub fn counts(&self) -> WebCounts {
        self.shared.counters.counts()
    }
}

impl Drop for WebServer {
    fn drop(&mut self) {
        self.shared.pictures.stop();
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
        EndHealth { delivered: counts.peers.messages, dropped: counts.peers.dropped(), failure: None }
    }
}

/// Makes the texts of the latest state while somebody looks, each once for all pages.
async fn tell(shared: &Shared) {
    let mut looks = interval(STATE_INTERVAL);
    looks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let (mut feed, mut last) = (Feed::default(), None);
    loop {
        looks.tick().await;
        shared.control.catch_up();
        let pages = shared.counters.counts().peers.connected;
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
    let (counters, patience) = (&shared.counters.peers, shared.patience);
    let answer = match timeout(patience.request, request(&mut stream, shared)).await {
        Ok(Some(answer)) => answer,
        // Whoever connects and says nothing is a browser that expects to ask later, or no browser.
        Ok(None) => return,
        Err(_) => http::refusal("408 Request Timeout"),
    };
    let (text, is_socket, is_refusal) = match answer {
        Answer::Upgrade(text) => (text, true, false),
        Answer::Response { text, is_refusal } => (text, false, is_refusal),
    };
    count(&counters.refused, u64::from(is_refusal));
    match timeout(patience.send, stream.write_all(text.as_bytes())).await {
        Ok(Ok(())) if is_socket => client::serve(stream, shared).await,
        Ok(Ok(())) => drop(stream.shutdown().await),
        _ => count(&counters.slow, 1),
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
