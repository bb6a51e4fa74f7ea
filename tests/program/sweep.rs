//! Parameter studies: the same table wherever they were stopped and however many threads they had.

use crate::support::link;

use city3d_logbook::figures::{RunLog, StreamLayout, crossings};
use link::city3d;
use std::collections::BTreeMap;
use std::path::Path;
use std::time::{Duration, Instant};

const GRID: [&str; 8] = [
    "sweep",
    "roundabout",
    "--set",
    "environment.command_delay_s=0:0.2:0.1",
    "--set",
    "environment.position_noise_m=0,0.002",
    "--seeds",
    "1..2",
];

/// Exit code, and all that was said.
fn sweep(arguments: &[&str], folder: &Path) -> (i32, String) {
    let output = city3d(&[&GRID[..], arguments].concat(), folder).output().unwrap();
    let said = [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).unwrap()).concat();
    (output.status.code().unwrap(), said)
}

#[test]
fn a_sweep_gives_the_same_table_with_other_threads_and_stopped_and_resumed() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let rest = ["--environment", "testbed", "--duration", "28"];
    let with = |more: &[&str]| sweep(&[&rest[..], more].concat(), folder);
    let (code, said) = with(&["--threads", "1", "--out", "one"]);
    assert_eq!(code, 0, "{said}");
    let table = |out: &str| std::fs::read(folder.join(out).join("sweep.csv")).unwrap();
    let one = table("one");
    assert_eq!(one.iter().filter(|byte| **byte == b'\n').count(), 1 + 3 * 2 * 2);
    assert_eq!(with(&["--threads", "2", "--out", "two"]).0, 0);
    assert!(table("two") == one, "two threads give another table");

    // Stopped at any byte.
    for share in [1, 3, 6] {
        std::fs::write(folder.join("two/sweep.csv"), &one[..one.len() * share / 7]).unwrap();
        let (code, said) = with(&["--out", "two"]);
        assert_eq!(code, 0, "{said}");
        assert!(table("two") == one, "resumed after {share} of 7");
    }

    // Killed.
    let rest_of: Vec<&str> = [&GRID[..], &rest, &["--threads", "1", "--out", "killed"]].concat();
    let mut child = city3d(&rest_of, folder).spawn().unwrap();
    let begun = Instant::now();
    let rows = || {
        std::fs::read(folder.join("killed/sweep.csv.part"))
            .map_or(0, |bytes| bytes.iter().filter(|b| **b == b'\n').count())
    };
    while rows() < 4 {
        assert!(begun.elapsed() < Duration::from_secs(120), "three runs never end");
        std::thread::sleep(Duration::from_millis(5));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    let (code, said) = with(&["--out", "killed"]);
    assert_eq!(code, 0, "{said}");
    assert!(table("killed") == one, "killed and resumed");

    // The rows are what the runs come to.
    let mut reader = csv::Reader::from_reader(&one[..]);
    let rows: Vec<BTreeMap<String, String>> = reader.deserialize().map(Result::unwrap).collect();
    let row = &rows[1];
    assert_eq!((row["environment.command_delay_s"].as_str(), row["seed"].as_str()), ("0.0", "2"));
    let text = city3d_simulation::scenario::Library::scenario("roundabout").unwrap().0;
    let text = text
        .replace("profile = \"ideal\"", "profile = \"testbed\"\ncommand_delay_s = 0\nposition_noise_m = 0");
    std::fs::write(folder.join("same.toml"), text).unwrap();
    let run = ["run", "same.toml", "--seed", "2", "--duration", "28", "--out", "run"];
    assert!(city3d(&run, folder).output().unwrap().status.success());
    let summary: serde_json::Value =
        serde_json::from_slice(&std::fs::read(folder.join("run/summary.json")).unwrap()).unwrap();
    assert_eq!(summary["state_hash"], row["state_hash"]);
    assert_eq!(summary["collisions"].to_string(), row["collisions"]);
    let log = RunLog::read(&folder.join("run/run.mcap")).unwrap();
    let merge = StreamLayout::of(&log, None, None).unwrap().merge.unwrap();
    let order: Vec<String> = crossings(&log, &merge).iter().map(|(_, id)| id.to_string()).collect();
    assert_eq!(order.join(" "), row["merge_order"]);

    // And the map tells their shares.
    let mut reader = csv::Reader::from_path(folder.join("one/merge_success.csv")).unwrap();
    let cells: Vec<BTreeMap<String, String>> = reader.deserialize().map(Result::unwrap).collect();
    assert_eq!(cells.len(), 6);
    for (cell, rows) in cells.iter().zip(rows.chunks(2)) {
        let share = rows.iter().filter(|row| row["squeezed_in"] != "0").count() as f64 / 2.0;
        assert_eq!(cell["share_squeezed_in"].parse::<f64>().unwrap(), share);
        assert_eq!(
            (&cell["x"], &cell["y"]),
            (&rows[0]["environment.command_delay_s"], &rows[0]["environment.position_noise_m"])
        );
    }
    assert!(folder.join("one/merge_success.png").exists() && folder.join("one/merge_success.svg").exists());
}

