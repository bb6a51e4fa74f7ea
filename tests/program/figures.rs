//! Figures and comparisons of recorded runs: what they show is held against the logs and the files of the runs.

use crate::support::link;

use city3d_logbook::figures::{
    Comparison, ComparisonValue, FigureSet, FigureSize, GiveWayKind, RunLog, RunPair, StreamLayout,
    crossings, png, svg,
};
use city3d_logbook::record::{LogEntry, LogReader};
use city3d_protocol::snapshot::VehicleId;
use link::{city3d, mainframe, serve};
use serde_json::Value as Json;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

fn run(arguments: &[&str], folder: &Path) -> PathBuf {
    let output = city3d(&[&["run"], arguments, &["--out", "run"]].concat(), folder).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    folder.join("run/run.mcap")
}

/// Exit code and what was said.
fn tell(arguments: &[&str], folder: &Path) -> (i32, String, String) {
    let output = city3d(arguments, folder).output().unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    (output.status.code().unwrap(), text(output.stdout), text(output.stderr))
}

type Rows = Vec<BTreeMap<String, String>>;

fn table(path: &Path) -> Rows {
    let mut reader =
        csv::Reader::from_path(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    reader.deserialize().map(Result::unwrap).collect()
}

fn number(row: &BTreeMap<String, String>, column: &str) -> f64 {
    row[column].parse().unwrap_or_else(|_| panic!("{column} of {row:?}"))
}

fn summary(log: &Path) -> Json {
    serde_json::from_slice(&std::fs::read(log.with_file_name("summary.json")).unwrap()).unwrap()
}

/// Of each vehicle in a log's snapshots: time and speed, as they were recorded.
fn speeds(log: &Path) -> BTreeMap<VehicleId, Vec<(f64, f64)>> {
    let mut found: BTreeMap<VehicleId, Vec<(f64, f64)>> = BTreeMap::new();
    let mut log = LogReader::open(log).unwrap();
    while let Some(entry) = log.read().unwrap() {
        if let LogEntry::Snapshot(snapshot) = entry {
            for vehicle in &snapshot.vehicles {
                found.entry(vehicle.id).or_default().push((snapshot.time_s, vehicle.state().speed_mps));
            }
        }
    }
    found
}

#[test]
fn the_papers_figures_of_the_roundabout_show_what_its_log_holds() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let log = run(&["roundabout"], folder);
    let (code, said, complained) = tell(&["plot", "run/run.mcap", "--out", "figures"], folder);
    assert_eq!(code, 0, "{complained}");
    let names =
        ["speed_path_1", "speed_path_2", "position", "space_time", "speed_time", "lateral_error", "pedals"];
    for name in names {
        assert!(said.contains(name), "{said}");
        for extension in ["svg", "png", "csv"] {
            let path = folder.join(format!("figures/{name}.{extension}"));
            assert!(path.metadata().unwrap().len() > 1000, "{}", path.display());
        }
    }
    let speeds = speeds(&log);
    // Path 1 is the one that gives way.
    let path_1 = table(&folder.join("figures/speed_path_1.csv"));
    let vehicles: BTreeSet<&str> = path_1.iter().map(|row| row["name"].as_str()).collect();
    assert_eq!(vehicles, ["path1_a", "path1_b", "path1_c"].into());
    let mut checked = 0;
    for row in path_1.iter().step_by(7) {
        let (time_s, id) = (number(row, "time_s"), VehicleId(row["vehicle"].parse().unwrap()));
        let within: Vec<f64> = speeds[&id]
            .iter()
            .filter(|(t, _)| (t - time_s).abs() < 0.05 + 1e-6)
            .map(|(_, v)| *v / 25.0)
            .collect();
        let mean = within.iter().sum::<f64>() / within.len() as f64;
        assert!((mean - number(row, "speed_mps")).abs() < 1e-5, "{row:?} {mean}");
        checked += 1;
    }
    assert!(checked > 400, "{checked}");

    // Positions grow, and by as much as the speeds say.
    for name in &vehicles {
        let rows: Vec<_> = path_1.iter().filter(|row| row["name"] == *name).collect();
        let mut driven = number(rows[0], "position_m");
        for pair in rows.windows(2) {
            let dt_s = number(pair[1], "time_s") - number(pair[0], "time_s");
            let step = number(pair[1], "position_m") - number(pair[0], "position_m");
            assert!((-0.0005..0.012).contains(&step), "{:?} {step}", pair[1]);
            driven += dt_s * (number(pair[0], "speed_mps") + number(pair[1], "speed_mps")) / 2.0;
        }
        let last = number(rows[rows.len() - 1], "position_m");
        assert!((driven - last).abs() < 0.1, "{name}: {driven} {last}");
    }

    // Both paths are at the merging point when the run says that their vehicles merge there.
    let position = table(&folder.join("figures/position.csv"));
    let log = RunLog::read(&log).unwrap();
    let layout = StreamLayout::of(&log, None, None).unwrap();
    let merge = layout.merge.clone().unwrap();
    assert_eq!(merge.name, "west-roundabout/ring/outer/3");
    let merge_at = layout.merge_at_m / 25.0;
    let order = crossings(&log, &merge);
    assert_eq!(layout.streams(&log)[0].line.unwrap().kind, GiveWayKind::Yield);
    assert_eq!(order.iter().map(|(_, id)| id.0).collect::<Vec<_>>(), [4, 5, 1, 6, 2, 3]);
    for (time_s, id) in order {
        let rows: Vec<_> = position.iter().filter(|row| row["vehicle"] == id.to_string()).collect();
        let near = rows.iter().min_by(|a, b| {
            (number(a, "time_s") - time_s).abs().total_cmp(&(number(b, "time_s") - time_s).abs())
        });
        let at = number(near.unwrap(), "position_m");
        assert!((at - merge_at).abs() < 0.01, "{id}: {at} {merge_at}");
        // The front axle, which the summary tells of, comes there an overhang of 1 m later.
        let events = summary(&folder.join("run/run.mcap"));
        let merges = events["events"].as_array().unwrap().iter().filter(|event| event["kind"] == "merge");
        let merges =
            merges.filter(|event| event["vehicle"] == id.0).map(|event| event["t"].as_f64().unwrap());
        assert!(merges.into_iter().any(|t| (0.05..0.45).contains(&(t - time_s))), "{id}: {time_s}");
    }
    // One that yields stops before its line: the paper's 3.3 m, less what the last vehicle starts further on.
    let line_m = layout.streams(&log)[0].line.unwrap().before_m / 25.0;
    let first: Vec<_> = position.iter().filter(|row| row["name"] == "path1_a").collect();
    let stands: Vec<f64> = first
        .windows(2)
        .filter(|pair| pair[0]["position_m"] == pair[1]["position_m"])
        .map(|pair| number(pair[0], "position_m"))
        .collect();
    assert!(!stands.is_empty());
    for at in stands {
        assert!((0.0..0.15).contains(&(merge_at - line_m - at)), "{at} {merge_at} {line_m}");
    }
}

