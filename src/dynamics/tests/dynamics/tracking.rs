//! Vehicles under tracking control: they keep to their path and to its times, with both models.

use crate::rig::{DT, MODELS, Rig, follow, route, spec, trajectory};
use city3d_dynamics::vehicle::{ModelKind, Motion, Tracker, VehicleSpec};
use city3d_geometry::{Curve, Pose2};
use city3d_protocol::snapshot::TrajectoryPoint;
use std::f64::consts::{FRAC_PI_2, PI};

fn steady(speed: f64) -> impl Fn(f64) -> (f64, f64) {
    move |time| (speed * time, speed)
}

/// A straight, half a circle to the left, a straight, a quarter to the right, a straight.
fn bends(heading: f64, radius: f64) -> Curve {
    let k = 1.0 / radius;
    route(heading, &[(20.0, 0.0), (PI * radius, k), (20.0, 0.0), (FRAC_PI_2 * radius, -k), (90.0, 0.0)])
}

/// From `speed` a stop with `braking` from `from` on, `standing` seconds, and off again with 2 m/s2.
fn stop_and_go(speed: f64, braking: f64, from: f64, standing: f64) -> impl Fn(f64) -> (f64, f64) {
    move |time| {
        let stop_takes = speed / braking;
        let stopped_at = speed * from + 0.5 * speed * stop_takes;
        let go = from + stop_takes + standing;
        if time < from {
            (speed * time, speed)
        } else if time < from + stop_takes {
            let t = time - from;
            (speed * from + speed * t - 0.5 * braking * t * t, speed - braking * t)
        } else if time < go {
            (stopped_at, 0.0)
        } else {
            let t = (time - go).min(speed / 2.0);
            let after = time - go - t;
            (stopped_at + t * t + speed * after, 2.0 * t)
        }
    }
}

/// Radius, speed and steering limit in degrees: lateral accelerations up to 3 m/s2.
const BENDS: [(f64, f64, f64); 6] = [
    (11.65, 6.0, 45.0),
    (11.65, 5.9, 20.0),
    (15.4, 6.8, 45.0),
    (50.0, 12.0, 20.0),
    (9.5, 5.3, 20.0),
    (5.0, 3.87, 45.0),
];

#[test]
fn the_front_axle_keeps_to_bends() {
    for model in MODELS {
        for (radius, speed, degrees) in BENDS {
            let car = VehicleSpec { steering_limit_rad: degrees.to_radians(), ..spec(model) };
            assert!(car.min_turn_radius() < radius);
            let route = bends(0.3, radius);
            let mut rig = Rig::on(car, &route, 0.0, speed);
            let errors = follow(&mut rig, &route, &steady(speed), (route.length() - 60.0) / speed, 0.0);
            let what = format!("{model:?} r = {radius}, {speed} m/s, {degrees} degrees: {errors:?}");
            assert!(errors.exact < 0.05, "{what}");
            assert!((errors.tracker - errors.exact).abs() < 0.01, "own account differs, {what}");
            assert!(errors.longitudinal < 0.1, "{what}");
            assert!(errors.least_throttle > -0.1, "{what}");
        }
    }
}

#[test]
fn a_coarse_trajectory_is_followed_as_well() {
    for model in MODELS {
        let route = bends(-2.0, 11.65);
        let mut rig = Rig::on(spec(model), &route, 0.0, 6.0);
        let mut worst = 0.0f64;
        // Half a second between points and between messages.
        for k in 0..1500 {
            if k % 50 == 0 {
                rig.tracker.follow(&trajectory(&route, &steady(6.0), rig.time(), 5.0, 0.5));
            }
            rig.track();
            worst = worst.max(route.project(rig.front().position).lateral.abs());
        }
        assert!(worst < 0.12, "{model:?} {worst}");
    }
}

#[test]
fn offsets_vanish_at_any_heading() {
    for model in MODELS {
        for heading in [0.0, 0.5, 1.57, 3.0] {
            for speed in [3.0, 8.75, 12.5] {
                let route = route(heading, &[(400.0, 0.0)]);
                let mut rig = Rig::on(spec(model), &route, 0.75, speed);
                let errors = follow(&mut rig, &route, &steady(speed), 10.0, 6.0);
                assert!(errors.exact < 0.02, "{model:?} heading {heading}, {speed} m/s: {errors:?}");
            }
        }
    }
}

