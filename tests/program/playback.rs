//! Recorded runs that are watched: at any time, forwards and backwards, from no more than is needed of the log.

use crate::support::live;

use city3d_logbook::record::{LogEntry, LogOrigin, LogReader, LogWriter};
use city3d_protocol::snapshot::{Event, FrameSnapshot, Pedals, SimCommand, VehicleId};
use city3d_session::RunHistory;
use city3d_session::playback::{Occurrence, PlaybackCommand, PlaybackError, Player, Playhead};
use city3d_simulation::runner::Run;
use live::roundabout;
use std::fs::File;
use std::io::BufWriter;
use std::path::Path;
use std::time::{Duration, Instant};

/// Records some seconds of the roundabout, snapshots at every other tick, chunks of a second; gives its snapshots and
/// its events. A person drives the third car for a second.
fn record(log: &Path, seconds: u64, origin: LogOrigin) -> (Vec<FrameSnapshot>, Vec<Event>) {
    let mut run = Run::new(roundabout(seconds as f64)).unwrap();
    let sink = BufWriter::new(File::create(log).unwrap());
    let mut writer = LogWriter::new(sink, run.experiment(), origin, &std::env::temp_dir()).unwrap();
    let (mut snapshots, mut events) = (Vec::new(), Vec::new());
    loop {
        let snapshot = run.snapshot().clone();
        for event in &snapshot.events {
            writer.event(event).unwrap();
            events.push(event.clone());
        }
        writer.tick(snapshot.tick, snapshot.time_s, snapshot.state_hash).unwrap();
        if snapshot.tick.is_multiple_of(2) {
            writer.snapshot(&snapshot).unwrap();
            snapshots.push(snapshot.clone());
        }
        if snapshot.tick.is_multiple_of(100) {
            writer.flush().unwrap();
        }
        if snapshot.tick == seconds * 100 {
            break;
        }
        match snapshot.tick {
            100..200 => run.inject(SimCommand::Drive(VehicleId(3), Pedals { gas: 0.3, ..Pedals::default() })),
            200 => run.inject(SimCommand::Release(VehicleId(3))),
            _ => {}
        }
        run.step();
        for command in run.commands() {
            writer.command(snapshot.tick, snapshot.time_s, command).unwrap();
        }
    }
    writer.finish().unwrap();
    (snapshots, events)
}

fn open(log: &Path) -> Player {
    Player::open(log, Box::new(|| {})).unwrap()
}

/// Waits until what is wanted at an instant is shown.
fn look(player: &mut Player, now: Instant) -> (std::sync::Arc<city3d_session::RunState>, f64) {
    let start = Instant::now();
    loop {
        let seen = player.advance(now);
        if !player.is_late() {
            return seen;
        }
        assert!(start.elapsed() < Duration::from_secs(60), "never read: {:?}", player.head());
        std::thread::sleep(Duration::from_millis(1));
    }
}

fn go(player: &mut Player, cue: PlaybackCommand) -> std::sync::Arc<city3d_session::RunState> {
    player.command(cue);
    look(player, Instant::now()).0
}

fn settle(player: &mut Player) {
    let start = Instant::now();
    // The thread is idle too before the first chunk is requested.
    player.advance(start);
    while !player.is_settled() {
        player.advance(Instant::now());
        assert!(start.elapsed() < Duration::from_secs(60), "it never comes to rest");
        std::thread::sleep(Duration::from_millis(1));
    }
}

#[test]
fn what_is_shown_is_what_was_recorded_at_any_time() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("run.mcap");
    let (snapshots, _) = record(&log, 8, LogOrigin::Run);
    let mut player = open(&log);
    assert_eq!((player.head().from_s, player.head().to_s, player.run_state().now.tick), (0.0, 8.0, 0));
    for wanted in [399, 0, 251, 250, 400, 1, 73] {
        let recorded = &snapshots[wanted];
        // Nearer to this snapshot than to any other.
        let run_state = go(&mut player, PlaybackCommand::Seek(recorded.time_s + 0.007));
        let shown = &run_state.now;
        assert_eq!((shown.tick, shown.time_s), (recorded.tick, recorded.time_s));
        assert_eq!((shown.state_hash, &shown.roster), (recorded.state_hash, &recorded.roster));
        assert_eq!(run_state.before.tick, recorded.tick.saturating_sub(2));
        for (shown, recorded) in shown.vehicles.iter().zip(&recorded.vehicles) {
            assert_eq!((shown.position, shown.status), (recorded.position, recorded.status));
            assert!((shown.speed_mps - recorded.speed_mps).abs() < 1e-5);
            for (wheel, rolled) in shown.wheels.iter().zip(&recorded.wheels) {
                assert!((wheel.steer_rad - rolled.steer_rad).abs() < 1e-5, "{wheel:?} {rolled:?}");
                // The log leaves the suspension out; it follows from the body's pose.
                assert!((wheel.lift_m - rolled.lift_m).abs() < 0.01, "{wheel:?} {rolled:?}");
            }
        }
    }
}

