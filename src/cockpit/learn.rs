//! Finding out which control of a device someone means, and how far it goes: by moving it.

use super::device::{Control, Function, Lever, Profile, Steering, Values};
use std::collections::BTreeMap;

/// What has been found out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Assignment {
    Steering(Steering),
    Lever(Function, Lever),
}

/// Watches a device until a control has been moved as far as it goes and let go again.
#[derive(Clone, Debug)]
pub struct Learner {
    function: Function,
    travels: BTreeMap<Control, Travel>,
}

/// Where a control has been while it was watched.
#[derive(Clone, Copy, Debug)]
struct Travel {
    start: f64,
    low: f64,
    high: f64,
    now: f64,
    /// It went far up before it went far down.
    is_up_first: Option<bool>,
    moved_s: f64,
}

/// A control that is meant moves at least so far from where it was.
const AXIS_WAY: f64 = 0.5;
const BUTTON_WAY: f64 = 0.5;
/// It is let go when it is back within this share of its way, and stays there.
const BACK: f64 = 0.25;
const STILL_S: f64 = 0.3;
/// The last of its way is given away, so that its end is reached each time.
const REACH: f64 = 0.97;
/// Of pedals; buttons have none.
const PEDAL_DEAD: f64 = 0.03;

impl Travel {
    fn new(start: f64, now_s: f64) -> Self {
        Self { start, low: start, high: start, now: start, is_up_first: None, moved_s: now_s }
    }

    fn go(&mut self, value: f64, way: f64, now_s: f64) {
        (self.low, self.high, self.now) = (self.low.min(value), self.high.max(value), value);
        self.moved_s = now_s;
        if self.is_up_first.is_none() && (value - self.start).abs() >= way {
            self.is_up_first = Some(value > self.start);
        }
    }

    /// Ways up and down from where it was.
    fn ways(&self) -> [f64; 2] {
        [self.high - self.start, self.start - self.low]
    }

    fn is_back(&self, way: f64, now_s: f64) -> bool {
        (self.now - self.start).abs() <= BACK * way && now_s - self.moved_s >= STILL_S
    }
}

impl Learner {
    /// Begins to watch a device whose controls have these values.
    pub fn new(function: Function, values: &Values) -> Self {
        let travels =
            values.iter().map(|(control, value)| (*control, Travel::new(*value, f64::NEG_INFINITY)));
        Self { function, travels: travels.collect() }
    }

    pub fn function(&self) -> Function {
        self.function
    }

    /// What the person is asked to do.
    pub fn request(&self) -> &'static str {
        match self.function {
            Function::Steering => {
                "Turn it fully to the left, then fully to the right, then let it go to its middle."
            }
            Function::Gas | Function::Brake | Function::Handbrake => {
                "Press it as far as it goes, then let it go."
            }
            _ => "Press the button that shall do it.",
        }
    }

    /// A control has moved. An axis of which nothing was known starts where it is first seen, a button released.
    pub fn take(&mut self, control: Control, value: f64, now_s: f64) {
        let (start, way) = match control {
            Control::Axis(_) => (value, AXIS_WAY),
            Control::Button(_) => (0.0, BUTTON_WAY),
        };
        self.travels.entry(control).or_insert_with(|| Travel::new(start, now_s)).go(value, way, now_s);
    }

    /// What has been found out by now. It takes a moment after the control was let go.
    pub fn outcome(&self, now_s: f64) -> Option<Assignment> {
        if self.function == Function::Steering { self.steering(now_s) } else { self.lever(now_s) }
    }

    fn steering(&self, now_s: f64) -> Option<Assignment> {
        let way = |travel: &Travel| travel.ways().into_iter().fold(f64::INFINITY, f64::min);
        let turned = self.travels.iter().filter(|(control, _)| matches!(control, Control::Axis(_)));
        let (&control, travel) = turned.max_by(|a, b| way(a.1).total_cmp(&way(b.1)))?;
        if way(travel) < AXIS_WAY || !travel.is_back(way(travel), now_s) {
            return None;
        }
        let centre = travel.now;
        let end = |value: f64| centre + (value - centre) * REACH;
        let (high, low) = (end(travel.high), end(travel.low));
        let (left, right) = if travel.is_up_first? { (high, low) } else { (low, high) };
        Some(Assignment::Steering(Steering { control, left, centre, right, dead_zone: 0.0 }))
    }

    fn lever(&self, now_s: f64) -> Option<Assignment> {
        let way = |travel: &Travel| travel.ways().into_iter().fold(0.0, f64::max);
        // Axes have twice the range of buttons.
        let share = |(control, travel): &(&Control, &Travel)| match control {
            Control::Axis(_) => way(travel) / 2.0,
            Control::Button(_) => way(travel),
        };
        let (&control, travel) = self.travels.iter().max_by(|a, b| share(a).total_cmp(&share(b)))?;
        let least = if matches!(control, Control::Axis(_)) { AXIS_WAY } else { BUTTON_WAY };
        if way(travel) < least || !travel.is_back(way(travel), now_s) {
            return None;
        }
        let [up, down] = travel.ways();
        let (rest, end) = (travel.now, if up > down { travel.high } else { travel.low });
        let lever = match control {
            Control::Axis(_) => {
                Lever { control, rest, full: rest + (end - rest) * REACH, dead_zone: PEDAL_DEAD }
            }
            Control::Button(_) => Lever { full: end * REACH, ..Lever::button(control) },
        };
        Some(Assignment::Lever(self.function, lever))
    }
}

