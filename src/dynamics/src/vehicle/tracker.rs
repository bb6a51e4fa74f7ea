//! Tracking control of one vehicle: lateral control by the Stanley steering law with corrections,
//! longitudinal control by a PID on the position along the path with feed-forward (the paper, eq. 1 and its
//! section on speed).

use super::path::{NearestPoint, Path, angle_between};
use super::pedals::{HANDBRAKE_THROTTLE, pedals};
use super::{Actuation, ModelKind, Motion, VehicleSpec};
use city3d_geometry::digest::{Digest, StateHash};
use city3d_geometry::trig;
use city3d_protocol::snapshot::GRAVITY_MPS2;
use city3d_protocol::snapshot::{Trajectory, TrajectoryPoint};
use city3d_workers::prefetch_slice;
use glam::DVec2;
use serde::{Deserialize, Serialize};

/// Length of path kept behind the vehicle when trajectories are replaced: the search range plus the distance
/// of a control step.
const KEPT_BEHIND_M: f64 = 5.0;
/// A new trajectory that starts this close to the old path continues it.
const JOINS_WITHIN_M: f64 = 0.4;
const JOINS_WITHIN_RAD: f64 = 0.4;
/// A trajectory that stays within this distance does not define the shape of the path.
const SPOT_M: f64 = 0.1;
/// Search window around the last station.
const SEARCH_BEHIND_M: f64 = 4.0;
const SEARCH_AHEAD_M: f64 = 8.0;
/// A search seldom reads more nodes of a path.
const SEARCHED_NODES: usize = 16;
/// Speed below which it counts as stopped.
const STANDING_MPS: f64 = 0.1;
/// Desired speed below which it should stop.
const MOVING_MPS: f64 = 0.05;
/// Dead band: smaller position errors do not start a stopped vehicle.
const CREEP_M: f64 = 0.3;
/// Throttle that holds a standing vehicle.
const HOLDING_THROTTLE: f64 = -0.3;
/// Throttle of the hardest braking without the handbrake.
const HARDEST_BRAKING: f64 = HANDBRAKE_THROTTLE + 1e-3;
/// Deceleration of a stop on the path: least, planned, most.
const STOP_GENTLY_MPS2: f64 = 3.0;
const STOP_FIRMLY_MPS2: f64 = 4.5;
const STOP_MOST_MPS2: f64 = 4.8;
/// Gain on the speed error in such a stop, 1/s.
const STOP_GAIN: f64 = 2.0;
/// A vehicle has overshot its waypoint beyond this distance plus the distance driven in this time.
const OVERSHOOT_M: f64 = 1.0;
const OVERSHOOT_S: f64 = 0.25;
/// A trajectory that starts later is extrapolated back by up to this time at its first acceleration: messages
/// of a renewed plan overtake one another by less.
const BACKCAST_S: f64 = 0.5;
/// Anti-windup: limit of the integral term, m/s2.
const INTEGRAL_LIMIT_MPS2: f64 = 1.0;

/// A waypoint of the trajectory on the path.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct PathWaypoint {
    time_s: f64,
    station: f64,
    speed_mps: f64,
}

/// The reference at one instant: desired station, speed and acceleration.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Reference {
    station: f64,
    speed_mps: f64,
    acceleration_mps2: f64,
}

/// Motion of the front axle.
#[derive(Clone, Copy, Debug)]
struct FrontAxle {
    /// Along the path; faster than the body in a bend.
    along_mps: f64,
    /// Rate that keeps it on the path.
    steering_rate_radps: f64,
}

/// Tracking controller that keeps a vehicle's front axle on the newest trajectory.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Tracker {
    path: Path,
    waypoints: Vec<PathWaypoint>,
    /// Digest of path and waypoints, which change only with a trajectory.
    plan_hash: u64,
    /// Station of the front axle on the path.
    station: Option<f64>,
    /// Integral of the longitudinal position error, m s.
    integral: f64,
    /// Permitted speed of a stop on the path.
    stopping_mps: Option<f64>,
    /// Stop requested, until the next trajectory.
    link_lost: bool,
    /// The vehicle has passed its waypoint and stops until the waypoint passes it.
    has_overshot: bool,
    steering_rad: f64,
}

