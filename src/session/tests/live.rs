//! A run on its own thread: started, paused, stepped, reset, paced, driven by a person, and its log.
#![allow(clippy::unwrap_used, reason = "a test may end where it finds something wrong")]
#![allow(
    clippy::disallowed_types,
    clippy::disallowed_methods,
    reason = "looks at what a run came to; no state depends on it"
)]

#[allow(dead_code, reason = "each test uses its own part")]
#[path = "../../../tests/support/live.rs"]
mod support;

use city3d_logbook::record::read_commands;
use city3d_protocol::snapshot::{FrameSnapshot, Pedals, Status, VehicleId};
use city3d_session::playback::{MarkKind, Occurrence, PastPlayer, PlaybackCommand, Player, TimelineMark};
use city3d_session::{
    EventReader, Order, RunGoal, RunHistory, RunPhase, RunState, RunTraffic, SessionHandle, Speed,
    TrafficRecorder, decisions,
};
use city3d_simulation::runner::Run;
use city3d_simulation::scenario::{Experiment, Library, Overrides, read_experiment};
use std::cell::RefCell;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};
use support::{roundabout, until};

fn live(folder: Option<&Path>) -> SessionHandle {
    support::live(roundabout(40.0), folder)
}

/// The roundabout with its control zone.
fn coordinated() -> Arc<Experiment> {
    let (text, library) = Library::scenario("roundabout-coordinated").unwrap();
    Arc::new(read_experiment("test", &text, &library, Overrides::default()).unwrap())
}

/// The same run in lockstep, up to a tick.
fn reference(tick: u64) -> FrameSnapshot {
    let mut run = Run::new(roundabout(40.0)).unwrap();
    while run.snapshot().tick < tick {
        run.step();
    }
    run.snapshot().clone()
}

#[test]
fn it_waits_to_be_started_and_stands_while_paused() {
    let live = live(None);
    std::thread::sleep(Duration::from_millis(50));
    assert_eq!((live.run_state().phase.clone(), live.run_state().now.tick), (RunPhase::Ready, 0));
    live.send(Order::Start);
    until(&live, "running", |run_state| run_state.phase == RunPhase::Running && run_state.now.tick > 5);
    live.send(Order::Pause);
    let paused = until(&live, "paused", |run_state| run_state.phase == RunPhase::Paused);
    std::thread::sleep(Duration::from_millis(100));
    assert_eq!(live.run_state().now.tick, paused.now.tick);
    assert_eq!(paused.interpolation_weight(Instant::now()), 1.0, "what stands is seen where it is");
    assert_eq!(paused.now.state_hash, reference(paused.now.tick).state_hash);
    live.stop().unwrap();
}

#[test]
fn a_step_is_exactly_one_tick() {
    let live = live(None);
    for tick in 1..=5 {
        live.send(Order::Step);
        let run_state = until(&live, "a step", |run_state| run_state.now.tick >= tick);
        assert_eq!((run_state.now.tick, run_state.phase.clone()), (tick, RunPhase::Paused));
        assert_eq!(run_state.before.tick, tick - 1);
    }
    assert_eq!(live.run_state().now.state_hash, reference(5).state_hash);
}

#[test]
fn after_a_reset_the_run_is_the_first_one_again() {
    let live = live(None);
    let first = live.run_state().now.state_hash;
    live.send(Order::Drive(VehicleId(1), Pedals { gas: 1.0, ..Pedals::default() }));
    live.send(Order::Speed(Speed::Unlimited));
    live.send(Order::Start);
    until(&live, "far on", |run_state| run_state.now.tick > 300);
    live.send(Order::Reset);
    let again = until(&live, "reset", |run_state| run_state.phase == RunPhase::Ready);
    assert_eq!((again.now.tick, again.now.state_hash, again.run), (0, first, 2));
    assert_eq!(again.before.tick, 0);
    for _ in 0..30 {
        live.send(Order::Step);
    }
    let run_state = until(&live, "30 steps", |run_state| run_state.now.tick == 30);
    assert_eq!(run_state.now.state_hash, reference(30).state_hash, "nobody drives by hand any more");
}

