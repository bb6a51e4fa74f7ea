//! The program as its users meet it: exit codes, files, formats.

use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::time::{Duration, Instant};

fn city3d(folder: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_city3d")).args(args).current_dir(folder).output().unwrap()
}

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

fn code(output: &Output) -> i32 {
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(!stderr.contains("panicked"), "{stderr}");
    output.status.code().expect("no signal")
}

fn stdout(output: &Output) -> String {
    String::from_utf8(output.stdout.clone()).unwrap()
}

/// A car that drives on into a standing one.
fn crash(collisions_forbidden: bool) -> String {
    format!(
        "name = \"crash\"\nduration_s = 6.0\ncollisions_forbidden = {collisions_forbidden}\n\
         [driver.blind]\ncontroller = \"cruise\"\n\
         [driver.parked]\ndesired_speed_mps = 0.01\n\
         [[vehicle]]\nname = \"parked\"\nroute = [\"main-boulevard/east/inner/1\"]\nat_m = 0.9\ndriver = \"parked\"\n\
         [[vehicle]]\nname = \"blind\"\nroute = [\"main-boulevard/east/inner/1\"]\nat_m = 0.3\nspeed_mps = 0.3\ndriver = \"blind\"\n"
    )
}

#[test]
fn everything_that_is_shipped_is_good() {
    let files = [
        "scenarios/roundabout.toml",
        "scenarios/city.toml",
        "scenarios/straight.toml",
        "assets/maps/ids3c.dxf",
        "roundabout",
        "ids3c",
    ];
    let output = city3d(&root(), &[&["check"], &files[..]].concat());
    assert_eq!(code(&output), 0, "{output:?}");
    assert_eq!(stdout(&output).matches(": good: ").count(), files.len());
}

#[test]
fn each_run_that_says_no_folder_has_a_new_one() {
    let folder = tempfile::tempdir().unwrap();
    for number in 1..=2 {
        let output = city3d(folder.path(), &["run", "straight", "--duration", "1"]);
        let name = format!("out/straight-{number}");
        assert!(code(&output) == 0 && stdout(&output).contains(&name), "{output:?}");
        assert!(folder.path().join(name).join("run.mcap").is_file());
    }
}

/// What a command says on standard error, with its exit code.
fn told(folder: &Path, args: &[&str]) -> (i32, String) {
    let output = city3d(folder, args);
    (code(&output), String::from_utf8(output.stderr).unwrap())
}

/// A command writes into a folder once; again only with `--force`.
fn is_written_over_only_when_asked(folder: &Path, args: &[&str], result: &str, remedy: &str) {
    assert_eq!(told(folder, args).0, 0, "{args:?}");
    let file = folder.join(result);
    std::fs::write(&file, "precious").unwrap();
    let (code, said) = told(folder, args);
    assert_eq!(code, 2, "{args:?}: {said}");
    assert!(
        said.contains(remedy) && said.contains("choose another --out, or --force writes over it"),
        "{said}"
    );
    assert_eq!(std::fs::read(&file).unwrap(), b"precious", "{args:?}");
    assert_eq!(told(folder, &[args, &["--force"]].concat()).0, 0, "{args:?}");
    assert_ne!(std::fs::read(&file).unwrap(), b"precious", "{args:?}");
}

