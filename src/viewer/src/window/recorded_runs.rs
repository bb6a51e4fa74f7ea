//! Recorded runs in the user's folder, for the start page.

use crate::ui::runs::{RunEntry, has_run};
use city3d_logbook::measures::RunMeasures;
use city3d_simulation::scenario::{Experiment, counted};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

/// Runs that are listed at most.
const MOST: usize = 40;
/// Depth of run folders below the folder of all runs: a folder for each window, and one for each of its runs.
const DEPTH: usize = 2;

/// The recorded runs in some folders, the latest first.
pub fn recorded_runs<'a>(folders: impl Iterator<Item = &'a Path>, now: SystemTime) -> Vec<RunEntry> {
    let mut found = Vec::new();
    for folder in folders {
        find(folder, DEPTH, &mut found);
    }
    found.sort_by(|a, b| b.cmp(a));
    found.dedup();
    let entry = |(written, folder): (SystemTime, PathBuf)| {
        let since = now.duration_since(written).unwrap_or_default();
        let of = RunFolder::of(&folder);
        let measures = RunMeasures::read(&folder).ok();
        let conditions =
            measures.as_ref().map(|of| conditions_of(of.seed, &of.environment, of.ideal_but_for_lab));
        RunEntry {
            name: of.name(conditions),
            outcome: measures.map_or_else(String::new, |of| outcome(&of)),
            began: of.began(since, after_first(&folder)),
            age: age(since),
            has_summary: folder.join(SUMMARY).is_file(),
            folder,
        }
    };
    found.into_iter().take(MOST).map(entry).collect()
}

const SUMMARY: &str = "summary.json";

/// Length and collisions of a run, in few words: the lists are narrow.
fn outcome(of: &RunMeasures) -> String {
    let length = format!("{:.0} s", of.simulated_s);
    match of.collisions {
        0 => length,
        count => format!("{length}, {}", counted(count as usize, "collision")),
    }
}

/// Seed and environment of a run, shorter than [`RunMeasures::conditions`].
fn conditions_of(seed: u64, environment: &str, ideal_but_for_lab: bool) -> String {
    match environment {
        "" => format!("seed {seed}"),
        _ if ideal_but_for_lab => format!("seed {seed}, {environment} but lab vehicles"),
        _ => format!("seed {seed}, {environment}"),
    }
}

/// Name of a run of an experiment in a folder, with its seed and environment.
pub fn named(folder: &Path, of: &Experiment) -> String {
    RunFolder::of(folder).name(Some(conditions_of(of.seed, of.environment_name(), of.is_ideal_but_for_lab())))
}

fn find(folder: &Path, depth: usize, found: &mut Vec<(SystemTime, PathBuf)>) {
    if has_run(folder) {
        let written = std::fs::metadata(super::opening::log_in(folder)).and_then(|log| log.modified());
        found.push((written.unwrap_or(SystemTime::UNIX_EPOCH), folder.to_path_buf()));
    }
    if depth == 0 {
        return;
    }
    let inside = std::fs::read_dir(folder).into_iter().flatten().flatten();
    inside
        .map(|entry| entry.path())
        .filter(|path| path.is_dir())
        .for_each(|path| find(&path, depth - 1, found));
}

/// How long after the first run of its window a run began: by when their logs were made, where the file system tells it.
fn after_first(folder: &Path) -> Duration {
    let made =
        |folder: &Path| std::fs::metadata(super::opening::log_in(folder)).and_then(|log| log.created()).ok();
    let first = folder.parent().and_then(|window| made(&window.join("run-1")));
    made(folder).zip(first).and_then(|(own, first)| own.duration_since(first).ok()).unwrap_or_default()
}

/// What the folders of a run tell: `roundabout-20261125-131520/run-2` is the second run of a window that began then.
struct RunFolder {
    scenario: String,
    /// `20261125` and `131520`.
    began: Option<[String; 2]>,
    number: u32,
}

impl RunFolder {
    fn of(folder: &Path) -> Self {
        let last = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let own = last(folder);
        let Some(number) = own.strip_prefix("run-").and_then(|number| number.parse().ok()) else {
            return Self { scenario: own, began: None, number: 1 };
        };
        let window = folder.parent().map(last).unwrap_or_default();
        let is_number = |part: &&str| !part.is_empty() && part.bytes().all(|byte| byte.is_ascii_digit());
        let parts: Vec<&str> = window.split('-').collect();
        let numbers = parts[1..].iter().rev().take_while(|part| is_number(part)).count();
        let (scenario, time) = parts.split_at(parts.len() - numbers);
        let began = match time {
            [date, clock, ..] if date.len() == 8 && clock.len() == 6 => {
                Some([(*date).to_owned(), (*clock).to_owned()])
            }
            _ => None,
        };
        Self { scenario: scenario.join("-"), began, number }
    }

