//! A coordination algorithm of your own: whoever can be at the conflict soonest goes first, in gaps of the schedule, and the
//! paper's roundabout under it.
//!
//! `cargo run --release -p city3d-simulation --example own_coordinator`

use city3d_control::coordination::{Coordinator, Coordinators, Grant, ZoneView};
use city3d_simulation::runner::RunMetrics;
use city3d_simulation::scenario::{Library, Overrides, read_experiment};
use std::sync::Arc;

/// The framework finds a plan for each grant, with its gaps to those who have theirs; a vehicle without one drives by the
/// rules of the road and asks again.
#[derive(Debug)]
struct SoonestFirst;

impl Coordinator for SoonestFirst {
    fn schedule(&mut self, view: &mut ZoneView<'_>) {
        let mut requests = view.requests().to_vec();
        requests.sort_by(|a, b| a.earliest_s.total_cmp(&b.earliest_s).then(a.vehicle.cmp(&b.vehicle)));
        for request in requests {
            let grant = Grant { not_before_s: request.earliest_s, fills_gaps: true };
            if let Err(infeasible) = view.grant(request.vehicle, grant) {
                println!("{:.1} s: vehicle {} has no plan: {infeasible:?}", view.now_s(), request.vehicle);
            }
        }
    }
}

/// Registers the algorithm, and runs the shipped scenario with one line changed.
pub fn run() -> Result<RunMetrics, Box<dyn std::error::Error>> {
    let (text, library) = Library::scenario("roundabout-coordinated")?;
    let text = text.replace("algorithm = \"insert\"", "algorithm = \"soonest\"");
    let coordinators = Coordinators::standard().with("soonest", || Box::new(SoonestFirst));
    let library = library.with_coordinators(coordinators);
    let experiment = read_experiment("own_coordinator", &text, &library, Overrides::default())?;
    Ok(RunMetrics::of(Arc::new(experiment))?)
}

#[allow(dead_code, reason = "a test runs this file as a module")]
fn main() -> Result<(), Box<dyn std::error::Error>> {
    let metrics = run()?;
    let passages = metrics.traffic.passages;
    println!(
        "{} passages, mean delay {:.2?} s, {} stops",
        passages.count, passages.mean_delay_s, passages.stops
    );
    Ok(())
}
