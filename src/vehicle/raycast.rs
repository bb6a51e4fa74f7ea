//! A rigid body on four sprung wheels, each felt by a ray, with tyres that slip.
//!
//! rapier has a ray-cast vehicle of its own. It is not used: its side force takes a fixed fifth of
//! the side speed away at each step, so that cornering stiffness depends on the length of the step
//! and not on the load; its brake is an impulse that the gas switches off; and a sliding wheel
//! carries twice as much lengthwise as sideways. Here forces follow from loads, in SI units.

use super::wheels::{angle_of, front_headings, pedal, steered};
use super::{Actuation, Drive, Motion, VehicleModel, VehicleSpec};
use crate::digest::{Digest, StateHash};
use crate::geom::Pose2;
use crate::physics::{BodyId, BodyState, BoxBody, GRAVITY_MPS2, Physics};
use crate::snapshot::WheelState;
use glam::{DQuat, DVec2, DVec3};
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// Underside of the box that others run into, above the road.
const CLEARANCE_M: f64 = 0.2;
/// The box lies this far inside the outline: contact would hold slow vehicles apart before their
/// outlines overlap, and a collision is the overlap of outlines.
const BUMPER_M: f64 = 0.03;
/// Bump stops begin at this share of the spring's length at rest and are this many times stiffer.
const BUMP_LENGTH: f64 = 0.3;
const BUMP_STIFFNESS: f64 = 6.0;

/// A vehicle on four sprung wheels.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct RaycastCar {
    body: BodyId,
    steering_rad: f64,
    wheels: [WheelState; 4],
    /// Of the centre of mass along the heading at the last step, for the acceleration.
    mass_speed_mps: f64,
}

/// Spring, damper and place of one wheel, from the spec.
struct Mount {
    /// Upper end of the spring, body frame.
    top: DVec3,
    /// At rest, N.
    load: f64,
}

/// What a wheel feels of the road.
#[derive(Clone, Copy)]
struct Footprint {
    wheel: usize,
    point: DVec3,
    normal: DVec3,
    /// N.
    load: f64,
}

/// Lengthwise force of one wheel: what pushes it, and the most that may hold it.
struct Lengthwise {
    drive: f64,
    resistance: f64,
}

/// What all wheels of a step share.
struct Ride<'a> {
    spec: &'a VehicleSpec,
    state: BodyState,
    dt_s: f64,
    /// Sum of the loads, N.
    load: f64,
    /// Directions of travel of the four wheels, body frame.
    headings: [DVec2; 4],
}

/// How far gravity presses a spring of the body in.
fn sag(spec: &VehicleSpec) -> f64 {
    let heave = spec.suspension.frequency_hz * TAU;
    GRAVITY_MPS2 / (heave * heave)
}

fn mounts(spec: &VehicleSpec) -> [Mount; 4] {
    let d = &spec.dimensions;
    let (front, rear) = spec.axle_arms();
    let weight = spec.mass_kg * GRAVITY_MPS2;
    let top = d.wheel_radius_m + spec.suspension.rest_length_m - sag(spec);
    [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)].map(|(ahead, left)| Mount {
        top: DVec3::new(ahead * d.wheelbase_m / 2.0, left * d.track_m / 2.0, top),
        load: 0.5 * weight * (if ahead > 0.0 { rear } else { front }) / d.wheelbase_m,
    })
}

/// How far the springs of a body in a pose have lifted its wheels, on flat ground at z = 0.
pub(super) fn lifts_m(spec: &VehicleSpec, position: DVec3, orientation: DQuat) -> [f64; 4] {
    let up = (orientation * DVec3::Z).z.max(0.2);
    let (rest, radius) = (spec.suspension.rest_length_m, spec.dimensions.wheel_radius_m);
    mounts(spec).map(|mount| {
        let to_ground = (position + orientation * mount.top).z / up;
        rest - (to_ground - radius).min(rest) - sag(spec)
    })
}

