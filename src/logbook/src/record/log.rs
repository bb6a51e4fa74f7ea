//! Writer of the run log: one MCAP file (profile `ros2`, CDR messages with ros2msg schemas) that Foxglove, the `mcap`
//! tools and ROS readers open.

use super::mcap_writer::McapWriter;
use super::plans::encode_plans;
use super::schema::{NetworkCommand, encode_event, encode_network, encode_snapshot, encode_tick};
use super::topic::LogTopic;
use super::transforms::{TRANSFORM_SCHEMA, TRANSFORM_TYPE, encode_transform};
use city3d_geometry::LengthScale;
use city3d_geometry::digest;
use city3d_protocol::snapshot::{CoordinationUpdate, Event, FrameSnapshot, ModelKind, SimCommand, Status};
use city3d_protocol::wire::{Measurement, vicon_frame};
use city3d_simulation::environment::EnvironmentProfile;
use city3d_simulation::scenario::Experiment;
use mcap::records::MessageHeader;
use std::collections::BTreeMap;
use std::io::{self, Write};
use std::path::Path;

/// Writes a log. The experiment is embedded: scenario and map as attachments, the rest as metadata.
pub struct LogWriter<W> {
    writer: McapWriter<W>,
    /// By topic; `None` where this log has none of its messages.
    channels: [Option<u16>; LogTopic::ALL.len()],
    has_signals: bool,
    transform_schema: u16,
    /// Channels of the vehicles' transforms, by the vehicles' names.
    transforms: BTreeMap<String, u16>,
    scale: LengthScale,
    sequence: u32,
    buffer: Vec<u8>,
}

impl<W> std::fmt::Debug for LogWriter<W> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("LogWriter").field("messages", &self.sequence).finish_non_exhaustive()
    }
}

/// Topic of the commands of persons.
pub(super) const COMMAND_TOPIC: &str = "/city3d/command";

/// Topic of the control framework's trajectories.
pub(super) const TRAJECTORY_TOPIC: &str = "/city3d/trajectory";

/// Topic of the measured poses of physical vehicles.
pub(super) const MEASURED_TOPIC: &str = "/city3d/measured";
/// Topic of the arrivals that enter the city.
pub(super) const ARRIVAL_TOPIC: &str = "/city3d/arrivals";

/// Topic of the commands of traffic signals.
pub(super) const SIGNALS_TOPIC: &str = "/city3d/signals";

/// Topic of the state digests.
pub(super) const TICK_TOPIC: &str = "/city3d/tick";

pub(super) const SNAPSHOT_TOPIC: &str = "/city3d/snapshot";

/// Topic of the events.
pub(super) const EVENT_TOPIC: &str = "/city3d/event";

/// Name of the metadata record of the experiment.
pub(super) const METADATA: &str = "city3d";
/// Format version; raised when an older reader would misread a log.
pub(super) const FORMAT: &str = "3";
/// Metadata key of the simulation revision, [`digest::REVISION`].
pub(super) const REVISION: &str = "revision";
pub(super) const SCENARIO: &str = "scenario.toml";
pub(super) const MAP: &str = "map.dxf";
/// Prefix of model attachments.
pub(super) const MODELS: &str = "models/";

/// The program that wrote a log; it tells which commands moved the vehicles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LogOrigin {
    /// A run in one process: trajectories, and commands of persons.
    Run,
    /// A city whose vehicles and commands came over the laboratory's link.
    Served,
    /// The control framework in a process of its own: it has seen poses, and no world.
    Mainframe,
    /// Made from poses that were measured elsewhere.
    Recorded,
}

impl LogOrigin {
    pub(super) const ALL: [Self; 4] = [Self::Run, Self::Served, Self::Mainframe, Self::Recorded];

    /// Whether it can be replayed; other logs hold only poses.
    pub fn has_world(self) -> bool {
        matches!(self, Self::Run | Self::Served)
    }

    pub(super) fn label(self) -> &'static str {
        match self {
            Self::Run => "run",
            Self::Served => "served",
            Self::Mainframe => "mainframe",
            Self::Recorded => "recorded",
        }
    }
}

