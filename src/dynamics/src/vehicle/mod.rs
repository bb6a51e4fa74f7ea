//! Vehicles: specification, tracking control and dynamics models.
//!
//! City frame and full-scale SI units throughout. A vehicle has a [`VehicleSpec`], a [`Dynamics`] model and a
//! [`Tracker`] that keeps its front axle on a trajectory. At each tick the tracker computes an [`Actuation`]
//! from the last [`Motion`], the model says what that does to its body, all bodies make one physics step, and the model
//! reads its motion back.

mod bicycle;
mod chassis;
mod measured;
mod path;
mod pedals;
mod raycast;
mod tracker;
mod wheels;

pub use bicycle::Bicycle;
pub use chassis::clears_ground;
pub use city3d_protocol::snapshot::{
    CentreOfMass, ControlGains, Drive, GRAVITY_MPS2, ModelKind, Motor, SpecError, Suspension, TorquePoint,
    VehicleSpec,
};
pub use measured::{Measured, UNSEEN_AFTER_S};
pub use pedals::pedals;
pub use raycast::RaycastCar;
pub use tracker::{Tracker, Tracking, throttle_for_acceleration};
pub use wheels::set_wheels;

use crate::physics::{BodyId, BodyState, FreeBody, Impetus, Physics};
use chassis::Chassis;
use city3d_geometry::digest::{Digest, StateHash};
use city3d_geometry::{LengthScale, Pose2, trig};
use city3d_protocol::snapshot::{VehicleState, WheelState};
use glam::{DQuat, DVec2, DVec3};
use serde::{Deserialize, Serialize};

/// Actuator commands: pedals in [0, 1] and the desired steering angle. Values outside are clamped; NaN
/// releases a pedal and holds the steering angle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Actuation {
    /// Gas pedal: share of the motor force that is available at the present speed.
    pub gas: f64,
    /// Brake pedal: share of the largest force of the service brake.
    pub brake: f64,
    /// Handbrake lever: share of its largest force.
    pub handbrake: f64,
    /// Desired steering angle of the equivalent single front wheel, left-positive.
    pub steering_rad: f64,
    /// The motor drives backwards.
    pub reverse: bool,
}

/// Motion of a vehicle at one tick, city frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Motion {
    /// Middle of the outline, on the ground when the body is level.
    pub position: DVec3,
    /// City from body.
    pub orientation: DQuat,
    /// Of [`Self::position`].
    pub velocity_mps: DVec3,
    /// Along the heading, at road level, negative in reverse.
    pub speed_mps: f64,
    /// Along the heading, of the centre of mass, over the last step.
    pub acceleration_mps2: f64,
    /// About the vertical, left-positive.
    pub yaw_rate_radps: f64,
    /// Steering angle of the equivalent single front wheel, after rate and limit.
    pub steering_rad: f64,
    /// Front left, front right, rear left, rear right.
    pub wheels: [WheelState; 4],
}

impl Motion {
    /// The motion of a vehicle's state, which has all of it.
    pub fn of(state: &VehicleState) -> Self {
        Self {
            position: state.position,
            orientation: state.orientation,
            velocity_mps: state.velocity_mps,
            speed_mps: state.speed_mps,
            acceleration_mps2: state.acceleration_mps2,
            yaw_rate_radps: state.yaw_rate_radps,
            steering_rad: state.steering_rad,
            wheels: state.wheels,
        }
    }

    /// Unit vector of the heading, seen from above.
    pub fn forward(&self) -> DVec2 {
        (self.orientation * DVec3::X).truncate().normalize_or(DVec2::X)
    }

    /// Middle of the outline and heading, seen from above.
    pub fn pose(&self) -> Pose2 {
        let forward = self.orientation * DVec3::X;
        Pose2::at(self.position.truncate(), trig::atan2(forward.y, forward.x))
    }
}

/// An interchangeable dynamics model around the shared physics step.
pub trait VehicleModel {
    /// Before the step: what the actuation does to its [body](Dynamics::body), for [`Physics::impel`]; `None` where the physics
    /// does not have it. `dt_s` is the step length.
    fn actuate(
        &mut self,
        physics: &Physics,
        spec: &VehicleSpec,
        actuation: &Actuation,
        dt_s: f64,
    ) -> Option<Impetus>;
    /// Reads the motion back, once after each step.
    fn read_back(&mut self, physics: &Physics, spec: &VehicleSpec, dt_s: f64) -> Motion;
    /// Removes its bodies from the physics.
    fn remove(&mut self, physics: &mut Physics);
}

