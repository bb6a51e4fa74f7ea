//! Vehicle data: static (build, appearance) and per tick (state).

use super::{Appearance, ModelKind, VehicleSpec};
use city3d_geometry::{OrientedRect, Pose2, trig};
use glam::{DQuat, DVec2, DVec3};
use serde::{Deserialize, Serialize};
use std::fmt;

/// Id of a vehicle. All per-vehicle work is done in id order.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct VehicleId(pub u32);

impl fmt::Display for VehicleId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.0)
    }
}

/// Status of a vehicle, as the vehicle list shows it. The numbers are those of link, log and digest.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[repr(u8)]
pub enum Status {
    /// Spawned and standing: no trajectory yet.
    #[default]
    Waiting = 0,
    /// On its way.
    Driving = 1,
    /// Held back by a yield sign or the right of way of another.
    Yielding = 2,
    /// Stopped, also on no lane, where a person has left it.
    Stopped = 3,
    /// Driven by a person.
    Manual = 4,
    /// No trajectory for longer than the link timeout: brakes to a stop on its path.
    LinkLost = 5,
    /// Collided: brakes and stays. A person may drive it on, and is clear after some metres.
    Collided = 6,
    /// At the end of its route.
    Finished = 7,
    /// Physical vehicle of which only poses are known: it reports its own pose, or the poses were recorded.
    /// In a running city it has the status of its motion, and its model is `measured`.
    Physical = 8,
    /// Physical vehicle that is not measured: occluded or removed.
    Unseen = 9,
}

impl Status {
    /// All statuses, each at the index of its number.
    pub const ALL: [Self; 10] = [
        Self::Waiting,
        Self::Driving,
        Self::Yielding,
        Self::Stopped,
        Self::Manual,
        Self::LinkLost,
        Self::Collided,
        Self::Finished,
        Self::Physical,
        Self::Unseen,
    ];

    /// Label for tables.
    pub fn label(self) -> &'static str {
        match self {
            Self::Waiting => "waiting",
            Self::Driving => "driving",
            Self::Yielding => "yielding",
            Self::Stopped => "stopped",
            Self::Manual => "manual",
            Self::LinkLost => "link lost",
            Self::Collided => "collided",
            Self::Finished => "finished",
            Self::Physical => "physical",
            Self::Unseen => "unseen",
        }
    }
}

/// Turn signal, as the lamps show it. The numbers are those of the link.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[repr(u8)]
pub enum Indicator {
    /// No turn signal.
    #[default]
    Off = 0,
    /// The lamps of the left side flash.
    Left = 1,
    /// The lamps of the right side flash.
    Right = 2,
    /// The lamps of both sides flash.
    Hazard = 3,
}

/// Dimensions of a vehicle for drawing and driving, city metres.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Dimensions {
    /// Length of the outline, from bumper to bumper.
    pub length_m: f64,
    /// Width of the outline, with the mirrors.
    pub width_m: f64,
    /// Height of a sedan above the road; other bodies are drawn higher.
    pub height_m: f64,
    /// Distance between the axles.
    pub wheelbase_m: f64,
    /// Track width between wheel centres.
    pub track_m: f64,
    /// Radius of a wheel with its tyre.
    pub wheel_radius_m: f64,
}

impl Dimensions {
    /// Distance from the middle of the outline to the front axle. The overhangs are equal.
    pub fn front_axle_m(&self) -> f64 {
        self.wheelbase_m / 2.0
    }
}

/// Static data of a vehicle.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct VehicleInfo {
    /// Unique in the city.
    pub id: VehicleId,
    /// Its name in the laboratory: the VICON subject.
    pub name: String,
    /// Outline, wheelbase, track and wheels.
    pub dimensions: Dimensions,
    /// Body type and colour.
    pub appearance: Appearance,
    /// Name of the dynamics model; empty if only poses are known.
    pub model: String,
}

/// Model name of physical vehicles.
const MEASURED: &str = "measured";

impl VehicleInfo {
    /// Whether control data is known besides poses: pedals, steering, path.
    pub fn has_control_data(&self) -> bool {
        !self.model.is_empty()
    }

    /// Whether it is a physical vehicle.
    pub fn is_physical(&self) -> bool {
        self.model == MEASURED
    }

