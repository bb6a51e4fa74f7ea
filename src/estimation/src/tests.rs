//! The estimator against motions in closed form.

use super::{MotionFilter, NoiseModel, Odometer, PoseUpdate};
use city3d_geometry::lab::Pose2;
use city3d_geometry::{Lab, LengthScale, trig, wrap_angle};
use glam::DVec2;

/// Deterministic normal numbers: the sum of twelve SplitMix64 numbers.
pub(super) struct Draws(pub u64);

impl Draws {
    pub fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    pub fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }

    pub fn noisy(&mut self, pose: Pose2, position_m: f64, heading_rad: f64) -> Pose2 {
        let at = pose.position + DVec2::new(self.normal(), self.normal()) * position_m;
        Pose2::at(at, wrap_angle(pose.yaw_rad + self.normal() * heading_rad))
    }
}

/// On a circle of half a metre, at a speed that swings between 0.1 and 0.3 m/s. Pose, speed, acceleration.
pub(super) fn circle(time_s: f64) -> (Pose2, f64, f64) {
    const RADIUS_M: f64 = 0.5;
    let (sin, cos) = trig::sin_cos(time_s);
    let angle = (0.2 * time_s - 0.1 * cos + 0.1) / RADIUS_M;
    let (y, x) = trig::sin_cos(angle);
    let pose = Pose2::new(RADIUS_M * x, RADIUS_M * y, wrap_angle(angle + std::f64::consts::FRAC_PI_2));
    (pose, 0.2 + 0.1 * sin, 0.1 * cos)
}

const NOISE: NoiseModel<Lab> = NoiseModel::LABORATORY;

/// A filter that has seen the circle for a time, 100 poses a second.
fn after(until_s: f64, position_m: f64, heading_rad: f64) -> MotionFilter<Lab> {
    let (mut filter, mut draws) = (MotionFilter::new(NOISE), Draws(1));
    for k in 0..=(until_s * 100.0).round() as u32 {
        let time_s = f64::from(k) / 100.0;
        filter.update(time_s, draws.noisy(circle(time_s).0, position_m, heading_rad));
    }
    filter
}

#[test]
fn poses_without_noise_tell_the_motion_as_it_is() {
    let motion = after(5.0, 0.0, 0.0).at(5.0).unwrap();
    let (pose, speed_mps, acceleration_mps2) = circle(5.0);
    assert!(motion.pose.position.distance(pose.position) < 1e-5);
    assert!((motion.speed_mps - speed_mps).abs() < 5e-4, "{motion:?}");
    assert!((motion.velocity_mps - pose.forward() * speed_mps).length() < 5e-4, "{motion:?}");
    assert!((motion.acceleration_mps2 - acceleration_mps2).abs() < 0.03, "{motion:?}");
    assert!((motion.yaw_rate_radps - speed_mps / 0.5).abs() < 0.005, "{motion:?}");
}

#[test]
fn noise_is_found_and_told_and_the_errors_stay_within_it() {
    for (position_m, heading_rad, worst_mps) in
        [(1e-4, 1e-3, 0.003), (1e-3, 9e-3, 0.008), (2e-3, 9e-3, 0.012)]
    {
        let (mut filter, mut draws) = (MotionFilter::new(NOISE), Draws(2));
        let (mut squares, mut normalised, mut count) = (0.0, 0.0, 0.0);
        for k in 0..3000 {
            let time_s = f64::from(k) / 100.0;
            let (pose, speed_mps, _) = circle(time_s);
            filter.update(time_s, draws.noisy(pose, position_m, heading_rad));
            if k > 200 {
                let motion = filter.at(time_s).unwrap();
                let error = motion.speed_mps - speed_mps;
                squares += error * error;
                normalised += trig::powi(error / motion.std.speed_mps, 2);
                count += 1.0;
            }
        }
        let rms_mps = f64::sqrt(squares / count);
        assert!(rms_mps < worst_mps, "{rms_mps} m/s with {position_m} m");
        let share: f64 = normalised / count;
        assert!((0.2..1.5).contains(&share), "mean normalised square {share} with {position_m} m");
        let [position, heading] = filter.measured_std();
        assert!((position / position_m - 1.0).abs() < 0.3, "{position} for {position_m}");
        assert!((heading / heading_rad - 1.0).abs() < 0.3, "{heading} for {heading_rad}");
    }
}