#[test]
fn a_figure_is_the_same_each_time_and_says_its_units() {
    let folder = tempfile::tempdir().unwrap();
    let log = run(&["roundabout", "--duration", "6", "--environment", "testbed"], folder.path());
    let runs = [RunLog::read(&log).unwrap()];
    let layout = StreamLayout::of(&runs[0], None, None).unwrap_or_else(|error| panic!("{error}"));
    let (figures, notes) = FigureSet::new(&runs, &layout, &BTreeSet::new()).all();
    // In 6 s nobody has come to the merging point.
    assert!(notes.iter().any(|note| note.contains("no streams merge")), "{notes:?}");
    for figure in &figures {
        assert!(figure.title.contains("roundabout, seed 2, testbed environment: "), "{}", figure.title);
        for size in [FigureSize::Column, FigureSize::Page] {
            let text = svg(figure, size).unwrap();
            assert_eq!(text, svg(figure, size).unwrap());
            assert!(text.contains(&format!("width=\"{}mm\"", size.width_mm())), "{}", figure.name);
            assert!(text.contains("Time [s]") || text.contains("Position along Path"), "{}", figure.name);
        }
    }
    let bytes = png(&figures[0], FigureSize::Column).unwrap();
    let image = image::load_from_memory(&bytes).unwrap().to_rgb8();
    assert_eq!(image.width(), 880);
    // Paper all around, and lines in the colours of the palette.
    assert!(image.rows().next().unwrap().all(|pixel| pixel.0 == [255; 3]));
    let wanted = figures[0].panels[0].lines[0].stroke.colour;
    assert!(image.pixels().filter(|pixel| pixel.0 == wanted).count() > 50);
}

