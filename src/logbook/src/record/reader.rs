//! Sequential MCAP log reader: the experiment first, then entry by entry. A truncated log, as of a killed process, is
//! read up to its last whole record.

use super::RecordError;
use super::decisions::{DECISIONS_TOPIC, LoggedDecisions, decode_decisions};
use super::input::{FileKind, file_kind};
use super::log::{
    ARRIVAL_TOPIC, COMMAND_TOPIC, EVENT_TOPIC, FORMAT, LogOrigin, MAP, MEASURED_TOPIC, METADATA, MODELS,
    NETWORK_TOPIC, REVISION, SCENARIO, SIGNALS_TOPIC, SNAPSHOT_TOPIC, TICK_TOPIC, TRAJECTORY_TOPIC,
};
use super::plans::{LoggedPlans, PLANS_TOPIC, decode_plans};
use super::records::{RecordStream, Truncation};
use super::schema::{
    LoggedSnapshot, NetworkCommand, decode_arrival, decode_command, decode_event, decode_measured,
    decode_network, decode_signals, decode_snapshot, decode_tick, decode_trajectory,
};
use city3d_protocol::snapshot::{Event, ModelKind, SimCommand, VehicleId};
use city3d_simulation::environment::EnvironmentProfile;
use city3d_simulation::scenario::{Experiment, Library, Overrides, read_experiment};
use mcap::records::Record;
use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};

/// A decoded message of a log.
#[derive(Clone, Debug, PartialEq)]
pub enum LogEntry {
    /// A trajectory, a measured pose, aspects of signals, or a command of a person, applied in the step after the tick.
    Command {
        /// Tick at which the step begins that applies it.
        tick: u64,
        /// The command as the simulation takes it.
        command: SimCommand,
    },
    /// A datagram of the laboratory's link that was carried out.
    Network(NetworkCommand),
    /// A vehicle of an inflow enters the city.
    Arrival {
        /// Tick at which the step begins that it enters in.
        tick: u64,
        /// Its number, by which the scenario has it.
        vehicle: VehicleId,
        /// Its speed, full scale.
        speed_mps: f64,
    },
    /// The state digest after a step, or at the beginning.
    Tick {
        /// Physics steps since the start or the last reset.
        tick: u64,
        /// Digest of the whole state; a replay must come to it.
        state_hash: u64,
    },
    /// The states of all vehicles at one tick.
    Snapshot(LoggedSnapshot),
    /// Something that happened to a vehicle.
    Event(Event),
    /// Why vehicles do what they do. No state depends on it.
    Decisions(LoggedDecisions),
    /// Plans of vehicles through control zones. No state depends on it.
    Plans(LoggedPlans),
}

/// Reads a log from start to end.
#[derive(Debug)]
pub struct LogReader {
    path: PathBuf,
    records: RecordStream,
    /// Topics by channel.
    topics: HashMap<u16, String>,
    metadata: BTreeMap<String, String>,
    attachments: BTreeMap<String, Vec<u8>>,
    origin: LogOrigin,
    /// The first message: opening reads metadata and attachments up to it.
    ahead: Option<LogEntry>,
}

impl LogReader {
    /// Opens a log of this version's format.
    ///
    /// # Errors
    /// [`RecordError::Unreadable`] where the file cannot be read, [`RecordError::NoLog`] where it is none of City3D, or of
    /// another format.
    pub fn open(path: &Path) -> Result<Self, RecordError> {
        if file_kind(path)? != FileKind::Mcap {
            return Err(no_log(path, "it is not an MCAP file; give the run.mcap of a run"));
        }
        let mut log = Self {
            path: path.to_path_buf(),
            records: RecordStream::open(path).map_err(|error| no_log(path, error))?,
            topics: HashMap::new(),
            metadata: BTreeMap::new(),
            attachments: BTreeMap::new(),
            origin: LogOrigin::Run,
            ahead: None,
        };
        log.ahead = log.next_entry()?;
        let truncation = log.truncation().cloned();
        if log.metadata.is_empty() {
            let why = match truncation {
                Some(why) => format!("{why}; give the run.mcap of a run"),
                None => "it has no metadata of City3D; give the run.mcap of a run of City3D. From a bag of poses, city3d \
                         replay BAG --scenario SCENARIO --out DIR makes a run"
                    .to_owned(),
            };
            return Err(no_log(path, why));
        }
        let format = log.metadata.get("format").map_or("1", String::as_str);
        if format != FORMAT {
            return Err(no_log(
                path,
                format!(
                    "its format is {format}, written by version {}, and this is version {} with format {FORMAT}; \
                     read it with the version that wrote it, or record the run again",
                    log.version(),
                    env!("CARGO_PKG_VERSION")
                ),
            ));
        }
        let origin = log.metadata.get("origin").cloned().unwrap_or_default();
        let known = LogOrigin::ALL.into_iter().find(|known| known.label() == origin);
        log.origin = known.ok_or_else(|| no_log(path, format!("unknown origin \"{origin}\"")))?;
        if let Some(missing) = [SCENARIO, MAP].into_iter().find(|name| !log.attachments.contains_key(*name)) {
            let why = truncation.map(|why| format!(": {why}")).unwrap_or_default();
            return Err(no_log(
                path,
                format!("it ends before {missing}{why}; nothing can be recovered from it"),
            ));
        }
        Ok(log)
    }

