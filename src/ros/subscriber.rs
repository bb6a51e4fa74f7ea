//! The subscribing end of TCPROS: finds the publishers of a topic, and reads what they send.

use super::xmlrpc::Value;
use super::{MessageType, Node, Place, header, http};
use std::cell::{Cell, RefCell};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::rc::Rc;
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::time::{sleep, timeout};

use super::node::{LONGEST_PAUSE, PATIENCE, SHORTEST_PAUSE};

/// Publishers of a topic that are listened to.
const MOST_PUBLISHERS: usize = 32;
/// Messages are at most so long, in bytes.
const LONGEST: usize = 1 << 20;
/// A publisher whose machine is gone is found out after some of these.
const ALIVE: Duration = Duration::from_secs(5);

/// What takes the bytes of each message.
pub(super) type Deliver = Box<dyn Fn(&[u8])>;

/// A topic that is listened to.
pub(super) struct Subscription {
    pub topic: String,
    pub kind: MessageType,
    deliver: Deliver,
    /// Addresses of its publishers, as the master has told last.
    publishers: RefCell<BTreeSet<String>>,
    /// Those that are followed, by address.
    pub links: RefCell<BTreeMap<String, Rc<Link>>>,
}

/// A publisher that is followed.
#[derive(Debug)]
pub(super) struct Link {
    pub id: i32,
    pub is_connected: Cell<bool>,
    pub received: Cell<u64>,
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

    /// Takes in who publishes the topic now. A connection that is there goes on, whoever has been forgotten by a
    /// master that was restarted.
    pub(super) fn update(self: &Rc<Self>, node: &Node, publishers: impl Iterator<Item = String>) {
        self.publishers.replace(publishers.take(MOST_PUBLISHERS).collect());
        for uri in self.publishers.borrow().iter() {
            let mut links = self.links.borrow_mut();
            if links.contains_key(uri) || links.len() >= MOST_PUBLISHERS {
                continue;
            }
            let link = Rc::new(Link {
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

/// Listens to a publisher, again and again while the master says that it is one.
async fn follow(node: Node, subscription: Rc<Subscription>, uri: String, link: Rc<Link>) {
    let mut pause = SHORTEST_PAUSE;
    while subscription.publishers.borrow().contains(&uri) && !node.is_shut() {
        let before = link.received.get();
        if let Err(why) = listen(&node, &subscription, &uri, &link).await {
            tracing::debug!("{} is not heard from {uri}: {why}", subscription.topic);
        }
        link.is_connected.set(false);
        let has_heard = link.received.get() > before;
        pause = if has_heard { SHORTEST_PAUSE } else { (2 * pause).min(LONGEST_PAUSE) };
        sleep(pause).await;
    }
    subscription.links.borrow_mut().remove(&uri);
}

async fn listen(node: &Node, subscription: &Subscription, uri: &str, link: &Link) -> Result<(), String> {
    let place = Place::of_uri(uri).ok_or("no address of a node")?;
    let mut stream = timeout(PATIENCE, connect(node, subscription, &place))
        .await
        .map_err(|_| format!("no answer within {} s", PATIENCE.as_secs()))??;
    link.is_connected.set(true);
    let mut bytes = Vec::new();
    while !node.is_shut() {
        let length = stream.read_u32_le().await.map_err(|error| error.to_string())? as usize;
        if length > LONGEST {
            return Err(format!("a message of {length} bytes, at most {LONGEST} are read"));
        }
        bytes.resize(length, 0);
        stream.read_exact(&mut bytes).await.map_err(|error| error.to_string())?;
        link.received.set(link.received.get() + 1);
        link.received_bytes.set(link.received_bytes.get() + 4 + length as u64);
        (subscription.deliver)(&bytes);
    }
    Ok(())
}

/// Asks a node for a topic, and greets it where it says.
async fn connect(node: &Node, subscription: &Subscription, place: &Place) -> Result<TcpStream, String> {
    let Subscription { topic, kind, .. } = subscription;
    let protocols = Value::List(vec![Value::List(vec!["TCPROS".into()])]);
    let arguments = [node.name().into(), topic.as_str().into(), protocols];
    let answer = http::call(place, "requestTopic", &arguments).await.map_err(|error| error.to_string())?;
    let (host, port) = tcpros_of(&answer).ok_or("it does not offer TCPROS")?;
    let mut stream =
        TcpStream::connect((host, port)).await.map_err(|error| format!("{host}:{port}: {error}"))?;
    // A socket that refuses these is gone.
    let _ = stream.set_nodelay(true);
    let keepalive = socket2::TcpKeepalive::new().with_time(ALIVE).with_interval(ALIVE);
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
fn tcpros_of(answer: &Value) -> Option<(&str, u16)> {
    let [Value::Int(1), _, Value::List(protocol)] = answer.list()? else { return None };
    let [name, host, port, ..] = &protocol[..] else { return None };
    (name.text() == Some("TCPROS")).then_some((host.text()?, u16::try_from(port.int()?).ok()?))
}
