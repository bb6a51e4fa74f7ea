//! Pictures throughout a run that nobody waits for: the vehicles that carry cameras, the ticks at which these are due, and
//! the run, which is simulated on demand or replayed from its log.

use city3d_control::SetupError;
use city3d_logbook::record::{LogEntry, LogOrigin, LogReader, RecordError};
use city3d_logbook::replay::{Replay, ReplayError};
use city3d_protocol::snapshot::{FrameSnapshot, VehicleId};
use city3d_protocol::wire::{Body, DecodeError};
use city3d_sensors::Sensor;
use city3d_simulation::runner::Run;
use city3d_simulation::scenario::{Experiment, PlannedVehicle};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use thiserror::Error;

/// Why a run cannot be captured.
#[derive(Debug, Error)]
pub enum CaptureError {
    /// The log cannot be read.
    #[error(transparent)]
    Log(#[from] RecordError),
    /// A vehicle that came over the link cannot be decoded from the log.
    #[error(transparent)]
    Decode(#[from] DecodeError),
    /// The control framework rejects a vehicle.
    #[error(transparent)]
    Setup(#[from] SetupError),
    /// The log cannot be replayed.
    #[error(transparent)]
    Replay(#[from] ReplayError),
    /// The replay has come to another state than the log, and would give wrong pictures.
    #[error(
        "tick {tick} differs from the log when it is simulated again, and so would the pictures; \
         city3d replay --verify tells more, and version {version}, which wrote the log, can draw it"
    )]
    Diverged {
        /// The first tick that differs.
        tick: u64,
        /// Version of City3D that wrote the log.
        version: String,
    },
    /// The log ends before the tick that was asked for.
    #[error("the log ends at {time_s} s")]
    LogEnd {
        /// Simulated time of the last tick of the log, seconds.
        time_s: f64,
    },
}

impl CaptureError {
    /// Whether what was asked for is wrong, rather than something having failed.
    pub fn is_bad_input(&self) -> bool {
        !matches!(self, Self::Diverged { .. } | Self::LogEnd { .. })
    }
}

/// A vehicle with its camera sensors: of a scenario, or one that came to a served city over the link.
#[derive(Clone, Debug)]
pub struct CameraCarrier {
    /// Number of the vehicle.
    pub id: VehicleId,
    /// Name of the vehicle.
    pub name: String,
    /// What it carries; empty if nothing.
    pub sensors: Vec<Sensor>,
}

impl CameraCarrier {
    /// The vehicles of an experiment.
    pub fn of_experiment(experiment: &Experiment) -> Vec<Self> {
        let carrier = |planned: &PlannedVehicle| Self {
            id: planned.id,
            name: planned.name.clone(),
            sensors: planned.sensors.clone(),
        };
        experiment.vehicles.iter().map(carrier).collect()
    }

    /// The vehicles of a log. Vehicles come over the link without sensors: number and name match them to those of the
    /// scenario.
    ///
    /// # Errors
    /// When the log cannot be read.
    pub fn of_log(path: &Path, experiment: &Experiment) -> Result<Vec<Self>, CaptureError> {
        let mut log = LogReader::open(path)?;
        if log.origin() != LogOrigin::Served {
            return Ok(Self::of_experiment(experiment));
        }
        let planned = Self::of_experiment(&log.planned()?);
        let mut carriers = BTreeMap::new();
        while let Some(entry) = log.read()? {
            let LogEntry::Network(command) = entry else { continue };
            if !Body::is_setup(command.kind) {
                continue;
            }
            let body = Body::from_log(command.kind, &command.body)?;
            let Body::Setup { setup, .. } = body else { continue };
            let known = planned.iter().find(|known| known.id == setup.id && known.name == setup.name);
            let carrier =
                known.cloned().unwrap_or(Self { id: setup.id, name: setup.name, sensors: Vec::new() });
            carriers.insert(setup.id, carrier);
        }
        Ok(carriers.into_values().collect())
    }
}

/// The ticks at which the cameras of a run are due.
#[derive(Clone, Debug)]
pub struct CaptureSchedule {
    from_s: f64,
    physics_hz: f64,
    last: u64,
    /// Simulated seconds from one picture to the next, by camera.
    every_s: Vec<f64>,
    /// Pictures taken so far, by camera.
    taken: Vec<u64>,
}

impl CaptureSchedule {
    /// Cameras with these periods in simulated seconds, which are all due at `from_s` first; `None` where the run ends
    /// before.
    pub fn new(from_s: f64, every_s: Vec<f64>, experiment: &Experiment) -> Option<Self> {
        let (rates, last) = (experiment.rates, experiment.ticks());
        if from_s > rates.time_s(last) {
            return None;
        }
        let taken = vec![0; every_s.len()];
        Some(Self { from_s, physics_hz: f64::from(rates.physics_hz), last, every_s, taken })
    }

    /// The tick nearest to the time at which a camera is due for the `count`-th time.
    fn tick(&self, every_s: f64, count: u64) -> u64 {
        ((self.from_s + count as f64 * every_s) * self.physics_hz).round() as u64
    }

    /// Whether at least `count` pictures follow.
    pub fn has(mut self, count: usize) -> bool {
        let mut found = 0;
        while found < count {
            let Some((_, due)) = self.next_due() else { return false };
            found += due.len();
        }
        true
    }

    /// The next due tick with the indices of its cameras; `None` at the end of the run.
    pub fn next_due(&mut self) -> Option<(u64, Vec<usize>)> {
        let periods = self.every_s.iter().zip(&self.taken);
        let due: Vec<u64> = periods.map(|(&every_s, &count)| self.tick(every_s, count)).collect();
        let next = due.iter().copied().min().filter(|&tick| tick <= self.last)?;
        let taken: Vec<usize> = (0..due.len()).filter(|&index| due[index] == next).collect();
        for &index in &taken {
            self.taken[index] += 1;
        }
        Some((next, taken))
    }
}

/// A run whose pictures are taken, without a clock.
#[derive(Debug)]
pub enum CapturedRun {
    /// A scenario that is simulated.
    Run(Box<Run>),
    /// A log that is replayed.
    Replay(Box<Replay>),
}

impl CapturedRun {
    /// A simulation at its first instant.
    ///
    /// # Errors
    /// [`CaptureError::Setup`].
    pub fn of_experiment(experiment: Arc<Experiment>) -> Result<Self, CaptureError> {
        Ok(Self::Run(Box::new(Run::new(experiment)?)))
    }

    /// A replay, which makes its first step.
    ///
    /// # Errors
    /// As for [`CapturedRun::advance`].
    pub fn of_replay(mut replay: Box<Replay>) -> Result<Self, CaptureError> {
        proceed(&mut replay)?;
        Ok(Self::Replay(replay))
    }

    /// The snapshot of now.
    pub fn snapshot(&self) -> &FrameSnapshot {
        match self {
            Self::Run(run) => run.snapshot(),
            Self::Replay(replay) => replay.snapshot(),
        }
    }

    /// Advances to a tick, or until `stop` is set; `progress` hears the simulated time.
    ///
    /// # Errors
    /// When the log cannot be replayed as far.
    pub fn advance(
        &mut self,
        tick: u64,
        stop: &AtomicBool,
        progress: &mut dyn FnMut(f64),
    ) -> Result<(), CaptureError> {
        while self.snapshot().tick < tick && !stop.load(Ordering::Relaxed) {
            match self {
                Self::Run(run) => drop(run.step()),
                Self::Replay(replay) => proceed(replay)?,
            }
            if self.snapshot().tick.is_multiple_of(100) {
                progress(self.snapshot().time_s);
            }
        }
        progress(self.snapshot().time_s);
        Ok(())
    }
}

/// Replays one tick and checks its digest.
fn proceed(replay: &mut Replay) -> Result<(), CaptureError> {
    match replay.step()? {
        Some(ticked) if ticked.agrees() => Ok(()),
        Some(ticked) => {
            Err(CaptureError::Diverged { tick: ticked.tick, version: replay.log().version().to_owned() })
        }
        None => Err(CaptureError::LogEnd { time_s: replay.snapshot().time_s }),
    }
}
