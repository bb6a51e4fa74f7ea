//! Subscribing end of TCPROS: connects to the publishers of a topic and reads their messages.

use super::xmlrpc::XmlRpcValue;
use super::{HostPort, MessageType, RosNode, header, http};
use std::cell::{Cell, RefCell};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::rc::Rc;
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::time::{sleep, timeout};

use super::node::{MAX_BACKOFF, MIN_BACKOFF, REQUEST_TIMEOUT};

/// Most publishers of a topic that are connected.
const MAX_PUBLISHERS: usize = 32;
/// Longest message, bytes.
const MAX_MESSAGE_BYTES: usize = 1 << 20;
/// Interval of TCP keep-alive probes, which detect a publisher whose machine is gone.
const KEEPALIVE_INTERVAL: Duration = Duration::from_secs(5);

/// Handler of the bytes of each message.
pub(super) type Deliver = Box<dyn Fn(&[u8])>;

/// A subscribed topic.
pub(super) struct Subscription {
    pub topic: String,
    /// Message type that publishers must agree on.
    pub kind: MessageType,
    deliver: Deliver,
    /// URIs of its publishers, as last reported by the master.
    publishers: RefCell<BTreeSet<String>>,
    /// Links to publishers, by URI.
    pub links: RefCell<BTreeMap<String, Rc<PublisherLink>>>,
}

/// Link to a publisher.
#[derive(Debug)]
pub(super) struct PublisherLink {
    /// Number of the connection in the Slave API, unique in the node.
    pub id: i32,
    /// The handshake is done and the connection is open.
    pub is_connected: Cell<bool>,
    /// Messages received so far, over all connections to this publisher.
    pub received: Cell<u64>,
    /// Bytes of these messages with their length prefixes.
    pub received_bytes: Cell<u64>,
}

impl fmt::Debug for Subscription {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Subscription").field("topic", &self.topic).finish_non_exhaustive()
    }
}

impl Subscription {
    pub(super) fn new(topic: &str, kind: MessageType, deliver: Deliver) -> Self {
        Self {
            topic: topic.to_owned(),
            kind,
            deliver,
            publishers: RefCell::default(),
            links: RefCell::default(),
        }
    }

    /// Updates the publishers of the topic. Open connections stay, because a restarted master has forgotten publishers.
    pub(super) fn update(self: &Rc<Self>, node: &RosNode, publishers: impl Iterator<Item = String>) {
        self.publishers.replace(publishers.take(MAX_PUBLISHERS).collect());
        for uri in self.publishers.borrow().iter() {
            let mut links = self.links.borrow_mut();
            if links.contains_key(uri) || links.len() >= MAX_PUBLISHERS {
                continue;
            }
            let link = Rc::new(PublisherLink {
                id: node.next_id(),
                is_connected: Cell::new(false),
                received: Cell::new(0),
                received_bytes: Cell::new(0),
            });
            links.insert(uri.clone(), Rc::clone(&link));
            tokio::task::spawn_local(follow(node.clone(), Rc::clone(self), uri.clone(), link));
        }
    }
}

/// Connects to a publisher, and again with backoff, while the master lists it.
async fn follow(node: RosNode, subscription: Rc<Subscription>, uri: String, link: Rc<PublisherLink>) {
    let mut backoff = MIN_BACKOFF;
    while subscription.publishers.borrow().contains(&uri) && !node.is_shut_down() {
        let before = link.received.get();
        if let Err(why) = listen(&node, &subscription, &uri, &link).await {
            tracing::debug!("{} is not received from {uri}: {why}", subscription.topic);
        }
        link.is_connected.set(false);
        let has_heard = link.received.get() > before;
        backoff = if has_heard { MIN_BACKOFF } else { (2 * backoff).min(MAX_BACKOFF) };
        sleep(backoff).await;
    }
    subscription.links.borrow_mut().remove(&uri);
}

async fn listen(
    node: &RosNode,
    subscription: &Subscription,
    uri: &str,
    link: &PublisherLink,
) -> Result<(), String> {
    let place = HostPort::of_uri(uri).ok_or("not the address of a node")?;
    let mut stream = timeout(REQUEST_TIMEOUT, connect(node, subscription, &place))
        .await
        .map_err(|_| format!("no answer within {} s", REQUEST_TIMEOUT.as_secs()))??;
    link.is_connected.set(true);
    let mut bytes = Vec::new();
    while !node.is_shut_down() {
        let length = stream.read_u32_le().await.map_err(|error| error.to_string())? as usize;
        if length > MAX_MESSAGE_BYTES {
            return Err(format!("a message of {length} bytes, at most {MAX_MESSAGE_BYTES} are read"));
        }
        bytes.resize(length, 0);
        stream.read_exact(&mut bytes).await.map_err(|error| error.to_string())?;
        link.received.set(link.received.get() + 1);
        link.received_bytes.set(link.received_bytes.get() + 4 + length as u64);
        (subscription.deliver)(&bytes);
    }
    Ok(())
}

/// Requests a topic from a node, and makes the TCPROS handshake.
async fn connect(node: &RosNode, subscription: &Subscription, place: &HostPort) -> Result<TcpStream, String> {
    let Subscription { topic, kind, .. } = subscription;
    let protocols = XmlRpcValue::List(vec![XmlRpcValue::List(vec!["TCPROS".into()])]);
    let arguments = [node.name().into(), topic.as_str().into(), protocols];
    let answer = http::call(place, "requestTopic", &arguments).await.map_err(|error| error.to_string())?;
    let (host, port) = tcpros_of(&answer).ok_or("it does not offer TCPROS")?;
    let mut stream =
        TcpStream::connect((host, port)).await.map_err(|error| format!("{host}:{port}: {error}"))?;
    // Errors mean a closed socket.
    let _ = stream.set_nodelay(true);
    let keepalive =
        socket2::TcpKeepalive::new().with_time(KEEPALIVE_INTERVAL).with_interval(KEEPALIVE_INTERVAL);
    let _ = socket2::SockRef::from(&stream).set_tcp_keepalive(&keepalive);
    let fields = [
        ("callerid", node.name()),
        ("md5sum", kind.md5sum),
        ("message_definition", kind.definition),
        ("tcp_nodelay", "1"),
        ("topic", topic),
        ("type", kind.name),
    ];
    stream.write_all(&header::encode(&fields)).await.map_err(|error| error.to_string())?;
    let answer = header::read(&mut stream).await?;
    if let Some(why) = answer.get("error") {
        return Err(why.clone());
    }
    match answer.get("md5sum") {
        Some(md5sum) if md5sum == kind.md5sum || md5sum == "*" => Ok(stream),
        found => Err(format!("md5sum {found:?}, {} has {}", kind.name, kind.md5sum)),
    }
}

/// Host and port of the answer `[1, "ready", ["TCPROS", host, port]]`.
fn tcpros_of(answer: &XmlRpcValue) -> Option<(&str, u16)> {
    let [XmlRpcValue::Int(1), _, XmlRpcValue::List(protocol)] = answer.list()? else { return None };
    let [name, host, port, ..] = &protocol[..] else { return None };
    (name.text() == Some("TCPROS")).then_some((host.text()?, u16::try_from(port.int()?).ok()?))
}
