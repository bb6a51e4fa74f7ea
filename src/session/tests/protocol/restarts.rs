//! City and control framework stop and come back, and the experiment is reset.

use crate::compare::{assert_same, assert_same_merges, digests, merges, replayed, summary_in};
use crate::lab::{Director, Lab, Program, Told, network, scenario, serving};
use crate::motion::{furthest, hardest_braking, stand};
use city3d_logbook::record::{NetworkCommand, read_network};
use city3d_network::simulated::SimulatedOptions;
use city3d_protocol::snapshot::{Status, VehicleId};
use city3d_protocol::wire::{Body, ExperimentPhase};
use city3d_session::{MomentKind, Order};
use std::path::Path;

/// Vehicles of the roundabout.
const ALL: usize = 6;

/// Waits until vehicles drive, and have done so for a while.
fn until_they_go(director: &Director, city: &Program, what: &str) -> Told {
    director.until(city, what, |told| told.driving() >= ALL - 1 && told.snapshot.time_s > 3.0)
}

#[test]
fn without_mainframe_vehicles_brake_on_their_path_and_go_on_when_it_is_back() {
    let lab = Lab::new(SimulatedOptions::default());
    let experiment = scenario("roundabout", 60.0);
    let (city, far) = (lab.serve(&experiment, serving(), None), lab.mainframe(&experiment, None));
    lab.direct(move |director| {
        until_they_go(director, &city, "do they drive");
        let killed_at = city.told().len();
        director.kill(&far);
        director.until(&city, "do they lose the link", |told| told.count(Status::LinkLost) == ALL);
        director.wait("do they stop", || stand(&city.desk().told).then_some(()));
        let seen = city.told().split_off(killed_at);
        let braking = hardest_braking(&seen, |_| true);
        assert!((2.0..5.3).contains(&braking), "{braking} m/s2");
        for state in seen.iter().flat_map(|told| &told.snapshot.vehicles) {
            assert!(state.lateral_error_m.abs() < 0.65, "vehicle {} leaves its path: {state:?}", state.id);
        }

        let far = director.lab.mainframe(&experiment, None);
        let back = director.until(&city, "do they go on", |told| told.driving() >= ALL - 1);
        let stood = seen.last().unwrap();
        assert!(furthest(stood, &back, |_| true) < 1.5, "they go on from where they stood");
        director.until(&far, "five seconds more", |told| told.snapshot.time_s > back.snapshot.time_s + 5.0);
        assert!(furthest(stood, &city.last(), |_| true) > 10.0);
        director.end(&far);
        director.end(&city);
        assert_eq!(city.summary().collisions, 0);
    });
}

#[test]
fn a_restarted_city_gets_its_vehicles_where_they_were() {
    for conditions in [SimulatedOptions::default(), network(5, 20, 0.05)] {
        let lab = Lab::new(conditions);
        let experiment = scenario("roundabout", 60.0);
        let (city, far) = (lab.serve(&experiment, serving(), None), lab.mainframe(&experiment, None));
        lab.direct(move |director| {
            let before = until_they_go(director, &city, "do they drive");
            director.kill(&city);
            director.pass(2.5);
            let trouble = far.desk().link.clone().unwrap().trouble.unwrap();
            assert!(trouble.starts_with("127.0.0.1:9870"), "{trouble}");

            let second = director.lab.serve(&experiment, serving(), None);
            until_they_go(director, &second, "do they go on in the new city");
            let told = second.told();
            let first = told.iter().find(|told| told.kind == MomentKind::First).unwrap();
            assert_eq!((first.snapshot.tick, first.snapshot.vehicles.len()), (0, ALL));
            let way_m = furthest(&before, first, |_| true);
            assert!(way_m < 1.5, "a vehicle has jumped {way_m} m");
            assert!(furthest(first, &second.last(), |_| true) > 5.0, "they drive");
            director.end(&far);
            director.end(&second);
            assert_eq!((second.summary().collisions, far.summary().collisions), (0, 0));
        });
    }
}

