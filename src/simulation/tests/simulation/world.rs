//! The world as a function of experiment and commands: it repeats, forks, reports collisions when they
//! happen, and looks after vehicles that nobody talks to.

use city3d_dynamics::vehicle::ModelKind;
use city3d_geometry::Pose2;
use city3d_protocol::snapshot::{
    Event, EventKind, FrameSnapshot, Pedals, SimCommand, Status, Trajectory, TrajectoryPoint, VehicleId,
    VehicleState,
};
use city3d_roadmap::dxf::{Drawing, EntityShape};
use city3d_simulation::runner::Run;
use city3d_simulation::scenario::{Experiment, Library, Overrides, read_experiment};
use city3d_simulation::sim::{World, WorldState};
use glam::DVec2;
use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;

const MODELS: [ModelKind; 2] = [ModelKind::Raycast, ModelKind::Bicycle];
const FIRST: VehicleId = VehicleId(1);

fn read(text: &str, model: ModelKind) -> Arc<Experiment> {
    let overrides = Overrides { model: Some(model), ..Overrides::default() };
    let experiment = read_experiment("test", text, &Library::default(), overrides);
    Arc::new(experiment.unwrap_or_else(|error| panic!("{error}\n{text}")))
}

fn shipped(name: &str, model: ModelKind) -> Arc<Experiment> {
    read(&Library::scenario(name).unwrap().0, model)
}

fn hashes(run: &mut Run, ticks: usize) -> Vec<u64> {
    (0..ticks).map(|_| run.step().state_hash).collect()
}

fn run_of(experiment: &Arc<Experiment>) -> Run {
    Run::new(Arc::clone(experiment)).unwrap()
}

#[test]
fn a_run_repeats_exactly_and_after_a_reset_too() {
    for (name, ticks) in [("roundabout", 1500), ("city", 250)] {
        for model in MODELS {
            let experiment = shipped(name, model);
            let mut run = run_of(&experiment);
            let first = hashes(&mut run, ticks);
            assert_eq!(first.iter().collect::<BTreeSet<_>>().len(), ticks, "no two states are the same");
            assert_eq!(first, hashes(&mut run_of(&experiment), ticks), "{name} {model:?}");
            run.reset().unwrap();
            assert_eq!(run.world().tick(), 0);
            assert_eq!(first, hashes(&mut run, ticks), "{name} {model:?} after a reset");
        }
    }
}

#[test]
fn eight_worlds_on_two_threads_are_what_they_are_alone() {
    let ticks = 300;
    let experiments: Vec<_> = (0..8)
        .map(|k| shipped(["roundabout", "straight", "city", "roundabout"][k % 4], MODELS[k / 4]))
        .collect();
    let alone: Vec<_> = experiments.iter().map(|e| hashes(&mut run_of(e), ticks)).collect();
    let together: Vec<_> = std::thread::scope(|scope| {
        let threads: Vec<_> = experiments
            .chunks(4)
            .map(|part| {
                scope.spawn(move || {
                    let mut runs: Vec<Run> = part.iter().map(run_of).collect();
                    let mut found = vec![Vec::new(); runs.len()];
                    for _ in 0..ticks {
                        for (run, found) in runs.iter_mut().zip(&mut found) {
                            found.push(run.step().state_hash);
                        }
                    }
                    found
                })
            })
            .collect();
        threads.into_iter().flat_map(|thread| thread.join().unwrap()).collect()
    });
    assert_eq!(alone, together);
}

#[test]
fn a_world_that_was_kept_goes_on_the_same() {
    fn is_send_and_clone<T: Send + Clone>(_: &T) {}
    for model in MODELS {
        let experiment = shipped("roundabout", model);
        let mut run = run_of(&experiment);
        hashes(&mut run, 400);
        let mut kept = Vec::new();
        ciborium::into_writer(run.world().state(), &mut kept).unwrap();
        let state: WorldState = ciborium::from_reader(&kept[..]).unwrap();
        let mut restored = World::new(Arc::clone(&experiment)).with_state(state);
        let mut fork = run.world().clone();
        is_send_and_clone(&fork);
        let mut out = FrameSnapshot::default();
        for _ in 0..500 {
            let hash = run.step().state_hash;
            for world in [&mut restored, &mut fork] {
                world.tick_into(run.commands(), &mut out);
                assert_eq!(out.state_hash, hash, "{model:?} tick {}", out.tick);
            }
            assert_eq!(&out, run.snapshot());
        }
    }
}

