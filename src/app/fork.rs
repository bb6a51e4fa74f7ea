//! `city3d run LOG --from-tick N`: a recorded run that goes on otherwise from the middle.

use super::files::{Files, LogArgs, log_of};
use super::run::drive;
use super::{Failure, Model, ProfileArg, ScenarioArgs, load, progress, replay};
use crate::environment::Profile;
use crate::record::{Origin, is_log};
use crate::replay::Replay;
use crate::runner::{Control, Run, Summary};
use crate::scenario::Experiment;
use crate::snapshot::{ModelKind, SimCommand};
use crate::wire::Measurement;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// What a fork begins with.
pub struct Fork<'a> {
    /// The log, and what the command line changes.
    pub args: &'a ScenarioArgs,
    pub from_tick: u64,
    /// The scenario from there on; without one that of the log.
    pub scenario: Option<&'a String>,
    pub log: LogArgs,
}

impl Fork<'_> {
    /// Makes the run again up to the tick, and goes on; gives its experiment as it is from there on, and the folder that
    /// was chosen for its files.
    pub fn run(
        &self,
        folder: impl FnOnce(&Experiment) -> PathBuf,
    ) -> Result<(Summary, Arc<Experiment>, PathBuf), Failure> {
        let path = &log_of(Path::new(&self.args.scenario));
        if !is_log(path) {
            return Err(Failure::bad_input(format!(
                "{}: --from-tick goes on from the log of a run; give its run.mcap",
                path.display()
            )));
        }
        let mut replay = Replay::open(path).map_err(replay::failure)?;
        replay::warn_of_version(&replay);
        if replay.log().origin() != Origin::Run {
            return Err(Failure::bad_input(format!(
                "{}: the vehicles of this log were driven over the link, and their routes are not in it; give the \
                 log of city3d run or of the window",
                path.display()
            )));
        }
        let original = Arc::clone(replay.experiment());
        let changed = Arc::new(self.changed(&original)?);
        if changed.ticks() <= self.from_tick {
            return Err(Failure::bad_input(format!(
                "the run would end at tick {}, before it goes on from tick {}; give a longer --duration",
                changed.ticks(),
                self.from_tick
            )));
        }
        let folder = folder(&changed);
        if log_of(&folder).canonicalize().is_ok_and(|there| path.canonicalize().is_ok_and(|log| log == there))
        {
            return Err(Failure::bad_input(format!(
                "--out {}: the log that the run goes on from lies there and would be written over; choose another folder",
                folder.display()
            )));
        }
        let mut files = Files::begin(Some(folder.clone()), &changed, Origin::Run, self.log)?;
        let bar = progress::simulated_seconds(changed.duration_s);
        let control = self.remake(&mut replay, &original, &mut files)?;
        let run = Run::resume(replay.into_world(), control(&changed)?);
        let summary = drive(run, &changed, files, None, &bar)?;
        Ok((summary, changed, folder))
    }

    fn changed(&self, original: &Experiment) -> Result<Experiment, Failure> {
        if let Some((vehicle, _)) = original.physical().next() {
            return Err(Failure::bad_input(format!(
                "vehicle {} of this run is physical: what its robot would have done is not in the log",
                vehicle.id
            )));
        }
        let Some(scenario) = self.scenario else {
            if self.args.seed.is_some() || self.args.model.is_some() || self.args.environment.is_some() {
                return Err(Failure::bad_input("--seed, --model and --environment need --scenario here"));
            }
            let duration_s = self.args.duration.unwrap_or(original.duration_s);
            return Ok(Experiment { duration_s, ..original.clone() });
        };
        // What the command line changed of the log stays changed, unless it is changed again.
        let model = original.model.and_then(|model| match model {
            ModelKind::Raycast => Some(Model::Raycast),
            ModelKind::Bicycle => Some(Model::Bicycle),
            ModelKind::Measured => None,
        });
        let profile = original.profile.map(|profile| match profile {
            Profile::Ideal => ProfileArg::Ideal,
            Profile::Testbed => ProfileArg::Testbed,
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
                "{scenario} cannot go on from the middle of this run: {}. Drivers, controllers, the right of way, the \
                 environment, the seed and the duration may change",
                wrong.join("; ")
            )));
        }
        Ok(Experiment::clone(&changed))
    }

    /// Simulates the log again up to the tick, with the control framework beside it: it sees what it saw then, and
    /// comes to the state that it had.
    fn remake(
        &self,
        replay: &mut Replay,
        original: &Experiment,
        files: &mut Files,
    ) -> Result<impl FnOnce(&Experiment) -> Result<Control, Failure> + use<>, Failure> {
        let mut control = Control::new(original).map_err(Failure::bad_input)?;
        let (mut delivered, mut is_as_told) = (Vec::new(), true);
        loop {
            let (tick, time_s) = (replay.snapshot().tick, replay.snapshot().time_s);
            let seen: Vec<Measurement> = Measurement::all(replay.snapshot(), original.scale).collect();
            let Some(ticked) = replay.step().map_err(replay::failure)? else {
                return Err(Failure::bad_input(format!(
                    "the log ends at tick {tick}: --from-tick has to be no more than that"
                )));
            };
            if !ticked.agrees() {
                return Err(Failure::failed(format!(
                    "tick {} of the run that was simulated again differs from the log: it cannot go on from there \
                     (city3d replay {} --verify)",
                    ticked.tick, self.args.scenario
                )));
            }
            if ticked.tick == 0 {
                files.first(replay.snapshot())?;
            } else {
                delivered.clear();
                control.step((tick, time_s), seen.into_iter(), &mut delivered);
                let mut told: Vec<SimCommand> =
                    delivered.drain(..).map(|message| message.into_command(original.scale)).collect();
                told.sort_by_key(SimCommand::order);
                let is_control = |command: &&SimCommand| matches!(command, SimCommand::Follow(_));
                is_as_told &= told.iter().filter(is_control).eq(replay.applied().iter().filter(is_control));
                files.commands(tick, time_s, replay.applied());
                files.tick(Some(control.mainframe()), replay.snapshot())?;
            }
            if ticked.tick == self.from_tick {
                break;
            }
        }
        if !is_as_told {
            tracing::warn!(
                "the control framework, run again, has not told the vehicles what the log says; it goes on from \
                 what it has seen"
            );
        }
        Ok(move |changed: &Experiment| {
            control.change(changed).map_err(Failure::bad_input)?;
            Ok(control)
        })
    }
}

/// What the past of a run depends on, and another scenario has otherwise.
fn differences(original: &Experiment, changed: &Experiment) -> Vec<String> {
    let mut wrong = Vec::new();
    let mut check = |same: bool, what: &str| {
        if !same {
            wrong.push(what.to_owned());
        }
    };
    check(original.map_bytes == changed.map_bytes, "its map is another one");
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
