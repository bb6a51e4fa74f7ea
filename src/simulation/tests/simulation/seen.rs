//! What the control framework counts of a city that it sees by poses alone.

use city3d_protocol::snapshot::{EventKind, FrameSnapshot, Status, VehicleId};
use city3d_protocol::wire::{ExperimentPhase, Measurement, ObservedVehicle, Poses};
use city3d_simulation::runner::{ObservedCity, Run};
use city3d_simulation::scenario::{Library, Overrides, read_experiment};
use std::collections::BTreeMap;
use std::sync::Arc;

type Stops = BTreeMap<VehicleId, u32>;

fn count(stops: &mut Stops, snapshot: &FrameSnapshot) {
    for event in snapshot.events.iter().filter(|event| event.kind == EventKind::Stop) {
        *stops.entry(event.vehicle).or_default() += 1;
    }
}

/// Runs a shipped scenario and lets it be seen. Stops and distances of the city, and as they were seen.
fn seen(
    scenario: &str,
    mut status_of: impl FnMut(Status, &mut Measurement) -> Status,
) -> [(Stops, Vec<f64>); 2] {
    let (text, library) = Library::scenario(scenario).unwrap();
    let experiment = Arc::new(read_experiment(scenario, &text, &library, Overrides::default()).unwrap());
    let mut run = Run::new(Arc::clone(&experiment)).unwrap();
    let mut city = ObservedCity::new(Arc::clone(&experiment));
    let (mut true_stops, mut seen_stops) = (Stops::new(), Stops::new());
    let mut snapshot = run.snapshot().clone();
    for tick in 0..=experiment.ticks() {
        let vehicles: Vec<ObservedVehicle> = snapshot
            .vehicles
            .iter()
            .map(|state| {
                let mut pose = Measurement::of(state, snapshot.time_s, experiment.scale);
                let status = status_of(state.status, &mut pose);
                ObservedVehicle { pose, status }
            })
            .collect();
        let (time_s, state_hash) = (snapshot.time_s, snapshot.state_hash);
        let (phase, vehicles_told) = (ExperimentPhase::Running, Vec::new());
        let head = Poses { tick, time_s, state_hash, phase, part: 0, parts: 1, vehicles: vehicles_told };
        count(&mut seen_stops, city.add_poses(&head, &vehicles));
        if tick < experiment.ticks() {
            snapshot = run.step().clone();
            count(&mut true_stops, &snapshot);
        }
    }
    let distances =
        |snapshot: &FrameSnapshot| snapshot.vehicles.iter().map(|state| state.distance_m).collect();
    [(true_stops, distances(&snapshot)), (seen_stops, distances(city.snapshot()))]
}

fn are_alike([(true_stops, true_m), (seen_stops, seen_m)]: [(Stops, Vec<f64>); 2], within: f64) {
    assert_eq!(true_stops, seen_stops);
    assert!(!true_stops.is_empty() && true_m.len() == seen_m.len());
    for (a, b) in true_m.iter().zip(&seen_m) {
        assert!((b / a - 1.0).abs() < within, "{b} m, and {a} m in truth");
    }
}

#[test]
fn a_city_is_seen_as_it_is() {
    are_alike(seen("roundabout", |status, _| status), 0.002);
}

/// The status tells whether a physical vehicle stands, but for one that yields: its poses, which are estimates, are
/// estimated a second time then. One that creeps at the speed of a stand may stand in one of the two and not in the other.
#[test]
fn physical_vehicles_have_the_stops_that_the_city_counts() {
    let [(true_stops, true_m), (seen_stops, seen_m)] = seen("mixed", |status, _| status);
    let total = |stops: &Stops| stops.values().sum::<u32>();
    assert!(total(&true_stops) > 4 && total(&true_stops).abs_diff(total(&seen_stops)) <= 1);
    for (vehicle, count) in &true_stops {
        let seen = seen_stops.get(vehicle).copied().unwrap_or(0);
        assert!(count.abs_diff(seen) <= 1, "vehicle {vehicle}: {seen} stops, and {count} in the city");
    }
    for (a, b) in true_m.iter().zip(&seen_m) {
        assert!((b / a - 1.0).abs() < 0.03, "{b} m, and {a} m in truth");
    }
}

/// As over ROS: the noise of motion capture, and nobody tells which vehicles are physical.
#[test]
fn noise_makes_no_stops() {
    let mut draws = 0_u64;
    let mut normal = || {
        let mut uniform = || {
            draws = draws.wrapping_add(0x9E37_79B9_7F4A_7C15);
            let mut z = draws;
            z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
            z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
            ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
        };
        (0..12).map(|_| uniform()).sum::<f64>() - 6.0
    };
    let noisy = |_, pose: &mut Measurement| {
        pose.position.x += 0.001 * normal();
        pose.position.y += 0.001 * normal();
        Status::Driving
    };
    are_alike(seen("roundabout", noisy), 0.02);
}

#[test]
fn the_seed_makes_another_run_of_physical_vehicles_and_none_of_simulated_ones_alone() {
    let hash = |scenario: &str, seed: u64| {
        let (text, library) = Library::scenario(scenario).unwrap();
        let overrides = Overrides { seed: Some(seed), ..Overrides::default() };
        let experiment = read_experiment(scenario, &text, &library, overrides).unwrap();
        let depends = experiment.depends_on_seed();
        let mut run = Run::new(Arc::new(experiment)).unwrap();
        ((0..200).fold(0, |_, _| run.step().state_hash), depends)
    };
    for (scenario, depends) in [("mixed", true), ("straight", false)] {
        let [a, b] = [3, 4].map(|seed| hash(scenario, seed));
        assert_eq!((a.0 != b.0, a.1), (depends, depends), "{scenario}");
    }
}
