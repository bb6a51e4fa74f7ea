//! City and control framework in real time, over good and bad networks.

use crate::compare::{Alone, alone, assert_same, assert_same_merges, merges};
use crate::lab::{Lab, Program, network, scenario, serving};
use city3d_network::simulated::SimulatedOptions;
use city3d_protocol::wire::DropReason;
use city3d_simulation::scenario::Experiment;
use std::sync::Arc;

/// Runs an experiment in real time, to its end.
fn drive(experiment: &Arc<Experiment>, conditions: SimulatedOptions) -> [Program; 2] {
    let lab = Lab::new(conditions);
    let programs = [lab.serve(experiment, serving(), None), lab.mainframe(experiment, None)];
    let [city, far] = programs.clone();
    let ticks = experiment.ticks();
    lab.direct(move |director| {
        director.until(&far, "the end of the experiment", |told| told.snapshot.tick >= ticks);
        director.end(&far);
        director.end(&city);
    });
    programs
}

#[test]
fn in_real_time_a_good_network_changes_no_merge_and_drops_nothing() {
    let experiment = scenario("roundabout", 18.0);
    let [city, far] = drive(&experiment, SimulatedOptions::default());
    let Alone { merges: expected, digests } = alone(&experiment);
    assert!(expected.len() > 10);
    let (served, controlled) = (city.summary(), far.summary());
    assert_same_merges(&merges(&controlled.events), &expected, 0.0);
    assert_same(&city.digests()[..digests.len()], &digests, "city");
    let link = served.link.unwrap();
    assert_eq!((served.collisions, link.dropped.total(), link.missing, link.time_skipped_s), (0, 0, 0, 0.0));
    assert!(link.used == link.received && link.received > 180, "{link:?}");
}

#[test]
fn in_real_time_delay_and_jitter_cause_no_collision() {
    let experiment = scenario("roundabout", 18.0);
    let [city, far] = drive(&experiment, network(30, 20, 0.0));
    let (served, controlled) = (city.summary(), far.summary());
    assert_eq!((served.collisions, controlled.collisions), (0, 0));
    assert_eq!(merges(&controlled.events).len(), alone(&experiment).merges.len());
    assert_eq!(served.link.unwrap().missing, 0);
}

#[test]
fn loss_jitter_and_reordering_cause_no_collision_and_are_counted() {
    let experiment = scenario("roundabout", 11.0);
    let [city, _] = drive(&experiment, network(1, 80, 0.05));
    let served = city.summary();
    assert_eq!(served.collisions, 0);
    let link = served.link.unwrap();
    let missing = link.missing as f64 / (link.missing + link.received) as f64;
    assert!((0.02..0.09).contains(&missing), "{link:?}");
    assert!(link.dropped.of(DropReason::Reordered) > 10, "{link:?}");
    for vehicle in served.vehicles.values() {
        assert!(vehicle.distance_m > 30.0, "{vehicle:?}");
    }
}

#[test]
fn a_noisy_run_repeats_by_its_seed() {
    let experiment = scenario("roundabout", 6.0);
    let run = |seed| {
        let [city, far] = drive(&experiment, SimulatedOptions { seed, ..network(5, 60, 0.1) });
        [city.digests(), far.digests()]
    };
    let [first, again, other] = [1, 1, 2].map(run);
    assert_same(&again[0], &first[0], "city");
    assert_same(&again[1], &first[1], "mainframe");
    assert_ne!(first[0], other[0], "losses are drawn from the seed");
}
