//! Kinematic bicycle model: no tyre slip, with motor, brakes and resistances of the specification. The
//! reference point is the middle of the rear axle.

use super::chassis::{Chassis, collision_box};
use super::wheels::{AckermannSteering, pedal, steered};
use super::{Actuation, Motion, VehicleModel, VehicleSpec};
use crate::physics::{Impetus, Physics};
use city3d_geometry::digest::{Digest, StateHash};
use city3d_geometry::{Pose2, trig, wrap_angle};
use city3d_protocol::snapshot::WheelState;
use glam::{DQuat, DVec2};
use serde::{Deserialize, Serialize};

/// A vehicle with the kinematic bicycle model.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Bicycle {
    /// Kinematic body for collisions with other vehicles.
    chassis: Chassis,
    rear: Pose2,
    speed_mps: f64,
    acceleration_mps2: f64,
    steering_rad: f64,
    spins_rad: [f64; 4],
}

impl Digest for Bicycle {
    fn digest(&self, hash: &mut StateHash) {
        self.rear.digest(hash);
        hash.numbers([self.speed_mps, self.acceleration_mps2, self.steering_rad]);
        hash.numbers(self.spins_rad);
    }
}

impl Bicycle {
    pub(super) fn chassis(&self) -> &Chassis {
        &self.chassis
    }

    pub(super) fn chassis_mut(&mut self) -> &mut Chassis {
        &mut self.chassis
    }

    /// Spawns it on the road, rolling at `speed_mps`; `pose` is the middle of its outline.
    pub fn spawn(physics: &mut Physics, spec: &VehicleSpec, pose: Pose2, speed_mps: f64) -> Self {
        Self {
            chassis: Chassis::of(physics.add_guided_box(&collision_box(spec, pose, speed_mps))),
            rear: pose.advanced(-spec.dimensions.wheelbase_m / 2.0),
            speed_mps,
            acceleration_mps2: 0.0,
            steering_rad: 0.0,
            spins_rad: [0.0; 4],
        }
    }

    /// The middle of its outline, and the unit vector of its heading.
    fn middle(&self, spec: &VehicleSpec) -> (Pose2, DVec2) {
        let forward = self.rear.forward();
        let position = self.rear.point_towards(forward, spec.dimensions.wheelbase_m / 2.0, 0.0);
        (Pose2::at(position, self.rear.yaw_rad), forward)
    }
}

/// Longitudinal force: motor less brakes and resistances, which stop the vehicle within the step at most;
/// limited by the grip of its tyres.
fn longitudinal_force(spec: &VehicleSpec, actuation: &Actuation, speed_mps: f64, dt_s: f64) -> f64 {
    let motor = pedal(actuation.gas) * spec.motor_force(speed_mps);
    let drive = if actuation.reverse { -motor } else { motor } - spec.drag_force(speed_mps);
    let brakes = pedal(actuation.brake) * spec.brake_force()
        + pedal(actuation.handbrake) * spec.handbrake_force()
        + spec.rolling_force();
    let held = -(speed_mps * spec.mass_kg / dt_s + drive);
    let grip = spec.grip_force();
    (drive + held.clamp(-brakes, brakes)).clamp(-grip, grip)
}

impl VehicleModel for Bicycle {
    fn actuate(
        &mut self,
        _physics: &Physics,
        spec: &VehicleSpec,
        actuation: &Actuation,
        dt_s: f64,
    ) -> Option<Impetus> {
        self.steering_rad = steered(spec, self.steering_rad, actuation.steering_rad, dt_s);
        let before = self.speed_mps;
        self.acceleration_mps2 = longitudinal_force(spec, actuation, before, dt_s) / spec.mass_kg;
        self.speed_mps = before + self.acceleration_mps2 * dt_s;
        let mean = 0.5 * (before + self.speed_mps);
        let steering = AckermannSteering::at(spec, self.steering_rad);
        let turn = steering.yaw_rate_radps(spec, mean) * dt_s;
        let chord: Pose2 = Pose2::at(self.rear.position, self.rear.yaw_rad + turn / 2.0);
        self.rear = Pose2::at(chord.point_at(mean * dt_s, 0.0), wrap_angle(self.rear.yaw_rad + turn));
        let d = &spec.dimensions;
        for (wheel, spin) in self.spins_rad.iter_mut().enumerate() {
            let side = if wheel % 2 == 0 { -d.track_m / 2.0 } else { d.track_m / 2.0 };
            let along = mean * dt_s + turn * side;
            // A steered front wheel is faster by 1 / cos of its angle.
            let along = if wheel < 2 { along / steering.headings[wheel].x } else { along };
            *spin += along / d.wheel_radius_m;
        }
        let (middle, _) = self.middle(spec);
        Some(Impetus::Pose { position: middle.position.extend(0.0), yaw_rad: middle.yaw_rad })
    }

    fn read_back(&mut self, _physics: &Physics, spec: &VehicleSpec, _dt_s: f64) -> Motion {
        let (middle, forward) = self.middle(spec);
        let steering = AckermannSteering::at(spec, self.steering_rad);
        let yaw_rate = steering.yaw_rate_radps(spec, self.speed_mps);
        let sideways = yaw_rate * spec.dimensions.wheelbase_m / 2.0;
        let velocity = forward * self.speed_mps + forward.perp() * sideways;
        let (sin, cos) = trig::sin_cos(middle.yaw_rad / 2.0);
        let steer = steering.wheel_angles_rad();
        let wheel = |k: usize| WheelState {
            spin_rad: self.spins_rad[k],
            steer_rad: if k < 2 { steer[k] } else { 0.0 },
            lift_m: 0.0,
        };
        Motion {
            position: middle.position.extend(0.0),
            orientation: DQuat::from_xyzw(0.0, 0.0, sin, cos),
            velocity_mps: velocity.extend(0.0),
            speed_mps: self.speed_mps,
            acceleration_mps2: self.acceleration_mps2,
            yaw_rate_radps: yaw_rate,
            steering_rad: self.steering_rad,
            wheels: [wheel(0), wheel(1), wheel(2), wheel(3)],
        }
    }

    fn remove(&mut self, physics: &mut Physics) {
        physics.remove(self.chassis.body());
    }
}
