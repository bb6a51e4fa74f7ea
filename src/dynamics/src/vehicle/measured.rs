//! A physical vehicle of the laboratory: its pose follows measurements.
//!
//! Its motion comes from [`MotionFilter`], which estimates speeds from poses and predicts from the newest
//! pose to the present (dead reckoning).

use super::chassis::collision_box;
use super::wheels::AckermannSteering;
use super::{Actuation, Motion, VehicleModel, VehicleSpec};
use crate::physics::{BodyId, Impetus, Physics};
use city3d_estimation::{MotionEstimate, MotionFilter, NoiseModel, Odometer, PoseUpdate, StandstillChange};
use city3d_geometry::digest::{Digest, StateHash};
use city3d_geometry::{LengthScale, Pose2, trig};
use city3d_protocol::snapshot::{MeasuredPose, WheelState};
use glam::{DQuat, DVec2, DVec3};
use serde::{Deserialize, Serialize};

/// Exponential smoothing factor of height and tilt, which affect nothing else.
const SMOOTHING: f64 = 0.15;
/// After this time without a pose it counts as unseen and is no longer predicted.
pub const UNSEEN_AFTER_S: f64 = 0.25;
/// Below this speed its yaw rate does not determine the steering angle.
const STEERS_MPS: f64 = 0.5;

fn turned(yaw_rad: f64) -> DQuat {
    let (sin, cos) = trig::sin_cos(yaw_rad / 2.0);
    DQuat::from_xyzw(0.0, 0.0, sin, cos)
}

fn yaw_of(orientation: DQuat) -> f64 {
    let forward = orientation * DVec3::X;
    trig::atan2(forward.y, forward.x)
}

/// Dynamics model of a physical vehicle: its motion is estimated from measured poses.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Measured {
    /// Kinematic body for collisions with other vehicles.
    body: BodyId,
    filter: MotionFilter,
    odometer: Odometer,
    /// Standstill transition of the last step.
    change: Option<StandstillChange>,
    /// `None` before the first pose.
    is_seen: Option<bool>,
    height_m: f64,
    tilt: DQuat,
    pose: Pose2,
    velocity_mps: DVec2,
    acceleration_mps2: f64,
    yaw_rate_radps: f64,
    spins_rad: [f64; 4],
}

impl Digest for Measured {
    fn digest(&self, hash: &mut StateHash) {
        self.filter.digest(hash);
        self.odometer.digest(hash);
        hash.flags([self.is_seen.is_some(), self.is_seen == Some(true)]);
        self.pose.digest(hash);
        self.tilt.digest(hash);
        self.velocity_mps.digest(hash);
        hash.numbers([self.height_m, self.acceleration_mps2, self.yaw_rate_radps]);
        hash.numbers(self.spins_rad);
    }
}

impl Measured {
    pub(super) fn body(&self) -> BodyId {
        self.body
    }

    /// Spawns it at its expected pose; `pose` is the middle of its outline.
    pub fn spawn(physics: &mut Physics, spec: &VehicleSpec, pose: Pose2, scale: LengthScale) -> Self {
        Self {
            body: physics.add_guided_box(&collision_box(spec, pose, 0.0)),
            filter: MotionFilter::new(NoiseModel::LABORATORY.to_city(scale)),
            odometer: Odometer::of_unknown_speed(),
            change: None,
            is_seen: None,
            height_m: 0.0,
            tilt: DQuat::IDENTITY,
            pose,
            velocity_mps: DVec2::ZERO,
            acceleration_mps2: 0.0,
            yaw_rate_radps: 0.0,
            spins_rad: [0.0; 4],
        }
    }

    /// Whether it was measured recently; `None` before its first pose.
    pub fn is_seen(&self) -> Option<bool> {
        self.is_seen
    }

    /// Standstill transition of the last step.
    pub fn stand_change(&self) -> Option<StandstillChange> {
        self.change
    }

    /// Whether it counts as stopped: standstill detection with hysteresis.
    pub fn is_standing(&self) -> bool {
        self.odometer.is_standing()
    }

