//! A client of rosbridge: the same topics as JSON over a WebSocket (rosbridge protocol 2.0), where no ROS node can
//! be, or the other side has ROS 2.

mod fragments;
mod status;

use super::node::{LONGEST_PAUSE, PATIENCE, SHORTEST_PAUSE};
use super::report::Report;
use super::{Message, NodeStatus, NodeThread, Place, RosError, Topics};
use fragments::{Fragment, Fragments};
use futures_util::stream::{SplitSink, SplitStream};
use futures_util::{SinkExt, StreamExt};
use serde::Deserialize;
use serde_json::{Value, json};
use status::{Level, Status, StatusLog};
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

/// Messages that wait to be sent; of more, the oldest are dropped.
const QUEUE: usize = 1024;
/// Handed to the socket before it is flushed.
const AT_ONCE: usize = 64;
/// What comes in is at most so long, in bytes, in one piece or in fragments.
const LONGEST: usize = 4 << 20;
/// Send buffer of the socket, bytes. Messages that a slow server has not read wait in the outbox, where the oldest are
/// dropped, and not in the kernel, where pings would wait behind them.
const SEND_BUFFER: usize = 128 << 10;

/// Address of a rosbridge.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BridgeUri {
    uri: String,
    place: Place,
}

impl BridgeUri {
    /// Where it usually is: on this machine.
    ///
    /// # Errors
    /// Never: it is an address.
    pub fn usual() -> Result<Self, RosError> {
        "ws://127.0.0.1:9090".parse()
    }
}

impl FromStr for BridgeUri {
    type Err = RosError;

    fn from_str(text: &str) -> Result<Self, RosError> {
        let wrong = || RosError::BridgeUri { uri: text.to_owned() };
        let rest = text.strip_prefix("ws://").ok_or_else(wrong)?;
        let host = rest.split('/').next().unwrap_or(rest);
        let place = Place::of_uri(&format!("http://{host}")).ok_or_else(wrong)?;
        Ok(Self { uri: text.to_owned(), place })
    }
}

/// How a lost server is detected. Pings have a schedule of their own: a server sends nothing to a client that only
/// publishes, so that nothing but their pongs shows that it is alive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Keepalive {
    /// Time from one ping to the next.
    pub ping_every: Duration,
    /// A server is lost when no frame of any kind has come from it for so long.
    pub timeout: Duration,
}

impl Default for Keepalive {
    /// Three pings without an answer.
    fn default() -> Self {
        Self { ping_every: Duration::from_secs(5), timeout: Duration::from_secs(15) }
    }
}

/// Where a rosbridge is, and how its loss is detected.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BridgeOptions {
    pub uri: BridgeUri,
    pub keepalive: Keepalive,
}

impl From<BridgeUri> for BridgeOptions {
    fn from(uri: BridgeUri) -> Self {
        Self { uri, keepalive: Keepalive::default() }
    }
}

/// Takes what was published on a topic.
type Hear = Box<dyn Fn(Value)>;

/// The client, on its thread.
#[derive(Clone)]
pub struct Bridge(Rc<Inner>);

impl fmt::Debug for Bridge {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Bridge").field("uri", &self.0.options.uri.uri).finish_non_exhaustive()
    }
}

struct Inner {
    options: BridgeOptions,
    /// Types of the topics that are published, and of those that are listened to.
    published: RefCell<BTreeMap<String, &'static str>>,
    heard: RefCell<BTreeMap<String, (&'static str, Hear)>>,
    outbox: RefCell<VecDeque<String>>,
    is_changed: Notify,
    status: Arc<NodeStatus>,
    /// Kept from one connection to the next, so that a server which refuses the same again is not quoted again.
    said: RefCell<StatusLog>,
}

/// Runs a client on a thread of its own until its work is done. The rosbridge need not be there yet.
///
/// # Errors
/// When the thread cannot be started.
pub fn run_bridge<F: Future<Output = ()>>(
    options: BridgeOptions,
    work: impl FnOnce(Bridge) -> F + Send + 'static,
) -> Result<NodeThread, RosError> {
    NodeThread::start("rosbridge", move |runtime, status| {
        let bridge = Bridge(Rc::new(Inner {
            options,
            published: RefCell::default(),
            heard: RefCell::default(),
            outbox: RefCell::default(),
            is_changed: Notify::new(),
            status,
            said: RefCell::default(),
        }));
        runtime.block_on(bridge.live(work(bridge.clone())));
    })
}

impl Topics for Bridge {
    fn advertise<M: Message>(&self, topic: &str) {
        let before = self.0.published.borrow_mut().insert(topic.to_owned(), M::TYPE.name);
        if before.is_none() {
            self.push(advertisement(topic, M::TYPE.name));
        }
    }

    fn retract(&self, topic: &str) {
        if self.0.published.borrow_mut().remove(topic).is_some() {
            self.push(json!({ "op": "unadvertise", "id": topic, "topic": topic }).to_string());
        }
    }