/// The dynamics model of one vehicle.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub enum Dynamics {
    /// Rigid body on four sprung wheels with tyre slip.
    Raycast(RaycastCar),
    /// Kinematic bicycle model without tyre slip.
    Bicycle(Bicycle),
    /// Physical vehicle of the laboratory, which follows its measured poses.
    Measured(Box<Measured>),
}

impl Dynamics {
    /// Spawns a vehicle on the road at its rest height, rolling at `speed_mps`. `pose` is the middle of its
    /// outline; `spec` has passed [`VehicleSpec::validate`]. `scale` is that of the laboratory in which a
    /// physical vehicle is measured.
    pub fn spawn(
        physics: &mut Physics,
        spec: &VehicleSpec,
        (pose, speed_mps): (Pose2, f64),
        scale: LengthScale,
    ) -> Self {
        match spec.model {
            ModelKind::Raycast => Self::Raycast(RaycastCar::spawn(physics, spec, pose, speed_mps)),
            ModelKind::Bicycle => Self::Bicycle(Bicycle::spawn(physics, spec, pose, speed_mps)),
            ModelKind::Measured => Self::Measured(Box::new(Measured::spawn(physics, spec, pose, scale))),
        }
    }

    /// What others run into.
    pub fn body(&self) -> BodyId {
        match self {
            Self::Raycast(car) => car.chassis().body(),
            Self::Bicycle(bicycle) => bicycle.chassis().body(),
            Self::Measured(measured) => measured.body(),
        }
    }

    /// Pose and velocity of its body; `None` where the physics does not have it.
    pub fn body_state(&self, physics: &Physics) -> Option<BodyState> {
        match self {
            Self::Raycast(car) => car.chassis().state(physics),
            Self::Bicycle(bicycle) => bicycle.chassis().state(physics),
            Self::Measured(measured) => physics.body(measured.body()),
        }
    }

    /// Whether others that run into it move it. The others push them away.
    pub fn gives_way(&self) -> bool {
        matches!(self, Self::Raycast(_))
    }

    /// Whether its body moves [by itself](Physics::release).
    pub fn is_free(&self) -> bool {
        self.chassis().is_some_and(Chassis::is_free)
    }

    /// Lets its body move by itself while nothing is near; that of a physical vehicle never does.
    pub fn release(&mut self, physics: &mut Physics) {
        if let Some(chassis) = self.chassis_mut() {
            chassis.release(physics);
        }
    }

    /// Gives its body back to the physics.
    pub fn hold(&mut self, physics: &mut Physics) {
        if let Some(chassis) = self.chassis_mut() {
            chassis.hold(physics);
        }
    }

    /// Its body while that is [free](Self::is_free).
    pub fn free_body_mut(&mut self) -> Option<&mut FreeBody> {
        self.chassis_mut()?.free_mut()
    }

    fn chassis(&self) -> Option<&Chassis> {
        match self {
            Self::Raycast(car) => Some(car.chassis()),
            Self::Bicycle(bicycle) => Some(bicycle.chassis()),
            Self::Measured(_) => None,
        }
    }

    fn chassis_mut(&mut self) -> Option<&mut Chassis> {
        match self {
            Self::Raycast(car) => Some(car.chassis_mut()),
            Self::Bicycle(bicycle) => Some(bicycle.chassis_mut()),
            Self::Measured(_) => None,
        }
    }

    fn model(&mut self) -> &mut dyn VehicleModel {
        match self {
            Self::Raycast(car) => car,
            Self::Bicycle(bicycle) => bicycle,
            Self::Measured(measured) => measured.as_mut(),
        }
    }
}

impl Digest for Dynamics {
    fn digest(&self, hash: &mut StateHash) {
        match self {
            Self::Raycast(car) => car.digest(hash),
            Self::Bicycle(bicycle) => bicycle.digest(hash),
            Self::Measured(measured) => measured.digest(hash),
        }
    }
}

impl VehicleModel for Dynamics {
    fn actuate(
        &mut self,
        physics: &Physics,
        spec: &VehicleSpec,
        actuation: &Actuation,
        dt_s: f64,
    ) -> Option<Impetus> {
        self.model().actuate(physics, spec, actuation, dt_s)
    }

    fn read_back(&mut self, physics: &Physics, spec: &VehicleSpec, dt_s: f64) -> Motion {
        self.model().read_back(physics, spec, dt_s)
    }

    fn remove(&mut self, physics: &mut Physics) {
        self.model().remove(physics);
    }
}
