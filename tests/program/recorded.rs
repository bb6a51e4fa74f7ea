//! Round trips: an ideal run written as noisy poses, in a table and in a bag, comes back as the run that it was.

use crate::support::bag;
use crate::support::link;

use bag::{Pose, Recording, bag, table};
use link::city3d;
use serde_json::Value;
use std::path::Path;

fn tell(arguments: &[&str], folder: &Path) -> String {
    let output = city3d(arguments, folder).output().unwrap();
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

/// An ideal run, with its poses 200 times a second.
fn ideal(folder: &Path) -> Vec<Pose> {
    let text = std::fs::read_to_string("scenarios/roundabout.toml").unwrap();
    std::fs::write(folder.join("roundabout.toml"), text + "\n[rates]\nphysics_hz = 200\n").unwrap();
    tell(&["run", "roundabout.toml", "--out", "ideal", "--csv-hz", "200"], folder);
    let mut rows = csv::Reader::from_path(folder.join("ideal/vehicles.csv")).unwrap();
    let headers = rows.headers().unwrap().clone();
    let place = |column: &str| headers.iter().position(|header| header == column).unwrap();
    let places = ["t", "id", "x", "y", "yaw"].map(place);
    let name = place("name");
    rows.records()
        .map(|row| {
            let row = row.unwrap();
            let [time_s, id, x, y, yaw_rad] = places.map(|place| row[place].parse::<f64>().unwrap());
            Pose { time_s, id: id as u32, name: row[name].to_owned(), x_m: x / 25.0, y_m: y / 25.0, yaw_rad }
        })
        .collect()
}

fn row<'c>(comparison: &'c Value, quantity: &str, vehicle: Option<u32>) -> [&'c Value; 2] {
    let rows = comparison["rows"].as_array().unwrap();
    let found = rows.iter().find(|row| row["quantity"] == quantity && row["vehicle"] == Value::from(vehicle));
    let values = found.unwrap_or_else(|| panic!("{quantity}"))["values"].as_array().unwrap();
    [&values[0], &values[1]]
}

/// The run that `poses` came back as, held against the ideal one: what `compare` says has to be the same.
fn comes_back(folder: &Path, poses: &str, rms_mps: f64) {
    let out = format!("{poses}-run");
    tell(&["replay", poses, "--scenario", "roundabout.toml", "--out", &out], folder);
    let told = tell(&["compare", "ideal/run.mcap", &format!("{out}/run.mcap"), "--json"], folder);
    let comparison: Value = serde_json::from_str(&told).unwrap();
    for id in 1..=6 {
        let [a, b] = row(&comparison, "stops", Some(id));
        assert_eq!(a, b, "{poses}: stops of vehicle {id}");
        let [a, b] = row(&comparison, "distance", Some(id)).map(|value| value.as_f64().unwrap());
        assert!((b / a - 1.0).abs() < 0.005, "{poses}: vehicle {id} drove {b} m, and {a} m in truth");
        let [a, b] = row(&comparison, "stood", Some(id)).map(|value| value.as_f64().unwrap());
        assert!((a - b).abs() < 1.0, "{poses}: vehicle {id} stood {b} s, and {a} s in truth");
    }
    for apart in comparison["apart"].as_array().unwrap() {
        let [speed, largest] = ["rms_speed_mps", "max_m"].map(|key| apart[key].as_f64().unwrap());
        assert!(speed < rms_mps && largest < 0.01, "{poses}: {apart}");
    }
    let [a, b] = row(&comparison, "RMS acceleration", None).map(|value| value.as_f64().unwrap());
    assert!((b / a - 1.0).abs() < 0.15, "{poses}: RMS acceleration {b}, and {a} in truth");
    let [a, b] = row(&comparison, "merge order", None);
    assert_eq!(a, b, "{poses}");
}

#[test]
fn poses_of_an_ideal_run_come_back_as_that_run_with_noise_of_any_level() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let poses = ideal(folder);
    for (hz, noise_mm, rms_mps) in [
        (200, 0.0, 0.0005),
        (200, 0.1, 0.001),
        (100, 0.1, 0.001),
        (100, 1.0, 0.003),
        (200, 1.0, 0.003),
        (100, 2.0, 0.004),
        (200, 2.0, 0.004),
        (50, 0.5, 0.003),
    ] {
        let yaw_noise_rad = if noise_mm < 1.0 { 0.001 * noise_mm } else { 0.009 };
        let recording = Recording { hz, noise_mm, yaw_noise_rad, ..Recording::default() };
        let name = format!("{hz}-{noise_mm}.csv");
        table(&folder.join(&name), &recording.of(&poses));
        comes_back(folder, &name, rms_mps);
    }
}

#[test]
fn gaps_jitter_and_outliers_in_a_bag_change_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let poses = ideal(folder);
    let recording = Recording {
        hz: 100,
        noise_mm: 1.0,
        yaw_noise_rad: 0.009,
        jitter_s: 0.003,
        has_gaps: true,
        outliers: 200,
    };
    bag(&folder.join("poses.bag"), &recording.of(&poses));
    comes_back(folder, "poses.bag", 0.004);
    // Rounded to millimetres and milliseconds, as tables often are.
    let recording = Recording { hz: 100, jitter_s: 0.0005, ..Recording::default() };
    let mut rounded = recording.of(&poses);
    for pose in &mut rounded {
        for value in [&mut pose.x_m, &mut pose.y_m, &mut pose.time_s] {
            *value = (*value * 1000.0).round() / 1000.0;
        }
    }
    table(&folder.join("rounded.csv"), &rounded);
    comes_back(folder, "rounded.csv", 0.003);
}
