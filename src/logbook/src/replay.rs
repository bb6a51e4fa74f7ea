//! Deterministic replay: simulates the world again from the recorded commands and compares its state digest with the
//! log at every tick.

use crate::record::{
    LogEntry, LogOrigin, LogReader, LoggedSnapshot, LoggedVehicle, NetworkCommand, RecordError,
};
use city3d_geometry::digest;
use city3d_protocol::snapshot::{FrameSnapshot, Setup, SimCommand, VehicleId};
use city3d_protocol::wire::Body;
use city3d_simulation::scenario::Experiment;
use city3d_simulation::sim::World;
use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;
use thiserror::Error;

/// A log that cannot be replayed.
#[derive(Debug, Error)]
pub enum ReplayError {
    /// The log cannot be read.
    #[error(transparent)]
    Log(#[from] RecordError),
    /// The log is of [`LogOrigin::Mainframe`].
    #[error(
        "the log is that of the control framework, which has no world of its own; \
         give the log of the city that it drove in (city3d serve --out)"
    )]
    Mainframe,
    /// The log is of [`LogOrigin::Recorded`].
    #[error("the log has poses that were measured elsewhere: there is no world to simulate again")]
    Recorded,
    /// The log is of another revision of the simulation than [`digest::REVISION`].
    #[error(
        "the log is of revision {found} of the simulation, written by version {version}, and this is revision {known}: \
         their states differ in some bits. Simulate it again with the version that wrote it; city3d replay LOG shows it \
         in the window"
    )]
    Revision {
        /// Revision in the log.
        found: u32,
        /// Revision of this program, [`digest::REVISION`].
        known: u32,
        /// Version of City3D that wrote the log.
        version: String,
    },
    /// The ticks of the log are not consecutive.
    #[error("the log goes from tick {from} to tick {to}: the ticks between them are missing")]
    Gap {
        /// Last tick that the replay has simulated.
        from: u64,
        /// Next tick in the log.
        to: u64,
    },
    /// A vehicle enters that the scenario of the log does not have.
    #[error("tick {tick}: vehicle {vehicle} enters, and no inflow of the log's scenario has it")]
    Arrival {
        /// Tick at the beginning of the step that it enters in.
        tick: u64,
        /// The unknown vehicle.
        vehicle: VehicleId,
    },
    /// A logged datagram of the laboratory's link cannot be decoded into commands.
    #[error("tick {tick}: what came over the link is damaged: {reason}")]
    Network {
        /// Tick at the beginning of the step that carried the datagram out.
        tick: u64,
        /// What is wrong with the datagram, in words.
        reason: String,
    },
}

/// State digests of one tick: recorded and simulated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TickDigests {
    /// Physics steps since the start or the last reset.
    pub tick: u64,
    /// Digest of the state in the log.
    pub recorded: u64,
    /// Digest of the state that the replay has come to.
    pub simulated: u64,
}

impl TickDigests {
    /// Whether the replay has come to the recorded state.
    pub fn agrees(&self) -> bool {
        self.recorded == self.simulated
    }
}

/// A vehicle whose simulated state differs from the log.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VehicleDifference {
    /// Number of the vehicle, unique in the run.
    pub vehicle: VehicleId,
    /// Distance between the two positions; `None` where only one of them exists.
    /// City metres.
    pub apart_m: Option<f64>,
}

/// Where the vehicles of a log and of the world differ.
#[derive(Clone, Debug, PartialEq)]
pub struct StateDifferences {
    /// Tick of the compared snapshot: the first one in the log not before the requested tick.
    pub tick: u64,
    /// In id order; none where the difference is finer than the log's snapshots.
    pub vehicles: Vec<VehicleDifference>,
}

/// A deterministic replay of a log, tick by tick.
#[derive(Debug)]
pub struct Replay {
    log: LogReader,
    world: World,
    snapshot: FrameSnapshot,
    /// For the next step, in the order in which they were applied.
    commands: Vec<SimCommand>,
    /// Those of the last step.
    applied: Vec<SimCommand>,
}

impl Replay {
    /// Opens a log and builds its world before the first tick.
    ///
    /// # Errors
    /// [`ReplayError`] where the log cannot be replayed.
    pub fn open(path: &Path) -> Result<Self, ReplayError> {
        let log = LogReader::open(path)?;
        if !log.origin().has_world() {
            let is_recorded = log.origin() == LogOrigin::Recorded;
            return Err(if is_recorded { ReplayError::Recorded } else { ReplayError::Mainframe });
        }
        let (found, known) = (log.revision(), digest::REVISION);
        if found != known {
            return Err(ReplayError::Revision { found, known, version: log.version().to_owned() });
        }
        let world = World::new(Arc::new(log.experiment()?));
        Ok(Self { snapshot: world.snapshot(), log, world, commands: Vec::new(), applied: Vec::new() })
    }

