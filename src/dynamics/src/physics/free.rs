//! Bodies that nothing is near. rapier has a price for each body, also where it touches nothing: islands, trees, pairs with
//! the ground and buffers of the solver come to a third of a tick. A body that has the road to itself moves alone, beside
//! other work on its vehicle, with the operations of rapier's solver in their order: the bits are the same.

use super::{BodyState, Impetus, pose, vector};
use rapier3d_f64::math::{Pose, Real, Rotation, Vector};
use rapier3d_f64::prelude::*;
use serde::{Deserialize, Serialize};

/// Largest turn within a step, as in rapier's solver.
const MOST_TURN_RAD: Real = std::f64::consts::FRAC_PI_4;

/// A body by itself: what decides how it goes on without contacts.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct FreeBody {
    pose: Pose,
    /// Of the centre of mass, and about it.
    linear: Vector,
    angular: Vector,
    /// In the frame of the body.
    mass: MassProperties,
}

impl FreeBody {
    pub(super) fn of(rigid: &RigidBody) -> Self {
        Self {
            pose: *rigid.position(),
            linear: rigid.linvel(),
            angular: rigid.angvel(),
            mass: rigid.mass_properties().local_mprops,
        }
    }

    /// Gives a body of the physics this motion.
    pub(super) fn write_to(&self, rigid: &mut RigidBody) {
        rigid.set_position(self.pose, true);
        rigid.set_linvel(self.linear, true);
        rigid.set_angvel(self.angular, true);
    }

    /// Its pose and velocity.
    pub fn state(&self) -> BodyState {
        let com = self.mass.world_com(&self.pose);
        BodyState::of(self.pose, com, self.linear, self.angular)
    }

    /// Advances bodies by one step. Which it did: those that it leads to no finite motion stay as they are.
    pub(super) fn advance_all<const N: usize>(
        mut moves: [Option<(&mut Self, Impetus)>; N],
        gravity: Vector,
        parameters: &IntegrationParameters,
    ) -> [bool; N] {
        let substeps = parameters.num_solver_iterations;
        let dt = parameters.dt / substeps as Real;
        let limits = Limits::of(parameters);
        let mut pushed: [Option<PushedBody>; N] = std::array::from_fn(|k| {
            let (body, impetus) = moves[k].as_ref()?;
            let Impetus::Forces { force_n, torque_nm } = *impetus else { return None };
            Some(PushedBody::new(body, vector(force_n), vector(torque_nm), gravity, dt))
        });
        // Side by side: the substeps of one body wait for one another, and those of several do not.
        for _ in 0..substeps {
            for (pushed, body) in pushed.iter_mut().zip(&moves) {
                if let (Some(pushed), Some((body, _))) = (pushed, body) {
                    pushed.substep(&body.mass, dt, &limits);
                }
            }
        }
        std::array::from_fn(|k| {
            let Some((body, impetus)) = &mut moves[k] else { return false };
            let (pose, linear, angular) = match (*impetus, &pushed[k]) {
                (Impetus::Pose { position, yaw_rad }, _) => {
                    body.guided(pose(position, yaw_rad), parameters, &limits)
                }
                (_, Some(moved)) => {
                    (moved.centre.prepend_translation(-body.mass.local_com), moved.linear, moved.angular)
                }
                (_, None) => return false,
            };
            let is_finite = pose.is_finite() && linear.is_finite() && angular.is_finite();
            if is_finite {
                (body.pose, body.linear, body.angular) = (pose, linear, angular);
            }
            is_finite
        })
    }

    /// A kinematic body: it is where it shall be, at the velocity that led there.
    fn guided(
        &self,
        to: Pose,
        parameters: &IntegrationParameters,
        limits: &Limits,
    ) -> (Pose, Vector, Vector) {
        let way = RigidBodyPosition { position: self.pose, next_position: to };
        let velocity = way.interpolate_velocity(parameters.inv_dt(), self.mass.local_com);
        let (mut linear, mut angular) = (velocity.linvel, velocity.angvel);
        // The solver's substeps do not move it, but their increments of zero make 0.0 of -0.0, and each of them rounds a limit.
        for _ in 0..parameters.num_solver_iterations {
            (linear, angular) = limits.limited(linear + Vector::ZERO, angular + Vector::ZERO);
        }
        (to, linear, angular)
    }
}

