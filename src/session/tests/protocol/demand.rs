//! Vehicles that come and go in a city and a control framework that are two programs.

use crate::compare::{alone, assert_same, replayed, summary_in};
use crate::lab::{Lab, network, serving};
use city3d_network::simulated::SimulatedOptions;
use city3d_protocol::snapshot::EventKind;
use city3d_roadmap::Grid;
use city3d_session::served::ServeOptions;
use city3d_session::{Order, SessionEnd};
use city3d_simulation::runner::{InflowTotals, Summary};
use city3d_simulation::scenario::{Experiment, Library, Overrides, grid_scenario, read_experiment};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

/// Traffic from all sides through one junction; vehicles need about 25 s from side to side.
fn traffic(duration_s: f64, rate_veh_h: u32) -> Arc<Experiment> {
    let grid = Grid { entry_m: 3.0, ..Grid::default() };
    let text = grid_scenario(&grid, Path::new("grid.dxf"), Path::new("grid.toml"));
    let text = text.replace("rate_veh_h = 200", &format!("rate_veh_h = {rate_veh_h}"));
    let library = Library::kept(grid.to_dxf().unwrap().into_bytes(), BTreeMap::new());
    let overrides = Overrides { duration_s: Some(duration_s), ..Overrides::default() };
    Arc::new(read_experiment("grid", &text, &library, overrides).unwrap())
}

fn in_lockstep() -> ServeOptions {
    ServeOptions { is_lockstep: true, ..serving() }
}

/// Vehicles that have entered, and those of them that have left.
fn come_and_gone(summary: &Summary) -> (u32, u32) {
    let sum = |of: fn(&InflowTotals) -> u32| summary.inflows.values().map(of).sum();
    (sum(|of| of.entered), sum(|of| of.left))
}

#[test]
fn in_lockstep_the_same_vehicles_come_and_go_in_two_programs_tick_by_tick() {
    let experiment = traffic(40.0, 300);
    let expected = alone(&experiment);
    for conditions in [SimulatedOptions::default(), network(2, 20, 0.05)] {
        let folder = tempfile::tempdir().unwrap();
        let lab = Lab::new(conditions);
        let end = SessionEnd::AtTick(experiment.ticks());
        let city = lab.serve_until(end, &experiment, in_lockstep(), Some(folder.path()));
        let far = lab.mainframe(&experiment, None);
        lab.run();
        assert_same(&city.digests(), &expected.digests, "city");
        assert_same(&far.digests(), &expected.digests, "mainframe");
        let (served, controlled) = (city.summary(), far.summary());
        assert_eq!(served.collisions, 0);
        let (entered, left) = come_and_gone(&controlled);
        assert!(entered > 8 && left > 2, "{entered} {left}");
        assert_eq!(controlled.inflows, served.inflows, "both know who came, when, and how long it was held");
        // The log of the city has the setups, and comes to the same states again.
        assert_same(&replayed(&folder.path().join("run.mcap")), &expected.digests, "replay");
    }
}

#[test]
fn in_real_time_vehicles_come_and_go_over_a_bad_network() {
    let experiment = traffic(40.0, 240);
    for conditions in [SimulatedOptions::default(), network(5, 20, 0.05)] {
        let lab = Lab::new(conditions);
        let (city, far) = (lab.serve(&experiment, serving(), None), lab.mainframe(&experiment, None));
        let ticks = experiment.ticks();
        let programs = [city.clone(), far.clone()];
        lab.direct(move |director| {
            director.until(&far, "the end of the experiment", |told| told.snapshot.tick >= ticks);
            director.end(&far);
            director.end(&city);
        });
        let [served, controlled] = programs.map(|program| program.summary());
        assert_eq!((served.collisions, controlled.collisions), (0, 0));
        let (entered, left) = come_and_gone(&served);
        assert!(entered > 6 && left > 1, "{entered} {left}");
        // Lost setups and removals are sent again: nobody waits long before an empty entry.
        assert!(served.inflows.values().all(|of| of.mean_held_s < 1.5), "{:?}", served.inflows);
        let spawned = served.events.iter().filter(|event| event.kind == EventKind::Spawn).count();
        assert_eq!(spawned, entered as usize, "nobody comes twice");
    }
}

#[test]
fn a_restarted_mainframe_takes_over_those_who_are_there_and_lets_others_in() {
    let lab = Lab::new(SimulatedOptions::default());
    let experiment = traffic(60.0, 300);
    let (city, far) = (lab.serve(&experiment, serving(), None), lab.mainframe(&experiment, None));
    let told = city.clone();
    lab.direct(move |director| {
        let before = director.until(&city, "some have come", |told| told.snapshot.time_s > 15.0);
        assert!(before.snapshot.vehicles.len() > 2);
        director.kill(&far);
        director.pass(3.0);
        let far = director.lab.mainframe(&experiment, None);
        director.until(&far, "a while later", |told| told.snapshot.time_s > 50.0);
        director.end(&far);
        director.end(&city);
        let (entered, left) = come_and_gone(&city.summary());
        assert!(left > 2 && entered > 6, "{entered} {left}");
        // Whoever was there has driven on and left.
        let last = city.last();
        for state in &before.snapshot.vehicles {
            let later = last.snapshot.vehicle(state.id);
            assert!(later.is_none_or(|later| later.distance_m > state.distance_m + 5.0), "{state:?}");
        }
        assert_eq!(city.summary().collisions, 0);
    });
    let spawned = told.summary().events.iter().filter(|event| event.kind == EventKind::Spawn).count();
    assert_eq!(spawned as u32, come_and_gone(&told.summary()).0, "nobody comes twice");
}

#[test]
fn after_a_reset_the_same_vehicles_come_again() {
    let folder = tempfile::tempdir().unwrap();
    let lab = Lab::new(SimulatedOptions::default());
    let experiment = traffic(60.0, 300);
    let city = lab.serve(&experiment, serving(), Some(folder.path()));
    let far = lab.mainframe(&experiment, None);
    lab.direct(move |director| {
        director.until(&city, "the first run", |told| told.snapshot.time_s > 12.0);
        city.order(Order::Reset);
        let is_new = |told: &crate::lab::Told| told.snapshot.time_s < 5.0 && told.snapshot.tick > 10;
        director.until(&city, "the next run", is_new);
        director.until(&city, "as far as the first", |told| told.snapshot.time_s > 14.0);
        director.end(&far);
        director.end(&city);
        assert_eq!(city.summary().collisions, 0);
    });
    let entered = |part: &str| {
        let summary = summary_in(&folder.path().join(part));
        let vehicles = summary["vehicles"].as_object().unwrap().clone();
        let early = vehicles.into_iter().filter(|(_, vehicle)| {
            vehicle["arrival"]["entered_s"].as_f64().is_some_and(|entered_s| entered_s < 11.0)
        });
        early.map(|(id, _)| id).collect::<Vec<_>>()
    };
    let first = entered("");
    assert!(first.len() > 2, "{first:?}");
    assert_eq!(entered("part-2"), first);
}