/// mu g = 2.9 m/s2 where v^2 / r = 6.6 is needed: only a model without tyre slip can do it.
#[test]
fn a_car_with_bald_tyres_leaves_its_lane() {
    let leaves = |model, friction| {
        let car = VehicleSpec { tyre_friction: friction, ..spec(model) };
        let route = route(0.0, &[(20.0, 0.0), (60.0, 1.0 / 11.65)]);
        let mut rig = Rig::on(car, &route, 0.0, 8.75);
        follow(&mut rig, &route, &steady(8.75), 6.0, 0.0).exact > 1.9
    };
    assert!(leaves(ModelKind::Raycast, 0.3));
    assert!(!leaves(ModelKind::Bicycle, 0.3));
    assert!(!leaves(ModelKind::Raycast, 0.9));
}

#[test]
fn stops_are_kept_and_left_in_time_without_the_handbrake() {
    for model in MODELS {
        for braking in [2.0, 3.0, 5.0] {
            let route = route(0.7, &[(200.0, 0.0)]);
            let plan = stop_and_go(8.75, braking, 2.0, 3.0);
            let stopped = 2.0 + 8.75 / braking;
            let mut rig = Rig::on(spec(model), &route, 0.0, 8.75);
            let way_in = follow(&mut rig, &route, &plan, stopped + 1.0, 0.0);
            let what = format!("{model:?} {braking} m/s2: {way_in:?}");
            assert!(way_in.least_throttle > -0.5, "{what}");
            assert!(way_in.longitudinal < 0.5, "{what}");
            let stood = rig.motion;
            assert!(stood.speed_mps.abs() < 0.01, "{what} {stood:?}");
            // Sampled at a tenth of a second, the plan moves off up to that much early.
            let standing = follow(&mut rig, &route, &plan, 1.8, 0.0);
            assert!((rig.motion.position - stood.position).length() < 1e-3, "{what} {standing:?}");
            assert!((rig.motion.steering_rad - stood.steering_rad).abs() < 1e-6, "{what}");
            follow(&mut rig, &route, &plan, 1.2, 0.0);
            let moved = (rig.motion.position - stood.position).length();
            assert!(moved > 0.7, "a second after the start it should have gone 1 m: {moved}, {what}");
            let way_out = follow(&mut rig, &route, &plan, 6.0, 4.0);
            assert!(way_out.longitudinal < 0.1, "{what} {way_out:?}");
        }
    }
}

#[test]
fn more_than_the_brake_can_do_pulls_the_handbrake() {
    for model in MODELS {
        let route = route(0.0, &[(200.0, 0.0)]);
        let mut rig = Rig::on(spec(model), &route, 0.0, 10.0);
        let errors = follow(&mut rig, &route, &stop_and_go(10.0, 8.5, 1.0, 30.0), 6.0, 0.0);
        assert!(errors.least_throttle <= -0.5, "{model:?} {errors:?}");
        assert!(rig.motion.speed_mps.abs() < 0.01);
    }
}

/// The place to stop comes up too early: the vehicle stops behind it and stays there.
#[test]
fn an_overshot_place_is_not_driven_back_to() {
    for model in MODELS {
        let route = route(0.0, &[(200.0, 0.0)]);
        let mut rig = Rig::on(spec(model), &route, 0.0, 8.0);
        let mut slowest = f64::INFINITY;
        for k in 0..1500 {
            if k % 2 == 0 {
                let time = rig.time();
                rig.tracker.follow(&trajectory(
                    &route,
                    &|t: f64| (if t < 0.5 { 8.0 * t } else { 4.0 }, if t < 0.5 { 8.0 } else { 0.0 }),
                    time,
                    3.0,
                    0.1,
                ));
            }
            rig.track();
            slowest = slowest.min(rig.motion.speed_mps);
        }
        let front = rig.front().position.x;
        assert!(front > 4.5, "it cannot have stopped in time: {front}");
        assert!(slowest > -0.01 && rig.motion.speed_mps.abs() < 1e-3, "{model:?} {slowest}");
    }
}