    /// Distance driven since the start.
    pub fn distance_m(&self) -> f64 {
        self.odometer.distance_m()
    }

    /// Adds a measured pose.
    pub fn take(&mut self, pose: &MeasuredPose) {
        let yaw_rad = yaw_of(pose.orientation);
        let taken = self.filter.update(pose.stamp_s, Pose2::at(pose.position.truncate(), yaw_rad));
        let share = match taken {
            PoseUpdate::Restarted => 1.0,
            PoseUpdate::Used => SMOOTHING,
            PoseUpdate::Stale | PoseUpdate::Outlier => return,
        };
        self.height_m += (pose.position.z - self.height_m) * share;
        self.tilt = self.tilt.lerp(turned(-yaw_rad) * pose.orientation, share);
    }

    /// Predicts it to a time, `dt_s` after the previous one.
    pub fn carry_to(&mut self, time_s: f64, spec: &VehicleSpec, dt_s: f64) {
        self.change = None;
        let Some(stamp_s) = self.filter.last_stamp_s() else { return };
        let is_seen = time_s - stamp_s <= UNSEEN_AFTER_S;
        self.is_seen = Some(is_seen);
        let Some(motion) = self.filter.at(time_s.min(stamp_s + UNSEEN_AFTER_S)) else { return };
        if is_seen && dt_s > 0.0 {
            self.change = self.odometer.update(&motion);
        }
        // What may be noise carries it nowhere.
        let until_s = if self.odometer.is_at_rest(&motion) { stamp_s } else { motion.time_s };
        self.pose = self.filter.at(until_s).map_or(motion.pose, |then| then.pose);
        let MotionEstimate { velocity_mps, acceleration_mps2, yaw_rate_radps, .. } =
            self.odometer.reported(&motion);
        if is_seen {
            self.velocity_mps = velocity_mps;
            (self.acceleration_mps2, self.yaw_rate_radps) = (acceleration_mps2, yaw_rate_radps);
        } else {
            self.velocity_mps = DVec2::ZERO;
            (self.acceleration_mps2, self.yaw_rate_radps) = (0.0, 0.0);
        }
        let speed_mps = self.speed_mps();
        for spin in &mut self.spins_rad {
            *spin += speed_mps * dt_s / spec.dimensions.wheel_radius_m;
        }
    }

    fn speed_mps(&self) -> f64 {
        self.velocity_mps.dot(self.pose.forward())
    }

    fn position(&self) -> DVec3 {
        self.pose.position.extend(self.height_m)
    }

    /// Steering angle that explains its yaw rate (kinematic bicycle).
    fn steering_rad(&self, spec: &VehicleSpec) -> f64 {
        let speed_mps = self.speed_mps().abs();
        if speed_mps < STEERS_MPS {
            return 0.0;
        }
        let angle = trig::atan2(self.yaw_rate_radps * spec.dimensions.wheelbase_m, speed_mps);
        angle.clamp(-spec.steering_limit_rad, spec.steering_limit_rad)
    }
}

impl VehicleModel for Measured {
    /// Its actuation comes from the laboratory, not from here.
    fn actuate(
        &mut self,
        _physics: &Physics,
        _spec: &VehicleSpec,
        _actuation: &Actuation,
        _dt_s: f64,
    ) -> Option<Impetus> {
        Some(Impetus::Pose { position: self.position(), yaw_rad: self.pose.yaw_rad })
    }

    fn read_back(&mut self, _physics: &Physics, spec: &VehicleSpec, _dt_s: f64) -> Motion {
        let steering_rad = self.steering_rad(spec);
        let steer = AckermannSteering::at(spec, steering_rad).wheel_angles_rad();
        let wheel = |k: usize| WheelState {
            spin_rad: self.spins_rad[k],
            steer_rad: if k < 2 { steer[k] } else { 0.0 },
            lift_m: 0.0,
        };
        Motion {
            position: self.position(),
            orientation: turned(self.pose.yaw_rad) * self.tilt,
            velocity_mps: self.velocity_mps.extend(0.0),
            speed_mps: self.speed_mps(),
            acceleration_mps2: self.acceleration_mps2,
            yaw_rate_radps: self.yaw_rate_radps,
            steering_rad,
            wheels: [wheel(0), wheel(1), wheel(2), wheel(3)],
        }
    }

