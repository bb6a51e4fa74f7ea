//! Plans of coordinated vehicles: as the control framework tells them, in the city that it controls, to whoever watches, in
//! logs, and in the past of a run.

use crate::decisions::{client, record_run, seek};
use crate::lab::{Director, Lab, Program, network, scenario, serving};
use city3d_logbook::record::{LogEntry, LogReader};
use city3d_network::simulated::SimulatedOptions;
use city3d_protocol::snapshot::{
    CoordinationState, CoordinationUpdate, NoPlan, PlannedPassage, VehicleId, ZoneCounts, ZoneState,
    ZoneVehicle,
};
use city3d_protocol::wire::{Body, DropReason, Plans};
use city3d_session::playback::{PastPlayer, PlaybackCommand, Player};
use city3d_session::served::ServeOptions;
use city3d_session::{Order, RunHistory, RunState, coordination};
use city3d_simulation::scenario::Experiment;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

/// Plans are looked at ten times a second.
const LATELY_TICKS: u64 = 11;
/// A plan that is told by points is drawn as exactly as this, metres.
const DRAWN_WITHIN_M: f64 = 0.3;

fn state(state: &RunState) -> CoordinationState {
    state.coordination.as_deref().cloned().unwrap_or_default()
}

/// Vehicles with plans, in id order.
fn planned(state: &CoordinationState) -> Vec<(VehicleId, PlannedPassage)> {
    let plans = state.vehicles.iter().filter_map(|vehicle| Some((vehicle.id, vehicle.plan.clone().ok()?)));
    plans.collect()
}

/// Whether two tell the same plan, within the precision of a log.
fn is_same(one: &PlannedPassage, other: &PlannedPassage) -> bool {
    (one.enters_s - other.enters_s).abs() < 1e-4 && (one.leaves_s - other.leaves_s).abs() < 1e-4
}

/// Panics where two plans bring their vehicle to other places at some time after this.
fn brings_to_the_same_places(one: &PlannedPassage, other: &PlannedPassage, from_s: f64) -> usize {
    let mut compared = 0;
    for time_s in (0..60).map(|k| from_s + f64::from(k) / 4.0) {
        let [Some(here), Some(there)] = [one, other].map(|plan| plan.position_at(time_s)) else { continue };
        assert!(here.distance(there) < DRAWN_WITHIN_M, "at {time_s} s: {here} and {there}");
        compared += 1;
    }
    assert!(one.entry.position.distance(other.entry.position) < 1e-3);
    compared
}

/// Waits until a city, its mainframe and a watcher tell the same plans of two vehicles.
fn until_all_agree(director: &Director, programs: [&Program; 3]) -> [Arc<RunState>; 3] {
    director.wait("plans", || {
        let states = programs.map(Program::run_state);
        let [far, here, there] = [&states[0], &states[1], &states[2]].map(|told| planned(&state(told)));
        let is_told = |(id, plan): &(VehicleId, PlannedPassage), told: &[(VehicleId, PlannedPassage)]| {
            told.iter().any(|(other, known)| other == id && is_same(plan, known))
        };
        let agree = far.iter().all(|plan| is_told(plan, &here) && is_told(plan, &there));
        let counted = states.each_ref().map(|told| state(told).zones);
        let are_counted = counted[0] == counted[1] && counted[1] == counted[2];
        (far.len() >= 2 && agree && are_counted && !counted[0].is_empty()).then_some(states)
    })
}

/// The state that a window of the city shows when it looks back to a time.
fn look_back(live: &RunState, experiment: &Experiment, time_s: f64) -> Arc<RunState> {
    let (mut history, mut past) = (RunHistory::default(), PastPlayer::default());
    history.read(&live.history);
    past.command(PlaybackCommand::Seek(time_s), live, &history);
    past.advance(Instant::now(), live, &history, experiment).expect("a time of the past").0
}