    /// The kind of program that has written it.
    pub fn origin(&self) -> LogOrigin {
        self.origin
    }

    /// The version of City3D that has written it.
    pub fn version(&self) -> &str {
        self.metadata.get("version").map_or("?", String::as_str)
    }

    /// The revision of the simulation that has made it, [`digest::REVISION`](city3d_geometry::digest::REVISION); logs that do not
    /// state it are of the first.
    pub fn revision(&self) -> u32 {
        self.metadata.get(REVISION).and_then(|text| text.parse().ok()).unwrap_or(1)
    }

    /// Topics of the channels read so far.
    pub(super) fn topics(&self) -> &HashMap<u16, String> {
        &self.topics
    }

    /// Why the log was not read up to its end, if it was not.
    pub fn truncation(&self) -> Option<&Truncation> {
        self.records.truncation()
    }

    /// The experiment from the log alone, without other files. That of a served city has no vehicles: they came over
    /// the link.
    ///
    /// # Errors
    /// [`RecordError::NoLog`] where it is damaged, or this version does not take the scenario.
    pub fn experiment(&self) -> Result<Experiment, RecordError> {
        let planned = self.planned()?;
        Ok(if self.origin == LogOrigin::Served { planned.without_vehicles() } else { planned })
    }

    /// The experiment with all vehicles of its scenario; a served city had only those that came over the link.
    ///
    /// # Errors
    /// As for [`LogReader::experiment`].
    pub fn planned(&self) -> Result<Experiment, RecordError> {
        let wrong = |why: String| no_log(&self.path, why);
        let number = |key: &str| self.metadata.get(key).ok_or_else(|| wrong(format!("it lacks \"{key}\"")));
        let damaged = |key: &str| wrong(format!("\"{key}\" is damaged"));
        let file = |name: &str| self.attachments.get(name).cloned().unwrap_or_default();
        let text = String::from_utf8(file(SCENARIO)).map_err(|_| damaged(SCENARIO))?;
        let models = self.attachments.iter();
        let models =
            models.filter_map(|(name, file)| Some((name.strip_prefix(MODELS)?.to_owned(), file.clone())));
        let library = Library::kept(file(MAP), models.collect());
        let overrides = Overrides {
            seed: Some(number("seed")?.parse().map_err(|_| damaged("seed"))?),
            duration_s: Some(number("duration_s")?.parse().map_err(|_| damaged("duration_s"))?),
            model: match number("model")?.as_str() {
                "" => None,
                "raycast" => Some(ModelKind::Raycast),
                "bicycle" => Some(ModelKind::Bicycle),
                _ => return Err(damaged("model")),
            },
            // Older logs have none.
            environment: match self.metadata.get("environment").map_or("", String::as_str) {
                "" => None,
                name => {
                    let known = EnvironmentProfile::ALL.into_iter().find(|profile| profile.name() == name);
                    Some(known.ok_or_else(|| damaged("environment"))?)
                }
            },
            allows_no_vehicles: self.origin == LogOrigin::Served,
        };
        let name = format!("{}: {SCENARIO}", self.path.display());
        read_experiment(&name, &text, &library, overrides).map_err(|error| wrong(error.to_string()))
    }

    /// The next entry; `None` at the end, see [`LogReader::truncation`].
    ///
    /// # Errors
    /// [`RecordError::NoLog`] where the file cannot be read.
    pub fn read(&mut self) -> Result<Option<LogEntry>, RecordError> {
        match self.ahead.take() {
            Some(entry) => Ok(Some(entry)),
            None => self.next_entry(),
        }
    }

    fn next_entry(&mut self) -> Result<Option<LogEntry>, RecordError> {
        loop {
            let record = self.records.next().map_err(|error| no_log(&self.path, error))?;
            match record {
                None => return Ok(None),
                Some(Record::Metadata(data)) if data.name == METADATA => self.metadata = data.metadata,
                Some(Record::Attachment { header, data, .. }) if is_of_experiment(&header.name) => {
                    self.attachments.insert(header.name, data.into_owned());
                }
                Some(Record::Channel(channel)) => drop(self.topics.insert(channel.id, channel.topic)),
                Some(Record::Message { header, data }) => {
                    let topic = self.topics.get(&header.channel_id).map_or("", String::as_str);
                    match decode(topic, &data) {
                        None => {}
                        Some(Some(entry)) => return Ok(Some(entry)),
                        Some(None) => self.records.end_damaged(format!("a message of {topic} is damaged")),
                    }
                }
                Some(_) => {}
            }
        }
    }
}