impl Profile {
    /// Takes over what has been found out; gives what the control did until now and no longer does.
    pub fn assign(&mut self, assignment: Assignment) -> Vec<Function> {
        let function = match assignment {
            Assignment::Steering(_) => Function::Steering,
            Assignment::Lever(function, _) => function,
        };
        let others = Function::ALL.into_iter().filter(|other| *other != function);
        let taken: Vec<Function> = others.filter(|other| self.clashes(*other, &assignment)).collect();
        taken.iter().for_each(|other| self.clear(*other));
        match assignment {
            Assignment::Steering(mut steering) => {
                // Who has chosen a dead zone keeps it.
                steering.dead_zone = self.steering.map_or(0.0, |old| old.dead_zone);
                self.steering = Some(steering);
            }
            Assignment::Lever(function, lever) => _ = self.levers.insert(function, lever),
        }
        taken
    }

    /// Whether the same control, moved the same way, does something else.
    fn clashes(&self, other: Function, assignment: &Assignment) -> bool {
        match (assignment, other) {
            (Assignment::Steering(steering), _) => self.control(other) == Some(steering.control),
            (Assignment::Lever(_, lever), Function::Steering) => {
                self.control(Function::Steering) == Some(lever.control)
            }
            (Assignment::Lever(_, lever), _) => self.levers.get(&other).is_some_and(|old| {
                old.control == lever.control && (old.full - old.rest) * (lever.full - lever.rest) > 0.0
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Moves a control through values, a tenth of a second each, and waits.
    fn learn(function: Function, known: &Values, moves: &[(Control, f64)]) -> Option<Assignment> {
        let mut learner = Learner::new(function, known);
        let mut now_s = 10.0;
        for &(control, value) in moves {
            assert_eq!(learner.outcome(now_s), None, "nothing is known before it is let go");
            now_s += 0.1;
            learner.take(control, value, now_s);
        }
        learner.outcome(now_s + 1.0)
    }

    fn lever(assignment: Option<Assignment>) -> Lever {
        match assignment {
            Some(Assignment::Lever(_, lever)) => lever,
            other => panic!("no lever: {other:?}"),
        }
    }

    fn along(control: Control, values: &[f64]) -> Vec<(Control, f64)> {
        values.iter().map(|value| (control, *value)).collect()
    }

    #[test]
    fn a_pedal_that_rests_at_one_is_learnt_with_its_range() {
        let pedal = Control::Axis(1);
        let found = lever(learn(Function::Gas, &Values::new(), &along(pedal, &[0.98, 0.2, -0.9, 0.3, 0.99])));
        assert_eq!((found.control, found.rest), (pedal, 0.99));
        assert!((found.full - (0.99 - 1.89 * 0.97)).abs() < 1e-9, "{found:?}");
        let known = Values::from([(pedal, -1.0)]);
        let other = lever(learn(Function::Gas, &known, &along(pedal, &[0.5, 1.0, -1.0])));
        assert!(other.rest == -1.0 && other.full > 0.9, "{other:?}");
    }

    #[test]
    fn pedals_on_one_axis_are_learnt_one_after_the_other() {
        let axis = Control::Axis(2);
        let known = Values::from([(axis, 0.0)]);
        let mut profile = Profile::default();
        for (function, end) in [(Function::Gas, 1.0), (Function::Brake, -1.0)] {
            let found = learn(function, &known, &along(axis, &[0.4 * end, end, 0.01]));
            assert_eq!(profile.assign(found.unwrap()), [], "they do not get in each other's way");
        }
        let values = Values::from([(axis, -1.0)]);
        assert_eq!(profile.position(Function::Brake, &values), 1.0);
        assert_eq!(profile.position(Function::Gas, &values), 0.0);
    }

    #[test]
    fn the_control_that_moves_most_is_meant_and_noise_is_not() {
        let (noise, pedal, trigger) = (Control::Axis(0), Control::Axis(4), Control::Button(9));
        let moves = [(noise, 0.1), (pedal, -1.0), (noise, -0.2), (pedal, 0.9), (noise, 0.0), (pedal, -1.0)];
        assert_eq!(lever(learn(Function::Brake, &Values::new(), &moves)).control, pedal);
        assert_eq!(learn(Function::Brake, &Values::new(), &along(noise, &[0.0, 0.3, 0.0])), None);
        let found = lever(learn(Function::Brake, &Values::new(), &along(trigger, &[0.3, 1.0, 0.0])));
        assert_eq!((found.control, found.rest), (trigger, 0.0));
        let held = learn(Function::Brake, &Values::new(), &along(pedal, &[-1.0, 0.5, 1.0]));
        assert_eq!(held, None, "it has still to be let go");
    }

    #[test]
    fn a_wheel_is_learnt_from_side_to_side_left_first() {
        let axis = Control::Axis(0);
        let turns = [0.02, -0.5, -1.0, 0.0, 0.8, 0.04];
        let Some(Assignment::Steering(wheel)) =
            learn(Function::Steering, &Values::new(), &along(axis, &turns))
        else {
            panic!("no wheel")
        };
        assert!(wheel.left < -0.95 && wheel.centre == 0.04 && (0.7..0.8).contains(&wheel.right), "{wheel:?}");
        let turns: Vec<f64> = turns.map(|value| -value).into();
        let Some(Assignment::Steering(other)) =
            learn(Function::Steering, &Values::new(), &along(axis, &turns))
        else {
            panic!("no wheel")
        };
        assert!(other.left > 0.95, "{other:?}");
        let half = along(axis, &[0.0, -0.6, -1.0, 0.0]);
        assert_eq!(learn(Function::Steering, &Values::new(), &half), None, "one side is not enough");
        let buttons = along(Control::Button(1), &[1.0, 0.0]);
        assert_eq!(learn(Function::Steering, &Values::new(), &buttons), None, "a button does not steer");
    }

    #[test]
    fn a_control_does_one_thing_for_each_way_it_moves() {
        let button = Control::Button(3);
        let mut profile = Profile::usual(Some(Control::Axis(0)), false, &[(Function::Hazard, button)]);
        profile.steering.as_mut().unwrap().dead_zone = 0.2;
        let found = learn(Function::Reverse, &Values::new(), &along(button, &[1.0, 0.0])).unwrap();
        assert_eq!(profile.assign(found), [Function::Hazard]);
        assert_eq!(profile.control(Function::Reverse), Some(button));
        let stick = along(Control::Axis(0), &[0.0, 1.0, 0.0]);
        let found = learn(Function::Gas, &Values::new(), &stick).unwrap();
        assert_eq!(profile.assign(found), [Function::Steering]);
        let wheel = along(Control::Axis(0), &[0.0, 1.0, -1.0, 0.0]);
        let found = learn(Function::Steering, &Values::new(), &wheel).unwrap();
        assert_eq!(profile.assign(found), [Function::Gas]);
    }
}
