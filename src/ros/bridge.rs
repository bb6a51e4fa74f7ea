//! A client of rosbridge: the same topics as JSON over a WebSocket (rosbridge protocol 2.0), where no ROS node can
//! be, or the other side has ROS 2.

use super::node::{LONGEST_PAUSE, PATIENCE, SHORTEST_PAUSE};
use super::report::Report;
use super::{Message, NodeStatus, NodeThread, Place, RosError, Topics};
use futures_util::stream::{SplitSink, SplitStream};
use futures_util::{SinkExt, StreamExt};
use serde::Deserialize;
use serde_json::{Value, json};
use std::cell::RefCell;
use std::collections::{BTreeMap, VecDeque};
use std::fmt;
use std::rc::Rc;
use std::str::FromStr;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;
use tokio::net::TcpStream;
use tokio::sync::Notify;
use tokio::time::{sleep, timeout};
use tokio_tungstenite::tungstenite::protocol::WebSocketConfig;
use tokio_tungstenite::tungstenite::{Bytes, Message as Packet};
use tokio_tungstenite::{WebSocketStream, client_async_with_config};

/// Messages that wait to be sent; of more, the oldest are dropped.
const QUEUE: usize = 1024;
/// Handed to the socket before it is flushed.
const AT_ONCE: usize = 64;
/// What comes in is at most so long, in bytes, in one piece or in fragments.
const LONGEST: usize = 4 << 20;
/// Messages whose fragments are waited for.
const MOST_FRAGMENTED: usize = 16;
const MOST_FRAGMENTS: usize = 4096;
/// A sign of life is asked for so often, and without one for the second time the other side is gone.
const PING: Duration = Duration::from_secs(5);
const SILENT: Duration = Duration::from_secs(15);

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

/// Takes what was published on a topic.
type Hear = Box<dyn Fn(Value)>;

/// The client, on its thread.
#[derive(Clone)]
pub struct Bridge(Rc<Inner>);

impl fmt::Debug for Bridge {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Bridge").field("uri", &self.0.uri.uri).finish_non_exhaustive()
    }
}

