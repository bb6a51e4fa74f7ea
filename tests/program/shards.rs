//! Sweeps in shards: processes anywhere make the table of one machine, and nothing is taken for what it is not.

use crate::support::link;

use link::city3d;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::time::{Duration, Instant};

const STUDY: [&str; 9] = [
    "sweep",
    "roundabout",
    "--environment",
    "testbed",
    "--duration",
    "3",
    "--set",
    "environment.command_delay_s=0,0.1",
    "--seeds",
];

/// Exit code, and all that was said, of a sweep with these seeds.
fn tell(folder: &Path, seeds: &str, more: &[&str]) -> (i32, String) {
    let output = city3d(&[&STUDY[..], &[seeds], more].concat(), folder).output().unwrap();
    let said = [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).unwrap()).concat();
    (output.status.code().unwrap_or(-1), said)
}

/// The shards `I/N` of a sweep, made one by one.
fn make(folder: &Path, seeds: &str, out: &str, shards: &[&str]) {
    for shard in shards {
        let (code, said) = tell(folder, seeds, &["--out", out, "--threads", "1", "--shard", shard]);
        assert_eq!(code, 0, "{said}");
    }
}

/// Every file of the folder of a finished sweep, but those that tell of machines.
fn files(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let entries = std::fs::read_dir(folder).unwrap().flatten().filter(|entry| entry.path().is_file());
    let named =
        entries.map(|entry| entry.file_name().into_string().unwrap()).filter(|name| name != "shards.csv");
    let mut files: Vec<_> =
        named.map(|name| (name.clone(), std::fs::read(folder.join(name)).unwrap())).collect();
    files.sort();
    files
}

#[test]
fn shards_of_processes_are_put_together_to_the_files_of_one_machine() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    assert_eq!(tell(folder, "1..5", &["--out", "one", "--parquet"]).0, 0);
    // 10 runs in 4 shards, in another order, one of them by two processes at once.
    make(folder, "1..5", "cut", &["3/4", "0/4", "1/4"]);
    let twice = [&STUDY[..], &["1..5", "--out", "cut", "--shard", "2/4"]].concat();
    let both = [(); 2].map(|()| city3d(&twice, folder).spawn().unwrap());
    for mut child in both {
        assert!(child.wait().unwrap().success());
    }
    let (code, said) = tell(folder, "1..5", &["--out", "cut", "--merge", "--parquet"]);
    assert_eq!(code, 0, "{said}");
    let (one, cut) = (files(&folder.join("one")), files(&folder.join("cut")));
    let names = |files: &[(String, Vec<u8>)]| files.iter().map(|(name, _)| name.clone()).collect::<Vec<_>>();
    assert_eq!(names(&one), names(&cut));
    assert!(
        names(&one).contains(&"sweep.parquet".to_owned())
            && names(&one).contains(&"collisions.png".to_owned())
    );
    for ((name, one), (_, cut)) in one.iter().zip(&cut) {
        assert!(one == cut, "{name} is another file");
    }

    // What made the rows, and where.
    let mut table = csv::Reader::from_path(folder.join("cut/shards.csv")).unwrap();
    let rows: Vec<std::collections::BTreeMap<String, String>> =
        table.deserialize().map(Result::unwrap).collect();
    let host = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap();
    assert_eq!(rows.len(), 4);
    for (row, (first, runs)) in rows.iter().zip([("0", "2"), ("2", "3"), ("5", "2"), ("7", "3")]) {
        assert_eq!(
            (row["first_run"].as_str(), row["runs"].as_str(), row["host"].as_str()),
            (first, runs, host.trim())
        );
        assert_eq!((row["version"].as_str(), row["scenario_sha256"].len()), (env!("CARGO_PKG_VERSION"), 64));
        assert!(
            row["wall_s"].parse::<f64>().unwrap() > 0.0
                && row["command"].contains("--seeds 1..5 --out cut --shard")
        );
    }

    // A shard that is there is not made again, unless that is wanted; the table goes on as a sweep does.
    let before = std::fs::read(folder.join("cut/shards/1-of-4.csv")).unwrap();
    let (code, said) = tell(folder, "1..5", &["--out", "cut", "--shard", "1/4"]);
    assert!(code == 0 && said.contains("done already"), "{said}");
    assert!(std::fs::read(folder.join("cut/shards/1-of-4.csv")).unwrap() == before);
    assert_eq!(tell(folder, "1..5", &["--out", "cut", "--shard", "1/4", "--force"]).0, 0);
    assert_eq!(tell(folder, "1..5", &["--out", "cut", "--merge"]).0, 0);
    assert_eq!(tell(folder, "1..5", &["--out", "cut"]).0, 0);
    assert!(files(&folder.join("cut")) == one, "merged again");
}

