//! Somebody who watches a city elsewhere.

use crate::lab::{CITY, Lab, Program, Told, named, scenario, serving};
use city3d_network::simulated::SimulatedOptions;
use city3d_protocol::snapshot::{EventKind, Pedals, Status, VehicleId};
use city3d_session::playback::Occurrence;
use city3d_session::{MomentKind, Order, PoseWatch};
use city3d_simulation::scenario::Experiment;
use std::collections::BTreeMap;
use std::sync::Arc;

/// By tick, while the clock runs.
fn ticks(program: &Program) -> BTreeMap<u64, Told> {
    let told = program.told().into_iter().filter(|told| told.kind == MomentKind::Tick);
    told.map(|told| (told.snapshot.tick, told)).collect()
}

/// What a watcher knows of a scenario whose vehicles it has to be told.
fn known(experiment: &Experiment) -> Arc<Experiment> {
    Arc::new(experiment.clone().without_vehicles())
}

#[test]
fn a_watcher_sees_the_city_as_it_is() {
    let lab = Lab::new(SimulatedOptions::default());
    let experiment = scenario("roundabout", 12.0);
    let (city, far) = (lab.serve(&experiment, serving(), None), lab.mainframe(&experiment, None));
    let watcher = lab.watcher(&known(&experiment));
    let (served, seen) = (city.clone(), watcher.clone());
    lab.direct(move |director| {
        director.until(&watcher, "do they drive", |told| told.snapshot.time_s > 11.0);
        let link = watcher.desk().link.clone().unwrap();
        assert_eq!((link.address.as_str(), link.trouble, link.is_remote), (CITY, None, true));
        assert_eq!(link.scenario.as_deref(), Some("roundabout"));
        assert!(link.leader.unwrap().starts_with("127.0.0.1:"));
        assert!((90.0..110.0).contains(&link.received_per_s), "{}", link.received_per_s);
        [watcher, far, city].iter().for_each(|program| director.end(program));
    });
    let (served, seen) = (ticks(&served), ticks(&seen));
    assert!(seen.len() > 1000, "{} ticks", seen.len());
    let (mut furthest_m, mut fastest_mps) = (0.0f64, 0.0f64);
    for (tick, seen) in &seen {
        let served = &served[tick];
        // Exact: time, digest, phase, who is there and what they do. Poses go through the wire and a filter.
        assert_eq!((served.snapshot.time_s, served.phase), (seen.snapshot.time_s, seen.phase));
        assert_eq!(served.snapshot.state_hash, seen.snapshot.state_hash);
        assert_eq!(served.snapshot.vehicles.len(), seen.snapshot.vehicles.len());
        for (is, looks) in served.snapshot.vehicles.iter().zip(&seen.snapshot.vehicles) {
            assert_eq!((is.id, is.status), (looks.id, looks.status));
            furthest_m = furthest_m.max((is.position - looks.position).length());
            if *tick > 200 {
                fastest_mps = fastest_mps.max((is.speed_mps - looks.speed_mps).abs());
            }
        }
    }
    assert!(furthest_m < 0.002 && fastest_mps < 0.1, "{furthest_m} m, {fastest_mps} m/s");
    let (city, told) = (served.values().last().unwrap(), seen.values().last().unwrap());
    for (is, looks) in city.snapshot.roster.iter().zip(told.snapshot.roster.iter()) {
        assert_eq!((is.id, &is.name, is.appearance), (looks.id, &looks.name, looks.appearance));
        assert_eq!((is.dimensions, looks.model.as_str()), (looks.dimensions, ""), "its pedals are not seen");
    }
}

