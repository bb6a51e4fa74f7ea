//! Commands: the only way to change the world. Network packets, key presses and replayed logs all become
//! commands.

use super::{Dimensions, Indicator, SignalAspects, VehicleId, VehicleSpec};
use city3d_geometry::{City, Frame, Lab, LengthScale, Pose2};
use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};
use std::f64::consts::FRAC_PI_2;

/// A waypoint: desired state of a vehicle at one time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(bound = "")]
pub struct TrajectoryPoint<F: Frame = City> {
    /// Simulated time of the waypoint.
    pub time_s: f64,
    /// Desired pose of the front-axle centre, the reference point of the tracking control.
    pub pose: Pose2<F>,
    /// In metres of the frame.
    pub speed_mps: f64,
}

/// The desired motion of one vehicle over a horizon that covers its stopping distance.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(bound = "")]
pub struct Trajectory<F: Frame = City> {
    /// The vehicle that is to follow it.
    pub vehicle: VehicleId,
    /// Sequence number per vehicle, incremented by the sender; older messages are dropped.
    pub sequence: u32,
    /// In time order.
    pub points: Vec<TrajectoryPoint<F>>,
    /// The vehicle yields at a sign or to the right of way of another.
    pub yielding: bool,
    /// The vehicle is at the end of its route.
    pub finished: bool,
    /// Turn signal that the vehicle shows.
    pub indicator: Indicator,
}

/// A sequence number this far behind means a restarted sender, not an old message.
const SENDER_RESTARTED: u32 = 1 << 16;

/// Whether a sequence number is newer than `last` of the same sender, across the wrap-around (RFC 1982).
pub fn is_newer(sequence: u32, last: u32) -> bool {
    let ahead = sequence.wrapping_sub(last);
    ahead != 0 && (ahead < u32::MAX / 2 || ahead.wrapping_neg() > SENDER_RESTARTED)
}

impl<F: Frame> Trajectory<F> {
    /// Whether it is newer than the sequence number `last` of the same sender.
    pub fn follows(&self, last: u32) -> bool {
        is_newer(self.sequence, last)
    }

    /// Whether it ends before a time.
    pub fn is_over(&self, time_s: f64) -> bool {
        self.points.last().is_none_or(|point| point.time_s < time_s)
    }
}

impl Trajectory<City> {
    /// Its list of points, emptied, for a trajectory to come: what one thread allocates and another frees costs both.
    pub fn into_spare(self) -> Vec<TrajectoryPoint<Lab>> {
        let mut points = self.points;
        points.clear();
        // The frames have the same layout, so that `collect` takes the space over.
        points.into_iter().map(|_| TrajectoryPoint::default()).collect()
    }
}

impl Trajectory<Lab> {
    /// The same motion in the city.
    pub fn into_city(self, scale: LengthScale) -> Trajectory<City> {
        let points = self.points.into_iter().map(|point| TrajectoryPoint {
            time_s: point.time_s,
            pose: point.pose.to_city(scale),
            speed_mps: scale.city_from_lab(point.speed_mps),
        });
        Trajectory {
            vehicle: self.vehicle,
            sequence: self.sequence,
            points: points.collect(),
            yielding: self.yielding,
            finished: self.finished,
            indicator: self.indicator,
        }
    }
}

/// Body types that the renderer has models for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum BodyType {
    /// Car with a boot; the only body that is as high as its dimensions state.
    #[default]
    Sedan,
    /// Car with a rear door in place of a boot.
    Hatchback,
    /// High car with plastic cladding and roof rails.
    Suv,
    /// Delivery van with a closed cargo space.
    Van,
    /// Pickup truck with an open bed.
    Pickup,
    /// A user's model, by index in the scenario.
    Own(u16),
    /// City bus; as high as its dimensions state.
    Bus,
    /// Delivery truck, a cab and a box; as high as its dimensions state.
    Truck,
    /// Sedan with a sign on its roof.
    Taxi,
    /// Car with a long roof and a rear door.
    Estate,
}

impl BodyType {
    /// The shipped bodies by name, which is also that of the model's file. The place in this list is the number on the
    /// wire.
    pub const SHIPPED: [(&str, Self); 9] = [
        ("sedan", Self::Sedan),
        ("hatchback", Self::Hatchback),
        ("suv", Self::Suv),
        ("van", Self::Van),
        ("pickup", Self::Pickup),
        ("bus", Self::Bus),
        ("truck", Self::Truck),
        ("taxi", Self::Taxi),
        ("estate", Self::Estate),
    ];

    /// Height of the drawn body above the road, metres. The height of the dimensions is a sedan's, and other cars have a
    /// factor. A bus or a truck is as high as stated, but at least higher than wide. It affects drawing only.
    pub fn height_m(self, dimensions: &Dimensions) -> f64 {
        let stated_m = dimensions.height_m;
        match self {
            Self::Sedan | Self::Own(_) => stated_m,
            Self::Hatchback | Self::Estate => 1.02 * stated_m,
            // With the sign on its roof.
            Self::Taxi => 1.10 * stated_m,
            Self::Suv => 1.18 * stated_m,
            Self::Pickup => 1.17 * stated_m,
            Self::Van => 1.40 * stated_m,
            Self::Bus | Self::Truck => stated_m.max(1.12 * dimensions.width_m),
        }
    }

