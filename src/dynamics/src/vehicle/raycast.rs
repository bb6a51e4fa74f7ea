//! Ray-cast vehicle: a rigid body on four spring-damper wheels whose ground contact is a ray, with brush
//! tyres.
//!
//! rapier's own ray-cast vehicle is not used. Its side force removes a fixed fifth of the side speed per
//! step, so cornering stiffness depends on the step length and not on the load; its brake is an impulse that
//! the gas switches off; and a sliding wheel carries twice as much longitudinally as laterally. Here forces
//! follow from loads, in SI units.

use super::chassis::{Chassis, collision_box};
use super::wheels::{AckermannSteering, pedal, steered};
use super::{Actuation, Drive, Motion, VehicleModel, VehicleSpec};
use crate::physics::{BodyState, Impetus, Physics};
use city3d_geometry::Pose2;
use city3d_geometry::digest::{Digest, StateHash};
use city3d_protocol::snapshot::GRAVITY_MPS2;
use city3d_protocol::snapshot::WheelState;
use glam::{DQuat, DVec2, DVec3};
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// Bump stops: start as a share of the spring's rest length, and stiffness relative to the spring.
const BUMP_LENGTH: f64 = 0.3;
const BUMP_STIFFNESS: f64 = 6.0;

/// A vehicle with the ray-cast model.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct RaycastCar {
    chassis: Chassis,
    steering_rad: f64,
    wheels: [WheelState; 4],
    /// Speed of the centre of mass along the heading at the last step, for the acceleration.
    mass_speed_mps: f64,
}

/// Suspension mount of one wheel.
struct SpringMount {
    /// Upper end of the spring, body frame.
    top: DVec3,
    /// Static load, N.
    load: f64,
}

/// The contact of a wheel with the road.
#[derive(Clone, Copy)]
struct WheelContact {
    wheel: usize,
    point: DVec3,
    normal: DVec3,
    /// N.
    load: f64,
}

/// Longitudinal force of one wheel: drive force, and the largest resistance.
struct LongitudinalForce {
    drive: f64,
    resistance: f64,
}

/// Quantities shared by all wheels in a step.
struct ChassisStep<'a> {
    spec: &'a VehicleSpec,
    state: BodyState,
    dt_s: f64,
    /// Sum of the loads, N.
    load: f64,
    /// Rolling directions of the four wheels, body frame.
    headings: [DVec2; 4],
}

/// Static deflection of a spring.
fn sag(spec: &VehicleSpec) -> f64 {
    let heave = spec.suspension.frequency_hz * TAU;
    GRAVITY_MPS2 / (heave * heave)
}

fn spring_mounts(spec: &VehicleSpec) -> [SpringMount; 4] {
    let d = &spec.dimensions;
    let (front, rear) = spec.axle_arms();
    let weight = spec.mass_kg * GRAVITY_MPS2;
    let top = d.wheel_radius_m + spec.suspension.rest_length_m - sag(spec);
    [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)].map(|(ahead, left)| SpringMount {
        top: DVec3::new(ahead * d.wheelbase_m / 2.0, left * d.track_m / 2.0, top),
        load: 0.5 * weight * (if ahead > 0.0 { rear } else { front }) / d.wheelbase_m,
    })
}

/// Suspension travel of the wheels for a body pose on flat ground at z = 0.
pub(super) fn lifts_m(spec: &VehicleSpec, position: DVec3, orientation: DQuat) -> [f64; 4] {
    let up = (orientation * DVec3::Z).z.max(0.2);
    let (rest, radius) = (spec.suspension.rest_length_m, spec.dimensions.wheel_radius_m);
    spring_mounts(spec).map(|mount| {
        let to_ground = (position + orientation * mount.top).z / up;
        rest - (to_ground - radius).min(rest) - sag(spec)
    })
}

impl Digest for RaycastCar {
    fn digest(&self, hash: &mut StateHash) {
        hash.numbers([self.steering_rad, self.mass_speed_mps]);
        hash.numbers(self.wheels.iter().map(|wheel| wheel.spin_rad));
    }
}