#[test]
fn a_lost_link_ends_in_a_gentle_stop_on_the_path() {
    for model in MODELS {
        let route = bends(1.0, 11.65);
        let mut rig = Rig::on(spec(model), &route, 0.0, 6.0);
        follow(&mut rig, &route, &steady(6.0), 4.5, 0.0);
        let from = route.project(rig.front().position).s;
        let mut hardest = 0.0f64;
        let mut worst = 0.0f64;
        for _ in 0..500 {
            rig.tracker.stop_on_path();
            rig.track();
            hardest = hardest.max(-rig.motion.acceleration_mps2);
            worst = worst.max(route.project(rig.front().position).lateral.abs());
        }
        let way = route.project(rig.front().position).s - from;
        assert!(rig.motion.speed_mps.abs() < 1e-3, "{model:?} {:?}", rig.motion);
        assert!(hardest <= 5.0, "{model:?} {hardest}");
        assert!(worst < 0.05, "{model:?} left its path by {worst}");
        assert!(way > 36.0 / 10.0 && way < 36.0 / 5.0, "{model:?} {way}");
        // The link is back: it goes on.
        let late = rig.time() - (from + way) / 6.0;
        let errors = follow(&mut rig, &route, &|t: f64| (6.0 * (t - late), 6.0), 5.0, 0.0);
        assert!(rig.motion.speed_mps > 5.0 && errors.exact < 0.05, "{model:?} {errors:?}");
    }
}

/// No word from the sender, and nobody calls for a stop either: the horizon is the end.
#[test]
fn a_trajectory_that_ends_in_motion_is_followed_by_a_stop() {
    for model in MODELS {
        let route = route(0.0, &[(200.0, 0.0)]);
        let mut rig = Rig::on(spec(model), &route, 0.0, 8.0);
        rig.tracker.follow(&trajectory(&route, &steady(8.0), 0.0, 4.0, 0.1));
        for _ in 0..1000 {
            rig.track();
        }
        let front = rig.front().position;
        assert!(rig.motion.speed_mps.abs() < 1e-3 && front.x < 32.0 + 64.0 / 6.0 + 1.0, "{front}");
    }
}

#[test]
fn a_car_that_lags_finds_the_bend_behind_the_first_point() {
    for model in MODELS {
        let radius = 12.0;
        let route = route(0.0, &[(12.0, 1.0 / radius); 12]);
        // 4 m behind the first point of the first trajectory, on the arc that leads to it.
        let mut rig = Rig::on(spec(model), &route, 0.0, 5.0);
        let ahead = |t: f64| (4.0 + 5.0 * t, 5.0);
        let errors = follow(&mut rig, &route, &ahead, 8.0, 1.5);
        assert!(errors.exact < 0.06, "{model:?} {errors:?}");
        let caught_up = follow(&mut rig, &route, &ahead, 6.0, 3.0);
        assert!(caught_up.longitudinal < 0.5, "{model:?} {caught_up:?}");
    }
}

/// Trajectories of one spot, again and again, while it stands at the end of a bend.
#[test]
fn coinciding_points_keep_the_last_path() {
    for model in MODELS {
        let route = route(0.0, &[(10.0, 0.0), (8.0, 0.1), (30.0, 0.0)]);
        let plan = stop_and_go(5.0, 2.5, 2.0, 4.0);
        let mut rig = Rig::on(spec(model), &route, 0.0, 5.0);
        let errors = follow(&mut rig, &route, &plan, 12.0, 0.0);
        assert!(errors.exact < 0.05 && errors.tracker < 0.05, "{model:?} {errors:?}");
        assert!(rig.motion.speed_mps > 4.5);
        // And a vehicle whose first word is to stay where it is.
        let mut rig = Rig::on(spec(model), &route, 0.0, 0.0);
        let errors = follow(&mut rig, &route, &|_: f64| (0.0, 0.0), 5.0, 0.0);
        assert!(errors.exact < 1e-3 && rig.motion.steering_rad.abs() < 1e-6, "{model:?} {errors:?}");
    }
}

#[test]
fn a_vehicle_without_a_trajectory_comes_to_a_stand() {
    for model in MODELS {
        let mut rig = Rig::new(spec(model), Pose2::default(), 5.0);
        for _ in 0..500 {
            let tracking = rig.track();
            assert!(tracking.throttle > -0.5 && tracking.lateral_error_m == 0.0);
        }
        assert!(rig.motion.speed_mps.abs() < 1e-3, "{model:?}");
    }
}