#[test]
fn what_is_missing_or_cut_or_of_another_study_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let merge = |seeds: &str| tell(folder, seeds, &["--out", "cut", "--merge"]);
    let (code, said) = merge("1..3");
    assert!(code == 1 && said.contains("has no shards") && said.contains("--shard 0/N"), "{said}");
    make(folder, "1..3", "cut", &["1/3"]);
    let (code, said) = merge("1..3");
    let command = "city3d sweep roundabout --duration 3 --environment testbed --set environment.command_delay_s=0,0.1 --seeds 1..3 \
                   --out cut --shard 2/3";
    assert!(
        code == 1 && said.contains("2 of 3 shards are missing: 0,2.") && said.contains(command),
        "{said}"
    );

    // The command that is named makes what is missing.
    let words: Vec<&str> = command.split(' ').skip(1).collect();
    assert!(city3d(&words, folder).output().unwrap().status.success());
    make(folder, "1..3", "cut", &["0/3"]);
    let path = folder.join("cut/shards/2-of-3.csv");
    let whole = std::fs::read(&path).unwrap();
    std::fs::write(&path, &whole[..whole.len() - 30]).unwrap();
    let (code, said) = merge("1..3");
    assert!(
        code == 1 && said.contains("2-of-3.csv is damaged") && said.contains("1 of 3 shards is missing: 2."),
        "{said}"
    );
    make(folder, "1..3", "cut", &["2/3"]);
    assert!(!folder.join("cut/sweep.csv").exists());
    assert_eq!(merge("1..3").0, 0);

    // Other seeds, another duration, another version, another number of shards.
    let (code, said) = merge("1..4");
    assert!(code == 2 && said.contains("is of other parameters or seeds"), "{said}");
    let (code, said) = tell(folder, "1..4", &["--out", "cut", "--shard", "1/3"]);
    assert!(code == 2 && said.contains("1-of-3.csv is of other parameters or seeds"), "{said}");
    let text = String::from_utf8(std::fs::read(&path).unwrap()).unwrap();
    let version = format!("version = \"{}\"", env!("CARGO_PKG_VERSION"));
    std::fs::write(&path, text.replace(&version, "version = \"0.0.7\"")).unwrap();
    let (code, said) = merge("1..3");
    assert!(code == 2 && said.contains("2-of-3.csv is of version 0.0.7"), "{said}");
    std::fs::write(&path, text).unwrap();
    make(folder, "1..3", "cut", &["0/2"]);
    let (code, said) = merge("1..3");
    assert!(code == 2 && said.contains("has shards of 2 and of 3 together"), "{said}");

    for (shard, why) in [("3/3", "the last of 3 is 2/3"), ("1", "write I/N"), ("0/7", "7 shards of 6 runs")] {
        let (code, said) = tell(folder, "1..3", &["--out", "more", "--shard", shard]);
        assert!(code == 2 && said.contains(why), "{said}");
    }
}

#[test]
fn a_scenario_map_that_changes_makes_another_study() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let map = city3d_simulation::scenario::Library::default().map("ids3c").unwrap();
    let text = city3d_simulation::scenario::Library::scenario("straight").unwrap().0;
    std::fs::write(folder.join("own.toml"), text.replace("map = \"ids3c\"", "map = \"own.dxf\"")).unwrap();
    std::fs::write(folder.join("own.dxf"), &map).unwrap();
    let sweep = |more: &[&str]| {
        let study = ["sweep", "own.toml", "--duration", "1", "--seeds", "1..2", "--out", "cut"];
        let output = city3d(&[&study[..], more].concat(), folder).output().unwrap();
        (output.status.code().unwrap(), String::from_utf8(output.stderr).unwrap())
    };
    assert_eq!(sweep(&["--shard", "0/2"]).0, 0);
    std::fs::write(folder.join("own.dxf"), [b"999\nchanged\n", &map[..]].concat()).unwrap();
    let (code, said) = sweep(&["--merge"]);
    assert!(code == 2 && said.contains("0-of-2.csv is of another scenario, map or model"), "{said}");
}

