//! Runs made again from their logs: verified to the last bit, recovered where torn, refused where changed.

use crate::support::link;
use crate::support::live;

use city3d_logbook::record::{LogOrigin, LogWriter, read_commands};
use city3d_protocol::snapshot::{Pedals, SimCommand, VehicleId};
use city3d_session::playback::{PlaybackCommand, Player};
use city3d_session::{Order, RunPhase, Speed};
use city3d_simulation::runner::Run;
use city3d_simulation::scenario::shipped_scenarios;
use link::{city3d, mainframe, root, serve};
use live::{live as run_live, roundabout, until};
use serde_json::Value;
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::process::Child;
use std::time::{Duration, Instant};

/// Exit code, report and what was complained of.
fn verify(log: &Path) -> (i32, Value, String) {
    let arguments = ["replay", log.to_str().unwrap(), "--verify", "--json"];
    let output = city3d(&arguments, log.parent().unwrap()).output().unwrap();
    let report = serde_json::from_slice(&output.stdout).unwrap_or_default();
    (output.status.code().unwrap(), report, String::from_utf8(output.stderr).unwrap())
}

fn record(arguments: &[&str], folder: &Path) {
    let output = city3d(&[&["run"], arguments, &["--out", "run"]].concat(), folder).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn every_shipped_scenario_comes_out_the_same_at_every_tick() {
    for scenario in shipped_scenarios() {
        let folder = tempfile::tempdir().unwrap();
        record(&[scenario, "--duration", "4"], folder.path());
        let (code, report, said) = verify(&folder.path().join("run/run.mcap"));
        assert_eq!((code, &report["torn"]), (0, &Value::Null), "{scenario}: {said}");
        assert_eq!((&report["ticks_agreeing"], &report["simulated_s"]), (&401.into(), &4.0.into()));
    }
}

#[test]
fn a_log_needs_no_other_file_and_keeps_what_the_command_line_changed() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let beside = folder.join("mine");
    std::fs::create_dir(&beside).unwrap();
    let text = std::fs::read_to_string(root().join("scenarios/city.toml")).unwrap();
    let (before, after) = text.split_once("map = \"ids3c\"").unwrap();
    std::fs::write(beside.join("own.toml"), format!("{before}map = \"own.dxf\"{after}")).unwrap();
    std::fs::copy(root().join("assets/maps/ids3c.dxf"), beside.join("own.dxf")).unwrap();
    std::fs::copy(root().join("assets/models/sedan.glb"), beside.join("sedan.glb")).unwrap();
    let changed = ["mine/own.toml", "--duration", "2.5", "--seed", "7", "--model", "bicycle"];
    record(&changed, folder);
    std::fs::remove_dir_all(&beside).unwrap();
    let log = folder.join("run/run.mcap");
    let (code, report, said) = verify(&log);
    assert_eq!((code, &report["ticks_agreeing"]), (0, &251.into()), "{said}");
    let models = city3d_logbook::record::LogReader::open(&log).unwrap().experiment().unwrap().models;
    assert!(models.files.contains_key("sedan.glb"));
}

#[test]
fn a_person_who_takes_over_and_gives_back_is_in_the_log() {
    let folder = tempfile::tempdir().unwrap();
    let live = run_live(roundabout(40.0), Some(folder.path()));
    live.send(Order::Speed(Speed::times(10.0)));
    live.send(Order::Start);
    let vehicle = VehicleId(1);
    until(&live, "a second", |run_state| run_state.now.tick > 100);
    for gas in [0.2, 1.0 / 3.0] {
        let pedals = Pedals { gas, steering_rad: 0.02 * gas, ..Pedals::default() };
        live.send(Order::Drive(vehicle, pedals));
        until(&live, "the pedal", |run_state| run_state.now.vehicle(vehicle).unwrap().gas == gas);
    }
    live.send(Order::Release(vehicle));
    let given_back = live.run_state().now.tick;
    until(&live, "some way further", |run_state| run_state.now.tick > given_back + 100);
    live.send(Order::Pause);
    let last = until(&live, "paused", |run_state| run_state.phase == RunPhase::Paused);
    live.stop().unwrap();
    let log = folder.path().join("run-1/run.mcap");
    assert_eq!(read_commands(&log).unwrap().len(), 3);
    let (code, report, said) = verify(&log);
    assert_eq!((code, &report["ticks_agreeing"]), (0, &(last.now.tick + 1).into()), "{said}");
}