#[test]
fn the_driver_models_close_the_loop() {
    let text = Library::scenario("roundabout").unwrap().0;
    let late_text = text.replace("profile = \"ideal\"", "profile = \"ideal\"\nmeasurement_delay_s = 0.2");
    let mut prompt = run_of(&read(&text, ModelKind::Raycast));
    let mut late = run_of(&read(&late_text, ModelKind::Raycast));
    let (mut apart_m, mut collisions) = (0.0f64, 0);
    for _ in 0..3500 {
        prompt.step();
        late.step();
        for (a, b) in prompt.snapshot().vehicles.iter().zip(&late.snapshot().vehicles) {
            apart_m = apart_m.max(a.position.distance(b.position));
        }
        let events = prompt.snapshot().events.iter().chain(&late.snapshot().events);
        collisions += events.filter(|event| event.kind.is_collision()).count();
    }
    assert!(apart_m > 0.5, "{apart_m}");
    assert_eq!(collisions, 0);
}

#[test]
fn an_overlapping_vehicle_starts_behind_the_first() {
    let at = |name: &str, at_m: f64| {
        format!("[[vehicle]]\nname = \"{name}\"\nroute = [\"main-boulevard/east/inner/1\"]\nat_m = {at_m}\n")
    };
    let text = format!("name = \"x\"\nduration_s = 5.0\n{}{}", at("first", 1.0), at("second", 1.05));
    for model in MODELS {
        let experiment = read(&text, model);
        let mut run = run_of(&experiment);
        let start = run.snapshot().clone();
        let [first, second] = &start.vehicles[..] else { panic!("two vehicles") };
        assert!(!overlap(&corners(&start, first), &corners(&start, second)));
        let gap_m = first.position.distance(second.position) - 5.0;
        assert!((1.9..2.6).contains(&gap_m) && second.position.x < first.position.x, "{gap_m}");
        let events = run.step().events.clone();
        let moved: Vec<&Event> =
            events.iter().filter(|event| matches!(event.kind, EventKind::Moved { .. })).collect();
        let [Event { time_s: 0.0, vehicle: VehicleId(2), kind: EventKind::Moved { behind: FIRST, by_m } }] =
            moved[..]
        else {
            panic!("{events:?}");
        };
        assert!((by_m - (1.05 * 25.0 - 25.0 + 5.0 + gap_m)).abs() < 1e-6, "{by_m}");
        assert!((0..400).all(|_| !run.step().events.iter().any(|event| event.kind.is_collision())));
    }
}

// Collisions, against outlines that are compared one with the other here.

fn corners(snapshot: &FrameSnapshot, state: &VehicleState) -> Vec<DVec2> {
    let size = snapshot.info(state.id).unwrap().dimensions;
    let (ahead, left) = (state.orientation * glam::DVec3::X, state.orientation * glam::DVec3::Y);
    let ahead = ahead.truncate().normalize_or(DVec2::X) * (size.length_m / 2.0);
    let left = left.truncate().normalize_or(DVec2::Y) * (size.width_m / 2.0);
    let c = state.position.truncate();
    vec![c + ahead + left, c - ahead + left, c - ahead - left, c + ahead - left]
}

/// Whether two convex polygons share an area: no side of either parts them.
fn overlap(a: &[DVec2], b: &[DVec2]) -> bool {
    let parts = |sides: &[DVec2], first: &[DVec2], second: &[DVec2]| {
        (0..sides.len()).any(|k| {
            let across = (sides[(k + 1) % sides.len()] - sides[k]).perp();
            let span = |points: &[DVec2]| {
                let along = points.iter().map(|p| p.dot(across));
                (along.clone().fold(f64::INFINITY, f64::min), along.fold(f64::NEG_INFINITY, f64::max))
            };
            let ((low_a, high_a), (low_b, high_b)) = (span(first), span(second));
            high_a <= low_b || high_b <= low_a
        })
    };
    !parts(a, a, b) && !parts(b, a, b)
}

