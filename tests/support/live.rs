//! A run on its own thread, to be waited for.

#![allow(dead_code, reason = "each test uses its own part")]

use city3d::live::{Live, Moment};
use city3d::scenario::{Experiment, Library, Overrides, read_experiment};
use std::sync::Arc;
use std::time::{Duration, Instant};

pub fn roundabout(duration_s: f64) -> Arc<Experiment> {
    let (text, library) = Library::scenario("roundabout").unwrap();
    let overrides = Overrides { duration_s: Some(duration_s), ..Overrides::default() };
    Arc::new(read_experiment("roundabout", &text, &library, overrides).unwrap())
}

/// Waits until a moment is as it should be.
pub fn until(live: &Live, what: &str, is_so: impl Fn(&Moment) -> bool) -> Arc<Moment> {
    let start = Instant::now();
    loop {
        let moment = live.moment();
        if is_so(&moment) {
            return moment;
        }
        assert!(start.elapsed() < Duration::from_secs(60), "never came: {what}; now {moment:?}");
        std::thread::sleep(Duration::from_millis(1));
    }
}