#[test]
fn an_occluded_vehicle_goes_on_around_its_bend_and_is_less_and_less_certain() {
    let filter = after(5.0, 1e-3, 9e-3);
    let mut last_m = 0.0;
    for k in 1..=50 {
        let time_s = 5.0 + f64::from(k) / 100.0;
        let motion = filter.at(time_s).unwrap();
        let off_m = motion.pose.position.distance(circle(time_s).0.position);
        assert!(
            motion.std.position_m > last_m && off_m < 3.0 * motion.std.position_m + 0.002,
            "{off_m}: {motion:?}"
        );
        last_m = motion.std.position_m;
    }
    assert!((0.005..0.08).contains(&last_m), "{last_m} m after half a second");
    // Found again it is where it is, and goes on without a jump of its speed.
    let mut filter = filter;
    assert_eq!(filter.update(5.5, circle(5.5).0), PoseUpdate::Used);
    let motion = filter.at(5.5).unwrap();
    assert!((motion.speed_mps - circle(5.5).1).abs() < 0.05, "{motion:?}");
}

#[test]
fn outliers_are_left_out_until_it_is_plain_that_the_vehicle_was_moved() {
    let mut filter = after(5.0, 1e-4, 1e-3);
    let before = filter.at(5.01).unwrap();
    let far = Pose2::new(3.0, 2.0, 1.0);
    assert_eq!(filter.update(5.01, far), PoseUpdate::Outlier);
    assert_eq!(filter.at(5.01).unwrap(), before);
    assert_eq!(filter.update(5.02, circle(5.02).0), PoseUpdate::Used);
    let taken: Vec<PoseUpdate> = (0..20).map(|k| filter.update(5.1 + 0.01 * f64::from(k), far)).collect();
    assert_eq!(taken[0], PoseUpdate::Outlier);
    assert!(taken.contains(&PoseUpdate::Restarted), "{taken:?}");
    let motion = filter.at(5.3).unwrap();
    assert!(
        motion.pose.position.distance(far.position) < 1e-3 && motion.speed_mps.abs() < 0.01,
        "{motion:?}"
    );
    // While the clock stands the same holds at one stamp, and then the vehicle is where it is put.
    let taken: Vec<PoseUpdate> = (0..4).map(|_| filter.update(5.29, circle(0.0).0)).collect();
    assert_eq!(taken, [PoseUpdate::Outlier, PoseUpdate::Outlier, PoseUpdate::Restarted, PoseUpdate::Used]);
    filter.update(5.29, circle(1.0).0);
    assert!(filter.at(5.29).unwrap().pose.position.distance(circle(1.0).0.position) < 1e-9);
    // A heading alone that is wrong leaves the position's estimate going.
    let mut filter = after(5.0, 1e-4, 1e-3);
    let turned = Pose2::at(circle(5.01).0.position, circle(5.01).0.yaw_rad + 2.0);
    assert_eq!(filter.update(5.01, turned), PoseUpdate::Used);
    assert!(wrap_angle(filter.at(5.01).unwrap().pose.yaw_rad - circle(5.01).0.yaw_rad).abs() < 0.01);
}

#[test]
fn stamps_that_come_twice_late_or_unevenly_do_not_shake_it() {
    let (mut filter, mut draws) = (MotionFilter::new(NOISE), Draws(3));
    let mut worst_mps = 0.0_f64;
    for k in 0..2000_u32 {
        let time_s = f64::from(k) / 100.0;
        // Stamped up to 4 ms off.
        let stamp_s = time_s + 0.004 * (2.0 * draws.uniform() - 1.0);
        let pose = draws.noisy(circle(time_s).0, 1e-4, 1e-3);
        filter.update(stamp_s, pose);
        let once = filter.at(stamp_s);
        filter.update(stamp_s, pose);
        assert_eq!(filter.at(stamp_s), once, "a duplicate has changed it");
        if k > 200 && k.is_multiple_of(5) {
            assert_eq!(filter.update(stamp_s - 0.03, circle(time_s - 0.03).0), PoseUpdate::Stale);
        }
        if k > 200 {
            let motion = filter.at(time_s).unwrap();
            worst_mps = worst_mps.max((motion.speed_mps - circle(time_s).1).abs());
        }
    }
    assert!(worst_mps < 0.03, "{worst_mps} m/s");
}