/// A city with its mainframe and a watcher, whose windows ask for plans.
fn told_over_the_link(options: SimulatedOptions, serving: ServeOptions) {
    let lab = Lab::new(options);
    let experiment = scenario("roundabout-coordinated", 60.0);
    let city = lab.serve(&experiment, serving, None);
    let far = lab.mainframe(&experiment, None);
    let watcher = lab.watcher(&Arc::new(experiment.as_ref().clone().without_vehicles()));
    lab.direct(move |director| {
        director.until(&city, "do they drive", |told| told.driving() >= 5);
        director.until(&watcher, "are they seen", |told| told.driving() >= 5);
        assert_eq!(city.run_state().coordination, None, "nobody asks");
        [&city, &watcher, &far].iter().for_each(|program| program.order(Order::TellPlans(true)));
        let states = until_all_agree(director, [&far, &city, &watcher]);
        let told = states.each_ref().map(|told| state(told));
        let mut compared = 0;
        for (id, plan) in planned(&told[0]) {
            for other in [&told[1], &told[2]] {
                let (_, known) = planned(other).into_iter().find(|(other, _)| *other == id).unwrap();
                compared += brings_to_the_same_places(&plan, &known, states[0].now.time_s);
            }
        }
        assert!(compared > 20, "{compared} places");
        let [zone] = &told[2].zones[..] else { panic!("one zone: {:?}", told[2].zones) };
        assert!(zone.name == "west-roundabout" && zone.counts.plans >= 2, "{zone:?}");
        // Who leaves the zone is gone soon, not after the time for which a plan holds.
        let inside = |program: &Program| {
            let vehicles = state(&program.run_state()).vehicles;
            vehicles.into_iter().map(|vehicle| vehicle.id).collect::<Vec<_>>()
        };
        let before = inside(&far);
        director.wait("somebody leaves", || before.iter().any(|id| !inside(&far).contains(id)).then_some(()));
        let left: Vec<VehicleId> = before.into_iter().filter(|id| !inside(&far).contains(id)).collect();
        director.wait("that is told", || {
            let is_gone = |program: &&Program| left.iter().all(|id| !inside(program).contains(id));
            [&city, &watcher].iter().all(is_gone).then_some(())
        });
        // The past is as it was, in the city's window and in the watcher's.
        for (program, shown) in [(&city, &states[1]), (&watcher, &states[2])] {
            let past = look_back(&program.run_state(), &experiment, shown.now.time_s);
            let then = planned(&state(shown));
            let seen = planned(&state(&past));
            let known = |id: VehicleId| seen.iter().find(|(other, _)| *other == id).map(|(_, plan)| plan);
            let same = then.iter().filter(|(id, plan)| known(*id).is_some_and(|known| is_same(plan, known)));
            assert!(same.count() >= 2, "{then:?} and {seen:?}");
        }
        // Without a control framework nobody tells anything soon.
        director.kill(&far);
        director.wait("silence", || {
            let is_silent = |program: &&Program| program.run_state().coordination.is_none();
            [&city, &watcher].iter().all(is_silent).then_some(())
        });
        [watcher, city].iter().for_each(|program| director.end(program));
    });
}

#[test]
fn a_city_and_who_watches_it_show_the_plans_of_the_mainframe() {
    told_over_the_link(SimulatedOptions::default(), serving());
}

#[test]
fn plans_are_told_over_a_link_that_loses_datagrams() {
    told_over_the_link(network(3, 2, 0.1), serving());
}

#[test]
fn who_comes_while_the_clock_stands_sees_the_plans() {
    let lab = Lab::new(SimulatedOptions::default());
    let experiment = scenario("roundabout-coordinated", 60.0);
    let (city, far) = (lab.serve(&experiment, serving(), None), lab.mainframe(&experiment, None));

    lab.direct(move |director| {
        city.order(Order::TellPlans(true));
        director.wait("plans", || (planned(&state(&city.run_state())).len() >= 2).then_some(()));
        city.order(Order::Pause);
        director.pass(3.0);
        let here = city.run_state();
        let watcher = director.lab.watcher(&experiment);
        director.wait("a window", || watcher.desk().link.is_some().then_some(()));
        watcher.order(Order::TellPlans(true));
        let there = director.wait("plans over there", || {
            let there = watcher.run_state();
            (planned(&state(&there)).len() >= 2).then_some(there)
        });
        assert_eq!(there.now.tick, here.now.tick);
        assert_eq!(planned(&state(&there)).len(), planned(&state(&here)).len());
        [watcher, far, city].iter().for_each(|program| director.end(program));
    });
}

