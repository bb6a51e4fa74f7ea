//! Writer of the run log: one MCAP file (profile `ros2`, CDR messages with ros2msg schemas) that Foxglove, the `mcap`
//! tools and ROS readers open.

use super::decisions::{DECISIONS_SCHEMA, DECISIONS_TOPIC, DECISIONS_TYPE, encode_decisions};
use super::mcap_writer::McapWriter;
use super::plans::{PLANS_SCHEMA, PLANS_TOPIC, PLANS_TYPE, encode_plans};
use super::schema::{
    ARRIVAL_SCHEMA, ARRIVAL_TYPE, COMMAND_SCHEMA, COMMAND_TYPE, EVENT_SCHEMA, EVENT_TYPE, MEASURED_SCHEMA,
    MEASURED_TYPE, NETWORK_SCHEMA, NETWORK_TYPE, NetworkCommand, PersonCommand, SIGNALS_SCHEMA, SIGNALS_TYPE,
    SNAPSHOT_SCHEMA, SNAPSHOT_TYPE, TICK_SCHEMA, TICK_TYPE, TRAJECTORY_SCHEMA, TRAJECTORY_TYPE,
    encode_arrival, encode_command, encode_event, encode_measured, encode_network, encode_signals,
    encode_snapshot, encode_tick, encode_trajectory, snapshot_schema_with_signals,
};
use super::transforms::{TRANSFORM_SCHEMA, TRANSFORM_TYPE, encode_transform};
use city3d_geometry::LengthScale;
use city3d_geometry::digest;
use city3d_protocol::snapshot::{
    ControlDecision, CoordinationUpdate, Event, FrameSnapshot, ModelKind, SimCommand, Status,
};
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
    snapshots: u16,
    events: u16,
    commands: u16,
    network: u16,
    trajectories: u16,
    measured: u16,
    /// In a city with traffic signals.
    signals: Option<u16>,
    ticks: u16,
    /// Of a scenario with inflows.
    arrivals: Option<u16>,
    /// Where a control framework may tell its decisions.
    decisions: Option<u16>,
    /// Where one may tell plans through control zones.
    plans: Option<u16>,
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
        let snapshot_schema =
            if has_signals { snapshot_schema_with_signals() } else { SNAPSHOT_SCHEMA.to_owned() };
        let mut channel = |topic: &str, name: &str, schema: &str| {
            let schema = writer.schema(name, "ros2msg", schema);
            writer.channel(schema, topic)
        };
        let snapshots = channel(SNAPSHOT_TOPIC, SNAPSHOT_TYPE, &snapshot_schema)?;
        let events = channel(EVENT_TOPIC, EVENT_TYPE, EVENT_SCHEMA)?;
        let commands = channel(COMMAND_TOPIC, COMMAND_TYPE, COMMAND_SCHEMA)?;
        let network = channel(NETWORK_TOPIC, NETWORK_TYPE, NETWORK_SCHEMA)?;
        let trajectories = channel(TRAJECTORY_TOPIC, TRAJECTORY_TYPE, TRAJECTORY_SCHEMA)?;
        let measured = channel(MEASURED_TOPIC, MEASURED_TYPE, MEASURED_SCHEMA)?;
        let ticks = channel(TICK_TOPIC, TICK_TYPE, TICK_SCHEMA)?;
        let signals =
            has_signals.then(|| channel(SIGNALS_TOPIC, SIGNALS_TYPE, SIGNALS_SCHEMA)).transpose()?;
        // Logs of scenarios without inflows stay as they are.
        let arrivals = if experiment.inflows.is_empty() {
            None
        } else {
            Some(channel(ARRIVAL_TOPIC, ARRIVAL_TYPE, ARRIVAL_SCHEMA)?)
        };
        // A log that was torn has no index, so that its channels have to be known before its first message.
        let decisions = match origin {
            LogOrigin::Recorded => None,
            _ => Some(channel(DECISIONS_TOPIC, DECISIONS_TYPE, DECISIONS_SCHEMA)?),
        };
        let may_coordinate = match origin {
            LogOrigin::Run => experiment.coordination.is_some(),
            // The control framework may have another scenario.
            LogOrigin::Served | LogOrigin::Mainframe => true,
            LogOrigin::Recorded => false,
        };
        let plans = may_coordinate.then(|| channel(PLANS_TOPIC, PLANS_TYPE, PLANS_SCHEMA)).transpose()?;
        let transform_schema = writer.schema(TRANSFORM_TYPE, "ros2msg", TRANSFORM_SCHEMA);
        Ok(Self {
            writer,
            snapshots,
            events,
            commands,
            network,
            trajectories,
            measured,
            signals,
            ticks,
            arrivals,
            decisions,
            plans,
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
        self.buffer = encode_snapshot(snapshot, self.signals.is_some(), std::mem::take(&mut self.buffer));
        self.message(self.snapshots, snapshot.time_s)?;
        for (state, info) in snapshot.iter().filter(|(state, _)| state.status != Status::Unseen) {
            let channel = self.transforms_of(&info.name)?;
            let pose = Measurement::of(state, snapshot.time_s, self.scale);
            let stamp = nanoseconds(snapshot.time_s);
            self.buffer = encode_transform(&info.name, &pose, stamp, std::mem::take(&mut self.buffer));
            self.message(channel, snapshot.time_s)?;
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
        self.message(self.events, event.time_s)
    }

    /// Adds the digest of a tick.
    ///
    /// # Errors
    /// When it cannot be written; what was written before stays readable.
    pub fn tick(&mut self, tick: u64, time_s: f64, state_hash: u64) -> io::Result<()> {
        self.buffer = encode_tick(tick, state_hash, std::mem::take(&mut self.buffer));
        self.message(self.ticks, time_s)
    }

    /// Adds a command that is applied in the step after a tick: a trajectory, a measured pose, aspects of signals, or a
    /// command of a person. The start of the clock is not logged.
    ///
    /// # Errors
    /// When it cannot be written; what was written before stays readable.
    pub fn command(&mut self, tick: u64, time_s: f64, command: &SimCommand) -> io::Result<()> {
        let mut buffer = std::mem::take(&mut self.buffer);
        buffer.clear();
        let kind = CommandKind::encode(tick, command, &mut buffer);
        let written = kind.map_or(Ok(()), |kind| self.encoded(kind, time_s, &buffer));
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
        let kind = CommandKind::encode_plans((tick, time_s), update, &mut buffer);
        let written = self.encoded(kind, time_s, &buffer);
        self.buffer = buffer;
        written
    }

    /// Adds an encoded command, or encoded decisions or plans.
    ///
    /// # Errors
    /// When it cannot be written; what was written before stays readable.
    pub(super) fn encoded(&mut self, kind: CommandKind, time_s: f64, message: &[u8]) -> io::Result<()> {
        let channel = match kind {
            CommandKind::Person => self.commands,
            CommandKind::Trajectory => self.trajectories,
            CommandKind::Measured => self.measured,
            CommandKind::Signals => match self.signals {
                Some(channel) => channel,
                // Nobody has these heads.
                None => return Ok(()),
            },
            CommandKind::Arrival => match self.arrivals {
                Some(channel) => channel,
                None => return Ok(()),
            },
            CommandKind::Decisions => match self.decisions {
                Some(channel) => channel,
                None => return Ok(()),
            },
            CommandKind::Plans => match self.plans {
                Some(channel) => channel,
                None => return Ok(()),
            },
        };
        let header = self.header(channel, time_s);
        self.writer.message(&header, message)
    }

    /// Adds a datagram that was carried out.
    ///
    /// # Errors
    /// When it cannot be written; what was written before stays readable.
    pub fn network(&mut self, time_s: f64, command: &NetworkCommand) -> io::Result<()> {
        self.buffer = encode_network(command, std::mem::take(&mut self.buffer));
        self.message(self.network, time_s)
    }

    fn message(&mut self, channel_id: u16, time_s: f64) -> io::Result<()> {
        let header = self.header(channel_id, time_s);
        self.writer.message(&header, &self.buffer)
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

/// The message type of a logged command, or of what is logged beside them.
#[derive(Clone, Copy, Debug)]
pub(super) enum CommandKind {
    /// Command of a person.
    Person,
    Trajectory,
    Measured,
    Signals,
    /// A vehicle of an inflow enters.
    Arrival,
    /// Why vehicles do what they do; no command.
    Decisions,
    /// Plans through control zones; no command.
    Plans,
}

impl CommandKind {
    /// Appends decisions that hold in the snapshot of a tick to a buffer.
    pub fn encode_decisions(
        (tick, time_s): (u64, f64),
        decisions: &[ControlDecision],
        buffer: &mut Vec<u8>,
    ) -> Self {
        *buffer = encode_decisions(tick, time_s, decisions, std::mem::take(buffer));
        Self::Decisions
    }

    /// Appends plans that hold in the snapshot of a tick to a buffer.
    pub fn encode_plans(
        (tick, time_s): (u64, f64),
        update: &CoordinationUpdate,
        buffer: &mut Vec<u8>,
    ) -> Self {
        *buffer = encode_plans(tick, time_s, update, std::mem::take(buffer));
        Self::Plans
    }

    /// Appends a command, applied in the step after a tick, to a buffer; `None` for commands that are not logged.
    pub fn encode(tick: u64, command: &SimCommand, buffer: &mut Vec<u8>) -> Option<Self> {
        let mut memory = || std::mem::take(buffer);
        let (kind, message) = match command {
            SimCommand::Follow(trajectory) => {
                (Self::Trajectory, encode_trajectory(tick, trajectory, memory()))
            }
            SimCommand::Measure(vehicle, pose) => {
                (Self::Measured, encode_measured(tick, *vehicle, pose, memory()))
            }
            SimCommand::Signals(aspects) => (Self::Signals, encode_signals(tick, aspects, memory())),
            SimCommand::Spawn(setup) => (Self::Arrival, encode_arrival(tick, setup, memory())),
            other => (Self::Person, encode_command(tick, PersonCommand::of(other)?, memory())),
        };
        *buffer = message;
        Some(kind)
    }
}

/// Simulated seconds as log nanoseconds.
fn nanoseconds(time_s: f64) -> u64 {
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
