//! Vehicles at the ends of their ways: at the first poses, and at the end of a route.

use super::Run;
use crate::scenario::{Library, Overrides, read_experiment};
use city3d_protocol::snapshot::Status;
use std::sync::Arc;

fn runner(name: &str, text: &str, seed: Option<u64>) -> Run {
    let (_, library) = Library::scenario("straight").unwrap();
    let overrides = Overrides { seed, ..Overrides::default() };
    Run::new(Arc::new(read_experiment(name, text, &library, overrides).unwrap())).unwrap()
}

/// Round a park and past the place where it began, with a driver who heeds nobody.
#[test]
fn who_heeds_nobody_stops_at_the_end_of_its_route_too() {
    let text = r#"
name = "round"
map = "ids3c"
seed = 1
duration_s = 60.0
[driver.default]
controller = "cruise"
[[vehicle]]
name = "car"
route = ["main-boulevard/east/inner/1", "main-boulevard/east/outer/3"]
at_m = 1.29
"#;
    let mut runner = runner("round", text, None);
    while runner.snapshot().time_s < 60.0 {
        runner.step();
    }
    let car = &runner.snapshot().vehicles[0];
    assert_eq!(car.status, Status::Finished);
    // An IDM driver ends after 209 m.
    assert!((car.distance_m - 209.0).abs() < 2.0, "{} m", car.distance_m);
}

/// Motion capture has a millimetre of noise, ten times what the estimator assumes before it has seen any, and is
/// heard late.
#[test]
fn a_physical_vehicle_at_rest_is_seen_at_rest_from_its_first_pose() {
    let (text, _) = Library::scenario("mixed").unwrap();
    for seed in 1..=5 {
        let mut runner = runner("mixed", &text, Some(seed));
        let begins: Vec<_> = runner.snapshot().vehicles.iter().map(|car| car.position).collect();
        while runner.snapshot().time_s < 0.3 {
            let snapshot = runner.step();
            for (car, begin) in snapshot.vehicles.iter().zip(&begins) {
                let off_m = car.position.distance(*begin);
                // From rest, with at most 3 m/s2.
                assert!(
                    car.speed_mps.abs() < 1.5 && off_m < 0.4,
                    "seed {seed}: {} at {} s: {} m/s, {off_m} m from its place",
                    car.id,
                    snapshot.time_s,
                    car.speed_mps
                );
            }
        }
    }
}
