//! Vehicles: how they are built, how they are controlled, how they move.

mod spec;
mod tracker;

pub use spec::{
    CentreOfMass, ControlGains, Drive, ModelKind, Motor, SpecError, Suspension, TorquePoint, VehicleSpec,
};
pub use tracker::{Tracker, Tracking};

use crate::geom::Pose2;
use crate::physics::Physics;
use crate::snapshot::WheelState;
use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};

/// What moves a vehicle: pedals in [0, 1] and the desired steering angle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Actuation {
    pub gas: f64,
    pub brake: f64,
    pub handbrake: f64,
    /// Desired angle of the front axle's middle, left-positive.
    pub steering_rad: f64,
    pub reverse: bool,
}

/// How a vehicle moves at one tick, city frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Motion {
    /// Middle of the outline, on the ground when the body is level.
    pub position: DVec3,
    /// City from body.
    pub orientation: DQuat,
    pub velocity_mps: DVec3,
    /// Along the heading, negative in reverse.
    pub speed_mps: f64,
    /// Along the heading.
    pub acceleration_mps2: f64,
    pub yaw_rate_radps: f64,
    /// Angle of the front axle's middle, after rate and limit.
    pub steering_rad: f64,
    pub wheels: [WheelState; 4],
}

/// A dynamics model around the one shared physics step.
pub trait VehicleModel {
    /// Before the step.
    fn apply(&mut self, physics: &mut Physics, spec: &VehicleSpec, actuation: &Actuation, dt_s: f64);
    /// After the step.
    fn read_back(&mut self, physics: &Physics, spec: &VehicleSpec, dt_s: f64) -> Motion;
    /// Takes everything of it out of the physics.
    fn remove(&mut self, physics: &mut Physics);
}

/// A vehicle on four sprung wheels.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct RaycastCar {}

/// A kinematic bicycle.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Bicycle {}

/// The dynamics model of one vehicle.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub enum Dynamics {
    Raycast(RaycastCar),
    Bicycle(Bicycle),
}

impl Dynamics {
    /// Puts a vehicle on the road at its rest height, rolling at `speed_mps`. `pose` is the middle
    /// of its outline.
    pub fn spawn(_physics: &mut Physics, spec: &VehicleSpec, _pose: Pose2, _speed_mps: f64) -> Self {
        match spec.model {
            ModelKind::Raycast => Self::Raycast(RaycastCar {}),
            ModelKind::Bicycle => Self::Bicycle(Bicycle {}),
        }
    }
}

impl VehicleModel for Dynamics {
    fn apply(&mut self, _physics: &mut Physics, _spec: &VehicleSpec, _actuation: &Actuation, _dt_s: f64) {}

    fn read_back(&mut self, _physics: &Physics, _spec: &VehicleSpec, _dt_s: f64) -> Motion {
        Motion::default()
    }

    fn remove(&mut self, _physics: &mut Physics) {}
}

/// The pedals for a throttle in [-1, 1] (the paper, eq. 2-4): gas, brake, handbrake.
pub fn pedals(throttle: f64) -> (f64, f64, f64) {
    if throttle <= -0.5 { (0.0, 0.0, 1.0) } else { (throttle.max(0.0), (-throttle).max(0.0), 0.0) }
}
