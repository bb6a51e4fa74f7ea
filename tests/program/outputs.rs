//! What commands leave when they are killed, stopped, locked out, or short of room: files are whole or have another name,
//! and nothing that was there is lost.

use crate::support::drawing::software;
use crate::support::link;

use city3d_logbook::record::{LogReader, last_tick};
use city3d_outputs::{LOCK_FILE, OutputFolder};
use link::city3d;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

/// How often each command is killed, or `CITY3D_KILLS`.
const KILLS: u32 = 2;

/// Cameras that draw quickly.
const SMALL: [&str; 10] = [
    "--camera",
    "chase",
    "--vehicle",
    "leader",
    "--size",
    "96x64",
    "--adapter",
    "software",
    "--quality",
    "low",
];

/// Exit code, and what was said on standard error.
fn told(folder: &Path, arguments: &[&str]) -> (Option<i32>, String) {
    let output = city3d(arguments, folder).output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(!said.contains("panicked"), "{said}");
    (output.status.code(), said)
}

fn works(folder: &Path, arguments: &[&str]) {
    let (code, said) = told(folder, arguments);
    assert_eq!(code, Some(0), "{arguments:?}: {said}");
}

fn start(folder: &Path, arguments: &[&str]) -> Child {
    city3d(arguments, folder).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap()
}

/// The files of a folder by name, but for those that say by their names that they are not whole.
fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().map(Result::unwrap);
    let named = entries.map(|entry| (entry.file_name().into_string().unwrap(), entry.path()));
    let whole = named.filter(|(name, path)| !name.ends_with(".part") && name != LOCK_FILE && path.is_file());
    whole.map(|(name, path)| (name, std::fs::read(path).unwrap())).collect()
}

/// Starts a command and kills it at random moments, up to `longest` after its start; tells what has become of it.
fn kill(longest: Duration, mut begin: impl FnMut(u32) -> Vec<Child>, check: impl Fn()) {
    let kills = std::env::var("CITY3D_KILLS").map_or(KILLS, |count| count.parse().unwrap());
    let mut random = ChaCha8Rng::seed_from_u64(16);
    for round in 0..kills {
        let after = longest.mul_f64(f64::from(random.next_u32()) / f64::from(u32::MAX));
        let mut children = begin(round);
        std::thread::sleep(after);
        for child in &mut children {
            child.kill().unwrap();
            child.wait().unwrap();
        }
        check();
    }
}

/// A summary is that of the log beside it, which is whole.
fn check_run(folder: &Path) {
    let Ok(summary) = std::fs::read(folder.join("summary.json")) else { return };
    let summary: Value = serde_json::from_slice(&summary).unwrap();
    let log = folder.join("run.mcap");
    let (last, truncation) = last_tick(&log).unwrap();
    assert_eq!(truncation, None, "a summary beside a log that was cut");
    let experiment = LogReader::open(&log).unwrap().planned().unwrap();
    assert_eq!(summary["seed"].as_u64(), Some(experiment.seed), "the summary of another run");
    let time_s = experiment.rates.time_s(last);
    assert!((summary["simulated_s"].as_f64().unwrap() - time_s).abs() < 1e-9, "{summary}");
    assert!(std::fs::read(folder.join("vehicles.csv")).unwrap().ends_with(b"\n"));
}

#[test]
fn a_killed_run_leaves_no_summary_of_another_one() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    works(folder.path(), &["run", "roundabout", "--seed", "99", "--duration", "2", "--out", "out"]);
    let begin = |round: u32| {
        let seed = round.to_string();
        vec![start(folder.path(), &["run", "roundabout", "--seed", &seed, "--out", "out", "--force"])]
    };
    kill(Duration::from_millis(900), begin, || check_run(&out));
    // What is left keeps nobody out.
    works(folder.path(), &["run", "roundabout", "--duration", "1", "--out", "out", "--force"]);
    assert_eq!(files(&out).len(), 3);
    check_run(&out);
}

#[test]
fn a_killed_city_and_its_mainframe_leave_no_summaries_of_others() {
    let folder = tempfile::tempdir().unwrap();
    let begin = |_| {
        let at = ["straight", "--speed", "4", "--out", "city", "--force"];
        let mut city = link::serve(&at, folder.path());
        let mut mainframe =
            link::mainframe(&city.address, &["straight", "--out", "mainframe", "--force"], folder.path());
        [&mut city, &mut mainframe].map(link::Process::release).into()
    };
    kill(Duration::from_millis(900), begin, || {
        check_run(&folder.path().join("city"));
        check_run(&folder.path().join("mainframe"));
    });
}

