//! Vehicles whose control framework goes away in mid-run: where they stop, and how they go on.

use city3d_control::Mainframe;
use city3d_protocol::snapshot::{FrameSnapshot, SimCommand, VehicleId};
use city3d_roadmap::{ZoneId, ZoneKind};
use city3d_simulation::runner::{ControlLoop, Run};
use city3d_simulation::scenario::{Experiment, Library, Overrides, read_experiment};
use std::sync::Arc;

fn collisions(snapshot: &FrameSnapshot) -> usize {
    snapshot.events.iter().filter(|event| event.kind.is_collision()).count()
}

fn city(duration_s: f64) -> Arc<Experiment> {
    let (text, library) = Library::scenario("city").unwrap();
    let overrides = Overrides { duration_s: Some(duration_s), ..Overrides::default() };
    Arc::new(read_experiment("city", &text, &library, overrides).unwrap())
}

/// Arc length at which a vehicle has to wait: before a section to which it is not admitted, or before a
/// crossing that somebody with an earlier admission has not left yet.
fn waits_at(mainframe: &Mainframe, id: VehicleId) -> Option<f64> {
    let cav = mainframe.cav(id).filter(|cav| cav.is_on_route())?;
    let hold_s = cav.route.sections.get(cav.passage.next_section).map(|section| section.hold_s);
    let goes_first = |zone: ZoneId, side: usize, order: u64| {
        mainframe.cavs().iter().filter(|other| other.id != id && other.is_on_route()).any(|other| {
            other.passage.admissions.iter().filter(|theirs| theirs.order < order).any(|theirs| {
                let there = &other.route.crossings[other.route.sections[theirs.section].crossings.clone()];
                there.iter().any(|there| {
                    let is_same = there.zone == zone && there.side != side;
                    is_same && there.to_s > other.rear_s()
                })
            })
        })
    };
    let admitted = cav.passage.admissions.iter().flat_map(|admission| {
        let crossings = &cav.route.crossings[cav.route.sections[admission.section].crossings.clone()];
        crossings.iter().map(|crossing| (crossing, admission.order))
    });
    let blocked = admitted
        .filter(|(crossing, _)| crossing.kind == ZoneKind::Cross && crossing.from_s > cav.front_s())
        .find(|(crossing, order)| goes_first(crossing.zone, crossing.side, *order))
        .map(|(crossing, _)| crossing.from_s);
    [hold_s, blocked].into_iter().flatten().min_by(f64::total_cmp)
}

/// Tolerance of the end of a trajectory, laboratory metres.
const ENDS_WITHIN_M: f64 = 0.03;

#[test]
fn trajectories_end_before_what_is_not_free_yet() {
    let experiment = city(60.0);
    let map = &experiment.lab_map;
    let mut run = Run::new(Arc::clone(&experiment)).unwrap();
    let (mut ended, mut beyond) = (0, Vec::new());
    for _ in 0..experiment.ticks() {
        run.step();
        for command in run.commands() {
            let SimCommand::Follow(trajectory) = command else { continue };
            let mainframe = run.mainframe();
            let Some(wait_s) = waits_at(mainframe, trajectory.vehicle) else { continue };
            let cav = mainframe.cav(trajectory.vehicle).unwrap();
            let last = trajectory.points.last().unwrap();
            let end = last.pose.to_lab(experiment.scale).position;
            let foot = cav.route.project(map, end, cav.axle_s() - 0.1, cav.axle_s() + 2.0);
            let front_s = foot.s + cav.body.overhang_m();
            ended += usize::from(last.speed_mps == 0.0);
            if front_s > wait_s + ENDS_WITHIN_M {
                beyond.push((run.world().time_s(), trajectory.vehicle, front_s - wait_s));
            }
        }
    }
    assert!(ended > 1000, "{ended}");
    assert!(beyond.is_empty(), "{} of them, first: {:?}", beyond.len(), &beyond[..beyond.len().min(5)]);
}

/// Drives without commands until a time and resumes with a control framework that has come anew. Returns the collisions.
fn lose_control(run: Run, until_s: f64) -> (Run, usize) {
    let experiment = Arc::clone(run.experiment());
    let mut world = run.world().clone();
    let mut snapshot = world.snapshot();
    let mut found = 0;
    while world.time_s() < until_s {
        world.tick_into(&[], &mut snapshot);
        found += collisions(&snapshot);
    }
    let mut control = ControlLoop::new(&experiment).unwrap();
    control.resume(None);
    let mut run = Run::resume(world, control);
    // The sequence of its trajectories begins again.
    for vehicle in &experiment.vehicles {
        run.inject(SimCommand::Spawn(Box::new(vehicle.setup(&experiment.city_map, experiment.scale))));
    }
    (run, found)
}