/// Plays for some passes of so many milliseconds, on a clock of its own.
fn play(
    player: &mut Player,
    now: &mut Instant,
    cue: PlaybackCommand,
    (passes, pass_ms): (u32, u64),
) -> Playhead {
    player.command(cue);
    look(player, *now);
    for _ in 0..passes {
        *now += Duration::from_millis(pass_ms);
        look(player, *now);
    }
    player.head()
}

#[test]
fn it_plays_at_its_speed_both_ways_between_snapshots_and_stands_at_the_ends() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("run.mcap");
    let (snapshots, _) = record(&log, 6, LogOrigin::Run);
    let mut player = open(&log);
    let mut now = Instant::now();
    player.command(PlaybackCommand::Speed(0.5));
    let head = play(&mut player, &mut now, PlaybackCommand::Play, (9, 10));
    assert!(head.is_playing && (head.at_s - 0.045).abs() < 1e-9, "{head:?}");
    // Between the snapshots at 0.04 and 0.06 s.
    let (run_state, weight) = player.advance(now);
    assert_eq!((run_state.before.tick, run_state.now.tick), (4, 6));
    assert!((weight - 0.25).abs() < 1e-6, "{weight}");
    let mut between = FrameSnapshot::default();
    between.blend(&run_state.before, &run_state.now, weight);
    let (from, to) = (snapshots[2].vehicles[0].position, snapshots[3].vehicles[0].position);
    assert!(between.vehicles[0].position.distance(from.lerp(to, 0.25)) < 1e-6);

    player.command(PlaybackCommand::Speed(10.0));
    let head = play(&mut player, &mut now, PlaybackCommand::Play, (2, 200));
    assert!((head.at_s - 4.045).abs() < 1e-6, "{head:?}");
    let head = play(&mut player, &mut now, PlaybackCommand::Reverse, (1, 150));
    assert!(head.is_playing && (head.at_s - 2.545).abs() < 1e-6, "{head:?}");
    let (run_state, weight) = player.advance(now);
    assert_eq!((run_state.before.tick, run_state.now.tick), (254, 256));
    assert!((weight - 0.25).abs() < 1e-6, "{weight}");
    // Backwards to the start: it stands there, and forwards to the end.
    let head = play(&mut player, &mut now, PlaybackCommand::Reverse, (4, 200));
    assert!(!head.is_playing && head.at_s == 0.0, "{head:?}");
    let head = play(&mut player, &mut now, PlaybackCommand::Play, (4, 200));
    assert!(!head.is_playing && head.at_s == 6.0, "{head:?}");
    assert_eq!(player.run_state().now.tick, 600);
    // From there it begins again.
    let head = play(&mut player, &mut now, PlaybackCommand::Play, (1, 100));
    assert!(head.is_playing && (head.at_s - 1.0).abs() < 1e-6, "{head:?}");
    // Held, it stands at a recorded snapshot; steps go from one to the next.
    let run_state = go(&mut player, PlaybackCommand::Pause);
    assert_eq!((run_state.now.tick, player.head().is_playing), (100, false));
    assert_eq!(go(&mut player, PlaybackCommand::Step { forward: true }).now.tick, 102);
    assert_eq!(go(&mut player, PlaybackCommand::Step { forward: false }).now.tick, 100);
    assert_eq!(go(&mut player, PlaybackCommand::Step { forward: false }).now.tick, 98);
}