#[test]
fn a_served_city_comes_out_the_same_and_the_far_control_has_nothing_to_compare() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let mut city = serve(&["roundabout", "--duration", "5", "--lockstep", "--out", "served"], folder);
    let mut far = mainframe(&city.address, &["roundabout", "--duration", "5", "--out", "far"], folder);
    assert_eq!((far.wait(), city.wait()), (0, 0));
    let (code, report, said) = verify(&folder.join("served/run.mcap"));
    assert_eq!((code, &report["ticks_agreeing"]), (0, &501.into()), "{said}");
    let (code, _, said) = verify(&folder.join("far/run.mcap"));
    assert!(code == 2 && said.contains("the log of the city"), "{code} {said}");
    // Both can be watched; whom the link has brought to the city is known by name.
    for log in ["served/run.mcap", "far/run.mcap"] {
        let mut player = Player::open(&folder.join(log), Box::new(|| {})).unwrap();
        player.command(PlaybackCommand::Seek(4.0));
        while !player.is_settled() {
            player.advance(Instant::now());
            std::thread::sleep(Duration::from_millis(1));
        }
        let now = &player.run_state().now;
        let seen: Vec<_> = now.iter().map(|(v, info)| (v.id.0, info.name.as_str())).collect();
        let names = ["path1_a", "path1_b", "path1_c", "path2_a", "path2_b", "path2_c"];
        assert_eq!(seen, (1..).zip(names).collect::<Vec<_>>(), "{log}");
        assert!((player.head().to_s - 5.0).abs() < 0.1, "{:?}", player.head());
    }
}

