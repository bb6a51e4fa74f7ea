//! Names of new files and folders.

use std::path::{Path, PathBuf};

/// The first of `NAME`, `NAME-2`, `NAME-3` ... in a folder that is not there yet, each with this ending.
pub fn unused(folder: &Path, name: &str, ending: &str) -> PathBuf {
    let first = std::iter::once(folder.join(format!("{name}{ending}")));
    let mut paths = first.chain((2_u64..).map(|k| folder.join(format!("{name}-{k}{ending}"))));
    paths.find(|path| !path.exists()).unwrap_or_else(|| folder.join(format!("{name}{ending}")))
}

/// Name of a file that shows a moment of a run: its scenario and the simulated time, such as `roundabout-12.34s`.
pub fn name_of_moment(scenario: &str, time_s: f64) -> String {
    let is_plain = |c: char| c.is_alphanumeric() || c == '-' || c == '_';
    let scenario: String = scenario.chars().map(|c| if is_plain(c) { c } else { '-' }).collect();
    format!("{scenario}-{time_s:.2}s")
}

/// A file that was written, for a notice: its name first, for long paths are cut.
pub fn written(file: &Path) -> String {
    let whole = std::path::absolute(file).unwrap_or_else(|_| file.to_path_buf());
    match (whole.file_name(), whole.parent()) {
        (Some(name), Some(folder)) => format!("{} in {}", name.display(), folder.display()),
        _ => whole.display().to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_moment_is_named_by_scenario_and_time_without_folders() {
        assert_eq!(name_of_moment("roundabout", 12.3), "roundabout-12.30s");
        assert_eq!(name_of_moment("my run/2", 0.0), "my-run-2-0.00s");
    }

    #[test]
    fn a_file_is_told_by_its_name_and_then_its_folder() {
        assert_eq!(written(Path::new("/runs/run-1/a-1.00s.png")), "a-1.00s.png in /runs/run-1");
    }

    #[test]
    fn names_are_numbered_on() {
        let folder = tempfile::tempdir().unwrap();
        for expected in ["mine.toml", "mine-2.toml", "mine-3.toml"] {
            let path = unused(folder.path(), "mine", ".toml");
            assert_eq!(path, folder.path().join(expected));
            std::fs::write(path, "").unwrap();
        }
    }
}