#[test]
fn results_are_written_over_only_when_that_is_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let is_written_over = |args: &[&str], result: &str, remedy: &str| {
        is_written_over_only_when_asked(folder, args, result, remedy);
    };
    let run = ["run", "straight", "--duration", "1", "--out"];
    let earlier = |out: &str, file: &str| format!("{out}: it has {file}");
    is_written_over(
        &[&run[..], &["one"]].concat(),
        "one/run.mcap",
        &earlier("one", "run.mcap, vehicles.csv"),
    );
    assert_eq!(told(folder, &[&run[..], &["two", "--seed", "2"]].concat()).0, 0);
    let plot = ["plot", "one", "--out", "figures"];
    is_written_over(&plot, "figures/speed_path_1.csv", &earlier("figures", ""));
    let compare = ["compare", "one", "two", "--out", "both"];
    is_written_over(&compare, "both/comparison.csv", &earlier("both", ""));
    let fork = ["run", "one/run.mcap", "--from-tick", "50", "--out", "fork"];
    is_written_over(&fork, "fork/summary.json", &earlier("fork", "run.mcap"));
    // A sweep goes on where it was stopped, and another one does not take its place.
    let sweep = ["sweep", "straight", "--duration", "1", "--out", "seeds", "--seeds"];
    for seeds in ["1..2", "1..2"] {
        assert_eq!(told(folder, &[&sweep[..], &[seeds]].concat()).0, 0, "the same sweep");
    }
    let (code, said) = told(folder, &[&sweep[..], &["4..5"]].concat());
    assert!(code == 2 && said.contains("seeds/sweep.csv is of another sweep"), "{said}");
    assert_eq!(told(folder, &[&sweep[..], &["4..5", "--force"]].concat()).0, 0);
    let rows = std::fs::read_to_string(folder.join("seeds/sweep.csv")).unwrap();
    let seeds: Vec<&str> = rows.lines().skip(1).filter_map(|row| row.split(',').next()).collect();
    assert_eq!(seeds, ["4", "5"]);
}

#[test]
fn a_run_that_is_written_over_loses_its_summary_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let run = ["run", "straight", "--duration", "1", "--out", "mine"];
    assert_eq!(told(folder.path(), &run).0, 0);
    // What cannot be written ends the run.
    let log = folder.path().join("mine/run.mcap");
    std::fs::remove_file(&log).unwrap();
    std::fs::create_dir(&log).unwrap();
    assert_eq!(told(folder.path(), &[&run[..], &["--force"]].concat()).0, 1);
    assert!(!folder.path().join("mine/summary.json").exists());
}

#[test]
fn the_halves_of_the_link_ask_before_they_write_over_a_run_or_a_part_of_one() {
    let folder = tempfile::tempdir().unwrap();
    let part = folder.path().join("old/part-2");
    std::fs::create_dir_all(&part).unwrap();
    std::fs::write(part.join("run.mcap"), "precious").unwrap();
    for args in
        [&["serve", "straight", "--headless", "--bind", "127.0.0.1:0"][..], &["mainframe", "straight"]]
    {
        let (code, said) = told(folder.path(), &[args, &["--out", "old"]].concat());
        assert!(code == 2 && said.contains("old/part-2: it has run.mcap of an earlier command"), "{said}");
    }
    assert_eq!(std::fs::read(part.join("run.mcap")).unwrap(), b"precious");
}

#[test]
fn redirected_messages_have_no_colour_codes() {
    let folder = tempfile::tempdir().unwrap();
    let noisy = ["run", "straight", "--duration", "1", "--log-hz", "5000", "--out", "mine"];
    let (code, said) = told(folder.path(), &noisy);
    assert!(code == 0 && said.contains("WARN"), "{said}");
    assert!(!said.contains('\u{1b}'), "{said:?}");
    // On a terminal they have, unless the user wants none.
    let Some(terminal) = Terminal::find() else { return };
    let again =
        |variable: &str| terminal.output(folder.path(), &[&noisy[..], &["--force"]].concat(), variable);
    assert!(again("NO_COLOR=").contains("\u{1b}[33m"), "{:?}", again("NO_COLOR="));
    assert!(again("NO_COLOR=1").contains("WARN") && !again("NO_COLOR=1").contains("\u{1b}[33m"));
}

/// Runs the program on a pseudo terminal, by `script` of util-linux.
struct Terminal;

impl Terminal {
    fn find() -> Option<Self> {
        let is_there = Command::new("script").arg("--version").output().is_ok_and(|it| it.status.success());
        assert!(is_there || std::env::var_os("CI").is_none(), "util-linux (script) is not installed");
        if !is_there {
            eprintln!("SKIPPED: util-linux (script) is not installed");
        }
        is_there.then_some(Self)
    }

    /// What it shows of the program.
    fn output(&self, folder: &Path, args: &[&str], variable: &str) -> String {
        let program = env!("CARGO_BIN_EXE_city3d");
        let line = format!("env TERM=xterm {variable} {program} {}", args.join(" "));
        let output = Command::new("script").args(["-qec", &line, "/dev/null"]).current_dir(folder).output();
        String::from_utf8_lossy(&output.unwrap().stdout).into_owned()
    }
}