#[test]
fn a_vehicle_that_was_set_up_in_motion_has_its_speed_at_once() {
    let filter = MotionFilter::moving(NOISE, 0.0, circle(0.0).0, 0.2);
    let motion = filter.at(0.1).unwrap();
    assert!((motion.speed_mps - 0.2).abs() < 1e-9 && motion.std.speed_mps < 0.1, "{motion:?}");
    assert!((motion.pose.position.y - 0.02).abs() < 1e-9, "{motion:?}");
    assert_eq!((MotionFilter::new(NOISE).at(0.1), filter.last_stamp_s()), (None, Some(0.0)));
    let mut unknown = MotionFilter::new(NOISE);
    assert_eq!(unknown.update(0.0, circle(0.0).0), PoseUpdate::Restarted);
    assert!(unknown.at(0.0).unwrap().std.speed_mps > 0.3);
}

#[test]
fn it_does_the_same_in_city_metres() {
    let (mut lab, mut city) =
        (MotionFilter::new(NOISE), MotionFilter::new(NOISE.to_city(LengthScale::TESTBED)));
    let mut draws = Draws(4);
    for k in 0..500 {
        let time_s = f64::from(k) / 100.0;
        let pose = draws.noisy(circle(time_s).0, 1e-3, 9e-3);
        assert_eq!(lab.update(time_s, pose), city.update(time_s, pose.to_city(LengthScale::TESTBED)));
    }
    let (lab, city) = (lab.at(5.1).unwrap(), city.at(5.1).unwrap());
    assert!((lab.speed_mps * 25.0 - city.speed_mps).abs() < 1e-9);
    assert!((lab.std.position_m * 25.0 - city.std.position_m).abs() < 1e-9);
    assert!((lab.yaw_rate_radps - city.yaw_rate_radps).abs() < 1e-9);
}

#[test]
fn a_clock_that_is_set_back_begins_the_estimate_anew() {
    let mut filter = after(5.0, 1e-4, 1e-3);
    assert_eq!(filter.update(0.0, circle(0.0).0), PoseUpdate::Restarted);
    assert_eq!(filter.last_stamp_s(), Some(0.0));
    assert_eq!(filter.update(3.0, circle(3.0).0), PoseUpdate::Restarted);
}

/// Ten times the noise that the model states, as an uncalibrated laboratory has it, must not look like motion.
#[test]
fn the_first_speeds_are_as_wrong_as_they_say_whatever_the_noise() {
    for (position_m, heading_rad) in [(1e-4, 1e-3), (1e-3, 9e-3), (2e-3, 9e-3)] {
        for speed_mps in [0.0, 0.3] {
            let (mut errors, mut outside) = (0, 0);
            for seed in 0..50 {
                let (mut filter, mut draws) = (MotionFilter::new(NOISE), Draws(seed));
                for k in 0..40 {
                    let time_s = f64::from(k) / 100.0;
                    let pose = Pose2::new(speed_mps * time_s, 0.0, 0.0);
                    filter.update(time_s, draws.noisy(pose, position_m, heading_rad));
                    let motion = filter.at(time_s).unwrap();
                    errors += 1;
                    outside += u32::from((motion.speed_mps - speed_mps).abs() > 3.0 * motion.std.speed_mps);
                }
            }
            let share = f64::from(outside) / f64::from(errors);
            assert!(
                share < 0.02,
                "{position_m} m, {speed_mps} m/s: {share} of the errors exceed three deviations"
            );
        }
    }
}

#[test]
fn a_vehicle_at_rest_at_its_first_pose_has_no_speed_and_no_way() {
    let scale = LengthScale::TESTBED;
    for seed in 0..50 {
        let mut filter = MotionFilter::new(NOISE.to_city(scale));
        let (mut odometer, mut draws) = (Odometer::of_unknown_speed(), Draws(seed));
        let mut fast = 0;
        for k in 0..100 {
            let time_s = f64::from(k) / 100.0;
            let seen = draws.noisy(Pose2::new(0.0, 0.0, 0.0), 1e-3, 9e-3);
            filter.update(time_s, seen.to_city(scale));
            // Motion capture is heard late.
            let motion = filter.at(time_s + 0.04).unwrap();
            odometer.update(&motion);
            let told = odometer.reported(&motion);
            fast += u32::from(told.speed_mps != 0.0);
            assert!(told.speed_mps.abs() < 3.0, "{seed}: {} m/s at {time_s} s", told.speed_mps);
            let place = if odometer.is_at_rest(&motion) { filter.at(time_s).unwrap() } else { motion };
            assert!(place.pose.position.length() < 0.25, "{seed}: {} at {time_s} s", place.pose.position);
        }
        assert!(fast <= 2, "{seed}: a speed in {fast} of 100 steps");
        assert!(odometer.distance_m() < 0.05, "{seed}: {} m", odometer.distance_m());
    }
}
