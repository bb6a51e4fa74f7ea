//! The server: what its connections share, and what it publishes.

use crate::channel::CityChannels;
use crate::client;
use crate::control::Control;
use crate::counters::{Counters, FoxgloveCounts};
use crate::end::{FoxgloveEnd, ToldReceiver};
use crate::handshake::{self, Access};
use crate::hub::{Hub, Publication};
use crate::metrics;
use crate::protocol::MAX_MESSAGE_BYTES;
use crate::publisher::Publisher;
use city3d_logbook::record::message::nanoseconds;
use city3d_logbook::record::{LogOrigin, LogTopic};
use city3d_network::listener::{BoundListener, ListenError, Listening, Patience, count};
use city3d_session::{OrderSender, PublishedState, RunPhase, Token};
use city3d_simulation::scenario::Experiment;
use std::io;
use std::net::SocketAddr;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, SystemTime, UNIX_EPOCH};
use tokio::net::TcpStream;
use tokio::sync::mpsc;
use tokio::time::{MissedTickBehavior, interval, sleep, timeout};
use tokio_tungstenite::accept_hdr_async_with_config;
use tokio_tungstenite::tungstenite::handshake::server::{Request, Response};
use tokio_tungstenite::tungstenite::protocol::WebSocketConfig;

/// Connections at once, at most; more are refused.
const MAX_CONNECTIONS: usize = 32;
/// Interval at which the latest state is looked at: for metrics, and for a city that stands.
const LOOK_INTERVAL: Duration = Duration::from_millis(100);
/// Looks from one message of metrics to the next.
const METRICS_EVERY: u32 = 2;
/// Subscriptions come one behind another, so that what stands is told a little later.
const SUBSCRIBED_PAUSE: Duration = Duration::from_millis(10);

/// How a city is offered to Foxglove.
#[derive(Debug)]
pub struct FoxgloveOptions {
    /// Address and port to listen on.
    pub address: String,
    /// Who knows it gives orders.
    pub token: Token,
    /// Pages that may connect besides those of this machine and Foxglove's own, such as `https://lab.example`.
    pub origins: Vec<String>,
    /// The experiment that runs.
    pub experiment: Arc<Experiment>,
    /// What the log of this city would be.
    pub origin: LogOrigin,
    /// Snapshots, scenes and transforms per simulated second.
    pub snapshot_hz: u32,
    /// Gives the session its orders.
    pub orders: OrderSender,
    /// How long the server waits for a client; [`PATIENCE`](crate::PATIENCE) is usual.
    pub patience: Patience,
}

/// Why a city cannot be offered.
#[derive(Debug, thiserror::Error)]
pub enum FoxgloveError {
    /// The address is in use, or is none of this machine.
    #[error(
        "Foxglove cannot be served at {address}: {error}; give another one, such as --foxglove=127.0.0.1:8766"
    )]
    Address {
        /// The address that was asked for.
        address: String,
        /// What the system says.
        error: io::Error,
    },
    /// The operating system refuses a thread or a runtime.
    #[error("no thread for Foxglove can be started: {0}")]
    Thread(io::Error),
}

impl From<ListenError> for FoxgloveError {
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
    token: Token,
    origins: Vec<String>,
    /// Tells clients that have been connected before whether it is the same city.
    pub session: String,
    pub hub: Arc<Hub>,
    pub control: Control,
    pub counters: Arc<Counters>,
    pub patience: Patience,
    next_client: AtomicU64,
}

impl Shared {
    pub(crate) fn next_client(&self) -> u64 {
        self.next_client.fetch_add(1, Ordering::Relaxed)
    }
}

/// A server on a thread of its own. Dropping it ends the thread and disconnects all clients.
#[derive(Debug)]
pub struct FoxgloveServer {
    listening: Listening,
    shared: Arc<Shared>,
    state: Arc<OnceLock<PublishedState>>,
}

