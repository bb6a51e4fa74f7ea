//! A person at the wheel: through bends and other ways than planned, among others who react, and back.

use city3d_dynamics::vehicle::ModelKind;
use city3d_geometry::{trig, wrap_angle};
use city3d_protocol::snapshot::{EventKind, Indicator, Pedals, SimCommand, Status, VehicleId, VehicleState};
use city3d_roadmap::{CityMap, LaneId};
use city3d_simulation::runner::Run;
use city3d_simulation::scenario::{Library, Overrides, read_experiment};
use glam::DVec2;
use std::sync::Arc;

fn angle_of(direction: DVec2) -> f64 {
    trig::atan2(direction.y, direction.x)
}

fn run(text: &str, model: ModelKind) -> Run {
    let overrides = Overrides { model: Some(model), ..Overrides::default() };
    let experiment = read_experiment("test", text, &Library::default(), overrides);
    Run::new(Arc::new(experiment.unwrap_or_else(|error| panic!("{error}")))).unwrap()
}

fn shipped(name: &str, model: ModelKind) -> Run {
    run(&Library::scenario(name).unwrap().0, model)
}

fn state(run: &Run, id: VehicleId) -> &VehicleState {
    run.snapshot().vehicle(id).unwrap()
}

/// Somebody who steers along lanes at a speed, looking some metres ahead.
struct Person {
    way: Vec<LaneId>,
    speed_mps: f64,
}

impl Person {
    fn pedals(&self, map: &CityMap, vehicle: &VehicleState) -> Pedals {
        let axle = vehicle.position.truncate() - vehicle.forward() * 1.5;
        let ahead = self.ahead(map, axle, 7.0) - axle;
        let angle = wrap_angle(angle_of(ahead) - angle_of(vehicle.forward()));
        let error = self.speed_mps - vehicle.speed_mps;
        Pedals {
            gas: (0.25 * error).clamp(0.0, 0.6),
            brake: (-0.2 * error).clamp(0.0, 0.6),
            steering_rad: trig::atan2(2.0 * 3.0 * trig::sin_cos(angle).0, ahead.length()),
            ..Pedals::default()
        }
    }

    /// The point of the way some metres ahead of its nearest one.
    fn ahead(&self, map: &CityMap, from: DVec2, metres: f64) -> DVec2 {
        let points: Vec<DVec2> = self
            .way
            .iter()
            .flat_map(|lane| map.lane(*lane).curve.sample(0.5))
            .map(|(_, point)| point.pose.position)
            .collect();
        let nearest = (0..points.len())
            .min_by(|a, b| points[*a].distance(from).total_cmp(&points[*b].distance(from)))
            .unwrap();
        let mut left = metres;
        for pair in points[nearest..].windows(2) {
            left -= pair[0].distance(pair[1]);
            if left < 0.0 {
                return pair[1];
            }
        }
        points[points.len() - 1]
    }
}

/// Drives until a distance has been driven, or so many seconds are over.
fn drive(run: &mut Run, id: VehicleId, person: &Person, metres: f64, seconds: u64) {
    let map = Arc::clone(&run.experiment().city_map);
    let start_m = state(run, id).distance_m;
    for tick in 0..seconds * 100 {
        if state(run, id).distance_m - start_m > metres {
            return;
        }
        if tick % 2 == 0 {
            run.inject(SimCommand::Drive(id, person.pedals(&map, state(run, id))));
        }
        run.step();
        assert_eq!(state(run, id).status, Status::Manual, "at {} s", run.snapshot().time_s);
        no_collision(run);
    }
}

fn go_on(run: &mut Run, seconds: u64) {
    for _ in 0..seconds * 100 {
        run.step();
        no_collision(run);
    }
}

fn no_collision(run: &Run) {
    let snapshot = run.snapshot();
    let collision = snapshot.events.iter().find(|event| event.kind.is_collision());
    assert!(collision.is_none(), "at {} s: {collision:?}", snapshot.time_s);
}

const MODELS: [ModelKind; 2] = [ModelKind::Raycast, ModelKind::Bicycle];

#[test]
fn a_person_drives_fifty_metres_through_a_bend_and_gives_back() {
    for model in MODELS {
        let mut run = shipped("roundabout", model);
        // The first of those who have the right of way: into and round the roundabout.
        let id = VehicleId(4);
        go_on(&mut run, 5);
        let before = state(&run, id).clone();
        let way = run.experiment().vehicles[3].route.clone();
        drive(&mut run, id, &Person { way, speed_mps: 6.0 }, 60.0, 20);
        let after = state(&run, id).clone();
        assert!(after.distance_m - before.distance_m > 50.0);
        let turn = wrap_angle(after.pose().yaw_rad - before.pose().yaw_rad);
        assert!(turn.abs() > 0.6, "{model:?}: no bend, {turn} rad");
        run.inject(SimCommand::Release(id));
        run.step();
        assert_ne!(state(&run, id).status, Status::Manual);
        go_on(&mut run, 6);
        let later = state(&run, id);
        assert!(later.distance_m - after.distance_m > 10.0, "{model:?}: it drives on by itself");
        assert!(later.lateral_error_m.abs() < 0.15, "{model:?}: {} m", later.lateral_error_m);
    }
}

