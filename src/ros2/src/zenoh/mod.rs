//! ROS 2 over Zenoh in the form of rmw_zenoh: keys with the hash of the type, CDR with its header, an attachment with sequence
//! number and time, and liveliness tokens that tell which nodes and topics there are.

mod names;

use crate::Ros2Error;
use crate::middleware::{
    HEADER_BYTES, MAX_MESSAGE_BYTES, Middleware, Offer, RECEIVE_DEPTH, Received, TopicPublisher,
    TopicSubscriber, refused,
};
use crate::options::{Ros2Network, Ros2Options};
use ::zenoh::liveliness::LivelinessToken;
use ::zenoh::pubsub::{Publisher, Subscriber};
use ::zenoh::qos::CongestionControl;
use ::zenoh::sample::{Sample, SampleKind};
use ::zenoh::{Config, Session, Wait};
use city3d_protocol::ros2::MessageKind;
use names::{Endpoint, EndpointKind, GID_BYTES, Names};
use std::collections::VecDeque;
use std::net::Ipv4Addr;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::Waker;
use std::time::{SystemTime, UNIX_EPOCH};

/// Where a router of rmw_zenoh listens, or whoever is there first.
const PORT: u16 = 7447;
/// Encapsulation header of little-endian CDR; its options may be anything.
const CDR_LE: [u8; 2] = [0x00, 0x01];

/// A session of Zenoh with the topics of a node.
pub(crate) struct Zenoh {
    session: Session,
    names: Names,
    /// Ends with the node.
    _node: LivelinessToken,
}

impl Zenoh {
    /// Joins a domain. Whoever is there first listens where a router would, and the others find it there.
    pub(crate) fn join(options: &Ros2Options) -> Result<Self, Ros2Error> {
        let (own, first) = match options.network {
            Ros2Network::Loopback => (Ipv4Addr::LOCALHOST, Ipv4Addr::LOCALHOST),
            Ros2Network::Interface(address) => (address, address),
            Ros2Network::All => (Ipv4Addr::UNSPECIFIED, Ipv4Addr::LOCALHOST),
        };
        let session = session(own, PORT, None).or_else(|_| session(own, 0, Some(first)))?;
        let names = Names::new(options.domain, &session.zid().to_string(), &options.name);
        let node = session.liveliness().declare_token(names.node()).wait().map_err(refused)?;
        Ok(Self { session, names, _node: node })
    }

    /// Tells others about a publisher or a subscriber.
    fn token(&self, endpoint: &Endpoint) -> Result<LivelinessToken, Ros2Error> {
        self.session.liveliness().declare_token(endpoint.token.as_str()).wait().map_err(refused)
    }

    /// Publishes the last message of a topic again whenever a subscriber comes.
    fn telllatecomers(&self, topic: &str, outlet: &Arc<Outlet>) -> Result<Subscriber<()>, Ros2Error> {
        let outlet = Arc::clone(outlet);
        let came = move |sample: Sample| {
            if sample.kind() == SampleKind::Put {
                outlet.repeat();
            }
        };
        let tokens = self.session.liveliness().declare_subscriber(self.names.subscribers_of(topic));
        tokens.callback(came).wait().map_err(refused)
    }
}

/// A session that listens at an address alone, and goes to nobody but the first one; nobody is looked for.
fn session(own: Ipv4Addr, port: u16, first: Option<Ipv4Addr>) -> Result<Session, Ros2Error> {
    let connect = first.map(|address| format!("\"tcp/{address}:{PORT}\"")).unwrap_or_default();
    let mut config = Config::default();
    for (key, value) in [
        ("mode", "\"peer\"".to_owned()),
        ("listen/endpoints", format!("[\"tcp/{own}:{port}\"]")),
        ("listen/exit_on_failure", "true".to_owned()),
        ("listen/timeout_ms", "0".to_owned()),
        ("connect/endpoints", format!("[{connect}]")),
        ("scouting/multicast/enabled", "false".to_owned()),
    ] {
        config.insert_json5(key, &value).map_err(refused)?;
    }
    ::zenoh::open(config).wait().map_err(refused)
}

impl Middleware for Zenoh {
    fn publisher(
        &mut self,
        topic: &str,
        kind: MessageKind,
        offer: Offer,
    ) -> Result<Box<dyn TopicPublisher>, Ros2Error> {
        let endpoint = self.names.endpoint(EndpointKind::Publisher, topic, kind, offer);
        let publisher = self
            .session
            .declare_publisher(self.names.key(topic, kind))
            // A slow reader holds nobody up: what finds no room on the way to it is dropped.
            .congestion_control(CongestionControl::Drop)
            .wait()
            .map_err(refused)?;
        let outlet = Arc::new(Outlet { publisher, state: Mutex::new(Sent::by(endpoint.gid)) });
        let latecomers = offer.is_latched.then(|| self.telllatecomers(topic, &outlet)).transpose()?;
        let token = self.token(&endpoint)?;
        Ok(Box::new(ZenohPublisher { outlet, gid: endpoint.gid, latecomers, _token: token }))
    }

