//! One gamepad or steering wheel: mapping of its axes and buttons to functions, calibration, dead zones, and present
//! positions.

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fmt;

/// An axis or a button of a device, by the code of its driver.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DeviceControl {
    /// Value from -1 to 1, not necessarily 0 at rest.
    Axis(u32),
    /// Value 0 at rest and 1 when pressed; a trigger is in between.
    Button(u32),
}

impl fmt::Display for DeviceControl {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // The upper half is the kind, which the word says already.
        match self {
            Self::Axis(code) => write!(f, "axis {}", code & 0xffff),
            Self::Button(code) => write!(f, "button {}", code & 0xffff),
        }
    }
}

/// Latest values of the controls that have moved so far. The others are unknown: a pedal may rest anywhere.
pub type Values = BTreeMap<DeviceControl, f64>;

/// A driving function that a control can be mapped to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ControlFunction {
    /// Steering wheel or stick.
    Steering,
    /// Accelerator pedal or trigger.
    Gas,
    /// Brake pedal or trigger.
    Brake,
    /// Handbrake lever, or a button for it.
    Handbrake,
    /// Requests the other gear, forward or reverse.
    Reverse,
    /// Switches the left indicator on or off.
    IndicateLeft,
    /// Switches the right indicator on or off.
    IndicateRight,
    /// Switches the hazard lights on or off.
    Hazard,
    /// Turns the camera backwards while it is held.
    LookBack,
    /// Takes over the selected vehicle, or gives it back.
    TakeWheel,
}

impl ControlFunction {
    /// All functions, in the order of the page of devices.
    pub const ALL: [Self; 10] = [
        Self::Steering,
        Self::Gas,
        Self::Brake,
        Self::Handbrake,
        Self::Reverse,
        Self::IndicateLeft,
        Self::IndicateRight,
        Self::Hazard,
        Self::LookBack,
        Self::TakeWheel,
    ];

    /// Name on the page of devices.
    pub fn label(self) -> &'static str {
        match self {
            Self::Steering => "Steering",
            Self::Gas => "Gas",
            Self::Brake => "Brake",
            Self::Handbrake => "Handbrake",
            Self::Reverse => "Reverse gear",
            Self::IndicateLeft => "Indicator left",
            Self::IndicateRight => "Indicator right",
            Self::Hazard => "Hazard lights",
            Self::LookBack => "Look back",
            Self::TakeWheel => "Take control, release",
        }
    }
}

impl ControlFunction {
    /// Whether it is analogue.
    pub fn is_lever(self) -> bool {
        matches!(self, Self::Steering | Self::Gas | Self::Brake | Self::Handbrake)
    }
}

/// Calibration of a pedal, a trigger or a button.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LeverCalibration {
    /// The axis or button that is read.
    pub control: DeviceControl,
    /// Value when nobody touches it.
    pub rest: f64,
    /// Value when it is pressed as far as it goes.
    pub full: f64,
    /// Dead zone: fraction of the travel without effect.
    pub dead_zone: f64,
}

impl LeverCalibration {
    /// A button or trigger with its usual range: 0 at rest, 1 fully pressed, no dead zone.
    pub fn button(control: DeviceControl) -> Self {
        Self { control, rest: 0.0, full: 1.0, dead_zone: 0.0 }
    }

    /// Normalized position: 0 at rest or unknown, 1 fully pressed.
    pub fn position(&self, values: &Values) -> f64 {
        let Some(value) = values.get(&self.control) else { return 0.0 };
        beyond_dead_zone(fraction(*value, self.rest, self.full), self.dead_zone)
    }
}

/// Calibration of the steering axis.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SteeringCalibration {
    /// The axis that is read.
    pub control: DeviceControl,
    /// Value when it is turned fully to the left.
    pub left: f64,
    /// Value when nobody touches it.
    pub centre: f64,
    /// Value when it is turned fully to the right.
    pub right: f64,
    /// Dead zone: fraction of the travel to either side without effect.
    pub dead_zone: f64,
}