#[test]
fn a_watcher_says_its_trouble_and_finds_the_city_again() {
    let lab = Lab::new(SimulatedOptions::default());
    let experiment = scenario("roundabout", 60.0);
    let watcher = lab.watcher(&known(&experiment));
    lab.direct(move |director| {
        let trouble = |words: &str| {
            let words = words.to_owned();
            let said = director.until_link(&watcher, &words, |link| {
                link.trouble.as_ref().is_some_and(|trouble| trouble.contains(&words))
            });
            assert!(said.trouble.unwrap().contains(CITY));
        };
        let is_seen_well = || {
            director.until_link(&watcher, "no trouble", |link| link.trouble.is_none());
        };
        trouble("nothing listens there");
        let city = director.lab.serve(&experiment, serving(), None);
        let far = director.lab.mainframe(&experiment, None);
        director.until(&watcher, "the city", |told| told.driving() >= 5);
        is_seen_well();

        director.lab.network.partition("watcher", "city");
        trouble("does not answer any more");
        let last = watcher.last().snapshot.tick;
        director.pass(3.0);
        assert_eq!(watcher.last().snapshot.tick, last, "nothing comes through");
        director.lab.network.repair();
        director.until(&watcher, "the city again", |told| told.snapshot.tick > last + 300);
        is_seen_well();

        // A city that was started again, with the mainframe's vehicles.
        let old = watcher.last().snapshot.tick;
        director.kill(&city);
        trouble(CITY);
        let city = director.lab.serve(&experiment, serving(), None);
        director.until(&watcher, "the new city", |told| told.driving() >= 5 && told.snapshot.tick < old);
        is_seen_well();
        let runs = watcher.told().iter().filter(|told| told.kind == MomentKind::First).count();
        assert_eq!(runs, 2, "of each city one");
        [far, city].iter().for_each(|program| director.end(program));
    });
}

#[test]
fn poses_tell_a_watcher_of_the_collisions_that_the_city_reports() {
    let lab = Lab::new(SimulatedOptions::default());
    let experiment = scenario("roundabout", 30.0);
    let [ahead, behind] = ["path1_b", "path1_c"].map(|name| named(&experiment, name));
    let (city, far) = (lab.serve(&experiment, serving(), None), lab.mainframe(&experiment, None));
    let watcher = lab.watcher(&known(&experiment));
    let (served, seen) = (city.clone(), watcher.clone());
    lab.direct(move |director| {
        director.until(&watcher, "do they drive", |told| told.driving() >= 5 && told.snapshot.time_s > 1.0);
        // On a straight road, one brakes and the next one does not.
        city.order(Order::Drive(ahead, Pedals { brake: 1.0, ..Pedals::default() }));
        city.order(Order::Drive(behind, Pedals { gas: 0.5, ..Pedals::default() }));
        director.until(&city, "a collision", |told| told.count(Status::Collided) > 0);
        director.pass(1.0);
        [watcher, far, city].iter().for_each(|program| director.end(program));
    });
    let told = served.told();
    let events = told.iter().flat_map(|told| &told.snapshot.events);
    let reported: Vec<_> = events.filter(|event| event.kind.is_collision()).cloned().collect();
    let mut watch = PoseWatch::default();
    let found: Vec<_> = seen
        .told()
        .iter()
        .filter(|told| told.kind == MomentKind::Tick)
        .flat_map(|told| watch.observe(&told.snapshot, false))
        .collect();
    let of = |found: &[(f64, Vec<VehicleId>)]| found.iter().map(|(_, who)| who.clone()).collect::<Vec<_>>();
    let pair = |vehicle: VehicleId, kind: &EventKind| match kind {
        EventKind::Collision { with } => vec![vehicle, *with],
        _ => vec![vehicle],
    };
    let reported: Vec<_> =
        reported.iter().map(|event| (event.time_s, pair(event.vehicle, &event.kind))).collect();
    let found: Vec<_> = found
        .iter()
        .filter_map(|mark| match &mark.what {
            Occurrence::Event(kind) => Some((mark.time_s, pair(mark.vehicle, kind))),
            _ => None,
        })
        .collect();
    assert!(!reported.is_empty());
    assert_eq!(of(&found), of(&reported), "{found:?} {reported:?}");
    let late = found.iter().zip(&reported).map(|(found, reported)| (found.0 - reported.0).abs());
    assert!(late.fold(0.0, f64::max) < 0.1, "{found:?} {reported:?}");
}