/// Three roads: "east" along y = 0, "west" beside it so near that cars touch, "north" across at x = 3;
/// a wall across "east" at x = 5.
fn crossing(folder: &Path) -> String {
    let mut drawing = Drawing::default();
    let p = DVec2::new;
    for (name, from, to) in [
        ("east", p(0.0, 0.0), p(6.0, 0.0)),
        ("west", p(6.0, 0.06), p(3.2, 0.06)),
        ("north", p(3.0, -3.0), p(3.0, 3.0)),
    ] {
        drawing.add("LANES", EntityShape::Line { from, to });
        let at = from + (to - from) * 0.25;
        drawing.add("NAMES", EntityShape::Text { at, height: 0.02, text: name.to_owned() });
    }
    drawing.add("SCENERY_WALL", EntityShape::Line { from: WALL[0] / 25.0, to: WALL[1] / 25.0 });
    let path = folder.join("crossing.dxf");
    std::fs::write(&path, drawing.to_dxf()).unwrap();
    path.to_str().unwrap().to_owned()
}

/// Ends of the wall, city metres; it is 0.3 m thick.
const WALL: [DVec2; 2] = [DVec2::new(125.0, -5.0), DVec2::new(125.0, 5.0)];

fn wall() -> Vec<DVec2> {
    let t = DVec2::new(0.15, 0.0);
    vec![WALL[0] - t, WALL[0] + t, WALL[1] + t, WALL[1] - t]
}

/// A vehicle that keeps its speed whatever is ahead.
fn blind(name: &str, lane: &str, at_m: f64, speed_mps: f64) -> String {
    format!(
        "[driver.{name}]\ncontroller = \"cruise\"\ndesired_speed_mps = {speed_mps}\n\
         [[vehicle]]\nname = \"{name}\"\nroute = [\"{lane}\"]\nat_m = {at_m}\nspeed_mps = {speed_mps}\ndriver = \"{name}\"\n"
    )
}

#[test]
fn planted_collisions_are_reported_once_when_outlines_first_overlap() {
    let folder = tempfile::tempdir().unwrap();
    let map = crossing(folder.path());
    let car = blind;
    let cases = [
        ("rear end", [car("a", "east", 2.0, 0.02), car("b", "east", 1.2, 0.35)].concat(), true),
        ("slow rear end", [car("a", "east", 2.0, 0.012), car("b", "east", 1.78, 0.03)].concat(), true),
        ("side", [car("a", "east", 2.0, 0.3), car("b", "north", 2.0, 0.3)].concat(), true),
        ("head", [car("a", "east", 3.3, 0.2), car("b", "west", 1.4, 0.2)].concat(), true),
        ("wall", car("a", "east", 4.2, 0.3), false),
        ("wall, slowly", car("a", "east", 4.84, 0.015), false),
    ];
    for (what, vehicles, between_cars) in cases {
        for model in MODELS {
            let what = format!("{what}, {model:?}");
            let experiment =
                read(&format!("name = \"x\"\nmap = \"{map}\"\nduration_s = 12.0\n{vehicles}"), model);
            let mut run = run_of(&experiment);
            let (mut reports, mut first_overlap) = (Vec::new(), None);
            for _ in 0..experiment.ticks() {
                let snapshot = run.step();
                let outlines: Vec<Vec<DVec2>> =
                    snapshot.vehicles.iter().map(|state| corners(snapshot, state)).collect();
                let touch = match &outlines[..] {
                    [a, b] => overlap(a, b),
                    [a] => overlap(a, &wall()),
                    _ => unreachable!(),
                };
                if touch && first_overlap.is_none() {
                    first_overlap = Some(snapshot.tick);
                }
                let tick = snapshot.tick;
                let found = snapshot.events.iter().filter(|event| event.kind.is_collision());
                reports.extend(found.map(|event| (tick, event.clone())));
            }
            assert_eq!(reports.len(), 1, "{what}: {reports:?}, first overlap {first_overlap:?}");
            let (tick, event) = &reports[0];
            assert_eq!(Some(*tick), first_overlap, "{what}");
            assert!((event.time_s - *tick as f64 * 0.01).abs() < 1e-9);
            let expected = if between_cars {
                EventKind::Collision { with: VehicleId(2) }
            } else {
                EventKind::CollisionStatic { with: "wall".to_owned() }
            };
            assert_eq!((event.vehicle, &event.kind), (FIRST, &expected), "{what}");
            let last = run.snapshot();
            assert!(last.vehicles.iter().all(|v| v.status == Status::Collided && v.speed_mps.abs() < 0.1));
        }
    }
}

// One car on a straight road, talked to directly.

/// A world with one car of a speed on the straight road.
fn lone_car(model: ModelKind, speed_mps: f64) -> World {
    let folder = tempfile::tempdir().unwrap();
    let map = crossing(folder.path());
    let text = format!(
        "name = \"x\"\nmap = \"{map}\"\nduration_s = 30.0\n[[vehicle]]\nname = \"a\"\nroute = [\"north\"]\n\
         at_m = 0.4\nspeed_mps = {}\n",
        speed_mps / 25.0
    );
    World::new(read(&text, model))
}

