//! Runs that go on otherwise from the middle of a log.

use crate::support::link;

use city3d_logbook::record::{LogEntry, LogReader};
use link::city3d;
use std::path::Path;

/// Exit code and what was complained of.
fn tell(arguments: &[&str], folder: &Path) -> (i32, String) {
    let output = city3d(arguments, folder).output().unwrap();
    (output.status.code().unwrap(), String::from_utf8(output.stderr).unwrap())
}

/// The digest of every tick.
fn digests(log: &Path) -> Vec<(u64, u64)> {
    let mut log = LogReader::open(log).unwrap();
    let mut found = Vec::new();
    while let Some(entry) = log.read().unwrap() {
        if let LogEntry::Tick { tick, state_hash } = entry {
            found.push((tick, state_hash));
        }
    }
    found
}

#[test]
fn without_a_change_a_fork_equals_its_origin_at_every_tick_and_a_changed_future_verifies() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let first = ["run", "roundabout", "--duration", "20", "--environment", "testbed", "--out", "first"];
    assert_eq!(tell(&first, folder).0, 0);
    let origin = digests(&folder.join("first/run.mcap"));
    assert_eq!(origin.len(), 2001);

    let again: [&[&str]; 2] = [&[], &["--scenario", "roundabout"]];
    for (k, scenario) in again.into_iter().enumerate() {
        let out = format!("again-{k}");
        let fork = ["run", "first/run.mcap", "--from-tick", "733", "--duration", "20", "--out", &out];
        let (code, said) = tell(&[&fork[..], scenario].concat(), folder);
        assert_eq!((code, said.as_str()), (0, ""), "{scenario:?}");
        assert!(digests(&folder.join(&out).join("run.mcap")) == origin, "{scenario:?} is another run");
    }

    // From there on without the testbed: the past is the same, the future another one, and the log its own proof.
    let fork = ["run", "first/run.mcap", "--from-tick", "700", "--scenario", "roundabout"];
    let fork = [&fork[..], &["--environment", "ideal", "--duration", "24", "--out", "other"]].concat();
    let (code, said) = tell(&fork, folder);
    assert_eq!(code, 0, "{said}");
    let other = digests(&folder.join("other/run.mcap"));
    assert_eq!(other.len(), 2401);
    let same = other.iter().zip(&origin).take_while(|(a, b)| a == b).count();
    assert!((700..760).contains(&same), "{same}");
    let (code, said) = tell(&["replay", "other/run.mcap", "--verify"], folder);
    assert_eq!(code, 0, "{said}");
    // Into the folder of its origin it would write over what it begins from.
    let before = std::fs::read(folder.join("first/run.mcap")).unwrap();
    for out in ["first", "./first/../first"] {
        let (code, said) =
            tell(&["run", "first", "--from-tick", "700", "--duration", "24", "--out", out], folder);
        assert!(code == 2 && said.contains("choose another --out"), "{code} {said}");
    }
    assert!(std::fs::read(folder.join("first/run.mcap")).unwrap() == before);

    // A fork of a fork: its scenario is not what its first seconds were driven by, and it says so.
    let third = ["run", "other/run.mcap", "--from-tick", "1000", "--duration", "12", "--out", "third"];
    let (code, said) = tell(&third, folder);
    assert!(code == 0 && said.contains("sends other trajectories than the log has"), "{said}");
    assert!(digests(&folder.join("third/run.mcap"))[..1001] == other[..1001]);
}

#[test]
fn another_driver_may_come_and_another_past_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    assert_eq!(tell(&["run", "straight", "--duration", "6", "--out", "first"], folder).0, 0);
    let text = city3d_simulation::scenario::Library::scenario("straight").unwrap().0;
    let fork = |name: &str, changed: String, tick: &str| {
        std::fs::write(folder.join(name), changed).unwrap();
        let rest = ["--scenario", name, "--duration", "6", "--out", "forked", "--force"];
        tell(&[&["run", "first/run.mcap", "--from-tick", tick][..], &rest].concat(), folder)
    };
    let (code, said) =
        fork("slow.toml", format!("{text}\n[driver.default]\ndesired_speed_mps = 0.1\n"), "50");
    assert_eq!(code, 0, "{said}");
    let driven = |name: &str| -> f64 {
        let summary = std::fs::read(folder.join(name).join("summary.json")).unwrap();
        let summary: serde_json::Value = serde_json::from_slice(&summary).unwrap();
        summary["vehicles"]["2"]["distance_m"].as_f64().unwrap()
    };
    assert!(driven("forked") < driven("first") - 1.0, "{} {}", driven("forked"), driven("first"));
    let (code, said) = tell(&["replay", "forked/run.mcap", "--verify"], folder);
    assert_eq!(code, 0, "{said}");

    let (code, said) = fork("start.toml", text.replace("at_m = 0.9", "at_m = 1.0"), "200");
    assert!(code == 2 && said.contains("vehicle 1 (leader) has another start"), "{said}");
    assert!(said.contains("the environment, the seed and the duration may change"), "{said}");
    let (code, said) = fork("heavy.toml", format!("{text}\n[vehicle_type.default]\nmass_kg = 1800\n"), "200");
    assert!(code == 2 && said.contains("another vehicle type"), "{said}");
    let (code, said) =
        fork("city.toml", city3d_simulation::scenario::Library::scenario("roundabout").unwrap().0, "200");
    assert!(code == 2 && said.contains("other vehicles"), "{said}");
    let (code, said) = fork("same.toml", text.clone(), "599");
    assert_eq!(code, 0, "{said}");
    let (code, said) = fork("same.toml", text, "600");
    assert!(code == 2 && said.contains("would end at tick 600"), "{said}");
    let late = ["run", "first/run.mcap", "--from-tick", "601", "--duration", "9", "--out", "late"];
    let (code, said) = tell(&late, folder);
    assert!(code == 2 && said.contains("the log ends at tick 600"), "{said}");
    let (code, said) = tell(&["run", "first/run.mcap", "--out", "none"], folder);
    assert!(code == 2 && said.contains("--from-tick N"), "{said}");
    let (code, said) = tell(&["run", "straight", "--from-tick", "3", "--out", "none"], folder);
    assert!(code == 2 && said.contains("give its run.mcap"), "{said}");
}