/// The plans of a run in one process, by tick.
type ToldPlans = BTreeMap<u64, CoordinationState>;

/// Records a run in one process.
fn record(experiment: &Arc<Experiment>, folder: &Path) -> ToldPlans {
    let mut told = ToldPlans::new();
    record_run(experiment, folder, |run| {
        let (tick, time_s) = (run.snapshot().tick, run.snapshot().time_s);
        told.extend(coordination(run.mainframe(), experiment, time_s).map(|now| (tick, now)));
    });
    told
}

/// Compares what is shown at a tick with the plans of the last tenth of a second; returns how many plans were compared.
fn is_as_it_was(told: &ToldPlans, (tick, time_s): (u64, f64), shown: &CoordinationState) -> usize {
    let lately: Vec<&CoordinationState> =
        told.range(tick.saturating_sub(LATELY_TICKS)..=tick).map(|(_, told)| told).collect();
    assert!(lately.iter().any(|then| then.zones == shown.zones), "at {time_s} s: {:?}", shown.zones);
    let of = |then: &CoordinationState, id| then.vehicle(id).cloned();
    for vehicle in &lately[0].vehicles {
        let stays = lately.iter().all(|then| of(then, vehicle.id).is_some());
        assert!(!stays || of(shown, vehicle.id).is_some(), "at {time_s} s vehicle {} is missing", vehicle.id);
    }
    let mut compared = 0;
    for vehicle in &shown.vehicles {
        let was = lately.iter().rev().filter_map(|then| of(then, vehicle.id));
        let is_it = |then: &ZoneVehicle| {
            let has_same_plan = match (&then.plan, &vehicle.plan) {
                (Ok(then), Ok(shown)) => is_same(then, shown),
                (then, shown) => then.as_ref().err() == shown.as_ref().err(),
            };
            let entered = (then.entered_s - vehicle.entered_s).abs() < 1e-4;
            has_same_plan && entered && then.zone == vehicle.zone && then.is_standing == vehicle.is_standing
        };
        let then = was.into_iter().find(is_it);
        let then = then.unwrap_or_else(|| panic!("at {time_s} s: {vehicle:?}"));
        if let (Ok(then), Ok(shown)) = (&then.plan, &vehicle.plan) {
            compared += brings_to_the_same_places(then, shown, time_s).min(1);
        }
    }
    compared
}

#[test]
fn a_replay_shows_the_plans_of_the_run_at_any_time() {
    let folder = tempfile::tempdir().unwrap();
    let experiment = scenario("roundabout-coordinated", 30.0);
    let told = record(&experiment, folder.path());
    let mut player = Player::open(&folder.path().join("run.mcap"), Box::new(|| {})).unwrap();
    let mut compared = 0;
    // Backwards and in leaps, so that chunks are read in no order.
    for time_s in (0..290).map(|k| f64::from(k * 83 % 290) / 10.0 + 0.5) {
        let shown = seek(&mut player, time_s);
        compared += is_as_it_was(&told, (shown.now.tick, shown.now.time_s), &state(&shown));
    }
    assert!(compared > 300, "{compared} plans");
}

#[test]
fn logs_of_both_ends_of_the_link_tell_the_plans_and_those_without_coordination_none() {
    let folder = tempfile::tempdir().unwrap();
    let lab = Lab::new(SimulatedOptions::default());
    let experiment = scenario("roundabout-coordinated", 15.0);
    let end = city3d_session::SessionEnd::AtTick(experiment.ticks());
    let lockstep = ServeOptions { is_lockstep: true, ..serving() };
    let city = lab.serve_until(end, &experiment, lockstep, Some(&folder.path().join("city")));
    let far = lab.mainframe(&experiment, Some(&folder.path().join("far")));
    lab.run();
    assert!(
        [city, far]
            .iter()
            .all(|program| { program.summary().link.is_none_or(|link| link.dropped.total() == 0) })
    );
    let uncoordinated = folder.path().join("uncoordinated");
    record(&scenario("roundabout", 15.0), &uncoordinated);
    let shown = ["city", "far", "uncoordinated"].map(|name| {
        let mut player = Player::open(&folder.path().join(name).join("run.mcap"), Box::new(|| {})).unwrap();
        let times = (0..150).map(|k| f64::from(k) / 10.0);
        times.filter(|time_s| planned(&state(&seek(&mut player, *time_s))).len() >= 2).count()
    });
    assert!(shown[0] > 50 && shown[1] > 50 && shown[2] == 0, "{shown:?}");
}