/// Topic of the datagrams of the laboratory's link.
pub(super) const NETWORK_TOPIC: &str = "/city3d/network";

impl<W: Write> LogWriter<W> {
    /// Begins a log with everything a run depends on. The index of a long log waits in a file without a name in
    /// `index_folder`.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn new(sink: W, experiment: &Experiment, origin: LogOrigin, index_folder: &Path) -> io::Result<Self> {
        let library = concat!("city3d ", env!("CARGO_PKG_VERSION"));
        let mut writer = McapWriter::new(sink, ("ros2", library), index_folder)?;
        writer.metadata(METADATA, &metadata_of(experiment, origin))?;
        writer.attachment(SCENARIO, "application/toml", experiment.scenario_text.as_bytes())?;
        writer.attachment(MAP, "image/vnd.dxf", &experiment.map_bytes)?;
        for (name, file) in &experiment.models.files {
            writer.attachment(&format!("{MODELS}{name}"), "model/gltf-binary", file)?;
        }
        let has_signals = !experiment.lab_map.signals.is_empty();
        let mut channels = [None; LogTopic::ALL.len()];
        for topic in LogTopic::of_log(experiment, origin) {
            let schema = writer.schema(topic.message_type(), "ros2msg", &topic.schema(has_signals));
            channels[topic as usize] = Some(writer.channel(schema, topic.name())?);
        }
        let transform_schema = writer.schema(TRANSFORM_TYPE, "ros2msg", TRANSFORM_SCHEMA);
        Ok(Self {
            writer,
            channels,
            has_signals,
            transform_schema,
            transforms: BTreeMap::new(),
            scale: experiment.scale,
            sequence: 0,
            buffer: Vec::new(),
        })
    }

    /// Adds a snapshot, and the transforms of the vehicles that motion capture sees in it.
    ///
    /// # Errors
    /// When it cannot be written; what was written before stays readable.
    pub fn snapshot(&mut self, snapshot: &FrameSnapshot) -> io::Result<()> {
        self.buffer = encode_snapshot(snapshot, self.has_signals, std::mem::take(&mut self.buffer));
        self.message(LogTopic::Snapshot, snapshot.time_s)?;
        for (state, info) in snapshot.iter().filter(|(state, _)| state.status != Status::Unseen) {
            let channel = self.transforms_of(&info.name)?;
            let pose = Measurement::of(state, snapshot.time_s, self.scale);
            let stamp = nanoseconds(snapshot.time_s);
            self.buffer = encode_transform(&info.name, &pose, stamp, std::mem::take(&mut self.buffer));
            let header = self.header(channel, snapshot.time_s);
            self.writer.message(&header, &self.buffer)?;
        }
        Ok(())
    }

    /// The channel of a vehicle's transforms.
    fn transforms_of(&mut self, name: &str) -> io::Result<u16> {
        if let Some(&channel) = self.transforms.get(name) {
            return Ok(channel);
        }
        let topic = format!("/{}", vicon_frame(name));
        let channel = self.writer.channel(self.transform_schema, &topic)?;
        self.transforms.insert(name.to_owned(), channel);
        Ok(channel)
    }

    /// Adds an event.
    ///
    /// # Errors
    /// When it cannot be written; what was written before stays readable.
    pub fn event(&mut self, event: &Event) -> io::Result<()> {
        self.buffer = encode_event(event, std::mem::take(&mut self.buffer));
        self.message(LogTopic::Event, event.time_s)
    }

    /// Adds the digest of a tick.
    ///
    /// # Errors
    /// When it cannot be written; what was written before stays readable.
    pub fn tick(&mut self, tick: u64, time_s: f64, state_hash: u64) -> io::Result<()> {
        self.buffer = encode_tick(tick, state_hash, std::mem::take(&mut self.buffer));
        self.message(LogTopic::Tick, time_s)
    }

    /// Adds a command that is applied in the step after a tick: a trajectory, a measured pose, aspects of signals, or a
    /// command of a person. The start of the clock is not logged.
    ///
    /// # Errors
    /// When it cannot be written; what was written before stays readable.
    pub fn command(&mut self, tick: u64, time_s: f64, command: &SimCommand) -> io::Result<()> {
        let mut buffer = std::mem::take(&mut self.buffer);
        buffer.clear();
        let topic = LogTopic::encode(tick, command, &mut buffer);
        let written = topic.map_or(Ok(()), |topic| self.encoded(topic, time_s, &buffer));
        self.buffer = buffer;
        written
    }

    /// Adds plans through control zones that hold in the snapshot of a tick; none in a log where nobody may tell any.
    ///
    /// # Errors
    /// When it cannot be written; what was written before stays readable.
    pub fn plans(&mut self, tick: u64, time_s: f64, update: &CoordinationUpdate) -> io::Result<()> {
        let mut buffer = std::mem::take(&mut self.buffer);
        buffer.clear();
        let buffer = encode_plans(tick, time_s, update, buffer);
        let written = self.encoded(LogTopic::Plans, time_s, &buffer);
        self.buffer = buffer;
        written
    }

    /// Adds an encoded command, or encoded decisions or plans.
    ///
    /// # Errors
    /// When it cannot be written; what was written before stays readable.
    pub(super) fn encoded(&mut self, topic: LogTopic, time_s: f64, message: &[u8]) -> io::Result<()> {
        // Nobody has these signal heads, or may tell plans.
        let Some(channel) = self.channels[topic as usize] else { return Ok(()) };
        let header = self.header(channel, time_s);
        self.writer.message(&header, message)
    }

    /// Adds a datagram that was carried out.
    ///
    /// # Errors
    /// When it cannot be written; what was written before stays readable.
    pub fn network(&mut self, time_s: f64, command: &NetworkCommand) -> io::Result<()> {
        self.buffer = encode_network(command, std::mem::take(&mut self.buffer));
        self.message(LogTopic::Network, time_s)
    }

    /// Adds the message in the buffer.
    fn message(&mut self, topic: LogTopic, time_s: f64) -> io::Result<()> {
        let buffer = std::mem::take(&mut self.buffer);
        let written = self.encoded(topic, time_s, &buffer);
        self.buffer = buffer;
        written
    }

    fn header(&mut self, channel_id: u16, time_s: f64) -> MessageHeader {
        self.sequence = self.sequence.wrapping_add(1);
        let stamp = nanoseconds(time_s);
        MessageHeader { channel_id, sequence: self.sequence, log_time: stamp, publish_time: stamp }
    }

    /// Ends the present chunk: its messages survive a crash.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn flush(&mut self) -> io::Result<()> {
        self.writer.flush()
    }

    /// Writes the index and ends the log.
    ///
    /// # Errors
    /// When it cannot be written; the messages stay readable without their index.
    pub fn finish(self) -> io::Result<()> {
        self.writer.finish()
    }
}