fn value<'c>(comparison: &'c Json, quantity: &str, vehicle: Option<u32>) -> &'c [Json] {
    let rows = comparison["rows"].as_array().unwrap();
    let is_it = |row: &&Json| row["quantity"] == quantity && row["vehicle"] == Json::from(vehicle);
    let row = rows.iter().find(is_it).unwrap_or_else(|| panic!("{quantity} of {vehicle:?}"));
    row["values"].as_array().unwrap()
}

#[test]
fn a_comparison_tells_both_runs_and_what_they_differ_in() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    for environment in ["ideal", "testbed"] {
        let arguments = ["run", "roundabout", "--environment", environment, "--out", environment];
        assert_eq!(tell(&arguments, folder).0, 0);
    }
    let logs = ["ideal/run.mcap", "testbed/run.mcap"];
    let (code, said, complained) = tell(&["compare", logs[0], logs[1], "--out", "both", "--json"], folder);
    assert_eq!(code, 0, "{complained}");
    let comparison: Json = serde_json::from_str(&said).unwrap();
    let written: Json =
        serde_json::from_slice(&std::fs::read(folder.join("both/comparison.json")).unwrap()).unwrap();
    assert_eq!(comparison, written);
    let settings: Vec<&str> =
        comparison["settings"].as_array().unwrap().iter().map(|line| line.as_str().unwrap()).collect();
    assert!(settings.contains(&"environment.loss: 0.0, 0.01"), "{settings:?}");
    assert!(settings.iter().all(|line| line.starts_with("environment.")), "{settings:?}");
    assert_eq!(comparison["runs"][1]["label"], "testbed emulator");

    for (k, log) in logs.iter().enumerate() {
        let summary = summary(&folder.join(log));
        assert_eq!(value(&comparison, "collisions", None)[k], summary["collisions"]);
        let mut names: Vec<(f64, &str)> = Vec::new();
        for (id, vehicle) in summary["vehicles"].as_object().unwrap() {
            let of = |quantity: &str| &value(&comparison, quantity, Some(id.parse().unwrap()))[k];
            assert_eq!(of("stops"), &vehicle["stops"], "{id}");
            // The longest stand is one of them.
            let stood = of("stood").as_f64().unwrap();
            assert!(stood + 0.6 >= vehicle["longest_stand_s"].as_f64().unwrap(), "{id}: {stood}");
            let largest = of("largest lateral error").as_f64().unwrap() * 25.0;
            assert!(
                (largest - vehicle["max_lateral_error_m"].as_f64().unwrap()).abs() < 0.003,
                "{id}: {largest}"
            );
            names.push((of("at the merging point").as_f64().unwrap(), vehicle["name"].as_str().unwrap()));
        }
        names.sort_by(|a, b| a.0.total_cmp(&b.0));
        let order: Vec<&str> = names.into_iter().map(|(_, name)| name).collect();
        assert_eq!(value(&comparison, "merge order", None)[k], order.join(" "));
    }
    let rough = value(&comparison, "RMS tracking error", None);
    assert!(rough[1].as_f64().unwrap() > rough[0].as_f64().unwrap(), "{rough:?}");

    // The distance between the runs is that of their snapshots.
    let difference = table(&folder.join("both/difference.csv"));
    let runs = logs.map(|log| RunLog::read(&folder.join(log)).unwrap());
    for row in difference.iter().step_by(97) {
        let at = |run: &RunLog| {
            let trace = run.vehicle(VehicleId(row["vehicle"].parse().unwrap())).unwrap();
            let time_s = number(row, "time_s");
            trace.samples.iter().find(|sample| (sample.time_s - time_s).abs() < 1e-3).unwrap().pose.position
        };
        let apart = at(&runs[0]).distance(at(&runs[1])) / 25.0;
        assert!((apart - number(row, "difference_m")).abs() < 2e-5, "{row:?} {apart}");
    }
    for name in ["speed_path_1", "position", "space_time", "lateral_error", "pedals"] {
        let labels: BTreeSet<String> = table(&folder.join(format!("both/{name}.csv")))
            .into_iter()
            .map(|row| row["run"].clone())
            .collect();
        assert_eq!(labels, ["ideal".to_owned(), "testbed emulator".to_owned()].into(), "{name}");
    }
    let tidy = table(&folder.join("both/comparison.csv"));
    assert_eq!(tidy.len(), comparison["rows"].as_array().unwrap().len() * 2);
    let (code, said, _) = tell(&["compare", logs[0], logs[1]], folder);
    assert!(code == 0 && said.contains("place in the merge order"), "{said}");
}

