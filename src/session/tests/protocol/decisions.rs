//! Why vehicles do what they do: as the control framework tells it, in the city that it controls, to whoever watches, and in
//! logs.

use crate::lab::{CITY, Director, Lab, Program, network, scenario, serving};
use city3d_logbook::record::{LogEntry, LogOrigin, LogReader};
use city3d_logbook::replay::Replay;
use city3d_logbook::verify::VerifyReport;
use city3d_network::link::{Client, ClientEvent};
use city3d_network::simulated::SimulatedOptions;
use city3d_protocol::snapshot::{ControlDecision, DecisionReason, Status, VehicleId};
use city3d_protocol::wire::{Authenticator, Body, Decisions, DropReason, VehicleDecision};
use city3d_session::playback::{PlaybackCommand, Player};
use city3d_session::served::ServeOptions;
use city3d_session::{
    FileOptions, Inputs, Moment, Order, RunFiles, RunFolders, RunState, decisions as decisions_of,
};
use city3d_simulation::runner::Run;
use city3d_simulation::scenario::Experiment;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// What is told of a vehicle: what limits it, and who else has a part in it.
type Why = (DecisionReason, Option<VehicleId>);

fn decisions(state: &RunState) -> &[ControlDecision] {
    state.insight.as_ref().and_then(|insight| insight.decisions.as_deref()).unwrap_or_default()
}

/// Who yields at a line, and to whom.
fn yielding(state: &RunState) -> Option<(VehicleId, VehicleId)> {
    let of = |told: &ControlDecision| {
        let is_yielding = state.now.vehicle(told.vehicle)?.status == Status::Yielding;
        let other = told.other.filter(|_| is_yielding && told.reason == DecisionReason::YieldLine)?;
        Some((told.vehicle, other))
    };
    decisions(state).iter().find_map(of)
}

/// A city with its mainframe and a watcher, whose windows ask why: waits until both say to whom a vehicle yields.
fn told_over_the_link(options: SimulatedOptions, serving: ServeOptions, folder: Option<&Path>) {
    let lab = Lab::new(options);
    let experiment = scenario("roundabout", 60.0);
    let city = lab.serve(&experiment, serving, folder);
    let far = lab.mainframe(&experiment, None);
    let watcher = lab.watcher(&Arc::new(experiment.as_ref().clone().without_vehicles()));
    lab.direct(move |director| {
        director.until(&city, "do they drive", |told| told.driving() >= 5);
        director.until(&watcher, "are they seen", |told| told.driving() >= 5);
        assert_eq!(city.run_state().insight, None, "nobody asks");
        [&city, &watcher, &far].iter().for_each(|program| program.order(Order::TellDecisions(true)));
        let both = || {
            let [here, there] = [&city, &watcher].map(Program::run_state);
            let pair = yielding(&here)?;
            (yielding(&there) == Some(pair)).then_some((here, there, far.run_state(), pair))
        };
        let (here, there, told, (vehicle, _)) = director.wait("a reason", both);
        assert!(decisions(&here).len() >= 5 && decisions(&there).len() >= 5);
        let of = |state: &RunState| state.insight.as_ref().unwrap().decision(vehicle).copied().unwrap();
        let [here, there, told] = [&here, &there, &told].map(|state| of(state));
        // The line is where the control framework has it, as far as numbers go through the scale.
        let place = told.place.unwrap();
        assert!(here.place.unwrap().distance(place) < 1e-6 && there.place.unwrap().distance(place) < 1e-6);
        assert!((here.target_mps - told.target_mps).abs() < 3.0);
        assert!(told.measured.is_some(), "in its own process");
        assert_eq!((here.measured, there.measured), (None, None), "it is told too seldom for that");
        // Without a control framework nobody tells anything soon.
        director.kill(&far);
        director.wait("silence", || {
            [&city, &watcher].iter().all(|program| decisions(&program.run_state()).is_empty()).then_some(())
        });
        [watcher, city].iter().for_each(|program| director.end(program));
    });
}

#[test]
fn a_city_and_who_watches_it_say_what_the_mainframe_tells() {
    told_over_the_link(SimulatedOptions::default(), serving(), None);
}

#[test]
fn it_is_told_over_a_link_that_loses_datagrams() {
    told_over_the_link(network(3, 2, 0.1), serving(), None);
}