#[test]
fn names_of_files_do_not_control_the_terminal() {
    let folder = tempfile::tempdir().unwrap();
    let text = "name = \"\\u001b]0;title\\u0007\\u001b[31mred\\r\\u202e\"\nduration_s = 1\n[[vehicle]]\n\
                route = [\"main-boulevard/east/inner/1\"]\nat_m = 0.5\n";
    std::fs::write(folder.path().join("a.toml"), text).unwrap();
    let output = city3d(folder.path(), &["run", "a.toml", "--out", "a"]);
    let shown = stdout(&output) + &String::from_utf8_lossy(&output.stderr);
    assert_eq!(code(&output), 0, "{shown}");
    assert!(shown.contains("\\u{1b}]0;title\\u{7}\\u{1b}[31mred\\u{d}\\u{202e}: 1.0 s simulated"), "{shown}");
    // In an error, and in a message of the log.
    std::fs::write(folder.path().join("b.toml"), text.replace("inner/1", "inner\\u001b[2J")).unwrap();
    let (code, error) = told(folder.path(), &["check", "b.toml"]);
    assert!(code == 2 && error.contains("\\u{1b}[2J"), "{error}");
    for text in [shown, error] {
        assert!(!text.contains(|c: char| c != '\n' && c.is_control() || c == '\u{202e}'), "{text:?}");
    }
}

#[test]
fn seeds_are_those_of_a_scenario_and_are_given_once() {
    let root = root();
    for command in ["run", "view", "serve"] {
        let (code, error) = told(&root, &[command, "straight", "--seed", "9223372036854775808"]);
        assert!(code == 2 && error.contains("from 0 to 9223372036854775807"), "{command}: {error}");
    }
    let folder = tempfile::tempdir().unwrap();
    for (set, option) in [
        ("seed=1,2", ["--seeds", "5..6"]),
        ("seed=1,2", ["--seed", "5"]),
        ("duration_s=1,2", ["--duration", "3"]),
    ] {
        let args = [&["sweep", "straight", "--out", "o", "--set", set], &option[..]].concat();
        let (code, error) = told(folder.path(), &args);
        let names_both = error.contains("--set") && error.contains(option[0]);
        assert!(code == 2 && names_both && !folder.path().join("o").exists(), "{error}");
    }
}

#[test]
fn a_name_that_is_far_too_long_is_told_in_short() {
    let folder = tempfile::tempdir().unwrap();
    let long = "a".repeat(100_000);
    let text = format!(
        "name = \"{long}\"\nduration_s = 1\n[[vehicle]]\nroute = [\"main-boulevard/east/inner/1\"]\nat_m = 0.5\n"
    );
    std::fs::write(folder.path().join("long.toml"), text).unwrap();
    for command in ["run", "check"] {
        let (code, error) = told(folder.path(), &[command, "long.toml"]);
        assert!(code == 2 && error.contains("line 1, column 8: name has 100000 characters"), "{error}");
        assert!(error.len() < 300, "{error}");
    }
    let (code, error) = told(folder.path(), &["run", &long]);
    assert!(code == 2 && error.contains("aaa... (100000 characters)") && error.len() < 500, "{error}");
}

#[test]
fn what_a_log_costs_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let output = city3d(folder.path(), &["bench", "log", "straight", "--duration", "2", "--pairs", "1"]);
    let report: serde_json::Value = serde_json::from_str(&stdout(&output)).unwrap();
    let length = std::fs::metadata(folder.path().join("out/bench-log/run.mcap")).unwrap().len();
    assert_eq!(report["log_bytes"].as_u64(), Some(length));
    assert_eq!((report["vehicles"].as_u64(), report["simulated_s"].as_f64()), (Some(2), Some(2.0)));
    assert!(report["with_log_s"].as_f64().unwrap() > 0.0, "{report}");
}

#[test]
fn help_is_there_for_every_command() {
    let help = city3d(&root(), &["--help"]);
    assert_eq!(code(&help), 0);
    let listed = stdout(&help);
    for command in ["run", "serve", "mainframe", "check", "generate"] {
        assert!(listed.contains(&format!("  {command}")), "{listed}");
        let output = city3d(&root(), &[command, "--help"]);
        assert_eq!(code(&output), 0, "{command}");
        assert!(stdout(&output).contains("Usage: city3d"), "{command}");
    }
    assert!(stdout(&city3d(&root(), &["run", "--help"])).contains("--speed"));
    assert!(stdout(&city3d(&root(), &["--version"])).contains(env!("CARGO_PKG_VERSION")));
}