#[test]
fn speeds_that_change_little_fill_their_axis() {
    let folder = tempfile::tempdir().unwrap();
    let axis = |scenario: &str| {
        let log = RunLog::read(&run(&[scenario, "--duration", "20", "--force"], folder.path())).unwrap();
        let layout = StreamLayout::of(&log, None, None).unwrap();
        let runs = [log];
        let (figures, _) = FigureSet::new(&runs, &layout, &BTreeSet::new()).all();
        let figure = figures.into_iter().find(|figure| figure.name == "speed_time").unwrap();
        (figure.panels[0].y, figure.note.contains("does not begin at 0"))
    };
    // The leader's speed is 0.2 m/s +- 0.02 m/s.
    let ((low, high), is_told) = axis("platoon");
    assert!(low > 0.15 && high > 0.22 && is_told, "{low} to {high}");
    let ((low, high), is_told) = axis("roundabout");
    assert!(low.abs() < 1e-3 && high > 0.3 && !is_told, "{low} to {high}");
}

#[test]
fn an_algorithm_and_none_are_compared_and_told_apart() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    for scenario in ["roundabout", "roundabout-coordinated"] {
        assert_eq!(tell(&["run", scenario, "--duration", "25", "--out", scenario], folder).0, 0);
    }
    let (code, said, complained) =
        tell(&["compare", "roundabout", "roundabout-coordinated", "--out", "both"], folder);
    assert_eq!(code, 0, "{complained}");
    for told in [
        "A  roundabout, right of way: ",
        "B  roundabout-coordinated, insert: ",
        "scenario roundabout, right of way, ideal, seed 2, 25.0 s",
        "scenario roundabout-coordinated, insert, ideal, seed 2, 25.0 s",
        "coordination.algorithm: none, \"insert\"",
        "merging point: the beginning of west-roundabout/ring/outer/3",
    ] {
        assert!(said.contains(told), "{told}: {said}");
    }
    assert!(!said.contains("only in"), "{said}");
    let labels: BTreeSet<String> =
        table(&folder.join("both/position.csv")).into_iter().map(|row| row["run"].clone()).collect();
    assert_eq!(
        labels,
        ["roundabout, right of way", "roundabout-coordinated, insert"].map(str::to_owned).into()
    );
}

#[test]
fn plot_says_which_merging_point_it_shows_and_how_to_choose_another() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    run(&["intersection", "--duration", "100"], folder);
    let (code, said, complained) = tell(&["plot", "run", "--out", "first"], folder);
    assert_eq!(code, 0, "{complained}");
    let note =
        said.lines().find(|line| line.starts_with("streams merge at ")).unwrap_or_else(|| panic!("{said}"));
    let shown = note.split("the beginning of ").nth(1).unwrap().split(' ').next().unwrap();
    let other = note.split("another one: ").nth(1).unwrap().split(' ').next().unwrap();
    assert_ne!(shown, other);
    let (code, said, complained) = tell(&["plot", "run", "--out", "second", "--merge", other], folder);
    assert_eq!(code, 0, "{complained}");
    assert!(said.contains(&format!("the beginning of {other} (")), "{said}");
    let vehicles = |folder_of: &str| -> BTreeSet<String> {
        table(&folder.join(folder_of).join("position.csv"))
            .into_iter()
            .map(|row| row["name"].clone())
            .collect()
    };
    assert_ne!(vehicles("first"), vehicles("second"));
}

/// A run that ends while vehicles queue before the merging point, as a city in a window always does.
#[test]
fn who_queues_before_the_merging_point_is_on_its_path() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    for seconds in ["14", "17"] {
        let output =
            city3d(&["run", "mixed", "--duration", seconds, "--out", "run", "--force"], folder).output();
        assert!(output.unwrap().status.success());
        let (code, _, complaint) = tell(&["plot", "run", "--out", "figures", "--force"], folder);
        assert_eq!(code, 0, "{complaint}");
        let rows = table(&folder.join("figures/space_time.csv"));
        let on_paths: BTreeSet<(&str, &str)> =
            rows.iter().map(|row| (&row["vehicle"][..], &row["path"][..])).collect();
        let expected = ["1", "2", "3"].map(|id| (id, "Path 1"));
        let expected = expected.into_iter().chain(["4", "5", "6"].map(|id| (id, "Path 2"))).collect();
        assert_eq!(on_paths, expected, "after {seconds} s");
    }
}