#[test]
fn as_fast_as_possible_comes_to_the_end_and_can_go_on_beyond() {
    let live = support::live(roundabout(5.0), None);
    live.send(Order::Speed(Speed::Unlimited));
    live.send(Order::Start);
    let over = until(&live, "the end", |run_state| run_state.phase == RunPhase::Over);
    assert_eq!(over.now.tick, 500);
    assert_eq!(over.now.state_hash, reference(500).state_hash);
    live.send(Order::Start);
    until(&live, "beyond the end", |run_state| run_state.now.tick > 600);
}

#[test]
fn a_reader_hears_each_event_of_the_run_once_however_fast_it_goes() {
    let live = live(None);
    let reader = RefCell::new(EventReader::default());
    live.send(Order::Drive(VehicleId(6), Pedals::default()));
    live.send(Order::Release(VehicleId(6)));
    live.send(Order::Speed(Speed::Unlimited));
    live.send(Order::Start);
    until(&live, "far on", |run_state| {
        reader.borrow_mut().read(&run_state.events);
        run_state.now.tick > 1000
    });
    let mut reader = reader.into_inner();
    let over = until(&live, "the end", |run_state| run_state.phase == RunPhase::Over);
    reader.read(&over.events);
    let known = reader.read(&over.events);
    assert_eq!(known, reader.marks().len(), "nothing is told twice");
    let mut run = Run::new(roundabout(40.0)).unwrap();
    let mut recorder = TrafficRecorder::new(run.experiment());
    recorder.observe(Some(run.mainframe()), run.snapshot());
    let (mut expected, mut merges) = (Vec::new(), 0);
    while run.snapshot().tick < over.now.tick {
        run.step();
        let found = recorder.observe(Some(run.mainframe()), run.snapshot());
        merges += found.len();
        expected
            .extend(run.snapshot().events.iter().chain(&found).map(|event| (event.time_s, event.vehicle)));
    }
    let told_merges = reader.marks().iter().filter(|mark| mark.what.kind() == MarkKind::Merge).count();
    assert!(merges > 2 && told_merges == merges, "{told_merges} of {merges}");
    let (of_person, of_city): (Vec<_>, Vec<_>) =
        reader.marks().iter().partition(|mark| mark.what.kind() == MarkKind::Person);
    let of_city: Vec<_> = of_city.iter().map(|mark| (mark.time_s, mark.vehicle)).collect();
    let ticks = |events: &[(f64, VehicleId)]| events.iter().filter(|(time_s, _)| *time_s > 0.0).count();
    assert!(ticks(&expected) > 10 && ticks(&of_city) == ticks(&expected), "{of_city:?} {expected:?}");
    assert!(of_person.iter().all(|mark| mark.vehicle == VehicleId(6)), "{of_person:?}");
    live.send(Order::Reset);
    let again = until(&live, "reset", |run_state| run_state.phase == RunPhase::Ready);
    assert_eq!((reader.read(&again.events), reader.marks().len()), (0, 0));
}

/// The numbers of the panel Traffic.
fn numbers(traffic: &RunTraffic) -> [f64; 6] {
    let measures = traffic.measures();
    let (trips, safety) = (measures.trips(), measures.safety());
    [
        f64::from(trips.stops),
        trips.mean_delay_s.unwrap_or(-1.0),
        trips.throughput_per_h.unwrap_or(-1.0),
        measures.queue().mean(),
        measures.effort().fuel_ml,
        safety.min_ttc_s.unwrap_or(-1.0),
    ]
}

/// The traffic of the same run, measured at every step up to a time.
fn measured(until_s: f64) -> RunTraffic {
    let mut run = Run::new(roundabout(40.0)).unwrap();
    let mut recorder = TrafficRecorder::new(run.experiment());
    recorder.observe(Some(run.mainframe()), run.snapshot());
    while run.snapshot().time_s < until_s - 1e-6 {
        run.step();
        recorder.observe(Some(run.mainframe()), run.snapshot());
    }
    recorder.traffic()
}

