//! A vehicle of the laboratory: it is where it is measured to be.
//!
//! An alpha-beta filter over the measured poses (Kalata 1984) gives its speed, which motion capture does not
//! tell, and carries it from the instant of the newest pose to the present.

use super::raycast::chassis;
use super::wheels::{angle_of, front_headings};
use super::{Actuation, Motion, VehicleModel, VehicleSpec};
use crate::geom::{Pose2, trig, wrap_angle};
use crate::physics::{BodyId, Physics};
use crate::snapshot::{MeasuredPose, WheelState};
use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};

/// Shares of a residual that correct the pose and, over the time between two poses, its rate of change: critically
/// damped, and a speed of some centimetres a second out of a millimetre of noise in the laboratory.
const ALPHA: f64 = 0.15;
const BETA: f64 = ALPHA * ALPHA / (2.0 - ALPHA);
/// Poses nearer to one another in time tell nothing about speed.
const SHORTEST_S: f64 = 0.005;
/// After so long without a pose it counts as unseen, and is not carried on any more.
pub const UNSEEN_AFTER_S: f64 = 0.25;
/// A vehicle found so far from where it was expected was put there by hand.
const PUT_DOWN_M: f64 = 2.0;
/// Slower than this its turning says nothing about its front wheels.
const STEERS_MPS: f64 = 0.5;
/// Of the change of speed, which is shown and nothing more.
const SMOOTHING_S: f64 = 0.3;

/// What is known of it at the stamp of the newest pose.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
struct Known {
    stamp_s: f64,
    position: DVec3,
    orientation: DQuat,
    velocity_mps: DVec3,
    yaw_rate_radps: f64,
}

impl Known {
    fn first(pose: &MeasuredPose) -> Self {
        Self {
            stamp_s: pose.stamp_s,
            position: pose.position,
            orientation: pose.orientation,
            velocity_mps: DVec3::ZERO,
            yaw_rate_radps: 0.0,
        }
    }

    /// Where it is some time later.
    fn after(&self, dt_s: f64) -> (DVec3, DQuat) {
        let (sin, cos) = trig::sin_cos(self.yaw_rate_radps * dt_s / 2.0);
        let turn = DQuat::from_xyzw(0.0, 0.0, sin, cos);
        (self.position + self.velocity_mps * dt_s, turn * self.orientation)
    }

    /// Takes a pose in; an older one says nothing.
    fn take(&mut self, pose: &MeasuredPose) {
        let dt_s = pose.stamp_s - self.stamp_s;
        if dt_s == 0.0 {
            // The experiment stands, the vehicle may be moved.
            (self.position, self.orientation) = (pose.position, pose.orientation);
        }
        if dt_s <= 0.0 {
            return;
        }
        let (position, orientation) = self.after(dt_s);
        let residual = pose.position - position;
        if dt_s > UNSEEN_AFTER_S || residual.length() > PUT_DOWN_M {
            *self = Self::first(pose);
            return;
        }
        let turned = wrap_angle(yaw_of(pose.orientation) - yaw_of(orientation));
        self.stamp_s = pose.stamp_s;
        self.position = position + residual * ALPHA;
        self.orientation = orientation.lerp(pose.orientation, ALPHA);
        let rate = BETA / dt_s.max(SHORTEST_S);
        self.velocity_mps += residual * rate;
        self.yaw_rate_radps += turned * rate;
    }
}

fn yaw_of(orientation: DQuat) -> f64 {
    let forward = orientation * DVec3::X;
    trig::atan2(forward.y, forward.x)
}

/// A measured vehicle.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Measured {
    /// What other vehicles run into. It gives way to nothing.
    body: BodyId,
    known: Option<Known>,
    /// `None` before the first pose.
    is_seen: Option<bool>,
    position: DVec3,
    orientation: DQuat,
    velocity_mps: DVec3,
    acceleration_mps2: f64,
    yaw_rate_radps: f64,
    spins_rad: [f64; 4],
}