    fn name(&self, conditions: Option<String>) -> String {
        let conditions = conditions.map_or_else(String::new, |conditions| format!(", {conditions}"));
        let number = if self.number > 1 { format!(", run {}", self.number) } else { String::new() };
        format!("{}{conditions}{number}", self.scenario)
    }

    /// The time of day, and the date of a run that was made before today; `later` than the first one of the window.
    fn began(&self, age: Duration, later: Duration) -> String {
        let Some([date, clock]) = &self.began else { return String::new() };
        let [h, min, s] = [0, 2, 4].map(|from| clock[from..from + 2].parse().unwrap_or(0_u64));
        let minutes = (h * 3600 + min * 60 + s + later.as_secs()) / 60;
        let time = format!("{:02}:{:02} UTC", minutes / 60 % 24, minutes % 60);
        if age < Duration::from_hours(20) {
            return time;
        }
        format!("{}-{}-{} {time}", &date[..4], &date[4..6], &date[6..])
    }
}

/// How long ago the files of a run were complete, in words, which is when it was closed: beside it is the time at which it began.
fn age(age: Duration) -> String {
    let minutes = age.as_secs() / 60;
    let (count, unit) = match minutes {
        0 => return "saved just now".to_owned(),
        1..60 => (minutes, "minute"),
        60..1440 => (minutes / 60, "hour"),
        _ => (minutes / 1440, "day"),
    };
    format!("saved {count} {unit}{} ago", if count == 1 { "" } else { "s" })
}

#[cfg(test)]
mod tests {
    use super::*;

    const SUMMARY_OF_SEED_7: &str = r#"{"scenario": "merge", "seed": 7, "environment": "testbed", "simulated_s": 40.0, "collisions": 2,
        "mean_speed_mps": 7.0, "vehicles": {}}"#;

    #[test]
    fn runs_are_found_and_named_after_their_scenarios() {
        let root = tempfile::tempdir().unwrap();
        for run in ["roundabout-20261125-131520/run-2", "merge-20261125-131520-2/run-1", "own"] {
            let folder = root.path().join(run);
            std::fs::create_dir_all(&folder).unwrap();
            std::fs::write(folder.join("run.mcap"), "").unwrap();
        }
        std::fs::write(root.path().join("own/summary.json"), "{}").unwrap();
        let merge = root.path().join("merge-20261125-131520-2/run-1/summary.json");
        std::fs::write(merge, SUMMARY_OF_SEED_7).unwrap();
        let later = SystemTime::now() + Duration::from_secs(7300);
        let mut runs = recorded_runs([root.path(), root.path()].into_iter(), later);
        runs.sort_by(|a, b| a.name.cmp(&b.name));
        let told: Vec<_> = runs.iter().map(|run| (run.name.as_str(), run.has_summary)).collect();
        assert_eq!(told, [("merge, seed 7, testbed", true), ("own", true), ("roundabout, run 2", false)]);
        assert_eq!(
            runs.iter().map(|run| run.began.as_str()).collect::<Vec<_>>(),
            ["13:15 UTC", "", "13:15 UTC"]
        );
        let of = RunFolder::of(Path::new("grid-2x5-20261125-131520/run-1"));
        assert_eq!(
            (of.name(None).as_str(), of.began(Duration::from_hours(48), Duration::ZERO).as_str()),
            ("grid-2x5", "2026-11-25 13:15 UTC")
        );
        assert_eq!(
            of.began(Duration::ZERO, Duration::from_secs(401)),
            "13:22 UTC",
            "a later run of that window"
        );
        assert!(runs.iter().all(|run| run.age == "saved 2 hours ago"), "{runs:?}");
        assert_eq!(
            runs.iter().map(|run| run.outcome.as_str()).collect::<Vec<_>>(),
            ["40 s, 2 collisions", "", ""]
        );
    }

    #[test]
    fn ages_are_told_in_the_largest_unit() {
        let told = [5, 61, 3599, 90_000].map(|seconds| age(Duration::from_secs(seconds)));
        assert_eq!(
            told,
            ["just now", "1 minute ago", "59 minutes ago", "1 day ago"].map(|ago| format!("saved {ago}"))
        );
    }
}
