//! Protects the results of earlier commands from being overwritten.

use super::ExistingResults;
use std::path::{Path, PathBuf};

/// File names of a run, in the order in which they are completed.
pub const RUN_FILES: [&str; 3] = ["run.mcap", "vehicles.csv", "summary.json"];

/// What becomes of the results of an earlier command.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Overwrite {
    /// They stay, and the new command fails.
    #[default]
    Refuse,
    /// They are written over.
    Replace,
}

impl Overwrite {
    /// Refuses a folder that has the files of a run.
    ///
    /// # Errors
    /// Names the folder and its files.
    pub fn check_run(self, folder: &Path) -> Result<(), ExistingResults> {
        self.check_files(folder, &RUN_FILES)
    }

    /// Refuses a folder with runs in subfolders of this name prefix.
    ///
    /// # Errors
    /// Names the first of these folders.
    pub fn check_runs(self, folder: &Path, prefix: &str) -> Result<(), ExistingResults> {
        run_folders(folder, prefix).into_iter().try_for_each(|run| self.check_run(&run))
    }

    /// Refuses a folder that has any of these files.
    ///
    /// # Errors
    /// Names the folder and the files.
    pub fn check_files<N: AsRef<str>>(self, folder: &Path, names: &[N]) -> Result<(), ExistingResults> {
        let there: Vec<&str> =
            names.iter().map(AsRef::as_ref).filter(|name| folder.join(name).exists()).collect();
        if self == Self::Replace || there.is_empty() {
            return Ok(());
        }
        let what = format!("it has {} of an earlier command already", listed(&there));
        Err(ExistingResults { path: folder.to_path_buf(), what })
    }

    /// Refuses a file that is there. Pipes and devices are written to.
    ///
    /// # Errors
    /// Names the file.
    pub fn check_file(self, path: &Path) -> Result<(), ExistingResults> {
        if self == Self::Replace || !path.is_file() {
            return Ok(());
        }
        Err(ExistingResults { path: path.to_path_buf(), what: "the file exists already".to_owned() })
    }
}

/// Some names, and how many more there are.
fn listed(names: &[&str]) -> String {
    const SOME: usize = 3;
    let some = names.iter().take(SOME).copied().collect::<Vec<_>>().join(", ");
    match names.len() {
        0..=SOME => some,
        count => format!("{some} and {} more files", count - SOME),
    }
}

/// Subfolders with a name prefix, sorted.
pub fn run_folders(folder: &Path, prefix: &str) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let named = entries.filter(|entry| entry.file_name().to_string_lossy().starts_with(prefix));
    let mut folders: Vec<PathBuf> = named.map(|entry| entry.path()).filter(|path| path.is_dir()).collect();
    folders.sort();
    folders
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_with_a_run_is_refused_unless_it_is_forced() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        assert_eq!(Overwrite::Refuse.check_run(&folder.join("new")), Ok(()));
        std::fs::write(folder.join("notes.txt"), "mine").unwrap();
        assert_eq!(Overwrite::Refuse.check_run(folder), Ok(()), "a folder with other files");
        std::fs::create_dir(folder.join("part-2")).unwrap();
        std::fs::write(folder.join("part-2/run.mcap"), "log").unwrap();
        let part = folder.join("part-2");
        let refused = Overwrite::Refuse.check_runs(folder, "part-").unwrap_err();
        assert_eq!(
            refused.to_string(),
            format!("{}: it has run.mcap of an earlier command already", part.display())
        );
        assert_eq!(Overwrite::Refuse.check_run(&part), Err(refused));
        assert_eq!(Overwrite::Replace.check_runs(folder, "part-"), Ok(()));
        assert_eq!(Overwrite::Replace.check_run(&part), Ok(()));
        assert_eq!(Overwrite::Refuse.check_runs(folder, "run-"), Ok(()));
    }

    #[test]
    fn a_long_list_of_files_is_cut() {
        let folder = tempfile::tempdir().unwrap();
        let names: Vec<String> = (1..=5).map(|k| format!("{k}.svg")).collect();
        names.iter().for_each(|name| std::fs::write(folder.path().join(name), "").unwrap());
        let refused = Overwrite::Refuse.check_files(folder.path(), &names).unwrap_err();
        assert_eq!(refused.what, "it has 1.svg, 2.svg, 3.svg and 2 more files of an earlier command already");
    }

    #[test]
    fn a_file_is_refused_and_a_device_is_not() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("1.svg");
        std::fs::write(&path, "").unwrap();
        assert_eq!(
            Overwrite::Refuse.check_file(&path).unwrap_err().to_string(),
            format!("{}: the file exists already", path.display())
        );
        assert_eq!(Overwrite::Refuse.check_file(Path::new("/dev/null")), Ok(()));
    }
}
