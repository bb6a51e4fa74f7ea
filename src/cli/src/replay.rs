//! `city3d replay`: shows a recorded run in the window or on a web page, or simulates it again and verifies its state
//! digests.

use super::files::{LogArgs, log_of};
use super::recorded::PosesReplay;
use super::say::say;
use super::served_at::ServedAt;
use super::web::WebArgs;
use super::{Failure, progress};
use city3d_logbook::record::{FileKind, file_kind, is_bag_folder, last_tick};
use city3d_logbook::replay::{Replay, ReplayError};
use city3d_logbook::verify::{DifferentVehicle, VerifyReport};
use city3d_simulation::scenario::shipped_scenarios;
use clap::Args;
use std::path::{Path, PathBuf};

#[derive(Debug, Args)]
pub struct ReplayArgs {
    /// The run.mcap or the folder of a run; or poses that were measured elsewhere: a bag of ROS 1 or ROS 2 (a file,
    /// or the folder of a bag of ROS 2) with transforms or stamped poses named after the vehicles, or a CSV file (time, id,
    /// x, y, yaw; seconds, laboratory metres, radians)
    log: PathBuf,
    /// With poses: the scenario that has their map and vehicles
    #[arg(long, value_name = "FILE", conflicts_with = "verify")]
    scenario: Option<String>,
    /// With poses: folder for the files of the run
    #[arg(long, value_name = "DIR", requires = "scenario")]
    out: Option<PathBuf>,
    #[command(flatten)]
    files: LogArgs,
    /// Simulate the run again from its commands alone, and compare the state at every tick
    #[arg(long)]
    verify: bool,
    /// Print the outcome as JSON instead of text
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    web: WebArgs,
    #[cfg(feature = "window")]
    #[command(flatten)]
    window: super::view::WindowArgs,
    #[cfg(all(feature = "web", feature = "render", not(feature = "window")))]
    #[command(flatten)]
    look: super::look::LookArgs,
}

pub fn replay(args: &ReplayArgs) -> Result<(), Failure> {
    let page = args.web.place()?;
    if page.is_some() && (args.verify || args.scenario.is_some() || args.json) {
        return Err(Failure::bad_input(
            "--web shows a log, and goes with none of --verify, --scenario and --json",
        ));
    }
    if let (Some(scenario), Some(out)) = (&args.scenario, &args.out) {
        return PosesReplay { poses: &args.log, scenario, out, log: args.files, json: args.json }.replay();
    }
    if let Some(failure) = no_log(&args.log) {
        return Err(failure);
    }
    let log = &log_of(&args.log);
    let is_table = log.extension().is_some_and(|extension| extension == "csv");
    let is_bag = matches!(file_kind(log), Ok(FileKind::Ros1Bag | FileKind::Sqlite));
    if !args.verify && (is_table || is_bag) {
        return Err(poses_need(&args.log));
    }
    if let Some(at) = page {
        return show_on_page(log, at, args);
    }
    if !args.verify {
        return if args.json {
            Err(Failure::bad_input("--json needs --verify, or poses with --scenario and --out"))
        } else {
            watch(log, args)
        };
    }
    let report = verify(log)?;
    if args.json {
        say(serde_json::to_string(&report).map_err(Failure::failed)?)?;
    } else {
        print(&report)?;
    }
    report.failure().map_or(Ok(()), |why| Err(Failure::failed(why)))
}

/// The error for poses without a scenario.
fn poses_need(path: &Path) -> Failure {
    let path = path.display();
    Failure::bad_input(format!(
        "{path} has measured poses and no run: make a run of them with the scenario that has their map and vehicles \
         (city3d replay {path} --scenario SCENARIO --out DIR), then watch it with city3d replay DIR"
    ))
}

/// Why what was given is no log, where it is something else that is known; with what to do instead.
fn no_log(path: &Path) -> Option<Failure> {
    let name = path.display();
    let file = path.file_name().unwrap_or_default();
    let run = |scenario: &str| {
        Failure::bad_input(format!(
            "{name} is a scenario, not a recorded run: record one with city3d run {scenario} --out out/run, and watch it \
             with city3d replay out/run; or watch it live: city3d view {scenario}"
        ))
    };
    let text = path.to_string_lossy();
    if !path.exists() && shipped_scenarios().any(|shipped| *shipped == *text) {
        return Some(run(&text));
    }
    if path.is_file() && path.extension().is_some_and(|extension| extension == "toml") {
        return Some(run(&text));
    }
    if path.is_file() && file == "summary.json" {
        let folder = path.parent().unwrap_or(path).display();
        return Some(Failure::bad_input(format!(
            "{name} is the summary of a run; give the folder of the run: city3d replay {folder}"
        )));
    }
    if path.is_dir() && !log_of(path).is_file() {
        return Some(if is_bag_folder(path) { poses_need(path) } else { no_run(path) });
    }
    None
}

