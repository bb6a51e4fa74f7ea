//! `--force`: protects the results of earlier commands from being overwritten.

use super::Failure;
use clap::Args;
use std::path::{Path, PathBuf};

/// File names of a run.
const RUN_FILES: [&str; 3] = ["run.mcap", "vehicles.csv", "summary.json"];

/// Option to overwrite existing results.
#[derive(Clone, Copy, Debug, Default, Args)]
pub struct OverwriteArgs {
    /// Write over the results of an earlier command in --out
    #[arg(long)]
    pub force: bool,
}

impl OverwriteArgs {
    /// Refuses a folder that has the files of a run.
    ///
    /// # Errors
    /// Bad input that names the folder and the remedy.
    pub fn check_run(self, folder: &Path) -> Result<(), Failure> {
        self.check_files(folder, &RUN_FILES)
    }

    /// Refuses a folder with runs in subfolders of this name prefix.
    ///
    /// # Errors
    /// Bad input that names the first of these folders and the remedy.
    pub fn check_runs(self, folder: &Path, prefix: &str) -> Result<(), Failure> {
        folders(folder, prefix).into_iter().try_for_each(|run| self.check_run(&run))
    }

    /// Refuses a folder that has any of these files.
    ///
    /// # Errors
    /// Bad input that names the folder, the files and the remedy.
    pub fn check_files<N: AsRef<str>>(self, folder: &Path, names: &[N]) -> Result<(), Failure> {
        let there: Vec<&str> =
            names.iter().map(AsRef::as_ref).filter(|name| folder.join(name).exists()).collect();
        if self.force || there.is_empty() {
            return Ok(());
        }
        Err(refusal(folder, &format!("it has {} of an earlier command already", listed(&there))))
    }

    /// Refuses a file that is there. Pipes and devices are written to.
    ///
    /// # Errors
    /// Bad input that names the file and the remedy.
    #[cfg(feature = "render")]
    pub fn check_file(self, path: &Path) -> Result<(), Failure> {
        if self.force || !path.is_file() {
            return Ok(());
        }
        Err(refusal(path, "the file exists already"))
    }
}

fn refusal(path: &Path, why: &str) -> Failure {
    Failure::bad_input(format!("{}: {why}; choose another --out, or --force writes over it", path.display()))
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
fn folders(folder: &Path, prefix: &str) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let named = entries.filter(|entry| entry.file_name().to_string_lossy().starts_with(prefix));
    let mut folders: Vec<PathBuf> = named.map(|entry| entry.path()).filter(|path| path.is_dir()).collect();
    folders.sort();
    folders
}

#[cfg(test)]
mod tests {
    use super::*;

    fn message(result: Result<(), Failure>) -> String {
        let failure = result.unwrap_err();
        assert_eq!(failure.code, crate::app::EXIT_BAD_INPUT);
        failure.message
    }

    #[test]
    fn a_folder_with_a_run_is_refused_unless_it_is_forced() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        let (asked, forced) = (OverwriteArgs::default(), OverwriteArgs { force: true });
        assert!(asked.check_run(&folder.join("new")).is_ok());
        std::fs::write(folder.join("notes.txt"), "mine").unwrap();
        assert!(asked.check_run(folder).is_ok(), "a folder with other files");
        std::fs::create_dir(folder.join("part-2")).unwrap();
        std::fs::write(folder.join("part-2/run.mcap"), "log").unwrap();
        let told = message(asked.check_runs(folder, "part-"));
        let part = folder.join("part-2");
        assert_eq!(
            told,
            format!(
                "{}: it has run.mcap of an earlier command already; choose another --out, or --force writes over it",
                part.display()
            )
        );
        assert_eq!(message(asked.check_run(&part)), told);
        assert!(forced.check_runs(folder, "part-").is_ok() && forced.check_run(&part).is_ok());
        assert!(asked.check_runs(folder, "run-").is_ok());
    }

    #[test]
    fn a_long_list_of_files_is_cut() {
        let folder = tempfile::tempdir().unwrap();
        let names: Vec<String> = (1..=5).map(|k| format!("{k}.svg")).collect();
        names.iter().for_each(|name| std::fs::write(folder.path().join(name), "").unwrap());
        let told = message(OverwriteArgs::default().check_files(folder.path(), &names));
        assert!(told.contains("it has 1.svg, 2.svg, 3.svg and 2 more files of an earlier command"), "{told}");
    }

    #[cfg(feature = "render")]
    #[test]
    fn a_file_is_refused_and_a_device_is_not() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("1.svg"), "").unwrap();
        let told = message(OverwriteArgs::default().check_file(&folder.path().join("1.svg")));
        assert!(told.contains("1.svg: the file exists already; choose another --out"), "{told}");
        assert!(OverwriteArgs::default().check_file(Path::new("/dev/null")).is_ok());
    }
}
