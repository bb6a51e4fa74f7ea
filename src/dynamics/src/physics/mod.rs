//! Rigid-body physics: the only interface to rapier.
//!
//! City frame, SI units. rapier computes in `f64`: at 2.4 km from the origin, one step of a car is only a few
//! units of `f32` precision, and its speed would be 1 % off. Physics is deterministic (rapier's
//! `enhanced-determinism`); a clone or a deserialised copy continues with the same bits.

mod free;
mod solid;

pub use free::FreeBody;

use city3d_geometry::digest::{Digest, StateHash};
use city3d_protocol::snapshot::GRAVITY_MPS2;
use glam::{DQuat, DVec2, DVec3};
use rapier3d_f64::math::{Pose, Rotation, Vector};
use rapier3d_f64::prelude::*;
use serde::{Deserialize, Serialize};

/// Collision groups.
const CHASSIS: Group = Group::GROUP_1;
const STATIC: Group = Group::GROUP_2;
const GROUND: Group = Group::GROUP_3;

/// All bodies of one world with the solver.
#[derive(Clone, Serialize, Deserialize)]
pub struct Physics {
    gravity: Vector,
    parameters: IntegrationParameters,
    islands: IslandManager,
    broad_phase: BroadPhaseBvh,
    narrow_phase: NarrowPhase,
    bodies: RigidBodySet,
    colliders: ColliderSet,
    impulse_joints: ImpulseJointSet,
    multibody_joints: MultibodyJointSet,
    soft_bodies: SoftBodySet,
    /// So many bodies are [free](FreeBody).
    free: usize,
    #[serde(skip)]
    workspace: Workspace,
}

/// Solver buffers: not state, so a copy starts with empty ones.
struct Workspace {
    pipeline: PhysicsPipeline,
    ccd: CCDSolver,
}

impl Default for Workspace {
    fn default() -> Self {
        let mut pipeline = PhysicsPipeline::new();
        // Its counters read the wall clock.
        pipeline.counters.disable();
        Self { pipeline, ccd: CCDSolver::new() }
    }
}

impl Clone for Workspace {
    fn clone(&self) -> Self {
        Self::default()
    }
}

impl std::fmt::Debug for Physics {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Physics")
            .field("dt_s", &self.parameters.dt)
            .field("bodies", &self.bodies.len())
            .field("colliders", &self.colliders.len())
            .finish_non_exhaustive()
    }
}

/// One body of a [`Physics`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct BodyId(RigidBodyHandle);

/// A box-shaped chassis. Its frame has x forward, y left, z up; the origin is on the ground under the middle
/// of the outline.
#[derive(Clone, Copy, Debug)]
pub struct BoxBody {
    /// Of the body's origin, city frame.
    pub position: DVec3,
    /// Heading, counter-clockwise from east.
    pub yaw_rad: f64,
    /// Of the whole body, city frame.
    pub velocity_mps: DVec3,
    /// Length, width, height.
    pub size_m: DVec3,
    /// Of the box's underside above the body's origin.
    pub clearance_m: f64,
    /// Of the whole body.
    pub mass_kg: f64,
    /// Body frame.
    pub centre_of_mass_m: DVec3,
    /// About the axes of the body through the centre of mass, kg m2.
    pub inertia_kgm2: DVec3,
}

/// What moves a body in the next step, city frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Impetus {
    /// Of a dynamic body, in addition to gravity and contacts.
    Forces {
        /// At the centre of mass.
        force_n: DVec3,
        /// About the axes of the city frame.
        torque_nm: DVec3,
    },
    /// Of a kinematic body: where it is after the step.
    Pose {
        /// Of the body's origin, metres.
        position: DVec3,
        /// Heading, counter-clockwise from east.
        yaw_rad: f64,
    },
}

/// Pose and velocity of a body, city frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodyState {
    /// Of the body's origin, metres.
    pub position: DVec3,
    /// City from body.
    pub orientation: DQuat,
    /// Position of the centre of mass, metres.
    pub centre_of_mass: DVec3,
    /// Of the centre of mass.
    pub velocity_mps: DVec3,
    /// About the axes of the city frame.
    pub angular_velocity_radps: DVec3,
}

impl Digest for BodyState {
    fn digest(&self, hash: &mut StateHash) {
        hash.all([&self.position, &self.velocity_mps, &self.angular_velocity_radps]);
        self.orientation.digest(hash);
    }
}