#[test]
fn nonsense_in_a_trajectory_is_left_out() {
    let route = route(0.0, &[(100.0, 0.0)]);
    let mut tracker = Tracker::default();
    let good = trajectory(&route, &steady(5.0), 0.0, 4.0, 0.1);
    tracker.follow(&good);
    let before = tracker.clone();
    let mut nonsense = good.clone();
    nonsense.points.iter_mut().for_each(|point| point.pose.position.x = f64::NAN);
    tracker.follow(&nonsense);
    assert_eq!(tracker, before, "nothing usable: the last one stays");
    let mut mixed = good.clone();
    let wild = TrajectoryPoint { time_s: f64::INFINITY, ..good.points[3] };
    mixed.points.insert(3, wild);
    mixed.points.insert(9, good.points[1]);
    let mut one = Tracker::default();
    one.follow(&mixed);
    assert_eq!(one, before);
    let spec = VehicleSpec::default();
    let tracking = one.step(&spec, &Motion::default(), 0.0, DT);
    assert!(tracking.throttle.is_finite() && tracking.actuation.steering_rad.is_finite());
}

/// The paper: a vehicle that is beyond its waypoint stops rather than reverses.
#[test]
fn a_vehicle_beyond_a_waypoint_with_a_speed_stops_and_does_not_reverse() {
    for model in MODELS {
        let route = route(0.2, &[(120.0, 0.0)]);
        let mut rig = Rig::on(spec(model), &route, 0.0, 4.0);
        // It stands at 5 m, and asks for 4 m/s there.
        let waypoint = |_: f64| (5.0, 4.0);
        let mut least_mps = f64::INFINITY;
        for k in 0..1700 {
            if k % 2 == 0 {
                rig.tracker.follow(&trajectory(&route, &waypoint, rig.time(), 4.0, 0.1));
            }
            rig.track();
            least_mps = least_mps.min(rig.motion.speed_mps);
        }
        let beyond_m = route.project(rig.front().position).s - 5.0;
        assert!(rig.motion.speed_mps.abs() < 0.01, "{model:?}: {} m/s", rig.motion.speed_mps);
        assert!((0.0..5.0).contains(&beyond_m), "{model:?}: {beyond_m} m beyond");
        assert!(least_mps > -0.05, "{model:?} reverses with {least_mps} m/s");
    }
}

#[test]
fn a_vehicle_that_has_overshot_waits_until_its_waypoint_passes() {
    for model in MODELS {
        let route = route(-1.0, &[(200.0, 0.0)]);
        let mut rig = Rig::on(spec(model), &route, 0.0, 6.0);
        // 20 m behind the vehicle, and slower.
        let waypoint = |time: f64| (3.0 * time - 20.0, 3.0);
        let (mut stood_at_m, mut passed_s) = (None, None);
        for k in 0..2500 {
            if k % 2 == 0 {
                rig.tracker.follow(&trajectory(&route, &waypoint, rig.time(), 4.0, 0.1));
            }
            rig.track();
            let front_m = route.project(rig.front().position).s;
            if stood_at_m.is_none() && rig.motion.speed_mps < 0.02 {
                stood_at_m = Some(front_m);
            }
            if passed_s.is_none() && waypoint(rig.time()).0 > front_m {
                passed_s = Some(rig.time());
                let moved_m = front_m - stood_at_m.expect("it stops before its waypoint comes");
                assert!(moved_m < 0.1, "{model:?} has moved {moved_m} m before its waypoint came");
            }
        }
        assert!(passed_s.is_some_and(|time_s| time_s < 15.0), "{model:?}: {passed_s:?}");
        let behind_m = waypoint(rig.time()).0 - route.project(rig.front().position).s;
        assert!((rig.motion.speed_mps - 3.0).abs() < 0.05, "{model:?}: {} m/s", rig.motion.speed_mps);
        assert!(behind_m.abs() < 0.5, "{model:?}: {behind_m} m behind its waypoint");
    }
}

/// Messages of a plan that brakes, each of which arrives before its first point is due: a robot whose drive is late.
#[test]
fn a_trajectory_that_is_always_a_little_ahead_is_followed_without_lag_of_speed() {
    for model in MODELS {
        let route = route(0.0, &[(200.0, 0.0)]);
        let mut rig = Rig::on(spec(model), &route, 0.0, 10.0);
        let plan = stop_and_go(10.0, 4.0, 2.0, 30.0);
        let mut most_mps = 0.0f64;
        for k in 0..450 {
            if k % 2 == 0 {
                rig.tracker.follow(&trajectory(&route, &plan, rig.time() + 0.06, 4.0, 0.1));
            }
            rig.track();
            if (2.5..4.4).contains(&rig.time()) {
                most_mps = most_mps.max(rig.motion.speed_mps - plan(rig.time()).1);
            }
        }
        assert!(most_mps < 0.4, "{model:?} is {most_mps} m/s too fast while it brakes");
    }
}