impl SteeringCalibration {
    /// Normalized position from 1 (full left) to -1 (full right); 0 while unknown.
    pub fn position(&self, values: &Values) -> f64 {
        let Some(&value) = values.get(&self.control) else { return 0.0 };
        let side = |end| beyond_dead_zone(fraction(value, self.centre, end), self.dead_zone);
        side(self.left) - side(self.right)
    }
}

/// Inverse linear interpolation, clamped to 0 and 1.
fn fraction(value: f64, from: f64, to: f64) -> f64 {
    let span = to - from;
    if span.abs() > 1e-6 { ((value - from) / span).clamp(0.0, 1.0) } else { 0.0 }
}

fn beyond_dead_zone(fraction: f64, dead_zone: f64) -> f64 {
    let dead_zone = dead_zone.clamp(0.0, MAX_DEAD_ZONE);
    ((fraction - dead_zone) / (1.0 - dead_zone)).max(0.0)
}

const MAX_DEAD_ZONE: f64 = 0.9;

/// The mapping of a device: which control has which function.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct DeviceProfile {
    /// Speed-sensitive steering: reduces the angle at speed, as a short stick needs; a wheel does not.
    #[serde(rename = "eases")]
    pub speed_sensitive: bool,
    /// `None` while no axis steers.
    pub steering: Option<SteeringCalibration>,
    /// All functions but the steering.
    pub levers: BTreeMap<ControlFunction, LeverCalibration>,
}

/// Sticks do not centre exactly; wheels nearly do.
const STICK_DEAD_ZONE: f64 = 0.12;

impl DeviceProfile {
    /// The default of a gamepad, or of a wheel whose pedals are not assigned yet.
    pub fn usual(
        steering: Option<DeviceControl>,
        is_wheel: bool,
        buttons: &[(ControlFunction, DeviceControl)],
    ) -> Self {
        let dead_zone = if is_wheel { 0.0 } else { STICK_DEAD_ZONE };
        let steering = steering.map(|control| SteeringCalibration {
            control,
            left: -1.0,
            centre: 0.0,
            right: 1.0,
            dead_zone,
        });
        let levers = buttons
            .iter()
            .map(|&(function, control)| (function, LeverCalibration::button(control)))
            .collect();
        Self { speed_sensitive: !is_wheel, steering, levers }
    }

    /// The control of a function.
    pub fn control(&self, function: ControlFunction) -> Option<DeviceControl> {
        match function {
            ControlFunction::Steering => self.steering.map(|steering| steering.control),
            _ => self.levers.get(&function).map(|lever| lever.control),
        }
    }

    /// The dead zone of a function.
    pub fn dead_zone(&self, function: ControlFunction) -> Option<f64> {
        match function {
            ControlFunction::Steering => self.steering.map(|steering| steering.dead_zone),
            _ => self.levers.get(&function).map(|lever| lever.dead_zone),
        }
    }

    /// Sets the dead zone of a function, a fraction of its travel, if a control is assigned.
    pub fn set_dead_zone(&mut self, function: ControlFunction, fraction: f64) {
        if let (ControlFunction::Steering, Some(steering)) = (function, &mut self.steering) {
            steering.dead_zone = fraction;
        } else if let Some(lever) = self.levers.get_mut(&function) {
            lever.dead_zone = fraction;
        }
    }

    /// Removes the control of a function, with its calibration.
    pub fn clear(&mut self, function: ControlFunction) {
        match function {
            ControlFunction::Steering => self.steering = None,
            _ => _ = self.levers.remove(&function),
        }
    }

    /// Inverts a control: left becomes right, pressed becomes released.
    pub fn invert(&mut self, function: ControlFunction) {
        if let (ControlFunction::Steering, Some(steering)) = (function, &mut self.steering) {
            std::mem::swap(&mut steering.left, &mut steering.right);
        } else if let Some(lever) = self.levers.get_mut(&function) {
            std::mem::swap(&mut lever.rest, &mut lever.full);
        }
    }