#[test]
fn wrong_arguments_are_bad_input() {
    let out = tempfile::tempdir().unwrap();
    let folder = out.path().to_str().unwrap();
    for args in [
        vec!["fly"],
        vec!["run", "nowhere", "--out", folder],
        vec!["run", "straight", "--out", folder, "--duration", "-1"],
        vec!["run", "straight", "--out", folder, "--duration", "1e300"],
        vec!["run", "straight", "--out", folder, "--speed", "0"],
        vec!["run", "straight", "--out", folder, "--speed", "1e-300"],
        vec!["run", "straight", "--out", folder, "--seed", "-5"],
        vec!["run", "straight", "--out", folder, "--model", "boat"],
        vec!["run", "straight", "--out", folder, "--log-hz", "0"],
        vec!["serve", "nowhere"],
        vec!["serve", "straight", "--bind", "nowhere"],
        vec!["serve", "straight", "--allow", "the laboratory"],
        vec!["serve", "straight", "--key", "nowhere"],
        vec!["serve", "straight", "--rate", "0"],
        vec!["mainframe", "straight", "--city", "nowhere"],
        vec!["check"],
        vec!["check", "nowhere.toml"],
        vec!["check", "nowhere.dxf"],
        vec!["check", folder],
    ] {
        let output = city3d(out.path(), &args);
        assert_eq!(code(&output), 2, "{args:?}");
        assert!(!output.stderr.is_empty(), "{args:?}");
    }
    assert_eq!(std::fs::read_dir(out.path()).unwrap().count(), 0, "nothing is written for bad input");
}

#[test]
fn what_is_no_log_is_told_what_to_do_instead() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    for out in ["out/one", "out/deep/two"] {
        let made = city3d(path, &["run", "straight", "--duration", "1", "--out", out]);
        assert_eq!(code(&made), 0, "{made:?}");
    }
    std::fs::create_dir(path.join("empty")).unwrap();
    std::fs::write(path.join("mine.toml"), crash(false)).unwrap();
    for (given, told) in [
        ("roundabout", vec!["is a scenario", "city3d run roundabout --out"]),
        ("mine.toml", vec!["is a scenario", "city3d run mine.toml --out"]),
        ("out", vec!["out/one", "out/deep/two"]),
        ("empty", vec!["without a run"]),
        ("out/one/summary.json", vec!["city3d replay out/one"]),
        ("out/one/vehicles.csv", vec!["--scenario SCENARIO --out DIR"]),
    ] {
        let output = city3d(path, &["replay", given]);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(code(&output), 2, "{given}: {said}");
        assert!(told.iter().all(|told| said.contains(told)), "{given}: {said}");
    }
}

#[test]
fn pictures_of_a_log_say_what_cannot_be_had() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    assert_eq!(code(&city3d(path, &["run", "straight", "--duration", "4", "--out", "run"])), 0);
    let said = |args: &[&str]| {
        let quality = ["--size", "320x240", "--quality", "low", "--adapter", "software"];
        let output = city3d(path, &[args, &quality].concat());
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        if said.contains("adapter") && code(&output) == 1 {
            assert!(std::env::var_os("CI").is_none(), "{said}");
            eprintln!("SKIPPED: {said}");
            return None;
        }
        Some((code(&output), said))
    };
    let (failed, text) = said(&["replay", "run", "--picture", "window.jpg"]).unwrap();
    assert!(failed == 2 && text.contains("window.png"), "{text}");
    let Some((failed, text)) = said(&["replay", "run", "--picture", "window.png", "--at", "9"]) else {
        return;
    };
    assert!(failed == 2 && text.contains("ends at 4.00 s"), "{text}");
    let whole = std::fs::read(path.join("run/run.mcap")).unwrap();
    std::fs::write(path.join("torn.mcap"), &whole[..whole.len() * 3 / 4]).unwrap();
    let (failed, text) = said(&["replay", "torn.mcap", "--picture", "window.png"]).unwrap();
    assert!(failed == 0 && text.contains("the log is truncated"), "{text}");
}

