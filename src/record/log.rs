//! The run log: one MCAP file (profile `ros2`, messages in CDR with ros2msg schemas) that Foxglove,
//! the `mcap` tools and ROS readers open.

use super::schema::{
    COMMAND_SCHEMA, COMMAND_TYPE, EVENT_SCHEMA, EVENT_TYPE, NETWORK_SCHEMA, NETWORK_TYPE, NetworkCommand,
    SNAPSHOT_SCHEMA, SNAPSHOT_TYPE, encode_command, encode_event, encode_network, encode_snapshot,
};
use crate::scenario::Experiment;
use crate::snapshot::{Event, FrameSnapshot, SimCommand};
use mcap::records::{MessageHeader, Metadata};
use mcap::{Attachment, McapResult, WriteOptions, Writer};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::{Seek, Write};

/// Writes a log. The experiment is embedded: scenario and map as attachments, the rest as metadata.
pub struct LogWriter<W: Write + Seek> {
    writer: Writer<W>,
    snapshots: u16,
    events: u16,
    commands: u16,
    network: u16,
    sequence: u32,
    buffer: Vec<u8>,
}

impl<W: Write + Seek> std::fmt::Debug for LogWriter<W> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("LogWriter").field("messages", &self.sequence).finish_non_exhaustive()
    }
}

/// Where the commands of persons are.
pub(super) const COMMAND_TOPIC: &str = "/city3d/command";

/// Where that is which came over the laboratory's link.
pub(super) const NETWORK_TOPIC: &str = "/city3d/network";

/// Chunks this large are compressed and written at once: what a killed process loses at most.
const CHUNK_BYTES: u64 = 512 << 10;

impl<W: Write + Seek> LogWriter<W> {
    /// Begins a log with everything a run depends on.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn new(sink: W, experiment: &Experiment) -> McapResult<Self> {
        let mut writer = WriteOptions::new()
            .profile("ros2")
            .library(concat!("city3d ", env!("CARGO_PKG_VERSION")))
            .compression(Some(mcap::Compression::Lz4))
            .chunk_size(Some(CHUNK_BYTES))
            .create(sink)?;
        writer.write_metadata(&Metadata { name: "city3d".to_owned(), metadata: metadata_of(experiment) })?;
        for (name, media_type, data) in [
            ("scenario.toml", "application/toml", experiment.scenario_text.as_bytes()),
            ("map.dxf", "image/vnd.dxf", experiment.map_bytes.as_slice()),
        ] {
            writer.attach(&Attachment {
                log_time: 0,
                create_time: 0,
                name: name.to_owned(),
                media_type: media_type.to_owned(),
                data: Cow::Borrowed(data),
            })?;
        }
        let mut channel = |topic: &str, name: &str, schema: &str| {
            let schema = writer.add_schema(name, "ros2msg", schema.as_bytes())?;
            writer.add_channel(schema, topic, "cdr", &BTreeMap::new())
        };
        let snapshots = channel("/city3d/snapshot", SNAPSHOT_TYPE, SNAPSHOT_SCHEMA)?;
        let events = channel("/city3d/event", EVENT_TYPE, EVENT_SCHEMA)?;
        let commands = channel(COMMAND_TOPIC, COMMAND_TYPE, COMMAND_SCHEMA)?;
        let network = channel(NETWORK_TOPIC, NETWORK_TYPE, NETWORK_SCHEMA)?;
        Ok(Self { writer, snapshots, events, commands, network, sequence: 0, buffer: Vec::new() })
    }

    /// Adds a snapshot.
    ///
    /// # Errors
    /// When it cannot be written; what was written before stays readable.
    pub fn snapshot(&mut self, snapshot: &FrameSnapshot) -> McapResult<()> {
        self.buffer = encode_snapshot(snapshot, std::mem::take(&mut self.buffer));
        self.message(self.snapshots, snapshot.time_s)
    }

    /// Adds an event.
    ///
    /// # Errors
    /// When it cannot be written; what was written before stays readable.
    pub fn event(&mut self, event: &Event) -> McapResult<()> {
        self.buffer = encode_event(event, std::mem::take(&mut self.buffer));
        self.message(self.events, event.time_s)
    }

    /// Adds a command of a person that is applied in the step after a tick.
    ///
    /// # Errors
    /// When it cannot be written; what was written before stays readable.
    pub fn command(&mut self, tick: u64, time_s: f64, command: &SimCommand) -> McapResult<()> {
        match encode_command(tick, command, std::mem::take(&mut self.buffer)) {
            Some(bytes) => {
                self.buffer = bytes;
                self.message(self.commands, time_s)
            }
            None => Ok(()),
        }
    }

    /// Adds what came over the laboratory's link.
    ///
    /// # Errors
    /// When it cannot be written; what was written before stays readable.
    pub fn network(&mut self, time_s: f64, command: &NetworkCommand) -> McapResult<()> {
        self.buffer = encode_network(command, std::mem::take(&mut self.buffer));
        self.message(self.network, time_s)
    }

    fn message(&mut self, channel_id: u16, time_s: f64) -> McapResult<()> {
        self.sequence = self.sequence.wrapping_add(1);
        let nanoseconds = (time_s * 1e9).round() as u64;
        let header = MessageHeader {
            channel_id,
            sequence: self.sequence,
            log_time: nanoseconds,
            publish_time: nanoseconds,
        };
        self.writer.write_to_known_channel(&header, &self.buffer)
    }

    /// Ends the present chunk: what has been added stays readable whatever happens.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn flush(&mut self) -> McapResult<()> {
        self.writer.flush()
    }

    /// Writes the index and ends the log.
    ///
    /// # Errors
    /// When it cannot be written; the messages stay readable without their index.
    pub fn finish(mut self) -> McapResult<()> {
        self.writer.finish().map(|_| ())
    }
}

fn metadata_of(experiment: &Experiment) -> BTreeMap<String, String> {
    let pairs = [
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