/// Output of the tracking control at one tick.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Tracking {
    /// Pedals and desired steering angle for the dynamics model.
    pub actuation: Actuation,
    /// Lateral error: front-axle centre from the path, left-positive; 0 without a path.
    pub lateral_error_m: f64,
    /// u_d of the paper, in [-1, 1].
    pub throttle: f64,
}

impl Digest for Tracker {
    fn digest(&self, hash: &mut StateHash) {
        hash.word(self.plan_hash);
        hash.optional(self.station);
        hash.optional(self.stopping_mps);
        hash.numbers([self.integral, self.steering_rad]);
        hash.flags([self.link_lost, self.has_overshot]);
    }
}

impl Tracker {
    /// Replaces the trajectory; the caller has checked its sequence number. Points that are not finite or not
    /// in time order are skipped; if none is left, the old trajectory stays.
    pub fn follow(&mut self, trajectory: &Trajectory) {
        let points = usable(&trajectory.points);
        let Some(first) = points.clone().next() else { return };
        let mut hash = self.replace_plan(first, points);
        for waypoint in &self.waypoints {
            hash.numbers([waypoint.time_s, waypoint.station, waypoint.speed_mps]);
        }
        self.plan_hash = hash.finish();
    }

    /// Returns the digest of the path.
    fn replace_plan<'a>(
        &mut self,
        first: &TrajectoryPoint,
        points: impl Iterator<Item = &'a TrajectoryPoint> + Clone,
    ) -> StateHash {
        self.link_lost = false;
        self.stopping_mps = None;

        let forward = first.pose.forward();
        let from = self.station.unwrap_or(f64::NEG_INFINITY) - KEPT_BEHIND_M;
        let joint = self.path.nearest(first.pose.position, forward, from, f64::INFINITY);
        let joint = joint.filter(|near| {
            near.path_to_left_m.abs() < JOINS_WITHIN_M
                && angle_between(near.tangent, forward).abs() < JOINS_WITHIN_RAD
        });
        self.waypoints.clear();
        let waypoint = |point: &TrajectoryPoint, station| PathWaypoint {
            time_s: point.time_s,
            station,
            speed_mps: point.speed_mps.max(0.0),
        };
        match joint {
            // All points in one spot: the old path gives the shape.
            Some(near) if stands(points.clone()) && self.path.end() > near.station => {
                self.waypoints.extend(points.map(|point| waypoint(point, near.station)));
                let mut hash = StateHash::default();
                self.path.digest(&mut hash);
                return hash;
            }
            // The old path is kept behind the new one: a lagging vehicle is still on it.
            Some(near) => {
                let from = self.station.map_or(near.station, |own| own.min(near.station));
                self.path.keep(from - KEPT_BEHIND_M, near.station - 1e-3);
                if self.path.is_empty() {
                    self.path.restart(near.station, first.pose);
                }
            }
            None => {
                self.station = None;
                self.integral = 0.0;
                self.path.restart(0.0, first.pose);
            }
        }
        let mut hash = StateHash::default();
        self.path.digest(&mut hash);
        for point in points {
            let station = self.path.push_into(point.pose, &mut hash);
            self.waypoints.push(waypoint(point, station));
        }
        hash
    }

    /// Asks for what [`Self::step`] or, with `whole`, [`Self::follow`] reads of its path: while others are worked on, it comes to
    /// the processor's cache.
    pub fn fetch(&self, whole: bool) {
        let most = if whole { usize::MAX } else { SEARCHED_NODES };
        self.path.fetch(most);
        prefetch_slice(&self.waypoints);
    }

    /// Link loss: brakes to a stop along the last path, at no more than 5 m/s2, until the next trajectory.
    /// Idempotent.
    pub fn stop_on_path(&mut self) {
        self.link_lost = true;
    }

    /// One control step at simulated time `time_s`.
    pub fn step(&mut self, spec: &VehicleSpec, motion: &Motion, time_s: f64, dt_s: f64) -> Tracking {
        let forward = motion.forward();
        let axle = motion.position.truncate() + forward * spec.dimensions.front_axle_m();
        let (from, to) = self.station.map_or((f64::NEG_INFINITY, f64::INFINITY), |station| {
            (station - SEARCH_BEHIND_M, station + SEARCH_AHEAD_M)
        });
        let nearest = self.path.nearest(axle, forward, from, to);
        let Some(nearest) = nearest else {
            // No path yet.
            let front = FrontAxle { along_mps: motion.speed_mps, steering_rate_radps: 0.0 };
            let throttle = self.stop(spec, motion, &front, f64::INFINITY, dt_s);
            return Tracking { actuation: self.actuation(throttle), lateral_error_m: 0.0, throttle };
        };
        self.station = Some(nearest.station);
        let turning = motion.yaw_rate_radps * spec.dimensions.front_axle_m();
        let velocity = motion.velocity_mps.truncate() + forward.perp() * turning;
        let along = velocity.dot(nearest.tangent);
        let rate = along * nearest.curvature - motion.yaw_rate_radps;
        let most = spec.steering_rate_radps;
        let front = FrontAxle { along_mps: along, steering_rate_radps: rate.clamp(-most, most) };

        let reference = self.reference(time_s).filter(|_| !self.link_lost);
        self.note_overshoot(reference, nearest.station, along);
        let throttle = match reference {
            Some(_) if self.has_overshot => self.stop(spec, motion, &front, 0.0, dt_s),
            Some(reference) => self.throttle(spec, motion, &front, reference, dt_s),
            None => self.stop(spec, motion, &front, self.path.end() - nearest.station, dt_s),
        };
        if along.abs() > STANDING_MPS || throttle > 0.0 {
            self.steering_rad = stanley(spec, motion, &nearest, forward, along);
        }
        Tracking { actuation: self.actuation(throttle), lateral_error_m: -nearest.path_to_left_m, throttle }
    }

    /// Detects overshoot, with hysteresis: a vehicle that has passed its waypoint stops until the waypoint passes it (the
    /// paper, section on speed control). The distance covered during a delay is no overshoot.
    fn note_overshoot(&mut self, reference: Option<Reference>, station: f64, along_mps: f64) {
        let Some(reference) = reference else {
            self.has_overshot = false;
            return;
        };
        let beyond_m = station - reference.station;
        if self.has_overshot {
            self.has_overshot = beyond_m > 0.0;
        } else {
            self.has_overshot = beyond_m > OVERSHOOT_M + OVERSHOOT_S * along_mps.max(0.0);
        }
    }

    fn actuation(&self, throttle: f64) -> Actuation {
        let (gas, brake, handbrake) = pedals(throttle);
        Actuation { gas, brake, handbrake, steering_rad: self.steering_rad, reverse: false }
    }

    /// PID controller with feed-forward and anti-windup: the throttle that keeps the front axle at its reference.
    fn throttle(
        &mut self,
        spec: &VehicleSpec,
        motion: &Motion,
        front: &FrontAxle,
        reference: Reference,
        dt_s: f64,
    ) -> f64 {
        let (along, station) = (front.along_mps, self.station.unwrap_or(0.0));
        self.stopping_mps = None;
        let gains = &spec.control;
        let error = reference.station - station;
        let shall_stand = reference.speed_mps < MOVING_MPS && reference.acceleration_mps2 <= 0.0;
        if shall_stand && error < CREEP_M && along < STANDING_MPS {
            self.integral = 0.0;
            return HOLDING_THROTTLE;
        }
        // A position error is corrected by a slightly higher speed, not by full throttle.
        let most = gains.speed_d * (1.0 + 0.1 * reference.speed_mps);
        let pull = gains.speed_p * error;
        let wanted = reference.acceleration_mps2
            + pull.clamp(-most, most)
            + gains.speed_d * (reference.speed_mps - along)
            + gains.speed_i * self.integral;
        let throttle = throttle_for(spec, motion, front, wanted);
        if throttle.abs() < 1.0 && pull.abs() < most && gains.speed_i > 0.0 {
            let limit = INTEGRAL_LIMIT_MPS2 / gains.speed_i;
            self.integral = (self.integral + error * dt_s).clamp(-limit, limit);
        }
        throttle
    }

    /// Throttle that brakes to a stop before the path ends.
    fn stop(
        &mut self,
        spec: &VehicleSpec,
        motion: &Motion,
        front: &FrontAxle,
        left_m: f64,
        dt_s: f64,
    ) -> f64 {
        let along = front.along_mps;
        self.integral = 0.0;
        if along < STANDING_MPS {
            self.stopping_mps = Some(0.0);
            return HOLDING_THROTTLE;
        }
        let planned = self.stopping_mps.unwrap_or(along);
        let needed = planned * planned / (2.0 * left_m.max(0.1));
        let braking = needed.clamp(STOP_GENTLY_MPS2, STOP_FIRMLY_MPS2);
        let planned = (planned - braking * dt_s).max(0.0);
        self.stopping_mps = Some(planned);
        let wanted = -braking + STOP_GAIN * (planned - along);
        throttle_for(spec, motion, front, wanted.clamp(-STOP_MOST_MPS2, 0.0))
    }

    /// The reference at a time; `None` after a trajectory that ends in motion.
    fn reference(&self, time_s: f64) -> Option<Reference> {
        let after = self.waypoints.partition_point(|waypoint| waypoint.time_s <= time_s);
        let before = after.checked_sub(1).map(|k| self.waypoints[k]);
        match (before, self.waypoints.get(after)) {
            (Some(a), Some(b)) => Some(between(&a, b, time_s)),
            (None, Some(first)) => Some(self.before(first, time_s)),
            (Some(last), None) if last.speed_mps < 0.3 => {
                Some(Reference { station: last.station, speed_mps: 0.0, acceleration_mps2: 0.0 })
            }
            _ => None,
        }
    }

    /// Extrapolates the reference to before the first waypoint.
    fn before(&self, first: &PathWaypoint, time_s: f64) -> Reference {
        let ahead_s = first.time_s - time_s;
        let gained = self
            .waypoints
            .get(1)
            .map_or(0.0, |second| (second.speed_mps - first.speed_mps) / (second.time_s - first.time_s));
        let changing_s = ahead_s.min(BACKCAST_S);
        let speed_mps = (first.speed_mps - gained * changing_s).max(0.0);
        let way_m = (speed_mps + first.speed_mps) / 2.0 * changing_s + speed_mps * (ahead_s - changing_s);
        let is_changing = ahead_s <= BACKCAST_S && speed_mps > 0.0;
        let acceleration_mps2 = if is_changing { gained } else { 0.0 };
        Reference { station: first.station - way_m, speed_mps, acceleration_mps2 }
    }
}

