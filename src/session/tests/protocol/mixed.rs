//! Virtual and physical vehicles in one experiment: the emulated laboratory comes late, goes, and comes back.

use crate::compare::merges;
use crate::lab::{Director, Lab, Program, network, scenario, serving};
use crate::motion::{furthest, hardest_braking, stand, way_m};
use city3d_network::simulated::SimulatedOptions;
use city3d_protocol::snapshot::{EventKind, Status, VehicleId};
use city3d_protocol::wire::ExperimentPhase;
use city3d_simulation::scenario::Experiment;

fn physical(experiment: &Experiment) -> Vec<VehicleId> {
    experiment.physical().map(|(planned, _)| planned.id).collect()
}

/// Waits until all vehicles of some have moved on from where they are.
fn until_all_move(director: &Director, city: &Program, ids: &[VehicleId]) {
    let from = city.last();
    director.until(city, "all move", |told| ids.iter().all(|id| way_m(&from, told, *id) > 1.0));
}

#[test]
fn physical_vehicles_are_waited_for_marked_when_unseen_and_found_again() {
    let lab = Lab::new(SimulatedOptions::default());
    let experiment = scenario("mixed", 60.0);
    let (city, far) = (lab.serve(&experiment, serving(), None), lab.mainframe(&experiment, None));
    lab.direct(move |director| {
        let in_lab = physical(&experiment);
        assert_eq!(in_lab.len(), 3);
        director.until(&city, "the setups", |told| told.snapshot.vehicles.len() == 6);
        director.pass(3.0);
        let waiting = city.last();
        assert_eq!((waiting.phase, waiting.snapshot.tick), (ExperimentPhase::Ready, 0), "nothing starts");
        assert!(in_lab.iter().all(|id| waiting.vehicle(*id).status == Status::Waiting));

        let testbed = director.lab.testbed(&experiment);
        let begun = director.until(&city, "the start", |told| told.phase == ExperimentPhase::Running);
        assert!(in_lab.iter().all(|id| begun.snapshot.info(*id).unwrap().is_physical()));
        assert_eq!(begun.count(Status::Unseen), 0);
        director.until(&city, "some seconds", |told| told.snapshot.time_s > 8.0);
        let later = city.last();
        for state in &begun.snapshot.vehicles {
            assert!(way_m(&begun, &later, state.id) > 3.0, "vehicle {} stands", state.id);
        }

        // Who is not seen stands where it would be.
        director.kill(&testbed);
        let unseen = director.until(&city, "they are unseen", |told| told.count(Status::Unseen) == 3);
        assert!(in_lab.iter().all(|id| unseen.vehicle(*id).status == Status::Unseen));
        director.pass(1.0);
        let still = city.last();
        assert!(in_lab.iter().all(|id| way_m(&unseen, &still, *id) < 0.1), "nobody guesses where they drive");

        let _again = director.lab.testbed(&experiment);
        director.until(&city, "they are seen again", |told| told.count(Status::Unseen) == 0);
        let events: Vec<EventKind> = city
            .told()
            .iter()
            .flat_map(|told| told.snapshot.events.clone())
            .filter(|event| in_lab.contains(&event.vehicle))
            .map(|event| event.kind)
            .collect();
        let count = |kind: &EventKind| events.iter().filter(|other| *other == kind).count();
        assert_eq!((count(&EventKind::Unseen), count(&EventKind::SeenAgain)), (3, 3), "{events:?}");
        until_all_move(director, &city, &in_lab);
        [far, city].iter().for_each(|program| director.end(program));
    });
}

/// Waits until some vehicles of both kinds have moved on from where they are.
fn until_both_move(director: &Director, city: &Program, experiment: &Experiment) {
    let from = city.last();
    director.until(city, "both kinds move", |told| {
        let moves = |is_physical: bool| {
            let counts = |id| experiment.is_physical(id) == is_physical;
            furthest(&from, told, counts) > 1.0
        };
        moves(true) && moves(false)
    });
}

#[test]
fn vehicles_of_both_kinds_stay_on_their_way_while_mainframe_and_city_are_started_again() {
    let lab = Lab::new(SimulatedOptions::default());
    let experiment = scenario("mixed", 120.0);
    lab.testbed(&experiment);
    let (city, far) = (lab.serve(&experiment, serving(), None), lab.mainframe(&experiment, None));
    lab.direct(move |director| {
        let is_physical = |id| experiment.is_physical(id);
        director.until(&city, "some seconds", |told| told.snapshot.time_s > 5.0);
        let killed_at = city.told().len();
        director.kill(&far);
        director.wait("do they stop", || stand(&city.desk().told).then_some(()));
        let seen = city.told().split_off(killed_at);
        let stood = seen.last().unwrap();
        assert_eq!(stood.count(Status::LinkLost), 3, "the virtual ones");
        let braking = hardest_braking(&seen, |id| !is_physical(id));
        assert!((2.0..5.3).contains(&braking), "virtual ones: {braking} m/s2");

        let far = director.lab.mainframe(&experiment, None);
        until_both_move(director, &city, &experiment);
        let back = city.last();
        let way_m = furthest(stood, &back, |_| true);
        assert!(way_m < 5.0, "a vehicle was put back to its start: {way_m} m");

        director.until(&city, "some seconds more", |told| told.snapshot.time_s > back.snapshot.time_s + 3.0);
        let before = city.last();
        director.kill(&city);
        director.pass(1.0);
        let city = director.lab.serve(&experiment, serving(), None);
        let begun = director.until(&city, "the new city", |told| told.phase == ExperimentPhase::Running);
        let way_m = furthest(&before, &begun, |id| !is_physical(id));
        assert!(way_m < 1.5, "a virtual vehicle has jumped {way_m} m");
        let way_m = furthest(&before, &begun, is_physical);
        assert!(way_m < 15.0, "a robot was put back to its start: {way_m} m");
        until_both_move(director, &city, &experiment);
        [&far, &city].iter().for_each(|program| director.end(program));
        assert_eq!(city.summary().collisions, 0);
    });
}

#[test]
fn three_virtual_and_three_physical_vehicles_are_one_experiment_over_a_bad_network() {
    let lab = Lab::new(network(5, 20, 0.03));
    let experiment = scenario("mixed", 30.0);
    lab.testbed(&experiment);
    let (city, far) = (lab.serve(&experiment, serving(), None), lab.mainframe(&experiment, None));
    let (served, controlled) = (city.clone(), far.clone());
    lab.direct(move |director| {
        // Poses of later ticks may overtake those of the last one.
        director.until(&far, "the end", |told| told.snapshot.tick >= 3000);
        [far, city].iter().for_each(|program| director.end(program));
    });
    let served = served.summary();
    assert_eq!((served.collisions, served.vehicles.len()), (0, 6));
    for vehicle in served.vehicles.values() {
        assert!(vehicle.distance_m > 60.0, "{vehicle:?}");
    }
    // The first of path 1 is virtual. It went in among those of path 2, of whom two are physical.
    let merged = merges(&controlled.summary().events);
    for id in [1, 4, 6].map(VehicleId) {
        assert!(merged.iter().any(|(vehicle, _)| *vehicle == id), "vehicle {id}: {merged:?}");
    }
}