/// Along "north" with a constant speed, from a place at a time.
fn ahead(sequence: u32, now_s: f64, from_y: f64, speed_mps: f64) -> Trajectory {
    let point = |k: i32| {
        let t = 0.1 * f64::from(k);
        let pose = Pose2::new(75.0, from_y + speed_mps * t, std::f64::consts::FRAC_PI_2);
        TrajectoryPoint { time_s: now_s + t, pose, speed_mps }
    };
    Trajectory { vehicle: FIRST, sequence, points: (0..=40).map(point).collect(), ..Trajectory::default() }
}

fn front_y(snapshot: &FrameSnapshot) -> f64 {
    snapshot.vehicles[0].pose().point_at(1.5, 0.0).y
}

#[test]
fn a_vehicle_that_hears_nothing_brakes_to_a_stop_on_its_path_and_resumes() {
    for model in MODELS {
        let mut world = lone_car(model, 8.0);
        let mut out = world.snapshot();
        let start_y = front_y(&out);
        let mut events = Vec::new();
        let mut hardest = 0.0f64;
        for tick in 0..1200u32 {
            let now_s = f64::from(tick) * 0.01;
            let mut commands = if tick == 0 { vec![SimCommand::Start] } else { Vec::new() };
            // Nothing between 1 s and 8 s.
            if tick % 2 == 0 && tick <= 100 {
                commands.push(SimCommand::Follow(ahead(tick, now_s, start_y + 8.0 * now_s, 8.0)));
            } else if tick % 2 == 0 && tick >= 800 {
                let y = front_y(&out);
                commands.push(SimCommand::Follow(ahead(tick, now_s, y.max(start_y) + 0.2, 3.0)));
            }
            world.tick_into(&commands, &mut out);
            events.extend(out.events.iter().filter(|e| e.kind != EventKind::Spawn).cloned());
            let car = &out.vehicles[0];
            hardest = hardest.max(-car.acceleration_mps2);
            assert!((car.position.x - 75.0).abs() < 0.05, "{model:?} leaves its path");
            if (160..800).contains(&tick) {
                assert_eq!(car.status, Status::LinkLost, "{model:?} {tick}");
            }
            if car.acceleration_mps2 < -1.5 && car.speed_mps > 1.0 && tick < 800 {
                assert!(car.brake_lights, "{model:?} {tick} brakes with {}", car.acceleration_mps2);
            }
            if tick == 90 {
                assert!(!car.brake_lights && car.status == Status::Driving && car.speed_mps > 7.5);
            }
            assert!(car.speed_mps > -0.02, "{model:?} rolls back");
            if tick == 790 {
                assert!(car.speed_mps < 0.05, "{model:?} {}", car.speed_mps);
            }
        }
        assert!((2.0..5.3).contains(&hardest), "{model:?} {hardest}");
        assert_eq!(out.vehicles[0].status, Status::Driving);
        assert!(out.vehicles[0].speed_mps > 2.0, "{model:?}: {}", out.vehicles[0].speed_mps);
        let kinds: Vec<&str> = events
            .iter()
            .map(|event| match event.kind {
                EventKind::LinkLost => "lost",
                EventKind::Stop => "stop",
                EventKind::LinkBack => "back",
                EventKind::Go { .. } => "go",
                _ => "other",
            })
            .collect();
        assert_eq!(kinds, ["lost", "stop", "back", "go"], "{model:?}");
        // The link timeout is 0.5 s after the last trajectory.
        assert!((events[0].time_s - 1.51).abs() < 0.015, "{}", events[0].time_s);
    }
}

#[test]
fn old_repeated_and_reordered_trajectories_change_nothing() {
    let (mut clean, mut noisy) = (lone_car(ModelKind::Raycast, 8.0), lone_car(ModelKind::Raycast, 8.0));
    let (mut a, mut b) = (clean.snapshot(), noisy.snapshot());
    let start_y = front_y(&a);
    for tick in 0..400u32 {
        let now_s = f64::from(tick) * 0.01;
        let mut good = if tick == 0 { vec![SimCommand::Start] } else { Vec::new() };
        let message = ahead(tick + 10, now_s, start_y + 8.0 * now_s, 8.0);
        good.push(SimCommand::Follow(message.clone()));
        // An old one and a repetition that say something else.
        let stop =
            |sequence| SimCommand::Follow(Trajectory { finished: true, ..ahead(sequence, now_s, 0.0, 0.0) });
        let mut more = good.clone();
        more.insert(0, stop(tick + 9));
        more.push(stop(tick + 10));
        more.push(stop(tick + 5));
        if tick == 0 {
            // The first message of all is not old.
            more = good.clone();
        }
        clean.tick_into(&good, &mut a);
        noisy.tick_into(&more, &mut b);
        assert_eq!(a.state_hash, b.state_hash, "tick {tick}");
    }
    assert!(a.vehicles[0].speed_mps > 7.5);
}

