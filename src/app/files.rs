//! Files of a run: `run.mcap`, `vehicles.csv` and `summary.json`.

use super::overwrite::OverwriteArgs;
use super::say::say;
use super::{Failure, create_folder};
use crate::mainframe::Mainframe;
use crate::record::{Cadence, LogOrigin, NetworkCommand, Recorder};
use crate::runner::{LinkSummary, Observer, Summary};
use crate::scenario::Experiment;
use crate::snapshot::{Event, FrameSnapshot, SimCommand};
use clap::Args;
use std::convert::Infallible;
use std::path::{Path, PathBuf};
use std::time::Instant;

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
    /// Refuses a folder that already has a run, or one of the parts of [`folder_of`].
    pub fn check_folder(self, folder: &Path) -> Result<(), Failure> {
        self.overwrite.check_run(folder)?;
        self.overwrite.check_runs(folder, PART_PREFIX)
    }

    /// The same options, with leave to overwrite.
    #[cfg(feature = "render")]
    pub fn forced(self) -> Self {
        Self { overwrite: OverwriteArgs { force: true }, ..self }
    }
}

/// Prefix of the folders of the second and later runs.
const PART_PREFIX: &str = "part-";

/// The folder of one of several runs of a process, counted from 1; the first has the folder `out` itself.
pub fn folder_of(out: Option<&Path>, part: u32) -> Option<PathBuf> {
    out.map(
        |folder| if part <= 1 { folder.to_path_buf() } else { folder.join(format!("{PART_PREFIX}{part}")) },
    )
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

/// The open files of one run; without a folder only the summary is computed.
pub struct RunFiles {
    folder: Option<PathBuf>,
    recorder: Option<Recorder>,
    observer: Observer,
    origin: LogOrigin,
    events: Vec<Event>,
    tick_events: Vec<Event>,
    start: Instant,
}

impl RunFiles {
    /// Opens the files. They are complete up to the last simulated second even if the process dies.
    pub fn begin(
        folder: Option<PathBuf>,
        experiment: &Experiment,
        origin: LogOrigin,
        args: LogArgs,
    ) -> Result<Self, Failure> {
        let physics_hz = experiment.rates.physics_hz;
        for (option, hz) in [("--log-hz", args.log_hz), ("--csv-hz", args.csv_hz)] {
            if hz > physics_hz {
                tracing::warn!("{option} {hz}: the run has {physics_hz} ticks per second, all are written");
            }
        }
        let every = |hz: u32| u64::from((physics_hz / hz).max(1));
        let cadence =
            Cadence { log_ticks: every(args.log_hz), table_ticks: every(args.csv_hz), flush_ticks: every(1) };
        let recorder = match &folder {
            Some(folder) => {
                args.check_folder(folder)?;
                create_folder(folder)?;
                remove_summary(folder)?;
                Some(Recorder::new(folder, experiment, origin, cadence).map_err(Failure::failed)?)
            }
            None => None,
        };
        let observer = Observer::new(experiment);
        let start = Instant::now();
        Ok(Self { folder, recorder, observer, origin, events: Vec::new(), tick_events: Vec::new(), start })
    }

    /// Records the initial snapshot.
    pub fn first(&mut self, snapshot: &FrameSnapshot) -> Result<(), Failure> {
        match &mut self.recorder {
            Some(recorder) => recorder.record(snapshot, &[]).map_err(Failure::failed),
            None => Ok(()),
        }
    }

    /// Records the commands of the step that begins at a tick.
    pub fn commands(&mut self, tick: u64, time_s: f64, commands: &[SimCommand]) {
        if let Some(recorder) = &mut self.recorder {
            recorder.commands(tick, time_s, commands);
        }
    }

    /// Records a command that came over the link.
    pub fn network(&mut self, time_s: f64, command: NetworkCommand) -> Result<(), Failure> {
        match &mut self.recorder {
            Some(recorder) => recorder.network(time_s, command).map_err(Failure::failed),
            None => Ok(()),
        }
    }

    /// Records the snapshot after a tick.
    pub fn tick(&mut self, mainframe: Option<&Mainframe>, snapshot: &FrameSnapshot) -> Result<(), Failure> {
        self.tick_events.clear();
        self.tick_events.extend_from_slice(&snapshot.events);
        self.observer.observe(mainframe, snapshot, &mut self.tick_events);
        if let Some(recorder) = &mut self.recorder {
            recorder.record(snapshot, &self.tick_events).map_err(Failure::failed)?;
        }
        self.events.append(&mut self.tick_events);
        Ok(())
    }

    /// Closes the files and writes the summary.
    pub fn finish(
        self,
        experiment: &Experiment,
        last: &FrameSnapshot,
        link: Option<LinkSummary>,
    ) -> Result<Summary, Failure> {
        if let Some(recorder) = self.recorder {
            recorder.finish().map_err(Failure::failed)?;
        }
        let wall_s = self.start.elapsed().as_secs_f64();
        let summary = Summary::new(experiment, &self.observer, last, self.events, wall_s);
        let summary = Summary { link, ..summary };
        let summary = if !self.origin.has_world() { summary.of_poses() } else { summary };
        if let Some(folder) = &self.folder {
            write_summary(folder, &summary)?;
        }
        Ok(summary)
    }
}

/// An overwritten run has no summary until the new one ends.
fn remove_summary(folder: &Path) -> Result<(), Failure> {
    let path = folder.join("summary.json");
    match std::fs::remove_file(&path) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
            Err(Failure::failed(format!("{}: {error}", path.display())))
        }
        _ => Ok(()),
    }
}

fn write_summary(folder: &Path, summary: &Summary) -> Result<(), Failure> {
    let path = folder.join("summary.json");
    let text = serde_json::to_string_pretty(summary).map_err(Failure::failed)?;
    std::fs::write(&path, text).map_err(|e| Failure::failed(format!("{}: {e}", path.display())))
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
        let count = summary.collisions;
        return Err(Failure::failed(format!(
            "{count} collisions in a scenario that forbids them (collisions_forbidden)"
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
            v.stops,
            v.longest_stand_s,
            v.max_lateral_error_m.map_or_else(|| "-".to_owned(), |error_m| format!("{error_m:.3}"))
        ))?;
    }
    if summary.vehicles.len() > 20 {
        say(format_args!("      and {} more in summary.json", summary.vehicles.len() - 20))?;
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
            say(format_args!(
                "ros: poses of {} instants published, {} dropped, {} heard; the master is {master}",
                ros.published, ros.dropped, ros.heard
            ))?;
        }
    }
    match folder {
        Some(folder) => say(format_args!("state {}   written to {}", summary.state_hash, folder.display())),
        None => say(format_args!("state {}", summary.state_hash)),
    }
}
