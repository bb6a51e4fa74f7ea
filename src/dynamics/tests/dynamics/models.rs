//! Vehicles by hand: what motor, brakes, tyres, steering and suspension do, against closed forms.

use crate::rig::{DT, MODELS, Rig, brake, gas, spec};
use city3d_dynamics::physics::Physics;
use city3d_dynamics::vehicle::{
    Actuation, Drive, Dynamics, ModelKind, VehicleModel, VehicleSpec, throttle_for_acceleration,
};
use city3d_geometry::{LengthScale, Pose2, trig};
use glam::DVec2;

const GRAVITY: f64 = 9.81;

fn at_origin(spec: VehicleSpec, speed: f64) -> Rig {
    Rig::new(spec, Pose2::default(), speed)
}

fn within(found: f64, expected: f64, share: f64, what: &str) {
    assert!((found - expected).abs() <= share * expected.abs(), "{what}: {found:.3}, expected {expected:.3}");
}

/// Without resistances the force is that of the motor, and v = F t / m.
#[test]
fn acceleration_follows_from_torque_and_mass() {
    for model in MODELS {
        for (torque, mass) in [(100.0, 1600.0), (200.0, 1600.0), (200.0, 2400.0), (50.0, 900.0)] {
            let mut car = spec(model);
            car.mass_kg = mass;
            car.drive = Drive::All;
            car.drag_area_m2 = 0.0;
            car.rolling_resistance = 0.0;
            car.motor.torque_curve.iter_mut().for_each(|point| point.torque_nm = torque);
            let force = torque * car.motor.gear_ratio / car.dimensions.wheel_radius_m;
            let mut rig = at_origin(car, 0.0);
            while rig.motion.speed_mps < 10.0 {
                rig.drive(&gas());
                assert!(rig.time() < 60.0, "too slow: {:?}", rig.motion);
            }
            within(rig.time(), mass * 10.0 / force, 0.1, &format!("{model:?} {torque} N m, {mass} kg"));
        }
    }
}

/// A front-driven car with more torque than grip: a = mu g b / (L + mu h), its own load transfer included.
#[test]
fn traction_ends_where_the_tyres_do() {
    let mut car = spec(ModelKind::Raycast);
    car.motor.torque_curve.iter_mut().for_each(|point| point.torque_nm *= 4.0);
    car.motor.max_power_w = 1e6;
    let (rear_arm, wheelbase) = (car.dimensions.wheelbase_m / 2.0, car.dimensions.wheelbase_m);
    let limit = car.tyre_friction * GRAVITY * rear_arm
        / (wheelbase + car.tyre_friction * car.centre_of_mass.height_m);
    let mut rig = at_origin(car, 0.0);
    for _ in 0..200 {
        rig.drive(&gas());
    }
    within(rig.motion.speed_mps / rig.time(), limit, 0.1, "traction");
}

/// P = (rho / 2 CdA v^2 + c m g) v.
#[test]
fn top_speed_follows_from_power_and_drag() {
    for model in MODELS {
        for (power, drag_area) in [(30e3, 0.65), (60e3, 2.0)] {
            let mut car = spec(model);
            car.motor.max_power_w = power;
            car.drag_area_m2 = drag_area;
            let resistance =
                |v: f64| 0.5 * 1.225 * drag_area * v * v + car.rolling_resistance * car.mass_kg * GRAVITY;
            let expected =
                (0..100_000).map(|k| f64::from(k) * 1e-3).find(|&v| resistance(v) * v > power).unwrap();
            let mut rig = at_origin(car, expected - 8.0);
            for _ in 0..15_000 {
                rig.drive(&gas());
            }
            within(rig.motion.speed_mps, expected, 0.05, &format!("{model:?} {power} W"));
            assert!(rig.motion.acceleration_mps2.abs() < 0.05);
        }
    }
}

/// The front axle's track at the stop of the steering has the radius L / sin(limit).
#[test]
fn the_throttle_for_an_acceleration_gives_it_on_straights_and_in_bends() {
    for model in MODELS {
        for (speed, steering_rad, wanted) in [(5.0, 0.0, 1.0), (8.0, 0.0, -2.0), (5.0, 0.15, 1.0)] {
            let mut rig = Rig::new(spec(model), Pose2::new(0.0, 0.0, 0.0), speed);
            // The steering gets where it is to be, and the tyres settle.
            for _ in 0..100 {
                let throttle = throttle_for_acceleration(&rig.spec, &rig.motion, 0.0);
                let (gas, brake) = (throttle.max(0.0), (-throttle).max(0.0));
                rig.drive(&Actuation { gas, brake, steering_rad, ..Actuation::default() });
            }
            let before = rig.motion.speed_mps;
            for _ in 0..100 {
                let throttle = throttle_for_acceleration(&rig.spec, &rig.motion, wanted);
                let (gas, brake) = (throttle.max(0.0), (-throttle).max(0.0));
                rig.drive(&Actuation { gas, brake, steering_rad, ..Actuation::default() });
            }
            let gained = rig.motion.speed_mps - before;
            assert!((gained - wanted).abs() < 0.1, "{model:?} {speed} {steering_rad}: {gained} in a second");
        }
    }
}

