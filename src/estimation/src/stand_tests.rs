//! Tests of standstill detection, on exact motion and on motion estimated from noisy poses.

use super::tests::Draws;
use super::{
    MotionEstimate, MotionFilter, MotionSample, NoiseModel, Odometer, StandstillChange, StandstillDetector,
    smooth,
};
use city3d_geometry::{Lab, LengthScale, Pose2};
use glam::DVec2;

const NOISE: NoiseModel<Lab> = NoiseModel::LABORATORY;
const SCALE: f64 = 25.0;

/// Full scale, along the x axis: 4 m/s, to a stand from 10 s to 12 s by 2 m/s2, and off again by 1 m/s2. Way and speed.
fn stop_and_go(time_s: f64) -> (f64, f64) {
    let braking_s = (time_s - 8.0).clamp(0.0, 2.0);
    let going_s = (time_s - 12.0).clamp(0.0, 4.0);
    let way_m = 4.0 * time_s.min(8.0) + 4.0 * braking_s - braking_s * braking_s + going_s * going_s / 2.0;
    let then_m = 4.0 * (time_s - 16.0).max(0.0);
    let speed_mps = if time_s < 12.0 { 4.0 - 2.0 * braking_s } else { going_s };
    (way_m + then_m, speed_mps)
}

fn changes(seen: impl Iterator<Item = (f64, MotionSample)>) -> Vec<(f64, StandstillChange)> {
    let mut detector = StandstillDetector::default();
    seen.filter_map(|(time_s, seen)| Some((time_s, detector.update(time_s, &seen)?))).collect()
}

fn exact(speed_at: impl Fn(f64) -> f64) -> Vec<(f64, StandstillChange)> {
    let mut way_m = 0.0;
    changes((0..2000).map(|k| {
        let time_s = f64::from(k) / 100.0;
        way_m += speed_at(time_s) * 0.01;
        (time_s, MotionSample::exact(speed_at(time_s), DVec2::new(way_m, 0.0)))
    }))
}

#[test]
fn a_known_state_stops_below_one_speed_and_moves_off_above_the_other() {
    let found = exact(|time_s| stop_and_go(time_s).1);
    let [(stop_s, StandstillChange::Stopped), (go_s, StandstillChange::MovedOff { stood_s })] = found[..]
    else {
        panic!("{found:?}")
    };
    assert!((stop_s - 9.95).abs() < 0.011, "{stop_s}");
    // 0.4 m/s after 0.4 s; a quarter of a metre after 0.7 s.
    assert!((stood_s - 2.45).abs() < 0.02 && (go_s - 12.71).abs() < 0.03, "{stood_s} {go_s}");
}

#[test]
fn who_stands_from_the_beginning_has_not_stopped_and_one_stand_is_one() {
    let found = exact(|time_s| if time_s < 5.0 { 0.0 } else { 3.0 });
    assert!(matches!(found[..], [(_, StandstillChange::MovedOff { .. })]), "{found:?}");
    // It creeps up behind another one, and once a little faster, without getting anywhere.
    let found = exact(|time_s| match time_s {
        ..5.0 => 3.0,
        5.0..10.0 => 0.0,
        10.0..10.2 => 0.45,
        10.2..12.0 => 0.05,
        12.0..15.0 => 0.0,
        _ => 3.0,
    });
    assert!(
        matches!(found[..], [(_, StandstillChange::Stopped), (_, StandstillChange::MovedOff { .. })]),
        "{found:?}"
    );
    // Slow is not standing.
    assert_eq!(exact(|time_s| if time_s < 5.0 { 3.0 } else { 0.15 }), []);
}

/// Poses of the stop and go in the laboratory, `hz` a second, without those between `hidden_s`.
fn poses(hz: f64, position_m: f64, hidden_s: std::ops::Range<f64>) -> Vec<(f64, Pose2)> {
    let mut draws = Draws(5);
    let times = (0..(20.0 * hz) as u32).map(|k| f64::from(k) / hz);
    times
        .map(|time_s| {
            let pose = Pose2::new(stop_and_go(time_s).0 / SCALE, 0.0, 0.0);
            (time_s, draws.noisy(pose, position_m, 9e-3).to_city(LengthScale::TESTBED))
        })
        .filter(|(time_s, _)| !hidden_s.contains(time_s))
        .collect()
}

fn kinds(found: &[StandstillChange]) -> (usize, usize) {
    let stops = found.iter().filter(|change| **change == StandstillChange::Stopped).count();
    (stops, found.len() - stops)
}

#[test]
fn an_estimated_stand_is_found_once_and_gets_no_distance_out_of_noise() {
    let truth_m = stop_and_go(19.9).0;
    for (hz, position_m) in
        [(100.0, 0.0), (100.0, 1e-4), (100.0, 1e-3), (200.0, 2e-3), (50.0, 5e-4), (120.0, 3e-3)]
    {
        let poses = poses(hz, position_m, 30.0..30.0);
        let mut filter = MotionFilter::new(NOISE.to_city(LengthScale::TESTBED));
        let live: Vec<MotionEstimate> = poses
            .iter()
            .map(|(time_s, pose)| {
                filter.update(*time_s, *pose);
                filter.at(*time_s).unwrap()
            })
            .collect();
        let times: Vec<f64> = (0..1991).map(|k| f64::from(k) / 100.0).collect();
        let smoothed = smooth(&NOISE.to_city(LengthScale::TESTBED), &poses, &times);
        let smoothed: Vec<MotionEstimate> = smoothed.into_iter().flatten().collect();
        assert!(smoothed.len() > 1980, "{}", smoothed.len());
        for (name, motions, within) in [("live", live, 0.02), ("smoothed", smoothed, 0.003)] {
            let mut odometer = Odometer::default();
            let found: Vec<StandstillChange> =
                motions.iter().filter_map(|motion| odometer.update(motion)).collect();
            assert_eq!(kinds(&found), (1, 1), "{name} {hz} Hz {position_m} m: {found:?}");
            let stood_s = found.iter().find_map(|change| match change {
                StandstillChange::MovedOff { stood_s } => Some(*stood_s),
                StandstillChange::Stopped => None,
            });
            assert!((stood_s.unwrap() - 2.45).abs() < 0.5, "{name} {hz} Hz {position_m} m: {stood_s:?}");
            let share = odometer.distance_m() / truth_m - 1.0;
            assert!(share.abs() < within, "{name} {hz} Hz {position_m} m: {share}");
        }
    }
}