#[test]
fn a_killed_process_leaves_a_log_up_to_its_last_second() {
    let folder = tempfile::tempdir().unwrap();
    let arguments = ["run", "roundabout", "--duration", "600", "--speed", "4", "--out", "run"];
    let mut child = city3d(&arguments, folder.path()).spawn().unwrap();
    let log = folder.path().join("run/run.mcap");
    let begun = Instant::now();
    let told = |log: &Path| city3d_logbook::record::last_tick(log).map_or(0, |(tick, _)| tick);
    while told(&log) < 300 {
        assert!(begun.elapsed() < Duration::from_secs(120), "three seconds never come");
        std::thread::sleep(Duration::from_millis(50));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    let (code, report, said) = verify(&log);
    assert_eq!(code, 0, "{said}");
    assert!(report["ticks_agreeing"].as_u64().unwrap() > 300, "{report}");
    assert!(report["torn"].is_string(), "{report}");

    // Cut anywhere, it is read as far as it goes, or says that nothing is left.
    let bytes = std::fs::read(&log).unwrap();
    let cut = folder.path().join("cut.mcap");
    let mut ticks = Vec::new();
    for part in 1..=8 {
        std::fs::write(&cut, &bytes[..bytes.len() * part / 8 - 3]).unwrap();
        let (code, report, said) = verify(&cut);
        let compared = report["ticks_agreeing"].as_u64().unwrap_or(0);
        let is_told = match code {
            0 => compared > 0 && report["torn"].is_string(),
            1 => compared == 0 && said.contains("no tick to compare: it ends"),
            _ => said.contains("ends"),
        };
        assert!(is_told && report.get("damage").is_none(), "{part}: {code} {said}");
        ticks.push(compared);
    }
    assert!(ticks.is_sorted() && ticks[7] > 200, "{ticks:?}");
}

/// A run in real time, and when its log had begun.
struct Doomed {
    child: Child,
    log: PathBuf,
    since: Instant,
}

impl Doomed {
    fn begin(folder: &Path, name: &str) -> Self {
        let arguments = ["run", "roundabout", "--duration", "600", "--speed", "1", "--out", name];
        let child = city3d(&arguments, folder).spawn().unwrap();
        let log = folder.join(name).join("run.mcap");
        while city3d_logbook::record::last_tick(&log).is_err() {
            std::thread::sleep(Duration::from_millis(2));
        }
        Self { child, log, since: Instant::now() }
    }

    /// Ends it without a warning; the simulated seconds that its log lacks.
    fn kill(mut self) -> f64 {
        let lived_s = self.since.elapsed().as_secs_f64();
        self.child.kill().unwrap();
        self.child.wait().unwrap();
        let (code, report, said) = verify(&self.log);
        // One that was killed before its first chunk has nothing to compare.
        let is_empty = report["ticks_agreeing"] == 0 && said.contains("no tick to compare");
        assert!(code == 0 || (code == 1 && is_empty), "{code} {said}");
        lived_s - report["simulated_s"].as_f64().unwrap()
    }
}

#[test]
fn fifty_processes_that_are_killed_lose_their_last_second_at_most() {
    let folder = tempfile::tempdir().unwrap();
    // Moments that spread evenly over all parts of a second, the same in each run of the test.
    let moments = (0..50).map(|k| 0.05 + 3.0 * (f64::from(k) * 0.618_034).fract());
    let mut moments: Vec<f64> = moments.collect();
    let (mut killed, mut worst_s) = (0, 0.0_f64);
    while !moments.is_empty() {
        let mut batch = moments.split_off(moments.len() - 10);
        batch.sort_by(f64::total_cmp);
        let runs: Vec<Doomed> =
            (0..batch.len()).map(|k| Doomed::begin(folder.path(), &format!("run-{}", killed + k))).collect();
        for (run, moment_s) in runs.into_iter().zip(batch) {
            // What the machine was late by, the run may have been late by as well.
            let due = run.since + Duration::from_secs_f64(moment_s);
            std::thread::sleep(due.saturating_duration_since(Instant::now()));
            worst_s = worst_s.max(run.kill());
            killed += 1;
        }
    }
    // A second of the run, and what a busy machine needs to write it.
    assert!(killed == 50 && worst_s < 1.4, "{killed} killed, and {worst_s} s lost");
}

/// A log of 3 s of the roundabout in which a command at a tick is another than that which was applied.
fn falsified(log: &Path, at_tick: u64, falsify: impl Fn(&mut SimCommand)) {
    let mut run = Run::new(roundabout(3.0)).unwrap();
    let sink = BufWriter::new(File::create(log).unwrap());
    let mut writer = LogWriter::new(sink, run.experiment(), LogOrigin::Run, &std::env::temp_dir()).unwrap();
    loop {
        let (tick, time_s, state_hash) = {
            let snapshot = run.snapshot();
            (snapshot.tick, snapshot.time_s, snapshot.state_hash)
        };
        writer.tick(tick, time_s, state_hash).unwrap();
        if tick.is_multiple_of(2) {
            writer.snapshot(run.snapshot()).unwrap();
        }
        if tick == 300 {
            break;
        }
        if (100..200).contains(&tick) {
            run.inject(SimCommand::Drive(VehicleId(1), Pedals { gas: 0.5, ..Pedals::default() }));
        }
        run.step();
        for command in run.commands() {
            let mut command = command.clone();
            if tick == at_tick {
                falsify(&mut command);
            }
            writer.command(tick, time_s, &command).unwrap();
        }
    }
    writer.finish().unwrap();
}

#[test]
fn a_log_whose_command_was_changed_fails_at_the_next_tick_and_names_the_vehicle() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("run.mcap");
    falsified(&log, 150, |_| ());
    let (code, report, said) = verify(&log);
    assert_eq!((code, &report["ticks_agreeing"]), (0, &301.into()), "{said}");

    falsified(&log, 151, |command| {
        if let SimCommand::Drive(_, pedals) = command {
            pedals.gas = 0.501;
        }
    });
    let (code, report, said) = verify(&log);
    let first = &report["first_difference"];
    assert_eq!((code, &report["ticks_agreeing"], &first["tick"]), (1, &152.into(), &152.into()), "{said}");
    assert_ne!(first["recorded"], first["simulated"]);
    assert_eq!(first["compared_at_tick"], 152);
    let vehicles = first["vehicles"].as_array().unwrap();
    assert_eq!((vehicles.len(), &vehicles[0]["id"]), (1, &1.into()), "{report}");

    falsified(&log, 220, |command| {
        if let SimCommand::Follow(trajectory) = command
            && trajectory.vehicle == VehicleId(2)
        {
            trajectory.points.iter_mut().for_each(|point| point.speed_mps += 1.0);
        }
    });
    let (code, report, said) = verify(&log);
    let first = &report["first_difference"];
    assert_eq!((code, &first["tick"], &first["compared_at_tick"]), (1, &221.into(), &222.into()), "{said}");
    assert_eq!(first["vehicles"][0]["id"], 2, "{report}");
}

