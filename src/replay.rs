//! Runs that are made again from their logs: the world alone, moved by the recorded commands, and held
//! against the digest of every tick.

use crate::digest;
use crate::record::{Entry, LogReader, LoggedSnapshot, LoggedVehicle, NetworkCommand, Origin, RecordError};
use crate::scenario::Experiment;
use crate::sim::World;
use crate::snapshot::{FrameSnapshot, SimCommand, VehicleId};
use crate::wire::Body;
use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;
use thiserror::Error;

/// A log from which no run can be made again.
#[derive(Debug, Error)]
pub enum ReplayError {
    #[error(transparent)]
    Log(#[from] RecordError),
    #[error(
        "the log is that of the control framework, which has no world of its own; \
         give the log of the city that it drove in (city3d serve --out)"
    )]
    Mainframe,
    #[error("the log is one of poses that were measured elsewhere: there is no world to simulate again")]
    Recorded,
    #[error(
        "the log is of revision {found} of the simulation, written by version {version}, and this is revision {known}: \
         their states differ in some bits. Simulate it again with the version that wrote it; city3d replay LOG shows it \
         in the window"
    )]
    Revision { found: u32, known: u32, version: String },
    #[error("the log goes from tick {from} to tick {to}: it lacks what lies between")]
    Gap { from: u64, to: u64 },
    #[error("tick {tick}: what came over the link is damaged: {reason}")]
    Network { tick: u64, reason: String },
}

/// Digests of one tick: of the log, and of the world that was simulated again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ticked {
    pub tick: u64,
    pub recorded: u64,
    pub simulated: u64,
}

impl Ticked {
    pub fn agrees(&self) -> bool {
        self.recorded == self.simulated
    }
}

/// A vehicle whose state differs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Difference {
    pub vehicle: VehicleId,
    /// How far apart the two are; `None` where only one of them is there.
    pub apart_m: Option<f64>,
}

/// Where the vehicles of a log and of the world differ.
#[derive(Clone, Debug, PartialEq)]
pub struct Differences {
    /// That of the snapshot in the log: the first one not before the tick that was asked for.
    pub tick: u64,
    /// In id order; none where the difference is finer than the log's snapshots.
    pub vehicles: Vec<Difference>,
}

/// A log whose run is simulated again, tick by tick.
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
    /// Opens a log, with its world before the first tick.
    ///
    /// # Errors
    /// Where it is no log from which a run can be made again.
    pub fn open(path: &Path) -> Result<Self, ReplayError> {
        let log = LogReader::open(path)?;
        if !log.origin().has_world() {
            let is_recorded = log.origin() == Origin::Recorded;
            return Err(if is_recorded { ReplayError::Recorded } else { ReplayError::Mainframe });
        }
        let (found, known) = (log.revision(), digest::REVISION);
        if found != known {
            return Err(ReplayError::Revision { found, known, version: log.version().to_owned() });
        }
        let world = World::new(Arc::new(log.experiment()?));
        Ok(Self { snapshot: world.snapshot(), log, world, commands: Vec::new(), applied: Vec::new() })
    }

    pub fn experiment(&self) -> &Arc<Experiment> {
        self.world.experiment()
    }

    pub fn log(&self) -> &LogReader {
        &self.log
    }

    /// The commands of the last step, in the order in which they were applied.
    pub fn applied(&self) -> &[SimCommand] {
        &self.applied
    }

    /// The world as it is now, and what was told of it last.
    pub fn into_world(self) -> World {
        self.world
    }

    /// The world as it was simulated again.
    pub fn snapshot(&self) -> &FrameSnapshot {
        &self.snapshot
    }

    /// Simulates on to the next tick of the log; `None` at its end.
    ///
    /// # Errors
    /// Where the log lacks something or cannot be read.
    pub fn step(&mut self) -> Result<Option<Ticked>, ReplayError> {
        while let Some(entry) = self.log.read()? {
            match entry {
                Entry::Tick { tick, state_hash } => return self.advance(tick, state_hash).map(Some),
                other => self.collect(other)?,
            }
        }
        Ok(None)
    }

    fn collect(&mut self, entry: Entry) -> Result<(), ReplayError> {
        match entry {
            Entry::Command { command, .. } => self.commands.push(command),
            Entry::Network(command) => {
                let commands = commands_of(&command, self.world.experiment())
                    .map_err(|reason| ReplayError::Network { tick: command.tick, reason })?;
                self.commands.extend(commands);
            }
            Entry::Tick { .. } | Entry::Snapshot(_) | Entry::Event(_) => {}
        }
        Ok(())
    }

    fn advance(&mut self, tick: u64, recorded: u64) -> Result<Ticked, ReplayError> {
        let from = self.world.tick();
        self.world.tick_as_given(&self.commands, &mut self.snapshot);
        std::mem::swap(&mut self.commands, &mut self.applied);
        self.commands.clear();
        if self.world.tick() != tick {
            return Err(ReplayError::Gap { from, to: tick });
        }
        // The clock of a run in one process starts with its first step.
        if tick == 0 && self.log.origin() == Origin::Run {
            self.commands.push(SimCommand::Start);
        }
        Ok(Ticked { tick, recorded, simulated: self.snapshot.state_hash })
    }

    /// The vehicles that differ in the next snapshot of the log, which is that of the present tick where
    /// the log has one; `None` where none follows.
    ///
    /// # Errors
    /// As for [`Replay::step`].
    pub fn differences(&mut self) -> Result<Option<Differences>, ReplayError> {
        while let Some(entry) = self.log.read()? {
            match entry {
                Entry::Tick { tick, state_hash } => drop(self.advance(tick, state_hash)?),
                Entry::Snapshot(logged) if logged.tick == self.snapshot.tick => {
                    return Ok(Some(self.compare(&logged)));
                }
                other => self.collect(other)?,
            }
        }
        Ok(None)
    }

    fn compare(&self, logged: &LoggedSnapshot) -> Differences {
        let simulated: Vec<LoggedVehicle> = self.snapshot.vehicles.iter().map(LoggedVehicle::of).collect();
        let all = logged.vehicles.iter().chain(&simulated).map(|vehicle| vehicle.id);
        let find = |list: &[LoggedVehicle], id| list.iter().find(|vehicle| vehicle.id == id).cloned();
        let difference = |vehicle| match (find(&logged.vehicles, vehicle), find(&simulated, vehicle)) {
            (Some(a), Some(b)) if a == b => None,
            (Some(a), Some(b)) => {
                Some(Difference { vehicle, apart_m: Some(a.position.distance(b.position)) })
            }
            _ => Some(Difference { vehicle, apart_m: None }),
        };
        let ids: BTreeSet<VehicleId> = all.collect();
        Differences { tick: logged.tick, vehicles: ids.into_iter().filter_map(difference).collect() }
    }
}

/// What the city has done with something that came over the link.
///
/// # Errors
/// In words, where it is damaged.
pub fn commands_of(command: &NetworkCommand, experiment: &Experiment) -> Result<Vec<SimCommand>, String> {
    let body = Body::from_log(command.kind, &command.body).map_err(|error| error.to_string())?;
    body.into_commands(experiment.scale, &experiment.vehicle_types)
}
