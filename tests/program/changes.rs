//! Values of a scenario that are set from the command line.

use crate::support::link;

use link::{city3d, root, summary};
use std::path::Path;
use std::process::Output;

const SHORT: [&str; 4] = ["--duration", "12", "--csv-hz", "1"];

fn run(arguments: &[&str], folder: &Path) -> Output {
    city3d(&[&["run"], arguments, &SHORT].concat(), folder).output().unwrap()
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
fn a_value_that_is_set_is_that_of_a_scenario_which_has_it() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let text = std::fs::read_to_string(root().join("scenarios/roundabout-coordinated.toml")).unwrap();
    let changed = text.replace("algorithm = \"insert\"", "algorithm = \"none\"");
    assert_ne!(text, changed);
    std::fs::write(folder.join("none.toml"), &changed).unwrap();
    let set = ["roundabout-coordinated", "--set", "coordination.algorithm=none", "--out", "set"];
    for arguments in
        [&set[..], &["none.toml", "--out", "written"], &["roundabout-coordinated", "--out", "plain"]]
    {
        let output = run(arguments, folder);
        assert!(output.status.success(), "{}", said(&output));
    }
    let state = |out: &str| summary(&folder.join(out))["state_hash"].clone();
    assert_eq!(state("set"), state("written"));
    assert_ne!(state("set"), state("plain"));
    // The log has what was set, with the comments of the file.
    let verified = city3d(&["replay", "set/run.mcap", "--verify"], folder).output().unwrap();
    assert!(verified.status.success(), "{}", said(&verified));
}

#[test]
fn values_that_cannot_be_set_are_told_with_their_key() {
    let folder = tempfile::tempdir().unwrap();
    for (change, message) in [
        ("coordination.algorithm=fastest", "there is no coordination algorithm \"fastest\""),
        ("vehicle.path9.at_m=1", "vehicle has no entry \"path9\"; give a name, or a number from 1"),
        ("seed", "write KEY=VALUE, such as coordination.algorithm=fifo"),
        ("coordination.lateral_gap=1", "unknown key \"lateral_gap\"; did you mean \"lateral_gap_s\"?"),
    ] {
        let output = run(&["roundabout-coordinated", "--set", change], folder.path());
        assert_eq!(output.status.code(), Some(2), "{change}");
        assert!(said(&output).contains(message), "{change}: {}", said(&output));
    }
    let output = run(&["roundabout-coordinated", "--set", "coordination.algorithm=fastest"], folder.path());
    assert!(said(&output).contains("(with coordination.algorithm=\"fastest\")"), "{}", said(&output));
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "nothing is written");
}
