//! One gamepad or steering wheel: which of its axes and buttons does what, and what they do at present.

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fmt;

/// An axis or a button of a device, by the number that its driver gives it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Control {
    /// Its value lies between -1 and 1, and need not be 0 at rest.
    Axis(u32),
    /// Its value is 0 at rest and 1 when it is pressed; a trigger's lies between.
    Button(u32),
}

impl fmt::Display for Control {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // The upper half tells kinds apart, which the word does already.
        match self {
            Self::Axis(code) => write!(f, "axis {}", code & 0xffff),
            Self::Button(code) => write!(f, "button {}", code & 0xffff),
        }
    }
}

/// Latest values of the controls of a device that have moved so far. Of the others nothing is known: a pedal
/// may rest anywhere.
pub type Values = BTreeMap<Control, f64>;

/// What a person does with a device.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Function {
    Steering,
    Gas,
    Brake,
    Handbrake,
    Reverse,
    IndicateLeft,
    IndicateRight,
    Hazard,
    LookBack,
    /// Takes the wheel of the selected vehicle, or gives it back.
    TakeWheel,
}

impl Function {
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
            Self::TakeWheel => "Drive, give back",
        }
    }
}

impl Function {
    /// Whether it counts how far it is moved.
    pub fn is_lever(self) -> bool {
        matches!(self, Self::Steering | Self::Gas | Self::Brake | Self::Handbrake)
    }
}

/// A pedal, a trigger or a button: how far it is pressed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Lever {
    pub control: Control,
    /// Value when nobody touches it.
    pub rest: f64,
    /// Value when it is pressed as far as it goes.
    pub full: f64,
    /// Share of its way in which nothing happens yet.
    pub dead_zone: f64,
}

impl Lever {
    pub fn button(control: Control) -> Self {
        Self { control, rest: 0.0, full: 1.0, dead_zone: 0.0 }
    }

    /// 0 when nobody touches it or nothing is known of it, 1 when it is pressed as far as it goes.
    pub fn position(&self, values: &Values) -> f64 {
        let Some(value) = values.get(&self.control) else { return 0.0 };
        beyond(share(*value, self.rest, self.full), self.dead_zone)
    }
}

/// What the front wheels follow.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Steering {
    pub control: Control,
    pub left: f64,
    pub centre: f64,
    pub right: f64,
    /// Share of the way to either side in which nothing happens yet.
    pub dead_zone: f64,
}

impl Steering {
    /// From 1, as far left as it goes, to -1; 0 as long as nothing is known of it.
    pub fn position(&self, values: &Values) -> f64 {
        let Some(&value) = values.get(&self.control) else { return 0.0 };
        let side = |end| beyond(share(value, self.centre, end), self.dead_zone);
        side(self.left) - side(self.right)
    }
}

/// Where a value lies between two others.
fn share(value: f64, from: f64, to: f64) -> f64 {
    let span = to - from;
    if span.abs() > 1e-6 { ((value - from) / span).clamp(0.0, 1.0) } else { 0.0 }
}

fn beyond(share: f64, dead_zone: f64) -> f64 {
    let dead_zone = dead_zone.clamp(0.0, MOST_DEAD);
    ((share - dead_zone) / (1.0 - dead_zone)).max(0.0)
}

const MOST_DEAD: f64 = 0.9;

/// Which control of a device does what.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Profile {
    /// Steers less the faster the vehicle is, as a short stick has to; a wheel is turned less by its driver.
    pub eases: bool,
    pub steering: Option<Steering>,
    /// All but the steering.
    pub levers: BTreeMap<Function, Lever>,
}

/// Sticks do not come back to their middle exactly, wheels nearly.
const STICK_DEAD: f64 = 0.12;

impl Profile {
    /// That of a gamepad, or of a wheel whose pedals have still to be found.
    pub fn usual(steering: Option<Control>, is_wheel: bool, buttons: &[(Function, Control)]) -> Self {
        let dead_zone = if is_wheel { 0.0 } else { STICK_DEAD };
        let steering =
            steering.map(|control| Steering { control, left: -1.0, centre: 0.0, right: 1.0, dead_zone });
        let levers = buttons.iter().map(|&(function, control)| (function, Lever::button(control))).collect();
        Self { eases: !is_wheel, steering, levers }
    }