/// The motion of a dynamic body within a step.
struct PushedBody {
    /// The solver's poses are those of the centre of mass.
    centre: Pose,
    linear: Vector,
    angular: Vector,
    inertia: Vector,
    /// Of the velocities in each substep.
    gain: Vector,
    turn_gain: Vector,
}

impl PushedBody {
    fn new(body: &FreeBody, force: Vector, torque: Vector, gravity: Vector, dt: Real) -> Self {
        let mass = &body.mass;
        let inverse_mass = Vector::splat(mass.inv_mass);
        let force = (Vector::ZERO + force) + gravity * inverse_mass.map(inverse);
        let torque = Vector::ZERO + torque;
        Self {
            centre: body.pose.prepend_translation(mass.local_com),
            linear: body.linear,
            angular: body.angular,
            inertia: mass.principal_inertia(),
            gain: force * inverse_mass * dt,
            turn_gain: mass.world_inv_inertia(&body.pose.rotation) * torque * dt,
        }
    }

    fn substep(&mut self, mass: &MassProperties, dt: Real, limits: &Limits) {
        let Self { centre, linear, angular, .. } = self;
        *linear += self.gain;
        *angular += self.turn_gain;
        let axes = centre.rotation * mass.principal_inertia_local_frame;
        *angular = gyroscopic(*angular, axes, self.inertia, mass.inv_principal_inertia, dt);
        (*linear, *angular) = limits.limited(*linear, *angular);
        let half_turn = *angular * (dt * 0.5);
        let turn = Rotation::from_xyzw(half_turn.x, half_turn.y, half_turn.z, 1.0);
        centre.rotation = turn * centre.rotation;
        centre.rotation = centre.rotation.normalize();
        centre.translation += *linear * dt;
    }
}

/// Limits of the solver on velocities.
struct Limits {
    most: Real,
    most_turning: Real,
}

impl Limits {
    fn of(parameters: &IntegrationParameters) -> Self {
        let most_turning = MOST_TURN_RAD * parameters.inv_dt();
        Self { most: parameters.max_linear_velocity(), most_turning }
    }

    fn limited(&self, mut linear: Vector, mut angular: Vector) -> (Vector, Vector) {
        // By their squares nearly all velocities are found to be within.
        let may_exceed = |v: Vector, most: Real| v.length_squared() > most * most * NEARLY;
        if may_exceed(linear, self.most) {
            let speed = linear.length();
            if speed > self.most {
                linear *= self.most / speed;
            }
        }
        if may_exceed(angular, self.most_turning) {
            let turning = angular.length();
            if turning > self.most_turning {
                angular *= self.most_turning / turning;
            }
        }
        (linear, angular)
    }
}

/// One less more than squares and roots are rounded by.
const NEARLY: Real = 1.0 - 1e-9;

/// Angular velocity after a time without torque: an explicit step that keeps the angular momentum.
fn gyroscopic(angular: Vector, axes: Rotation, inertia: Vector, inverse: Vector, dt: Real) -> Vector {
    let own = axes.inverse() * angular;
    let momentum = inertia * own;
    let change = -own.cross(momentum) * dt;
    let total = momentum + change;
    let square = total.length_squared();
    if square == 0.0 {
        return angular;
    }
    let kept = total * (momentum.length_squared() / square).sqrt();
    axes * (inverse * kept)
}

fn inverse(value: Real) -> Real {
    if value == 0.0 { 0.0 } else { 1.0 / value }
}

#[cfg(test)]
mod tests {
    use super::super::{BodyId, BoxBody, Physics};
    use super::*;
    use glam::DVec3;