    /// The static data from a specification.
    pub fn of(id: VehicleId, name: &str, appearance: Appearance, spec: &VehicleSpec) -> Self {
        let model = match spec.model {
            ModelKind::Raycast => "raycast",
            ModelKind::Bicycle => "bicycle",
            ModelKind::Measured => MEASURED,
        };
        Self { id, name: name.to_owned(), dimensions: spec.dimensions, appearance, model: model.to_owned() }
    }
}

/// State of one wheel. Arrays of four: front left, front right, rear left, rear right.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct WheelState {
    /// Rolling angle about the axle, increasing forwards.
    pub spin_rad: f64,
    /// Steering angle of this wheel, left-positive.
    pub steer_rad: f64,
    /// Suspension travel towards the body. At rest the wheel centre is a wheel radius above the road.
    pub lift_m: f64,
}

/// A vehicle at one tick.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct VehicleState {
    /// Unique in the city.
    pub id: VehicleId,
    /// What it does, or what holds it back.
    pub status: Status,
    /// Middle of the outline, on the ground when the body is level.
    pub position: DVec3,
    /// City from body.
    pub orientation: DQuat,
    /// City frame.
    pub velocity_mps: DVec3,
    /// Along the heading, negative in reverse.
    pub speed_mps: f64,
    /// Along the heading.
    pub acceleration_mps2: f64,
    /// Counter-clockwise seen from above.
    pub yaw_rate_radps: f64,
    /// Steering angle of the front axle's middle, left-positive.
    pub steering_rad: f64,
    /// Pedals in [0, 1].
    pub gas: f64,
    /// Brake pedal in [0, 1].
    pub brake: f64,
    /// Handbrake lever in [0, 1].
    pub handbrake: f64,
    /// Whether the reverse gear is engaged.
    pub reverse: bool,
    /// Whether the brake lights are on: brake or handbrake is applied.
    pub brake_lights: bool,
    /// Turn signal; hazard while a physical vehicle is not measured.
    pub indicator: Indicator,
    /// Front left, front right, rear left, rear right.
    pub wheels: [WheelState; 4],
    /// Lateral error: front-axle centre from the desired path, left-positive; 0 without a path.
    pub lateral_error_m: f64,
    /// Odometer: distance driven since the start.
    pub distance_m: f64,
}

impl VehicleState {
    /// [`Self::lateral_error_m`] if the vehicle follows a path: `None` while a person drives, and once it has collided.
    pub fn tracked_lateral_error_m(&self) -> Option<f64> {
        (!matches!(self.status, Status::Manual | Status::Collided)).then_some(self.lateral_error_m)
    }

    /// Position and heading seen from above.
    pub fn pose(&self) -> Pose2 {
        let forward = self.orientation * DVec3::X;
        Pose2::at(self.position.truncate(), trig::atan2(forward.y, forward.x))
    }

    /// Interpolates towards an earlier state for drawing.
    pub(super) fn blend_from(&mut self, earlier: &Self, weight: f64) {
        let between = |from, to| super::lerp(from, to, weight);
        self.position = earlier.position.lerp(self.position, weight);
        self.orientation = earlier.orientation.lerp(self.orientation, weight);
        self.speed_mps = between(earlier.speed_mps, self.speed_mps);
        self.steering_rad = between(earlier.steering_rad, self.steering_rad);
        for (wheel, before) in self.wheels.iter_mut().zip(&earlier.wheels) {
            wheel.spin_rad = between(before.spin_rad, wheel.spin_rad);
            wheel.steer_rad = between(before.steer_rad, wheel.steer_rad);
            wheel.lift_m = between(before.lift_m, wheel.lift_m);
        }
    }

    /// Unit vector of the heading, seen from above.
    pub fn forward(&self) -> DVec2 {
        (self.orientation * DVec3::X).truncate().normalize_or(DVec2::X)
    }

    /// The body's outline seen from above.
    pub fn outline(&self, dimensions: &Dimensions) -> OrientedRect {
        let half = DVec2::new(dimensions.length_m, dimensions.width_m) / 2.0;
        OrientedRect { centre: self.position.truncate(), axis: self.forward(), half }
    }
}