    /// From -1 to 1 for the steering, from 0 to 1 for the rest.
    pub fn position(&self, function: ControlFunction, values: &Values) -> f64 {
        match function {
            ControlFunction::Steering => self.steering.map_or(0.0, |steering| steering.position(values)),
            _ => self.levers.get(&function).map_or(0.0, |lever| lever.position(values)),
        }
    }
}

/// Normalized positions of the analogue controls.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LeverPositions {
    /// 1 is full left, -1 full right.
    pub steering: f64,
    /// 0 is released, 1 fully pressed.
    pub gas: f64,
    /// 0 is released, 1 fully pressed.
    pub brake: f64,
    /// 0 is released, 1 fully applied.
    pub handbrake: f64,
    /// Speed-sensitive steering.
    pub speed_sensitive: bool,
}

impl LeverPositions {
    /// The largest difference of one control between two positions.
    fn max_difference(&self, other: &Self) -> f64 {
        let ways = [
            self.steering - other.steering,
            self.gas - other.gas,
            self.brake - other.brake,
            self.handbrake - other.handbrake,
        ];
        ways.into_iter().fold(0.0, |most, way| way.abs().max(most))
    }
}

/// A connected device.
#[derive(Clone, Debug, PartialEq)]
pub struct Device {
    /// Identifies the device across sessions.
    pub key: String,
    /// Name that the operating system gives it.
    pub name: String,
    /// Its present mapping.
    pub profile: DeviceProfile,
    values: Values,
    /// Positions when use was last detected.
    noticed: LeverPositions,
}

/// A control that moves this far is in use; less may be noise.
const USE_THRESHOLD: f64 = 0.1;
/// A button beyond this position is pressed.
const PRESS_THRESHOLD: f64 = 0.5;

impl Device {
    /// A device whose controls have not moved yet: everything is released.
    pub fn new(key: String, name: String, profile: DeviceProfile) -> Self {
        Self { key, name, profile, values: Values::new(), noticed: LeverPositions::default() }
    }

    /// Latest uncalibrated values of its controls.
    pub fn values(&self) -> &Values {
        &self.values
    }

    /// Takes a new value of a control; returns the functions that it has pressed.
    pub fn take(&mut self, control: DeviceControl, value: f64) -> Vec<ControlFunction> {
        let before: Vec<bool> = ControlFunction::ALL.map(|function| self.is_pressed(function)).into();
        self.values.insert(control, value);
        let news = ControlFunction::ALL.into_iter().zip(before);
        news.filter(|(function, was)| !was && self.is_pressed(*function))
            .map(|(function, _)| function)
            .collect()
    }

    /// Whether the button of a function is down. Pedals and steering are no buttons.
    pub fn is_pressed(&self, function: ControlFunction) -> bool {
        !function.is_lever() && self.position(function) > PRESS_THRESHOLD
    }

    /// From -1 to 1 for the steering, from 0 to 1 for the rest.
    pub fn position(&self, function: ControlFunction) -> f64 {
        self.profile.position(function, &self.values)
    }

    /// Present positions of steering and pedals.
    pub fn levers(&self) -> LeverPositions {
        LeverPositions {
            steering: self.position(ControlFunction::Steering),
            gas: self.position(ControlFunction::Gas),
            brake: self.position(ControlFunction::Brake),
            handbrake: self.position(ControlFunction::Handbrake),
            speed_sensitive: self.profile.speed_sensitive,
        }
    }