const TWO_IN_LINE: &str = r#"
name = "line"
duration_s = 60
[[vehicle]]
route = ["main-boulevard/east/inner/1", "second-avenue/west/1"]
at_m = 1.2
[[vehicle]]
route = ["main-boulevard/east/inner/1", "second-avenue/west/1"]
at_m = 0.5
"#;

#[test]
fn those_behind_stop_for_a_person_who_stops() {
    for model in MODELS {
        let mut run = run(TWO_IN_LINE, model);
        go_on(&mut run, 1);
        run.inject(SimCommand::Drive(VehicleId(1), Pedals { brake: 0.7, ..Pedals::default() }));
        go_on(&mut run, 10);
        let (person, behind) = (state(&run, VehicleId(1)), state(&run, VehicleId(2)));
        assert_eq!((person.status, behind.status), (Status::Manual, Status::Stopped));
        let gap = person.position.distance(behind.position) - 5.0;
        assert!((0.5..12.0).contains(&gap), "{model:?}: {gap} m");
        run.inject(SimCommand::Release(VehicleId(1)));
        go_on(&mut run, 8);
        assert!(state(&run, VehicleId(1)).speed_mps > 2.0 && state(&run, VehicleId(2)).speed_mps > 2.0);
    }
}

#[test]
fn a_person_may_turn_off_and_the_way_goes_on_from_there() {
    let text = TWO_IN_LINE.replace("at_m = 0.5", "at_m = 0.05");
    let mut run = run(&text, ModelKind::Raycast);
    let map = Arc::clone(&run.experiment().city_map);
    let planned = run.experiment().vehicles[0].route.clone();
    // The first branching, and the way that is not planned.
    let branch = (0..planned.len() - 1)
        .find(|k| {
            map.lane(planned[*k])
                .successors
                .iter()
                .any(|next| *next != planned[k + 1] && map.min_radius(*next) > 8.0)
        })
        .unwrap();
    let mut way = planned[..=branch].to_vec();
    let other = map.lane(planned[branch]).successors.iter().find(|next| **next != planned[branch + 1]);
    way.push(*other.unwrap());
    for _ in 0..3 {
        way.push(map.lane(way[way.len() - 1]).successors[0]);
    }
    let id = VehicleId(1);
    let to_branch: f64 = way[..=branch].iter().map(|lane| map.lane(*lane).curve.length()).sum();
    drive(&mut run, id, &Person { way: way.clone(), speed_mps: 5.0 }, to_branch + 15.0, 60);
    let cav = &run.mainframe().cavs()[0];
    assert!(cav.reroutes > 0 && cav.is_on_route(), "it is known to be on another way");
    run.inject(SimCommand::Release(id));
    let before_m = state(&run, id).distance_m;
    go_on(&mut run, 12);
    let after = state(&run, id);
    assert!(after.distance_m - before_m > 10.0, "it drives on: {} m", after.distance_m - before_m);
    assert!(after.lateral_error_m.abs() < 0.3, "{}", after.lateral_error_m);
}

#[test]
fn off_the_road_it_is_an_obstacle_that_stands_when_it_is_given_back() {
    let mut run = run(TWO_IN_LINE, ModelKind::Bicycle);
    go_on(&mut run, 1);
    let id = VehicleId(1);
    // Half off the road, across the lane.
    for tick in 0..260 {
        let steering_rad = if tick < 160 { 0.5 } else { 0.0 };
        let brake = if tick < 180 { 0.0 } else { 0.6 };
        let gas = if tick < 120 { 0.15 } else { 0.0 };
        run.inject(SimCommand::Drive(id, Pedals { gas, brake, steering_rad, ..Pedals::default() }));
        run.step();
        if run.snapshot().events.iter().any(|event| matches!(event.kind, EventKind::Collision { .. })) {
            panic!("hit by the one behind at {} s", run.snapshot().time_s);
        }
    }
    let cav = &run.mainframe().cavs()[0];
    assert!(!cav.is_on_route(), "at {:?}", state(&run, id).pose());
    run.inject(SimCommand::Release(id));
    for _ in 0..1000 {
        run.step();
        let hits = run.snapshot().events.iter().any(|e| matches!(e.kind, EventKind::Collision { .. }));
        assert!(!hits, "at {} s", run.snapshot().time_s);
    }
    let vehicle = state(&run, id);
    assert!(vehicle.speed_mps.abs() < 0.1 && vehicle.status == Status::Stopped, "{vehicle:?}");
    assert_eq!(vehicle.indicator, Indicator::Hazard);
}