impl FoxgloveServer {
    /// Binds the address and starts the thread; the end is that of the session. There are no metrics, and no answers to
    /// orders, before [`Self::watch`].
    ///
    /// # Errors
    /// When the address cannot be bound, or the system refuses the thread.
    pub fn start(options: FoxgloveOptions) -> Result<(Self, FoxgloveEnd), FoxgloveError> {
        let FoxgloveOptions { address, token, origins, experiment, origin, snapshot_hz, orders, patience } =
            options;
        let listener = BoundListener::bind(&address)?;
        let (counters, state) = (Arc::<Counters>::default(), Arc::<OnceLock<_>>::default());
        let has_signals = !experiment.lab_map.signals.is_empty();
        let channels = CityChannels::new(&LogTopic::of_log(&experiment, origin), has_signals);
        let (hub, elsewhere) = Hub::new(channels, Arc::clone(&counters));
        let hub = Arc::new(hub);
        let snapshot_ticks = u64::from((experiment.rates.physics_hz / snapshot_hz.max(1)).max(1));
        let (end, told) = FoxgloveEnd::new(Arc::clone(&hub), Arc::clone(&counters), snapshot_ticks);
        let shared = Arc::new(Shared {
            token,
            origins,
            session: SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_millis().to_string(),
            hub: Arc::clone(&hub),
            control: Control::new(orders, Arc::clone(&state), &experiment.name, Arc::clone(&counters.peers)),
            counters: Arc::clone(&counters),
            patience,
            next_client: AtomicU64::new(1),
        });
        let publisher = Publisher::new(hub, experiment);
        let sources = Sources { told, elsewhere };
        let (of_clients, of_publisher) = (Arc::clone(&shared), Arc::clone(&shared));
        let serve = move |stream| {
            let shared = Arc::clone(&of_clients);
            async move { connection(stream, &shared).await }
        };
        let beside = async move { publish(publisher, sources, &of_publisher).await };
        let listening =
            listener.listen(("foxglove", MAX_CONNECTIONS), Arc::clone(&counters.peers), serve, beside)?;
        Ok((Self { listening, shared, state }, end))
    }

    /// Shows the states that a session publishes.
    pub fn watch(&self, state: PublishedState) {
        // A server has one session.
        let _ = self.state.set(state);
    }

    /// The address that it listens on.
    pub fn address(&self) -> SocketAddr {
        self.listening.address()
    }

    /// The address for who may give orders; without its token it is that for who may watch.
    pub fn url(&self) -> String {
        let shown = self.listening.reachable();
        format!("ws://{shown}/?token={}", self.shared.token.text())
    }

    /// What it has counted.
    pub fn counts(&self) -> FoxgloveCounts {
        self.shared.counters.counts()
    }
}

/// What the server publishes besides the latest state.
struct Sources {
    told: ToldReceiver,
    elsewhere: mpsc::Receiver<Publication>,
}

async fn connection(stream: TcpStream, shared: &Arc<Shared>) {
    let config = WebSocketConfig::default()
        .max_message_size(Some(MAX_MESSAGE_BYTES))
        .max_frame_size(Some(MAX_MESSAGE_BYTES));
    let mut access = Access::Watch;
    #[allow(clippy::result_large_err, reason = "tungstenite's own type")]
    let admit = |request: &Request, response: Response| {
        let (response, admitted) = handshake::admit(request, response, (&shared.token, &shared.origins))?;
        access = admitted;
        Ok(response)
    };
    let accepted = accept_hdr_async_with_config(stream, admit, Some(config));
    match timeout(shared.patience.request, accepted).await {
        Ok(Ok(socket)) => client::serve(socket, access, shared).await,
        Ok(Err(_)) | Err(_) => count(&shared.counters.peers.refused, 1),
    }
}

/// Publishes moments as they come, and what the latest state tells.
async fn publish(mut publisher: Publisher, sources: Sources, shared: &Shared) {
    let Sources { mut told, mut elsewhere } = sources;
    let mut looks = interval(LOOK_INTERVAL);
    looks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let (hub, mut shown, mut looked, mut has_ended) = (&shared.hub, None, 0_u32, false);
    loop {
        tokio::select! {
            biased;
            moment = told.next(), if !has_ended => match moment {
                Some(moment) => {
                    publisher.publish(&moment);
                    told.recycle(moment);
                    // One task must not keep the others from the sockets.
                    tokio::task::yield_now().await;
                }
                None => has_ended = true,
            },
            Some((channel, stamp_ns, payload)) = elsewhere.recv() => hub.publish(&channel, stamp_ns, payload),
            () = hub.subscribed.notified() => {
                sleep(SUBSCRIBED_PAUSE).await;
                shown = None;
                publisher.publish_constant();
                publish_standing(&mut publisher, shared, &mut shown);
            }
            _ = looks.tick() => {
                looked = looked.wrapping_add(1);
                publish_standing(&mut publisher, shared, &mut shown);
                if looked.is_multiple_of(METRICS_EVERY) {
                    publish_metrics(shared);
                }
            }
        }
    }
}

/// Publishes a city that stands, once: no moments come from it.
fn publish_standing(publisher: &mut Publisher, shared: &Shared, shown: &mut Option<(u32, u64)>) {
    let Some(state) = shared.control.state() else { return };
    shared.hub.follow(&state.now.roster);
    let now = (state.run, state.now.tick);
    if state.phase == RunPhase::Running || *shown == Some(now) || !shared.hub.is_wanted() {
        return;
    }
    *shown = Some(now);
    publisher.publish_standing(&state.now);
}

fn publish_metrics(shared: &Shared) {
    let channel = &shared.hub.city.metrics;
    if channel.is_wanted()
        && let Some(state) = shared.control.state()
    {
        let clients = shared.counters.counts().peers.connected;
        let message = metrics::metrics(&state, clients).to_string();
        shared.hub.publish(channel, nanoseconds(state.now.time_s), message);
    }
}
