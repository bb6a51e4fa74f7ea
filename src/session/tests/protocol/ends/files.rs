//! Files on a disk that is slow, full, or away.

use super::{EndHealth, EndSummary, Stage, passes};
use crate::lab::scenario;
use city3d_logbook::record::LogOrigin;
use city3d_logbook::replay::Replay;
use city3d_session::{
    FileOptions, Host, LocalCity, Order, Overwrite, RunFiles, RunFolders, Session, SessionEnd,
};
use std::error::Error;
use std::path::Path;

/// More vehicles, so that what waits for a disk is soon too much.
const CROWD: u32 = 400;

/// Files in the folders `run-1` and `run-2`.
fn files(root: &Path) -> Box<RunFiles> {
    let options = FileOptions { log_hz: 100, csv_hz: 100, overwrite: Overwrite::Replace };
    let folders = RunFolders::Numbered { root: root.to_path_buf(), before: 0 };
    Box::new(RunFiles::new(folders, LogOrigin::Run, options).without_waiting())
}

fn works(health: &EndHealth) -> bool {
    health.failure.is_none()
}

/// The files of the first run fail, and those of the next one do not.
fn fails_once(root: &Path, crowd: u32, words: &[&str]) -> Vec<EndSummary> {
    let stages = vec![
        Stage::new("they fail", |health| !works(health)).order(Order::Reset),
        Stage::new("the next run", |_| true).order(Order::Start),
        Stage::new("they work again", works),
    ];
    let (health, accounts) = passes(files(root), crowd, stages);
    assert!(health.failure.is_none() && accounts.len() == 2, "{health:?} {accounts:?}");
    let [first, second] = &accounts[..] else { panic!("{accounts:?}") };
    let why = first.failure.as_ref().unwrap();
    assert!(words.iter().all(|word| why.contains(word)), "{why}");
    assert!(first.dropped > 0);
    assert_eq!((first.failures, second.failures), (1, 1), "said once");
    assert_eq!((second.failure.as_ref(), second.dropped), (None, first.dropped));
    assert!(second.delivered > first.delivered + 60);
    if crowd == 0 {
        let mut replay = Replay::open(&root.join("run-2/run.mcap")).unwrap();
        while let Some(tick) = replay.step().unwrap() {
            assert!(tick.agrees(), "{tick:?}");
        }
        assert!(replay.snapshot().tick > 60);
    }
    accounts
}

#[test]
fn files_that_work_delay_nothing() {
    let root = tempfile::tempdir().unwrap();
    let (health, accounts) = passes(files(root.path()), 0, vec![Stage::new("they work", works)]);
    assert!(health.failure.is_none() && health.dropped == 0, "{health:?}");
    assert!(health.delivered > 60 && accounts.is_empty(), "the summary is silent about files that are whole");
}

#[test]
#[cfg(unix)]
fn a_full_disk_ends_the_files_of_a_run_and_not_the_city() {
    let root = tempfile::tempdir().unwrap();
    std::fs::create_dir(root.path().join("run-1")).unwrap();
    std::os::unix::fs::symlink("/dev/full", root.path().join("run-1/run.mcap")).unwrap();
    fails_once(root.path(), 0, &["run.mcap", "No space left"]);
    // There was room for it.
    assert!(root.path().join("run-1/summary.json").is_file());
}

#[test]
fn a_folder_that_cannot_be_created_ends_the_files_of_a_run_and_not_the_city() {
    let root = tempfile::tempdir().unwrap();
    std::fs::write(root.path().join("run-1"), "a file").unwrap();
    fails_once(root.path(), 0, &["run-1", "cannot be created"]);
    assert_eq!(std::fs::read_to_string(root.path().join("run-1")).unwrap(), "a file");
}

/// Makes a file of the first run a pipe.
#[cfg(unix)]
fn pipe(root: &Path, name: &str) -> std::path::PathBuf {
    std::fs::create_dir(root.join("run-1")).unwrap();
    let path = root.join("run-1").join(name);
    let made = std::process::Command::new("mkfifo").arg(&path).status();
    assert!(made.unwrap().success());
    path
}

#[test]
#[cfg(unix)]
fn a_disk_that_takes_nothing_any_more_ends_the_files_of_a_run_and_not_the_city() {
    let root = tempfile::tempdir().unwrap();
    // Pipes cannot be sought in, as logs are. It is opened, and nobody reads it.
    let path = pipe(root.path(), "vehicles.csv");
    let reader = std::thread::spawn(move || std::fs::File::open(path).unwrap());
    fails_once(root.path(), CROWD, &["run-1", "too slow"]);
    drop(reader.join().unwrap());
}

#[test]
#[cfg(unix)]
fn a_disk_that_does_not_open_a_file_ends_the_files_of_a_run_and_not_the_city() {
    let root = tempfile::tempdir().unwrap();
    let path = pipe(root.path(), "run.mcap");
    fails_once(root.path(), CROWD, &["run-1", "too slow"]);
    // The writer waits for a reader until now.
    drop(std::fs::File::open(path).unwrap());
}

#[test]
#[cfg(unix)]
fn what_the_system_says_is_behind_the_failure_of_files() {
    let root = tempfile::tempdir().unwrap();
    std::os::unix::fs::symlink("/dev/full", root.path().join("run.mcap")).unwrap();
    let options = FileOptions { overwrite: Overwrite::Replace, ..FileOptions::default() };
    let folders = RunFolders::Parts(root.path().to_path_buf());
    let host = Host::system();
    let city = LocalCity::new(scenario("roundabout", 2.0), host.clone()).unwrap().started();
    let files = Box::new(RunFiles::new(folders, LogOrigin::Run, options));
    let session = Session::new(city, host).until(SessionEnd::AtTick(200)).with_end(files).strictly();
    let error = session.run().map(drop).unwrap_err();
    let mut chain = std::iter::successors(Some(&error as &dyn Error), |error| (*error).source());
    let kind = chain.find_map(|error| error.downcast_ref::<std::io::Error>()).map(std::io::Error::kind);
    assert_eq!(kind, Some(std::io::ErrorKind::StorageFull), "{error:?}");
}