#[test]
fn killed_frames_leave_whole_pictures_and_a_table_of_them() {
    if software().is_none() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let frames = [&["frames", "straight", "--duration", "2", "--every", "0.02"][..], &SMALL].concat();
    works(folder.path(), &[&frames[..], &["--out", "whole"]].concat());
    let expected = files(&folder.path().join("whole"));
    assert_eq!(expected.len(), 1 + 101);
    let begin = |_| vec![start(folder.path(), &[&frames[..], &["--out", "out", "--force"]].concat())];
    kill(Duration::from_millis(1500), begin, || {
        for (name, bytes) in files(&folder.path().join("out")) {
            assert!(expected[&name] == bytes, "{name} is not whole");
        }
    });
}

#[test]
fn killed_plots_leave_whole_figures() {
    let folder = tempfile::tempdir().unwrap();
    works(folder.path(), &["run", "roundabout", "--duration", "10", "--out", "run"]);
    works(folder.path(), &["plot", "run", "--out", "whole"]);
    let expected = files(&folder.path().join("whole"));
    let begin = |_| vec![start(folder.path(), &["plot", "run", "--out", "out", "--force"])];
    kill(Duration::from_millis(1200), begin, || {
        for (name, bytes) in files(&folder.path().join("out")) {
            assert!(expected[&name] == bytes, "{name} is not whole");
        }
    });
}

#[test]
fn a_killed_sweep_has_another_name_and_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let sweep =
        ["sweep", "straight", "--duration", "2", "--set", "environment.loss=0,0.1", "--seeds", "1..20"];
    works(folder.path(), &[&sweep[..], &["--out", "whole"]].concat());
    let expected = files(&folder.path().join("whole"));
    let begin = |_| vec![start(folder.path(), &[&sweep[..], &["--out", "out"]].concat())];
    kill(Duration::from_millis(900), begin, || {
        for (name, bytes) in files(&folder.path().join("out")) {
            assert!(expected[&name] == bytes, "{name} is not whole");
        }
    });
    works(folder.path(), &[&sweep[..], &["--out", "out"]].concat());
    assert_eq!(files(&folder.path().join("out")), expected);
}

/// Poses of a vehicle as a table.
fn poses() -> String {
    let rows =
        (0..100).map(|k| format!("{:.2},1,{:.4},1.0,0\n", f64::from(k) * 0.02, 1.0 + f64::from(k) * 0.002));
    std::iter::once("time,id,x,y,yaw\n".to_owned()).chain(rows).collect()
}

#[test]
fn a_folder_that_is_being_written_has_no_second_writer() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    works(folder, &["run", "straight", "--duration", "1", "--out", "run"]);
    std::fs::write(folder.join("poses.csv"), poses()).unwrap();
    let locked = OutputFolder::open(&folder.join("out")).unwrap();
    std::fs::write(folder.join("out/summary.json"), "precious").unwrap();
    let city = ["serve", "straight", "--headless", "--bind", "127.0.0.1:0"];
    let commands: [&[&str]; 9] = [
        &["run", "straight", "--duration", "1", "--force"],
        &["run", "run/run.mcap", "--from-tick", "50", "--force"],
        &["replay", "poses.csv", "--scenario", "straight", "--force"],
        &["frames", "straight", "--duration", "0.1", "--force"],
        &["plot", "run", "--force"],
        &["compare", "run", "run", "--force"],
        &["sweep", "straight", "--duration", "1", "--force"],
        &[&city[..], &["--force"]].concat(),
        &["mainframe", "straight", "--force"],
    ];
    for command in commands {
        let (code, said) = told(folder, &[command, &["--out", "out"]].concat());
        assert_eq!(code, Some(1), "{command:?}: {said}");
        assert!(said.contains("out: another command is writing into this folder"), "{command:?}: {said}");
    }
    assert_eq!(
        files(&folder.join("out")),
        BTreeMap::from([("summary.json".to_owned(), b"precious".to_vec())])
    );
    drop(locked);
    works(folder, &["run", "straight", "--duration", "1", "--out", "out", "--force"]);
    assert!(!folder.join("out").join(LOCK_FILE).exists());
}

