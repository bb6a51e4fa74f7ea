//! ROS 2 over DDS, by RustDDS: names of topics and types as all of its middlewares make them, messages as they are.

mod graph;

use crate::Ros2Error;
use crate::middleware::{
    HEADER_BYTES, MAX_MESSAGE_BYTES, Middleware, Offer, RECEIVE_DEPTH, Received, TopicPublisher,
    TopicSubscriber, refused,
};
use crate::options::{Ros2Network, Ros2Options};
use city3d_protocol::ros2::MessageKind;
use graph::NodeGraph;
use rustdds::bytes::Bytes;
use rustdds::dds::result::WriteError;
use rustdds::no_key::{
    DataWriter, Decode, DefaultDecoder, DeserializerAdapter, SerializerAdapter, SimpleDataReader,
};
use rustdds::policy::{Durability, History, Reliability, ResourceLimits};
use rustdds::{
    DataWriterStatus, DomainParticipant, DomainParticipantBuilder, Duration, Publisher, QosPolicies,
    QosPolicyBuilder, RTPSEntity, RepresentationIdentifier, StatusEvented, Subscriber, TopicKind,
};
use std::collections::VecDeque;
use std::convert::Infallible;
use std::net::{IpAddr, Ipv4Addr};
use std::task::Waker;

/// What RustDDS has dropped in this process, because it was no message or beyond its bounds, since some time.
#[derive(Debug)]
pub(crate) struct DroppedByDds {
    before: u64,
}

impl DroppedByDds {
    /// Counts from now on.
    pub(crate) fn from_now() -> Self {
        Self { before: rustdds::limits::dropped() }
    }

    pub(crate) fn count(&self) -> u64 {
        rustdds::limits::dropped().saturating_sub(self.before)
    }
}

/// A participant of DDS with the topics of a node.
pub(crate) struct Dds {
    participant: DomainParticipant,
    publisher: Publisher,
    subscriber: Subscriber,
    graph: NodeGraph,
}

impl Dds {
    /// Joins a domain.
    pub(crate) fn join(options: &Ros2Options) -> Result<Self, Ros2Error> {
        let participant = participant(options)?;
        let none = QosPolicies::qos_none();
        let publisher = participant.create_publisher(&none).map_err(refused)?;
        let subscriber = participant.create_subscriber(&none).map_err(refused)?;
        let mut dds = Self { graph: NodeGraph::new(&options.name), participant, publisher, subscriber };
        let writer = dds.writer(graph::TOPIC, graph::TYPE, &qos(Offer { window: 16, is_latched: true }))?;
        dds.graph.publish_by(dds.participant.guid().to_bytes(), writer);
        Ok(dds)
    }

    fn writer(&self, topic: &str, kind: &str, qos: &QosPolicies) -> Result<RawWriter, Ros2Error> {
        let topic = self
            .participant
            .create_topic(topic.to_owned(), kind.to_owned(), qos, TopicKind::NoKey)
            .map_err(refused)?;
        self.publisher.create_datawriter_no_key(&topic, Some(qos.clone())).map_err(refused)
    }
}

/// A participant. Without a network RustDDS binds its sockets to the loopback device (`SO_BINDTODEVICE`), which neither lets in
/// what comes from elsewhere nor lets anything out.
fn participant(options: &Ros2Options) -> Result<DomainParticipant, Ros2Error> {
    let builder = DomainParticipantBuilder::new(options.domain);
    let builder = match options.network {
        Ros2Network::Loopback => {
            try_loopback_device().map_err(|source| Ros2Error::Fence { source })?;
            builder.with_only_networks([IpAddr::V4(Ipv4Addr::LOCALHOST)])
        }
        Ros2Network::Interface(address) => builder.with_only_networks([IpAddr::V4(address)]),
        Ros2Network::All => builder,
    };
    builder.build().map_err(refused)
}

/// Whether a socket can be bound to the loopback device: what RustDDS says where it cannot helps nobody.
#[cfg(target_os = "linux")]
fn try_loopback_device() -> std::io::Result<()> {
    use socket2::{Domain, Socket, Type};
    Socket::new(Domain::IPV4, Type::DGRAM, None)?.bind_device(Some(b"lo"))
}

#[cfg(not(target_os = "linux"))]
fn try_loopback_device() -> std::io::Result<()> {
    Err(std::io::ErrorKind::Unsupported.into())
}

/// What a publisher offers. A slow reader holds nobody up: what finds no room in the window is dropped.
fn qos(offer: Offer) -> QosPolicies {
    let window = i32::from(offer.window);
    let durability = if offer.is_latched { Durability::TransientLocal } else { Durability::Volatile };
    QosPolicyBuilder::new()
        .reliability(Reliability::Reliable { max_blocking_time: Duration::ZERO })
        .durability(durability)
        .history(History::KeepLast { depth: 1 })
        .resource_limits(ResourceLimits {
            max_samples: window,
            max_instances: window,
            max_samples_per_instance: window,
        })
        .build()
}