    /// Whether a control has been moved since use was last detected.
    pub fn is_used(&mut self) -> bool {
        let levers = self.levers();
        let is_used = levers.max_difference(&self.noticed) > USE_THRESHOLD;
        if is_used {
            self.noticed = levers;
        }
        is_used
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn device(profile: DeviceProfile) -> Device {
        Device::new("key".to_owned(), "name".to_owned(), profile)
    }

    fn lever(control: DeviceControl, rest: f64, full: f64) -> LeverCalibration {
        LeverCalibration { control, rest, full, dead_zone: 0.05 }
    }

    #[test]
    fn pedals_that_share_an_axis_are_told_apart() {
        let axis = DeviceControl::Axis(2);
        let levers =
            [(ControlFunction::Gas, lever(axis, 0.0, 1.0)), (ControlFunction::Brake, lever(axis, 0.0, -1.0))];
        let mut wheel = device(DeviceProfile { levers: levers.into(), ..DeviceProfile::default() });
        for (value, gas, brake) in [(0.0, 0.0, 0.0), (1.0, 1.0, 0.0), (-1.0, 0.0, 1.0), (0.03, 0.0, 0.0)] {
            wheel.take(axis, value);
            assert_eq!((wheel.levers().gas, wheel.levers().brake), (gas, brake), "at {value}");
        }
        wheel.take(axis, -0.525);
        assert!((wheel.levers().brake - 0.5).abs() < 1e-9);
    }

    #[test]
    fn an_inverted_pedal_is_released_before_anything_is_known_of_it() {
        let axis = DeviceControl::Axis(5);
        let levers = [(ControlFunction::Gas, lever(axis, 1.0, -1.0))];
        let mut wheel = device(DeviceProfile { levers: levers.into(), ..DeviceProfile::default() });
        assert_eq!(wheel.levers().gas, 0.0, "0 would be half way down");
        wheel.take(axis, 1.0);
        assert_eq!(wheel.levers().gas, 0.0);
        wheel.take(axis, -1.0);
        assert_eq!(wheel.levers().gas, 1.0);
        wheel.profile.invert(ControlFunction::Gas);
        assert_eq!(wheel.levers().gas, 0.0);
    }

    #[test]
    fn a_stick_has_a_dead_zone_and_steers_to_its_own_ends() {
        let steering = SteeringCalibration {
            control: DeviceControl::Axis(0),
            left: -0.9,
            centre: 0.1,
            right: 1.0,
            dead_zone: 0.1,
        };
        let mut pad = device(DeviceProfile { steering: Some(steering), ..DeviceProfile::default() });
        for (value, position) in [(0.1, 0.0), (0.15, 0.0), (0.02, 0.0), (-0.9, 1.0), (-1.0, 1.0), (1.0, -1.0)]
        {
            pad.take(DeviceControl::Axis(0), value);
            assert!((pad.levers().steering - position).abs() < 1e-9, "{value}: {}", pad.levers().steering);
        }
        pad.profile.invert(ControlFunction::Steering);
        assert!(pad.levers().steering > 0.99);
    }

    #[test]
    fn triggers_are_pedals_and_a_press_is_told_once() {
        let trigger = DeviceControl::Button(7);
        let buttons = [(ControlFunction::Gas, trigger), (ControlFunction::Reverse, DeviceControl::Button(3))];
        let mut pad = device(DeviceProfile::usual(Some(DeviceControl::Axis(0)), false, &buttons));
        pad.take(trigger, 0.4);
        assert_eq!(pad.levers().gas, 0.4);
        assert!(pad.is_used() && !pad.is_used());
        assert_eq!(pad.take(DeviceControl::Button(3), 1.0), [ControlFunction::Reverse]);
        assert_eq!(pad.take(DeviceControl::Button(3), 1.0), []);
        pad.take(DeviceControl::Button(3), 0.0);
        assert_eq!(pad.take(DeviceControl::Button(3), 1.0), [ControlFunction::Reverse]);
        assert!(!pad.is_used(), "buttons are no levers");
    }

    #[test]
    fn values_without_range_or_sense_press_nothing() {
        let axis = DeviceControl::Axis(0);
        let levers = [
            (ControlFunction::Gas, lever(axis, 0.5, 0.5)),
            (ControlFunction::Brake, LeverCalibration { dead_zone: 7.0, ..lever(axis, 0.0, 1.0) }),
        ];
        let mut wheel = device(DeviceProfile { levers: levers.into(), ..DeviceProfile::default() });
        wheel.take(axis, 0.5);
        assert_eq!((wheel.levers().gas, wheel.levers().brake), (0.0, 0.0));
    }
}