/// The box of a vehicle: a little inside its outline, with its mass, its inertia that of a homogeneous block of the outline.
pub(super) fn chassis(spec: &VehicleSpec, pose: Pose2, speed_mps: f64) -> BoxBody {
    let d = &spec.dimensions;
    let size = DVec3::new(d.length_m, d.width_m, d.height_m);
    let square = size * size;
    let block = DVec3::new(square.y + square.z, square.x + square.z, square.x + square.y) / 12.0;
    BoxBody {
        position: pose.position.extend(0.0),
        yaw_rad: pose.yaw_rad,
        velocity_mps: pose.forward().extend(0.0) * speed_mps,
        size_m: size - DVec3::new(2.0 * BUMPER_M, 2.0 * BUMPER_M, 0.0),
        clearance_m: CLEARANCE_M.min(0.5 * d.height_m),
        mass_kg: spec.mass_kg,
        centre_of_mass_m: DVec3::new(spec.centre_of_mass.ahead_m, 0.0, spec.centre_of_mass.height_m),
        inertia_kgm2: block * DVec3::new(1.0, 1.0, spec.yaw_inertia_factor) * spec.mass_kg,
    }
}

/// Its body is hashed with the physics.
impl Digest for RaycastCar {
    fn digest(&self, hash: &mut StateHash) {
        hash.numbers([self.steering_rad, self.mass_speed_mps]);
        hash.numbers(self.wheels.iter().map(|wheel| wheel.spin_rad));
    }
}

impl RaycastCar {
    /// Puts a car on the road at its rest height, rolling at `speed_mps`.
    pub fn spawn(physics: &mut Physics, spec: &VehicleSpec, pose: Pose2, speed_mps: f64) -> Self {
        let body = physics.add_box(&chassis(spec, pose, speed_mps));
        Self { body, steering_rad: 0.0, wheels: Default::default(), mass_speed_mps: speed_mps }
    }

    /// Casts the wheels' rays and loads the springs. A wheel in the air has no footprint.
    fn footprints(
        &mut self,
        physics: &Physics,
        spec: &VehicleSpec,
        state: &BodyState,
    ) -> [Option<Footprint>; 4] {
        let up = state.orientation * DVec3::Z;
        let (rest, radius, sag) = (spec.suspension.rest_length_m, spec.dimensions.wheel_radius_m, sag(spec));
        let damping_time = 2.0 * spec.suspension.damping_ratio / (spec.suspension.frequency_hz * TAU);
        let bump = BUMP_LENGTH * (rest - sag);
        let mut footprints = [None; 4];
        for (wheel, mount) in mounts(spec).iter().enumerate() {
            let top = state.position + state.orientation * mount.top;
            let hit = physics.cast_to_ground(top, -up, rest + radius);
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
            footprints[wheel] = Some(Footprint { wheel, point, normal: hit.normal, load: load.max(0.0) });
        }
        footprints
    }
}

impl Ride<'_> {
    /// Force of the road on one wheel, without its load, and the speed along the wheel.
    ///
    /// Side and stopping forces are those at the end of the step (implicit in the wheel's share of
    /// the mass), which keeps them stable and unbiased down to standing, and lets brakes stop a
    /// wheel without ever turning it backwards.
    fn tyre(&self, footprint: &Footprint, lengthwise: &Lengthwise) -> (DVec3, f64) {
        let heading = self.headings[footprint.wheel];
        let ahead = self.state.orientation * heading.extend(0.0);
        let normal = footprint.normal;
        let ahead = (ahead - normal * ahead.dot(normal)).normalize_or(DVec3::X);
        let left = normal.cross(ahead);
        let velocity = self.state.velocity_at(footprint.point);
        let (v_ahead, v_left) = (velocity.dot(ahead), velocity.dot(left));
        let grip = self.spec.tyre_friction * footprint.load;
        if grip <= 0.0 {
            return (DVec3::ZERO, v_ahead);
        }

        let share = self.spec.mass_kg * footprint.load / self.load;
        let held = -(v_ahead * share / self.dt_s + lengthwise.drive);
        let force_ahead = lengthwise.drive + held.clamp(-lengthwise.resistance, lengthwise.resistance);

        // The wheel turns with the body during the step, away from its own velocity.
        let turned = self.dt_s * self.state.angular_velocity_radps.dot(normal) * v_ahead;
        let stiffness = self.spec.tyre_cornering * footprint.load;
        let linear = -stiffness * (v_left - turned) / (v_ahead.abs() + stiffness * self.dt_s / share);
        let force_left = grip * brush(linear / grip);

        // Friction circle.
        let demand = DVec2::new(force_ahead, force_left);
        let force = demand * (grip / demand.length().max(grip));
        (ahead * force.x + left * force.y, v_ahead)
    }
}