impl RaycastCar {
    pub(super) fn chassis(&self) -> &Chassis {
        &self.chassis
    }

    pub(super) fn chassis_mut(&mut self) -> &mut Chassis {
        &mut self.chassis
    }

    /// Spawns a car on the road at its rest height, rolling at `speed_mps`.
    pub fn spawn(physics: &mut Physics, spec: &VehicleSpec, pose: Pose2, speed_mps: f64) -> Self {
        let chassis = Chassis::of(physics.add_box(&collision_box(spec, pose, speed_mps)));
        Self { chassis, steering_rad: 0.0, wheels: Default::default(), mass_speed_mps: speed_mps }
    }

    /// Casts the wheels' rays and computes spring and damper loads. A wheel in the air has no contact.
    fn contacts(&mut self, spec: &VehicleSpec, state: &BodyState) -> [Option<WheelContact>; 4] {
        let up = state.orientation * DVec3::Z;
        let (rest, radius, sag) = (spec.suspension.rest_length_m, spec.dimensions.wheel_radius_m, sag(spec));
        let damping_time = 2.0 * spec.suspension.damping_ratio / (spec.suspension.frequency_hz * TAU);
        let bump = BUMP_LENGTH * (rest - sag);
        let mut contacts = [None; 4];
        for (wheel, mount) in spring_mounts(spec).iter().enumerate() {
            let top = state.position + state.orientation * mount.top;
            let hit = Physics::cast_to_ground(top, -up, rest + radius);
            let Some(hit) = hit.filter(|hit| hit.normal.dot(up) > 0.2) else {
                self.wheels[wheel].lift_m = -sag;
                continue;
            };
            let point = top - up * hit.distance_m;
            let length = hit.distance_m - radius;
            self.wheels[wheel].lift_m = rest - length - sag;
            let stiffness = mount.load / sag;
            let closing = -state.velocity_at(point).dot(hit.normal);
            let load = stiffness
                * (rest - length
                    + damping_time * closing
                    + (BUMP_STIFFNESS - 1.0) * (bump - length).max(0.0));
            contacts[wheel] = Some(WheelContact { wheel, point, normal: hit.normal, load: load.max(0.0) });
        }
        contacts
    }
}

impl ChassisStep<'_> {
    /// Force of one tyre (brush model, limited by the friction circle) without its load, and the speed along the wheel.
    ///
    /// Lateral and braking forces are implicit: those at the end of the step for the wheel's share of the
    /// mass. They are stable and unbiased down to standstill, and brakes never turn a wheel backwards.
    fn tyre(&self, contact: &WheelContact, longitudinal: &LongitudinalForce) -> (DVec3, f64) {
        let heading = self.headings[contact.wheel];
        let ahead = self.state.orientation * heading.extend(0.0);
        let normal = contact.normal;
        let ahead = (ahead - normal * ahead.dot(normal)).normalize_or(DVec3::X);
        let left = normal.cross(ahead);
        let velocity = self.state.velocity_at(contact.point);
        let (v_ahead, v_left) = (velocity.dot(ahead), velocity.dot(left));
        let grip = self.spec.tyre_friction * contact.load;
        if grip <= 0.0 {
            return (DVec3::ZERO, v_ahead);
        }

        let share = self.spec.mass_kg * contact.load / self.load;
        let held = -(v_ahead * share / self.dt_s + longitudinal.drive);
        let force_ahead = longitudinal.drive + held.clamp(-longitudinal.resistance, longitudinal.resistance);

        // The wheel turns with the body during the step, which changes its slip angle.
        let turned = self.dt_s * self.state.angular_velocity_radps.dot(normal) * v_ahead;
        let stiffness = self.spec.tyre_cornering * contact.load;
        let linear = -stiffness * (v_left - turned) / (v_ahead.abs() + stiffness * self.dt_s / share);
        let force_left = grip * brush_tyre(linear / grip);

        // Friction circle: the resultant of longitudinal and lateral force is limited by grip.
        let demand = DVec2::new(force_ahead, force_left);
        let force = demand * (grip / demand.length().max(grip));
        (ahead * force.x + left * force.y, v_ahead)
    }
}