/// The finite points in time order.
fn usable(points: &[TrajectoryPoint]) -> impl Iterator<Item = &TrajectoryPoint> + Clone {
    let mut latest = f64::NEG_INFINITY;
    let finite = |p: &&TrajectoryPoint| p.pose.is_finite() && p.time_s.is_finite() && p.speed_mps.is_finite();
    points.iter().filter(finite).filter(move |point| {
        let is_later = point.time_s > latest;
        latest = latest.max(point.time_s);
        is_later
    })
}

/// Whether a trajectory is stationary.
fn stands<'a>(mut points: impl Iterator<Item = &'a TrajectoryPoint>) -> bool {
    let Some(first) = points.next() else { return true };
    points.all(|point| point.pose.position.distance_squared(first.pose.position) < SPOT_M * SPOT_M)
}

/// Interpolates between waypoints: linear in speed; the station follows, scaled to meet both.
fn between(a: &PathWaypoint, b: &PathWaypoint, time_s: f64) -> Reference {
    let lasting = b.time_s - a.time_s;
    let share = (time_s - a.time_s) / lasting;
    let gain = b.speed_mps - a.speed_mps;
    let mean = 0.5 * (a.speed_mps + b.speed_mps);
    let covered = if mean > 1e-6 { share * (a.speed_mps + 0.5 * gain * share) / mean } else { share };
    Reference {
        station: a.station + (b.station - a.station) * covered,
        speed_mps: a.speed_mps + gain * share,
        acceleration_mps2: gain / lasting,
    }
}