#[test]
fn the_traffic_is_that_of_every_step_however_fast_the_run_goes() {
    let live = live(None);
    assert!(live.run_state().traffic.is_none());
    live.send(Order::Speed(Speed::Unlimited));
    live.send(Order::Start);
    let over = until(&live, "the end", |run_state| run_state.phase == RunPhase::Over);
    let (traffic, expected) = (over.traffic.clone().unwrap(), measured(over.now.time_s));
    assert_eq!((traffic.since_s(), traffic.until_s()), (Some(0.0), over.now.time_s));
    assert_eq!(numbers(&traffic), numbers(&expected));
    assert!(numbers(&traffic)[0] > 0.0 && numbers(&traffic)[4] > 1.0, "{:?}", numbers(&traffic));
    let places = |traffic: &RunTraffic| traffic.places().map(|(_, places)| places.len()).sum::<usize>();
    assert_eq!(places(&traffic), places(&expected), "its diagram has no holes");
    live.send(Order::Reset);
    let again = until(&live, "reset", |run_state| run_state.phase == RunPhase::Ready);
    assert!(again.traffic.is_none());
}

/// Plays a log until all that is on display is known.
fn settle(player: &mut Player) -> Arc<RunState> {
    let start = Instant::now();
    loop {
        let (state, _) = player.advance(Instant::now());
        let is_measured =
            state.traffic.as_ref().is_some_and(|traffic| (traffic.until_s() - state.now.time_s).abs() < 1e-6);
        if player.is_settled() && player.info().searched >= 1.0 && is_measured {
            return state;
        }
        assert!(start.elapsed() < Duration::from_secs(60), "it is never known");
        std::thread::sleep(Duration::from_millis(1));
    }
}

#[test]
fn a_log_has_the_events_and_the_traffic_of_its_run_at_whatever_time_one_looks() {
    let folder = tempfile::tempdir().unwrap();
    let live = live(Some(folder.path()));
    live.send(Order::Speed(Speed::Unlimited));
    live.send(Order::Start);
    let over = until(&live, "the end", |run_state| run_state.phase == RunPhase::Over);
    let mut reader = EventReader::default();
    reader.read(&over.events);
    live.stop().unwrap();
    let mut player = Player::open(&folder.path().join("run-1/run.mcap"), Box::new(|| {})).unwrap();
    player.show_traffic(true);
    player.command(PlaybackCommand::Seek(40.0));
    let end = settle(&mut player);
    let in_order = |marks: &[TimelineMark]| {
        // Where vehicles stand at the start is no event of the log.
        let during = marks.iter().filter(|mark| mark.time_s > 0.0);
        let mut marks: Vec<_> = during
            .map(|mark| ((mark.time_s * 100.0).round() as u64, mark.vehicle, mark.what.kind()))
            .collect();
        marks.sort();
        marks
    };
    let (of_log, of_run) = (in_order(&player.info().marks), in_order(reader.marks()));
    assert_eq!(of_log, of_run);
    let to_whom = |marks: &[TimelineMark]| -> Vec<(VehicleId, VehicleId)> {
        let told = marks.iter().filter_map(|mark| match mark.what {
            Occurrence::YieldTo(other) => Some((mark.vehicle, other)),
            _ => None,
        });
        told.collect()
    };
    let (of_log, of_run) = (to_whom(&player.info().marks), to_whom(reader.marks()));
    assert!(!of_run.is_empty() && of_run.iter().all(|told| of_log.contains(told)), "{of_run:?} {of_log:?}");
    // A log has fewer states than the run has steps.
    let is_close = |traffic: &RunTraffic, expected: &RunTraffic| {
        numbers(traffic)
            .iter()
            .zip(numbers(expected))
            .take(5)
            .all(|(a, b)| (a - b).abs() <= 0.02 * b.abs() + 0.05)
    };
    let live_traffic = over.traffic.clone().unwrap();
    let traffic = end.traffic.clone().unwrap();
    assert!(is_close(&traffic, &live_traffic), "{:?} {:?}", numbers(&traffic), numbers(&live_traffic));
    for at_s in [12.0, 31.0, 3.0] {
        player.command(PlaybackCommand::Seek(at_s));
        let (traffic, expected) = (settle(&mut player).traffic.clone().unwrap(), measured(at_s));
        assert!(is_close(&traffic, &expected), "{at_s} s: {:?} {:?}", numbers(&traffic), numbers(&expected));
    }
}

