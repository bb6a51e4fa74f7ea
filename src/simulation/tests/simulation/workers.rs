//! A large city comes out the same on any number of threads.

use city3d_roadmap::Grid;
use city3d_simulation::runner::Run;
use city3d_simulation::scenario::{Experiment, Library, Overrides, read_experiment};
use city3d_workers::Workers;
use std::collections::BTreeMap;
use std::num::NonZeroUsize;
use std::sync::Arc;

/// Enough vehicles for several threads.
const VEHICLES: usize = 400;

/// A city of grid streets that is full from the beginning, under noise and lag.
fn city(more: &str) -> Experiment {
    let grid = Grid { size: "6x10".parse().unwrap(), ..Grid::default() };
    let library = Library::kept(grid.to_dxf().unwrap().into_bytes(), BTreeMap::new());
    let text = format!(
        "name = \"grid\"\nmap = \"grid.dxf\"\nseed = 3\nduration_s = 60.0\n{more}\n[environment]\nprofile = \"testbed\"\n\
         [driver.default]\ncontroller = \"ploeg\"\n\
         [traffic]\nvehicles = {VEHICLES}\nspread = 0.08\nstart_speed_mps = 0.2\n"
    );
    read_experiment("grid", &text, &library, Overrides::default()).unwrap_or_else(|error| panic!("{error}"))
}

/// Digest and events of every step.
fn history(experiment: &Experiment, threads: usize) -> Vec<(u64, String)> {
    let workers = Workers::new(NonZeroUsize::new(threads).unwrap());
    let mut run = Run::new(Arc::new(Experiment { workers, ..experiment.clone() })).unwrap();
    assert!(run.snapshot().vehicles.len() >= VEHICLES);
    let mut step = || {
        let snapshot = run.step();
        (snapshot.state_hash, format!("{:?}", snapshot.events))
    };
    (0..150).map(|_| step()).collect()
}

#[test]
fn any_number_of_threads_makes_the_same_run() {
    let coordinated = "[coordination]\nalgorithm = \"insert\"";
    for experiment in [city(""), city(coordinated), city("[platoon]")] {
        let alone = history(&experiment, 1);
        for threads in [2, 3, 7] {
            let together = history(&experiment, threads);
            let differs = alone.iter().zip(&together).position(|(alone, together)| alone != together);
            assert_eq!(differs, None, "{threads} threads: the first step that differs");
        }
    }
}
