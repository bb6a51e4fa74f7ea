//! rosbridge client: topics as JSON over a WebSocket (rosbridge protocol 2.0, RFC 6455), for ROS 2 or across networks.

mod fragments;
#[cfg(feature = "fuzzing")]
pub(super) mod fuzzing;
mod status;

use super::node::{MAX_BACKOFF, MIN_BACKOFF, REQUEST_TIMEOUT};
use super::report::ReachabilityLog;
use super::{HostPort, NodeStatus, NodeThread, RosError, RosMessage, Topics};
use fragments::{Fragment, FragmentReassembly};
use futures_util::stream::{SplitSink, SplitStream};
use futures_util::{SinkExt, StreamExt};
use serde::Deserialize;
use serde_json::{Value, json};
use status::{BridgeStatus, Severity, StatusLog};
use std::cell::RefCell;
use std::collections::{BTreeMap, VecDeque};
use std::fmt;
use std::rc::Rc;
use std::str::FromStr;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};
use tokio::net::TcpStream;
use tokio::sync::Notify;
use tokio::time::{MissedTickBehavior, interval_at, sleep, timeout};
use tokio_tungstenite::tungstenite::protocol::{CloseFrame, WebSocketConfig};
use tokio_tungstenite::tungstenite::{Bytes, Message as Packet};
use tokio_tungstenite::{WebSocketStream, client_async_with_config};

/// Messages in the outbox; the oldest are dropped (load shedding).
const OUTBOX_CAPACITY: usize = 1024;
/// Messages that are written before a flush.
const BATCH_MESSAGES: usize = 64;
/// Longest received message, bytes, in one piece or in fragments.
const MAX_MESSAGE_BYTES: usize = 4 << 20;
/// Send buffer of the socket, bytes. Messages that a slow server has not read wait in the outbox, where the oldest are
/// dropped, and not in the kernel, where pings would wait behind them.
const SEND_BUFFER: usize = 128 << 10;

/// URI of a rosbridge server.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BridgeUri {
    uri: String,
    place: HostPort,
}

impl BridgeUri {
    /// The default URI, on this machine.
    ///
    /// # Errors
    /// Never, because the URI is valid.
    pub fn localhost() -> Result<Self, RosError> {
        "ws://127.0.0.1:9090".parse()
    }
}

impl FromStr for BridgeUri {
    type Err = RosError;

    fn from_str(text: &str) -> Result<Self, RosError> {
        let wrong = || RosError::BridgeUri { uri: text.to_owned() };
        let rest = text.strip_prefix("ws://").ok_or_else(wrong)?;
        let host = rest.split('/').next().unwrap_or(rest);
        let place = HostPort::of_uri(&format!("http://{host}")).ok_or_else(wrong)?;
        Ok(Self { uri: text.to_owned(), place })
    }
}

/// How a lost server is detected. Pings have a schedule of their own: a server sends nothing to a client that only
/// publishes, so that nothing but their pongs shows that it is alive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Keepalive {
    /// Time from one ping to the next.
    pub ping_every: Duration,
    /// A server that has sent no frame of any kind for this time counts as lost.
    pub timeout: Duration,
}

impl Default for Keepalive {
    /// Three pings without an answer.
    fn default() -> Self {
        Self { ping_every: Duration::from_secs(5), timeout: Duration::from_secs(15) }
    }
}

/// Settings of a rosbridge client.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BridgeOptions {
    /// Server to connect to.
    pub uri: BridgeUri,
    /// Ping interval and timeout.
    pub keepalive: Keepalive,
}

impl From<BridgeUri> for BridgeOptions {
    fn from(uri: BridgeUri) -> Self {
        Self { uri, keepalive: Keepalive::default() }
    }
}

/// Handler of the messages of a topic.
type MessageHandler = Box<dyn Fn(Value)>;

/// rosbridge client, a handle on its own thread.
#[derive(Clone)]
pub struct Bridge(Rc<BridgeState>);