    /// The control that does something.
    pub fn control(&self, function: Function) -> Option<Control> {
        match function {
            Function::Steering => self.steering.map(|steering| steering.control),
            _ => self.levers.get(&function).map(|lever| lever.control),
        }
    }

    /// Share of a control's way in which nothing happens yet.
    pub fn dead_zone(&self, function: Function) -> Option<f64> {
        match function {
            Function::Steering => self.steering.map(|steering| steering.dead_zone),
            _ => self.levers.get(&function).map(|lever| lever.dead_zone),
        }
    }

    pub fn set_dead_zone(&mut self, function: Function, share: f64) {
        if let (Function::Steering, Some(steering)) = (function, &mut self.steering) {
            steering.dead_zone = share;
        } else if let Some(lever) = self.levers.get_mut(&function) {
            lever.dead_zone = share;
        }
    }

    pub fn clear(&mut self, function: Function) {
        match function {
            Function::Steering => self.steering = None,
            _ => _ = self.levers.remove(&function),
        }
    }

    /// Turns a control round: left is right, pressed is let go.
    pub fn invert(&mut self, function: Function) {
        if let (Function::Steering, Some(steering)) = (function, &mut self.steering) {
            std::mem::swap(&mut steering.left, &mut steering.right);
        } else if let Some(lever) = self.levers.get_mut(&function) {
            std::mem::swap(&mut lever.rest, &mut lever.full);
        }
    }

    /// From -1 to 1 for the steering, from 0 to 1 for the rest.
    pub fn position(&self, function: Function, values: &Values) -> f64 {
        match function {
            Function::Steering => self.steering.map_or(0.0, |steering| steering.position(values)),
            _ => self.levers.get(&function).map_or(0.0, |lever| lever.position(values)),
        }
    }
}

/// Where the levers of a device are.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Levers {
    /// 1 is as far left as it goes, -1 as far right.
    pub steering: f64,
    pub gas: f64,
    pub brake: f64,
    pub handbrake: f64,
    /// Steers less the faster the vehicle is.
    pub eases: bool,
}

impl Levers {
    /// The largest way between two positions of one lever.
    fn apart(&self, other: &Self) -> f64 {
        let ways = [
            self.steering - other.steering,
            self.gas - other.gas,
            self.brake - other.brake,
            self.handbrake - other.handbrake,
        ];
        ways.into_iter().fold(0.0, |most, way| way.abs().max(most))
    }
}

/// A device that is plugged in.
#[derive(Clone, Debug, PartialEq)]
pub struct Device {
    /// What it is known by from one run to the next.
    pub key: String,
    pub name: String,
    pub profile: Profile,
    values: Values,
    /// Where its levers were when it was last noticed that somebody moved them.
    noticed: Levers,
}

/// A lever that moves so far is being used; less may be noise.
const NOTICED: f64 = 0.1;
/// A lever beyond this is a button that is pressed.
const PRESSED: f64 = 0.5;

impl Device {
    pub fn new(key: String, name: String, profile: Profile) -> Self {
        Self { key, name, profile, values: Values::new(), noticed: Levers::default() }
    }

    pub fn values(&self) -> &Values {
        &self.values
    }

    /// Takes a new value of a control; gives what has been pressed by it.
    pub fn take(&mut self, control: Control, value: f64) -> Vec<Function> {
        let before: Vec<bool> = Function::ALL.map(|function| self.is_pressed(function)).into();
        self.values.insert(control, value);
        let news = Function::ALL.into_iter().zip(before);
        news.filter(|(function, was)| !was && self.is_pressed(*function))
            .map(|(function, _)| function)
            .collect()
    }

    /// Whether a button is down. Pedals and steering are no buttons.
    pub fn is_pressed(&self, function: Function) -> bool {
        !function.is_lever() && self.position(function) > PRESSED
    }

    /// From -1 to 1 for the steering, from 0 to 1 for the rest.
    pub fn position(&self, function: Function) -> f64 {
        self.profile.position(function, &self.values)
    }

    pub fn levers(&self) -> Levers {
        Levers {
            steering: self.position(Function::Steering),
            gas: self.position(Function::Gas),
            brake: self.position(Function::Brake),
            handbrake: self.position(Function::Handbrake),
            eases: self.profile.eases,
        }
    }

