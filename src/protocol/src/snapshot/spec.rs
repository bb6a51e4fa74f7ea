//! Vehicle specification: build and control gains.

use super::Dimensions;
use serde::{Deserialize, Serialize};

/// Standard gravity, rounded; vehicles weigh and grip by it.
pub const GRAVITY_MPS2: f64 = 9.81;

/// A vehicle's build and gains, full-scale SI units.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct VehicleSpec {
    /// Outline, wheelbase, track and wheels.
    pub dimensions: Dimensions,
    /// Mass of the whole vehicle.
    pub mass_kg: f64,
    /// Yaw inertia as a multiple of that of a homogeneous block of the outline's length and width.
    pub yaw_inertia_factor: f64,
    /// Place of the centre of mass between the axles and above the road.
    pub centre_of_mass: CentreOfMass,
    /// Torque, gear and power of the motor.
    pub motor: Motor,
    /// Of all four wheels together, pedal fully down.
    pub brake_torque_nm: f64,
    /// Of all four wheels together: an electric parking brake, which in motion brakes every wheel.
    pub handbrake_torque_nm: f64,
    /// Largest angle of the front axle's middle to either side.
    pub steering_limit_rad: f64,
    /// Largest rate of change of the same angle.
    pub steering_rate_radps: f64,
    /// Spring and damper, the same at all wheels.
    pub suspension: Suspension,
    /// Friction coefficient between tyre and road.
    pub tyre_friction: f64,
    /// Cornering stiffness of a tyre over its load, 1/rad.
    pub tyre_cornering: f64,
    /// Drag coefficient times frontal area.
    pub drag_area_m2: f64,
    /// Rolling resistance over weight.
    pub rolling_resistance: f64,
    /// The axles that the motor drives.
    pub drive: Drive,
    /// Dynamics model that computes the motion.
    pub model: ModelKind,
    /// Gains of the tracking control.
    pub control: ControlGains,
}

/// The centre of mass.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CentreOfMass {
    /// Above the road at rest.
    pub height_m: f64,
    /// In front of the outline's middle.
    pub ahead_m: f64,
}

/// The motor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Motor {
    /// Torque curve at full throttle, in order of speed; linear in between, zero beyond the last point.
    pub torque_curve: Vec<TorquePoint>,
    /// Motor turns per wheel turn.
    pub gear_ratio: f64,
    /// Limit of motor force times speed.
    pub max_power_w: f64,
}

/// One point of a torque curve.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TorquePoint {
    /// Motor speed, turns a minute.
    pub rpm: f64,
    /// Torque of the motor, before the gear.
    pub torque_nm: f64,
}

/// Spring and damper of each wheel.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Suspension {
    /// Of the unloaded spring.
    pub rest_length_m: f64,
    /// Natural frequency of the body's heave.
    pub frequency_hz: f64,
    /// Damping over critical damping.
    pub damping_ratio: f64,
}

/// The driven axles.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Drive {
    /// Front-wheel drive.
    #[default]
    Front,
    /// Rear-wheel drive.
    Rear,
    /// All-wheel drive.
    All,
}

/// The dynamics model of a vehicle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ModelKind {
    /// Ray-cast vehicle: rigid body on four sprung wheels, with tyre slip.
    #[default]
    Raycast,
    /// Kinematic bicycle without tyre slip.
    Bicycle,
    /// Physical vehicle of the laboratory: follows its measured pose.
    Measured,
}

/// Gains of the tracking control.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ControlGains {
    /// Stanley gain of the lateral error, 1/s.
    pub k_e: f64,
    /// Softening speed of the Stanley law, m/s.
    pub k_s: f64,
    /// Slip correction in a steady turn, s2/m, negative: about -1 / (g tyre_cornering). Models without tyre
    /// slip ignore it.
    pub k_a: f64,
    /// Yaw rate damping, s.
    pub k_y: f64,
    /// Proportional gain: longitudinal position error to acceleration, 1/s2.
    pub speed_p: f64,
    /// Integral gain, 1/s3.
    pub speed_i: f64,
    /// Derivative gain: speed error to acceleration, 1/s.
    pub speed_d: f64,
}

impl Default for ControlGains {
    fn default() -> Self {
        Self { k_e: 3.0, k_s: 2.5, k_a: -0.0068, k_y: 0.05, speed_p: 1.0, speed_i: 0.1, speed_d: 2.0 }
    }
}

impl Default for VehicleSpec {
    /// A car of 1600 kg, 5.0 x 2.5 m.
    fn default() -> Self {
        Self {
            dimensions: Dimensions {
                length_m: 5.0,
                width_m: 2.5,
                height_m: 1.5,
                wheelbase_m: 3.0,
                track_m: 2.1,
                wheel_radius_m: 0.34,
            },
            mass_kg: 1600.0,
            yaw_inertia_factor: 1.0,
            centre_of_mass: CentreOfMass { height_m: 0.5, ahead_m: 0.0 },
            motor: Motor {
                torque_curve: vec![
                    TorquePoint { rpm: 0.0, torque_nm: 280.0 },
                    TorquePoint { rpm: 12000.0, torque_nm: 280.0 },
                ],
                gear_ratio: 9.0,
                max_power_w: 110e3,
            },
            brake_torque_nm: 6500.0,
            handbrake_torque_nm: 4500.0,
            steering_limit_rad: 45f64.to_radians(),
            steering_rate_radps: 1.0,
            suspension: Suspension { rest_length_m: 0.35, frequency_hz: 1.5, damping_ratio: 0.4 },
            tyre_friction: 0.9,
            tyre_cornering: 15.0,
            drag_area_m2: 0.65,
            rolling_resistance: 0.012,
            drive: Drive::Front,
            model: ModelKind::Raycast,
            control: ControlGains::default(),
        }
    }
}