#[test]
fn a_run_writes_what_the_documents_promise() {
    // Shipped scenarios run from any folder.
    let out = tempfile::tempdir().unwrap();
    let output = city3d(out.path(), &["run", "straight", "--out", "here/there", "--duration", "2", "--json"]);
    assert_eq!(code(&output), 0, "{output:?}");
    let folder = out.path().join("here/there");

    let printed: Value = serde_json::from_str(&stdout(&output)).unwrap();
    let text = std::fs::read_to_string(folder.join("summary.json")).unwrap();
    let summary: Value = serde_json::from_str(&text).unwrap();
    assert_eq!(printed["state_hash"], summary["state_hash"]);
    assert_eq!(summary["scenario"], "straight");
    assert_eq!((&summary["seed"], &summary["collisions"]), (&1.into(), &0.into()));
    assert!((summary["simulated_s"].as_f64().unwrap() - 2.0).abs() < 1e-9);
    let factor = summary["simulated_s"].as_f64().unwrap() / summary["wall_s"].as_f64().unwrap();
    assert!((summary["real_time_factor"].as_f64().unwrap() - factor).abs() < 1e-6 * factor);
    let hash = summary["state_hash"].as_str().unwrap();
    assert!(hash.len() == 16 && u64::from_str_radix(hash, 16).is_ok(), "{hash}");
    let spawn = &summary["events"][0];
    assert_eq!((&spawn["kind"], &spawn["vehicle"], &spawn["t"]), (&"spawn".into(), &1.into(), &0.0.into()));
    for id in ["1", "2"] {
        let vehicle = &summary["vehicles"][id];
        for field in ["distance_m", "stops", "mean_lateral_error_m", "max_lateral_error_m", "collisions"] {
            assert!(vehicle[field].is_number(), "{field} of {vehicle}");
        }
        assert_eq!(vehicle["status"], "driving");
    }

    let mut table = csv::Reader::from_path(folder.join("vehicles.csv")).unwrap();
    let columns: Vec<String> = table.headers().unwrap().iter().map(str::to_owned).collect();
    assert_eq!(columns, city3d_logbook::record::COLUMNS);
    let rows: Vec<csv::StringRecord> = table.records().map(Result::unwrap).collect();
    // Ten a second, the first instant included, for each of two vehicles.
    assert_eq!(rows.len(), 21 * 2);
    assert_eq!((&rows[1][0], &rows[1][2], &rows[1][3]), ("0.000", "2", "follower"));
    let distance: f64 = rows[40][16].parse().unwrap();
    let told = summary["vehicles"]["1"]["distance_m"].as_f64().unwrap();
    assert!((distance - told).abs() < 0.001, "{distance} {told}");

    let log = std::fs::read(folder.join("run.mcap")).unwrap();
    let times = mcap::MessageStream::new(&log)
        .unwrap()
        .map(Result::unwrap)
        .filter(|message| message.channel.topic.contains("snapshot"))
        .map(|message| message.log_time)
        .collect::<Vec<_>>();
    assert_eq!(times.len(), 101);
    assert!(times.is_sorted());
}

#[test]
fn a_collision_fails_the_run_where_it_is_forbidden() {
    let out = tempfile::tempdir().unwrap();
    for (forbidden, expected) in [(true, 1), (false, 0)] {
        std::fs::write(out.path().join("crash.toml"), crash(forbidden)).unwrap();
        let output = city3d(out.path(), &["run", "crash.toml", "--out", "out", "--force"]);
        assert_eq!(code(&output), expected, "{output:?}");
        let text = std::fs::read_to_string(out.path().join("out/summary.json")).unwrap();
        let summary: Value = serde_json::from_str(&text).unwrap();
        assert_eq!(summary["collisions"], 1);
        for id in ["1", "2"] {
            assert_eq!(summary["vehicles"][id]["collisions"], 1);
            assert_eq!(summary["vehicles"][id]["status"], "collided");
        }
    }
}

