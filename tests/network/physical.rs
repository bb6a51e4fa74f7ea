//! Vehicles of the laboratory among those of the city: one experiment over four processes.

use crate::support::link;
use crate::support::mixed;
use crate::support::ros;

use link::{city3d, events, mainframe, serve, summary};
use mixed::{PHYSICAL, mixed, testbed};
use serde_json::Value;
use std::path::Path;

/// Numbers of the vehicles in a picture of instances.
fn instances(path: &Path) -> std::collections::BTreeSet<u16> {
    let picture = image::open(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    picture.into_luma16().pixels().map(|pixel| pixel.0[0]).filter(|number| *number != 0).collect()
}

fn verify(folder: &Path, log: &str) {
    let output = city3d(&["replay", log, "--verify", "--json"], folder).output().unwrap();
    let told = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{told}{}", String::from_utf8_lossy(&output.stderr));
    let report: Value = serde_json::from_str(&told).unwrap();
    assert!(report["ticks_agreeing"].as_u64().unwrap() > 500, "{report}");
}

fn distance_m(summary: &Value, vehicle: u64) -> f64 {
    summary["vehicles"][vehicle.to_string()]["distance_m"].as_f64().unwrap()
}

/// Three virtual and three physical vehicles, in real time.
fn drive_together(folder: &Path, arguments: &[&str]) {
    mixed(folder, "");
    let mut robots = testbed(arguments, folder);
    // Who merges first depends on when robots and mainframe find each other: the last of all needs half a minute.
    let length = ["mixed.toml", "--duration", "30"];
    let mut city = serve(&[&length[..], arguments, &["--out", "served"]].concat(), folder);
    let mut far = mainframe(&city.address, &[&length[..], arguments, &["--out", "far"]].concat(), folder);
    assert_eq!((far.wait(), city.wait()), (0, 0));
    assert_eq!(robots.end(), 0);

    let [served, far] = ["served", "far"].map(|name| summary(&folder.join(name)));
    assert_eq!(served["collisions"], 0);
    for id in 1..=6 {
        assert!(distance_m(&served, id) > 60.0, "vehicle {id}: {}", served["vehicles"]);
    }
    for (_, id) in PHYSICAL {
        let status = served["vehicles"][id.to_string()]["status"].as_str().unwrap();
        // What it does, as of any other vehicle.
        let known = ["driving", "yielding", "stopped", "finished", "unseen"];
        assert!(known.contains(&status), "vehicle {id} is {status}");
    }
    // The first of path 1 is virtual. It went in among those of path 2, of whom two are physical.
    let merged: Vec<u64> = events(&far, "merge").iter().map(|(vehicle, _)| *vehicle).collect();
    assert!([1, 4, 6].iter().all(|vehicle| merged.contains(vehicle)), "{merged:?}");
    verify(folder, "served/run.mcap");
}

#[test]
fn three_virtual_and_three_physical_vehicles_are_one_experiment_over_ros() {
    if !ros::has_peers() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let ros = ros::Ros::new(folder);
    let _core = ros.core();
    drive_together(folder, &[&format!("--ros={}", ros.uri())]);
    let heard = summary(&folder.join("served"))["link"]["ros"]["heard"].as_u64().unwrap();
    assert!(heard > 6000, "{heard} poses of three vehicles in 25 s");
    all_are_in_pictures(folder);
}

fn all_are_in_pictures(folder: &Path) {
    let view = ["--camera", "overhead", "--kind", "instance", "--every", "10", "--size", "640x640"];
    let arguments = [&["frames", "served/run.mcap", "--out", "pictures"], &view[..]].concat();
    let output = city3d(&arguments, folder).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let mut pictures = 0;
    for entry in std::fs::read_dir(folder.join("pictures")).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|extension| extension == "png") {
            assert_eq!(instances(&path), (1..=6).collect(), "{}", path.display());
            pictures += 1;
        }
    }
    assert!(pictures >= 3, "{pictures} pictures");
}

/// Who is hidden from motion capture stands, and is found again where it is.
#[test]
fn a_vehicle_out_of_sight_is_marked_until_it_is_found_again() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    mixed(folder, "\n[environment]\nprofile = \"testbed\"\nocclusion_every_s = 5.0\nocclusion_s = 0.8\n");
    let arguments = ["run", "mixed.toml", "--duration", "20", "--out", "run"];
    // Blind driving may end in a collision; that is not what is looked at.
    city3d(&arguments, folder).output().unwrap();
    let summary = summary(&folder.join("run"));
    let (hidden, found) = (events(&summary, "unseen"), events(&summary, "seen_again"));
    assert!(hidden.len() >= 3, "{hidden:?}");
    for (vehicle, time_s) in hidden.iter().filter(|(_, time_s)| *time_s < 18.0) {
        let back = found.iter().find(|(other, back_s)| other == vehicle && back_s > time_s);
        let (_, back_s) = back.unwrap_or_else(|| panic!("vehicle {vehicle} stays away: {found:?}"));
        assert!(back_s - time_s < 1.5, "vehicle {vehicle} from {time_s} to {back_s} s");
    }
    verify(folder, "run/run.mcap");
}

#[test]
fn one_word_puts_a_vehicle_into_the_laboratory_of_a_run_that_repeats() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    mixed(folder, "");
    let run = |out: &str| {
        let output = city3d(&["run", "mixed.toml", "--out", out], folder).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        summary(&folder.join(out))
    };
    let (first, second) = (run("first"), run("second"));
    assert_eq!(first["state_hash"], second["state_hash"]);
    assert_eq!(first["collisions"], 0);
    for (_, id) in PHYSICAL {
        assert!(distance_m(&first, id) > 100.0, "vehicle {id}: {}", first["vehicles"]);
    }
    verify(folder, "first/run.mcap");
}