#[test]
fn a_city_without_commands_comes_to_a_stop_without_a_collision_and_goes_on() {
    let mut run = Run::new(city(600.0)).unwrap();
    let mut found = 0;
    for absence in 0..6 {
        let goes_s = run.world().time_s() + 12.0 + 0.37 * f64::from(absence);
        while run.world().time_s() < goes_s {
            found += collisions(run.step());
        }
        let lost = lose_control(run, goes_s + 5.0);
        assert!(lost.0.snapshot().vehicles.iter().all(|state| state.speed_mps < 0.01));
        (run, found) = (lost.0, found + lost.1);
    }
    assert_eq!(found, 0);
}

/// Longest stand that a city with interruptions may have, seconds.
const LONGEST_STAND_S: f64 = 100.0;
const GOLDEN: f64 = 0.618_033_988_749_9;
const UNTIL_S: f64 = 330.0;

/// Loses control again and again for up to `longest_absence_s`, at times that follow from `first_draw`.
fn drive_with_absences(longest_absence_s: f64, first_draw: f64) {
    let mut drawn = first_draw;
    let mut draw = |from_s: f64, to_s: f64| {
        drawn += 1.0;
        from_s + (to_s - from_s) * (drawn * drawn * GOLDEN).fract()
    };
    let mut run = Run::new(city(2000.0)).unwrap();
    let mut moved_s = vec![0.0; run.experiment().vehicles.len()];
    let (mut found, mut longest_s) = (0, 0.0_f64);
    while run.world().time_s() < UNTIL_S {
        let goes_s = run.world().time_s() + draw(5.0, 60.0);
        let comes_s = goes_s + draw(0.1, longest_absence_s);
        while run.world().time_s() < goes_s {
            let snapshot = run.step();
            found += collisions(snapshot);
            for (state, moved_s) in snapshot.vehicles.iter().zip(&mut moved_s) {
                if state.speed_mps > 0.1 {
                    *moved_s = snapshot.time_s;
                }
                longest_s = longest_s.max(snapshot.time_s - *moved_s);
            }
        }
        let lost = lose_control(run, comes_s);
        (run, found) = (lost.0, found + lost.1);
    }
    assert_eq!(found, 0);
    assert!(longest_s < LONGEST_STAND_S, "{longest_s}");
}

#[test]
fn a_city_goes_on_after_control_has_been_away_until_all_stood() {
    drive_with_absences(20.0, 500.0);
}

#[test]
fn a_city_goes_on_after_control_has_been_away_for_moments() {
    // Vehicles are still under way when it comes back, one of them before an exit of a roundabout.
    drive_with_absences(2.5, 800.0);
}

/// Two vehicles that stand inside a crossing as the control framework finds them, at `at_m` of their ways through it.
fn both_inside(ways: [&str; 2], at_m: [f64; 2]) -> Option<Run> {
    let vehicle = |number: usize| {
        format!("[[vehicle]]\nname = \"v{number}\"\nroute = {}\nat_m = {}\n", ways[number], at_m[number])
    };
    let text = format!(
        "name = \"inside\"\nmap = \"crossing\"\nseed = 1\nduration_s = 20.0\n{}{}",
        vehicle(0),
        vehicle(1)
    );
    let library = Library::scenario("intersection").unwrap().1;
    let experiment = read_experiment("inside", &text, &library, Overrides::default()).ok()?;
    Some(Run::new(Arc::new(experiment)).unwrap())
}

#[test]
fn of_two_inside_a_crossing_the_one_whose_way_is_free_goes_first() {
    let east = "[\"junction-1-1/west-to-east\", \"street-1/east/2\"]";
    let north = "[\"junction-1-1/south-to-north\", \"avenue-1/north/2\"]";
    let left = "[\"junction-1-1/west-to-north\", \"avenue-1/north/2\"]";
    let west = "[\"junction-1-1/east-to-west\", \"street-1/west/2\"]";
    let mut runs = 0;
    for ways in [[east, north], [north, east], [left, west], [west, left]] {
        for k in 0..100 {
            let at_m = [0.12 + 0.06 * f64::from(k % 10), 0.12 + 0.06 * f64::from(k / 10)];
            // Places that overlap are refused.
            let Some(mut run) = both_inside(ways, at_m) else { continue };
            runs += 1;
            for _ in 0..run.experiment().ticks() {
                assert_eq!(collisions(run.step()), 0, "{ways:?} {at_m:?}");
            }
            // A left turn that has begun and oncoming traffic may block each other: then both stand.
            let stand = run.snapshot().vehicles.iter().filter(|state| state.distance_m < 25.0).count();
            let may_block = ways.contains(&left) && at_m.iter().all(|at_m| (0.15..0.65).contains(at_m));
            assert!(stand == 0 || may_block && stand == 2, "{ways:?} {at_m:?}: {stand}");
        }
    }
    assert!(runs > 100, "{runs}");
}