/// Simulated seconds as log nanoseconds.
pub fn nanoseconds(time_s: f64) -> u64 {
    (time_s * 1e9).round() as u64
}

fn metadata_of(experiment: &Experiment, origin: LogOrigin) -> BTreeMap<String, String> {
    let model = match experiment.model {
        None => "",
        Some(ModelKind::Raycast) => "raycast",
        Some(ModelKind::Bicycle) => "bicycle",
        // No override: a scenario states it vehicle by vehicle.
        Some(ModelKind::Measured) => "",
    };
    let pairs = [
        ("format", FORMAT.to_owned()),
        (REVISION, digest::REVISION.to_string()),
        ("origin", origin.label().to_owned()),
        ("model", model.to_owned()),
        ("environment", experiment.profile.map_or("", EnvironmentProfile::name).to_owned()),
        ("scenario", experiment.name.clone()),
        ("version", env!("CARGO_PKG_VERSION").to_owned()),
        ("seed", experiment.seed.to_string()),
        ("duration_s", experiment.duration_s.to_string()),
        ("length_scale", experiment.scale.factor().to_string()),
        ("physics_hz", experiment.rates.physics_hz.to_string()),
        ("control_hz", experiment.rates.control_hz.to_string()),
    ];
    pairs.map(|(key, value)| (key.to_owned(), value)).into()
}
