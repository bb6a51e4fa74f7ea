//! Compares what programs have come to: digests, merges, logs and summaries.

use crate::lab::Told;
use city3d_logbook::replay::Replay;
use city3d_protocol::snapshot::{Event, EventKind, VehicleId};
use city3d_session::MomentKind;
use city3d_simulation::runner::{Observer, Run};
use city3d_simulation::scenario::Experiment;
use std::path::Path;
use std::sync::Arc;

/// Tick and digest of moments in which the clock runs.
pub fn digests(told: &[Told]) -> Vec<(u64, u64)> {
    let ticks = told.iter().filter(|told| matches!(told.kind, MomentKind::First | MomentKind::Tick));
    ticks.map(|told| (told.snapshot.tick, told.snapshot.state_hash)).collect()
}

/// A run of one process: digests, and who merged when.
pub struct Alone {
    pub digests: Vec<(u64, u64)>,
    pub merges: Vec<(VehicleId, f64)>,
}

/// The experiment in one process, to its end.
pub fn alone(experiment: &Arc<Experiment>) -> Alone {
    let mut run = Run::new(Arc::clone(experiment)).unwrap();
    let (mut observer, mut events) = (Observer::new(experiment), Vec::new());
    let mut digests = vec![(0, run.snapshot().state_hash)];
    while run.snapshot().tick < experiment.ticks() {
        run.step();
        digests.push((run.snapshot().tick, run.snapshot().state_hash));
        observer.observe(Some(run.mainframe()), run.snapshot(), &mut events);
    }
    Alone { digests, merges: merges(&events) }
}

/// Who merged when.
pub fn merges(events: &[Event]) -> Vec<(VehicleId, f64)> {
    let merges = events.iter().filter(|event| event.kind == EventKind::Merge);
    merges.map(|event| (event.vehicle, event.time_s)).collect()
}

/// Asserts that two lists of digests are the same, and names the first tick that differs.
pub fn assert_same(found: &[(u64, u64)], expected: &[(u64, u64)], who: &str) {
    let first = found.iter().zip(expected).find(|(a, b)| a != b);
    assert_eq!((first, found.len()), (None, expected.len()), "{who}");
}

/// `summary.json` of a folder.
pub fn summary_in(folder: &Path) -> serde_json::Value {
    serde_json::from_slice(&std::fs::read(folder.join("summary.json")).unwrap()).unwrap()
}

/// The same vehicles merge in the same order as in one process, at nearly the same times.
pub fn assert_same_merges(found: &[(VehicleId, f64)], expected: &[(VehicleId, f64)], apart_s: f64) {
    let who = |merges: &[(VehicleId, f64)]| merges.iter().map(|(vehicle, _)| *vehicle).collect::<Vec<_>>();
    assert_eq!(who(found), who(expected), "{found:?} instead of {expected:?}");
    for ((vehicle, time_s), (_, expected_s)) in found.iter().zip(expected) {
        assert!((time_s - expected_s).abs() <= apart_s, "{vehicle}: {time_s} s instead of {expected_s} s");
    }
}

/// The digests of a log, simulated again from what came over the link.
pub fn replayed(log: &Path) -> Vec<(u64, u64)> {
    let mut replay = Replay::open(log).unwrap();
    let mut digests = Vec::new();
    while let Some(tick) = replay.step().unwrap() {
        assert!(tick.agrees(), "tick {}", tick.tick);
        digests.push((tick.tick, tick.simulated));
    }
    digests
}