    /// The experiment of the log: scenario, map and settings of the simulated world.
    pub fn experiment(&self) -> &Arc<Experiment> {
        self.world.experiment()
    }

    /// The log, read as far as the replay has come.
    pub fn log(&self) -> &LogReader {
        &self.log
    }

    /// The commands of the last step, in the order in which they were applied.
    pub fn applied(&self) -> &[SimCommand] {
        &self.applied
    }

    /// The world in its present state.
    pub fn into_world(self) -> World {
        self.world
    }

    /// The simulated snapshot.
    pub fn snapshot(&self) -> &FrameSnapshot {
        &self.snapshot
    }

    /// Simulates to the next tick of the log; `None` at its end.
    ///
    /// # Errors
    /// Where the log lacks something or cannot be read.
    pub fn step(&mut self) -> Result<Option<TickDigests>, ReplayError> {
        while let Some(entry) = self.log.read()? {
            match entry {
                LogEntry::Tick { tick, state_hash } => return self.advance(tick, state_hash).map(Some),
                other => self.collect(other)?,
            }
        }
        Ok(None)
    }

    fn collect(&mut self, entry: LogEntry) -> Result<(), ReplayError> {
        match entry {
            LogEntry::Command { command, .. } => self.commands.push(command),
            LogEntry::Network(command) => {
                let commands = commands_of(&command, self.world.experiment())
                    .map_err(|reason| ReplayError::Network { tick: command.tick, reason })?;
                self.commands.extend(commands);
            }
            LogEntry::Arrival { tick, vehicle, speed_mps } => {
                let experiment = self.world.experiment();
                let arrival = experiment.arrival(vehicle).ok_or(ReplayError::Arrival { tick, vehicle })?;
                let setup = arrival.vehicle.setup(&experiment.city_map, experiment.scale);
                self.commands.push(SimCommand::Spawn(Box::new(Setup { speed_mps, ..setup })));
            }
            LogEntry::Tick { .. }
            | LogEntry::Snapshot(_)
            | LogEntry::Event(_)
            | LogEntry::Decisions(_)
            | LogEntry::Plans(_) => {}
        }
        Ok(())
    }

    fn advance(&mut self, tick: u64, recorded: u64) -> Result<TickDigests, ReplayError> {
        let from = self.world.tick();
        self.world.tick_as_given(&self.commands, &mut self.snapshot);
        std::mem::swap(&mut self.commands, &mut self.applied);
        self.commands.clear();
        if self.world.tick() != tick {
            return Err(ReplayError::Gap { from, to: tick });
        }
        // The clock of a run in one process starts with its first step.
        if tick == 0 && self.log.origin() == LogOrigin::Run {
            self.commands.push(SimCommand::Start);
        }
        Ok(TickDigests { tick, recorded, simulated: self.snapshot.state_hash })
    }

    /// The vehicles that differ in the next snapshot of the log, which is that of the present tick where
    /// the log has one; `None` where none follows.
    ///
    /// # Errors
    /// As for [`Replay::step`].
    pub fn differences(&mut self) -> Result<Option<StateDifferences>, ReplayError> {
        while let Some(entry) = self.log.read()? {
            match entry {
                LogEntry::Tick { tick, state_hash } => drop(self.advance(tick, state_hash)?),
                LogEntry::Snapshot(logged) if logged.tick == self.snapshot.tick => {
                    return Ok(Some(self.compare(&logged)));
                }
                other => self.collect(other)?,
            }
        }
        Ok(None)
    }

    fn compare(&self, logged: &LoggedSnapshot) -> StateDifferences {
        let simulated: Vec<LoggedVehicle> = self.snapshot.vehicles.iter().map(LoggedVehicle::of).collect();
        let all = logged.vehicles.iter().chain(&simulated).map(|vehicle| vehicle.id);
        let find = |list: &[LoggedVehicle], id| list.iter().find(|vehicle| vehicle.id == id).cloned();
        let difference = |vehicle| match (find(&logged.vehicles, vehicle), find(&simulated, vehicle)) {
            (Some(a), Some(b)) if a == b => None,
            (Some(a), Some(b)) => {
                Some(VehicleDifference { vehicle, apart_m: Some(a.position.distance(b.position)) })
            }
            _ => Some(VehicleDifference { vehicle, apart_m: None }),
        };
        let ids: BTreeSet<VehicleId> = all.collect();
        StateDifferences { tick: logged.tick, vehicles: ids.into_iter().filter_map(difference).collect() }
    }
}

/// Decodes the commands of a logged datagram.
///
/// # Errors
/// The reason, where it is damaged.
pub fn commands_of(command: &NetworkCommand, experiment: &Experiment) -> Result<Vec<SimCommand>, String> {
    let body = Body::from_log(command.kind, &command.body).map_err(|error| error.to_string())?;
    body.into_commands(experiment.scale, &experiment.vehicle_types)
}
