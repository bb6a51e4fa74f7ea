//! `city3d run`: a scenario from its start to its end.

use super::files::{Files, LogArgs, conclude};
use super::fork::Fork;
use super::{Failure, ScenarioArgs, load, progress};
use crate::record::{Origin, is_log};
use crate::runner::{Run, Summary};
use crate::scenario::Experiment;
use clap::Args;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

#[derive(Debug, Args)]
pub struct RunArgs {
    #[command(flatten)]
    scenario: ScenarioArgs,
    /// Folder for run.mcap, vehicles.csv and summary.json
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Times real time; without it as fast as the machine can
    #[arg(long, value_name = "X", value_parser = super::pace)]
    speed: Option<f64>,
    /// Of a log: make its run again up to this tick, and go on from there
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
    if let Some(from_tick) = args.from_tick {
        let (scenario, out, log) = (args.changed.as_ref(), args.out.as_path(), args.log);
        let (summary, experiment) = Fork { args: &args.scenario, from_tick, scenario, out, log }.run()?;
        return conclude(&summary, &experiment, Some(&args.out), args.json);
    }
    if is_log(Path::new(&args.scenario.scenario)) {
        return Err(Failure::bad_input(format!(
            "{log} is the log of a run: --from-tick N goes on from its middle; city3d replay {log} --verify \
             simulates it again",
            log = args.scenario.scenario
        )));
    }
    let experiment = load::experiment(&args.scenario)?;
    let summary = simulate(args, &experiment)?;
    conclude(&summary, &experiment, Some(&args.out), args.json)
}

fn simulate(args: &RunArgs, experiment: &Arc<Experiment>) -> Result<Summary, Failure> {
    let mut files = Files::begin(Some(args.out.clone()), experiment, Origin::Run, args.log)?;
    let mut run = Run::new(Arc::clone(experiment)).map_err(Failure::bad_input)?;
    let bar = progress::simulated_seconds(experiment.duration_s);
    let start = Instant::now();
    files.first(run.snapshot())?;
    for tick in 0..experiment.ticks() {
        let time_s = run.snapshot().time_s;
        run.step();
        files.commands(tick, time_s, run.commands())?;
        let snapshot = run.snapshot();
        files.tick(Some(run.mainframe()), snapshot)?;
        if tick % 100 == 0 {
            progress::show(&bar, snapshot.time_s);
        }
        if let Some(speed) = args.speed {
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