    fn publish<M: Message>(&self, topic: &str, message: impl FnOnce() -> M) {
        // Where nobody is connected nobody gets it.
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

    /// It does not tell who listens behind it.
    fn is_heard(&self, topic: &str) -> bool {
        self.0.published.borrow().contains_key(topic)
    }

    fn subscribe<M: Message>(&self, topic: &str, hear: impl Fn(M) + 'static) {
        let name = topic.to_owned();
        let hear = move |value| match serde_json::from_value(value) {
            Ok(message) => hear(message),
            Err(error) => tracing::debug!("{name}: a message is dropped: {error}"),
        };
        self.0.heard.borrow_mut().insert(topic.to_owned(), (M::TYPE.name, Box::new(hear)));
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
    fn push(&self, text: String) {
        let mut outbox = self.0.outbox.borrow_mut();
        if outbox.len() >= QUEUE {
            outbox.pop_front();
            self.0.status.slow.fetch_add(1, Ordering::Relaxed);
        }
        outbox.push_back(text);
        self.0.is_changed.notify_one();
    }

    async fn live(&self, work: impl Future<Output = ()>) {
        tokio::select! {
            () = work => {}
            () = self.keep() => {}
        }
    }

    /// Keeps a connection for as long as it lives.
    async fn keep(&self) {
        let mut report = Report::new(format!("the rosbridge {}", self.0.options.uri.uri), &self.0.status);
        let mut pause = SHORTEST_PAUSE;
        loop {
            let trouble = match timeout(PATIENCE, self.connect()).await {
                Err(_) => format!("no answer within {} s", PATIENCE.as_secs()),
                Ok(Err(why)) => why,
                Ok(Ok(socket)) => {
                    self.greet();
                    report.is_there();
                    pause = SHORTEST_PAUSE;
                    self.talk(socket).await
                }
            };
            report.is_away(&trouble);
            sleep(pause).await;
            pause = (2 * pause).min(LONGEST_PAUSE);
        }
    }

    async fn connect(&self) -> Result<Socket, String> {
        let BridgeUri { uri, place } = &self.0.options.uri;
        let told = |error: &dyn fmt::Display| error.to_string();
        let stream =
            TcpStream::connect((place.host.as_str(), place.port)).await.map_err(|error| told(&error))?;
        stream.set_nodelay(true).map_err(|error| told(&error))?;
        // One that keeps its own size works too, with later pings while the server is slow.
        let _ = socket2::SockRef::from(&stream).set_send_buffer_size(SEND_BUFFER);
        let config = WebSocketConfig::default().max_message_size(Some(LONGEST)).max_frame_size(Some(LONGEST));
        let found = client_async_with_config(uri.as_str(), stream, Some(config)).await;
        found.map(|(socket, _)| socket).map_err(|error| told(&error))
    }

    /// Tells a rosbridge that knows nothing yet what is published and listened to; what waited is old by now.
    fn greet(&self) {
        let mut outbox = self.0.outbox.borrow_mut();
        outbox.clear();
        outbox.extend(self.0.published.borrow().iter().map(|(topic, kind)| advertisement(topic, kind)));
        outbox.extend(self.0.heard.borrow().iter().map(|(topic, (kind, _))| subscription(topic, kind)));
        self.0.is_changed.notify_one();
    }

    /// Sends and hears until the connection ends; why it did.
    async fn talk(&self, socket: Socket) -> String {
        let (to, from) = socket.split();
        tokio::select! {
            why = self.send(to) => why,
            why = self.listen(from) => why,
        }
    }

    /// Sends messages as they come, and pings on their own schedule.
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

    /// The oldest messages that wait, once there are any.
    async fn next_texts(&self) -> Vec<String> {
        loop {
            {
                let mut outbox = self.0.outbox.borrow_mut();
                if !outbox.is_empty() {
                    let count = outbox.len().min(AT_ONCE);
                    return outbox.drain(..count).collect();
                }
            }
            self.0.is_changed.notified().await;
        }
    }

    async fn listen(&self, mut from: SplitStream<Socket>) -> String {
        let silence = self.0.options.keepalive.timeout;
        let mut fragments = Fragments::default();
        loop {
            let packet = match timeout(silence, from.next()).await {
                Err(_) => return format!("silent for {} s, pings included", silence.as_secs_f64()),
                Ok(None) => return "it has hung up".to_owned(),
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

    fn take(&self, fragments: &mut Fragments, bytes: &[u8]) {
        match serde_json::from_slice(bytes) {
            Ok(Said::Fragment(fragment)) => {
                if let Some(whole) = fragments.take(fragment) {
                    self.act(serde_json::from_str(&whole));
                }
            }
            said => self.act(said),
        }
    }

    /// Acts on a message that is whole.
    fn act(&self, said: serde_json::Result<Said>) {
        match said {
            Ok(Said::Publish { topic, msg }) => {
                if let Some((_, hear)) = self.0.heard.borrow().get(&topic) {
                    hear(msg);
                }
            }
            Ok(Said::Status(status)) => self.tell(&status),
            // Fragments of fragments are none.
            Ok(Said::Fragment(_) | Said::Other) => {}
            Err(error) => tracing::debug!("the rosbridge sends what cannot be read: {error}"),
        }
    }

    /// Tells the user what the server refuses.
    fn tell(&self, status: &Status) {
        let (uri, text) = (&self.0.options.uri.uri, status.text());
        if status.level() == Level::Other {
            return tracing::debug!("the rosbridge {uri} says: {text}");
        }
        let Some(text) = self.0.said.borrow_mut().admit(&text, Instant::now()) else { return };
        match status.level() {
            Level::Error => tracing::error!("the rosbridge {uri} reports an error: {text}"),
            _ => tracing::warn!("the rosbridge {uri} warns: {text}"),
        }
    }
}

/// Why a server says that it closes a connection.
fn closed(frame: Option<&CloseFrame>) -> String {
    let reason = frame.map(|frame| {
        let words: String = frame.reason.chars().filter(|c| !c.is_control()).take(200).collect();
        if words.is_empty() { format!(" ({})", frame.code) } else { format!(" ({}: {words})", frame.code) }
    });
    format!("it has closed the connection{}", reason.unwrap_or_default())
}

/// What a rosbridge says.
#[derive(Deserialize)]
#[serde(tag = "op", rename_all = "snake_case")]
enum Said {
    Publish {
        topic: String,
        msg: Value,
    },
    Fragment(Fragment),
    Status(Status),
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