#[test]
fn in_lockstep_the_city_is_told_too_and_its_log_keeps_it() {
    let folder = tempfile::tempdir().unwrap();
    let lab = Lab::new(SimulatedOptions::default());
    let experiment = scenario("roundabout", 20.0);
    let end = city3d_session::SessionEnd::AtTick(experiment.ticks());
    let lockstep = ServeOptions { is_lockstep: true, ..serving() };
    let city = lab.serve_until(end, &experiment, lockstep, Some(&folder.path().join("city")));
    let far = lab.mainframe(&experiment, Some(&folder.path().join("far")));
    let (served, controlled) = (city.clone(), far.clone());
    lab.run();
    for (program, origin) in [(served, LogOrigin::Served), (controlled, LogOrigin::Mainframe)] {
        assert!(program.summary().link.is_none_or(|link| link.dropped.total() == 0));
        let name = if origin == LogOrigin::Served { "city" } else { "far" };
        let log = folder.path().join(name).join("run.mcap");
        let mut player = Player::open(&log, Box::new(|| {})).unwrap();
        assert_eq!(player.origin(), origin);
        let times = (0..200).map(|k| f64::from(k) / 10.0);
        let found = times.filter_map(|time_s| yielding(&seek(&mut player, time_s))).count();
        assert!(found > 5, "{found} in the log of the {name}");
        if origin == LogOrigin::Served {
            is_simulated_again(&log);
        }
    }
}