#[test]
fn logs_tell_plans_as_often_as_they_say() {
    let folder = tempfile::tempdir().unwrap();
    let experiment = scenario("roundabout-coordinated", 20.0);
    record(&experiment, folder.path());
    let mut log = LogReader::open(&folder.path().join("run.mcap")).unwrap();
    let mut last: BTreeMap<VehicleId, (f64, ZoneVehicle)> = BTreeMap::new();
    let (mut entries, mut left) = (0, 0);
    while let Some(entry) = log.read().unwrap() {
        let LogEntry::Plans(told) = entry else { continue };
        entries += 1;
        for vehicle in told.update.vehicles {
            if let Some((before_s, before)) = last.insert(vehicle.id, (told.time_s, vehicle.clone())) {
                let passed_s = told.time_s - before_s;
                let is_other = before.is_standing != vehicle.is_standing
                    || match (&before.plan, &vehicle.plan) {
                        (Ok(before), Ok(now)) => !is_same(before, now),
                        (before, now) => before.is_ok() != now.is_ok(),
                    };
                assert!(passed_s < 1.001 && (passed_s > 0.999 || is_other), "{passed_s} s: {vehicle:?}");
            }
        }
        for id in told.update.left {
            assert!(last.remove(&id).is_some(), "vehicle {id} was in the zone");
            left += 1;
        }
    }
    assert!(entries > 15 && left >= 3, "{entries} entries, {left} left");
}

#[test]
fn a_stranger_tells_no_plans_and_is_counted() {
    let lab = Lab::new(SimulatedOptions::default());
    let experiment = scenario("roundabout-coordinated", 60.0);
    let (city, far) = (lab.serve(&experiment, serving(), None), lab.mainframe(&experiment, None));
    let served = city.clone();
    lab.direct(move |director| {
        city.order(Order::TellPlans(true));
        director.wait("plans", || (!state(&city.run_state()).vehicles.is_empty()).then_some(()));
        let vehicle = state(&city.run_state()).vehicles[0].id;
        let mut stranger = client(director);
        for _ in 0..20 {
            let counts = ZoneCounts { plans: 7777, ..ZoneCounts::default() };
            let of = |id| ZoneVehicle {
                id,
                zone: 0,
                entered_s: 0.0,
                is_standing: true,
                plan: Err(NoPlan::LeftItsPlans),
            };
            let update = CoordinationUpdate {
                zones: vec![ZoneState { number: 0, name: "mine".to_owned(), counts }],
                vehicles: vec![of(vehicle), of(VehicleId(60_000))],
                left: vec![vehicle],
            };
            let time_s = city.last().snapshot.time_s;
            stranger.send(&Body::Plans(Plans { time_s, update: update.clone() }));
            stranger.send(&Body::Plans(Plans { time_s: time_s + 1e6, update: update.clone() }));
            stranger.send(&Body::ShownPlans(Plans { time_s, update }));
            director.pass(0.05);
            let told = state(&city.run_state());
            assert!(told.zones.iter().all(|zone| zone.name == "west-roundabout"), "{:?}", told.zones);
            assert!(told.vehicles.iter().all(|told| told.plan != Err(NoPlan::LeftItsPlans)));
        }
        [far, city].iter().for_each(|program| director.end(program));
    });
    let dropped = served.summary().link.unwrap().dropped;
    let counted = [DropReason::NotYours, DropReason::UnknownVehicle, DropReason::Ahead, DropReason::WrongWay]
        .map(|reason| dropped.of(reason));
    assert_eq!(counted, [60, 20, 20, 20], "{dropped:?}");
}