/// Side force of a brush tyre over its grip, for the force that it would have without a limit
/// (parabolic pressure; R. Fiala 1954).
fn brush(linear: f64) -> f64 {
    let x = linear.abs().min(3.0);
    (x - x * x / 3.0 + x * x * x / 27.0).copysign(linear)
}

impl VehicleModel for RaycastCar {
    fn apply(&mut self, physics: &mut Physics, spec: &VehicleSpec, actuation: &Actuation, dt_s: f64) {
        let Some(state) = physics.body(self.body) else { return };
        self.steering_rad = steered(spec, self.steering_rad, actuation.steering_rad, dt_s);
        let [left, right] = front_headings(spec, self.steering_rad);
        self.wheels[0].steer_rad = angle_of(left);
        self.wheels[1].steer_rad = angle_of(right);

        let footprints = self.footprints(physics, spec, &state);
        let driven = |wheel: usize| match spec.drive {
            Drive::Front => wheel < 2,
            Drive::Rear => wheel >= 2,
            Drive::All => true,
        };
        let load: f64 = footprints.iter().flatten().map(|f| f.load).sum();
        let driven_load: f64 = footprints.iter().flatten().filter(|f| driven(f.wheel)).map(|f| f.load).sum();
        let forward = state.orientation * DVec3::X;
        let motor = pedal(actuation.gas) * spec.motor_force(state.velocity_mps.dot(forward));
        let motor = if actuation.reverse { -motor } else { motor };
        let brakes =
            pedal(actuation.brake) * spec.brake_force() + pedal(actuation.handbrake) * spec.handbrake_force();

        let headings = [left, right, DVec2::X, DVec2::X];
        let ride = Ride { spec, state, dt_s, load, headings };
        let mut force = state.velocity_mps * -(spec.drag_force(1.0) * state.velocity_mps.length());
        let mut torque = DVec3::ZERO;
        for footprint in footprints.iter().flatten() {
            let lengthwise = Lengthwise {
                drive: if driven(footprint.wheel) && driven_load > 0.0 {
                    motor * footprint.load / driven_load
                } else {
                    0.0
                },
                resistance: footprint.load * spec.rolling_resistance
                    + if load > 0.0 { brakes * footprint.load / load } else { 0.0 },
            };
            let (road, v_ahead) = ride.tyre(footprint, &lengthwise);
            let road = road + footprint.normal * footprint.load;
            force += road;
            torque += (footprint.point - state.centre_of_mass).cross(road);
            let wheel = &mut self.wheels[footprint.wheel];
            wheel.spin_rad += v_ahead / spec.dimensions.wheel_radius_m * dt_s;
        }
        physics.set_force(self.body, force, torque);
    }

    fn read_back(&mut self, physics: &Physics, _spec: &VehicleSpec, dt_s: f64) -> Motion {
        let Some(state) = physics.body(self.body) else { return Motion::default() };
        // Where the wheels stand: as the body swings back from a stop, they do not.
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
        physics.remove(self.body);
    }
}