#[test]
fn a_sweep_refuses_what_cannot_be_and_the_folder_of_another_one() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let tell = |arguments: &[&str]| {
        let output = city3d(&[&["sweep", "straight", "--duration", "1"], arguments].concat(), folder)
            .output()
            .unwrap();
        let said = [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).unwrap()).concat();
        (output.status.code().unwrap(), said)
    };
    let (code, said) = tell(&["--set", "environment.lost=0,1", "--out", "a"]);
    assert!(code == 2 && said.contains("unknown key \"lost\""), "{said}");
    let (code, said) = tell(&["--set", "environment.loss=0:1", "--out", "a"]);
    assert!(code == 2 && said.contains("loss"), "{said}");
    let (code, said) = tell(&["--set", "vehicle.nobody.at_m=0.1", "--out", "b"]);
    assert!(code == 2 && said.contains("\"nobody\""), "{said}");
    let (code, said) = tell(&["--seeds", "3..1", "--out", "b"]);
    assert!(code == 2 && said.contains("before the first"), "{said}");
    // Nothing merges on a straight road: a table, and no map.
    let (code, said) = tell(&["--seeds", "1..2", "--out", "c"]);
    assert!(code == 0 && said.contains("no map"), "{said}");
    let (code, said) = tell(&["--seeds", "1..3", "--out", "c"]);
    assert!(code == 2 && said.contains("another sweep") && said.contains("--force"), "{said}");
}

#[test]
fn sweeps_of_several_scenarios_share_a_table_and_a_figure() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let tell = |arguments: &[&str]| {
        let output = city3d(arguments, folder).output().unwrap();
        let text = |bytes| String::from_utf8(bytes).unwrap();
        (output.status.code().unwrap(), text(output.stdout), text(output.stderr))
    };
    let study = |scenario: &str, axis: &str, out: &str| {
        let rest =
            ["--environment", "testbed", "--duration", "28", "--seeds", "1..2", "--set", axis, "--out", out];
        let (code, _, said) = tell(&[&["sweep", scenario][..], &rest].concat());
        assert_eq!(code, 0, "{said}");
    };
    let delays = "environment.command_delay_s=0,0.1";
    study("roundabout", delays, "yield");
    study("roundabout-coordinated", delays, "plans");
    let (code, said, complained) = tell(&["compare", "yield", "plans", "--out", "both"]);
    assert_eq!(code, 0, "{complained}");
    let rows = |path: &str| -> Vec<Vec<String>> {
        let mut reader = csv::Reader::from_path(folder.join(path)).unwrap();
        reader.records().map(|row| row.unwrap().iter().map(str::to_owned).collect()).collect()
    };
    assert_eq!(rows("both/delay.csv"), [rows("yield/delay.csv"), rows("plans/delay.csv")].concat());
    let header = said.lines().find(|line| line.starts_with("command_delay_s")).unwrap();
    assert_eq!(header.split_whitespace().skip(1).collect::<Vec<_>>(), ["0", "0.1"]);
    let mean = |path: &str| {
        let found = rows(path).into_iter().find(|row| row[3] == "mean_delay_s").unwrap();
        (found[0].clone(), format!("{:.2} ±", found[4].parse::<f64>().unwrap()))
    };
    for (curve, delay) in [mean("yield/delay.csv"), mean("plans/delay.csv")] {
        let line = said.lines().find(|line| line.split_whitespace().next() == Some(&curve)).unwrap();
        assert!(line.contains(&delay), "{line}: {delay}");
    }
    assert!(folder.join("both/delay.svg").exists() && folder.join("both/delay.png").exists());

    // The same curve in two sweeps: the folders tell which.
    study("roundabout", delays, "again");
    let (code, said, _) = tell(&["compare", "yield", "again", "--json"]);
    let points: Vec<serde_json::Value> = serde_json::from_str(&said).unwrap();
    let names: Vec<&str> = points.iter().map(|point| point["curve"].as_str().unwrap()).collect();
    assert_eq!((code, &names[..]), (0, &["yield", "yield", "again", "again"][..]));
    assert_eq!(points[0]["mean_delay_s"], points[2]["mean_delay_s"]);

    // What has no common figure, and what would write over a sweep.
    study("roundabout", "environment.loss=0,0.01", "losses");
    let whole = std::fs::read(folder.join("losses/sweep.csv")).unwrap();
    let refusals: [(&[&str], &str); 5] = [
        (&["yield", "losses"], "varies loss"),
        (&["yield", "plans", "--out", "yield", "--force"], "choose another --out"),
        (&["missing", "absent", "gone"], "two runs can be compared"),
        (&["yield", "missing"], "missing/sweep.csv: No such file"),
        (&["yield"], "2 values required"),
    ];
    for (arguments, why) in refusals {
        let (code, _, said) = tell(&[&["compare"], arguments].concat());
        assert!(code == 2 && said.contains(why), "{arguments:?}: {said}");
    }
    std::fs::write(folder.join("losses/sweep.csv"), &whole[..whole.len() * 3 / 4]).unwrap();
    let (code, _, said) = tell(&["compare", "losses", "yield"]);
    assert!(code == 2 && said.contains("sweep.csv") && said.contains("--force"), "{said}");
    std::fs::rename(folder.join("losses/sweep.csv"), folder.join("losses/sweep.csv.part")).unwrap();
    let (code, _, said) = tell(&["compare", "losses", "yield"]);
    assert!(code == 2 && said.contains("is not over"), "{said}");
}
