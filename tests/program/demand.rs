//! Grid maps and vehicles that come and go, by the commands: generated, checked, run, simulated again, continued, swept.

use crate::support::link;

use city3d_logbook::record::{LogEntry, LogReader};
use link::city3d;
use serde_json::Value;
use std::path::Path;

/// Exit code, standard output and standard error.
fn tell(arguments: &[&str], folder: &Path) -> (i32, String, String) {
    let output = city3d(arguments, folder).output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    (output.status.code().unwrap(), text(output.stdout), text(output.stderr))
}

fn well(arguments: &[&str], folder: &Path) -> String {
    let (code, said, complained) = tell(arguments, folder);
    assert_eq!((code, complained.as_str()), (0, ""), "{arguments:?}");
    said
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

/// A junction with traffic from all sides in `grid.toml`.
fn generate(folder: &Path) {
    let grid = ["generate", "map", "--grid", "1x1", "--entry", "3m", "--out", "grid.dxf"];
    well(&[&grid[..], &["--scenario", "grid.toml"]].concat(), folder);
    let text = std::fs::read_to_string(folder.join("grid.toml")).unwrap();
    std::fs::write(folder.join("grid.toml"), text.replace("rate_veh_h = 200", "rate_veh_h = 400")).unwrap();
}

#[test]
fn grids_are_maps_and_have_scenarios() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let said = well(&["generate", "map", "--grid", "2x3", "--block", "50cm", "--out", "maps"], folder);
    assert_eq!(said, "maps/grid-2x3.dxf\n");
    let said = well(&["check", "maps/grid-2x3.dxf"], folder);
    // 2 x 2 x 4 + 2 x 3 x 3 lanes and twelve ways through each of six junctions.
    assert!(said.contains("good: 106 lanes") && said.contains("12 stop and yield lines"), "{said}");

    generate(folder);
    let said = well(&["check", "grid.dxf", "grid.toml"], folder);
    assert!(
        said.contains("inflow street-1/east: ") && said.contains("on lane \"street-1/east/1\""),
        "{said}"
    );

    for (arguments, what) in [
        (&["--grid", "0x3"][..], "as in 5x5"),
        (&["--grid", "2x2", "--block", "6"], "with its unit"),
        (&["--grid", "2x2", "--control", "signal"], "all-way-stop"),
        (&["--block", "6m"], "--grid"),
        (&["--grid", "30x30"], "choose fewer or shorter roads"),
        (&["--grid", "2x2", "--entry", "1cm"], "between 0.5 and 100 m"),
    ] {
        let (code, _, complained) = tell(&[&["generate", "map"][..], arguments].concat(), folder);
        assert!(code == 2 && complained.contains(what), "{arguments:?}: {code} {complained}");
    }
}

#[test]
fn runs_with_inflows_are_simulated_again_and_go_on_from_their_logs() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    generate(folder);
    let run = |duration: &str, out: &str| {
        well(&["run", "grid.toml", "--duration", duration, "--out", out], folder);
        digests(&folder.join(out).join("run.mcap"))
    };
    let [first, long] = [run("30", "first"), run("40", "long")];
    assert!(long[..first.len()] == first[..], "a longer run begins as the shorter one");
    let summary = std::fs::read(folder.join("first/summary.json")).unwrap();
    let summary: Value = serde_json::from_slice(&summary).unwrap();
    let inflows = summary["inflows"].as_object().unwrap();
    let sum = |key: &str| inflows.values().map(|of| of[key].as_u64().unwrap()).sum::<u64>();
    assert!(inflows.len() == 4 && sum("left") > 2, "{inflows:?}");
    assert_eq!(sum("arrived"), sum("entered") + sum("held"));
    assert_eq!(summary["vehicles"].as_object().unwrap().len() as u64, sum("entered"));
    well(&["replay", "first/run.mcap", "--verify"], folder);

    // A fork that lasts longer has the arrivals of the longer run.
    let fork = ["run", "first/run.mcap", "--from-tick", "1500", "--duration", "40", "--out", "again"];
    well(&fork, folder);
    assert!(digests(&folder.join("again/run.mcap")) == long, "the fork is another run");
    well(&["replay", "again/run.mcap", "--verify"], folder);

    // From there on with more traffic from the west: its past is another one, and so it is refused.
    let (code, _, complained) = tell(
        &[
            "run",
            "first/run.mcap",
            "--from-tick",
            "1500",
            "--scenario",
            "grid.toml",
            "--seed",
            "9",
            "--out",
            "x",
        ],
        folder,
    );
    assert!(code == 2 && complained.contains("other vehicles before tick 1500"), "{complained}");
}

#[test]
fn a_sweep_sets_all_inflows_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    generate(folder);
    let sweep = ["sweep", "grid.toml", "--set", "inflow.*.rate_veh_h=60,1200", "--duration", "8"];
    let (code, _, complained) = tell(&[&sweep[..], &["--out", "sweep"]].concat(), folder);
    assert_eq!(code, 0, "{complained}");
    let table = std::fs::read_to_string(folder.join("sweep/sweep.csv")).unwrap();
    let rows: Vec<Vec<&str>> = table.lines().map(|line| line.split(',').collect()).collect();
    let column = rows[0].iter().position(|name| *name == "entered").unwrap();
    let entered: Vec<u32> = rows[1..].iter().map(|row| row[column].parse().unwrap()).collect();
    assert!(entered.len() == 2 && entered[1] > entered[0] + 4, "{table}");
}