#[test]
fn the_log_has_the_moment_of_an_impact_whatever_its_rate() {
    let out = tempfile::tempdir().unwrap();
    std::fs::write(out.path().join("crash.toml"), crash(false)).unwrap();
    let output = city3d(out.path(), &["run", "crash.toml", "--out", "out", "--log-hz", "2"]);
    assert_eq!(code(&output), 0, "{output:?}");
    let text = std::fs::read_to_string(out.path().join("out/summary.json")).unwrap();
    let summary: Value = serde_json::from_str(&text).unwrap();
    let events = summary["events"].as_array().unwrap();
    let collision = events.iter().find(|event| event["kind"] == "collision").unwrap();
    let at_ns = (collision["t"].as_f64().unwrap() * 1e9).round() as u64;
    let log = std::fs::read(out.path().join("out/run.mcap")).unwrap();
    let times: Vec<u64> = mcap::MessageStream::new(&log)
        .unwrap()
        .map(Result::unwrap)
        .filter(|message| message.channel.topic.contains("snapshot"))
        .map(|message| message.log_time)
        .collect();
    let is_due = |time: &u64| time.is_multiple_of(500_000_000);
    assert!(!is_due(&at_ns), "a collision between two states: {at_ns}");
    assert!(times.iter().any(|time| time.abs_diff(at_ns) < 1_000_000), "{times:?} {at_ns}");
    assert!(times.iter().filter(|time| !is_due(time)).count() == 1 && times.is_sorted(), "{times:?}");
}

#[test]
fn check_prints_one_json_line_a_file() {
    let out = tempfile::tempdir().unwrap();
    std::fs::write(out.path().join("bad.toml"), "nam = 3\n").unwrap();
    let output = city3d(out.path(), &["check", "--json", "straight", "bad.toml", "ids3c"]);
    assert_eq!(code(&output), 2);
    let lines: Vec<Value> = stdout(&output).lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let good: Vec<bool> = lines.iter().map(|line| line["ok"].as_bool().unwrap()).collect();
    assert_eq!(good, [true, false, true]);
    assert!(lines[1]["message"].as_str().unwrap().contains("bad.toml: line 1, column 1"));
}

#[test]
fn check_lists_the_lanes_that_routes_can_name() {
    let text = stdout(&city3d(&root(), &["check", "--lanes", "ids3c"]));
    let row = text.lines().find(|line| line.starts_with("west-roundabout/ring/outer/3 ")).unwrap();
    let cells: Vec<&str> = row.split_whitespace().collect();
    assert!(cells[1].parse::<f64>().unwrap() > 0.1 && cells[2].parse::<f64>().unwrap() > 0.1, "{row}");
    assert!(cells.len() > 3, "it leads somewhere: {row}");
    assert!(cells[3..].iter().all(|next| text.contains(&format!("\n{next} "))), "{row}");

    let output = city3d(&root(), &["check", "--json", "--lanes", "straight"]);
    let line: Value = serde_json::from_str(&stdout(&output)).unwrap();
    let lanes = line["lanes"].as_array().unwrap();
    assert!(lanes.iter().any(|lane| lane["kind"] == "connector") && lanes[0]["successors"].is_array());
}

#[test]
fn check_gives_routes_and_conflicts_as_data() {
    let output = city3d(&root(), &["check", "--json", "--routes", "roundabout-coordinated"]);
    let line: Value = serde_json::from_str(&stdout(&output)).unwrap();
    let vehicles = line["routes"]["vehicles"].as_array().unwrap();
    let names: Vec<_> = vehicles.iter().filter_map(|vehicle| vehicle["name"].as_str()).collect();
    assert_eq!(names, ["path1_a", "path1_b", "path1_c", "path2_a", "path2_b", "path2_c"]);
    assert_eq!(vehicles[0]["start"]["axle_m"], 0.42);
    assert_eq!(vehicles[0]["driver"]["min_acceleration_mps2"], -0.2);
    assert_eq!(vehicles[3]["passages"][0]["zone"], "west-roundabout");
    assert!(
        line["routes"]["conflicts"].as_array().unwrap().iter().any(|conflict| conflict["kind"] == "merge")
    );
    // A map alone has the conflicts of its lanes, and they are those of the scenario's map.
    let output = city3d(&root(), &["check", "--json", "--routes", "ids3c"]);
    let map: Value = serde_json::from_str(&stdout(&output)).unwrap();
    assert!(map["routes"].is_null() && map["lane_conflicts"] == line["lane_conflicts"]);
    assert_eq!(map["lane_conflicts"][0]["lanes"].as_array().unwrap().len(), 2);
}