/// Stanley steering law with corrections (the paper, eq. 1, with the heading error in place of the heading),
/// angles left-positive, errors at the front axle: `delta = theta_e - k_a v psi_d' + atan(k_e y_e / (k_s +
/// v)) - k_y (psi' - psi_d')`.
fn stanley(spec: &VehicleSpec, motion: &Motion, nearest: &NearestPoint, forward: DVec2, along: f64) -> f64 {
    let gains = &spec.control;
    let speed = motion.speed_mps.abs();
    let heading_error = angle_between(forward, nearest.tangent);
    let desired_yaw_rate = along * nearest.curvature;
    let k_a = match spec.model {
        ModelKind::Raycast => gains.k_a,
        ModelKind::Bicycle | ModelKind::Measured => 0.0,
    };
    heading_error - k_a * speed * desired_yaw_rate
        + trig::atan(gains.k_e * nearest.path_to_left_m / (gains.k_s + speed))
        - gains.k_y * (motion.yaw_rate_radps - desired_yaw_rate)
}

/// Throttle in [-1, 1] that accelerates a vehicle as wanted, m/s2 along its heading, at its present steering angle: feed-forward
/// by the inverse model of its power balance.
pub fn throttle_for_acceleration(spec: &VehicleSpec, motion: &Motion, wanted_mps2: f64) -> f64 {
    let cos = trig::cos(motion.steering_rad).max(0.1);
    let front = FrontAxle { along_mps: motion.speed_mps / cos, steering_rate_radps: 0.0 };
    throttle_for(spec, motion, &front, wanted_mps2 / cos)
}

