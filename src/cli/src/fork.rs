//! `city3d run LOG --from-tick N`: forks a recorded run at a tick, by replay up to it.

use super::files::{LogArgs, log_of};
use super::run::{files_of, simulate_rest};
use super::{Failure, ModelArg, ProfileArg, ScenarioArgs, load, progress, replay};
use city3d_logbook::record::{LogOrigin, is_log};
use city3d_logbook::replay::Replay;
use city3d_protocol::snapshot::{ModelKind, SimCommand};
use city3d_protocol::wire::Measurement;
use city3d_session::{Inputs, Moment, RunFiles};
use city3d_simulation::environment::EnvironmentProfile;
use city3d_simulation::runner::{ControlLoop, Run, Summary};
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
    /// folder of the files.
    pub fn run(
        &self,
        folder: impl FnOnce(&Experiment) -> PathBuf,
    ) -> Result<(Summary, Arc<Experiment>, PathBuf), Failure> {
        let path = &log_of(Path::new(&self.args.scenario));
        if !is_log(path) {
            return Err(Failure::bad_input(format!(
                "{}: --from-tick continues a recorded run; give its run.mcap",
                path.display()
            )));
        }
        let mut replay = Replay::open(path).map_err(replay::failure)?;
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
        if log_of(&folder).canonicalize().is_ok_and(|there| path.canonicalize().is_ok_and(|log| log == there))
        {
            return Err(Failure::bad_input(format!(
                "--out {}: this folder has the log that is to be continued, and would lose it; choose another folder",
                folder.display()
            )));
        }
        let mut files = files_of(Some(folder.clone()), self.log);
        files.begin(&changed)?;
        let bar = progress::simulated_seconds(changed.duration_s);
        let control = self.replay_until_fork(&mut replay, &original, &mut files)?;
        let run = Run::resume(replay.into_world(), control(&changed)?);
        let summary = simulate_rest(run, &changed, files, None, bar)?;
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
            if self.args.seed.is_some() || self.args.model.is_some() || self.args.environment.is_some() {
                return Err(Failure::bad_input(
                    "with --from-tick, --seed, --model and --environment need --scenario",
                ));
            }
            let duration_s = self.args.duration.unwrap_or(original.duration_s);
            return Ok(Experiment { duration_s, ..original.clone() });
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
        let args = ScenarioArgs {
            scenario: scenario.clone(),
            seed: self.args.seed.or(Some(original.seed)),
            duration: self.args.duration,
            model: self.args.model.or(model),
            environment: self.args.environment.or(profile),
        };
        let changed = load::experiment(&args)?;
        let wrong = differences(original, &changed);
        if !wrong.is_empty() {
            return Err(Failure::bad_input(format!(
                "{scenario} cannot continue this run: {}. Only drivers, controllers, the right of way, \
                 the environment, the seed and the duration may change",
                wrong.join("; ")
            )));
        }
        Ok(Experiment::clone(&changed))
    }

    /// Replays the log up to the tick, with the control framework beside it, which so reaches its state of then.
    fn replay_until_fork(
        &self,
        replay: &mut Replay,
        original: &Arc<Experiment>,
        files: &mut RunFiles,
    ) -> Result<impl FnOnce(&Experiment) -> Result<ControlLoop, Failure> + use<>, Failure> {
        let mut control = ControlLoop::new(original).map_err(Failure::bad_input)?;
        let (mut delivered, mut is_same) = (Vec::new(), true);
        loop {
            let (tick, time_s) = (replay.snapshot().tick, replay.snapshot().time_s);
            let seen: Vec<Measurement> = Measurement::all(replay.snapshot(), original.scale).collect();
            let Some(ticked) = replay.step().map_err(replay::failure)? else {
                return Err(Failure::bad_input(format!(
                    "the log ends at tick {tick}; give --from-tick this tick or an earlier one"
                )));
            };
            if !ticked.agrees() {
                return Err(Failure::failed(format!(
                    "tick {} differs from the log when it is simulated again, so the run cannot be continued; \
                     city3d replay {} --verify tells more",
                    ticked.tick, self.args.scenario
                )));
            }
            if ticked.tick == 0 {
                files.record_or_fail(&Moment::first(original, replay.snapshot()))?;
            } else {
                delivered.clear();
                control.step((tick, time_s), seen.into_iter(), &mut delivered);
                let mut commands: Vec<SimCommand> =
                    delivered.drain(..).map(|message| message.into_command(original.scale)).collect();
                commands.sort_by_key(SimCommand::order);
                let is_control = |command: &&SimCommand| matches!(command, SimCommand::Follow(_));
                is_same &= commands.iter().filter(is_control).eq(replay.applied().iter().filter(is_control));
                let inputs = Inputs::Commands(replay.applied());
                let (snapshot, mainframe) = (replay.snapshot(), Some(control.mainframe()));
                let moment = Moment::tick(original, snapshot, inputs, mainframe, (tick, time_s));
                files.record_or_fail(&moment)?;
            }
            if ticked.tick == self.from_tick {
                break;
            }
        }
        if !is_same {
            tracing::warn!(
                "the control framework, simulated again, sends other trajectories than the log has; it continues \
                 from its own state"
            );
        }
        Ok(move |changed: &Experiment| {
            control.change(changed).map_err(Failure::bad_input)?;
            Ok(control)
        })
    }
}

/// Differences from the original that its past depends on.
fn differences(original: &Experiment, changed: &Experiment) -> Vec<String> {
    let mut wrong = Vec::new();
    let mut check = |same: bool, what: &str| {
        if !same {
            wrong.push(what.to_owned());
        }
    };
    check(original.map_bytes == changed.map_bytes, "its map differs");
    check(original.scale == changed.scale, "its length_scale differs");
    check(original.rates == changed.rates, "its [rates] differ");
    check(original.link_timeout_s == changed.link_timeout_s, "its link_timeout_s differs");
    let ids =
        |experiment: &Experiment| experiment.vehicles.iter().map(|vehicle| vehicle.id).collect::<Vec<_>>();
    if ids(original) != ids(changed) {
        wrong.push("it has other vehicles".to_owned());
        return wrong;
    }
    for (a, b) in original.vehicles.iter().zip(&changed.vehicles) {
        let parts = [
            (a.name == b.name, "name"),
            (a.start == b.start, "start (route, at_m, speed_mps)"),
            (a.route == b.route, "route"),
            (a.spec == b.spec, "vehicle type"),
            (a.is_human == b.is_human, "person at the wheel"),
        ];
        let other: Vec<&str> = parts.into_iter().filter(|(same, _)| !same).map(|(_, what)| what).collect();
        if !other.is_empty() {
            wrong.push(format!("vehicle {} ({}) has another {}", a.id, a.name, other.join(", ")));
        }
    }
    wrong
}