#[test]
fn the_turning_circle_follows_from_the_steering_limit() {
    for model in MODELS {
        for degrees in [20.0f64, 45.0] {
            let car = VehicleSpec { steering_limit_rad: degrees.to_radians(), ..spec(model) };
            let radius = car.dimensions.wheelbase_m / trig::sin(degrees.to_radians());
            let mut rig = at_origin(car, 2.5);
            let mut track = Vec::new();
            for step in 0..4000 {
                let gas = (0.5 * (2.5 - rig.motion.speed_mps)).clamp(0.0, 1.0);
                rig.drive(&Actuation { gas, steering_rad: 9.0, ..Actuation::default() });
                if step > 800 {
                    track.push(rig.front().position);
                }
            }
            let low = track.iter().fold(DVec2::INFINITY, |low, p| low.min(*p));
            let high = track.iter().fold(DVec2::NEG_INFINITY, |high, p| high.max(*p));
            let diameter = 0.5 * ((high - low).x + (high - low).y);
            within(diameter / 2.0, radius, 0.1, &format!("{model:?} {degrees} degrees"));
        }
    }
}

/// v^2 / 2a with a = min(brake, grip) + rolling resistance (drag adds a hundredth).
#[test]
fn braking_distance_follows_from_brake_and_grip() {
    for model in MODELS {
        for (torque, friction) in [(6500.0, 0.9), (6500.0, 0.4), (1500.0, 0.9)] {
            let car = VehicleSpec { brake_torque_nm: torque, tyre_friction: friction, ..spec(model) };
            let brake_alone = torque / car.dimensions.wheel_radius_m / car.mass_kg;
            let deceleration = (brake_alone + car.rolling_resistance * GRAVITY).min(friction * GRAVITY);
            let mut rig = at_origin(car, 12.5);
            while rig.motion.speed_mps > 0.01 {
                rig.drive(&brake());
                assert!(rig.time() < 30.0);
            }
            let expected = 12.5 * 12.5 / (2.0 * deceleration);
            within(rig.motion.position.x, expected, 0.1, &format!("{model:?} {torque} N m, mu {friction}"));
        }
    }
}

#[test]
fn the_handbrake_is_bounded_by_its_torque_and_by_the_tyres() {
    for model in MODELS {
        for (torque, friction) in [(4500.0, 0.9), (1000.0, 0.9), (1e6, 0.9), (4500.0, 0.3)] {
            let car = VehicleSpec { handbrake_torque_nm: torque, tyre_friction: friction, ..spec(model) };
            let bound = (torque / car.dimensions.wheel_radius_m / car.mass_kg).min(friction * GRAVITY);
            let resistance = car.rolling_resistance * GRAVITY + 0.05;
            let mut rig = at_origin(car, 10.0);
            let pull = Actuation { handbrake: 1.0, ..Actuation::default() };
            let mut hardest = 0.0f64;
            for _ in 0..60 {
                rig.drive(&pull);
                hardest = hardest.max(-rig.motion.acceleration_mps2);
            }
            let mean = (10.0 - rig.motion.speed_mps) / rig.time();
            // Pitching moves the middle of the body a little for its own part.
            assert!(hardest < 1.1 * bound + resistance + 0.2, "{model:?} {torque}: {hardest} > {bound}");
            within(mean, bound, 0.1, &format!("{model:?} {torque} N m, mu {friction}"));
        }
    }
}

#[test]
fn a_braking_car_stops_and_stays() {
    let brakes = [
        brake(),
        Actuation { brake: 0.3, ..Actuation::default() },
        Actuation { handbrake: 1.0, ..Actuation::default() },
        Actuation { brake: 1.0, steering_rad: 0.4, ..Actuation::default() },
    ];
    for model in MODELS {
        for pedals in brakes {
            let mut rig = Rig::new(spec(model), Pose2::new(60.0, -50.0, 0.7), 8.75);
            let mut slowest = f64::INFINITY;
            for _ in 0..700 {
                rig.drive(&pedals);
                slowest = slowest.min(rig.motion.speed_mps);
            }
            let stood = rig.motion.pose();
            for _ in 0..2000 {
                rig.drive(&pedals);
                slowest = slowest.min(rig.motion.speed_mps);
            }
            let moved = rig.motion.pose();
            assert!(slowest >= -0.01, "{model:?} {pedals:?} rolled back: {slowest}");
            assert!(rig.motion.speed_mps.abs() < 1e-3);
            assert!((moved.position - stood.position).length() < 1e-3, "{model:?} {stood:?} {moved:?}");
            assert!((moved.yaw_rad - stood.yaw_rad).abs() < 1e-4);
            // And goes on when they let go.
            for _ in 0..100 {
                rig.drive(&gas());
            }
            assert!(rig.motion.speed_mps > 2.0, "{model:?} {pedals:?} locked: {:?}", rig.motion);
        }
    }
}