#[test]
fn two_runs_in_one_folder_do_not_mix() {
    let folder = tempfile::tempdir().unwrap();
    let run = |seed| ["run", "straight", "--duration", "3", "--seed", seed, "--out", "out", "--force"];
    let mut children: Vec<Child> = ["5", "6"].map(|seed| start(folder.path(), &run(seed))).into();
    let codes: Vec<Option<i32>> = children.iter_mut().map(|child| child.wait().unwrap().code()).collect();
    // The second one is refused, unless it came when the first one had ended.
    assert!(codes.contains(&Some(0)) && codes.iter().all(|code| matches!(code, Some(0 | 1))), "{codes:?}");
    check_run(&folder.path().join("out"));
    assert_eq!(files(&folder.path().join("out")).len(), 3);
}

#[test]
#[cfg(unix)]
fn no_input_is_written_over_under_any_name() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let at = |name: &str| folder.join(name);
    works(folder, &["run", "straight", "--duration", "1", "--out", "run"]);
    for name in ["hard", "soft", "table", "figures", "study"] {
        std::fs::create_dir(at(name)).unwrap();
    }
    std::fs::hard_link(at("run/run.mcap"), at("hard/run.mcap")).unwrap();
    std::os::unix::fs::symlink("../run/run.mcap", at("soft/run.mcap")).unwrap();
    std::fs::write(at("table/vehicles.csv"), poses()).unwrap();
    std::fs::hard_link(at("run/run.mcap"), at("figures/lateral_error.svg")).unwrap();
    let scenario =
        std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("scenarios/straight.toml"));
    std::fs::write(at("study/sweep.toml"), scenario.unwrap()).unwrap();
    std::fs::hard_link(at("study/sweep.toml"), at("study/summary.json")).unwrap();
    std::fs::hard_link(at("study/sweep.toml"), at("video.y4m")).unwrap();
    let precious = [files(&at("run")), files(&at("table")), files(&at("study"))];
    let commands: [&[&str]; 11] = [
        &["run", "run/run.mcap", "--from-tick", "50", "--out", "run"],
        &["run", "run", "--from-tick", "50", "--out", "run/../run"],
        &["run", "run/run.mcap", "--from-tick", "50", "--out", "hard"],
        &["run", "run/run.mcap", "--from-tick", "50", "--out", "soft"],
        &["run", "study/sweep.toml", "--out", "study"],
        &["replay", "run/run.mcap", "--scenario", "straight", "--out", "hard"],
        &["replay", "table/vehicles.csv", "--scenario", "straight", "--out", "table"],
        &["plot", "run", "--out", "figures"],
        &["compare", "run", "run", "--out", "figures"],
        &["sweep", "study/sweep.toml", "--out", "study"],
        &["frames", "study/sweep.toml", "--camera", "orbit", "--out", "video.y4m"],
    ];
    for command in commands {
        let (code, said) = told(folder, &[command, &["--force"]].concat());
        assert_eq!(code, Some(2), "{command:?}: {said}");
        assert!(said.contains("that the command reads, and would be written over"), "{command:?}: {said}");
    }
    assert!(precious == [files(&at("run")), files(&at("table")), files(&at("study"))]);
    assert!(at("hard/run.mcap").exists() && at("soft/run.mcap").is_symlink());
}

/// A bit mask of signals of a process, as `/proc` tells it.
fn signals(child: &Child, field: &str) -> u64 {
    let status = std::fs::read_to_string(format!("/proc/{}/status", child.id())).unwrap();
    let mask = status.lines().find_map(|line| line.strip_prefix(field)).unwrap();
    u64::from_str_radix(mask.trim_start_matches(':').trim(), 16).unwrap()
}