#[test]
fn a_killed_shard_leaves_nothing_that_counts() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    // Long enough to be killed while it runs.
    let long = ["sweep", "city", "--seeds", "1..400", "--out", "cut", "--threads", "1", "--shard", "1/2"];
    let mut child = city3d(&long, folder).spawn().unwrap();
    std::thread::sleep(Duration::from_millis(300));
    child.kill().unwrap();
    assert!(!child.wait().unwrap().success());
    let output = city3d(&[&long[..6], &["--merge"]].concat(), folder).output();
    let said = String::from_utf8(output.unwrap().stderr).unwrap();
    assert!(said.contains("has no shards"), "{said}");
}

/// Stands in for a command of Slurm.
fn command(folder: &Path, name: &str, script: &str) {
    let path = folder.join("bin").join(name);
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    std::fs::write(&path, format!("#!/bin/bash\n{script}")).unwrap();
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o755)).unwrap();
}

#[test]
fn the_script_of_an_array_job_makes_the_shards_and_what_is_missing_is_submitted_again() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    assert_eq!(tell(folder, "1..4", &["--out", "one"]).0, 0);
    let submit = ["--out", "with space", "--submit", "slurm", "--shards", "4"];
    let (code, said) = tell(folder, "1..4", &submit);
    assert!(
        code == 0 && said.contains("4 tasks of 8 runs") && said.contains("sbatch 'with space/sweep.sbatch'"),
        "{said}"
    );
    let script = std::fs::read_to_string(folder.join("with space/sweep.sbatch")).unwrap();
    assert!(script.contains("#SBATCH --array=0-3\n") && script.contains("#SBATCH --requeue\n"), "{script}");

    // Runs the tasks in place of Slurm, but the second one the first time; is asked once for a job that is queued.
    command(
        folder,
        "sbatch",
        r#"echo "$@" >> bin/submitted
for task in $(echo "$2" | sed 's/--array=//; s/0-3/0 1 2 3/'); do
    if [[ $task == 1 && ! -e bin/killed ]]; then touch bin/killed; continue; fi
    SLURM_ARRAY_TASK_ID=$task bash "$3" >&2 || exit 1
done
echo 17"#,
    );
    command(folder, "squeue", "echo asked >> bin/asked; [[ $(wc -l < bin/asked) != 2 ]] || echo 17");
    let path = format!("{}:{}", folder.join("bin").display(), std::env::var("PATH").unwrap());
    let go = |more: &[&str]| {
        let words = [&STUDY[..], &["1..4"], &submit, &["--go"], more].concat();
        let output = city3d(&words, folder).env("PATH", &path).output().unwrap();
        let said = [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).unwrap()).concat();
        (output.status.code().unwrap(), said)
    };
    let begun = Instant::now();
    let (code, said) = go(&["--wait"]);
    assert_eq!(code, 0, "{said}");
    assert!(begun.elapsed() < Duration::from_secs(120));
    let submitted = std::fs::read_to_string(folder.join("bin/submitted")).unwrap();
    assert_eq!(
        submitted.lines().collect::<Vec<_>>(),
        ["--parsable --array=0-3 with space/sweep.sbatch", "--parsable --array=1 with space/sweep.sbatch"]
    );
    assert!(files(&folder.join("one")).iter().all(|(name, one)| {
        std::fs::read(folder.join("with space").join(name)).is_ok_and(|merged| merged == *one)
    }));

    // A person's changes of the script stay, and a job that makes nothing is not submitted for ever.
    let script = script.replace("exec ", "exit 1\nexec ");
    std::fs::write(folder.join("with space/sweep.sbatch"), &script).unwrap();
    std::fs::remove_file(folder.join("with space/shards/2-of-4.csv")).unwrap();
    command(folder, "sbatch", "echo 18");
    let (code, said) = go(&["--wait"]);
    assert!(code == 1 && said.contains("job 18 has made none of its shards (2)"), "{said}");
    assert_eq!(std::fs::read_to_string(folder.join("with space/sweep.sbatch")).unwrap(), script);
    command(folder, "sbatch", "echo sbatch: error: Invalid account >&2; exit 1");
    let (code, said) = go(&[]);
    assert!(code == 1 && said.contains("Invalid account"), "{said}");
}