impl BodyState {
    fn of(pose: Pose, centre_of_mass: Vector, linear: Vector, angular: Vector) -> Self {
        let q = pose.rotation;
        Self {
            position: dvec(pose.translation),
            orientation: DQuat::from_xyzw(q.x, q.y, q.z, q.w).normalize(),
            centre_of_mass: dvec(centre_of_mass),
            velocity_mps: dvec(linear),
            angular_velocity_radps: dvec(angular),
        }
    }

    /// Velocity of a point of the body, given in the city frame.
    pub fn velocity_at(&self, point: DVec3) -> DVec3 {
        self.velocity_mps + self.angular_velocity_radps.cross(point - self.centre_of_mass)
    }
}

/// The hit of a ray on the ground.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GroundHit {
    /// From the ray's origin, along it.
    pub distance_m: f64,
    /// Unit vector out of the ground, city frame; zero if the ray starts below the ground.
    pub normal: DVec3,
}

impl Physics {
    /// Flat ground at z = 0 with gravity and a fixed step of `dt_s`.
    pub fn new(dt_s: f64) -> Self {
        let mut physics = Self {
            gravity: Vector::new(0.0, 0.0, -GRAVITY_MPS2),
            parameters: IntegrationParameters { dt: dt_s, ..IntegrationParameters::default() },
            islands: IslandManager::new(),
            broad_phase: BroadPhaseBvh::new(),
            narrow_phase: NarrowPhase::new(),
            bodies: RigidBodySet::new(),
            colliders: ColliderSet::new(),
            impulse_joints: ImpulseJointSet::new(),
            multibody_joints: MultibodyJointSet::new(),
            soft_bodies: SoftBodySet::new(),
            free: 0,
            workspace: Workspace::default(),
        };
        let plane = SharedShape::new(HalfSpace::new(Vector::Z));
        let ground =
            ColliderBuilder::new(plane).friction(0.5).collision_groups(groups(GROUND, CHASSIS)).build();
        physics.colliders.insert(ground);
        physics
    }

    /// Length of one step.
    pub fn dt_s(&self) -> f64 {
        self.parameters.dt
    }

    /// Adds a static obstacle. `polygon` is its simple outline in either order and may be concave; one
    /// without area is skipped and logged.
    pub fn add_static_polygon(&mut self, polygon: &[DVec2], height_m: f64) {
        match solid::extruded(polygon, height_m) {
            Some(shape) => {
                let wall = ColliderBuilder::new(shape)
                    .friction(0.4)
                    .collision_groups(groups(STATIC, CHASSIS))
                    .build();
                self.colliders.insert(wall);
            }
            None => tracing::warn!(
                corners = polygon.len(),
                height_m,
                "left out an obstacle: its outline needs three finite corners, an area and a height"
            ),
        }
    }

    /// Adds a dynamic body, moved by forces.
    pub fn add_box(&mut self, body: &BoxBody) -> BodyId {
        let properties =
            MassProperties::new(vector(body.centre_of_mass_m), body.mass_kg, vector(body.inertia_kgm2));
        let rigid = RigidBodyBuilder::dynamic()
            .pose(pose(body.position, body.yaw_rad))
            .linvel(vector(body.velocity_mps))
            .additional_mass_properties(properties)
            // A sleeping body would ignore its forces.
            .can_sleep(false)
            .build();
        self.insert(rigid, body)
    }

    /// Adds a kinematic body, which goes from [pose to pose](Impetus::Pose) and pushes others away.
    pub fn add_guided_box(&mut self, body: &BoxBody) -> BodyId {
        let rigid =
            RigidBodyBuilder::kinematic_position_based().pose(pose(body.position, body.yaw_rad)).build();
        self.insert(rigid, body)
    }

    fn insert(&mut self, mut rigid: RigidBody, body: &BoxBody) -> BodyId {
        rigid.wake_up(true);
        let handle = self.bodies.insert(rigid);
        let half = (body.size_m - DVec3::Z * body.clearance_m) / 2.0;
        let collider = ColliderBuilder::cuboid(half.x, half.y, half.z)
            .translation(Vector::new(0.0, 0.0, body.clearance_m + half.z))
            .density(0.0)
            .friction(0.3)
            .restitution(0.1)
            .collision_groups(groups(CHASSIS, CHASSIS | STATIC | GROUND))
            .build();
        self.colliders.insert_with_parent(collider, handle, &mut self.bodies);
        BodyId(handle)
    }