#[test]
fn all_that_happened_is_known_and_can_be_jumped_to() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("run.mcap");
    let (_, events) = record(&log, 15, LogOrigin::Run);
    let mut player = open(&log);
    settle(&mut player);
    let told = player.info();
    assert_eq!((told.searched, &told.truncation), (1.0, &None));
    let found: Vec<_> = told.marks.iter().filter(|mark| matches!(mark.what, Occurrence::Event(_))).collect();
    assert!(events.len() > 10 && found.len() == events.len(), "{} of {}", found.len(), events.len());
    for (mark, event) in found.iter().zip(&events) {
        assert_eq!((mark.time_s, mark.vehicle), (event.time_s, event.vehicle));
        assert_eq!(mark.what, Occurrence::Event(event.kind.clone()));
    }
    let persons: Vec<_> =
        told.marks.iter().filter(|mark| !matches!(mark.what, Occurrence::Event(_))).collect();
    let of = |k: usize| (persons[k].time_s, persons[k].vehicle.0, &persons[k].what);
    assert_eq!(
        (persons.len(), of(0), of(1)),
        (2, (1.0, 3, &Occurrence::TakeOver), (2.0, 3, &Occurrence::GiveBack))
    );
    for mark in told.marks.iter() {
        let now = go(&mut player, PlaybackCommand::Show(mark.time_s)).now.time_s;
        assert!((mark.time_s - 1e-9..mark.time_s + 0.02).contains(&now), "{now} for {}", mark.time_s);
    }
}

#[test]
fn no_more_is_decoded_than_is_shown_and_memory_is_bounded() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("run.mcap");
    record(&log, 40, LogOrigin::Run);
    let mut player = open(&log);
    settle(&mut player);
    let opened = player.stats();
    assert!(opened.chunks >= 40 && opened.decoded <= 5, "{opened:?}");
    go(&mut player, PlaybackCommand::Seek(20.0));
    settle(&mut player);
    let jumped = player.stats();
    assert!(jumped.decoded - opened.decoded <= 6, "a jump takes what lies around: {jumped:?}");
    for k in 0..60 {
        go(&mut player, PlaybackCommand::Seek(f64::from(k * 7 % 40)));
        assert!(player.stats().kept <= 600, "{:?}", player.stats());
    }
    // What running plots show of the seconds before is read for them.
    go(&mut player, PlaybackCommand::Seek(35.0));
    let mut history = RunHistory::default();
    player.read_history(&mut history, 30.0);
    player.advance(Instant::now());
    settle(&mut player);
    player.read_history(&mut history, 30.0);
    let past = history.between(5.0, 35.0);
    let times: Vec<f64> = past.iter().map(|state| state.time_s()).collect();
    assert!(times[0] < 5.2 && times[times.len() - 1] > 34.8, "{times:?}");
    assert!((280..=320).contains(&times.len()) && times.is_sorted(), "{}", times.len());
    assert!(past.iter().all(|state| state.vehicle(VehicleId(1)).is_some()));
    // Figures show the whole log.
    player.read_history(&mut history, f64::INFINITY);
    player.advance(Instant::now());
    settle(&mut player);
    player.read_history(&mut history, f64::INFINITY);
    assert!((395..=420).contains(&history.states().len()), "{}", history.states().len());
}

/// Time of the last snapshot, as reading from the start finds it.
fn last_snapshot_s(log: &Path) -> f64 {
    let mut reader = LogReader::open(log).unwrap();
    let mut last_s = 0.0;
    while let Some(entry) = reader.read().unwrap() {
        if let LogEntry::Snapshot(snapshot) = entry {
            last_s = snapshot.time_s;
        }
    }
    last_s
}

#[test]
fn a_torn_log_is_shown_up_to_its_last_whole_record() {
    let folder = tempfile::tempdir().unwrap();
    let (log, cut) = (folder.path().join("run.mcap"), folder.path().join("cut.mcap"));
    record(&log, 10, LogOrigin::Run);
    let bytes = std::fs::read(&log).unwrap();
    let mut ends = Vec::new();
    for part in 1..=16 {
        std::fs::write(&cut, &bytes[..bytes.len() * part / 16 - 3]).unwrap();
        match Player::open(&cut, Box::new(|| {})) {
            Ok(mut player) => {
                assert_eq!(player.head().to_s, last_snapshot_s(&cut), "{part}");
                let end = go(&mut player, PlaybackCommand::Seek(99.0));
                assert_eq!(end.now.time_s, player.head().to_s);
                let is_whole = player.head().to_s == 10.0;
                assert!(
                    is_whole
                        || player.info().truncation.is_some_and(|why| why.contains("middle of a record"))
                );
                ends.push(player.head().to_s);
            }
            Err(error) => {
                assert!(ends.is_empty() && !matches!(error, PlaybackError::Thread(_)), "{part}: {error}");
            }
        }
    }
    assert!(ends.len() > 4 && ends.is_sorted() && ends[0] < 5.0, "{ends:?}");
}