#[test]
fn what_is_no_log_of_city3d_is_refused_with_the_remedy() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a file");
    std::fs::write(&file, "t,tick,id\n").unwrap();
    let (code, _, said) = verify(&file);
    assert!(code == 2 && said.contains("not an MCAP file; give the run.mcap"), "{code} {said}");
    mcap::Writer::new(File::create(&file).unwrap()).unwrap().finish().unwrap();
    let (code, _, said) = verify(&file);
    assert!(code == 2 && said.contains("give the run.mcap"), "{code} {said}");
    let mut writer = mcap::Writer::new(File::create(&file).unwrap()).unwrap();
    let metadata = [("version".to_owned(), "0.0.9".to_owned())].into();
    writer.write_metadata(&mcap::records::Metadata { name: "city3d".to_owned(), metadata }).unwrap();
    writer.finish().unwrap();
    let (code, _, said) = verify(&file);
    assert!(code == 2 && said.contains("version 0.0.9") && said.contains("record the run again"), "{said}");
    let output = city3d(&["replay", "a file"], folder.path()).output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.code() == Some(2) && said.contains("record the run again"), "{said}");
}

#[test]
fn pictures_of_a_log_are_those_of_its_run() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    record(&["roundabout", "--duration", "3"], folder);
    let look =
        ["--adapter", "software", "--quality", "fast", "--size", "96x72", "--from", "1", "--every", "0.5"];
    let draw = |what: &str, rest: &[&str]| {
        let output = city3d(&[&["frames", what], rest, &look[..]].concat(), folder).output().unwrap();
        (output.status.code(), String::from_utf8(output.stderr).unwrap())
    };
    assert_eq!(draw("roundabout", &["--duration", "2.5", "--vehicle", "1", "--out", "a"]).0, Some(0));
    let (code, said) = draw("run/run.mcap", &["--duration", "2.5", "--vehicle", "1", "--out", "b"]);
    assert_eq!(code, Some(0), "{said}");
    let files = |name: &str| {
        let entries = std::fs::read_dir(folder.join(name)).unwrap().map(Result::unwrap);
        let mut files: Vec<_> =
            entries.map(|entry| (entry.file_name(), std::fs::read(entry.path()).unwrap())).collect();
        files.sort();
        files
    };
    let (run, log) = (files("a"), files("b"));
    assert!(run.len() > 4, "{}", run.len());
    assert!(run == log, "the pictures of the log are others");
    let (code, said) = draw("run/run.mcap", &["--seed", "3", "--out", "c"]);
    assert!(code == Some(2) && said.contains("--seed"), "{said}");
}