    fn subscriber(
        &mut self,
        topic: &str,
        kind: MessageKind,
        waker: &Waker,
    ) -> Result<Box<dyn TopicSubscriber>, Ros2Error> {
        let offer = Offer { window: RECEIVE_DEPTH, is_latched: false };
        let endpoint = self.names.endpoint(EndpointKind::Subscriber, topic, kind, offer);
        let queue = Arc::new(Queue::default());
        let (to, waker) = (Arc::clone(&queue), waker.clone());
        let subscriber = self
            .session
            .declare_subscriber(self.names.any_hash(topic, kind))
            .callback(move |sample| {
                to.push(received(&sample));
                waker.wake_by_ref();
            })
            .wait()
            .map_err(refused)?;
        let token = self.token(&endpoint)?;
        Ok(Box::new(ZenohSubscriber { queue, _subscriber: subscriber, _token: token }))
    }

    /// Its token ends with it.
    fn withdraw(&mut self, publisher: Box<dyn TopicPublisher>) {
        drop(publisher);
    }

    /// Each topic has told of itself.
    fn announce(&mut self) {}
}

/// What a publisher has sent.
#[derive(Debug)]
struct Sent {
    gid: [u8; GID_BYTES],
    number: i64,
    last: Vec<u8>,
}

impl Sent {
    fn by(gid: [u8; GID_BYTES]) -> Self {
        Self { gid, number: 0, last: Vec::new() }
    }

    /// The next sequence number, the time since 1970 in nanoseconds, and who has sent it.
    fn attachment(&mut self) -> Vec<u8> {
        self.number += 1;
        let since_1970 = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let mut attachment = self.number.to_le_bytes().to_vec();
        attachment.extend((since_1970.as_nanos() as i64).to_le_bytes());
        attachment.push(GID_BYTES as u8);
        attachment.extend(self.gid);
        attachment
    }
}

struct Outlet {
    publisher: Publisher<'static>,
    state: Mutex<Sent>,
}

impl Outlet {
    fn put(&self, message: Vec<u8>) -> bool {
        let mut sent = locked(&self.state);
        let attachment = sent.attachment();
        self.publisher.put(message).attachment(attachment).wait().is_ok()
    }

    fn keep(&self, message: &[u8]) {
        message.clone_into(&mut locked(&self.state).last);
    }

    /// Publishes the kept message again, if there is one.
    fn repeat(&self) {
        let last = locked(&self.state).last.clone();
        if !last.is_empty() {
            self.put(last);
        }
    }
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

struct ZenohPublisher {
    outlet: Arc<Outlet>,
    gid: [u8; GID_BYTES],
    /// The last message is kept for them.
    latecomers: Option<Subscriber<()>>,
    _token: LivelinessToken,
}

impl TopicPublisher for ZenohPublisher {
    /// Zenoh does not tell whether a message was dropped on its way.
    fn publish(&mut self, message: Vec<u8>) -> bool {
        if self.latecomers.is_some() {
            self.outlet.keep(&message);
        }
        self.outlet.put(message)
    }

    fn has_subscribers(&mut self) -> bool {
        self.outlet.publisher.matching_status().wait().is_ok_and(|status| status.matching())
    }

    fn id(&self) -> [u8; GID_BYTES] {
        self.gid
    }
}

/// Messages that wait to be taken.
#[derive(Debug, Default)]
struct Queue {
    messages: Mutex<VecDeque<Received>>,
}

impl Queue {
    fn push(&self, message: Received) {
        let mut messages = locked(&self.messages);
        if messages.len() >= usize::from(RECEIVE_DEPTH) {
            messages.pop_front();
        }
        messages.push_back(message);
    }
}

/// A message without its header.
fn received(sample: &Sample) -> Received {
    if sample.payload().len() > HEADER_BYTES + MAX_MESSAGE_BYTES {
        return Received::Refused;
    }
    match sample.payload().to_bytes().split_at_checked(HEADER_BYTES) {
        Some((header, body)) if header.starts_with(&CDR_LE) => Received::Message(body.to_vec()),
        _ => Received::Refused,
    }
}

struct ZenohSubscriber {
    queue: Arc<Queue>,
    _subscriber: Subscriber<()>,
    _token: LivelinessToken,
}

impl TopicSubscriber for ZenohSubscriber {
    fn take(&mut self) -> Option<Received> {
        locked(&self.queue.messages).pop_front()
    }
}
