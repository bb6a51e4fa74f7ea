//! Calibration of a control: which one is meant, and its range, from its motion.

use super::device::{
    ControlFunction, DeviceControl, DeviceProfile, LeverCalibration, SteeringCalibration, Values,
};
use std::collections::BTreeMap;

/// The result of a calibration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Assignment {
    /// The steering axis with its range.
    Steering(SteeringCalibration),
    /// The control of any other function, with its range.
    LeverCalibration(ControlFunction, LeverCalibration),
}

/// Watches a device until a control has been moved to its end and released again.
#[derive(Clone, Debug)]
pub struct Calibrator {
    function: ControlFunction,
    travels: BTreeMap<DeviceControl, Travel>,
}

/// Range and present value of a control since the start of the calibration.
#[derive(Clone, Copy, Debug)]
struct Travel {
    start: f64,
    low: f64,
    high: f64,
    now: f64,
    /// Whether it moved far up before it moved far down.
    is_up_first: Option<bool>,
    moved_s: f64,
}

/// Least travel of the control that is meant.
const MIN_AXIS_TRAVEL: f64 = 0.5;
const MIN_BUTTON_TRAVEL: f64 = 0.5;
/// Released: back within this fraction of its travel, and still for a time.
const RELEASE_TOLERANCE: f64 = 0.25;
const RELEASE_TIME_S: f64 = 0.3;
/// Fraction of the range that counts as full, so that the end is reached each time.
const FULL_FRACTION: f64 = 0.97;
/// Dead zone of pedals; buttons have none.
const PEDAL_DEAD_ZONE: f64 = 0.03;

impl Travel {
    fn new(start: f64, now_s: f64) -> Self {
        Self { start, low: start, high: start, now: start, is_up_first: None, moved_s: now_s }
    }

    fn update(&mut self, value: f64, extent: f64, now_s: f64) {
        (self.low, self.high, self.now) = (self.low.min(value), self.high.max(value), value);
        self.moved_s = now_s;
        if self.is_up_first.is_none() && (value - self.start).abs() >= extent {
            self.is_up_first = Some(value > self.start);
        }
    }

    /// Travel up and down from the start.
    fn extents(&self) -> [f64; 2] {
        [self.high - self.start, self.start - self.low]
    }

    fn is_released(&self, extent: f64, now_s: f64) -> bool {
        (self.now - self.start).abs() <= RELEASE_TOLERANCE * extent && now_s - self.moved_s >= RELEASE_TIME_S
    }
}

impl Calibrator {
    /// Starts with the present values of a device.
    pub fn new(function: ControlFunction, values: &Values) -> Self {
        let travels =
            values.iter().map(|(control, value)| (*control, Travel::new(*value, f64::NEG_INFINITY)));
        Self { function, travels: travels.collect() }
    }

    /// The function that gets a control.
    pub fn function(&self) -> ControlFunction {
        self.function
    }

    /// The instruction for the person.
    pub fn request(&self) -> &'static str {
        match self.function {
            ControlFunction::Steering => {
                "Turn it fully to the left, then fully to the right, then let it return to its centre."
            }
            ControlFunction::Gas | ControlFunction::Brake | ControlFunction::Handbrake => {
                "Press it as far as it goes, then let it go."
            }
            _ => "Press the button for it.",
        }
    }

    /// Takes a new value of a control. An unknown axis starts at its first value, a button released.
    pub fn take(&mut self, control: DeviceControl, value: f64, now_s: f64) {
        let (start, extent) = match control {
            DeviceControl::Axis(_) => (value, MIN_AXIS_TRAVEL),
            DeviceControl::Button(_) => (0.0, MIN_BUTTON_TRAVEL),
        };
        self.travels.entry(control).or_insert_with(|| Travel::new(start, now_s)).update(value, extent, now_s);
    }

    /// The result, a moment after the control was released.
    pub fn outcome(&self, now_s: f64) -> Option<Assignment> {
        if self.function == ControlFunction::Steering { self.steering(now_s) } else { self.lever(now_s) }
    }

    fn steering(&self, now_s: f64) -> Option<Assignment> {
        let extent = |travel: &Travel| travel.extents().into_iter().fold(f64::INFINITY, f64::min);
        let turned = self.travels.iter().filter(|(control, _)| matches!(control, DeviceControl::Axis(_)));
        let (&control, travel) = turned.max_by(|a, b| extent(a.1).total_cmp(&extent(b.1)))?;
        if extent(travel) < MIN_AXIS_TRAVEL || !travel.is_released(extent(travel), now_s) {
            return None;
        }
        let centre = travel.now;
        let end = |value: f64| centre + (value - centre) * FULL_FRACTION;
        let (high, low) = (end(travel.high), end(travel.low));
        let (left, right) = if travel.is_up_first? { (high, low) } else { (low, high) };
        Some(Assignment::Steering(SteeringCalibration { control, left, centre, right, dead_zone: 0.0 }))
    }

    fn lever(&self, now_s: f64) -> Option<Assignment> {
        let extent = |travel: &Travel| travel.extents().into_iter().fold(0.0, f64::max);
        // Axes have twice the range of buttons.
        let fraction = |(control, travel): &(&DeviceControl, &Travel)| match control {
            DeviceControl::Axis(_) => extent(travel) / 2.0,
            DeviceControl::Button(_) => extent(travel),
        };
        let (&control, travel) = self.travels.iter().max_by(|a, b| fraction(a).total_cmp(&fraction(b)))?;
        let least =
            if matches!(control, DeviceControl::Axis(_)) { MIN_AXIS_TRAVEL } else { MIN_BUTTON_TRAVEL };
        if extent(travel) < least || !travel.is_released(extent(travel), now_s) {
            return None;
        }
        let [up, down] = travel.extents();
        let (rest, end) = (travel.now, if up > down { travel.high } else { travel.low });
        let lever = match control {
            DeviceControl::Axis(_) => LeverCalibration {
                control,
                rest,
                full: rest + (end - rest) * FULL_FRACTION,
                dead_zone: PEDAL_DEAD_ZONE,
            },
            DeviceControl::Button(_) => {
                LeverCalibration { full: end * FULL_FRACTION, ..LeverCalibration::button(control) }
            }
        };
        Some(Assignment::LeverCalibration(self.function, lever))
    }
}