    fn tumbling_box() -> BoxBody {
        BoxBody {
            position: DVec3::new(3.0, -20.0, 30.0),
            yaw_rad: 0.3,
            velocity_mps: DVec3::new(12.0, -3.0, 1.0),
            size_m: DVec3::new(5.0, 2.5, 1.5),
            clearance_m: 0.2,
            mass_kg: 1600.0,
            centre_of_mass_m: DVec3::new(0.1, 0.0, 0.5),
            inertia_kgm2: DVec3::new(1133.0, 3600.0, 4166.0),
        }
    }

    /// Bodies of one physics after each of some steps, and of another where they are free between steps 5 and 60.
    fn assert_equal(add: fn(&mut Physics, &BoxBody) -> BodyId, impetus: impl Fn(u32) -> Impetus, steps: u32) {
        let mut physics = [Physics::new(0.01), Physics::new(0.01)];
        let body = add(&mut physics[0], &tumbling_box());
        assert_eq!(add(&mut physics[1], &tumbling_box()), body);
        let mut free: Option<FreeBody> = None;
        for step in 0..steps {
            let impetus = impetus(step);
            physics[0].impel(body, &impetus);
            physics[0].step();
            match step {
                5 => free = physics[1].release(body),
                60 => physics[1].hold(body, &free.take().unwrap()),
                _ => {}
            }
            match &mut free {
                Some(free) => assert_eq!(physics[1].advance([Some((free, impetus))]), [true]),
                None => physics[1].impel(body, &impetus),
            }
            physics[1].step();
            let state = free.as_ref().map_or_else(|| physics[1].body(body), |free| Some(free.state()));
            assert_eq!(state.map(bits), physics[0].body(body).map(bits), "step {step}");
        }
    }

    fn bits(state: BodyState) -> Vec<u64> {
        let vectors =
            [state.position, state.centre_of_mass, state.velocity_mps, state.angular_velocity_radps];
        let numbers = vectors.iter().flat_map(|v| v.to_array());
        numbers.chain(state.orientation.to_array()).map(f64::to_bits).collect()
    }

    #[test]
    fn a_free_body_moves_with_the_bits_of_one_in_the_physics() {
        let forces = |step: u32| {
            let k = f64::from(step);
            Impetus::Forces {
                force_n: DVec3::new(900.0 - 20.0 * k, 35.0 * k, 15_000.0),
                torque_nm: DVec3::new(300.0 - 7.0 * k, 2000.0, -400.0 + 11.0 * k),
            }
        };
        assert_equal(Physics::add_box, forces, 100);
    }

    #[test]
    fn a_free_body_without_torque_keeps_turning_alike() {
        let pushed_once = |step: u32| {
            let torque_nm = if step < 3 { DVec3::new(3e4, 2e4, 9e4) } else { DVec3::ZERO };
            Impetus::Forces { force_n: DVec3::ZERO, torque_nm }
        };
        assert_equal(Physics::add_box, pushed_once, 100);
    }

    #[test]
    fn a_free_guided_body_has_the_velocity_of_one_in_the_physics() {
        let poses = |step: u32| {
            let k = f64::from(step) / 10.0;
            // A heading behind which the other sense of turning begins, too.
            let yaw_rad = if step == 20 { -3.1 } else { 0.3 + k.min(3.0) };
            Impetus::Pose { position: DVec3::new(3.0 + k * k, -20.0 - k, 0.0), yaw_rad }
        };
        assert_equal(Physics::add_guided_box, poses, 100);
    }

    #[test]
    fn what_is_not_finite_is_left_to_the_physics() {
        let mut physics = Physics::new(0.01);
        let body = physics.add_box(&tumbling_box());
        let mut free = physics.release(body).unwrap();
        let before = bits(free.state());
        let impetus = Impetus::Forces { force_n: DVec3::X * f64::NAN, torque_nm: DVec3::ZERO };
        assert_eq!(physics.advance([Some((&mut free, impetus)), None]), [false; 2]);
        assert_eq!(bits(free.state()), before);
    }
}
