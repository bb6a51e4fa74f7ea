//! City and control framework in lockstep: two programs do what one does.

use crate::compare::{alone, assert_same, merges, summary_in};
use crate::lab::{Lab, network, scenario, serving, with};
use city3d_network::simulated::SimulatedOptions;
use city3d_session::SessionEnd;
use city3d_session::served::ServeOptions;
use city3d_simulation::environment::EnvironmentProfile;
use city3d_simulation::scenario::{Experiment, Overrides};
use std::sync::Arc;

fn in_lockstep() -> ServeOptions {
    ServeOptions { is_lockstep: true, ..serving() }
}

fn assert_two_do_what_one_does(experiment: &Arc<Experiment>, conditions: SimulatedOptions) {
    let lab = Lab::new(conditions);
    let end = SessionEnd::AtTick(experiment.ticks());
    let city = lab.serve_until(end, experiment, in_lockstep(), None);
    let far = lab.mainframe(experiment, None);
    lab.run();
    let expected = alone(experiment);
    assert_eq!(expected.digests.len() as u64, experiment.ticks() + 1);
    assert_same(&city.digests(), &expected.digests, "city");
    assert_same(&far.digests(), &expected.digests, "mainframe");
    let (served, controlled) = (city.summary(), far.summary());
    assert_eq!((served.collisions, &served.state_hash), (0, &controlled.state_hash));
    assert_eq!(merges(&controlled.events), expected.merges);
    let is_lossy = conditions.loss > 0.0;
    assert_eq!(served.link.unwrap().missing > 0, is_lossy);
}

#[test]
fn in_lockstep_two_programs_do_what_one_does_tick_by_tick() {
    assert_two_do_what_one_does(&scenario("roundabout", 40.0), SimulatedOptions::default());
    assert_two_do_what_one_does(&scenario("city", 3.0), SimulatedOptions::default());
}

#[test]
fn in_lockstep_loss_and_reordering_on_the_network_change_nothing() {
    assert_two_do_what_one_does(&scenario("roundabout", 40.0), network(2, 20, 0.05));
}

#[test]
fn in_lockstep_delays_and_loss_of_the_scenario_are_the_same_in_two_programs() {
    let testbed = Overrides {
        duration_s: Some(8.0),
        environment: Some(EnvironmentProfile::Testbed),
        ..Overrides::default()
    };
    assert_two_do_what_one_does(&with("roundabout", testbed), SimulatedOptions::default());
}

#[test]
fn the_files_of_a_run_end_with_what_was_before_the_reset() {
    let folder = tempfile::tempdir().unwrap();
    let (lab, experiment) = (Lab::new(SimulatedOptions::default()), scenario("straight", 2.0));
    let city = lab.serve(&experiment, in_lockstep(), Some(folder.path()));
    lab.direct(move |director| {
        for _ in 0..2 {
            // The second one finds the experiment at its end, and resets it.
            let far = director.lab.mainframe(&experiment, None);
            director.until_end(&far);
        }
        director.end(&city);
    });
    let [first, second] = ["", "part-2"].map(|part| summary_in(&folder.path().join(part)));
    assert_eq!(first["simulated_s"], 2.0, "{first}");
    assert!(first["mean_speed_mps"].as_f64().unwrap() > 0.0, "{first}");
    assert_eq!(first["state_hash"], second["state_hash"]);
}