#[test]
fn a_run_held_against_itself_is_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let log = run(&["roundabout", "--duration", "20"], folder.path());
    let pair = RunPair::new(RunLog::read(&log).unwrap(), RunLog::read(&log).unwrap()).unwrap();
    let layout = StreamLayout::of(&pair.runs()[0], None, None).unwrap();
    let labels = ["a".to_owned(), "b".to_owned()];
    let comparison = Comparison::of(&pair, &layout, &labels);
    assert_eq!(comparison.only, [Vec::<String>::new(), Vec::new()]);
    assert!(comparison.settings.is_empty(), "{:?}", comparison.settings);
    assert!(comparison.rows.iter().all(|row| row.values[0] == row.values[1]));
    assert!(
        comparison
            .rows
            .iter()
            .any(|row| row.quantity == "least gap" && row.values[0] != ComparisonValue::None)
    );
    assert!(comparison.apart.iter().all(|apart| apart.max_m == 0.0) && comparison.apart.len() == 6);
}

#[test]
fn what_a_comparison_tells_does_not_depend_on_the_rate_of_the_log() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    for hz in ["100", "50", "10"] {
        let shared = ["run", "roundabout", "--duration", "25", "--environment", "testbed"];
        assert_eq!(tell(&[&shared[..], &["--log-hz", hz, "--out", hz]].concat(), folder).0, 0);
    }
    for other in ["50/run.mcap", "10/run.mcap"] {
        let (code, said, complained) = tell(&["compare", "100/run.mcap", other, "--json"], folder);
        assert_eq!(code, 0, "{complained}");
        let comparison: Json = serde_json::from_str(&said).unwrap();
        for vehicle in [None, Some(1), Some(4)] {
            let rms = ["RMS acceleration", "RMS jerk", "RMS lateral error", "RMS tracking error"];
            for quantity in rms {
                let [a, b] = [0, 1].map(|run| value(&comparison, quantity, vehicle)[run].as_f64().unwrap());
                assert!((a / b - 1.0).abs() < 0.01, "{other}: {quantity} of {vehicle:?}: {a} and {b}");
            }
        }
    }
}

#[test]
fn runs_without_a_common_vehicle_are_not_compared_and_it_says_why() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    assert_eq!(tell(&["run", "straight", "--out", "straight"], folder).0, 0);
    assert_eq!(tell(&["run", "roundabout", "--duration", "2", "--out", "roundabout"], folder).0, 0);
    let (code, _, said) = tell(&["compare", "straight/run.mcap", "roundabout/run.mcap"], folder);
    assert!(
        code == 2 && said.contains("no vehicle in common, by name: leader, follower, and path1_a"),
        "{said}"
    );
    let (code, _, said) = tell(&["plot", "straight/run.mcap", "--merge", "nowhere", "--out", "out"], folder);
    assert!(
        code == 2 && said.contains("no streams merge at \"nowhere\"; no streams merge anywhere"),
        "{said}"
    );
    let (code, _, said) = tell(&["plot", "straight/run.mcap", "--vehicle", "7", "--out", "out"], folder);
    assert!(code == 2 && said.contains("no vehicle 7; it has 1 leader, 2 follower"), "{said}");
    // Nothing merges on a straight road, and the rest is drawn; of one vehicle as well.
    let (code, said, _) =
        tell(&["plot", "straight/run.mcap", "--vehicle", "follower", "--out", "out"], folder);
    assert!(code == 0 && said.contains("no streams merge"), "{said}");
    let rows = table(&folder.join("out/space_time.csv"));
    assert!(!rows.is_empty() && rows.iter().all(|row| row["name"] == "follower"));
}

