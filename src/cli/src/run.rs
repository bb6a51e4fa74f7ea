//! `city3d run`: simulates a scenario from start to end.

use super::files::{LogArgs, conclude, new_folder};
use super::fork::ForkedRun;
use super::{Failure, ScenarioArgs, load, progress};
use city3d_logbook::record::{LogOrigin, is_log};
use city3d_session::RunFiles;
use city3d_simulation::runner::{Run, Summary};
use city3d_simulation::scenario::Experiment;
use clap::Args;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

#[derive(Debug, Args)]
pub struct RunArgs {
    #[command(flatten)]
    scenario: ScenarioArgs,
    /// Folder for run.mcap, vehicles.csv and summary.json [default: a new one, such as out/roundabout-1]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Speed as a multiple of real time [default: as fast as the machine can]
    #[arg(long, value_name = "X", value_parser = super::values::pace)]
    speed: Option<f64>,
    /// With a log: simulate its run again up to this tick, and continue from there
    #[arg(long, value_name = "N")]
    from_tick: Option<u64>,
    /// With --from-tick: the scenario from there on, instead of the log's
    #[arg(long = "scenario", id = "changed", value_name = "FILE", requires = "from_tick")]
    changed: Option<String>,
    #[command(flatten)]
    log: LogArgs,
    /// Print the summary as JSON instead of text
    #[arg(long)]
    json: bool,
}

pub fn run(args: &RunArgs) -> Result<(), Failure> {
    let folder = |experiment: &Experiment| args.out.clone().unwrap_or_else(|| new_folder(&experiment.name));
    if let Some(from_tick) = args.from_tick {
        let fork =
            ForkedRun { args: &args.scenario, from_tick, scenario: args.changed.as_ref(), log: args.log };
        let (summary, experiment, folder) = fork.run(folder)?;
        return conclude(&summary, &experiment, Some(&folder), args.json);
    }
    if is_log(Path::new(&args.scenario.scenario)) {
        return Err(Failure::bad_input(format!(
            "{log} is the log of a run: --from-tick N continues it from tick N; city3d replay {log} --verify \
             simulates it again",
            log = args.scenario.scenario
        )));
    }
    let experiment = load::experiment(&args.scenario)?;
    let folder = folder(&experiment);
    let files = RunFiles::begin(Some(folder.clone()), &experiment, LogOrigin::Run, args.log.options())?;
    let summary = simulate(&experiment, files, args.speed)?;
    conclude(&summary, &experiment, Some(&folder), args.json)
}

/// Simulates an experiment and writes its files, as fast as possible or at `speed` times real time.
pub fn simulate(
    experiment: &Arc<Experiment>,
    mut files: RunFiles,
    speed: Option<f64>,
) -> Result<Summary, Failure> {
    let run = Run::new(Arc::clone(experiment)).map_err(Failure::bad_input)?;
    files.first(run.snapshot())?;
    simulate_rest(run, experiment, files, speed, &progress::simulated_seconds(experiment.duration_s))
}

/// Simulates the rest of a run, up to the end of its experiment.
pub fn simulate_rest(
    mut run: Run,
    experiment: &Experiment,
    mut files: RunFiles,
    speed: Option<f64>,
    bar: &progress::Progress,
) -> Result<Summary, Failure> {
    let start = Instant::now();
    for tick in run.snapshot().tick..experiment.ticks() {
        let time_s = run.snapshot().time_s;
        run.step();
        files.commands(tick, time_s, run.commands());
        let snapshot = run.snapshot();
        files.tick(Some(run.mainframe()), snapshot)?;
        if tick % 100 == 0 {
            progress::show(bar, snapshot.time_s);
        }
        if let Some(speed) = speed {
            keep_pace(start, snapshot.time_s / speed);
        }
    }
    let summary = files.finish(experiment, run.snapshot(), None)?;
    bar.finish_and_clear();
    Ok(summary)
}

fn keep_pace(start: Instant, due_s: f64) {
    if let Some(early) = Duration::from_secs_f64(due_s).checked_sub(start.elapsed()) {
        std::thread::sleep(early);
    }
}
