//! Fifty cars all over the city for five minutes.

use city3d_simulation::runner::{Observer, Run, Summary};
use city3d_simulation::scenario::{Library, Overrides, read_experiment};
use std::sync::Arc;

fn five_minutes(seed: Option<u64>) -> Summary {
    traffic(Overrides { seed, ..Overrides::default() })
}

fn traffic(overrides: Overrides) -> Summary {
    let (text, library) = Library::scenario("city").unwrap();
    let experiment = Arc::new(read_experiment("city.toml", &text, &library, overrides).unwrap());
    assert_eq!(experiment.vehicles.len(), 50);
    let limits: Vec<f64> =
        experiment.vehicles.iter().map(|v| v.spec.steering_limit_rad.to_degrees()).collect();
    assert!(limits.iter().any(|deg| *deg < 21.0) && limits.iter().any(|deg| *deg > 44.0), "{limits:?}");
    let mut run = Run::new(Arc::clone(&experiment)).unwrap();
    let mut observer = Observer::new(&experiment);
    let mut events = Vec::new();
    for _ in 0..experiment.ticks() {
        run.step();
        events.extend_from_slice(&run.snapshot().events);
        observer.observe(Some(run.mainframe()), run.snapshot(), &mut events);
    }
    Summary::new(&experiment, &observer, run.snapshot(), events, 1.0)
}

fn assert_traffic_flows(summary: &Summary) {
    assert_eq!(summary.collisions, 0, "seed {}", summary.seed);
    assert!(summary.mean_speed_mps >= 4.0, "seed {}: {}", summary.seed, summary.mean_speed_mps);
    assert!(summary.unused_lanes.is_empty(), "seed {}: {:?}", summary.seed, summary.unused_lanes);
    for (id, vehicle) in &summary.vehicles {
        assert!(vehicle.longest_stand_s <= 60.0, "seed {}: vehicle {id}: {vehicle:?}", summary.seed);
        assert!(vehicle.max_lane_excess_m <= 0.0, "seed {}: vehicle {id}: {vehicle:?}", summary.seed);
        let keeps_to_its_path = vehicle.max_lateral_error_m.is_some_and(|error_m| error_m < 0.30);
        assert!(keeps_to_its_path, "seed {}: vehicle {id}: {vehicle:?}", summary.seed);
    }
}

#[test]
fn traffic_flows_all_over_the_city() {
    let summary = five_minutes(None);
    assert!((summary.simulated_s - 300.0).abs() < 1e-6);
    assert_traffic_flows(&summary);
}

/// Once a car that turned off behind its line met another after five minutes, and tails that reached a millimetre into a
/// junction held up each other for ever.
#[test]
fn ten_minutes_come_to_no_end() {
    for seed in [None, Some(1)] {
        let summary = traffic(Overrides { seed, duration_s: Some(600.0), ..Overrides::default() });
        assert!((summary.simulated_s - 600.0).abs() < 1e-6);
        assert_traffic_flows(&summary);
    }
}

#[test]
fn another_seed_flows_elsewhere() {
    let (one, other) = (five_minutes(Some(1)), five_minutes(Some(2)));
    assert_traffic_flows(&one);
    assert_traffic_flows(&other);
    assert_ne!(one.state_hash, other.state_hash);
}