    /// Where a camera behind the windscreen is: shares of the length ahead of the middle, and of the height.
    pub fn windscreen_shares(self) -> [f64; 2] {
        match self {
            Self::Bus => [0.455, 0.68],
            Self::Truck => [0.40, 0.71],
            // The sign above the roof does not lift the camera.
            Self::Taxi => [0.11, 0.80],
            _ => [0.11, 0.88],
        }
    }
}

/// Appearance of a vehicle.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Appearance {
    /// Model to draw, which also determines how high a camera sits behind the windscreen.
    pub body: BodyType,
    /// sRGB.
    pub colour: [u8; 3],
}

impl Default for Appearance {
    fn default() -> Self {
        Self { body: BodyType::Sedan, colour: [178, 34, 34] }
    }
}

/// Setup of a new vehicle, city frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Setup {
    /// Unique in the city.
    pub id: VehicleId,
    /// Its name in the laboratory: the VICON subject.
    pub name: String,
    /// Body type and colour; without effect on the motion.
    pub appearance: Appearance,
    /// Middle of the outline.
    pub pose: Pose2,
    /// Along the heading.
    pub speed_mps: f64,
    /// Specification of its build and control.
    pub spec: VehicleSpec,
}

/// Pedals and steering wheel of a human driver.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Pedals {
    /// Accelerator pedal in [0, 1]; values beyond are clamped.
    pub gas: f64,
    /// Brake pedal in [0, 1]; values beyond are clamped.
    pub brake: f64,
    /// Handbrake lever in [0, 1]; values beyond are clamped.
    pub handbrake: f64,
    /// Desired steering angle, left-positive.
    pub steering_rad: f64,
    /// Reverse gear: gas drives the vehicle backwards.
    pub reverse: bool,
    /// Turn signal that the driver has set.
    pub indicator: Indicator,
}

impl Pedals {
    /// Largest desired steering angle to either side: beyond the steering limit of any vehicle.
    pub const MAX_STEERING_RAD: f64 = FRAC_PI_2;

    /// The pedals with each value clamped to its range; NaN counts as 0.
    pub fn clamped(self) -> Self {
        let clamp = |value: f64, least, most| if value.is_nan() { 0.0 } else { value.clamp(least, most) };
        Self {
            gas: clamp(self.gas, 0.0, 1.0),
            brake: clamp(self.brake, 0.0, 1.0),
            handbrake: clamp(self.handbrake, 0.0, 1.0),
            steering_rad: clamp(self.steering_rad, -Self::MAX_STEERING_RAD, Self::MAX_STEERING_RAD),
            ..self
        }
    }
}

/// Measured pose of a physical vehicle, city frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MeasuredPose {
    /// Simulated time of the measurement.
    pub stamp_s: f64,
    /// Middle of the outline, on the ground.
    pub position: DVec3,
    /// City from body.
    pub orientation: DQuat,
}

/// A change of the world, applied at the tick at which it arrives.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum SimCommand {
    /// The clock runs, from the present tick on.
    Start,
    /// The clock stops; all vehicles stay as they are.
    Pause,
    /// Back to the initial conditions: the run that follows equals the first one exactly.
    Reset,
    /// Adds a vehicle. If the id exists, the vehicle stays and its sequence number is reset: its sender has
    /// restarted.
    Spawn(Box<Setup>),
    /// A vehicle follows this trajectory in place of the one before.
    Follow(Trajectory),
    /// Takes a vehicle out of the city.
    Remove(VehicleId),
    /// Measured pose of a physical vehicle; other vehicles ignore it.
    Measure(VehicleId, MeasuredPose),
    /// A person takes over or updates the pedals.
    Drive(VehicleId, Pedals),
    /// The person hands back to the algorithm.
    Release(VehicleId),
    /// Signal heads show these aspects.
    Signals(SignalAspects),
}

impl SimCommand {
    /// The vehicle it addresses; commands are applied in the order of (vehicle, sequence).
    pub fn vehicle(&self) -> Option<VehicleId> {
        match self {
            Self::Start | Self::Pause | Self::Reset | Self::Signals(_) => None,
            Self::Spawn(setup) => Some(setup.id),
            Self::Follow(trajectory) => Some(trajectory.vehicle),
            Self::Remove(id) | Self::Measure(id, _) | Self::Drive(id, _) | Self::Release(id) => Some(*id),
        }
    }

    /// Sort key of commands within a tick; the sort is stable.
    pub fn order(&self) -> (Option<VehicleId>, u32) {
        (self.vehicle(), if let Self::Follow(trajectory) = self { trajectory.sequence } else { 0 })
    }
}
