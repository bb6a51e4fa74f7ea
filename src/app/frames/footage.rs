//! What is drawn: a scenario that is simulated as the pictures need it, or the run of a log, simulated again.

use super::super::files::log_of;
use super::super::replay::{failure, warn_of_version};
use super::super::{Failure, ScenarioArgs, load, progress};
use super::carriers::{self, Carrier};
use crate::record::{is_log, last_tick};
use crate::replay::Replay;
use crate::runner::Run;
use crate::scenario::{Experiment, shipped_scenarios};
use crate::snapshot::FrameSnapshot;
use std::path::Path;
use std::sync::Arc;

pub(super) enum Footage {
    Scenario(Arc<Experiment>),
    /// With how long it shall go on, and who was there.
    Log(Box<Replay>, Arc<Experiment>, Vec<Carrier>),
}

impl Footage {
    pub(super) fn of(args: &ScenarioArgs) -> Result<Self, Failure> {
        // A folder may be called as a shipped scenario is, which goes first.
        let is_shipped = shipped_scenarios().any(|name| name == args.scenario);
        let path = Path::new(&args.scenario);
        let path = &if is_shipped { path.to_path_buf() } else { log_of(path) };
        if !is_log(path) {
            return load::experiment(args).map(Self::Scenario);
        }
        if args.seed.is_some() || args.model.is_some() || args.environment.is_some() {
            return Err(Failure::bad_input(
                "a log stays as it was recorded: leave --seed, --model and --environment out, or give a scenario",
            ));
        }
        let (last, torn) = last_tick(path).map_err(Failure::bad_input)?;
        let replay = Replay::open(path).map_err(failure)?;
        warn_of_version(&replay);
        let recorded_s = replay.experiment().rates.time_s(last);
        if let Some(why) = torn {
            tracing::warn!("{}: {why}; its pictures end at {recorded_s} s", path.display());
        }
        let duration_s = args.duration.unwrap_or(recorded_s).min(recorded_s);
        let experiment = Experiment { duration_s, ..Experiment::clone(replay.experiment()) };
        let carriers = carriers::of_log(path, &experiment)?;
        Ok(Self::Log(Box::new(replay), Arc::new(experiment), carriers))
    }

    /// The vehicles that may carry cameras.
    pub(super) fn carriers(&self) -> Vec<Carrier> {
        match self {
            Self::Scenario(experiment) => carriers::of_experiment(experiment),
            Self::Log(.., carriers) => carriers.clone(),
        }
    }

    /// Its duration is that of the pictures.
    pub(super) fn experiment(&self) -> &Arc<Experiment> {
        match self {
            Self::Scenario(experiment) | Self::Log(_, experiment, _) => experiment,
        }
    }

    /// Begins with the first instant.
    pub(super) fn begin(self) -> Result<Reel, Failure> {
        match self {
            Self::Scenario(experiment) => {
                Run::new(experiment).map(Box::new).map(Reel::Run).map_err(Failure::bad_input)
            }
            Self::Log(mut replay, ..) => {
                proceed(&mut replay)?;
                Ok(Reel::Replay(replay))
            }
        }
    }
}

/// Footage that is under way.
pub(super) enum Reel {
    Run(Box<Run>),
    Replay(Box<Replay>),
}

impl Reel {
    pub(super) fn snapshot(&self) -> &FrameSnapshot {
        match self {
            Self::Run(run) => run.snapshot(),
            Self::Replay(replay) => replay.snapshot(),
        }
    }

    /// Goes on to a tick.
    pub(super) fn advance(&mut self, tick: u64, bar: &progress::Progress) -> Result<(), Failure> {
        while self.snapshot().tick < tick {
            match self {
                Self::Run(run) => drop(run.step()),
                Self::Replay(replay) => proceed(replay)?,
            }
            if self.snapshot().tick.is_multiple_of(100) {
                progress::show(bar, self.snapshot().time_s);
            }
        }
        progress::show(bar, self.snapshot().time_s);
        Ok(())
    }
}

/// One tick, which has to be the recorded one: other pictures are none of the run.
fn proceed(replay: &mut Replay) -> Result<(), Failure> {
    match replay.step().map_err(failure)? {
        Some(ticked) if ticked.agrees() => Ok(()),
        Some(ticked) => Err(Failure::failed(format!(
            "tick {} of the run that was simulated again differs from the log, and so would the pictures; \
             city3d replay --verify tells more, and the version that wrote the log, {}, draws it",
            ticked.tick,
            replay.log().version()
        ))),
        None => Err(Failure::failed(format!("the log ends at {} s", replay.snapshot().time_s))),
    }
}
