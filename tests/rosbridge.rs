//! Poses over rosbridge, against a WebSocket peer that fragments, answers and hangs up.
#![cfg(feature = "rosbridge")]
#![allow(clippy::unwrap_used, reason = "a test may end where it finds something wrong")]

#[path = "support/link.rs"]
mod link;

use link::{mainframe, serve, summary};
use serde_json::Value;
use std::io::{BufRead, BufReader, Read};
use std::process::{Command, Stdio};

/// The peer, with its port.
fn peer() -> Option<(std::process::Child, BufReader<std::process::ChildStdout>, u16)> {
    let Some(python) = std::env::var_os("CITY3D_PEERS_PYTHON") else {
        let remedy = "CITY3D_PEERS_PYTHON is not set: run scripts/test.sh";
        assert!(std::env::var_os("CI").is_none(), "rosbridge cannot be tested: {remedy}");
        eprintln!("SKIPPED: {remedy}");
        return None;
    };
    let script = link::root().join("tests/peers/rosbridge.py");
    let mut command = Command::new(python);
    let mut child = command.arg(script).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
    let mut lines = BufReader::new(child.stdout.take().unwrap());
    let mut line = String::new();
    lines.read_line(&mut line).unwrap();
    Some((child, lines, line.trim().parse().unwrap()))
}

#[test]
fn the_city_and_the_mainframe_talk_over_a_rosbridge_that_is_cut_once() {
    let Some((mut bridge, mut lines, port)) = peer() else { return };
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let address = format!("--rosbridge=ws://127.0.0.1:{port}");
    let length = ["roundabout", "--duration", "12", &address];
    let mut city = serve(&[&length[..], &["--csv-hz", "100", "--out", "served"]].concat(), folder);
    let mut far = mainframe(&city.address, &[&length[..], &["--out", "far"]].concat(), folder);
    assert_eq!((far.wait(), city.wait()), (0, 0));

    drop(bridge.stdin.take());
    let mut told = String::new();
    lines.read_to_string(&mut told).unwrap();
    bridge.wait().unwrap();
    let told: Value = serde_json::from_str(&told).unwrap();
    assert_eq!(told["cuts"], 1, "{told}");
    let served = summary(&folder.join("served"));
    assert_eq!(served["collisions"], 0);
    assert!(served["link"]["ros"]["master_returns"].as_u64().unwrap() >= 1, "{}", served["link"]);
    for (id, vehicle) in served["vehicles"].as_object().unwrap() {
        assert!(vehicle["distance_m"].as_f64().unwrap() > 30.0, "vehicle {id}: {vehicle}");
    }

    let tf = &told["topics"]["/tf"];
    assert_eq!((&tf["type"], &tf["wrong"]), (&"tf2_msgs/TFMessage".into(), &Value::Array(Vec::new())));
    let car = &told["topics"]["/vicon/path1_a/path1_a"];
    assert_eq!(
        (&car["type"], &car["wrong"]),
        (&"geometry_msgs/TransformStamped".into(), &Value::Array(Vec::new()))
    );
    assert!(car["count"].as_u64().unwrap() > 900, "{} poses in 12 s", car["count"]);
    let last = &car["last"];
    assert_eq!(
        [&last["header"]["frame_id"], &last["child_frame_id"]],
        ["/vicon/world", "vicon/path1_a/path1_a"]
    );
    // Laboratory metres: where the table has the vehicle last, at its scale.
    let mut table = csv::Reader::from_path(folder.join("served/vehicles.csv")).unwrap();
    let rows = table.records().map(Result::unwrap).filter(|row| &row[3] == "path1_a");
    let row = rows.last().unwrap();
    for (axis, column) in [("x", 5), ("y", 6)] {
        let lab_m = last["transform"]["translation"][axis].as_f64().unwrap();
        let city_m: f64 = row[column].parse().unwrap();
        assert!((lab_m - city_m / 25.0).abs() < 0.02, "{axis}: {lab_m} m, in the city {city_m} m");
    }
}