#[test]
fn torn_and_empty_logs_are_drawn_as_far_as_they_go() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let log = run(&["roundabout", "--duration", "20"], folder);
    let bytes = std::fs::read(&log).unwrap();
    std::fs::write(folder.join("torn.mcap"), &bytes[..bytes.len() * 3 / 4]).unwrap();
    let (code, _, said) = tell(&["plot", "torn.mcap", "--out", "torn"], folder);
    assert!(code == 0 && said.contains("log is truncated"), "{said}");
    let last =
        table(&folder.join("torn/pedals.csv")).iter().map(|row| number(row, "time_s")).fold(0.0, f64::max);
    assert!((8.0..19.9).contains(&last), "{last}");

    // A log that ends before its first snapshot.
    let empty = folder.join("empty.mcap");
    let open = |length: usize| {
        std::fs::write(&empty, &bytes[..length]).unwrap();
        LogReader::open(&empty)
    };
    let whole = (0..bytes.len()).step_by(8192).find(|&length| open(length).is_ok()).unwrap();
    let cut = (whole - 8192..whole).step_by(64).find(|&length| open(length).is_ok());
    assert!(open(cut.unwrap()).unwrap().read().unwrap().is_none());
    let (code, _, said) = tell(&["plot", "empty.mcap", "--out", "empty"], folder);
    assert!(code == 2 && said.contains("nothing to draw"), "{code} {said}");
}

#[test]
fn a_log_of_the_control_framework_has_positions_and_no_pedals() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let mut city = serve(&["roundabout", "--duration", "20", "--lockstep", "--out", "served"], folder);
    let mut far = mainframe(&city.address, &["roundabout", "--duration", "20", "--out", "far"], folder);
    assert_eq!((far.wait(), city.wait()), (0, 0));
    let (code, said, complained) = tell(&["plot", "far/run.mcap", "served/run.mcap", "--out", "out"], folder);
    assert!(code == 0 && said.contains("no pedals"), "{said} {complained}");
    assert!(!folder.join("out/far/pedals.svg").exists() && folder.join("out/served/pedals.svg").exists());
    // Both saw the same vehicles at the same places.
    let [far, served] = ["far", "served"].map(|name| table(&folder.join(format!("out/{name}/position.csv"))));
    let by_time = |rows: &Rows| -> BTreeMap<(String, String), f64> {
        rows.iter()
            .map(|row| ((row["name"].clone(), row["time_s"].clone()), number(row, "position_m")))
            .collect()
    };
    let (far, served) = (by_time(&far), by_time(&served));
    let common: Vec<_> = far.iter().filter_map(|(key, m)| Some((key, *m, *served.get(key)?))).collect();
    assert!(common.len() > 1000, "{}", common.len());
    for (key, a, b) in common {
        assert!((a - b).abs() < 0.01, "{key:?}: {a} {b}");
    }
}

#[test]
fn poses_that_are_hardly_meant_so_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let mut poses = "time,id,x,y,yaw\n".to_owned();
    for k in 0..100 {
        let (t, y) = (f64::from(k) * 0.1, 10.0 + f64::from(k) * 0.4);
        // In full-scale metres; the first one is not seen for three seconds; nobody is the 99th.
        if !(40..70).contains(&k) {
            poses += &format!("{t},1,-66.0,{y},1.5708\n");
        }
        poses += &format!("{t},99,-60.0,{y},1.5708\n");
    }
    std::fs::write(folder.join("poses.csv"), poses).unwrap();
    let replay = ["replay", "poses.csv", "--scenario", "roundabout", "--out", "measured"];
    let (code, said, complained) = tell(&replay, folder);
    assert_eq!(code, 0, "{complained}");
    for told in ["lie outside of the map", "divide x and y by 25", "no vehicle 99", "from 3.90 s to 7.00 s"] {
        assert!(complained.contains(told), "{told}: {complained}");
    }
    let row = said.lines().find(|line| line.contains("path1_a")).unwrap();
    assert!(row.trim_end().ends_with(" -"), "{row}");
    let summary: Json =
        serde_json::from_slice(&std::fs::read(folder.join("measured/summary.json")).unwrap()).unwrap();
    let events = summary["events"].as_array().unwrap().iter().filter(|event| event["vehicle"] == 1);
    let told: Vec<(f64, &str)> =
        events.map(|event| (event["t"].as_f64().unwrap(), event["kind"].as_str().unwrap())).collect();
    let gap: Vec<_> =
        told.iter().filter(|(_, kind)| kind.starts_with("unseen") || kind.starts_with("seen")).collect();
    assert_eq!(gap.len(), 2, "{told:?}");
    assert!((gap[0].0 - 3.91).abs() < 0.02 && (gap[1].0 - 7.0).abs() < 0.02, "{told:?}");

    // The table of a run of ours is none of poses.
    run(&["straight", "--duration", "2"], folder);
    let (code, _, said) =
        tell(&["replay", "run/vehicles.csv", "--scenario", "straight", "--out", "again"], folder);
    assert!(code == 2 && said.contains("full-scale") && said.contains("city3d replay run"), "{said}");
}

