//! The roundabout of the paper, coordinated.

use crate::support::{Outcome, run, shipped};
use city3d_simulation::environment::EnvironmentProfile;
use city3d_simulation::scenario::Overrides;

fn drive(text: &str, overrides: Overrides) -> Outcome {
    run(text, overrides, |run, id| {
        let cav = run.mainframe().cavs().iter().find(|cav| cav.id == id).unwrap();
        cav.route.sections.last().is_none_or(|section| cav.rear_s() > section.to_s)
    })
}

/// Vehicles of path 1, which yields in the uncoordinated run.
const PATH_1: [u32; 3] = [1, 2, 3];

#[test]
fn nobody_stops_and_all_are_through_sooner_with_a_third_of_the_squared_acceleration() {
    let before = drive(&shipped("roundabout"), Overrides::default());
    let after = drive(&shipped("roundabout-coordinated"), Overrides::default());
    assert_eq!(after.collisions, 0);
    let all_through_s = |outcome: &Outcome| {
        outcome.vehicles.values().map(|vehicle| vehicle.left_zone_s.unwrap()).fold(0.0, f64::max)
    };
    assert!(all_through_s(&after) <= all_through_s(&before), "{after:?}");
    for id in PATH_1 {
        let vehicle = &after.vehicles[&id];
        assert!(vehicle.left_zone_s <= before.vehicles[&id].left_zone_s, "{id}");
        assert!(vehicle.slowest_mps > 0.05, "{id} slows to {}", vehicle.slowest_mps);
        assert!(vehicle.stops.iter().all(|stop_s| *stop_s > vehicle.left_zone_s.unwrap()), "{id}");
    }
    let squared =
        |outcome: &Outcome| -> f64 { outcome.vehicles.values().map(|vehicle| vehicle.until_through).sum() };
    assert!(3.0 * squared(&after) < squared(&before), "{} {}", squared(&after), squared(&before));
}

#[test]
fn in_the_testbed_nobody_collides_or_stops() {
    let text = shipped("roundabout-coordinated");
    let mut stops = 0;
    for seed in 1..=50 {
        let testbed = EnvironmentProfile::Testbed;
        let overrides = Overrides { seed: Some(seed), environment: Some(testbed), ..Overrides::default() };
        let outcome = drive(&text, overrides);
        assert_eq!(outcome.collisions, 0, "seed {seed}");
        let is_early =
            |stop_s: &&f64, through_s: Option<f64>| through_s.is_none_or(|time_s| **stop_s < time_s);
        stops += outcome
            .vehicles
            .values()
            .map(|vehicle| vehicle.stops.iter().filter(|stop| is_early(stop, vehicle.left_zone_s)).count())
            .sum::<usize>();
        assert!(outcome.vehicles.values().all(|vehicle| vehicle.left_zone_s.is_some()), "seed {seed}");
    }
    assert_eq!(stops, 0);
}
