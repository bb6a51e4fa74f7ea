//! A driver of your own in a scenario: the full velocity difference model (Jiang, Wu and Zhu 2001, Physical Review E 64,
//! eq. 3), below Gipps' safe speed.
//!
//! `cargo run --release -p city3d-simulation --example own_driver`

use city3d_control::{Controller, DriverParams, Drivers, LeaderState, OwnMotion};
use city3d_simulation::runner::RunMetrics;
use city3d_simulation::scenario::{Library, Overrides, read_experiment};
use std::sync::Arc;

/// Relaxes to the speed that the gap permits, and to that of the leader. Laboratory metres.
#[derive(Debug)]
struct FullVelocityDifference(DriverParams);

impl Controller for FullVelocityDifference {
    fn acceleration(&self, own: OwnMotion, desired_mps: f64, ahead: Option<LeaderState>) -> f64 {
        const SENSITIVITY: f64 = 0.8;
        const SPEED_DIFFERENCE_SENSITIVITY: f64 = 0.6;
        let params = &self.0;
        let mut optimal_mps = desired_mps;
        let (mut difference, mut safe_mps2) = (0.0, params.max_acceleration_mps2);
        if let Some(ahead) = ahead {
            let spare_m = (ahead.gap_m - params.standstill_gap_m).max(0.0);
            optimal_mps = desired_mps.min(spare_m / params.headway_s);
            difference = (ahead.speed_mps - own.measured_mps) / (1.0 + spare_m);
            safe_mps2 = params.safe_acceleration(own.measured_mps, ahead, own.margin_m);
        }
        let wanted_mps2 =
            SENSITIVITY * (optimal_mps - own.planned_mps) + SPEED_DIFFERENCE_SENSITIVITY * difference;
        wanted_mps2.min(safe_mps2).clamp(params.min_acceleration_mps2, params.max_acceleration_mps2)
    }
}

/// The line `controller` is all that changes from one algorithm to another.
const SCENARIO: &str = r#"
name = "own_driver"
duration_s = 60
[driver.default]
controller = "fvdm"
[traffic]
vehicles = 20
"#;

/// Registers the driver, and runs the scenario that names it.
pub fn run() -> Result<RunMetrics, Box<dyn std::error::Error>> {
    let drivers = Drivers::standard().with("fvdm", |params| Box::new(FullVelocityDifference(params)));
    let library = Library::default().with_drivers(drivers);
    let experiment = read_experiment("own_driver", SCENARIO, &library, Overrides::default())?;
    Ok(RunMetrics::of(Arc::new(experiment))?)
}

#[allow(dead_code, reason = "a test runs this file as a module")]
fn main() -> Result<(), Box<dyn std::error::Error>> {
    let metrics = run()?;
    println!("collisions {}, mean speed {:.3} m/s", metrics.collisions, metrics.mean_speed_mps);
    Ok(())
}