#[test]
fn a_pause_changes_nothing_but_the_wait() {
    let experiment = shipped("straight", ModelKind::Raycast);
    let mut run = run_of(&experiment);
    let mut steps = Vec::new();
    for _ in 0..200 {
        let hash = run.step().state_hash;
        steps.push((run.commands().to_vec(), hash));
    }
    let mut world = World::new(experiment);
    let mut out = FrameSnapshot::default();
    for (tick, (commands, hash)) in steps.iter().enumerate() {
        if tick == 120 {
            let before = out.state_hash;
            for commands in [&[SimCommand::Pause][..], &[], &[]] {
                world.tick_into(commands, &mut out);
                assert!(!world.is_running() && out.tick == 120 && out.state_hash == before);
            }
            let mut first = commands.clone();
            first.push(SimCommand::Start);
            world.tick_into(&first, &mut out);
        } else {
            world.tick_into(commands, &mut out);
        }
        assert_eq!(out.state_hash, *hash, "tick {tick}");
    }
}

#[test]
fn a_person_drives_and_gives_back() {
    for model in MODELS {
        let mut world = lone_car(model, 0.0);
        let mut out = world.snapshot();
        assert_eq!(out.vehicles[0].status, Status::Waiting);
        let moving = lone_car(model, 8.0).snapshot();
        assert_eq!(moving.vehicles[0].status, Status::Driving, "{model:?}: what moves does not wait");
        let full_gas = Pedals { gas: 1.0, steering_rad: 0.1, ..Pedals::default() };
        world.tick_into(&[SimCommand::Start, SimCommand::Drive(FIRST, full_gas)], &mut out);
        for _ in 0..200 {
            world.tick_into(&[], &mut out);
        }
        let car = &out.vehicles[0];
        assert_eq!(car.status, Status::Manual);
        assert!(car.speed_mps > 4.0 && car.position.x < 74.8, "{model:?} {car:?}");
        // Fingers that are no numbers, and vehicles that are not there, do no harm.
        let broken = Pedals { gas: f64::NAN, steering_rad: f64::NAN, ..Pedals::default() };
        world.tick_into(&[SimCommand::Drive(FIRST, broken), SimCommand::Remove(VehicleId(77))], &mut out);
        let mut nowhere = ahead(1, 0.0, f64::NAN, f64::INFINITY);
        nowhere.points[3].time_s = f64::NAN;
        world.tick_into(&[SimCommand::Follow(nowhere), SimCommand::Release(FIRST)], &mut out);
        for _ in 0..600 {
            world.tick_into(&[], &mut out);
        }
        let car = &out.vehicles[0];
        assert!(car.position.is_finite() && car.orientation.is_finite(), "{model:?} {car:?}");
        assert_ne!(car.status, Status::Manual);
        assert!(car.speed_mps.abs() < 0.1, "without a path it stands: {model:?} {car:?}");
        world.tick_into(&[SimCommand::Remove(FIRST)], &mut out);
        assert!(out.vehicles.is_empty() && out.roster.is_empty());
        assert_eq!(out.events.len(), 1);
    }
}

#[test]
fn every_status_of_the_list_is_reached() {
    let mut seen: Vec<Status> = Vec::new();
    for (name, ticks) in [("roundabout", 2200), ("straight", 1200)] {
        let mut run = run_of(&shipped(name, ModelKind::Raycast));
        seen.extend(run.snapshot().vehicles.iter().map(|v| v.status));
        for _ in 0..ticks {
            let statuses = run.step().vehicles.iter().map(|v| v.status).collect::<Vec<_>>();
            seen.extend(statuses);
        }
    }
    for status in [Status::Driving, Status::Yielding, Status::Stopped, Status::Finished] {
        assert!(seen.contains(&status), "{status:?}");
    }
    // Waiting, link lost, collided and manual have tests of their own.
}