/// The setups at the beginning of a log.
fn setups(folder: &Path) -> Vec<NetworkCommand> {
    let is_setup = |command: &NetworkCommand| {
        matches!(Body::from_log(command.kind, &command.body), Ok(Body::Setup { .. }))
    };
    read_network(&folder.join("run.mcap")).unwrap().into_iter().filter(is_setup).collect()
}

#[test]
fn a_reset_by_the_window_begins_the_same_run_again_and_the_mainframe_goes_on_with_it() {
    let folder = tempfile::tempdir().unwrap();
    let [served, controlled] = ["served", "far"].map(|name| folder.path().join(name));
    let lab = Lab::new(SimulatedOptions::default());
    let experiment = scenario("roundabout", 60.0);
    let city = lab.serve(&experiment, serving(), Some(&served));
    let far = lab.mainframe(&experiment, Some(&controlled));
    let told = city.clone();
    lab.direct(move |director| {
        let is_at =
            |told: &Told, time_s| told.phase == ExperimentPhase::Running && told.snapshot.time_s >= time_s;
        let last = director.until(&city, "the first run", |told| is_at(told, 12.0));
        city.order(Order::Reset);
        let is_new = |told: &Told| told.snapshot.tick < last.snapshot.tick && is_at(told, 1.0);
        director.until(&city, "the next run", is_new);
        director.until(&city, "as far as the first", |told| is_at(told, 12.5));
        director.end(&far);
        director.end(&city);
        assert_eq!(city.summary().collisions, 0);
    });

    let told = told.told();
    let second_at = told.iter().rposition(|told| told.kind == MomentKind::First).unwrap();
    let (first, second) = told.split_at(second_at);
    let [first, second] = [first, second].map(|run| {
        let at = run.iter().position(|told| told.kind == MomentKind::First).unwrap();
        run[at..].to_vec()
    });
    assert_eq!(first[0].snapshot, second[0].snapshot, "the same initial state");
    let [first, second] = [first, second].map(|run| digests(&run));
    let same = first.iter().zip(&second).take_while(|(a, b)| a == b).count();
    assert_eq!(same, first.len(), "the runs differ from tick {same} on");

    let parts = |root: &Path| [root.to_path_buf(), root.join("part-2")];
    let [before, after] = parts(&served).map(|part| setups(&part));
    assert_eq!(before.len(), ALL);
    let bodies = |setups: Vec<NetworkCommand>| setups.into_iter().map(|one| one.body).collect::<Vec<_>>();
    let (before, after) = (bodies(before), bodies(after));
    assert_eq!(after[..ALL], before[..], "the city keeps them");
    for (part, digests) in parts(&served).iter().zip([&first, &second]) {
        assert_same(&replayed(&part.join("run.mcap")), digests, "replay");
    }
    let [before, after] = parts(&controlled).map(|part| merges_in(&part));
    assert!(before.len() > 6, "{before:?}");
    assert_same_merges(&after[..before.len()], &before, 0.05);
    for part in parts(&served) {
        assert!(summary_in(&part)["simulated_s"].as_f64().unwrap() > 11.9);
    }
}

fn merges_in(folder: &Path) -> Vec<(VehicleId, f64)> {
    let events = serde_json::from_value::<Vec<_>>(summary_in(folder)["events"].clone()).unwrap();
    merges(&events)
}

#[test]
fn a_mainframe_that_comes_back_to_a_full_city_lets_nobody_collide() {
    let (lab, experiment) = (Lab::new(SimulatedOptions::default()), scenario("city", 300.0));
    let city = lab.serve(&experiment, serving(), None);
    let (served, first) = (city.clone(), lab.mainframe(&experiment, None));
    lab.direct(move |director| {
        let mut far = first;
        for at_s in [25.0, 50.0] {
            director.until(&city, "its time", |told| told.snapshot.time_s >= at_s);
            director.kill(&far);
            // They stand wherever they were: in front of lines, behind others, and in the middle of junctions.
            director.pass(4.0);
            far = director.lab.mainframe(&experiment, None);
        }
        director.until(&city, "some way", |told| told.snapshot.time_s >= 75.0);
        assert!(city.last().driving() >= 25, "most drive");
        director.end(&city);
    });
    let served = served.summary();
    assert_eq!(served.collisions, 0);
}
