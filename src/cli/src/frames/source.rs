//! Source of the frames: a scenario that is simulated on demand, or a log that is replayed.

use super::super::files::log_of;
use super::super::replay::{failure, warn_of_version};
use super::super::{Failure, ScenarioArgs, load};
use city3d_logbook::record::{is_log, last_tick};
use city3d_logbook::replay::Replay;
use city3d_session::capture::{CameraCarrier, CapturedRun};
use city3d_simulation::scenario::{Experiment, shipped_scenarios};
use std::path::{Path, PathBuf};
use std::sync::Arc;

pub(super) enum FrameSource {
    Scenario(Arc<Experiment>),
    /// Replay, experiment with the duration of the pictures, and vehicles.
    Log(Box<Replay>, Arc<Experiment>, Vec<CameraCarrier>),
}

impl FrameSource {
    pub(super) fn of(args: &ScenarioArgs) -> Result<Self, Failure> {
        // A shipped scenario wins over a folder of the same name.
        let is_shipped = shipped_scenarios().any(|name| name == args.scenario);
        let path = Path::new(&args.scenario);
        let path = &if is_shipped { path.to_path_buf() } else { log_of(path) };
        if !is_log(path) {
            return load::experiment(args).map(Self::Scenario);
        }
        if args.changed.has_more_than_duration() {
            return Err(Failure::bad_input(
                "--seed, --model, --environment and --set cannot change a recorded run; leave them out, or give a \
                 scenario",
            ));
        }
        let (last, truncation) = last_tick(path).map_err(Failure::bad_input)?;
        let replay = Replay::open(path).map_err(failure)?;
        warn_of_version(&replay);
        let recorded_s = replay.experiment().rates.time_s(last);
        if let Some(why) = truncation {
            tracing::warn!("{}: {why}; its pictures end at {recorded_s} s", path.display());
        }
        let duration_s = args.changed.duration.unwrap_or(recorded_s).min(recorded_s);
        let experiment = Experiment { duration_s, ..Experiment::clone(replay.experiment()) };
        let carriers = CameraCarrier::of_log(path, &experiment)?;
        Ok(Self::Log(Box::new(replay), Arc::new(experiment), carriers))
    }

    /// The files that it was read from, where these are no shipped ones.
    pub(super) fn inputs(&self, args: &ScenarioArgs) -> Vec<PathBuf> {
        match self {
            Self::Scenario(experiment) => load::inputs(&args.scenario, experiment),
            Self::Log(..) => vec![log_of(Path::new(&args.scenario))],
        }
    }

    /// The vehicles that may carry cameras.
    pub(super) fn carriers(&self) -> Vec<CameraCarrier> {
        match self {
            Self::Scenario(experiment) => CameraCarrier::of_experiment(experiment),
            Self::Log(.., carriers) => carriers.clone(),
        }
    }

    /// The experiment; its duration is that of the pictures.
    pub(super) fn experiment(&self) -> &Arc<Experiment> {
        match self {
            Self::Scenario(experiment) | Self::Log(_, experiment, _) => experiment,
        }
    }

    /// Starts the simulation or the replay at its first instant.
    pub(super) fn begin(self) -> Result<CapturedRun, Failure> {
        Ok(match self {
            Self::Scenario(experiment) => CapturedRun::of_experiment(experiment),
            Self::Log(replay, ..) => CapturedRun::of_replay(replay),
        }?)
    }
}