impl DeviceProfile {
    /// Applies a calibration; returns the functions that lost their control.
    pub fn assign(&mut self, assignment: Assignment) -> Vec<ControlFunction> {
        let function = match assignment {
            Assignment::Steering(_) => ControlFunction::Steering,
            Assignment::LeverCalibration(function, _) => function,
        };
        let others = ControlFunction::ALL.into_iter().filter(|other| *other != function);
        let taken: Vec<ControlFunction> = others.filter(|other| self.clashes(*other, &assignment)).collect();
        taken.iter().for_each(|other| self.clear(*other));
        match assignment {
            Assignment::Steering(mut steering) => {
                // A chosen dead zone stays.
                steering.dead_zone = self.steering.map_or(0.0, |old| old.dead_zone);
                self.steering = Some(steering);
            }
            Assignment::LeverCalibration(function, lever) => _ = self.levers.insert(function, lever),
        }
        taken
    }

    /// Whether another function uses the same control in the same direction.
    fn clashes(&self, other: ControlFunction, assignment: &Assignment) -> bool {
        match (assignment, other) {
            (Assignment::Steering(steering), _) => self.control(other) == Some(steering.control),
            (Assignment::LeverCalibration(_, lever), ControlFunction::Steering) => {
                self.control(ControlFunction::Steering) == Some(lever.control)
            }
            (Assignment::LeverCalibration(_, lever), _) => self.levers.get(&other).is_some_and(|old| {
                old.control == lever.control && (old.full - old.rest) * (lever.full - lever.rest) > 0.0
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Moves a control through values, a tenth of a second each, and waits.
    fn learn(
        function: ControlFunction,
        known: &Values,
        moves: &[(DeviceControl, f64)],
    ) -> Option<Assignment> {
        let mut learner = Calibrator::new(function, known);
        let mut now_s = 10.0;
        for &(control, value) in moves {
            assert_eq!(learner.outcome(now_s), None, "nothing is known before it is let go");
            now_s += 0.1;
            learner.take(control, value, now_s);
        }
        learner.outcome(now_s + 1.0)
    }

    fn lever(assignment: Option<Assignment>) -> LeverCalibration {
        match assignment {
            Some(Assignment::LeverCalibration(_, lever)) => lever,
            other => panic!("no lever: {other:?}"),
        }
    }

    fn along(control: DeviceControl, values: &[f64]) -> Vec<(DeviceControl, f64)> {
        values.iter().map(|value| (control, *value)).collect()
    }

    #[test]
    fn a_pedal_that_rests_at_one_is_learnt_with_its_range() {
        let pedal = DeviceControl::Axis(1);
        let found =
            lever(learn(ControlFunction::Gas, &Values::new(), &along(pedal, &[0.98, 0.2, -0.9, 0.3, 0.99])));
        assert_eq!((found.control, found.rest), (pedal, 0.99));
        assert!((found.full - (0.99 - 1.89 * 0.97)).abs() < 1e-9, "{found:?}");
        let known = Values::from([(pedal, -1.0)]);
        let other = lever(learn(ControlFunction::Gas, &known, &along(pedal, &[0.5, 1.0, -1.0])));
        assert!(other.rest == -1.0 && other.full > 0.9, "{other:?}");
    }

    #[test]
    fn pedals_on_one_axis_are_learnt_one_after_the_other() {
        let axis = DeviceControl::Axis(2);
        let known = Values::from([(axis, 0.0)]);
        let mut profile = DeviceProfile::default();
        for (function, end) in [(ControlFunction::Gas, 1.0), (ControlFunction::Brake, -1.0)] {
            let found = learn(function, &known, &along(axis, &[0.4 * end, end, 0.01]));
            assert_eq!(profile.assign(found.unwrap()), [], "they do not get in each other's way");
        }
        let values = Values::from([(axis, -1.0)]);
        assert_eq!(profile.position(ControlFunction::Brake, &values), 1.0);
        assert_eq!(profile.position(ControlFunction::Gas, &values), 0.0);
    }

    #[test]
    fn the_control_that_moves_most_is_meant_and_noise_is_not() {
        let (noise, pedal, trigger) =
            (DeviceControl::Axis(0), DeviceControl::Axis(4), DeviceControl::Button(9));
        let moves = [(noise, 0.1), (pedal, -1.0), (noise, -0.2), (pedal, 0.9), (noise, 0.0), (pedal, -1.0)];
        assert_eq!(lever(learn(ControlFunction::Brake, &Values::new(), &moves)).control, pedal);
        assert_eq!(learn(ControlFunction::Brake, &Values::new(), &along(noise, &[0.0, 0.3, 0.0])), None);
        let found = lever(learn(ControlFunction::Brake, &Values::new(), &along(trigger, &[0.3, 1.0, 0.0])));
        assert_eq!((found.control, found.rest), (trigger, 0.0));
        let held = learn(ControlFunction::Brake, &Values::new(), &along(pedal, &[-1.0, 0.5, 1.0]));
        assert_eq!(held, None, "it has still to be let go");
    }

    #[test]
    fn a_wheel_is_learnt_from_side_to_side_left_first() {
        let axis = DeviceControl::Axis(0);
        let turns = [0.02, -0.5, -1.0, 0.0, 0.8, 0.04];
        let Some(Assignment::Steering(wheel)) =
            learn(ControlFunction::Steering, &Values::new(), &along(axis, &turns))
        else {
            panic!("no wheel")
        };
        assert!(wheel.left < -0.95 && wheel.centre == 0.04 && (0.7..0.8).contains(&wheel.right), "{wheel:?}");
        let turns: Vec<f64> = turns.map(|value| -value).into();
        let Some(Assignment::Steering(other)) =
            learn(ControlFunction::Steering, &Values::new(), &along(axis, &turns))
        else {
            panic!("no wheel")
        };
        assert!(other.left > 0.95, "{other:?}");
        let half = along(axis, &[0.0, -0.6, -1.0, 0.0]);
        assert_eq!(learn(ControlFunction::Steering, &Values::new(), &half), None, "one side is not enough");
        let buttons = along(DeviceControl::Button(1), &[1.0, 0.0]);
        assert_eq!(
            learn(ControlFunction::Steering, &Values::new(), &buttons),
            None,
            "a button does not steer"
        );
    }

    #[test]
    fn a_control_does_one_thing_for_each_way_it_moves() {
        let button = DeviceControl::Button(3);
        let mut profile =
            DeviceProfile::usual(Some(DeviceControl::Axis(0)), false, &[(ControlFunction::Hazard, button)]);
        profile.steering.as_mut().unwrap().dead_zone = 0.2;
        let found = learn(ControlFunction::Reverse, &Values::new(), &along(button, &[1.0, 0.0])).unwrap();
        assert_eq!(profile.assign(found), [ControlFunction::Hazard]);
        assert_eq!(profile.control(ControlFunction::Reverse), Some(button));
        let stick = along(DeviceControl::Axis(0), &[0.0, 1.0, 0.0]);
        let found = learn(ControlFunction::Gas, &Values::new(), &stick).unwrap();
        assert_eq!(profile.assign(found), [ControlFunction::Steering]);
        let wheel = along(DeviceControl::Axis(0), &[0.0, 1.0, -1.0, 0.0]);
        let found = learn(ControlFunction::Steering, &Values::new(), &wheel).unwrap();
        assert_eq!(profile.assign(found), [ControlFunction::Gas]);
    }
}