/// Throttle for a desired acceleration of the front axle along its path: inverse model of the vehicle's power
/// balance (feed-forward).
///
/// With the front axle at speed v_f and angle delta the kinetic energy is `m v_f^2 (cos^2 delta + rho sin^2
/// delta) / 2`, where rho accounts for rotation. The motor moves the body, which is slower than its front
/// axle by cos delta.
fn throttle_for(spec: &VehicleSpec, motion: &Motion, front: &FrontAxle, wanted_mps2: f64) -> f64 {
    let speed = motion.speed_mps;
    let (sin, cos) = trig::sin_cos(motion.steering_rad);
    let (turning, slip_drag) = match spec.model {
        ModelKind::Raycast => {
            let lateral = speed * motion.yaw_rate_radps;
            let slip = lateral / (spec.tyre_cornering * GRAVITY_MPS2);
            (spec.turning_share(), spec.mass_kg * lateral * slip)
        }
        ModelKind::Bicycle | ModelKind::Measured => (0.0, 0.0),
    };
    let speeding = wanted_mps2 * (cos * cos + turning * sin * sin) / cos;
    let bending = front.along_mps * sin * (1.0 - turning) * front.steering_rate_radps;
    let force =
        spec.mass_kg * (speeding - bending) + spec.drag_force(speed) + spec.rolling_force() + slip_drag;
    if force >= 0.0 {
        return (force / spec.motor_force(speed).max(1.0)).min(1.0);
    }
    let throttle = (force / spec.brake_force()).max(-1.0);
    // The handbrake supplements the brake.
    if throttle > 1.1 * HANDBRAKE_THROTTLE { throttle.max(HARDEST_BRAKING) } else { throttle }
}