/// Waits for something that comes to pass by itself, however slow the machine is.
fn until(what: &str, mut is_so: impl FnMut() -> bool) {
    for _ in 0..60_000 {
        if is_so() {
            return;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    panic!("{what}: it never comes");
}

fn signal(child: &Child, name: &str) {
    assert!(Command::new("kill").args([name, &child.id().to_string()]).status().unwrap().success());
}

#[test]
#[cfg(target_os = "linux")]
fn a_run_that_is_stopped_has_whole_files_and_says_where() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["INT", "TERM", "HUP"] {
        let arguments = ["run", "straight", "--duration", "600", "--speed", "1", "--out", name];
        let mut run = start(folder.path(), &arguments);
        let out = folder.path().join(name);
        until("the log", || out.join("run.mcap").exists());
        signal(&run, &format!("-{name}"));
        assert_eq!(run.wait().unwrap().code(), Some(1), "{name}");
        let summary: Value = serde_json::from_slice(&files(&out)["summary.json"]).unwrap();
        let (last, truncation) = last_tick(&out.join("run.mcap")).unwrap();
        assert_eq!((summary["stopped_at_tick"].as_u64(), truncation), (Some(last), None), "{name}");
        check_run(&out);
    }
    // One that comes to its end does not.
    works(folder.path(), &["run", "straight", "--duration", "0.5", "--out", "whole"]);
    let summary: Value =
        serde_json::from_slice(&files(&folder.path().join("whole"))["summary.json"]).unwrap();
    assert!(summary.get("stopped_at_tick").is_none(), "{summary}");
}

#[test]
#[cfg(target_os = "linux")]
fn a_second_ctrl_c_ends_a_command_that_cannot_end_in_order() {
    const SIGINT: u64 = 1 << 1;
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("out")).unwrap();
    // Nobody reads this pipe, so that the log is never open.
    let pipe = folder.path().join("out/run.mcap");
    assert!(Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    let mut run = start(folder.path(), &["run", "straight", "--out", "out", "--force"]);
    until("the handler", || signals(&run, "SigCgt") & SIGINT != 0);
    signal(&run, "-INT");
    until("the first signal", || (signals(&run, "ShdPnd") | signals(&run, "SigPnd")) & SIGINT == 0);
    assert!(run.try_wait().unwrap().is_none(), "the first one waits for the files");
    signal(&run, "-INT");
    assert_eq!(run.wait().unwrap().code(), Some(130));
}

#[test]
#[cfg(target_os = "linux")]
fn a_run_that_outlives_its_terminal_is_not_stopped_by_it() {
    let folder = tempfile::tempdir().unwrap();
    let program = env!("CARGO_BIN_EXE_city3d");
    let arguments = [program, "run", "straight", "--duration", "0.3", "--speed", "0.5", "--out", "out"];
    let mut command = Command::new("nohup");
    command.args(arguments).current_dir(folder.path()).stdout(Stdio::null()).stderr(Stdio::null());
    let mut run = command.spawn().unwrap();
    until("the log", || folder.path().join("out/run.mcap").exists());
    signal(&run, "-HUP");
    assert_eq!(run.wait().unwrap().code(), Some(0));
}

#[test]
#[cfg(unix)]
fn pictures_that_are_stopped_are_listed_as_far_as_they_are() {
    if software().is_none() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let frames = [&["frames", "straight", "--duration", "600", "--every", "0.05"][..], &SMALL].concat();
    let mut child = start(folder.path(), &[&frames[..], &["--out", "out"]].concat());
    let out = folder.path().join("out");
    until("a picture", || files(&out).keys().any(|name| name.ends_with(".png")));
    signal(&child, "-TERM");
    assert_eq!(child.wait().unwrap().code(), Some(1));
    let mut there: BTreeSet<String> = files(&out).into_keys().collect();
    assert!(there.remove("frames.csv"));
    let mut table = csv::Reader::from_path(out.join("frames.csv")).unwrap();
    let listed: BTreeSet<String> = table.records().map(|row| row.unwrap()[0].to_owned()).collect();
    assert_eq!(listed, there);
    assert_eq!(std::fs::read_dir(&out).unwrap().count(), there.len() + 1, "nothing unfinished is left");

    let mut child = start(folder.path(), &[&frames[..], &["--out", "run.y4m"]].concat());
    let stream = || {
        let entries = std::fs::read_dir(folder.path()).unwrap().map(Result::unwrap);
        let mut parts = entries.filter(|entry| entry.file_name().to_string_lossy().starts_with("run.y4m."));
        parts.next().map_or(0, |entry| entry.metadata().map_or(0, |metadata| metadata.len()))
    };
    let frame = (96 * 64 * 3 / 2 + "FRAME\n".len()) as u64;
    until("a frame", || stream() > 2 * frame);
    assert!(!folder.path().join("run.y4m").exists());
    signal(&child, "-INT");
    assert_eq!(child.wait().unwrap().code(), Some(1));
    let video = std::fs::read(folder.path().join("run.y4m")).unwrap();
    let header = video.iter().position(|&byte| byte == b'\n').unwrap() as u64 + 1;
    assert_eq!((video.len() as u64 - header) % frame, 0, "the stream ends with a whole frame");
}

#[test]
#[cfg(target_os = "linux")]
fn a_disk_without_room_is_named_by_each_command() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    works(folder, &["run", "straight", "--duration", "1", "--out", "run"]);
    let mut commands: Vec<(&[&str], &str)> = vec![
        (&["run", "straight", "--duration", "1"], "run.mcap"),
        (&["run", "straight", "--duration", "1"], "vehicles.csv"),
        (&["run", "straight", "--duration", "1"], "summary.json"),
        (&["run", "straight", "--duration", "1", "--no-log"], "summary.json"),
        (&["plot", "run"], "lateral_error.png"),
        (&["compare", "run", "run"], "comparison.json"),
        (&["sweep", "straight", "--duration", "1"], "sweep.toml"),
        (&["generate", "models"], "sedan.glb"),
    ];
    let pictures = [&["frames", "straight", "--duration", "0.1"][..], &SMALL].concat();
    if software().is_some() {
        commands.push((&pictures, "chase_leader_00000000.png"));
        commands.push((&pictures, "frames.csv"));
    }
    for (number, (command, file)) in commands.into_iter().enumerate() {
        let out = number.to_string();
        std::fs::create_dir(folder.join(&out)).unwrap();
        std::os::unix::fs::symlink("/dev/full", folder.join(&out).join(file)).unwrap();
        let force: &[&str] = if command[0] == "generate" { &[] } else { &["--force"] };
        let (code, said) = told(folder, &[command, force, &["--out", &out]].concat());
        assert_eq!(code, Some(1), "{command:?}: {said}");
        assert!(said.contains(file) && said.contains("No space left on device"), "{command:?}: {said}");
    }
}

