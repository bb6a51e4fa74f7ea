//! A run on its own thread, to be waited for.

use city3d_session::live::{LiveRun, RunState};
use city3d_simulation::scenario::{Experiment, Library, Overrides, read_experiment};
use std::sync::Arc;
use std::time::{Duration, Instant};

pub fn roundabout(duration_s: f64) -> Arc<Experiment> {
    let (text, library) = Library::scenario("roundabout").unwrap();
    let overrides = Overrides { duration_s: Some(duration_s), ..Overrides::default() };
    Arc::new(read_experiment("roundabout", &text, &library, overrides).unwrap())
}

/// Waits until a published state satisfies a condition.
pub fn until(live: &LiveRun, what: &str, is_so: impl Fn(&RunState) -> bool) -> Arc<RunState> {
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