/// Whether an attachment belongs to the experiment of a log.
fn is_of_experiment(name: &str) -> bool {
    name == SCENARIO || name == MAP || name.starts_with(MODELS)
}

pub(super) fn no_log(path: &Path, reason: impl ToString) -> RecordError {
    RecordError::NoLog { path: path.to_path_buf(), reason: reason.to_string() }
}

/// Decodes a message: `None` for other topics, `Some(None)` for a damaged message.
pub(super) fn decode(topic: &str, data: &[u8]) -> Option<Option<LogEntry>> {
    let command = |(tick, command)| LogEntry::Command { tick, command };
    Some(match topic {
        COMMAND_TOPIC => decode_command(data).map(command),
        TRAJECTORY_TOPIC => {
            decode_trajectory(data).map(|(tick, trajectory)| command((tick, SimCommand::Follow(trajectory))))
        }
        MEASURED_TOPIC => decode_measured(data).map(command),
        SIGNALS_TOPIC => decode_signals(data).map(command),
        NETWORK_TOPIC => decode_network(data).map(LogEntry::Network),
        ARRIVAL_TOPIC => decode_arrival(data).map(|(tick, vehicle, speed_mps)| LogEntry::Arrival {
            tick,
            vehicle,
            speed_mps,
        }),
        TICK_TOPIC => decode_tick(data).map(|(tick, state_hash)| LogEntry::Tick { tick, state_hash }),
        SNAPSHOT_TOPIC => decode_snapshot(data).map(LogEntry::Snapshot),
        DECISIONS_TOPIC => decode_decisions(data).map(LogEntry::Decisions),
        PLANS_TOPIC => decode_plans(data).map(LogEntry::Plans),
        EVENT_TOPIC => decode_event(data).map(LogEntry::Event),
        _ => return None,
    })
}

/// Calls `take` with type, topic and bytes of each message of any MCAP file. Returns why the file was not read up to its
/// end, if it was not.
pub(super) fn each_message(
    path: &Path,
    mut take: impl FnMut(&str, &str, &[u8]),
) -> std::io::Result<Option<Truncation>> {
    let mut records = RecordStream::open(path)?;
    // Type names by schema; type and topic by channel.
    let mut schemas: HashMap<u16, String> = HashMap::new();
    let mut channels: HashMap<u16, (String, String)> = HashMap::new();
    while let Some(record) = records.next()? {
        match record {
            Record::Schema { header, .. } => drop(schemas.insert(header.id, header.name)),
            Record::Channel(channel) => {
                let kind = schemas.get(&channel.schema_id).cloned().unwrap_or_default();
                channels.insert(channel.id, (kind, channel.topic));
            }
            Record::Message { header, data } => {
                if let Some((kind, topic)) = channels.get(&header.channel_id) {
                    take(kind, topic, &data);
                }
            }
            _ => {}
        }
    }
    Ok(records.truncation().cloned())
}

/// The last tick of a log, and why the log was not read up to its end, if it was not.
///
/// # Errors
/// As for [`LogReader::open`].
pub fn last_tick(path: &Path) -> Result<(u64, Option<Truncation>), RecordError> {
    let mut log = LogReader::open(path)?;
    let mut last = 0;
    while let Some(entry) = log.read()? {
        if let LogEntry::Tick { tick, .. } = entry {
            last = tick;
        }
    }
    Ok((last, log.truncation().cloned()))
}

/// The commands of persons in a log, each with the tick at which the step began that applied it.
///
/// # Errors
/// [`RecordError::NoLog`] where the file cannot be read or is none.
pub fn read_commands(path: &Path) -> Result<Vec<(u64, SimCommand)>, RecordError> {
    let of_person = |entry| match entry {
        LogEntry::Command { command: SimCommand::Follow(_) | SimCommand::Signals(_), .. } => None,
        LogEntry::Command { tick, command } => Some((tick, command)),
        _ => None,
    };
    read_some(path, of_person)
}

/// The datagrams of the laboratory's link in the order in which they were carried out.
///
/// # Errors
/// [`RecordError::NoLog`] where the file cannot be read or is none.
pub fn read_network(path: &Path) -> Result<Vec<NetworkCommand>, RecordError> {
    read_some(path, |entry| if let LogEntry::Network(command) = entry { Some(command) } else { None })
}

fn read_some<T>(path: &Path, pick: impl Fn(LogEntry) -> Option<T>) -> Result<Vec<T>, RecordError> {
    let mut log = LogReader::open(path)?;
    let mut found = Vec::new();
    while let Some(entry) = log.read()? {
        found.extend(pick(entry));
    }
    Ok(found)
}