/// Brush tyre model: lateral force over grip as a function of the linear force over grip (parabolic pressure;
/// Fiala 1954).
fn brush_tyre(linear: f64) -> f64 {
    let x = linear.abs().min(3.0);
    (x - x * x / 3.0 + x * x * x / 27.0).copysign(linear)
}

impl VehicleModel for RaycastCar {
    fn actuate(
        &mut self,
        physics: &Physics,
        spec: &VehicleSpec,
        actuation: &Actuation,
        dt_s: f64,
    ) -> Option<Impetus> {
        let state = self.chassis.state(physics)?;
        self.steering_rad = steered(spec, self.steering_rad, actuation.steering_rad, dt_s);
        let steering = AckermannSteering::at(spec, self.steering_rad);
        [self.wheels[0].steer_rad, self.wheels[1].steer_rad] = steering.wheel_angles_rad();

        let contacts = self.contacts(spec, &state);
        let driven = |wheel: usize| match spec.drive {
            Drive::Front => wheel < 2,
            Drive::Rear => wheel >= 2,
            Drive::All => true,
        };
        let load: f64 = contacts.iter().flatten().map(|f| f.load).sum();
        let driven_load: f64 = contacts.iter().flatten().filter(|f| driven(f.wheel)).map(|f| f.load).sum();
        let forward = state.orientation * DVec3::X;
        let motor = pedal(actuation.gas) * spec.motor_force(state.velocity_mps.dot(forward));
        let motor = if actuation.reverse { -motor } else { motor };
        let brakes =
            pedal(actuation.brake) * spec.brake_force() + pedal(actuation.handbrake) * spec.handbrake_force();

        let [left, right] = steering.headings;
        let headings = [left, right, DVec2::X, DVec2::X];
        let ride = ChassisStep { spec, state, dt_s, load, headings };
        let mut force = state.velocity_mps * -(spec.drag_force(1.0) * state.velocity_mps.length());
        let mut torque = DVec3::ZERO;
        for contact in contacts.iter().flatten() {
            let longitudinal = LongitudinalForce {
                drive: if driven(contact.wheel) && driven_load > 0.0 {
                    motor * contact.load / driven_load
                } else {
                    0.0
                },
                resistance: contact.load * spec.rolling_resistance
                    + if load > 0.0 { brakes * contact.load / load } else { 0.0 },
            };
            let (road, v_ahead) = ride.tyre(contact, &longitudinal);
            let road = road + contact.normal * contact.load;
            force += road;
            torque += (contact.point - state.centre_of_mass).cross(road);
            let wheel = &mut self.wheels[contact.wheel];
            wheel.spin_rad += v_ahead / spec.dimensions.wheel_radius_m * dt_s;
        }
        Some(Impetus::Forces { force_n: force, torque_nm: torque })
    }

    fn read_back(&mut self, physics: &Physics, _spec: &VehicleSpec, dt_s: f64) -> Motion {
        let Some(state) = self.chassis.state(physics) else { return Motion::default() };
        // Wheels that stand do not roll while the body swings back from a stop.
        let velocity = state.velocity_at(state.position);
        let forward = (state.orientation * DVec3::X).truncate().normalize_or(DVec2::X);
        let speed = velocity.truncate().dot(forward);
        let mass_speed = state.velocity_mps.truncate().dot(forward);
        let acceleration = (mass_speed - self.mass_speed_mps) / dt_s;
        self.mass_speed_mps = mass_speed;
        Motion {
            position: state.position,
            orientation: state.orientation,
            velocity_mps: velocity,
            speed_mps: speed,
            acceleration_mps2: acceleration,
            yaw_rate_radps: state.angular_velocity_radps.z,
            steering_rad: self.steering_rad,
            wheels: self.wheels,
        }
    }

    fn remove(&mut self, physics: &mut Physics) {
        physics.remove(self.chassis.body());
    }
}
