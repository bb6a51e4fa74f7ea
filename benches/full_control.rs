//! Times a large city in full control: vehicles of `[traffic]` on a grid of 15x15 junctions, world, control framework and link in
//! lockstep as in a run. Prints ticks with and without a control step, and how many times real time they are together.
//! Arguments: vehicles (10000), vehicle model (bicycle), seconds to measure (10). `THREADS=N` in the environment sets the threads.
#![allow(clippy::disallowed_types, reason = "measures time")]

mod common;

use city3d_roadmap::Grid;
use city3d_simulation::runner::Run;
use city3d_simulation::scenario::{Experiment, Library, Overrides, read_experiment};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Until queues have formed at the junctions.
const WARM_UP_S: f64 = 10.0;

fn experiment(vehicles: &str, model: &str, measured_s: f64) -> Arc<Experiment> {
    let grid = Grid { size: "15x15".parse().expect("a size"), ..Grid::default() };
    let drawing = grid.to_dxf().expect("a map").into_bytes();
    let text = format!(
        "name = \"grid\"\nmap = \"grid.dxf\"\nduration_s = {}\n[vehicle_type.default]\nmodel = \"{model}\"\n\
         [traffic]\nvehicles = {vehicles}\n",
        WARM_UP_S + measured_s
    );
    let library = Library::kept(drawing, BTreeMap::new());
    let read = read_experiment("grid", &text, &library, Overrides::default())
        .unwrap_or_else(|error| panic!("{error}"));
    Arc::new(Experiment { workers: common::workers(), ..read })
}

fn median(times: &mut [Duration]) -> f64 {
    times.sort_unstable();
    times.get(times.len() / 2).map_or(0.0, Duration::as_secs_f64)
}

fn mean(times: &[Duration]) -> f64 {
    times.iter().sum::<Duration>().as_secs_f64() / times.len().max(1) as f64
}

fn main() {
    // `cargo bench` passes options of its own.
    let mut arguments = std::env::args().skip(1).filter(|argument| !argument.starts_with("--"));
    let vehicles = arguments.next().unwrap_or_else(|| "10000".to_owned());
    let model = arguments.next().unwrap_or_else(|| "bicycle".to_owned());
    let measured_s = arguments.next().map_or(10.0, |seconds| seconds.parse().expect("seconds"));
    let experiment = experiment(&vehicles, &model, measured_s);
    let ticks_per_control = experiment.rates.ticks_per_control();
    let mut run = Run::new(Arc::clone(&experiment)).expect("a scenario that can run");
    let (mut with_control, mut without) = (Vec::new(), Vec::new());
    while run.world().time_s() < experiment.duration_s {
        let is_measured = run.world().time_s() >= WARM_UP_S;
        let times = if run.world().tick().is_multiple_of(ticks_per_control) {
            &mut with_control
        } else {
            &mut without
        };
        let begun = Instant::now();
        run.step();
        if is_measured {
            times.push(begun.elapsed());
        }
    }
    let all = [&with_control[..], &without].concat();
    println!(
        "| vehicles | threads | tick with a control step | tick without | mean | times real time | digest |"
    );
    println!("|---|---|---|---|---|---|---|");
    println!(
        "| {vehicles} {model} | {} | {:.1} ms | {:.1} ms | {:.1} ms | {:.2} | {:016x} |",
        experiment.workers.count(),
        median(&mut with_control) * 1e3,
        median(&mut without) * 1e3,
        mean(&all) * 1e3,
        experiment.rates.dt_s() / mean(&all),
        run.snapshot().state_hash,
    );
}