impl Measured {
    /// Puts it where it is expected; `pose` is the middle of its outline.
    pub fn spawn(physics: &mut Physics, spec: &VehicleSpec, pose: Pose2) -> Self {
        let (sin, cos) = trig::sin_cos(pose.yaw_rad / 2.0);
        Self {
            body: physics.add_guided_box(&chassis(spec, pose, 0.0)),
            known: None,
            is_seen: None,
            position: pose.position.extend(0.0),
            orientation: DQuat::from_xyzw(0.0, 0.0, sin, cos),
            velocity_mps: DVec3::ZERO,
            acceleration_mps2: 0.0,
            yaw_rate_radps: 0.0,
            spins_rad: [0.0; 4],
        }
    }

    /// Whether it was measured lately; `None` before its first pose.
    pub fn is_seen(&self) -> Option<bool> {
        self.is_seen
    }

    /// Takes a measured pose in.
    pub fn take(&mut self, pose: &MeasuredPose) {
        match &mut self.known {
            Some(known) => known.take(pose),
            None => self.known = Some(Known::first(pose)),
        }
    }

    /// Brings it to where it is at a time, as far as that is known.
    pub fn carry_to(&mut self, time_s: f64, spec: &VehicleSpec, dt_s: f64) {
        let Some(known) = &self.known else { return };
        let age_s = (time_s - known.stamp_s).max(0.0);
        let is_seen = age_s <= UNSEEN_AFTER_S;
        self.is_seen = Some(is_seen);
        (self.position, self.orientation) = known.after(age_s.min(UNSEEN_AFTER_S));
        let before = self.speed_mps();
        self.velocity_mps = if is_seen { known.velocity_mps } else { DVec3::ZERO };
        self.yaw_rate_radps = if is_seen { known.yaw_rate_radps } else { 0.0 };
        let speed_mps = self.speed_mps();
        if dt_s > 0.0 {
            let raw = (speed_mps - before) / dt_s;
            self.acceleration_mps2 += (raw - self.acceleration_mps2) * (dt_s / SMOOTHING_S).min(1.0);
        }
        for spin in &mut self.spins_rad {
            *spin += speed_mps * dt_s / spec.dimensions.wheel_radius_m;
        }
    }

    fn speed_mps(&self) -> f64 {
        self.velocity_mps.dot(self.orientation * DVec3::X)
    }

    /// By which it would turn as it does.
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
    /// It does what it does in the laboratory, whatever is asked of it here.
    fn apply(&mut self, physics: &mut Physics, _spec: &VehicleSpec, _actuation: &Actuation, _dt_s: f64) {
        physics.move_to(self.body, self.position, yaw_of(self.orientation));
    }

    fn read_back(&mut self, _physics: &Physics, spec: &VehicleSpec, _dt_s: f64) -> Motion {
        let steering_rad = self.steering_rad(spec);
        let steer = front_headings(spec, steering_rad).map(angle_of);
        let wheel = |k: usize| WheelState {
            spin_rad: self.spins_rad[k],
            steer_rad: if k < 2 { steer[k] } else { 0.0 },
            lift_m: 0.0,
        };
        Motion {
            position: self.position,
            orientation: self.orientation,
            velocity_mps: self.velocity_mps,
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
        (Measured::spawn(&mut physics, &spec, Pose2::default()), spec)
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
        assert!((car.position.x - 8.0 * 1.99).abs() < 0.01, "{}", car.position.x);
        assert!((yaw_of(car.orientation) - 0.5 * 1.99).abs() < 0.01, "{}", yaw_of(car.orientation));
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
        assert_eq!((car.is_seen(), car.velocity_mps), (Some(false), DVec3::ZERO));
        assert!((car.position.x - 8.0 * (1.99 + UNSEEN_AFTER_S)).abs() < 0.05, "{}", car.position.x);
        car.take(&pose(3.0, 50.0, 1.0));
        car.carry_to(3.0, &spec, 0.01);
        assert_eq!(car.is_seen(), Some(true));
        assert_eq!(car.position.x, 50.0);
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
                worst = worst.max((car.position.x - 8.0 * time_s).abs());
            }
        }
        assert!(worst < 0.05, "{worst} m");
    }
}
