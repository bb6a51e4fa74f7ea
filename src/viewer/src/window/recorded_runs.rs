//! Recorded runs in the user's folder, for the start page.

use crate::ui::runs::{RunEntry, has_run};
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
    let entry = |(written, folder): (SystemTime, PathBuf)| RunEntry {
        name: name(&folder),
        age: age(now.duration_since(written).unwrap_or_default()),
        has_summary: folder.join("summary.json").is_file(),
        folder,
    };
    found.into_iter().take(MOST).map(entry).collect()
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

/// Scenario and number of a run, by its folders: `roundabout-20261125-131520/run-2` is "roundabout, run 2".
fn name(folder: &Path) -> String {
    let last = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let own = last(folder);
    let Some(number) = own.strip_prefix("run-") else { return own };
    let window = folder.parent().map(last).unwrap_or_default();
    let is_time = |part: &str| !part.is_empty() && part.bytes().all(|byte| byte.is_ascii_digit());
    let mut parts: Vec<&str> = window.split('-').collect();
    while parts.len() > 1 && parts.last().is_some_and(|part| is_time(part)) {
        parts.pop();
    }
    format!("{}, run {number}", parts.join("-"))
}

/// How long ago, in words.
fn age(age: Duration) -> String {
    let minutes = age.as_secs() / 60;
    let (count, unit) = match minutes {
        0 => return "just now".to_owned(),
        1..60 => (minutes, "minute"),
        60..1440 => (minutes / 60, "hour"),
        _ => (minutes / 1440, "day"),
    };
    format!("{count} {unit}{} ago", if count == 1 { "" } else { "s" })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_are_found_and_named_after_their_scenarios() {
        let root = tempfile::tempdir().unwrap();
        for run in ["roundabout-20261125-131520/run-2", "merge-20261125-131520-2/run-1", "own"] {
            let folder = root.path().join(run);
            std::fs::create_dir_all(&folder).unwrap();
            std::fs::write(folder.join("run.mcap"), "").unwrap();
        }
        std::fs::write(root.path().join("own/summary.json"), "{}").unwrap();
        let later = SystemTime::now() + Duration::from_secs(7300);
        let mut runs = recorded_runs([root.path(), root.path()].into_iter(), later);
        runs.sort_by(|a, b| a.name.cmp(&b.name));
        let told: Vec<_> = runs.iter().map(|run| (run.name.as_str(), run.has_summary)).collect();
        assert_eq!(told, [("merge, run 1", false), ("own", true), ("roundabout, run 2", false)]);
        assert!(runs.iter().all(|run| run.age == "2 hours ago"), "{runs:?}");
    }

    #[test]
    fn ages_are_told_in_the_largest_unit() {
        let told = [5, 61, 3599, 90_000].map(|seconds| age(Duration::from_secs(seconds)));
        assert_eq!(told, ["just now", "1 minute ago", "59 minutes ago", "1 day ago"]);
    }
}
