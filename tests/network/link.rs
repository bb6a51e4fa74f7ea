//! City and control framework in two processes, as in the laboratory.

use crate::support::link;
use crate::support::watch;

use city3d_protocol::snapshot::Status;
use city3d_protocol::wire::{ExperimentPhase, ObservedVehicle, Poses};
use link::{assert_same_merges, city3d, digests, events, mainframe, serve, serve_at, summary, was_held_up};
use watch::{Watcher, hardest_braking, stand, torn_s};

/// Every tick in the log; one scenario after another goes into the same folders.
const EVERY_TICK: [&str; 3] = ["--log-hz", "100", "--force"];

#[test]
fn in_lockstep_two_processes_do_what_one_does_tick_by_tick() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    // Delays, jitter and loss are in the control framework's process.
    let text = std::fs::read_to_string(link::root().join("scenarios/roundabout.toml")).unwrap();
    let text = text.replace("profile = \"ideal\"", "profile = \"testbed\"");
    std::fs::write(folder.join("testbed.toml"), text).unwrap();
    for (scenario, duration) in [("roundabout", "40"), ("testbed.toml", "8"), ("city", "3")] {
        let run = [&["run", scenario, "--duration", duration, "--out", "run"], &EVERY_TICK[..]].concat();
        assert!(city3d(&run, folder).output().unwrap().status.success());
        let rest = ["--duration", duration, "--lockstep", "--out", "served"];
        let mut city = serve(&[&[scenario], &rest[..], &EVERY_TICK[..]].concat(), folder);
        let arguments = [&[scenario, "--duration", duration, "--out", "far"], &EVERY_TICK[..]].concat();
        let mut far = mainframe(&city.address, &arguments, folder);
        assert_eq!((far.wait(), city.wait()), (0, 0), "{scenario}");

        let alone = digests(&folder.join("run/run.mcap"));
        assert_eq!(alone.len(), duration.parse::<usize>().unwrap() * 100 + 1);
        for other in ["served", "far"] {
            let digests = digests(&folder.join(other).join("run.mcap"));
            let first = alone.iter().zip(&digests).find(|(a, b)| a != b);
            assert_eq!((first, digests.len()), (None, alone.len()), "{scenario}: {other}");
        }
        let [run, served, far] = ["run", "served", "far"].map(|name| summary(&folder.join(name)));
        assert_eq!(run["state_hash"], served["state_hash"]);
        assert_eq!(events(&run, "merge"), events(&far, "merge"), "{scenario}");
        assert_eq!(served["collisions"], 0);
    }
}

#[test]
fn the_files_of_a_run_end_with_what_was_before_the_reset() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let mut city = serve(&["straight", "--lockstep", "--out", "served"], folder);
    for _ in 0..2 {
        // The second one finds the experiment at its end, and resets it.
        assert_eq!(mainframe(&city.address, &["straight", "--duration", "2"], folder).wait(), 0);
    }
    assert_eq!(city.end(), 0);
    let [first, second] = ["served", "served/part-2"].map(|name| summary(&folder.join(name)));
    assert_eq!(first["simulated_s"], 2.0, "{first}");
    assert!(first["mean_speed_mps"].as_f64().unwrap() > 0.0, "{first}");
    assert_eq!(first["state_hash"], second["state_hash"]);
}

#[test]
fn in_real_time_the_same_merge_in_the_same_order() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let alone = ["run", "roundabout", "--duration", "18", "--out", "run"];
    assert!(city3d(&alone, folder).output().unwrap().status.success());
    let expected = events(&summary(&folder.join("run")), "merge");
    assert!(expected.len() > 10);
    for attempt in 1.. {
        let length = ["roundabout", "--duration", "18", "--force"];
        let mut city = serve(&[&length[..], &["--speed", "3", "--out", "served"]].concat(), folder);
        let mut far = mainframe(&city.address, &[&length[..], &["--out", "far"]].concat(), folder);
        assert_eq!((far.wait(), city.wait()), (0, 0));
        let [served, far] = ["served", "far"].map(|name| summary(&folder.join(name)));
        if was_held_up(&served) && attempt < 6 {
            continue;
        }
        assert_same_merges(&events(&far, "merge"), &expected);
        assert_eq!(served["collisions"], 0);
        assert_eq!(served["link"]["dropped"].as_object().unwrap().len(), 0, "{}", served["link"]);
        return;
    }
}

fn all(poses: &Poses, status: Status) -> bool {
    poses.vehicles.len() == 6 && poses.vehicles.iter().all(|seen| seen.status == status)
}

fn drive(poses: &Poses) -> bool {
    let drives = |seen: &&ObservedVehicle| matches!(seen.status, Status::Driving | Status::Yielding);
    poses.phase == ExperimentPhase::Running && poses.vehicles.iter().filter(drives).count() >= 5
}

#[test]
fn mainframe_and_city_may_be_killed_and_restarted() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let served = |out| ["roundabout", "--speed", "2", "--out", out];
    let mut city = serve(&served("first"), folder);
    let address = city.address.clone();
    let length = ["roundabout", "--duration", "60", "--out", "far", "--force"];
    let start = || mainframe(&address, &length, folder);
    let mut far = start();
    let mut watcher = Watcher::new(&address);
    watcher.until("do they drive", |poses| drive(poses) && poses.time_s > 3.0);

    far.signal("-KILL");
    far.wait();
    let mut seen = watcher.until("do they lose the link", |poses| all(poses, Status::LinkLost));
    while !stand(&seen) {
        seen.push(watcher.next());
        assert!(seen.len() < 3000, "they do not stop");
    }
    let braking = hardest_braking(&seen, 10, |_| true);
    assert!((2.0..5.3).contains(&braking), "{braking} m/s2");

    let mut far = start();
    watcher.until("do they go on", drive);
    let before = watcher.next();

    city.signal("-KILL");
    city.wait();
    let mut city = serve_at(&address, &served("second"), folder);
    // Poses of the old one may still be on their way; in the new one time begins anew.
    let is_new = |poses: &Poses| (1.5..before.time_s - 0.5).contains(&poses.time_s);
    let seen = watcher.until("do they go on in the new city", |poses| drive(poses) && is_new(poses));
    for (old, new) in before.vehicles.iter().zip(&seen.last().unwrap().vehicles) {
        let way_m = (old.pose.position - new.pose.position).length();
        assert!(way_m < 1.5, "vehicle {} has jumped {way_m} m", old.pose.vehicle);
    }
    assert_eq!((far.end(), city.end()), (0, 0));
    let second = summary(&folder.join("second"));
    assert_eq!(second["collisions"], 0);
    assert!(digests(&folder.join("second/run.mcap")).len() > 50);
    let last_s = torn_s(&folder.join("first/run.mcap"));
    assert!(last_s > before.time_s - 3.0, "the log ends at {last_s} s, the city at {} s", before.time_s);
}
