//! `city3d run LOG --from-tick N`: forks a recorded run at a tick, by replay up to it.

use super::files::{LogArgs, log_of};
use super::run::{files_of, simulate_rest};
use super::{ChangeArgs, Failure, ModelArg, ProfileArg, ScenarioArgs, load, on_end, progress, replay};
use city3d_logbook::record::{LogOrigin, is_log};
use city3d_logbook::replay::Replay;
use city3d_protocol::snapshot::ModelKind;
use city3d_session::fork::{Fork, ForkError, differences};
use city3d_session::{Moment, RunFiles};
use city3d_simulation::environment::EnvironmentProfile;
use city3d_simulation::runner::Summary;
use city3d_simulation::scenario::Experiment;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Arguments of a forked run.
pub struct ForkedRun<'a> {
    /// The log, with the changes of the command line.
    pub args: &'a ScenarioArgs,
    pub from_tick: u64,
    /// The scenario after the fork; that of the log if `None`.
    pub scenario: Option<&'a String>,
    pub log: LogArgs,
}

impl ForkedRun<'_> {
    /// Replays the run up to the tick and simulates on; returns the summary, the experiment after the fork and the
    /// folder of the files. `set` sets what else the files shall have.
    pub fn run(
        &self,
        folder: impl FnOnce(&Experiment) -> PathBuf,
        set: impl FnOnce(RunFiles) -> RunFiles,
    ) -> Result<(Summary, Arc<Experiment>, PathBuf), Failure> {
        let path = &log_of(Path::new(&self.args.scenario));
        if !is_log(path) {
            return Err(Failure::bad_input(format!(
                "{}: --from-tick continues a recorded run; give its run.mcap",
                path.display()
            )));
        }
        let replay = Replay::open(path).map_err(replay::failure)?;
        replay::warn_of_version(&replay);
        if replay.log().origin() != LogOrigin::Run {
            return Err(Failure::bad_input(format!(
                "{}: this log has no routes of its vehicles, so its run cannot be continued; give the log of city3d \
                 run or of the window",
                path.display()
            )));
        }
        let original = Arc::clone(replay.experiment());
        let changed = Arc::new(self.changed(&original)?);
        if changed.ticks() <= self.from_tick {
            return Err(Failure::bad_input(format!(
                "the run would end at tick {}, and --from-tick is {}; give a longer --duration",
                changed.ticks(),
                self.from_tick
            )));
        }
        let folder = folder(&changed);
        let mut inputs = vec![path.clone()];
        inputs.extend(self.scenario.iter().flat_map(|scenario| load::inputs(scenario, &changed)));
        let claimed = self.log.options().claim_folder(&folder, &inputs)?;
        let stop = on_end()?;
        let mut files = set(files_of(Some(folder.clone()), self.log).in_claimed(Some(claimed)));
        files.begin(&changed)?;
        let bar = progress::simulated_seconds(changed.duration_s);
        let fork = match Fork::at(replay, self.from_tick, &mut files, &stop) {
            Err(ForkError::Stopped { last }) => {
                let summary = files.conclude(&Moment::first(&original, &last), true)?;
                return Ok((summary, changed, folder));
            }
            fork => fork.map_err(|error| self.failure(error))?,
        };
        if !fork.control_agrees() {
            tracing::warn!(
                "the control framework, simulated again, sends other trajectories than the log has; it continues \
                 from its own state"
            );
        }
        let run = fork.resume(&changed).map_err(|error| self.failure(error))?;
        let summary = simulate_rest(run, &changed, files, (None, stop), bar)?;
        Ok((summary, changed, folder))
    }

    fn changed(&self, original: &Experiment) -> Result<Experiment, Failure> {
        if let Some((vehicle, _)) = original.physical().next() {
            return Err(Failure::bad_input(format!(
                "vehicle {} of this run is physical; runs with physical vehicles cannot be continued from their logs",
                vehicle.id
            )));
        }
        let Some(scenario) = self.scenario else {
            if self.args.changed.has_more_than_duration() {
                return Err(Failure::bad_input(
                    "with --from-tick, --seed, --model, --environment and --set need --scenario",
                ));
            }
            let duration_s = self.args.changed.duration.unwrap_or(original.duration_s);
            return original.lasting(duration_s).map_err(Failure::bad_input);
        };
        // Changes by the command line of the log stay, unless they are changed again.
        let model = original.model.and_then(|model| match model {
            ModelKind::Raycast => Some(ModelArg::Raycast),
            ModelKind::Bicycle => Some(ModelArg::Bicycle),
            ModelKind::Measured => None,
        });
        let profile = original.profile.map(|profile| match profile {
            EnvironmentProfile::Ideal => ProfileArg::Ideal,
            EnvironmentProfile::Testbed => ProfileArg::Testbed,
        });
        let changed = ChangeArgs {
            seed: self.args.changed.seed.or(Some(original.seed)),
            model: self.args.changed.model.or(model),
            environment: self.args.changed.environment.or(profile),
            ..self.args.changed.clone()
        };
        let args = ScenarioArgs { scenario: scenario.clone(), changed };
        let changed = load::experiment(&args)?;
        let wrong = differences(original, &changed, self.from_tick);
        if !wrong.is_empty() {
            return Err(Failure::bad_input(format!(
                "{scenario} cannot continue this run: {}. Only drivers, controllers, the right of way, \
                 the environment, the seed and the duration may change",
                wrong.join("; ")
            )));
        }
        Ok(Experiment::clone(&changed))
    }

    fn failure(&self, error: ForkError) -> Failure {
        match error {
            ForkError::Setup(error) => Failure::bad_input(error),
            ForkError::Replay(error) => replay::failure(error),
            ForkError::Files(error) => error.into(),
            ForkError::LogEnd { .. } => {
                Failure::bad_input(format!("{error}; give --from-tick this tick or an earlier one"))
            }
            ForkError::Stopped { .. } => Failure::failed(error),
            ForkError::Diverged { .. } => {
                let log = &self.args.scenario;
                Failure::failed(format!("{error}; city3d replay {log} --verify tells more"))
            }
        }
    }
}