impl fmt::Debug for Bridge {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Bridge").field("uri", &self.0.options.uri.uri).finish_non_exhaustive()
    }
}

struct BridgeState {
    options: BridgeOptions,
    /// Types of the published topics; types and handlers of the subscribed ones.
    published: RefCell<BTreeMap<String, &'static str>>,
    subscribed: RefCell<BTreeMap<String, (&'static str, MessageHandler)>>,
    outbox: RefCell<VecDeque<String>>,
    is_changed: Notify,
    status: Arc<NodeStatus>,
    /// Kept from one connection to the next, so that a server which refuses the same again is not quoted again.
    status_log: RefCell<StatusLog>,
}

/// Runs a client on a thread of its own until its work is done. The server may start later.
///
/// # Errors
/// When the thread cannot be started.
pub fn run_bridge<F: Future<Output = ()>>(
    options: BridgeOptions,
    work: impl FnOnce(Bridge) -> F + Send + 'static,
) -> Result<NodeThread, RosError> {
    NodeThread::start("rosbridge", move |runtime, status| {
        let bridge = Bridge::new(options, status);
        runtime.block_on(bridge.run(work(bridge.clone())));
    })
}

impl Topics for Bridge {
    fn advertise<M: RosMessage>(&self, topic: &str) {
        let before = self.0.published.borrow_mut().insert(topic.to_owned(), M::TYPE.name);
        if before.is_none() {
            self.push(advertisement(topic, M::TYPE.name));
        }
    }

    fn unadvertise(&self, topic: &str) {
        if self.0.published.borrow_mut().remove(topic).is_some() {
            self.push(json!({ "op": "unadvertise", "id": topic, "topic": topic }).to_string());
        }
    }

    fn publish<M: RosMessage>(&self, topic: &str, message: impl FnOnce() -> M) {
        // Without a connection the message is dropped.
        if !self.0.status.is_registered.load(Ordering::Relaxed)
            || !self.0.published.borrow().contains_key(topic)
        {
            return;
        }
        match serde_json::to_value(message()) {
            Ok(message) => {
                self.push(
                    json!({ "op": "publish", "id": topic, "topic": topic, "msg": message }).to_string(),
                );
            }
            Err(error) => tracing::debug!("{topic}: not published: {error}"),
        }
    }

    /// rosbridge does not report subscribers: every advertised topic may have some.
    fn has_subscribers(&self, topic: &str) -> bool {
        self.0.published.borrow().contains_key(topic)
    }

    fn subscribe<M: RosMessage>(&self, topic: &str, on_message: impl Fn(M) + 'static) {
        let name = topic.to_owned();
        let handler = move |value| match serde_json::from_value(value) {
            Ok(message) => on_message(message),
            Err(error) => tracing::debug!("{name}: a message is dropped: {error}"),
        };
        self.0.subscribed.borrow_mut().insert(topic.to_owned(), (M::TYPE.name, Box::new(handler)));
        self.push(subscription(topic, M::TYPE.name));
    }
}

fn advertisement(topic: &str, kind: &str) -> String {
    json!({ "op": "advertise", "id": topic, "topic": topic, "type": kind }).to_string()
}

fn subscription(topic: &str, kind: &str) -> String {
    json!({ "op": "subscribe", "id": topic, "topic": topic, "type": kind }).to_string()
}

type Socket = WebSocketStream<TcpStream>;

impl Bridge {
    fn new(options: BridgeOptions, status: Arc<NodeStatus>) -> Self {
        Self(Rc::new(BridgeState {
            options,
            published: RefCell::default(),
            subscribed: RefCell::default(),
            outbox: RefCell::default(),
            is_changed: Notify::new(),
            status,
            status_log: RefCell::default(),
        }))
    }