#[test]
fn a_log_that_is_damaged_in_the_middle_ends_there() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("run.mcap");
    record(&log, 10, LogOrigin::Run);
    let mut bytes = std::fs::read(&log).unwrap();
    let middle = bytes.len() * 6 / 10;
    bytes[middle..middle + 64].iter_mut().for_each(|byte| *byte ^= 0x55);
    std::fs::write(&log, bytes).unwrap();
    let mut player = open(&log);
    // A chunk without events is not read before it is shown.
    for at_s in [1.0, 4.0, 5.0, 6.0, 7.0, 1.0] {
        go(&mut player, PlaybackCommand::Seek(at_s));
    }
    settle(&mut player);
    player.advance(Instant::now());
    let (head, told) = (player.head(), player.info());
    assert!(told.truncation.is_some() && (2.0..9.5).contains(&head.to_s), "{head:?} {:?}", told.truncation);
    assert!(told.marks.iter().all(|mark| mark.time_s <= head.to_s + 1.0));
    let end = go(&mut player, PlaybackCommand::Seek(10.0));
    assert!(end.now.time_s <= head.to_s, "{} {head:?}", end.now.time_s);
}

#[test]
fn logs_that_hold_no_world_are_watched_too() {
    for origin in [LogOrigin::Mainframe, LogOrigin::Recorded] {
        let folder = tempfile::tempdir().unwrap();
        let log = folder.path().join("run.mcap");
        let (snapshots, _) = record(&log, 2, origin);
        let mut player = open(&log);
        let run_state = go(&mut player, PlaybackCommand::Seek(1.5));
        assert_eq!((run_state.now.tick, &run_state.now.roster), (150, &snapshots[75].roster), "{origin:?}");
    }
}

#[test]
fn opening_and_jumping_are_measured() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("run.mcap");
    let (_, events) = record(&log, 10, LogOrigin::Run);
    let bench = |jumps: &str| {
        let program = std::process::Command::new(env!("CARGO_BIN_EXE_city3d"))
            .args(["bench", "replay", log.to_str().unwrap(), "--jumps", jumps])
            .output()
            .unwrap();
        assert!(program.status.success(), "{}", String::from_utf8_lossy(&program.stderr));
        serde_json::from_slice::<serde_json::Value>(&program.stdout).unwrap()
    };
    let report = bench("20");
    assert_eq!((&report["jumps"], &report["vehicles"]), (&20.into(), &6.into()));
    let number = |name: &str| report[name].as_f64().unwrap();
    assert!(number("jump_median_ms") > 0.0 && number("jump_median_ms") <= number("jump_p99_ms"), "{report}");
    assert!(number("simulated_s") == 10.0 && number("chunks") >= 10.0, "{report}");
    // And the person who takes a wheel and gives it back.
    assert_eq!(report["events"], events.len() + 2, "{report}");
    assert!(number("played_forwards_x") > 0.5 && number("played_backwards_x") > 0.5, "{report}");
    assert!(number("decoded_chunks") <= 20.0 * 6.0 && number("kept_snapshots") <= 600.0, "{report}");
}

#[test]
fn what_is_no_log_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("run.mcap");
    let refused = |log: &Path| Player::open(log, Box::new(|| {})).unwrap_err().to_string();
    assert!(refused(&log).contains("run.mcap"));
    let sink = BufWriter::new(File::create(&log).unwrap());
    LogWriter::new(sink, &roundabout(1.0), LogOrigin::Run, folder.path()).unwrap().finish().unwrap();
    let said = refused(&log);
    assert!(said.contains("no snapshots"), "{said}");
}