    /// Removes a body; a missing one is no error.
    pub fn remove(&mut self, body: BodyId) {
        let removed = self.bodies.remove(
            body.0,
            &mut self.islands,
            &mut self.colliders,
            &mut self.impulse_joints,
            &mut self.multibody_joints,
            &mut self.soft_bodies,
            true,
        );
        if removed.is_some_and(|rigid| !rigid.is_enabled()) {
            self.free -= 1;
        }
    }

    /// `None` for a body that was removed.
    pub fn body(&self, body: BodyId) -> Option<BodyState> {
        let rigid = self.bodies.get(body.0)?;
        Some(BodyState::of(*rigid.position(), rigid.center_of_mass(), rigid.linvel(), rigid.angvel()))
    }

    /// Lets a body go that nothing is near: until it is [held](Self::hold) again, it has no place here and others go through
    /// it. `None` for a body that was removed or is free.
    pub fn release(&mut self, body: BodyId) -> Option<FreeBody> {
        let rigid = self.bodies.get_mut(body.0).filter(|rigid| rigid.is_enabled())?;
        let free = FreeBody::of(rigid);
        rigid.set_enabled(false);
        self.free += 1;
        Some(free)
    }

    /// Takes a body back that was free; one that was removed is no error.
    pub fn hold(&mut self, body: BodyId, free: &FreeBody) {
        let Some(rigid) = self.bodies.get_mut(body.0) else { return };
        if !rigid.is_enabled() {
            rigid.set_enabled(true);
            self.free -= 1;
        }
        free.write_to(rigid);
    }

    /// Advances free bodies by one step, as [`Self::impel`] and [`Self::step`] do where nothing is near: several side by side
    /// take less time than one by one. Which it did: a motion that is not finite is left to the physics.
    pub fn advance<const N: usize>(&self, moves: [Option<(&mut FreeBody, Impetus)>; N]) -> [bool; N] {
        FreeBody::advance_all(moves, self.gravity, &self.parameters)
    }

    /// Lets an impetus act on a body; one that was removed is no error.
    pub fn impel(&mut self, body: BodyId, impetus: &Impetus) {
        let Some(rigid) = self.bodies.get_mut(body.0) else { return };
        match *impetus {
            Impetus::Forces { force_n, torque_nm } => {
                rigid.reset_forces(false);
                rigid.reset_torques(false);
                rigid.add_force(vector(force_n), false);
                rigid.add_torque(vector(torque_nm), false);
            }
            Impetus::Pose { position, yaw_rad } => {
                rigid.set_next_kinematic_position(pose(position, yaw_rad));
            }
        }
    }

    /// Casts a ray to the ground, the plane z = 0; nothing else stops it, so that a wheel does not hit its own chassis.
    pub fn cast_to_ground(origin: DVec3, direction: DVec3, reach_m: f64) -> Option<GroundHit> {
        if origin.z < 0.0 {
            return Some(GroundHit { distance_m: 0.0, normal: DVec3::ZERO });
        }
        let distance_m = -origin.z / direction.z;
        let hits = distance_m >= 0.0 && distance_m <= reach_m;
        hits.then_some(GroundHit { distance_m, normal: DVec3::Z })
    }

    /// Advances all bodies by one step that are not free.
    pub fn step(&mut self) {
        if self.free == self.bodies.len() {
            return;
        }
        self.workspace.pipeline.step(
            self.gravity,
            &self.parameters,
            &mut self.islands,
            &mut self.broad_phase,
            &mut self.narrow_phase,
            &mut self.bodies,
            &mut self.colliders,
            &mut self.impulse_joints,
            &mut self.multibody_joints,
            &mut self.soft_bodies,
            &mut self.workspace.ccd,
            &(),
            &(),
        );
    }
}

fn groups(memberships: Group, filter: Group) -> InteractionGroups {
    InteractionGroups::new(memberships, filter, InteractionTestMode::And)
}

fn vector(v: DVec3) -> Vector {
    Vector::new(v.x, v.y, v.z)
}

fn dvec(v: Vector) -> DVec3 {
    DVec3::new(v.x, v.y, v.z)
}

