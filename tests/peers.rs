//! City3D against independent programs: what they write it reads, what it writes they read.
//!
//! `scripts/test.sh` installs the peers and names their Python in `CITY3D_PEERS_PYTHON`.
#![allow(clippy::unwrap_used, reason = "a test may end where it finds something wrong")]

use serde_json::Value;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// The Python that has the peers; without one a test is skipped loudly, and fails in CI.
fn python() -> Option<OsString> {
    let python = std::env::var_os("CITY3D_PEERS_PYTHON");
    if python.is_none() {
        let remedy = "CITY3D_PEERS_PYTHON is not set: run scripts/test.sh";
        assert!(std::env::var_os("CI").is_none(), "peers cannot be tested: {remedy}");
        eprintln!("SKIPPED: {remedy}");
    }
    python
}

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

fn output(command: &mut Command) -> (Output, String) {
    let output = command.output().unwrap();
    let [out, err] =
        [&output.stdout, &output.stderr].map(|bytes| String::from_utf8_lossy(bytes).into_owned());
    (output, format!("{command:?}\n{out}{err}"))
}

fn peer(python: &OsString, script: &str, arguments: &[&Path]) -> (Output, String) {
    output(Command::new(python).arg(root().join("tests/peers").join(script)).args(arguments))
}

fn city3d(arguments: &[&str], folder: &Path) -> String {
    let (output, told) =
        output(Command::new(env!("CARGO_BIN_EXE_city3d")).args(arguments).current_dir(folder));
    assert!(output.status.success(), "{told}");
    told
}

fn summary(folder: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(folder.join("summary.json")).unwrap()).unwrap()
}

#[test]
fn ezdxf_finds_nothing_wrong_with_the_map() {
    let Some(python) = python() else { return };
    let (output, told) = peer(&python, "audit_dxf.py", &[&root().join("assets/maps/ids3c.dxf")]);
    assert!(output.status.success(), "{told}");
    // The same look finds a fault where there is one.
    let broken = root().join("tests/corpus/maps/truncated_in_value.dxf");
    let (output, told) = peer(&python, "audit_dxf.py", &[&broken]);
    assert_eq!(output.status.code(), Some(1), "{told}");
}

#[test]
fn a_map_drawn_with_ezdxf_can_be_driven() {
    let Some(python) = python() else { return };
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let (output, told) = peer(&python, "draw_map.py", &[&folder.join("drawn.dxf")]);
    assert!(output.status.success(), "{told}");
    std::fs::copy(root().join("tests/peers/drawn.toml"), folder.join("drawn.toml")).unwrap();
    let told = city3d(&["check", "drawn.dxf", "drawn.toml"], folder);
    assert!(told.contains("drawn.dxf: good") && told.contains("drawn.toml: good"), "{told}");
    for model in ["raycast", "bicycle"] {
        city3d(&["run", "drawn.toml", "--model", model, "--out", model], folder);
        let summary = summary(&folder.join(model));
        assert_eq!(summary["collisions"], 0, "{model}");
        for id in ["1", "2"] {
            let vehicle = &summary["vehicles"][id];
            // Full scale: the loop is 179 m long, the way from it to the end of the branch 103 m.
            assert!(vehicle["distance_m"].as_f64().unwrap() > 60.0, "{model}: {vehicle}");
            assert!(vehicle["max_lane_excess_m"].as_f64().unwrap() < 0.0, "{model}: {vehicle}");
        }
    }
}

#[test]
fn mcap_tools_read_the_log_of_a_run() {
    let Some(python) = python() else { return };
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    city3d(&["run", "straight", "--duration", "3", "--seed", "5", "--out", "."], folder);
    let (output, told) = peer(&python, "read_log.py", &[&folder.join("run.mcap")]);
    assert!(output.status.success(), "{told}");
    let log: Value = serde_json::from_slice(&output.stdout).unwrap();
    let summary = summary(folder);

    assert_eq!(log["profile"], "ros2");
    // 3 s at 50 Hz, and the initial conditions.
    assert_eq!(log["topics"]["/city3d/snapshot"], 151);
    let events = summary["events"].as_array().unwrap();
    assert_eq!(log["events"].as_array().unwrap().len(), events.len());
    for (logged, event) in log["events"].as_array().unwrap().iter().zip(events) {
        assert_eq!(logged, event);
    }
    let [first, last] = [0, 1].map(|end| &log["ends"][end]);
    assert_eq!((first["tick"].as_u64(), last["tick"].as_u64()), (Some(0), Some(300)));
    assert_eq!(last["state_hash"], summary["state_hash"]);
    assert_eq!(log["metadata"]["city3d"]["seed"], "5");
    assert!(log["attachments"]["scenario.toml"].as_str().unwrap().contains("Two cars on a straight road"));
    assert!(log["attachments"]["map.dxf"].as_str().unwrap().contains("SECTION"));
    compare_with_table(&folder.join("vehicles.csv"), last);
}