#[test]
fn given_back_off_the_road_at_speed_it_brakes_to_a_stand_and_no_link_is_lost() {
    for model in MODELS {
        let mut run = run(TWO_IN_LINE, model);
        go_on(&mut run, 2);
        let id = VehicleId(1);
        let mut ticks = 0;
        // Off the lane, at the speed that it has.
        while run.mainframe().cavs()[0].is_on_route() {
            run.inject(SimCommand::Drive(id, Pedals { steering_rad: 0.3, ..Pedals::default() }));
            run.step();
            ticks += 1;
            assert!(ticks < 600, "{model:?}: it never leaves its lane");
        }
        let left = state(&run, id).clone();
        assert!(left.speed_mps > 2.0, "{model:?}: {} m/s", left.speed_mps);
        run.inject(SimCommand::Release(id));
        for _ in 0..600 {
            run.step();
            assert_ne!(state(&run, id).status, Status::LinkLost, "{model:?}");
        }
        let after = state(&run, id);
        let way_m = after.position.distance(left.position);
        let braking_m = trig::powi(left.speed_mps, 2) / (2.0 * 2.0);
        assert!(after.speed_mps.abs() < 0.1 && way_m < braking_m + 3.0, "{model:?}: {way_m} m, {after:?}");
        assert!(matches!(after.status, Status::Stopped | Status::Collided), "{model:?}: {after:?}");
    }
}

#[test]
fn after_a_collision_a_person_can_back_out_and_drive_on() {
    for model in MODELS {
        let mut run = run(TWO_IN_LINE, model);
        go_on(&mut run, 1);
        let id = VehicleId(2);
        // Into the one ahead, which a person holds.
        run.inject(SimCommand::Drive(VehicleId(1), Pedals { brake: 0.7, ..Pedals::default() }));
        run.inject(SimCommand::Drive(id, Pedals { gas: 0.4, ..Pedals::default() }));
        let mut ticks = 0;
        while state(&run, id).status != Status::Collided {
            run.step();
            ticks += 1;
            assert!(ticks < 2000, "they never meet");
        }
        run.inject(SimCommand::Drive(id, Pedals { gas: 0.4, reverse: true, ..Pedals::default() }));
        let from = state(&run, id).position;
        let forward_m = |run: &Run| (state(run, id).position - from).truncate().dot(state(run, id).forward());
        // Until it has braked it moves on, without tyres even through the other one: it has collided until it is out of it.
        while forward_m(&run) > -7.0 {
            let here_m = forward_m(&run);
            let is_in_it = (0.1..4.9).contains(&here_m);
            assert!(!is_in_it || state(&run, id).status == Status::Collided, "{model:?}: {here_m} m into it");
            run.step();
            ticks += 1;
            assert!(ticks < 6000, "{model:?}: it does not back out");
        }
        assert_eq!(state(&run, id).status, Status::Manual, "{model:?}: it is clear of the other");
        assert_eq!(state(&run, VehicleId(1)).status, Status::Collided, "{model:?}: the other one stays");
    }
}

#[test]
fn a_car_for_a_person_stands_until_somebody_drives_it_and_the_others_live_with_it() {
    for model in MODELS {
        let mut run = shipped("student", model);
        let (student, behind) = (VehicleId(1), VehicleId(2));
        assert_eq!(state(&run, student).status, Status::Manual, "from the start");
        let from = state(&run, student).position;
        for _ in 0..6000 {
            run.step();
            no_collision(&run);
            let events = &run.snapshot().events;
            let noise = events.iter().find(|e| e.vehicle == student && e.kind != EventKind::Spawn);
            assert!(noise.is_none(), "{model:?}: {noise:?}");
            assert_eq!(state(&run, student).status, Status::Manual);
        }
        assert!(state(&run, student).position.distance(from) < 0.05, "{model:?}: it rolls away");
        let gap = state(&run, behind).position.distance(from) - 5.0;
        assert!((0.5..12.0).contains(&gap), "{model:?}: the one behind waits behind it, {gap} m");
        for round in 3..=5 {
            let driven = state(&run, VehicleId(round)).distance_m;
            assert!(driven > 180.0, "{model:?}: {round} is held up, {driven} m in a minute");
        }
        // Given back, it goes in among them.
        run.inject(SimCommand::Release(student));
        go_on(&mut run, 60);
        let driven = (state(&run, student).distance_m, state(&run, behind).distance_m);
        assert!(driven.0 > 80.0 && driven.1 > 60.0, "{model:?}: {driven:?}");
    }
}

