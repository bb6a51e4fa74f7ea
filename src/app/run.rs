//! `city3d run`: a scenario from its start to its end.

use super::say::say;
use super::{Failure, ScenarioArgs, create_folder, load, progress};
use crate::record::{Cadence, Recorder};
use crate::runner::{Observer, Run, Summary};
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
    /// Snapshots per simulated second in the log
    #[arg(long, value_name = "HZ", default_value_t = 50, value_parser = clap::value_parser!(u32).range(1..))]
    log_hz: u32,
    /// Rows per simulated second and vehicle in vehicles.csv
    #[arg(long, value_name = "HZ", default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..))]
    csv_hz: u32,
    /// Print the summary as JSON instead of text
    #[arg(long)]
    json: bool,
}

pub fn run(args: &RunArgs) -> Result<(), Failure> {
    let experiment = load::experiment(&args.scenario)?;
    create_folder(&args.out)?;
    let summary = simulate(args, &experiment)?;
    write_summary(&args.out, &summary)?;
    if args.json {
        say(serde_json::to_string(&summary).map_err(Failure::failed)?)?;
    } else {
        print(&summary, &args.out)?;
    }
    if summary.collisions > 0 && experiment.outcome.collisions_forbidden {
        let count = summary.collisions;
        return Err(Failure::failed(format!(
            "{count} collisions in a scenario that forbids them (collisions_forbidden)"
        )));
    }
    Ok(())
}

fn simulate(args: &RunArgs, experiment: &Arc<Experiment>) -> Result<Summary, Failure> {
    let every = |hz: u32| u64::from((experiment.rates.physics_hz / hz).max(1));
    let cadence = Cadence { log_ticks: every(args.log_hz), table_ticks: every(args.csv_hz) };
    let mut recorder = Recorder::new(&args.out, experiment, cadence).map_err(Failure::failed)?;
    let mut run = Run::new(Arc::clone(experiment)).map_err(Failure::bad_input)?;
    let mut observer = Observer::new(experiment);
    let mut all_events = Vec::new();
    let mut events = Vec::new();
    let bar = progress::simulated_seconds(experiment.duration_s);
    let start = Instant::now();
    recorder.record(run.snapshot(), &[]).map_err(Failure::failed)?;
    for tick in 0..experiment.ticks() {
        run.step();
        let snapshot = run.snapshot();
        events.clear();
        events.extend_from_slice(&snapshot.events);
        observer.observe(experiment, run.mainframe(), snapshot, &mut events);
        recorder.record(snapshot, &events).map_err(Failure::failed)?;
        all_events.append(&mut events);
        if tick % 100 == 0 {
            progress::show(&bar, snapshot.time_s);
        }
        if let Some(speed) = args.speed {
            keep_pace(start, snapshot.time_s / speed);
        }
    }
    recorder.finish().map_err(Failure::failed)?;
    let wall_s = start.elapsed().as_secs_f64();
    bar.finish_and_clear();
    Ok(Summary::new(experiment, &observer, run.snapshot(), all_events, wall_s))
}

fn keep_pace(start: Instant, due_s: f64) {
    if let Some(early) = Duration::from_secs_f64(due_s).checked_sub(start.elapsed()) {
        std::thread::sleep(early);
    }
}

fn write_summary(folder: &Path, summary: &Summary) -> Result<(), Failure> {
    let path = folder.join("summary.json");
    let text = serde_json::to_string_pretty(summary).map_err(Failure::failed)?;
    std::fs::write(&path, text).map_err(|e| Failure::failed(format!("{}: {e}", path.display())))
}

fn print(summary: &Summary, folder: &Path) -> Result<(), Failure> {
    say(format_args!(
        "{}: {:.1} s simulated in {:.2} s ({:.0} times real time), seed {}",
        summary.scenario, summary.simulated_s, summary.wall_s, summary.real_time_factor, summary.seed
    ))?;
    say(format_args!("collisions {}   mean speed {:.2} m/s", summary.collisions, summary.mean_speed_mps))?;
    say("  id  name      status      distance m  mean m/s  stops  longest stand s  max lateral m")?;
    for (id, v) in summary.vehicles.iter().take(20) {
        say(format_args!(
            "{id:>4}  {:<8}  {:<10}  {:>10.1}  {:>8.2}  {:>5}  {:>15.1}  {:>13.3}",
            v.name,
            v.status.label(),
            v.distance_m,
            v.mean_speed_mps,
            v.stops,
            v.longest_stand_s,
            v.max_lateral_error_m
        ))?;
    }
    if summary.vehicles.len() > 20 {
        say(format_args!("      and {} more in summary.json", summary.vehicles.len() - 20))?;
    }
    say(format_args!("state {}   written to {}", summary.state_hash, folder.display()))
}