/// The last rows of `vehicles.csv` are the last snapshot of the log.
fn compare_with_table(table: &Path, last: &Value) {
    let mut reader = csv::Reader::from_path(table).unwrap();
    let columns = reader.headers().unwrap().clone();
    let rows: Vec<csv::StringRecord> = reader.records().map(Result::unwrap).collect();
    let vehicles = last["vehicles"].as_array().unwrap();
    assert_eq!(vehicles.len(), 2);
    for (row, vehicle) in rows[rows.len() - vehicles.len()..].iter().zip(vehicles) {
        let cell = |name: &str| &row[columns.iter().position(|column| column == name).unwrap()];
        assert_eq!(cell("tick"), "300");
        assert_eq!(cell("id"), vehicle["id"].to_string());
        for name in ["x", "y", "z", "speed", "steering", "lateral_error", "distance"] {
            let (text, logged) = (cell(name), vehicle[name].as_f64().unwrap());
            let number: f64 = text.parse().unwrap();
            assert!((number - logged).abs() < 2e-3, "{name}: {text} in the table, {logged} in the log");
        }
    }
}

#[cfg(feature = "render")]
#[test]
fn numpy_and_pillow_read_the_pictures_of_all_kinds() {
    use city3d::render::{AdapterPreference, Context};
    let Some(python) = python() else { return };
    if let Err(error) = Context::headless(&AdapterPreference::Software) {
        assert!(std::env::var_os("CI").is_none(), "pictures cannot be tested: {error}");
        eprintln!("SKIPPED: {error}");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let take = |out: &str, more: &[&str]| {
        let common =
            ["frames", "roundabout", "--sensor", "windscreen", "--size", "200x150", "--quality", "fast"];
        let times = ["--from", "12", "--duration", "12", "--adapter", "software", "--out", out];
        city3d(&[&common, &times[..], more].concat(), folder);
        let document = root().join("docs/cameras.md");
        let (output, told) = peer(&python, "read_frames.py", &[&folder.join(out), &document]);
        assert!(output.status.success(), "{told}");
        serde_json::from_slice::<Value>(&output.stdout).unwrap()
    };
    let seen = take("exact", &["--depth-format", "f32"]);
    assert_eq!(seen["depth"], serde_json::json!(["float32", [150, 200]]));
    assert_eq!(seen["modes"], serde_json::json!({ "rgb": "RGB", "semantic": "L", "instance": "I;16" }));
    assert_eq!(seen["sky"], seen["sky_by_class"]);
    assert!(seen["road"].as_u64().unwrap() > 2000 && seen["highest"].as_f64().unwrap() < 0.01, "{seen}");
    // Its own bonnet and the car ahead, whose rear is half a length behind its middle.
    let vehicles = seen["vehicles"].as_object().unwrap();
    assert!(vehicles["2"]["pixels"].as_u64().unwrap() > 1000, "{seen}");
    city3d(&["run", "roundabout", "--duration", "12", "--out", "run"], folder);
    let mut table = csv::Reader::from_path(folder.join("run/vehicles.csv")).unwrap();
    let rows = table.records().map(Result::unwrap);
    let ahead = rows.filter(|row| &row[1] == "1200" && &row[2] == "1").last().unwrap();
    for (axis, column) in [(0, 5), (1, 6)] {
        let (found, known) =
            (vehicles["1"]["middle"][axis].as_f64().unwrap(), ahead[column].parse::<f64>().unwrap());
        assert!((found - known).abs() < 3.0, "axis {axis}: {found}, and it is at {known}");
    }
    for (_, vehicle) in vehicles {
        assert_eq!(vehicle["classes"], serde_json::json!([11]));
    }
    let coloured = take("coloured", &["--depth-format", "f32", "--palette"]);
    assert_eq!(coloured["modes"]["semantic"], "P");
    assert_eq!(coloured["vehicles"], seen["vehicles"]);
}