#[test]
fn a_folder_that_cannot_be_written_fails_with_its_name() {
    let out = tempfile::tempdir().unwrap();
    std::fs::write(out.path().join("file"), "").unwrap();
    for folder in ["file", "file/below"] {
        let output = city3d(out.path(), &["run", "straight", "--out", folder]);
        assert_eq!(code(&output), 1);
        assert!(String::from_utf8_lossy(&output.stderr).contains(folder), "{output:?}");
    }
    let output = city3d(out.path(), &["generate", "map", "--out", "file"]);
    assert_eq!(code(&output), 1);
}

#[test]
fn speed_keeps_pace_with_the_clock() {
    let out = tempfile::tempdir().unwrap();
    let start = Instant::now();
    let output =
        city3d(out.path(), &["run", "straight", "--out", "out", "--duration", "1.5", "--speed", "1"]);
    assert_eq!(code(&output), 0);
    assert!(start.elapsed() >= Duration::from_millis(1500), "{:?}", start.elapsed());
}

#[test]
fn the_map_can_be_made_again_byte_by_byte() {
    let out = tempfile::tempdir().unwrap();
    let output = city3d(out.path(), &["generate", "map", "--out", "maps"]);
    assert_eq!(code(&output), 0);
    let made = std::fs::read(out.path().join("maps/ids3c.dxf")).unwrap();
    assert!(made == std::fs::read(root().join("assets/maps/ids3c.dxf")).unwrap());
    // Where a file is named that is what is written.
    let output = city3d(out.path(), &["generate", "map", "--out", "own.dxf"]);
    assert_eq!(code(&output), 0);
    assert!(made == std::fs::read(out.path().join("own.dxf")).unwrap());
}

#[test]
fn a_reader_that_closes_its_end_is_no_failure() {
    let folder = tempfile::tempdir().unwrap();
    let commands: [&[&str]; 4] = [
        &["check", "--lanes", "ids3c"],
        &["check", "--json", "ids3c"],
        &["run", "straight", "--duration", "0.1", "--out", "out"],
        &["generate", "map", "--out", "maps"],
    ];
    for args in commands {
        // The end that is read is dropped at once.
        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        let output = Command::new(env!("CARGO_BIN_EXE_city3d"))
            .args(args)
            .current_dir(folder.path())
            .stdout(writer)
            .output()
            .unwrap();
        assert_eq!(code(&output), 0, "{args:?}: {output:?}");
    }
}

#[test]
fn a_measured_map_is_repaired_into_another_file() {
    let folder = tempfile::tempdir().unwrap();
    let gap = std::fs::read_to_string(root().join("tests/corpus/maps/gap.dxf")).unwrap();
    std::fs::write(folder.path().join("gap.dxf"), &gap).unwrap();
    let refused = city3d(folder.path(), &["check", "gap.dxf"]);
    assert_eq!(code(&refused), 2);
    assert!(String::from_utf8_lossy(&refused.stderr).contains("--repair"), "{refused:?}");
    let output = city3d(folder.path(), &["check", "--repair", "15mm", "gap.dxf", "--out", "good.dxf"]);
    assert_eq!(code(&output), 0, "{output:?}");
    let text = stdout(&output);
    assert!(text.contains("gap.dxf: line 19, LINE 21: start moved by"), "{text}");
    assert!(text.contains("good.dxf: good:"), "{text}");
    assert_eq!(code(&city3d(folder.path(), &["check", "good.dxf"])), 0);
    // Less than the gap; over the map itself; without a unit; without a place for the result.
    for arguments in [
        &["check", "--repair", "2mm", "gap.dxf", "--out", "other.dxf"][..],
        &["check", "--repair", "15mm", "gap.dxf", "--out", "./gap.dxf"],
        &["check", "--repair", "15", "gap.dxf", "--out", "other.dxf"],
        &["check", "--repair", "15mm", "gap.dxf"],
    ] {
        assert_eq!(code(&city3d(folder.path(), arguments)), 2, "{arguments:?}");
    }
    assert!(!folder.path().join("other.dxf").exists());
    assert_eq!(std::fs::read_to_string(folder.path().join("gap.dxf")).unwrap(), gap);
}