#[test]
fn an_occlusion_is_no_stop() {
    // Hidden while it drives, and while it stands.
    for hidden_s in [4.0..4.5, 10.3..10.8, 9.8..10.2] {
        let poses = poses(100.0, 1e-3, hidden_s.clone());
        let mut filter = MotionFilter::new(NOISE.to_city(LengthScale::TESTBED));
        let mut odometer = Odometer::default();
        let mut found = Vec::new();
        for (time_s, pose) in &poses {
            filter.update(*time_s, *pose);
            found.extend(odometer.update(&filter.at(*time_s).unwrap()));
        }
        assert_eq!(kinds(&found), (1, 1), "{hidden_s:?}: {found:?}");
    }
}

#[test]
fn the_smoother_gives_speeds_as_they_were() {
    let times: Vec<f64> = (0..1990).map(|k| f64::from(k) / 100.0).collect();
    // Tolerance in laboratory metres a second.
    for (hz, position_m, hidden_s, most_mps) in [
        (100.0, 0.0, 30.0..30.0, 5e-4),
        (100.0, 1e-3, 30.0..30.0, 3e-3),
        (200.0, 2e-3, 30.0..30.0, 3.5e-3),
        (100.0, 1e-3, 14.0..14.5, 4e-3),
    ] {
        let found = smooth(&NOISE.to_city(LengthScale::TESTBED), &poses(hz, position_m, hidden_s), &times);
        let errors = times.iter().zip(&found).map(|(time_s, motion)| {
            let motion = motion.as_ref().unwrap_or_else(|| panic!("nothing at {time_s} s"));
            (motion.speed_mps - stop_and_go(*time_s).1) / SCALE
        });
        let rms_mps = f64::sqrt(errors.map(|error| error * error).sum::<f64>() / times.len() as f64);
        assert!(rms_mps < most_mps, "{rms_mps} m/s at {hz} Hz with {position_m} m");
    }
}

#[test]
fn rounded_positions_are_as_noisy_as_their_steps() {
    let times: Vec<f64> = (0..1990).map(|k| f64::from(k) / 100.0).collect();
    let mut rounded = poses(100.0, 0.0, 30.0..30.0);
    for (_, pose) in &mut rounded {
        // Millimetres of the laboratory.
        pose.position = (pose.position / SCALE * 1000.0).round() / 1000.0 * SCALE;
    }
    let found = smooth(&NOISE.to_city(LengthScale::TESTBED), &rounded, &times);
    let errors = times
        .iter()
        .zip(&found)
        .map(|(time_s, motion)| (motion.as_ref().unwrap().speed_mps - stop_and_go(*time_s).1) / SCALE);
    let rms_mps = f64::sqrt(errors.map(|error| error * error).sum::<f64>() / times.len() as f64);
    assert!(rms_mps < 0.003, "{rms_mps} m/s");
}

#[test]
fn the_smoother_leaves_outliers_out_and_knows_nothing_of_long_gaps() {
    let mut poses = poses(100.0, 1e-3, 5.0..6.5);
    for k in [100, 101, 200, 1100, 1500] {
        poses[k].1.position.y += 10.0;
        poses[k].1.yaw_rad += 2.0;
    }
    let times: Vec<f64> = (0..1990).map(|k| f64::from(k) / 100.0).collect();
    let found = smooth(&NOISE.to_city(LengthScale::TESTBED), &poses, &times);
    for (time_s, motion) in times.iter().zip(&found) {
        assert_eq!(motion.is_none(), (5.0..6.495).contains(time_s), "{time_s}");
        if let Some(motion) = motion {
            assert!(motion.pose.position.y.abs() < 0.1 && motion.pose.yaw_rad.abs() < 0.05, "{motion:?}");
        }
    }
    // A vehicle that is faster than one of the laboratory ever is, ten poses a second.
    let fast: Vec<(f64, Pose2)> =
        (0..100).map(|k| (f64::from(k) / 10.0, Pose2::new(10.0 * f64::from(k), 0.0, 0.0))).collect();
    let found = smooth(&NOISE.to_city(LengthScale::TESTBED), &fast, &times[..900]);
    assert!(found.iter().all(|motion| motion.is_some_and(|motion| (motion.speed_mps - 100.0).abs() < 1.0)));
    // Somebody has put it elsewhere: it does not drive there.
    let mut moved = self::poses(100.0, 1e-3, 30.0..30.0);
    moved.iter_mut().filter(|(time_s, _)| *time_s > 11.0).for_each(|(_, pose)| pose.position.y += 50.0);
    let found = smooth(&NOISE.to_city(LengthScale::TESTBED), &moved, &times);
    let fastest = found.iter().flatten().map(|motion| motion.velocity_mps.y.abs()).fold(0.0, f64::max);
    assert!(fastest < 2.0, "{fastest}");
}