#[test]
fn who_looks_back_is_told_why_vehicles_did_what_they_did() {
    let live = live(None);
    live.send(Order::Speed(Speed::Unlimited));
    live.send(Order::RunUntil(RunGoal::Time(20.0)));
    let paused = until(&live, "20 s", |run_state| run_state.phase == RunPhase::Paused);
    let mut history = RunHistory::default();
    history.read(&paused.history);
    let mut past = PastPlayer::default();
    past.command(PlaybackCommand::Seek(12.0), &paused, &history);
    let (shown, _) = past.advance(Instant::now(), &paused, &history, &roundabout(40.0)).unwrap();
    let told = shown.insight.as_ref().and_then(|insight| insight.decisions.clone()).unwrap();
    let mut run = Run::new(roundabout(40.0)).unwrap();
    while run.snapshot().tick < 1200 {
        run.step();
    }
    let expected = decisions(run.mainframe(), run.experiment());
    let same = |told: &city3d_protocol::snapshot::ControlDecision| {
        expected
            .iter()
            .any(|now| (now.vehicle, now.reason, now.other) == (told.vehicle, told.reason, told.other))
    };
    assert_eq!(told.len(), expected.len());
    // A decision may change between two samples.
    assert!(told.iter().filter(|told| same(told)).count() + 1 >= told.len(), "{told:?} {expected:?}");
}

#[test]
fn a_run_goes_on_up_to_a_time_or_an_event_and_pauses_exactly_there() {
    let live = live(None);
    live.send(Order::Speed(Speed::Unlimited));
    live.send(Order::RunUntil(RunGoal::Time(2.345)));
    let paused = until(&live, "the time", |run_state| run_state.phase == RunPhase::Paused);
    assert_eq!((paused.now.tick, paused.goal), (235, None));
    assert_eq!(paused.now.state_hash, reference(235).state_hash);
    live.send(Order::RunUntil(RunGoal::Time(1.0)));
    let refused = until(&live, "the refusal", |run_state| run_state.refusal.is_some());
    assert_eq!(refused.refusal.as_ref().unwrap().1.as_ref(), "the run is at 2.35 s already");
    live.send(Order::RunUntil(RunGoal::Event(Some(MarkKind::Stop))));
    let stopped = until(&live, "the event", |run_state| {
        run_state.phase == RunPhase::Paused && run_state.now.tick > 235
    });
    let mut reader = EventReader::default();
    reader.read(&stopped.events);
    let stops: Vec<f64> =
        reader.marks().iter().filter(|mark| mark.what.kind() == MarkKind::Stop).map(|m| m.time_s).collect();
    assert_eq!(stops, [stopped.now.time_s], "the first stop of the run, at its tick");
    // Whoever starts it by hand has no goal any more.
    live.send(Order::RunUntil(RunGoal::Time(30.0)));
    live.send(Order::Start);
    until(&live, "the end", |run_state| run_state.phase == RunPhase::Over);
}

#[test]
fn the_past_of_a_run_is_kept_from_its_start_without_a_log_and_ends_with_it() {
    let live = live(None);
    live.send(Order::Speed(Speed::Unlimited));
    live.send(Order::RunUntil(RunGoal::Time(20.0)));
    let paused = until(&live, "20 s", |run_state| run_state.phase == RunPhase::Paused);
    let mut history = RunHistory::default();
    history.read(&paused.history);
    let times: Vec<f64> = history.states().iter().map(|state| state.time_s()).collect();
    assert!(times.len() == 201 && times[0] == 0.0, "{times:?}");
    assert!(times.windows(2).all(|pair| (pair[1] - pair[0] - 0.1).abs() < 1e-6), "{times:?}");
    let then = history.states()[73].snapshot(&roundabout(40.0));
    let wanted = reference(730);
    assert_eq!((then.tick, then.state_hash, &then.roster), (730, wanted.state_hash, &wanted.roster));
    for (kept, was) in then.vehicles.iter().zip(&wanted.vehicles) {
        assert_eq!((kept.position, kept.status), (was.position, was.status));
        assert!((kept.speed_mps - was.speed_mps).abs() < 1e-5 && (kept.gas - was.gas).abs() < 1e-6);
    }
    live.send(Order::Reset);
    let again = until(&live, "reset", |run_state| run_state.phase == RunPhase::Ready);
    history.read(&again.history);
    assert_eq!(history.states().len(), 0);
}