#[test]
fn poses_measured_elsewhere_are_a_run_to_draw_and_to_compare() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    run(&["roundabout", "--duration", "30"], folder);
    // What motion capture would have written: laboratory metres, its own clock, some rows missing.
    let mut poses = "time,id,x,y,yaw\n".to_owned();
    for (index, row) in table(&folder.join("run/vehicles.csv")).iter().enumerate() {
        if index % 11 != 3 {
            let [t, x, y] = ["t", "x", "y"].map(|column| number(row, column));
            poses +=
                &format!("{:.3},{},{:.6},{:.6},{}\n", 1e6 + t, row["id"], x / 25.0, y / 25.0, row["yaw"]);
        }
    }
    std::fs::write(folder.join("poses.csv"), poses).unwrap();
    let replay = ["replay", "poses.csv", "--scenario", "roundabout", "--out", "measured"];
    let (code, said, complained) = tell(&replay, folder);
    assert_eq!(code, 0, "{said} {complained}");
    // A folder of a run means the log in it.
    let both = ["compare", "run", "measured/run.mcap", "--out", "both", "--json"];
    let (code, said, complained) = tell(&both, folder);
    assert_eq!(code, 0, "{complained}");
    let comparison: Json = serde_json::from_str(&said).unwrap();
    assert_eq!(comparison["runs"][1]["label"], "physical");
    let order = value(&comparison, "merge order", None);
    assert!(
        order[0] == order[1] && order[0].as_str().unwrap().starts_with("path2_a path2_b path1_a"),
        "{order:?}"
    );
    // It begins at the speed that its poses tell: nothing jerks there that did not in the laboratory.
    let firsts = |run: &str| -> Vec<BTreeMap<String, String>> {
        let rows = table(&folder.join(run).join("vehicles.csv")).into_iter();
        rows.filter(|row| number(row, "t") == 0.0).collect()
    };
    let measured = firsts("measured");
    assert!(measured.len() >= 5, "{}", measured.len());
    // Only poses are known: no pedals.
    assert!(measured.iter().all(|row| row["gas"].is_empty() && row["lateral_error"].is_empty()));
    assert!(firsts("run").iter().all(|row| !row["gas"].is_empty() && !row["lateral_error"].is_empty()));
    for (row, run) in measured.iter().flat_map(|row| firsts("run").into_iter().map(move |run| (row, run))) {
        let [told, true_mps] = [row, &run].map(|row| number(row, "speed"));
        // Some brake from the start, by 5 m/s2 at most, and the next pose is up to 0.2 s away.
        assert!(
            row["id"] != run["id"] || (true_mps > 1.0 && (told - true_mps).abs() < 0.6),
            "{told} {true_mps}"
        );
    }
    let jerk = value(&comparison, "RMS jerk", None);
    let [simulated, measured] = [0, 1].map(|run| jerk[run].as_f64().unwrap());
    assert!(measured < 3.0 * simulated, "{measured} for {simulated}");
    // Nobody has told what path it was to follow.
    let measured: Json =
        serde_json::from_slice(&std::fs::read(folder.join("measured/summary.json")).unwrap()).unwrap();
    assert!(measured["vehicles"]["1"]["max_lateral_error_m"].is_null(), "{}", measured["vehicles"]["1"]);
    let apart = comparison["apart"].as_array().unwrap();
    assert!(apart.len() == 6 && apart.iter().all(|one| one["max_m"].as_f64().unwrap() < 0.01), "{apart:?}");

    let (code, _, said) = tell(&["replay", "poses.csv"], folder);
    assert!(code == 2 && said.contains("--scenario SCENARIO --out DIR"), "{said}");
    let (code, _, said) = tell(&["replay", "measured/run.mcap", "--verify"], folder);
    assert!(code == 2 && said.contains("no world to simulate again"), "{said}");
    std::fs::write(folder.join("poses.csv"), "time,id,x,y,yaw\n0,1,0,zero,0\n").unwrap();
    let (code, _, said) = tell(&replay, folder);
    assert!(code == 2 && said.contains("poses.csv: line 2: y is \"zero\""), "{said}");
}
