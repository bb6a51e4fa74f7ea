//! A run on its own thread, to be waited for.

use city3d_logbook::record::LogOrigin;
use city3d_session::{
    FileOptions, Host, LocalCity, RunFiles, RunFolders, RunState, Session, SessionHandle, WallTime,
};
use city3d_simulation::scenario::{Experiment, Library, Overrides, read_experiment};
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

pub fn roundabout(duration_s: f64) -> Arc<Experiment> {
    let (text, library) = Library::scenario("roundabout").unwrap();
    let overrides = Overrides { duration_s: Some(duration_s), ..Overrides::default() };
    Arc::new(read_experiment("roundabout", &text, &library, overrides).unwrap())
}

/// A city on its own thread, as the window has it, with its files in `run-1`, `run-2` of a folder.
pub fn live(experiment: Arc<Experiment>, folder: Option<&Path>) -> SessionHandle {
    let folders = match folder {
        Some(root) => RunFolders::Numbered { root: root.into(), before: 0 },
        None => RunFolders::None,
    };
    let files = RunFiles::new(folders, LogOrigin::Run, FileOptions::default());
    let files = files.without_waiting().counting(WallTime::Steps);
    let (host, written) = (Host::system(), files.written());
    let city = LocalCity::new(experiment, host.clone()).unwrap();
    Session::new(city, host).with_end(Box::new(files)).spawn(Some(written)).unwrap()
}

/// Waits until a published state satisfies a condition.
pub fn until(live: &SessionHandle, what: &str, is_so: impl Fn(&RunState) -> bool) -> Arc<RunState> {
    let start = Instant::now();
    loop {
        let run_state = live.run_state();
        if is_so(&run_state) {
            return run_state;
        }
        assert!(start.elapsed() < Duration::from_secs(60), "never came: {what}; now {run_state:?}");
        std::thread::sleep(Duration::from_millis(1));
    }
}