impl Middleware for Dds {
    fn publisher(
        &mut self,
        topic: &str,
        kind: MessageKind,
        offer: Offer,
    ) -> Result<Box<dyn TopicPublisher>, Ros2Error> {
        let writer = self.writer(&format!("rt{topic}"), &kind.dds_name(), &qos(offer))?;
        self.graph.add_writer(writer.guid().to_bytes());
        // Ten seconds of poses at 100 Hz: a loaded machine may be that late.
        let max_backlog = usize::from(offer.window / 4);
        Ok(Box::new(DdsPublisher { writer, backlog: VecDeque::new(), max_backlog, readers: 0 }))
    }

    fn subscriber(
        &mut self,
        topic: &str,
        kind: MessageKind,
        waker: &Waker,
    ) -> Result<Box<dyn TopicSubscriber>, Ros2Error> {
        // Best effort is heard from reliable publishers too, but repairs of lost messages are worth having.
        let qos = QosPolicyBuilder::new()
            .reliability(Reliability::Reliable { max_blocking_time: Duration::ZERO })
            .durability(Durability::Volatile)
            .history(History::KeepLast { depth: RECEIVE_DEPTH.into() })
            .build();
        let topic = self
            .participant
            .create_topic(format!("rt{topic}"), kind.dds_name(), &qos, TopicKind::NoKey)
            .map_err(refused)?;
        let reader: RawReader =
            self.subscriber.create_simple_datareader_no_key(&topic, Some(qos)).map_err(refused)?;
        self.graph.add_reader(reader.guid().to_bytes());
        Ok(Box::new(DdsSubscriber { reader, waker: waker.clone() }))
    }

    fn withdraw(&mut self, publisher: Box<dyn TopicPublisher>) {
        self.graph.remove_writer(publisher.id());
    }

    fn announce(&mut self) {
        self.graph.announce();
    }
}

type RawWriter = DataWriter<Bytes, RawCdr>;
type RawReader = SimpleDataReader<Received, RawCdr>;

struct DdsPublisher {
    writer: RawWriter,
    /// Messages that the writer has not taken yet: to RustDDS a reader has acknowledged nothing until it first does, so that
    /// the window of a writer that has run for a while is full for some milliseconds whenever a reader joins.
    backlog: VecDeque<Bytes>,
    /// Messages that wait at most; the oldest are dropped (load shedding).
    max_backlog: usize,
    /// Readers that are matched now.
    readers: i32,
}

impl TopicPublisher for DdsPublisher {
    fn publish(&mut self, message: Vec<u8>) -> bool {
        self.backlog.push_back(message.into());
        while let Some(first) = self.backlog.pop_front() {
            if let Err(WriteError::WouldBlock { data }) = self.writer.write(first, None) {
                self.backlog.push_front(data);
                break;
            }
        }
        let is_full = self.backlog.len() > self.max_backlog;
        if is_full {
            self.backlog.pop_front();
        }
        !is_full
    }

    fn has_subscribers(&mut self) -> bool {
        while let Some(status) = self.writer.try_recv_status() {
            if let DataWriterStatus::PublicationMatched { current, .. } = status {
                self.readers = current.count();
            }
        }
        self.readers > 0
    }

    fn id(&self) -> [u8; 16] {
        self.writer.guid().to_bytes()
    }
}

struct DdsSubscriber {
    reader: RawReader,
    waker: Waker,
}

impl DdsSubscriber {
    fn try_take(&self) -> Option<Received> {
        // An error is a message that cannot be read, or one that was lost.
        match self.reader.try_take_one() {
            Ok(taken) => taken.map(rustdds::no_key::DeserializedCacheChange::into_value),
            Err(_) => Some(Received::Refused),
        }
    }
}

impl TopicSubscriber for DdsSubscriber {
    fn take(&mut self) -> Option<Received> {
        self.reader.drain_read_notifications();
        // One that comes while the waker is set is taken at once.
        self.try_take().or_else(|| {
            self.reader.set_waker(Some(self.waker.clone()));
            self.try_take()
        })
    }
}

/// Messages that are CDR already.
struct RawCdr;

impl SerializerAdapter<Bytes> for RawCdr {
    type Error = Infallible;

    fn output_encoding() -> RepresentationIdentifier {
        RepresentationIdentifier::CDR_LE
    }

    fn to_bytes(message: &Bytes) -> Result<Bytes, Infallible> {
        // RustDDS writes the header itself.
        Ok(message.slice(HEADER_BYTES.min(message.len())..))
    }
}

impl DeserializerAdapter<Received> for RawCdr {
    type Error = Infallible;
    type Decoded = Received;

    fn supported_encodings() -> &'static [RepresentationIdentifier] {
        &[RepresentationIdentifier::CDR_LE]
    }

    fn transform_decoded(decoded: Received) -> Received {
        decoded
    }
}

impl DefaultDecoder<Received> for RawCdr {
    type Decoder = RawDecoder;
    const DECODER: RawDecoder = RawDecoder;
}

/// Takes messages as they are.
#[derive(Clone)]
struct RawDecoder;

impl Decode<'_, Received> for RawDecoder {
    type Error = Infallible;

    fn decode_bytes(self, body: &[u8], encoding: RepresentationIdentifier) -> Result<Received, Infallible> {
        let is_taken = encoding == RepresentationIdentifier::CDR_LE && body.len() <= MAX_MESSAGE_BYTES;
        Ok(if is_taken { Received::Message(body.to_vec()) } else { Received::Refused })
    }
}
