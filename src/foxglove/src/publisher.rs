//! Encodes what clients have subscribed to, from the moments that the session hands over and from the latest state.

use crate::channel::Channel;
use crate::end::Told;
use crate::hub::Hub;
use crate::scene::{self, SceneMaker};
use city3d_logbook::record::LogTopic;
use city3d_logbook::record::message::{encode_snapshot, encode_transform, nanoseconds};
use city3d_protocol::snapshot::{FrameSnapshot, Status};
use city3d_protocol::wire::Measurement;
use city3d_simulation::scenario::Experiment;
use foxglove::Encode;
use glam::DVec3;
use std::sync::Arc;
use tokio_tungstenite::tungstenite::Bytes;

/// Least simulated time between two poses on the topics of VICON: there is one for each vehicle, and 3D panels subscribe to
/// all of them.
const VICON_INTERVAL_NS: u64 = 100_000_000;

/// Encodes for one server.
pub(crate) struct Publisher {
    hub: Arc<Hub>,
    experiment: Arc<Experiment>,
    signals: Vec<DVec3>,
    scene: SceneMaker,
    vicon_ns: Option<u64>,
    last_ns: u64,
}

/// A well-known message as bytes.
pub(crate) fn encoded<M: Encode>(message: &M) -> Bytes {
    let mut bytes = Vec::with_capacity(message.encoded_len().unwrap_or_default());
    // A vector grows as it has to.
    let _ = message.encode(&mut bytes);
    bytes.into()
}

impl Publisher {
    pub(crate) fn new(hub: Arc<Hub>, experiment: Arc<Experiment>) -> Self {
        let signals = scene::signal_places(&experiment);
        Self { hub, experiment, signals, scene: SceneMaker::default(), vicon_ns: None, last_ns: 0 }
    }

    /// Publishes a moment.
    pub(crate) fn publish(&mut self, told: &Told) {
        if told.time_ns < self.last_ns {
            self.restart(told.time_ns);
        }
        self.last_ns = told.time_ns;
        self.hub.tell_time(told.time_ns);
        for (message, bytes) in told.messages.iter() {
            if let Some(channel) = self.hub.city.log(message.topic) {
                self.hub.publish(channel, message.stamp_ns, Bytes::copy_from_slice(bytes));
            }
        }
        if let Some(snapshot) = &told.snapshot {
            self.hub.follow(&snapshot.roster);
            self.snapshot(snapshot);
        }
    }

    /// Publishes what does not change, for those who have just subscribed.
    pub(crate) fn publish_constant(&mut self) {
        // The next scene is whole, as after a reset.
        self.scene = SceneMaker::default();
        self.vicon_ns = None;
        self.map(self.last_ns);
    }

    /// Publishes a city that stands.
    pub(crate) fn publish_standing(&mut self, snapshot: &FrameSnapshot) {
        let time_ns = nanoseconds(snapshot.time_s);
        if time_ns < self.last_ns {
            self.restart(time_ns);
        }
        self.last_ns = time_ns;
        self.hub.tell_time(time_ns);
        self.snapshot(snapshot);
    }

    /// Another run has begun: panels drop what they have when the time goes back.
    fn restart(&mut self, time_ns: u64) {
        self.vicon_ns = None;
        self.hub.tell_time(time_ns);
        self.map(time_ns);
    }

    fn wanted(channel: &Arc<Channel>) -> Option<&Arc<Channel>> {
        Some(channel).filter(|channel| channel.is_wanted())
    }

    fn map(&self, time_ns: u64) {
        if let Some(channel) = Self::wanted(&self.hub.city.map) {
            self.hub.publish(channel, time_ns, encoded(&scene::roads(&self.experiment, time_ns)));
        }
    }

    fn snapshot(&mut self, snapshot: &FrameSnapshot) {
        let (hub, time_ns) = (&self.hub, nanoseconds(snapshot.time_s));
        if let Some(channel) = hub.city.log(LogTopic::Snapshot).and_then(Self::wanted) {
            let has_signals = !self.experiment.lab_map.signals.is_empty();
            hub.publish(channel, time_ns, encode_snapshot(snapshot, has_signals, Vec::new()));
        }
        if let Some(channel) = Self::wanted(&hub.city.transforms) {
            hub.publish(channel, time_ns, encoded(&scene::transforms(snapshot, time_ns)));
        }
        if let Some(channel) = Self::wanted(&hub.city.scene) {
            let scene = self.scene.scene(snapshot, &self.signals, time_ns);
            hub.publish(channel, time_ns, encoded(&scene));
        }
        let is_due = self.vicon_ns.is_none_or(|last_ns| time_ns >= last_ns + VICON_INTERVAL_NS);
        if is_due && hub.wants_vicon() {
            self.vicon_ns = Some(time_ns);
            self.vicon(snapshot, time_ns);
        }
    }

    /// Poses of the vehicles that motion capture measures, as a log has them.
    fn vicon(&self, snapshot: &FrameSnapshot, time_ns: u64) {
        for (state, info) in snapshot.iter().filter(|(state, _)| state.status != Status::Unseen) {
            if let Some(channel) = self.hub.vicon(&info.name) {
                let pose = Measurement::of(state, snapshot.time_s, self.experiment.scale);
                let message = encode_transform(&info.name, &pose, time_ns, Vec::new());
                self.hub.publish(&channel, time_ns, message);
            }
        }
    }
}