    fn push(&self, text: String) {
        let mut outbox = self.0.outbox.borrow_mut();
        if outbox.len() >= OUTBOX_CAPACITY {
            outbox.pop_front();
            self.0.status.slow.fetch_add(1, Ordering::Relaxed);
        }
        outbox.push_back(text);
        self.0.is_changed.notify_one();
    }

    async fn run(&self, work: impl Future<Output = ()>) {
        tokio::select! {
            () = work => {}
            () = self.stay_connected() => {}
        }
    }

    /// Stays connected, with exponential backoff after errors.
    async fn stay_connected(&self) {
        let mut log =
            ReachabilityLog::new(format!("the rosbridge {}", self.0.options.uri.uri), &self.0.status);
        let mut backoff = MIN_BACKOFF;
        loop {
            let error = match timeout(REQUEST_TIMEOUT, self.connect()).await {
                Err(_) => format!("no answer within {} s", REQUEST_TIMEOUT.as_secs()),
                Ok(Err(why)) => why,
                Ok(Ok(socket)) => {
                    self.readvertise();
                    log.reachable();
                    backoff = MIN_BACKOFF;
                    self.exchange(socket).await
                }
            };
            log.unreachable(&error);
            sleep(backoff).await;
            backoff = (2 * backoff).min(MAX_BACKOFF);
        }
    }

    async fn connect(&self) -> Result<Socket, String> {
        let BridgeUri { uri, place } = &self.0.options.uri;
        let told = |error: &dyn fmt::Display| error.to_string();
        let stream =
            TcpStream::connect((place.host.as_str(), place.port)).await.map_err(|error| told(&error))?;
        stream.set_nodelay(true).map_err(|error| told(&error))?;
        // A larger buffer works too, but delays pings while the server is slow.
        let _ = socket2::SockRef::from(&stream).set_send_buffer_size(SEND_BUFFER);
        let config = WebSocketConfig::default()
            .max_message_size(Some(MAX_MESSAGE_BYTES))
            .max_frame_size(Some(MAX_MESSAGE_BYTES));
        let found = client_async_with_config(uri.as_str(), stream, Some(config)).await;
        found.map(|(socket, _)| socket).map_err(|error| told(&error))
    }

    /// Advertises and subscribes all topics on a new connection, and drops the waiting messages, which are stale.
    fn readvertise(&self) {
        let mut outbox = self.0.outbox.borrow_mut();
        outbox.clear();
        outbox.extend(self.0.published.borrow().iter().map(|(topic, kind)| advertisement(topic, kind)));
        outbox.extend(self.0.subscribed.borrow().iter().map(|(topic, (kind, _))| subscription(topic, kind)));
        self.0.is_changed.notify_one();
    }

    /// Sends and receives until the connection ends; returns the reason.
    async fn exchange(&self, socket: Socket) -> String {
        let (to, from) = socket.split();
        tokio::select! {
            why = self.send(to) => why,
            why = self.receive(from) => why,
        }
    }

    /// Sends messages as they come, and keep-alive pings on their own schedule.
    async fn send(&self, mut to: SplitSink<Socket, Packet>) -> String {
        let every = self.0.options.keepalive.ping_every;
        let mut pings = interval_at(tokio::time::Instant::now() + every, every);
        pings.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            let packets: Vec<Packet> = tokio::select! {
                biased;
                _ = pings.tick() => vec![Packet::Ping(Bytes::new())],
                texts = self.next_texts() => texts.into_iter().map(Packet::text).collect(),
            };
            for packet in packets {
                if let Err(error) = to.feed(packet).await {
                    return error.to_string();
                }
            }
            if let Err(error) = to.flush().await {
                return error.to_string();
            }
        }
    }

    /// Waits for messages and takes the oldest ones.
    async fn next_texts(&self) -> Vec<String> {
        loop {
            {
                let mut outbox = self.0.outbox.borrow_mut();
                if !outbox.is_empty() {
                    let count = outbox.len().min(BATCH_MESSAGES);
                    return outbox.drain(..count).collect();
                }
            }
            self.0.is_changed.notified().await;
        }
    }