/// The state that a player shows at a time, with all that the log tells of it.
pub fn seek(player: &mut Player, time_s: f64) -> Arc<RunState> {
    player.command(PlaybackCommand::Seek(time_s));
    let start = Instant::now();
    loop {
        let (state, _) = player.advance(start);
        if player.is_settled() {
            return state;
        }
        assert!(start.elapsed() < Duration::from_secs(60), "never read: {time_s} s");
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// `replay --verify` agrees with each tick.
fn is_simulated_again(log: &Path) {
    let mut replay = Replay::open(log).unwrap();
    let report = VerifyReport::of(&mut replay, log, &mut |_| ()).unwrap();
    assert!(report.ticks_agreeing > 1000 && report.first_difference.is_none(), "{report:?}");
}

/// Records a run in one process; `look` sees it after each tick.
pub fn record_run(experiment: &Arc<Experiment>, folder: &Path, mut look: impl FnMut(&Run)) {
    let mut run = Run::new(Arc::clone(experiment)).unwrap();
    let folders = RunFolders::parts(Some(folder.to_path_buf()));
    let mut files = RunFiles::new(folders, LogOrigin::Run, FileOptions::default());
    files.begin(experiment).unwrap();
    files.record_or_fail(&Moment::first(experiment, run.snapshot())).unwrap();
    for tick in 0..experiment.ticks() {
        let from = (tick, run.snapshot().time_s);
        run.step();
        let inputs = Inputs::Commands(run.commands());
        let moment = Moment::tick(experiment, run.snapshot(), inputs, Some(run.mainframe()), from);
        files.record_or_fail(&moment).unwrap();
        look(&run);
    }
    let last = Moment::first(experiment, run.snapshot());
    files.conclude(&last, false).unwrap();
}

/// Records a run in one process; gives why each vehicle did what it did, by tick.
fn record(experiment: &Arc<Experiment>, folder: &Path) -> BTreeMap<u64, BTreeMap<VehicleId, Why>> {
    let mut told = BTreeMap::new();
    record_run(experiment, folder, |run| {
        let why = decisions_of(run.mainframe(), experiment);
        let why = why.iter().map(|told| (told.vehicle, (told.reason, told.other))).collect();
        told.insert(run.snapshot().tick, why);
    });
    told
}

#[test]
fn a_replay_says_to_whom_vehicles_yield_at_any_time() {
    let folder = tempfile::tempdir().unwrap();
    let experiment = scenario("roundabout", 30.0);
    let told = record(&experiment, folder.path());
    let log = folder.path().join("run.mcap");
    let mut player = Player::open(&log, Box::new(|| {})).unwrap();
    let (mut yields, mut compared) = (0, 0);
    // Backwards and in leaps, so that chunks are read in no order.
    let times = (0..290).map(|k| f64::from(k * 83 % 290) / 10.0 + 0.5);
    for time_s in times {
        let state = seek(&mut player, time_s);
        let tick = state.now.tick;
        assert_eq!(decisions(&state).len(), told[&tick].len(), "at {time_s} s of each vehicle");
        yields += usize::from(yielding(&state).is_some());
        for shown in decisions(&state) {
            // Decisions are looked at ten times a second.
            let lately = tick.saturating_sub(11).max(1)..=tick;
            let was: Vec<Why> =
                told.range(lately).filter_map(|(_, told)| told.get(&shown.vehicle).copied()).collect();
            assert!(was.contains(&(shown.reason, shown.other)), "at {time_s} s: {shown:?}, it was {was:?}");
            compared += 1;
        }
    }
    assert!(yields > 50, "{yields}");
    assert_eq!(compared, 290 * experiment.vehicles.len(), "of each vehicle at each time");
    is_simulated_again(&log);
}

#[test]
fn logs_tell_decisions_as_often_as_they_say() {
    let folder = tempfile::tempdir().unwrap();
    let experiment = scenario("roundabout", 10.0);
    record(&experiment, folder.path());
    let mut log = LogReader::open(&folder.path().join("run.mcap")).unwrap();
    let mut last: BTreeMap<VehicleId, (f64, Why)> = BTreeMap::new();
    let mut entries = 0;
    while let Some(entry) = log.read().unwrap() {
        let LogEntry::Decisions(told) = entry else { continue };
        entries += 1;
        assert!(told.decisions.is_sorted_by_key(|decision| decision.vehicle));
        for decision in told.decisions {
            let why = (decision.reason, decision.other);
            if let Some((before_s, before)) = last.insert(decision.vehicle, (told.time_s, why)) {
                let passed_s = told.time_s - before_s;
                assert!(
                    passed_s < 0.501 && (passed_s > 0.499 || before != why),
                    "{passed_s} s: {decision:?}"
                );
            }
        }
    }
    assert!(entries > 20, "{entries}");
    assert!(last.values().all(|(told_s, _)| *told_s > 9.4), "{last:?}");
}

pub fn client(director: &Director) -> Client {
    let mut client = Client::on(&director.lab.network.host(), CITY, 0, Authenticator::Checksum).unwrap();
    let until = director.lab.network.host().clock.now() + Duration::from_secs(5);
    client.send(&Body::Hello { token: 0 });
    while director.lab.network.host().clock.now() < until {
        match client.receive(Duration::from_millis(100)) {
            Some(ClientEvent::Body(Body::Clock(_))) => return client,
            _ => _ = client.send(&Body::Hello { token: 0 }),
        }
    }
    panic!("the city does not answer");
}

#[test]
fn a_stranger_tells_nothing_and_is_counted() {
    let lab = Lab::new(SimulatedOptions::default());
    let experiment = scenario("roundabout", 60.0);
    let (city, far) = (lab.serve(&experiment, serving(), None), lab.mainframe(&experiment, None));
    let served = city.clone();
    lab.direct(move |director| {
        let now = director.until(&city, "do they drive", |told| told.driving() >= 5);
        city.order(Order::TellDecisions(true));
        director.wait("decisions", || (decisions(&city.run_state()).len() >= 5).then_some(()));
        let vehicle = now.snapshot.vehicles[0].id;
        let mut stranger = client(director);
        for tries in 1..=20 {
            let one = VehicleDecision {
                vehicle,
                reason: DecisionReason::OffRoute,
                other: None,
                place: None,
                target_mps: 0.0,
                acceleration_mps2: 0.0,
                longitudinal_error_m: 0.0,
            };
            let none = VehicleDecision { vehicle: VehicleId(60_000 + tries), ..one };
            let time_s = city.last().snapshot.time_s;
            stranger.send(&Body::Decisions(Decisions { time_s, vehicles: vec![one, none] }));
            stranger.send(&Body::Decisions(Decisions { time_s: time_s + 1e6, vehicles: vec![one] }));
            stranger.send(&Body::ShownDecisions(Decisions { time_s, vehicles: vec![one] }));
            director.pass(0.05);
            let told = city.run_state();
            assert!(decisions(&told).iter().all(|told| told.reason != DecisionReason::OffRoute));
        }
        [far, city].iter().for_each(|program| director.end(program));
    });
    let dropped = served.summary().link.unwrap().dropped;
    let counted = [DropReason::NotYours, DropReason::UnknownVehicle, DropReason::Ahead, DropReason::WrongWay]
        .map(|reason| dropped.of(reason));
    assert_eq!(counted, [20; 4], "{dropped:?}");
}