#[test]
fn a_person_who_hesitates_at_the_line_can_still_drive_in() {
    let mut run = shipped("student", ModelKind::Bicycle);
    let id = VehicleId(1);
    go_on(&mut run, 20);
    let way = run.experiment().vehicles[0].route.clone();
    // Somebody polite would look; the others are there to make room.
    let person = Person { way, speed_mps: 4.0 };
    let map = Arc::clone(&run.experiment().city_map);
    while state(&run, id).distance_m < 60.0 {
        run.inject(SimCommand::Drive(id, person.pedals(&map, state(&run, id))));
        run.step();
        assert!(run.snapshot().time_s < 60.0, "{} m", state(&run, id).distance_m);
    }
    assert!(run.mainframe().cavs()[0].is_on_route());
}

#[test]
fn a_parked_vehicle_stays_and_others_stop_behind_it() {
    let text = r#"
        name = "parked"
        duration_s = 40.0
        [driver.parked]
        controller = "parked"
        [[vehicle]]
        name = "follower"
        route = ["south-boulevard/east/outer/1"]
        at_m = 0.3
        speed_mps = 0.3
        [[vehicle]]
        name = "obstacle"
        driver = "parked"
        route = ["south-boulevard/east/outer/1"]
        at_m = 2.0
    "#;
    for model in [ModelKind::Bicycle, ModelKind::Raycast] {
        let mut run = run(text, model);
        let start = state(&run, VehicleId(2)).position;
        for _ in 0..3000 {
            run.step();
        }
        let [follower, obstacle] = [1, 2].map(|id| state(&run, VehicleId(id)).clone());
        assert!(obstacle.position.distance(start) < 0.05, "{:?}", obstacle.position - start);
        assert!(follower.speed_mps.abs() < 0.05 && follower.distance_m > 20.0, "{follower:?}");
        let gap_m = (obstacle.position - follower.position).length() - 5.0;
        assert!((0.5..6.0).contains(&gap_m), "{gap_m} m");
        assert_ne!(follower.status, Status::Collided);
    }
}

#[test]
fn who_hangs_over_the_beginning_of_its_route_is_seen_from_the_lane_before() {
    let map = Arc::clone(&shipped("city", ModelKind::Bicycle).experiment().city_map);
    let lane = map.lane_by_name("south-boulevard/east/outer/1").unwrap();
    let before = map.lane(lane.predecessors[0]);
    let first = map.lane(before.predecessors[0]);
    // The front axle of the obstacle stands on its route, and most of its body on the last lane of the follower.
    let text = format!(
        r#"
        name = "overhang"
        duration_s = 30.0
        [driver.parked]
        controller = "parked"
        [[vehicle]]
        name = "follower"
        route = [{:?}, {:?}]
        at_m = {}
        speed_mps = 0.2
        [[vehicle]]
        name = "obstacle"
        driver = "parked"
        route = [{:?}]
        at_m = 0.01
    "#,
        first.name,
        before.name,
        ((first.curve.length() - 20.0) / 25.0).max(0.05),
        lane.name
    );
    for model in [ModelKind::Bicycle, ModelKind::Raycast] {
        let mut run = run(&text, model);
        go_on(&mut run, 30);
        let [follower, obstacle] = [1, 2].map(|id| state(&run, VehicleId(id)).clone());
        let gap_m = (obstacle.position - follower.position).length() - 5.0;
        assert!((0.5..6.0).contains(&gap_m), "{gap_m} m");
        assert!(follower.distance_m > 10.0 && follower.status != Status::Collided, "{follower:?}");
    }
}

#[test]
fn a_vehicle_whose_trajectories_are_withheld_loses_its_link_until_it_gets_them_again() {
    let mut run = shipped("roundabout", ModelKind::Raycast);
    let (one, other) = (VehicleId(4), VehicleId(1));
    go_on(&mut run, 1);
    run.withhold(one, true);
    go_on(&mut run, 4);
    assert_eq!(state(&run, one).status, Status::LinkLost);
    assert!(state(&run, one).speed_mps < 0.1, "it has braked to a stand");
    assert_ne!(state(&run, other).status, Status::LinkLost);
    run.withhold(one, false);
    go_on(&mut run, 4);
    assert!(state(&run, one).speed_mps > 1.0, "it drives on");
    run.withhold(one, true);
    run.reset().unwrap();
    go_on(&mut run, 4);
    assert_eq!(state(&run, one).status, Status::Driving, "a reset ends it");
}