/// A folder that has no log itself: those of its folders that have.
fn no_run(path: &Path) -> Failure {
    const TOLD: usize = 20;
    let mut runs: Vec<PathBuf> = Vec::new();
    let mut folders = vec![(path.to_path_buf(), 0)];
    while let Some((folder, depth)) = folders.pop() {
        let inside = std::fs::read_dir(&folder).into_iter().flatten().flatten();
        for inside in inside.map(|entry| entry.path()).filter(|inside| inside.is_dir()) {
            if inside.join("run.mcap").is_file() {
                runs.push(inside);
            } else if depth < 2 {
                folders.push((inside, depth + 1));
            }
        }
    }
    runs.sort();
    let name = path.display();
    if runs.is_empty() {
        return Failure::bad_input(format!(
            "{name} is a folder without a run.mcap; give the folder of a run, such as city3d run SCENARIO --out DIR writes"
        ));
    }
    let told: Vec<String> = runs.iter().take(TOLD).map(|run| run.display().to_string()).collect();
    let more = if runs.len() > TOLD { format!(" and {} more", runs.len() - TOLD) } else { String::new() };
    Failure::bad_input(format!("{name} is a folder of runs; give one of them: {}{more}", told.join(", ")))
}

/// Serves a page on a log until a signal ends it.
#[cfg(feature = "web")]
#[cfg_attr(not(feature = "render"), expect(unused_variables, reason = "without pictures there is no look"))]
fn show_on_page(log: &Path, mut at: ServedAt, args: &ReplayArgs) -> Result<(), Failure> {
    use super::web::{PagedCity, start, tell};
    use city3d_session::playback::SharedPlayer;
    use city3d_web::PageOrders;
    let player = SharedPlayer::open(log).map_err(Failure::bad_input)?;
    let (end, ended) = std::sync::mpsc::channel();
    super::signals::at_end(move || {
        // Whoever has gone does not wait for it.
        let _ = end.send(());
    })?;
    let city = PagedCity {
        experiment: player.experiment(),
        #[cfg(all(feature = "render", feature = "window"))]
        look: args.window.look(),
        #[cfg(all(feature = "render", not(feature = "window")))]
        look: &args.look,
    };
    let server = start(&mut at, PageOrders::Log(player.remote()), &city)?;
    server.watch(player.published());
    tell(&server)?;
    // It ends with the thread of the signals alone.
    let _ = ended.recv();
    Ok(())
}

#[cfg(not(feature = "web"))]
fn show_on_page(_: &Path, _: ServedAt, _: &ReplayArgs) -> Result<(), Failure> {
    Err(Failure::bad_input("this program was built without the web page"))
}

#[cfg(feature = "window")]
fn watch(log: &Path, args: &ReplayArgs) -> Result<(), Failure> {
    super::view::replay(log, &args.window)
}

#[cfg(not(feature = "window"))]
fn watch(log: &Path, _args: &ReplayArgs) -> Result<(), Failure> {
    city3d_logbook::record::LogReader::open(log).map_err(Failure::bad_input)?;
    let log = log.display();
    Err(Failure::bad_input(format!(
        "this program was built without the window. city3d replay {log} --verify simulates the run again and \
         compares it"
    )))
}

fn verify(log: &Path) -> Result<VerifyReport, Failure> {
    let (last, _) = last_tick(log).map_err(Failure::bad_input)?;
    let mut replay = Replay::open(log).map_err(failure)?;
    warn_of_version(&replay);
    let bar = progress::simulated_seconds(replay.experiment().rates.time_s(last));
    let report = VerifyReport::of(&mut replay, log, &mut |time_s| progress::show(&bar, time_s));
    bar.finish_and_clear();
    report.map_err(failure)
}

/// Warns of a log of another version, which may simulate differently.
pub(super) fn warn_of_version(replay: &Replay) {
    let (theirs, ours) = (replay.log().version(), env!("CARGO_PKG_VERSION"));
    if theirs != ours {
        tracing::warn!(
            "the log was written by version {theirs}, and this is {ours}: its simulation may differ"
        );
    }
}

/// A log that cannot be used is bad input.
pub(super) fn failure(error: ReplayError) -> Failure {
    Failure::bad_input(error)
}

fn print(report: &VerifyReport) -> Result<(), Failure> {
    if let Some(why) = &report.torn {
        say(format_args!(
            "{}: the log has no end: {why}. It is compared up to its last whole record",
            report.log.display()
        ))?;
    }
    say(format_args!(
        "{}: {} ticks agree, {:.2} s simulated again from the commands",
        report.scenario, report.ticks_agreeing, report.simulated_s
    ))?;
    let Some(first) = &report.first_difference else { return Ok(()) };
    say(format_args!(
        "tick {} ({:.2} s) differs: state {} in the log, {} simulated again",
        first.tick, first.time_s, first.recorded, first.simulated
    ))?;
    let Some(tick) = first.compared_at_tick else {
        return say("the log has no later snapshot to show which vehicles differ");
    };
    if first.vehicles.is_empty() {
        return say(format_args!("at tick {tick} no vehicle differs within the precision of snapshots"));
    }
    for DifferentVehicle { id, name, apart_m } in &first.vehicles {
        let how = match apart_m {
            Some(apart_m) => format!("differs at tick {tick}, {apart_m:.6} m apart"),
            None => format!("exists in only one of the two at tick {tick}"),
        };
        say(format_args!("vehicle {id} ({name}) {how}"))?;
    }
    Ok(())
}
