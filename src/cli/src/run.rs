//! `city3d run`: simulates a scenario from start to end.

use super::files::{LogArgs, conclude, fail_if_stopped, new_folder};
use super::fork::ForkedRun;
use super::foxglove::{FoxgloveArgs, OfferedCity};
use super::{Failure, ScenarioArgs, load, on_end, progress};
use city3d_logbook::record::{LogOrigin, is_log};
use city3d_session::{FilesWritten, Host, LocalCity, RunFiles, RunFolders, Session, SessionEnd, Speed};
use city3d_simulation::runner::{Run, Summary};
use city3d_simulation::scenario::Experiment;
use clap::Args;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex, PoisonError};

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
    #[command(flatten)]
    foxglove: FoxgloveArgs,
    /// Write summary.json alone, without run.mcap and vehicles.csv
    #[arg(long, conflicts_with_all = ["log_hz", "csv_hz"])]
    no_log: bool,
    /// Print the summary as JSON instead of text
    #[arg(long)]
    json: bool,
}

pub fn run(args: &RunArgs) -> Result<(), Failure> {
    let folder = |experiment: &Experiment| args.out.clone().unwrap_or_else(|| new_folder(&experiment.name));
    if let Some(from_tick) = args.from_tick {
        let fork =
            ForkedRun { args: &args.scenario, from_tick, scenario: args.changed.as_ref(), log: args.log };
        let (summary, experiment, folder) = fork.run(folder, |files| args.files(files))?;
        conclude(&summary, &experiment, Some(&folder), args.json)?;
        return fail_if_stopped(&summary, &experiment);
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
    let inputs = load::inputs(&args.scenario.scenario, &experiment);
    let claimed = args.log.options().claim_folder(&folder, &inputs)?;
    let stop = on_end()?;
    let mut files = args.files(files_of(Some(folder.clone()), args.log).in_claimed(Some(claimed)));
    files.begin(&experiment)?;
    let offered = OfferedCity {
        experiment: &experiment,
        origin: LogOrigin::Run,
        snapshot_hz: args.log.options().log_hz,
        #[cfg(feature = "render")]
        look: super::look::LookArgs::default(),
    };
    let run = Run::new(Arc::clone(&experiment)).map_err(Failure::bad_input)?;
    let (written, bar) = (files.written(), progress::simulated_seconds(experiment.duration_s));
    let session = session_of(run, &experiment, files, (args.speed, stop), bar);
    let (session, foxglove) = args.foxglove.attach(args.foxglove.place()?.as_mut(), session, offered)?;
    let summary = summary_of(foxglove.publishing(session)?, &written)?;
    conclude(&summary, &experiment, Some(&folder), args.json)?;
    fail_if_stopped(&summary, &experiment)
}

impl RunArgs {
    /// The files with or without a log.
    fn files(&self, files: RunFiles) -> RunFiles {
        if self.no_log { files.without_log() } else { files }
    }
}

/// The files of a single run.
pub fn files_of(folder: Option<PathBuf>, log: LogArgs) -> RunFiles {
    RunFiles::new(RunFolders::parts(folder), LogOrigin::Run, log.options())
}

/// Simulates an experiment and writes its files, as fast as possible or at `speed` times real time, until `stop` is set.
#[cfg(feature = "render")]
pub fn simulate(
    experiment: &Arc<Experiment>,
    files: RunFiles,
    speed: Option<f64>,
    stop: Arc<AtomicBool>,
) -> Result<Summary, Failure> {
    let run = Run::new(Arc::clone(experiment)).map_err(Failure::bad_input)?;
    let bar = progress::simulated_seconds(experiment.duration_s);
    simulate_rest(run, experiment, files, (speed, stop), bar)
}

/// Simulates the rest of a run, up to the end of its experiment or until the flag is set.
pub fn simulate_rest(
    run: Run,
    experiment: &Arc<Experiment>,
    files: RunFiles,
    (speed, stop): (Option<f64>, Arc<AtomicBool>),
    bar: progress::Progress,
) -> Result<Summary, Failure> {
    let written = files.written();
    summary_of(session_of(run, experiment, files, (speed, stop), bar), &written)
}

/// A session of the rest of a run.
fn session_of(
    run: Run,
    experiment: &Arc<Experiment>,
    files: RunFiles,
    (speed, stop): (Option<f64>, Arc<AtomicBool>),
    bar: progress::Progress,
) -> Session<LocalCity> {
    let host = Host::system();
    let city = LocalCity::on(run, Arc::clone(experiment), host.clone());
    Session::new(city.started(), host)
        .at_speed(speed.map_or(Speed::Unlimited, Speed::Times))
        .until(SessionEnd::AtTick(experiment.ticks()))
        .stopped_by(stop)
        .with_end(Box::new(files))
        .with_end(Box::new(bar))
        .strictly()
}

/// Runs a session to its end; `written` is what its files come to.
fn summary_of(session: Session<LocalCity>, written: &Mutex<FilesWritten>) -> Result<Summary, Failure> {
    session.run()?;
    let summary = written.lock().unwrap_or_else(PoisonError::into_inner).summary.clone();
    summary.ok_or_else(|| Failure::failed("the run has no summary"))
}