struct Inner {
    uri: BridgeUri,
    /// Types of the topics that are published, and of those that are listened to.
    published: RefCell<BTreeMap<String, &'static str>>,
    heard: RefCell<BTreeMap<String, (&'static str, Hear)>>,
    outbox: RefCell<VecDeque<String>>,
    is_changed: Notify,
    status: Arc<NodeStatus>,
}

/// Runs a client on a thread of its own until its work is done. The rosbridge need not be there yet.
///
/// # Errors
/// When the thread cannot be started.
pub fn run_bridge<F: Future<Output = ()>>(
    uri: BridgeUri,
    work: impl FnOnce(Bridge) -> F + Send + 'static,
) -> Result<NodeThread, RosError> {
    NodeThread::start("rosbridge", move |runtime, status| {
        let bridge = Bridge(Rc::new(Inner {
            uri,
            published: RefCell::default(),
            heard: RefCell::default(),
            outbox: RefCell::default(),
            is_changed: Notify::new(),
            status,
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
        let mut report = Report::new(format!("the rosbridge {}", self.0.uri.uri), &self.0.status);
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
        let BridgeUri { uri, place } = &self.0.uri;
        let told = |error: &dyn fmt::Display| error.to_string();
        let stream =
            TcpStream::connect((place.host.as_str(), place.port)).await.map_err(|error| told(&error))?;
        stream.set_nodelay(true).map_err(|error| told(&error))?;
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

    async fn send(&self, mut to: SplitSink<Socket, Packet>) -> String {
        loop {
            let batch: Vec<String> = {
                let mut outbox = self.0.outbox.borrow_mut();
                let count = outbox.len().min(AT_ONCE);
                outbox.drain(..count).collect()
            };
            let is_empty = batch.is_empty();
            for text in batch {
                if let Err(error) = to.feed(Packet::text(text)).await {
                    return error.to_string();
                }
            }
            if let Err(error) = to.flush().await {
                return error.to_string();
            }
            if is_empty
                && timeout(PING, self.0.is_changed.notified()).await.is_err()
                && let Err(error) = to.send(Packet::Ping(Bytes::new())).await
            {
                return error.to_string();
            }
        }
    }

    async fn listen(&self, mut from: SplitStream<Socket>) -> String {
        let mut fragments = Fragments::default();
        loop {
            let packet = match timeout(SILENT, from.next()).await {
                Err(_) => return format!("silent for {} s", SILENT.as_secs()),
                Ok(None) => return "it has hung up".to_owned(),
                Ok(Some(Err(error))) => return error.to_string(),
                Ok(Some(Ok(packet))) => packet,
            };
            match packet {
                Packet::Text(text) => self.take(&mut fragments, text.as_bytes()),
                Packet::Binary(bytes) => self.take(&mut fragments, &bytes),
                Packet::Close(_) => return "it has closed the connection".to_owned(),
                Packet::Ping(_) | Packet::Pong(_) | Packet::Frame(_) => {}
            }
        }
    }

    fn take(&self, fragments: &mut Fragments, bytes: &[u8]) {
        match serde_json::from_slice(bytes) {
            Ok(Said::Publish { topic, msg }) => {
                if let Some((_, hear)) = self.0.heard.borrow().get(&topic) {
                    hear(msg);
                }
            }
            Ok(Said::Fragment(fragment)) => {
                // Fragments of fragments are none.
                if let Some(whole) = fragments.take(fragment)
                    && let Ok(Said::Publish { topic, msg }) = serde_json::from_str(&whole)
                    && let Some((_, hear)) = self.0.heard.borrow().get(&topic)
                {
                    hear(msg);
                }
            }
            Ok(Said::Status { level, msg }) => {
                let msg: String = msg.chars().filter(|c| !c.is_control()).take(200).collect();
                if level == "error" || level == "warning" {
                    tracing::warn!("the rosbridge says: {msg}");
                } else {
                    tracing::debug!("the rosbridge says: {msg}");
                }
            }
            Ok(Said::Other) => {}
            Err(error) => tracing::debug!("the rosbridge sends what cannot be read: {error}"),
        }
    }
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
    Status {
        #[serde(default)]
        level: String,
        #[serde(default)]
        msg: String,
    },
    #[serde(other)]
    Other,
}

/// A part of a message that was too long for its sender.
#[derive(Deserialize)]
struct Fragment {
    id: Value,
    data: String,
    num: usize,
    total: usize,
}

/// Messages of which some parts have come.
#[derive(Default)]
struct Fragments {
    /// By id, the oldest first.
    begun: VecDeque<(String, Vec<Option<String>>)>,
}

impl Fragments {
    /// Takes a part in; gives the whole when it was the last one.
    fn take(&mut self, Fragment { id, data, num, total }: Fragment) -> Option<String> {
        let id = id.to_string();
        if total == 0 || total > MOST_FRAGMENTS || num >= total {
            return None;
        }
        let index = self.begun.iter().position(|(other, parts)| *other == id && parts.len() == total);
        let index = index.unwrap_or_else(|| {
            if self.begun.len() >= MOST_FRAGMENTED {
                self.begun.pop_front();
            }
            self.begun.push_back((id, Vec::new()));
            self.begun.len() - 1
        });
        let (_, parts) = self.begun.get_mut(index)?;
        parts.resize(total, None);
        parts[num] = Some(data);
        let length: usize = parts.iter().flatten().map(String::len).sum();
        if length > LONGEST {
            self.begun.remove(index);
            return None;
        }
        let whole: Option<String> = parts.iter().map(Option::as_deref).collect();
        whole.inspect(|_| drop(self.begun.remove(index)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn part(id: &str, data: &str, num: usize, total: usize) -> Fragment {
        Fragment { id: id.into(), data: data.to_owned(), num, total }
    }

    #[test]
    fn fragments_make_a_whole_in_any_order() {
        let mut fragments = Fragments::default();
        assert_eq!(fragments.take(part("a", "lo", 1, 2)), None);
        assert_eq!(fragments.take(part("b", "x", 0, 2)), None);
        assert_eq!(fragments.take(part("a", "hel", 0, 2)), Some("hello".to_owned()));
        assert_eq!(fragments.take(part("b", "y", 1, 2)), Some("xy".to_owned()));
        assert!(fragments.begun.is_empty());
    }

    #[test]
    fn fragments_that_never_end_take_no_more_than_so_much_room() {
        let mut fragments = Fragments::default();
        for k in 0..1000 {
            assert_eq!(fragments.take(part(&k.to_string(), "x", 0, 2)), None);
        }
        assert_eq!(fragments.begun.len(), MOST_FRAGMENTED);
        for (num, total) in [(0, 0), (2, 2), (0, usize::MAX)] {
            assert_eq!(fragments.take(part("wrong", "x", num, total)), None);
        }
        let long = "x".repeat(LONGEST / 2 + 1);
        assert_eq!(fragments.take(part("long", &long, 0, 3)), None);
        assert_eq!(fragments.take(part("long", &long, 1, 3)), None);
        assert_eq!(fragments.take(part("long", "", 2, 3)), None);
    }

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