    fn remove(&mut self, physics: &mut Physics) {
        physics.remove(self.body);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose(stamp_s: f64, x: f64, yaw_rad: f64) -> MeasuredPose {
        let (sin, cos) = trig::sin_cos(yaw_rad / 2.0);
        MeasuredPose {
            stamp_s,
            position: DVec3::new(x, 0.0, 0.0),
            orientation: DQuat::from_xyzw(0.0, 0.0, sin, cos),
        }
    }

    /// A vehicle with the measures of a default one, and time since its first pose.
    fn measured() -> (Measured, VehicleSpec) {
        let (mut physics, spec) = (Physics::new(0.01), VehicleSpec::default());
        (Measured::spawn(&mut physics, &spec, Pose2::default(), LengthScale::TESTBED), spec)
    }

    #[test]
    fn it_is_carried_from_the_newest_pose_to_the_present() {
        let (mut car, spec) = measured();
        for k in 0..200 {
            let time_s = 0.01 * f64::from(k);
            // Each pose comes 30 ms late.
            car.take(&pose(time_s - 0.03, 8.0 * (time_s - 0.03), 0.5 * (time_s - 0.03)));
            car.carry_to(time_s, &spec, 0.01);
        }
        assert!((car.pose.position.x - 8.0 * 1.99).abs() < 0.01, "{}", car.pose.position.x);
        assert!((car.pose.yaw_rad - 0.5 * 1.99).abs() < 0.01, "{}", car.pose.yaw_rad);
        assert!((car.velocity_mps.x - 8.0).abs() < 0.05 && (car.yaw_rate_radps - 0.5).abs() < 0.01);
        assert_eq!(car.is_seen(), Some(true));
    }

    #[test]
    fn unseen_it_stands_where_it_would_be_by_then_and_comes_back_where_it_is_found() {
        let (mut car, spec) = measured();
        for k in 0..200 {
            let time_s = 0.01 * f64::from(k);
            car.take(&pose(time_s, 8.0 * time_s, 0.0));
            car.carry_to(time_s, &spec, 0.01);
        }
        for k in 200..300 {
            car.carry_to(0.01 * f64::from(k), &spec, 0.01);
        }
        assert_eq!((car.is_seen(), car.velocity_mps), (Some(false), DVec2::ZERO));
        assert!(
            (car.pose.position.x - 8.0 * (1.99 + UNSEEN_AFTER_S)).abs() < 0.05,
            "{}",
            car.pose.position.x
        );
        car.take(&pose(3.0, 50.0, 1.0));
        car.carry_to(3.0, &spec, 0.01);
        assert_eq!(car.is_seen(), Some(true));
        assert_eq!(car.pose.position.x, 50.0);
    }

    #[test]
    fn poses_that_have_overtaken_one_another_and_noise_do_not_shake_it() {
        let (mut car, spec) = measured();
        let mut worst = 0.0f64;
        for k in 0..400_u32 {
            let time_s = 0.01 * f64::from(k);
            // 25 mm to and fro, as a millimetre in the laboratory, and every third pose behind the next one.
            let late_s = if k.is_multiple_of(3) { 0.035 } else { 0.01 };
            let noise = if (k * 7919).is_multiple_of(2) { 0.025 } else { -0.025 };
            car.take(&pose(time_s - late_s, 8.0 * (time_s - late_s) + noise, 0.0));
            car.carry_to(time_s, &spec, 0.01);
            if k > 200 {
                worst = worst.max((car.pose.position.x - 8.0 * time_s).abs());
            }
        }
        assert!(worst < 0.05, "{worst} m");
    }
}