    /// Whether somebody has moved a lever since it was last noticed.
    pub fn is_used(&mut self) -> bool {
        let levers = self.levers();
        let is_used = levers.apart(&self.noticed) > NOTICED;
        if is_used {
            self.noticed = levers;
        }
        is_used
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn device(profile: Profile) -> Device {
        Device::new("key".to_owned(), "name".to_owned(), profile)
    }

    fn lever(control: Control, rest: f64, full: f64) -> Lever {
        Lever { control, rest, full, dead_zone: 0.05 }
    }

    #[test]
    fn pedals_that_share_an_axis_are_told_apart() {
        let axis = Control::Axis(2);
        let levers = [(Function::Gas, lever(axis, 0.0, 1.0)), (Function::Brake, lever(axis, 0.0, -1.0))];
        let mut wheel = device(Profile { levers: levers.into(), ..Profile::default() });
        for (value, gas, brake) in [(0.0, 0.0, 0.0), (1.0, 1.0, 0.0), (-1.0, 0.0, 1.0), (0.03, 0.0, 0.0)] {
            wheel.take(axis, value);
            assert_eq!((wheel.levers().gas, wheel.levers().brake), (gas, brake), "at {value}");
        }
        wheel.take(axis, -0.525);
        assert!((wheel.levers().brake - 0.5).abs() < 1e-9);
    }

    #[test]
    fn an_inverted_pedal_is_released_before_anything_is_known_of_it() {
        let axis = Control::Axis(5);
        let levers = [(Function::Gas, lever(axis, 1.0, -1.0))];
        let mut wheel = device(Profile { levers: levers.into(), ..Profile::default() });
        assert_eq!(wheel.levers().gas, 0.0, "0 would be half way down");
        wheel.take(axis, 1.0);
        assert_eq!(wheel.levers().gas, 0.0);
        wheel.take(axis, -1.0);
        assert_eq!(wheel.levers().gas, 1.0);
        wheel.profile.invert(Function::Gas);
        assert_eq!(wheel.levers().gas, 0.0);
    }

    #[test]
    fn a_stick_has_a_dead_zone_and_steers_to_its_own_ends() {
        let steering =
            Steering { control: Control::Axis(0), left: -0.9, centre: 0.1, right: 1.0, dead_zone: 0.1 };
        let mut pad = device(Profile { steering: Some(steering), ..Profile::default() });
        for (value, position) in [(0.1, 0.0), (0.15, 0.0), (0.02, 0.0), (-0.9, 1.0), (-1.0, 1.0), (1.0, -1.0)]
        {
            pad.take(Control::Axis(0), value);
            assert!((pad.levers().steering - position).abs() < 1e-9, "{value}: {}", pad.levers().steering);
        }
        pad.profile.invert(Function::Steering);
        assert!(pad.levers().steering > 0.99);
    }

    #[test]
    fn triggers_are_pedals_and_a_press_is_told_once() {
        let trigger = Control::Button(7);
        let buttons = [(Function::Gas, trigger), (Function::Reverse, Control::Button(3))];
        let mut pad = device(Profile::usual(Some(Control::Axis(0)), false, &buttons));
        pad.take(trigger, 0.4);
        assert_eq!(pad.levers().gas, 0.4);
        assert!(pad.is_used() && !pad.is_used());
        assert_eq!(pad.take(Control::Button(3), 1.0), [Function::Reverse]);
        assert_eq!(pad.take(Control::Button(3), 1.0), []);
        pad.take(Control::Button(3), 0.0);
        assert_eq!(pad.take(Control::Button(3), 1.0), [Function::Reverse]);
        assert!(!pad.is_used(), "buttons are no levers");
    }

    #[test]
    fn values_without_range_or_sense_press_nothing() {
        let axis = Control::Axis(0);
        let levers = [
            (Function::Gas, lever(axis, 0.5, 0.5)),
            (Function::Brake, Lever { dead_zone: 7.0, ..lever(axis, 0.0, 1.0) }),
        ];
        let mut wheel = device(Profile { levers: levers.into(), ..Profile::default() });
        wheel.take(axis, 0.5);
        assert_eq!((wheel.levers().gas, wheel.levers().brake), (0.0, 0.0));
    }
}