#[test]
fn poses_between_ticks_follow_the_clock() {
    let live = live(None);
    live.send(Order::Speed(Speed::times(0.1)));
    live.send(Order::Start);
    let run_state = until(&live, "two ticks", |run_state| run_state.now.tick > 2);
    let clock = run_state.clock.unwrap();
    // A tick takes 100 ms at this speed, and the run is never behind by more than one.
    let now = Instant::now();
    assert!(run_state.interpolation_weight(now + clock.until(now, run_state.now.time_s)) > 0.999);
    let middle = (run_state.before.time_s + run_state.now.time_s) / 2.0;
    if clock.simulated_s(now) < middle {
        let weight = run_state.interpolation_weight(now + clock.until(now, middle));
        assert!((weight - 0.5).abs() < 0.01, "{weight}");
    }
    assert_eq!(run_state.now.tick - run_state.before.tick, 1);
}

#[test]
fn what_a_person_commands_is_in_the_log_and_makes_the_run_again() {
    let folder = tempfile::tempdir().unwrap();
    let live = live(Some(folder.path()));
    live.send(Order::Speed(Speed::times(10.0)));
    live.send(Order::Start);
    let vehicle = VehicleId(1);
    until(&live, "two seconds", |run_state| run_state.now.tick > 200);
    for gas in [0.1, 0.3, 1.0 / 3.0] {
        let pedals = Pedals { gas, steering_rad: 0.013 * gas, ..Pedals::default() };
        live.send(Order::Drive(vehicle, pedals));
        until(&live, "the pedal", |run_state| run_state.now.vehicle(vehicle).unwrap().gas == gas);
    }
    let taken = live.run_state().now.tick;
    let manual = until(&live, "some way by hand", |run_state| run_state.now.tick > taken + 30);
    assert_eq!(manual.now.vehicle(vehicle).unwrap().status, Status::Manual);
    live.send(Order::Release(vehicle));
    until(&live, "given back", |run_state| run_state.now.vehicle(vehicle).unwrap().status != Status::Manual);
    live.send(Order::Pause);
    let last = until(&live, "paused", |run_state| run_state.phase == RunPhase::Paused);
    // Closed in mid-run: the files are whole.
    live.stop().unwrap();

    let folder = folder.path().join("run-1");
    let commands = read_commands(&folder.join("run.mcap")).unwrap();
    assert_eq!(commands.len(), 4, "{commands:?}");
    let mut again = Run::new(roundabout(40.0)).unwrap();
    while again.snapshot().tick < last.now.tick {
        let tick = again.snapshot().tick;
        for (_, command) in commands.iter().filter(|(at, _)| *at == tick) {
            again.inject(command.clone());
        }
        again.step();
    }
    assert_eq!(again.snapshot().state_hash, last.now.state_hash);
    assert_ne!(reference(last.now.tick).state_hash, last.now.state_hash, "the person changed the run");
    let summary: serde_json::Value =
        serde_json::from_slice(&std::fs::read(folder.join("summary.json")).unwrap()).unwrap();
    assert_eq!(summary["state_hash"], format!("{:016x}", last.now.state_hash));
    let table = std::fs::read_to_string(folder.join("vehicles.csv")).unwrap();
    let mut rows = table.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let column = rows.next().unwrap().iter().position(|name| *name == "lateral_error").unwrap();
    let (by_hand, driven): (Vec<_>, Vec<_>) = rows.partition(|row| row.contains(&"manual"));
    assert!(!by_hand.is_empty(), "the table tells who drove");
    assert!(by_hand.iter().all(|row| row[column].is_empty()), "nobody told the person what path to follow");
    assert!(driven.iter().all(|row| !row[column].is_empty()));
}