    async fn receive(&self, mut from: SplitStream<Socket>) -> String {
        let keepalive_timeout = self.0.options.keepalive.timeout;
        let mut fragments = FragmentReassembly::default();
        loop {
            let packet = match timeout(keepalive_timeout, from.next()).await {
                Err(_) => return format!("no message or pong for {} s", keepalive_timeout.as_secs_f64()),
                Ok(None) => return "it ended the connection".to_owned(),
                Ok(Some(Err(error))) => return error.to_string(),
                Ok(Some(Ok(packet))) => packet,
            };
            match packet {
                Packet::Text(text) => self.take(&mut fragments, text.as_bytes()),
                Packet::Binary(bytes) => self.take(&mut fragments, &bytes),
                Packet::Close(why) => return closed(why.as_ref()),
                // The library answers a ping when the next frame is asked for, which is at once.
                Packet::Ping(_) | Packet::Pong(_) | Packet::Frame(_) => {}
            }
        }
    }

    fn take(&self, fragments: &mut FragmentReassembly, bytes: &[u8]) {
        match serde_json::from_slice(bytes) {
            Ok(ServerOp::Fragment(fragment)) => {
                if let Some(whole) = fragments.take(fragment) {
                    self.dispatch(serde_json::from_str(&whole));
                }
            }
            operation => self.dispatch(operation),
        }
    }

    /// Dispatches a complete message.
    fn dispatch(&self, operation: serde_json::Result<ServerOp>) {
        match operation {
            Ok(ServerOp::Publish { topic, msg }) => {
                if let Some((_, handler)) = self.0.subscribed.borrow().get(&topic) {
                    handler(msg);
                }
            }
            Ok(ServerOp::Status(status)) => self.report_status(&status),
            // Fragments of fragments are invalid.
            Ok(ServerOp::Fragment(_) | ServerOp::Other) => {}
            Err(error) => tracing::debug!("a message of the rosbridge is dropped: {error}"),
        }
    }

    /// Logs a status message of the server.
    fn report_status(&self, status: &BridgeStatus) {
        let (uri, text) = (&self.0.options.uri.uri, status.text());
        if status.level() == Severity::Other {
            return tracing::debug!("the rosbridge {uri} says: {text}");
        }
        let Some(text) = self.0.status_log.borrow_mut().admit(&text, Instant::now()) else { return };
        match status.level() {
            Severity::Error => tracing::error!("the rosbridge {uri} reports an error: {text}"),
            _ => tracing::warn!("the rosbridge {uri} warns: {text}"),
        }
    }
}

/// Reason of a close frame.
fn closed(frame: Option<&CloseFrame>) -> String {
    let reason = frame.map(|frame| {
        let words: String = frame.reason.chars().filter(|c| !c.is_control()).take(200).collect();
        if words.is_empty() { format!(" ({})", frame.code) } else { format!(" ({}: {words})", frame.code) }
    });
    format!("it closed the connection{}", reason.unwrap_or_default())
}

/// Operation of a rosbridge server.
#[derive(Deserialize)]
#[serde(tag = "op", rename_all = "snake_case")]
enum ServerOp {
    Publish {
        topic: String,
        msg: Value,
    },
    Fragment(Fragment),
    Status(BridgeStatus),
    #[serde(other)]
    Other,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_those_of_web_sockets() {
        for good in ["ws://127.0.0.1:9090", "ws://lab:9090/", "ws://[::1]:9090/path"] {
            assert!(good.parse::<BridgeUri>().is_ok(), "{good}");
        }
        for wrong in ["", "127.0.0.1:9090", "http://lab:9090", "ws://lab", "wss://lab:9090"] {
            let told = wrong.parse::<BridgeUri>().unwrap_err().to_string();
            assert!(told.contains("write it as ws://127.0.0.1:9090"), "{told}");
        }
    }
}
