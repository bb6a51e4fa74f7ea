//! The topics of a log: their names, message types and definitions, and which log has which.

use super::decisions::{DECISIONS_SCHEMA, DECISIONS_TOPIC, DECISIONS_TYPE};
use super::log::{
    ARRIVAL_TOPIC, COMMAND_TOPIC, EVENT_TOPIC, LogOrigin, MEASURED_TOPIC, NETWORK_TOPIC, SIGNALS_TOPIC,
    SNAPSHOT_TOPIC, TICK_TOPIC, TRAJECTORY_TOPIC,
};
use super::plans::{PLANS_SCHEMA, PLANS_TOPIC, PLANS_TYPE};
use super::schema::{
    ARRIVAL_SCHEMA, ARRIVAL_TYPE, COMMAND_SCHEMA, COMMAND_TYPE, EVENT_SCHEMA, EVENT_TYPE, MEASURED_SCHEMA,
    MEASURED_TYPE, NETWORK_SCHEMA, NETWORK_TYPE, PersonCommand, SIGNALS_SCHEMA, SIGNALS_TYPE,
    SNAPSHOT_SCHEMA, SNAPSHOT_TYPE, TICK_SCHEMA, TICK_TYPE, TRAJECTORY_SCHEMA, TRAJECTORY_TYPE,
    encode_arrival, encode_command, encode_measured, encode_signals, encode_trajectory,
    snapshot_schema_with_signals,
};
use city3d_protocol::snapshot::SimCommand;
use city3d_simulation::scenario::Experiment;
use std::borrow::Cow;

/// A topic of a log whose name does not depend on the vehicles.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum LogTopic {
    /// Instants of the run.
    Snapshot,
    /// What happened to vehicles.
    Event,
    /// Commands of persons.
    Command,
    /// Commands over the laboratory's link.
    Network,
    /// Trajectories of the control framework.
    Trajectory,
    /// Measured poses of physical vehicles.
    Measured,
    /// Digests of the state.
    Tick,
    /// Commands of traffic signals.
    Signals,
    /// Vehicles of inflows that enter.
    Arrival,
    /// Why vehicles do what they do; no command.
    Decisions,
    /// Plans through control zones; no command.
    Plans,
}

impl LogTopic {
    /// All topics, each at the index of its number, in the order of a log's channels.
    pub const ALL: [Self; 11] = [
        Self::Snapshot,
        Self::Event,
        Self::Command,
        Self::Network,
        Self::Trajectory,
        Self::Measured,
        Self::Tick,
        Self::Signals,
        Self::Arrival,
        Self::Decisions,
        Self::Plans,
    ];

    /// The topics of the log of an experiment.
    pub fn of_log(experiment: &Experiment, origin: LogOrigin) -> Vec<Self> {
        let may_coordinate = match origin {
            LogOrigin::Run => experiment.coordination.is_some(),
            // The control framework may have another scenario.
            LogOrigin::Served | LogOrigin::Mainframe => true,
            LogOrigin::Recorded => false,
        };
        let is_in = |topic: &Self| match topic {
            Self::Signals => !experiment.lab_map.signals.is_empty(),
            // Logs of scenarios without inflows stay as they are.
            Self::Arrival => !experiment.inflows.is_empty(),
            // A log that was torn has no index, so that its channels have to be known before its first message.
            Self::Decisions => origin != LogOrigin::Recorded,
            Self::Plans => may_coordinate,
            _ => true,
        };
        Self::ALL.into_iter().filter(is_in).collect()
    }

    /// Name of the topic.
    pub fn name(self) -> &'static str {
        match self {
            Self::Snapshot => SNAPSHOT_TOPIC,
            Self::Event => EVENT_TOPIC,
            Self::Command => COMMAND_TOPIC,
            Self::Network => NETWORK_TOPIC,
            Self::Trajectory => TRAJECTORY_TOPIC,
            Self::Measured => MEASURED_TOPIC,
            Self::Tick => TICK_TOPIC,
            Self::Signals => SIGNALS_TOPIC,
            Self::Arrival => ARRIVAL_TOPIC,
            Self::Decisions => DECISIONS_TOPIC,
            Self::Plans => PLANS_TOPIC,
        }
    }

    /// Name of the ROS 2 type of its messages.
    pub fn message_type(self) -> &'static str {
        match self {
            Self::Snapshot => SNAPSHOT_TYPE,
            Self::Event => EVENT_TYPE,
            Self::Command => COMMAND_TYPE,
            Self::Network => NETWORK_TYPE,
            Self::Trajectory => TRAJECTORY_TYPE,
            Self::Measured => MEASURED_TYPE,
            Self::Tick => TICK_TYPE,
            Self::Signals => SIGNALS_TYPE,
            Self::Arrival => ARRIVAL_TYPE,
            Self::Decisions => DECISIONS_TYPE,
            Self::Plans => PLANS_TYPE,
        }
    }

    /// Definition of that type, in a city with or without traffic signals.
    pub fn schema(self, has_signals: bool) -> Cow<'static, str> {
        Cow::Borrowed(match self {
            Self::Snapshot if has_signals => return Cow::Owned(snapshot_schema_with_signals()),
            Self::Snapshot => SNAPSHOT_SCHEMA,
            Self::Event => EVENT_SCHEMA,
            Self::Command => COMMAND_SCHEMA,
            Self::Network => NETWORK_SCHEMA,
            Self::Trajectory => TRAJECTORY_SCHEMA,
            Self::Measured => MEASURED_SCHEMA,
            Self::Tick => TICK_SCHEMA,
            Self::Signals => SIGNALS_SCHEMA,
            Self::Arrival => ARRIVAL_SCHEMA,
            Self::Decisions => DECISIONS_SCHEMA,
            Self::Plans => PLANS_SCHEMA,
        })
    }

    /// The topic of a command; `None` for commands that are not logged.
    pub fn of_command(command: &SimCommand) -> Option<Self> {
        Some(match command {
            SimCommand::Follow(_) => Self::Trajectory,
            SimCommand::Measure(..) => Self::Measured,
            SimCommand::Signals(_) => Self::Signals,
            SimCommand::Spawn(_) => Self::Arrival,
            other => PersonCommand::of(other).map(|_| Self::Command)?,
        })
    }

    /// Appends the message of a command, applied in the step after a tick, to a buffer; `None` for commands that are not
    /// logged.
    pub fn encode(tick: u64, command: &SimCommand, buffer: &mut Vec<u8>) -> Option<Self> {
        let mut memory = || std::mem::take(buffer);
        let (topic, message) = match command {
            SimCommand::Follow(trajectory) => {
                (Self::Trajectory, encode_trajectory(tick, trajectory, memory()))
            }
            SimCommand::Measure(vehicle, pose) => {
                (Self::Measured, encode_measured(tick, *vehicle, pose, memory()))
            }
            SimCommand::Signals(aspects) => (Self::Signals, encode_signals(tick, aspects, memory())),
            SimCommand::Spawn(setup) => (Self::Arrival, encode_arrival(tick, setup, memory())),
            other => (Self::Command, encode_command(tick, PersonCommand::of(other)?, memory())),
        };
        *buffer = message;
        Some(topic)
    }
}