#[test]
fn each_run_has_its_files_and_one_that_never_began_has_none() {
    let folder = tempfile::tempdir().unwrap();
    let recorded = live(Some(folder.path()));
    recorded.send(Order::Step);
    until(&recorded, "a step", |run_state| run_state.now.tick == 1);
    recorded.send(Order::Reset);
    recorded.send(Order::Step);
    let second = until(&recorded, "a step of the second run", |run_state| {
        run_state.run == 2 && run_state.now.tick == 1
    });
    assert_eq!(second.folder.as_deref(), Some(folder.path().join("run-2").as_path()));
    recorded.send(Order::Reset);
    until(&recorded, "a third run", |run_state| run_state.run == 3);
    recorded.stop().unwrap();
    for run in ["run-1", "run-2"] {
        assert!(read_commands(&folder.path().join(run).join("run.mcap")).unwrap().is_empty(), "{run}");
        assert!(folder.path().join(run).join("summary.json").is_file(), "{run}");
    }
    assert!(!folder.path().join("run-3").exists());
}

#[test]
fn a_folder_that_cannot_be_written_is_named_and_the_city_drives_on() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("taken");
    std::fs::write(&file, "a file").unwrap();
    let live = live(Some(&file));
    live.send(Order::Start);
    let failed =
        until(&live, "the failure", |run_state| run_state.ends.iter().any(|end| end.failure.is_some()));
    let failure = failed.ends.iter().find_map(|end| end.failure.clone()).unwrap();
    assert!(failure.contains("taken"), "{failure}");
    until(&live, "further ticks", |run_state| run_state.now.tick > failed.now.tick + 10);
    let written = live.stop().unwrap();
    assert!(written.failure.unwrap().to_string().contains("taken"));
}

#[test]
fn plans_are_told_to_who_asks_and_change_nothing() {
    let live = support::live(coordinated(), None);
    for tick in 1..=600 {
        live.send(Order::Step);
        until(&live, "a step", |run_state| run_state.now.tick >= tick);
    }
    assert_eq!(live.run_state().coordination, None, "nobody has asked");
    live.send(Order::TellPlans(true));
    let told = until(&live, "plans", |run_state| run_state.coordination.is_some());
    let vehicles = &told.coordination.as_ref().unwrap().vehicles;
    assert!(vehicles.iter().filter(|vehicle| vehicle.plan.is_ok()).count() >= 2, "{vehicles:?}");
    let mut run = Run::new(coordinated()).unwrap();
    while run.snapshot().tick < 601 {
        run.step();
    }
    live.send(Order::Step);
    let stepped = until(&live, "a step", |run_state| run_state.now.tick == 601);
    assert_eq!(stepped.now.state_hash, run.snapshot().state_hash);
    live.send(Order::TellPlans(false));
    until(&live, "no plans", |run_state| run_state.coordination.is_none());
    live.stop().unwrap();
}

#[test]
fn who_leaves_the_road_is_told_while_it_runs_and_by_its_log() {
    let folder = tempfile::tempdir().unwrap();
    let live = support::live(roundabout(12.0), Some(folder.path()));
    let pedals = Pedals { gas: 0.6, steering_rad: 0.25, ..Pedals::default() };
    live.send(Order::Drive(VehicleId(3), pedals));
    live.send(Order::Speed(Speed::Unlimited));
    live.send(Order::Start);
    let over = until(&live, "the end", |run_state| run_state.phase == RunPhase::Over);
    let mut reader = EventReader::default();
    reader.read(&over.events);
    live.stop().unwrap();
    let left = |marks: &[TimelineMark]| -> Vec<(VehicleId, f64)> {
        let told = marks.iter().filter(|mark| mark.what == Occurrence::LeftRoad);
        told.map(|mark| (mark.vehicle, mark.time_s)).collect()
    };
    let of_run = left(reader.marks());
    let [(VehicleId(3), time_s)] = of_run[..] else { panic!("{of_run:?} of {:?}", reader.marks()) };
    let mut player = Player::open(&folder.path().join("run-1/run.mcap"), Box::new(|| {})).unwrap();
    player.show_traffic(true);
    player.command(PlaybackCommand::Seek(12.0));
    settle(&mut player);
    let of_log = left(&player.info().marks);
    // A log has fewer states than the run has steps.
    assert!(
        matches!(of_log[..], [(VehicleId(3), at_s)] if (at_s - time_s).abs() < 0.1),
        "{of_log:?}, {of_run:?}"
    );
}