#[test]
#[cfg(target_os = "linux")]
fn pictures_before_a_full_disk_are_listed() {
    if software().is_none() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    std::fs::create_dir(&out).unwrap();
    std::os::unix::fs::symlink("/dev/full", out.join("chase_leader_00000200.png")).unwrap();
    let frames = ["frames", "straight", "--duration", "4", "--every", "0.02", "--out", "out"];
    let (code, said) = told(folder.path(), &[&frames[..], &SMALL].concat());
    assert!(code == Some(1) && said.contains("No space left on device"), "{said}");
    let mut there: BTreeSet<String> = files(&out).into_keys().collect();
    assert!(there.remove("frames.csv"), "{there:?}");
    let mut table = csv::Reader::from_path(out.join("frames.csv")).unwrap();
    let listed: BTreeSet<String> = table.records().map(|row| row.unwrap()[0].to_owned()).collect();
    assert!(listed == there && listed.len() >= 100, "{listed:?}");
}

#[test]
#[cfg(unix)]
fn a_limit_on_the_size_of_files_is_an_error_with_words() {
    let folder = tempfile::tempdir().unwrap();
    let line =
        format!("ulimit -f 40; exec {} run straight --duration 20 --out out", env!("CARGO_BIN_EXE_city3d"));
    let output = Command::new("sh").args(["-c", &line]).current_dir(folder.path()).output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("out/run.mcap") && said.contains("File too large"), "{said}");
}

#[test]
fn a_run_without_a_log_has_the_same_summary_and_no_other_file() {
    let folder = tempfile::tempdir().unwrap();
    let run = ["run", "straight", "--duration", "2", "--force", "--out"];
    works(folder.path(), &[&run[..], &["logged"]].concat());
    works(folder.path(), &[&run[..], &["summary"]].concat());
    // An earlier log would be that of another run.
    works(folder.path(), &[&run[..], &["summary", "--no-log"]].concat());
    let [logged, mut summary] = ["logged", "summary"].map(|out| files(&folder.path().join(out)));
    let read = |bytes: &[u8]| {
        let mut summary: Value = serde_json::from_slice(bytes).unwrap();
        summary.as_object_mut().unwrap().retain(|key, _| !["wall_s", "real_time_factor"].contains(&&**key));
        summary
    };
    assert_eq!(read(&summary.remove("summary.json").unwrap()), read(&logged["summary.json"]));
    assert_eq!(summary, BTreeMap::new());
    let (code, said) = told(folder.path(), &[&run[..], &["x", "--no-log", "--log-hz", "10"]].concat());
    assert!(code == Some(2) && said.contains("--no-log"), "{said}");
}

#[test]
fn pictures_for_a_folder_that_cannot_be_written_fail_as_other_results_do() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("file"), "").unwrap();
    let (code, said) =
        told(folder.path(), &["frames", "straight", "--duration", "0.1", "--out", "file/below"]);
    assert!(code == Some(1) && said.contains("file/below: the folder cannot be created"), "{said}");
}
