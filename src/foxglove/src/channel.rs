//! Channels: what can be subscribed to, with the definitions of its messages.

use city3d_logbook::record::LogTopic;
use city3d_logbook::record::message::{TRANSFORM_SCHEMA, TRANSFORM_TYPE};
use city3d_protocol::wire::vicon_frame;
use foxglove::Encode;
use serde_json::{Value, json};
use std::borrow::Cow;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

/// Messages of states that wait for a slow client: newer ones take the place of older ones.
const STATE_DEPTH: usize = 8;
/// Messages of what has happened that wait for a slow client.
const HISTORY_DEPTH: usize = 512;
/// Pictures that wait for a slow client.
#[cfg(feature = "render")]
const PICTURE_DEPTH: usize = 2;

/// The definition of a message type.
#[derive(Debug)]
pub(crate) struct Schema {
    pub name: Cow<'static, str>,
    /// Encoding of messages.
    pub message_encoding: &'static str,
    /// Encoding of the definition.
    pub encoding: &'static str,
    /// The definition as the protocol has it: text, or base64 of what is none.
    pub text: Cow<'static, str>,
}

impl Schema {
    /// A well-known type of Foxglove.
    fn well_known<M: Encode>() -> Arc<Self> {
        let found = M::get_schema();
        let (name, data) = found.map_or_else(Default::default, |schema| (schema.name, schema.data));
        Arc::new(Self {
            name: name.into(),
            message_encoding: "protobuf",
            encoding: "protobuf",
            text: data_encoding::BASE64.encode(&data).into(),
        })
    }

    fn ros(name: &'static str, text: Cow<'static, str>) -> Arc<Self> {
        Arc::new(Self { name: name.into(), message_encoding: "cdr", encoding: "ros2msg", text })
    }

    fn json(name: &'static str, definition: &Value) -> Arc<Self> {
        let text = definition.to_string().into();
        Arc::new(Self { name: name.into(), message_encoding: "json", encoding: "jsonschema", text })
    }

    /// Transforms as VICON's bridge publishes them, which all vehicles share.
    pub(crate) fn vicon() -> Arc<Self> {
        Self::ros(TRANSFORM_TYPE, Cow::Borrowed(TRANSFORM_SCHEMA))
    }
}

/// What can be subscribed to.
#[derive(Debug)]
pub(crate) struct Channel {
    /// Number in the protocol, never used again.
    pub id: u32,
    pub topic: String,
    pub schema: Arc<Schema>,
    /// Messages that wait for a client at most (keep last).
    pub depth: usize,
    subscribers: AtomicU32,
    /// Of this channel and others like it, together.
    of_group: Arc<AtomicU32>,
}

impl Channel {
    pub(crate) fn new(id: u32, topic: &str, schema: Arc<Schema>, depth: usize) -> Arc<Self> {
        Self::of_group(id, topic, (schema, depth), Arc::default())
    }

    /// A channel whose subscribers are counted with those of others, too.
    fn of_group(
        id: u32,
        topic: &str,
        (schema, depth): (Arc<Schema>, usize),
        of_group: Arc<AtomicU32>,
    ) -> Arc<Self> {
        let (topic, subscribers) = (topic.to_owned(), AtomicU32::new(0));
        Arc::new(Self { id, topic, schema, depth, subscribers, of_group })
    }

    /// Somebody listens.
    pub(crate) fn is_wanted(&self) -> bool {
        self.subscribers.load(Ordering::Relaxed) > 0
    }

    pub(crate) fn subscribe(&self) {
        self.subscribers.fetch_add(1, Ordering::Relaxed);
        self.of_group.fetch_add(1, Ordering::Relaxed);
    }

    pub(crate) fn unsubscribe(&self) {
        self.subscribers.fetch_sub(1, Ordering::Relaxed);
        self.of_group.fetch_sub(1, Ordering::Relaxed);
    }

    /// As the protocol advertises it.
    pub(crate) fn advertisement(&self) -> Value {
        let Schema { name, message_encoding, encoding, text } = &*self.schema;
        json!({ "id": self.id, "topic": self.topic, "encoding": message_encoding, "schemaName": name,
            "schemaEncoding": encoding, "schema": text })
    }
}

/// The channels that a city always has.
#[derive(Debug)]
pub(crate) struct CityChannels {
    /// By the number of the topic; `None` where the log of this city has no such topic.
    log: [Option<Arc<Channel>>; LogTopic::ALL.len()],
    /// Vehicles and signals.
    pub scene: Arc<Channel>,
    /// Roads, which do not change.
    pub map: Arc<Channel>,
    pub transforms: Arc<Channel>,
    pub metrics: Arc<Channel>,
}

impl CityChannels {
    /// Channels with the numbers from 1 on.
    pub(crate) fn new(topics: &[LogTopic], has_signals: bool) -> Self {
        let mut next_id = 1..;
        let mut channel = |topic: &str, schema: Arc<Schema>, depth: usize| {
            Channel::new(next_id.next().unwrap_or_default(), topic, schema, depth)
        };
        let mut log = [const { None }; LogTopic::ALL.len()];
        for topic in topics {
            let depth = if *topic == LogTopic::Snapshot { STATE_DEPTH } else { HISTORY_DEPTH };
            let schema = Schema::ros(topic.message_type(), topic.schema(has_signals));
            log[*topic as usize] = Some(channel(topic.name(), schema, depth));
        }
        let scene = Schema::well_known::<foxglove::messages::SceneUpdate>();
        let transforms = Schema::well_known::<foxglove::messages::FrameTransforms>();
        Self {
            log,
            scene: channel("/city3d/scene", Arc::clone(&scene), STATE_DEPTH),
            map: channel("/city3d/map", scene, STATE_DEPTH),
            transforms: channel("/tf", transforms, STATE_DEPTH),
            metrics: channel(
                "/city3d/metrics",
                Schema::json("city3d.Metrics", &crate::metrics::schema()),
                STATE_DEPTH,
            ),
        }
    }

    /// The channel of a topic of the log.
    pub(crate) fn log(&self, topic: LogTopic) -> Option<&Arc<Channel>> {
        self.log[topic as usize].as_ref()
    }

    pub(crate) fn all(&self) -> impl Iterator<Item = &Arc<Channel>> {
        let others = [&self.scene, &self.map, &self.transforms, &self.metrics];
        self.log.iter().flatten().chain(others)
    }
}

/// The channel of the poses of a vehicle as VICON's bridge publishes them; `of_group` counts the subscribers of all.
pub(crate) fn vicon_channel(
    id: u32,
    vehicle: &str,
    schema: &Arc<Schema>,
    of_group: &Arc<AtomicU32>,
) -> Arc<Channel> {
    let topic = format!("/{}", vicon_frame(vehicle));
    Channel::of_group(id, &topic, (Arc::clone(schema), STATE_DEPTH), Arc::clone(of_group))
}

/// The channels of a camera: its pictures, and its calibration.
#[cfg(feature = "render")]
pub(crate) fn camera_channels(ids: [u32; 2], name: &str) -> [Arc<Channel>; 2] {
    use foxglove::messages::{CameraCalibration, CompressedImage};
    let [image, calibration] = ids;
    let image_schema = Schema::well_known::<CompressedImage>();
    let calibration_schema = Schema::well_known::<CameraCalibration>();
    [
        Channel::new(image, &format!("/{name}/image"), image_schema, PICTURE_DEPTH),
        Channel::new(calibration, &format!("/{name}/calibration"), calibration_schema, PICTURE_DEPTH),
    ]
}