fn pose(position: DVec3, yaw_rad: f64) -> Pose {
    let (sin, cos) = city3d_geometry::trig::sin_cos(yaw_rad / 2.0);
    Pose::from_parts(vector(position), Rotation::from_xyzw(0.0, 0.0, sin, cos))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn falling_box(z: f64, x_speed: f64) -> BoxBody {
        BoxBody {
            position: DVec3::new(0.0, 0.0, z),
            yaw_rad: 0.3,
            velocity_mps: DVec3::X * x_speed,
            size_m: DVec3::new(5.0, 2.5, 1.5),
            clearance_m: 0.2,
            mass_kg: 1600.0,
            centre_of_mass_m: DVec3::Z * 0.5,
            inertia_kgm2: DVec3::new(1133.0, 3600.0, 4166.0),
        }
    }

    #[test]
    fn a_body_falls_freely_and_lands_on_its_underside() {
        let mut physics = Physics::new(0.01);
        let body = physics.add_box(&falling_box(5.0, 0.0));
        for _ in 0..50 {
            physics.step();
        }
        let z = physics.body(body).unwrap().position.z;
        assert!((z - (5.0 - 0.5 * GRAVITY_MPS2 * 0.25)).abs() < 0.06, "{z}");
        for _ in 0..400 {
            physics.step();
        }
        let z = physics.body(body).unwrap().position.z;
        assert!((z + 0.2).abs() < 0.02, "the underside lies on the ground: {z}");
    }

    #[test]
    fn walls_stop_bodies_and_rays_see_the_ground_alone() {
        for wall in [
            vec![(10.0, -5.0), (11.0, -5.0), (11.0, 5.0), (10.0, 5.0)],
            // An angle, in the other sense of turning.
            vec![(10.0, -5.0), (10.0, 5.0), (20.0, 5.0), (20.0, 4.0), (11.0, 4.0), (11.0, -5.0)],
        ] {
            let mut physics = Physics::new(0.01);
            let corners: Vec<DVec2> = wall.into_iter().map(DVec2::from).collect();
            physics.add_static_polygon(&corners, 3.0);
            let body = physics.add_box(&BoxBody { yaw_rad: 0.0, ..falling_box(-0.19, 10.0) });
            for _ in 0..200 {
                physics.step();
            }
            let x = physics.body(body).unwrap().position.x;
            assert!(x < 7.6, "{x}");
            let hit = Physics::cast_to_ground(DVec3::new(10.5, 0.0, 5.0), -DVec3::Z, 10.0).unwrap();
            assert!((hit.distance_m - 5.0).abs() < 1e-6);
            assert!(Physics::cast_to_ground(DVec3::new(10.5, 0.0, 5.0), -DVec3::Z, 4.0).is_none());
        }
    }

    /// A map may reach 25 km from its origin: a body moves there as it does at the origin.
    #[test]
    fn a_body_far_from_the_origin_moves_as_one_near_it() {
        let rolled = |start: DVec2| {
            let mut physics = Physics::new(0.01);
            let placed = BoxBody { position: start.extend(-0.19), ..falling_box(0.0, 10.0) };
            let body = physics.add_box(&placed);
            let states: Vec<BodyState> = (0..100)
                .map(|_| {
                    physics.step();
                    physics.body(body).unwrap()
                })
                .collect();
            let ways = states.windows(2).map(|pair| (pair[1].position - pair[0].position).x);
            (ways.collect::<Vec<f64>>(), states[99].velocity_mps)
        };
        let (near_m, near_mps) = rolled(DVec2::ZERO);
        let (far_m, far_mps) = rolled(DVec2::new(25_000.0, -25_000.0));
        assert!((near_mps - far_mps).length() < 1e-6, "{near_mps} and {far_mps}");
        for (near, far) in near_m.iter().zip(&far_m) {
            assert!((near - far).abs() < 1e-7, "steps of {near} m and {far} m");
        }
    }

    #[test]
    fn outlines_without_an_area_are_left_out() {
        let mut physics = Physics::new(0.01);
        let before = physics.colliders.len();
        physics.add_static_polygon(&[DVec2::ZERO, DVec2::X], 3.0);
        physics.add_static_polygon(&[DVec2::ZERO, DVec2::X, DVec2::X * 2.0], 3.0);
        physics.add_static_polygon(&[DVec2::ZERO, DVec2::X, DVec2::new(f64::NAN, 1.0)], 3.0);
        physics.add_static_polygon(&[DVec2::ZERO, DVec2::X, DVec2::Y], 0.0);
        assert_eq!(physics.colliders.len(), before);
    }
}
