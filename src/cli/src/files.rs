//! Options of the files of a run, their names, and the summary on standard output.

use super::Failure;
use super::overwrite::OverwriteArgs;
use super::say::say;
use city3d_session::{FileOptions, FilesWritten};
use city3d_simulation::runner::Summary;
use city3d_simulation::scenario::{Experiment, counted};
use clap::Args;
use std::convert::Infallible;
use std::path::{Path, PathBuf};

/// Options of the files of a run.
#[derive(Clone, Copy, Debug, Args)]
pub struct LogArgs {
    /// Snapshots per simulated second in the log
    #[arg(long, value_name = "HZ", default_value_t = 50, value_parser = clap::value_parser!(u32).range(1..))]
    log_hz: u32,
    /// Rows per simulated second and vehicle in vehicles.csv
    #[arg(long, value_name = "HZ", default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..))]
    csv_hz: u32,
    #[command(flatten)]
    overwrite: OverwriteArgs,
}

impl LogArgs {
    pub fn options(self) -> FileOptions {
        FileOptions { log_hz: self.log_hz, csv_hz: self.csv_hz, overwrite: self.overwrite.policy() }
    }

    /// The same options, with leave to overwrite.
    #[cfg(feature = "render")]
    pub fn forced(self) -> Self {
        Self { overwrite: OverwriteArgs { force: true }, ..self }
    }
}

/// A new folder for a run without `--out`: `out/NAME-1`, then `out/NAME-2`.
pub fn new_folder(name: &str) -> PathBuf {
    let name = name.replace(|c: char| !(c.is_alphanumeric() || "-_.".contains(c)), "_");
    let folder = |number: u32| Path::new("out").join(format!("{name}-{number}"));
    (1..).map(folder).find(|folder| !folder.exists()).unwrap_or_else(|| folder(0))
}

/// The path of a log, also when it is given by its folder.
pub fn log_of(path: &Path) -> PathBuf {
    let inside = path.join("run.mcap");
    if inside.is_file() { inside } else { path.to_path_buf() }
}

/// [`log_of`] as a parser of command-line arguments.
pub fn log_argument(text: &str) -> Result<PathBuf, Infallible> {
    Ok(log_of(Path::new(text)))
}

/// The failure of a run that was stopped before its end; its files are whole up to there.
pub fn fail_if_stopped(summary: &Summary, experiment: &Experiment) -> Result<(), Failure> {
    let Some(tick) = summary.stopped_at_tick else { return Ok(()) };
    let (done_s, all_s) = (summary.simulated_s, experiment.duration_s);
    Err(Failure::failed(format!("stopped after {done_s:.2} of {all_s:.2} s, at tick {tick}")))
}

/// Prints the summary of the run that a session ended with.
///
/// # Errors
/// When its files are not whole, or as for [`conclude`].
pub fn conclude_files(written: &FilesWritten, experiment: &Experiment, json: bool) -> Result<(), Failure> {
    if let Some(summary) = &written.summary {
        conclude(summary, experiment, written.folder.as_deref(), json)?;
    }
    match &written.failure {
        Some(why) => Err(Failure::failed(format!("the files are not whole: {why}"))),
        None => Ok(()),
    }
}

/// Prints the summary of a run.
///
/// # Errors
/// When the scenario forbids collisions and the run has some.
pub fn conclude(
    summary: &Summary,
    experiment: &Experiment,
    folder: Option<&Path>,
    json: bool,
) -> Result<(), Failure> {
    if json {
        say(serde_json::to_string(summary).map_err(Failure::failed)?)?;
    } else {
        print(summary, folder)?;
    }
    if summary.collisions > 0 && experiment.expectations.collisions_forbidden {
        let count = counted(summary.collisions, "collision");
        return Err(Failure::failed(format!(
            "{count} in a scenario that forbids them (collisions_forbidden)"
        )));
    }
    Ok(())
}

fn print(summary: &Summary, folder: Option<&Path>) -> Result<(), Failure> {
    say(format_args!(
        "{}: {:.1} s simulated in {:.2} s ({:.0} times real time), seed {}",
        summary.scenario, summary.simulated_s, summary.wall_s, summary.real_time_factor, summary.seed
    ))?;
    say(format_args!("collisions {}   mean speed {:.2} m/s", summary.collisions, summary.mean_speed_mps))?;
    say("  id  name      status      distance m  mean m/s  stops  longest stand s  max lateral m")?;
    for (id, v) in summary.vehicles.iter().take(20) {
        say(format_args!(
            "{id:>4}  {:<8}  {:<10}  {:>10.1}  {:>8.2}  {:>5}  {:>15.1}  {:>13}",
            v.name,
            v.status.label(),
            v.distance_m,
            v.mean_speed_mps,
            // As the window and `sweep` count them.
            v.traffic.as_ref().map_or(v.stops, |traffic| traffic.slow_stops),
            v.longest_stand_s,
            v.max_lateral_error_m.map_or_else(|| "-".to_owned(), |error_m| format!("{error_m:.3}"))
        ))?;
    }
    if summary.vehicles.len() > 20 {
        say(format_args!("      and {} more in summary.json", summary.vehicles.len() - 20))?;
    }
    for (name, of) in summary.inflows.iter().take(20) {
        say(format_args!("inflow {name}: {of}"))?;
    }
    if let Some(link) = &summary.link {
        let reasons: Vec<String> =
            link.dropped.iter().map(|(reason, count)| format!("{count} {}", reason.label())).collect();
        let reasons = if reasons.is_empty() { String::new() } else { format!(": {}", reasons.join(", ")) };
        say(format_args!(
            "link: {} datagrams, {} missing, {} dropped{reasons}",
            link.received,
            link.missing,
            link.dropped.total()
        ))?;
        if let Some(ros) = &link.ros {
            let master = if ros.master_is_there { "there" } else { "away" };
            let ignored = match ros.invalid + ros.ahead {
                0 => String::new(),
                _ => format!(" ({} invalid, {} ahead of the clock)", ros.invalid, ros.ahead),
            };
            say(format_args!(
                "ros: poses of {} instants published, {} dropped, {} heard{ignored}; the master is {master}",
                ros.published, ros.dropped, ros.heard
            ))?;
        }
    }
    match folder {
        Some(folder) => say(format_args!("state {}   written to {}", summary.state_hash, folder.display())),
        None => say(format_args!("state {}", summary.state_hash)),
    }
}