#[test]
fn gas_and_brake_together_do_not_drive_backwards() {
    for model in MODELS {
        let mut rig = at_origin(spec(model), 5.0);
        let both = Actuation { gas: 1.0, brake: 1.0, ..Actuation::default() };
        for _ in 0..500 {
            rig.drive(&both);
            assert!(rig.motion.speed_mps > -0.01);
        }
        assert!(rig.motion.speed_mps < 0.01, "the brake is the stronger: {:?}", rig.motion.speed_mps);
        let mut rig = at_origin(spec(model), 0.0);
        let back = Actuation { gas: 0.3, reverse: true, ..Actuation::default() };
        for _ in 0..200 {
            rig.drive(&back);
        }
        assert!(rig.motion.speed_mps < -1.0, "reverse drives backwards");
    }
}

#[test]
fn a_car_left_alone_goes_straight() {
    for model in MODELS {
        let mut rig = at_origin(spec(model), 12.0);
        for _ in 0..4000 {
            let gas = (0.5 * (12.0 - rig.motion.speed_mps)).clamp(0.0, 1.0);
            rig.drive(&Actuation { gas, ..Actuation::default() });
        }
        let pose = rig.motion.pose();
        assert!(pose.position.x > 400.0);
        assert!(pose.position.y.abs() < 0.02 && pose.yaw_rad.abs() < 1e-4, "{model:?} {pose:?}");
    }
}

#[test]
fn a_spawned_car_rests_on_its_wheels_from_the_first_tick() {
    for model in MODELS {
        for (speed, ahead) in [(0.0, 0.0), (12.5, 0.0), (6.0, 0.3), (6.0, -0.4)] {
            let mut car = spec(model);
            car.centre_of_mass.ahead_m = ahead;
            let mut rig = Rig::new(car, Pose2::new(-70.0, 65.0, 2.0), speed);
            for _ in 0..300 {
                rig.drive(&Actuation::default());
                let motion = &rig.motion;
                assert!(motion.velocity_mps.z.abs() < 0.01, "{model:?} {speed} bounces: {motion:?}");
                assert!(motion.position.z.abs() < 0.005, "{motion:?}");
                assert!(motion.acceleration_mps2.abs() < 0.4, "{model:?} {speed}: {motion:?}");
                assert!(motion.wheels.iter().all(|wheel| wheel.lift_m.abs() < 0.005));
            }
            let rolled = rig.motion.wheels[3].spin_rad * rig.spec.dimensions.wheel_radius_m;
            let way = (rig.motion.position.truncate() - DVec2::new(-70.0, 65.0)).length();
            assert!((rolled - way).abs() < 0.02 * way + 0.01, "wheels roll: {rolled} {way}");
        }
    }
}

/// Both springs and weight: the outer wheels are pressed in by m a h / (k track) in a steady turn.
#[test]
fn the_body_leans_out_of_a_bend_and_its_wheels_turn_apart() {
    let mut rig = at_origin(spec(ModelKind::Raycast), 6.0);
    for _ in 0..400 {
        let gas = (0.5 * (6.0 - rig.motion.speed_mps)).clamp(0.0, 1.0);
        rig.drive(&Actuation { gas, steering_rad: 0.25, ..Actuation::default() });
    }
    let car = &rig.spec;
    let stiffness = trig::powi(car.suspension.frequency_hz * std::f64::consts::TAU, 2) * car.mass_kg;
    let lateral = rig.motion.speed_mps * rig.motion.yaw_rate_radps;
    // The lean moves the weight outwards as well.
    let track = car.dimensions.track_m;
    let height = car.centre_of_mass.height_m;
    let lean =
        car.mass_kg * lateral * height / (stiffness * track * track / 4.0 - car.mass_kg * GRAVITY * height);
    let [_, _, left, right] = rig.motion.wheels;
    within((right.lift_m - left.lift_m) / track, lean, 0.15, "lean");
    let [left, right, ..] = rig.motion.wheels;
    assert!(left.steer_rad > 0.25 && right.steer_rad < 0.25, "{left:?} {right:?}");
}

