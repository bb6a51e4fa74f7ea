//! `city3d bench log`: cost of the log, by the same run with and without it, in turns.

use crate::files::LogArgs;
use crate::run::{files_of, simulate};
use crate::say::say;
use crate::{Failure, ScenarioArgs, load};
use city3d_render::benchmark::cpu_s;
use city3d_simulation::scenario::Experiment;
use clap::Args;
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Default folder, which the benchmark may overwrite.
const DEFAULT_FOLDER: &str = "out/bench-log";

#[derive(Debug, Args)]
pub struct LogBenchArgs {
    #[command(flatten)]
    scenario: ScenarioArgs,
    /// Number of runs with a log, and of runs without one
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=100))]
    pairs: u32,
    /// Folder for the files; they are kept
    #[arg(long, value_name = "DIR", default_value = DEFAULT_FOLDER)]
    out: PathBuf,
    #[command(flatten)]
    log: LogArgs,
}

/// One line of the report; times are medians.
#[derive(Debug, Serialize)]
struct LogReport {
    bench: &'static str,
    scenario: String,
    vehicles: usize,
    simulated_s: f64,
    /// Size of run.mcap.
    log_bytes: u64,
    bytes_per_s: f64,
    /// Wall-clock time from the first tick until the files are complete.
    with_log_s: f64,
    without_log_s: f64,
    /// Relative increase of the time of a run at full speed.
    overhead: f64,
    /// CPU time of the log per simulated second, on all cores.
    share_of_a_core: Option<f64>,
}

/// Times of one run.
#[derive(Clone, Copy, Debug)]
struct RunCost {
    wall_s: f64,
    cpu_s: Option<f64>,
}

pub fn log(args: &LogBenchArgs) -> Result<(), Failure> {
    let experiment = load::experiment(&args.scenario)?;
    let (mut with, mut without) = (Vec::new(), Vec::new());
    if args.out != Path::new(DEFAULT_FOLDER) {
        args.log.options().check_folder(&args.out)?;
    }
    // Each run overwrites the one before.
    let log = args.log.forced();
    for _ in 0..args.pairs {
        with.push(cost(&experiment, Some(&args.out), log)?);
        without.push(cost(&experiment, None, log)?);
    }
    let wall = |costs: &[RunCost]| median(costs.iter().map(|cost| cost.wall_s).collect());
    let cpu =
        |costs: &[RunCost]| costs.iter().map(|cost| cost.cpu_s).collect::<Option<Vec<f64>>>().map(median);
    let work = cpu(&with).zip(cpu(&without)).map(|(with, without)| with - without);
    let log_bytes = std::fs::metadata(args.out.join("run.mcap")).map_err(Failure::failed)?.len();
    let report = LogReport {
        bench: "city3d_log",
        scenario: experiment.name.clone(),
        vehicles: experiment.vehicles.len(),
        simulated_s: experiment.duration_s,
        log_bytes,
        bytes_per_s: log_bytes as f64 / experiment.duration_s,
        with_log_s: wall(&with),
        without_log_s: wall(&without),
        overhead: wall(&with) / wall(&without) - 1.0,
        share_of_a_core: work.map(|work| work / experiment.duration_s),
    };
    say(serde_json::to_string(&report).map_err(Failure::failed)?)
}

fn cost(experiment: &Arc<Experiment>, folder: Option<&Path>, log: LogArgs) -> Result<RunCost, Failure> {
    let before = cpu_s();
    let mut files = files_of(folder.map(Path::to_path_buf), log);
    files.begin(experiment)?;
    let summary = simulate(experiment, files, None, Arc::default())?;
    Ok(RunCost { wall_s: summary.wall_s, cpu_s: cpu_s().zip(before).map(|(after, before)| after - before) })
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}