#[test]
fn cars_crash_into_walls_and_into_one_another() {
    let wall = [(20.0, -10.0), (21.0, -10.0), (21.0, 10.0), (20.0, 10.0)].map(DVec2::from);
    let mut rig = at_origin(spec(ModelKind::Raycast), 10.0);
    rig.physics.add_static_polygon(&wall, 3.0);
    for _ in 0..400 {
        rig.drive(&Actuation::default());
        assert!(rig.motion.position.x < 17.7, "through the wall: {:?}", rig.motion.position);
    }
    assert!(rig.motion.position.x > 10.0 && rig.motion.position.z.abs() < 0.1);

    for model in MODELS {
        // Into a standing car of the same mass: it is pushed ahead; a bicycle gives way to nothing.
        let mut rig = Rig::new(spec(model), Pose2::new(-10.0, 0.3, 0.0), 8.0);
        let other_spec = spec(ModelKind::Raycast);
        let mut other =
            Dynamics::spawn(&mut rig.physics, &other_spec, (Pose2::default(), 0.0), LengthScale::TESTBED);
        let mut pushed = 0.0f64;
        for _ in 0..300 {
            let impetus = other.actuate(&rig.physics, &other_spec, &Actuation::default(), DT).unwrap();
            rig.physics.impel(other.body(), &impetus);
            rig.drive(&Actuation::default());
            pushed = pushed.max(other.read_back(&rig.physics, &other_spec, DT).velocity_mps.x);
        }
        assert!(pushed > 3.0, "{model:?} {pushed}");
        let after = rig.motion.velocity_mps.x;
        match model {
            ModelKind::Raycast => assert!(after < 5.5, "momentum went over: {after}"),
            ModelKind::Bicycle | ModelKind::Measured => assert!(after > 7.0, "{after}"),
        }
        other.remove(&mut rig.physics);
        assert!(format!("{:?}", rig.physics).contains("bodies: 1"));
    }
}

#[test]
fn pedals_that_are_no_numbers_do_no_harm() {
    for model in MODELS {
        let mut rig = at_origin(spec(model), 5.0);
        let nonsense = Actuation {
            gas: f64::NAN,
            brake: -3.0,
            handbrake: f64::NAN,
            steering_rad: f64::NAN,
            reverse: false,
        };
        for _ in 0..100 {
            rig.drive(&nonsense);
        }
        let motion = rig.motion;
        assert!(motion.position.is_finite() && (motion.speed_mps - 5.0).abs() < 0.3, "{motion:?}");
    }
}

fn busy(model: ModelKind) -> Rig {
    let mut rig = Rig::new(spec(model), Pose2::new(3.0, 4.0, 0.5), 6.0);
    rig.physics
        .add_static_polygon(&[(30.0, 0.0), (31.0, 40.0), (29.0, 40.0), (29.5, 20.0)].map(DVec2::from), 3.0);
    rig
}

fn swerve(rig: &mut Rig, steps: u32) {
    for _ in 0..steps {
        let phase = rig.time();
        let steering_rad = 0.3 * ((phase * 0.7).fract() - 0.5);
        let brake = if phase % 3.0 < 0.4 { 0.6 } else { 0.0 };
        rig.drive(&Actuation { gas: 0.4, brake, steering_rad, ..Actuation::default() });
    }
}

#[test]
fn copies_and_saved_worlds_go_on_with_the_same_bits() {
    for model in MODELS {
        let mut rig = busy(model);
        swerve(&mut rig, 237);
        let mut clone = rig.clone();
        let mut saved = Vec::new();
        ciborium::into_writer(&rig, &mut saved).unwrap();
        let mut loaded: Rig = ciborium::from_reader(saved.as_slice()).unwrap();
        for _ in 0..100 {
            for copy in [&mut rig, &mut clone, &mut loaded] {
                // Into the wall at some point: contacts have state as well.
                swerve(copy, 10);
            }
            assert_eq!(rig.motion, clone.motion, "{model:?} clone at {}", rig.tick);
            assert_eq!(rig.motion, loaded.motion, "{model:?} loaded at {}", rig.tick);
        }
        // The whole state, not just what is read back.
        let bytes = |rig: &Rig| {
            let mut bytes = Vec::new();
            ciborium::into_writer(rig, &mut bytes).unwrap();
            bytes
        };
        assert_eq!(bytes(&rig), bytes(&clone));
        assert_eq!(bytes(&rig), bytes(&loaded));
    }
}

#[test]
fn two_runs_have_the_same_bits() {
    for model in MODELS {
        let run = || {
            let mut rig = busy(model);
            swerve(&mut rig, 1000);
            rig.motion
        };
        assert_eq!(run(), run());
    }
    assert_eq!(Physics::new(DT).dt_s(), DT);
}
