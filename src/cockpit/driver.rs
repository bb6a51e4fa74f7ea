//! Driving by hand: a key that is pressed becomes a pedal that travels and a wheel that turns; levers of a
//! gamepad or a steering wheel are where they are.

use super::Levers;
use crate::geom::trig;
use crate::snapshot::{Indicator, Pedals};

/// Keys of a driver that are held down.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Keys {
    pub gas: bool,
    pub brake: bool,
    pub handbrake: bool,
    pub left: bool,
    pub right: bool,
}

/// What the driver's hands and feet are on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Hands {
    Keys(Keys),
    Levers(Levers),
}

/// What the ramps need to know of the vehicle, city metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Handling {
    pub wheelbase_m: f64,
    pub steering_limit_rad: f64,
}

/// Time that a pedal takes from its stop to the floor, and back.
const GAS_DOWN_S: f64 = 0.7;
const GAS_UP_S: f64 = 0.2;
const BRAKE_DOWN_S: f64 = 0.35;
const BRAKE_UP_S: f64 = 0.15;
/// Most of the brake that a key presses: a full stop without locked wheels.
const BRAKE_MOST: f64 = 0.8;
/// The wheel turns so fast, rad/s at the front axle, and back so fast.
const STEER_RADPS: f64 = 0.6;
const CENTRE_RADPS: f64 = 1.2;
/// Keys and sticks ask for no more sideways than this, so that a car at speed does not skid at a touch.
const LATERAL_MPS2: f64 = 5.0;
/// The gear changes below this speed.
const SHIFT_BELOW_MPS: f64 = 1.0;

/// Turns keys and levers into pedals, as time goes by.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Driver {
    pedals: Pedals,
    /// The gear that the driver wants.
    wants_reverse: bool,
}

impl Driver {
    /// Takes the vehicle over as it drives: the wheel is where it is.
    pub fn taking_over(steering_rad: f64) -> Self {
        let pedals = Pedals { steering_rad, ..Pedals::default() };
        Self { pedals, wants_reverse: false }
    }

    pub fn pedals(&self) -> Pedals {
        self.pedals
    }

    /// Wants the other direction; it is engaged once the vehicle is slow enough.
    pub fn shift(&mut self) {
        self.wants_reverse = !self.wants_reverse;
    }

    /// Whether the gear is chosen but not engaged yet.
    pub fn is_shifting(&self) -> bool {
        self.wants_reverse != self.pedals.reverse
    }

    /// Switches an indicator on, or off where it is on.
    pub fn indicate(&mut self, wanted: Indicator) {
        let pedals = &mut self.pedals;
        pedals.indicator = if pedals.indicator == wanted { Indicator::Off } else { wanted };
    }

    /// Takes the feet off the pedals and lets go of the handbrake.
    pub fn let_go(&mut self) {
        (self.pedals.gas, self.pedals.brake, self.pedals.handbrake) = (0.0, 0.0, 0.0);
    }

    /// Moves pedals and wheel on by `dt_s`, for a vehicle at `speed_mps`.
    pub fn step(&mut self, hands: Hands, speed_mps: f64, handling: &Handling, dt_s: f64) -> Pedals {
        if speed_mps.abs() < SHIFT_BELOW_MPS {
            self.pedals.reverse = self.wants_reverse;
        }
        match hands {
            Hands::Keys(keys) => self.step_keys(keys, speed_mps, handling, dt_s),
            Hands::Levers(levers) => self.step_levers(levers, speed_mps, handling),
        }
        self.pedals
    }

    fn step_keys(&mut self, keys: Keys, speed_mps: f64, handling: &Handling, dt_s: f64) {
        let gas = keys.gas && !keys.brake && !self.is_shifting();
        let pedals = &mut self.pedals;
        pedals.gas = ramp(pedals.gas, if gas { 1.0 } else { 0.0 }, (GAS_DOWN_S, GAS_UP_S), dt_s);
        let brake = if keys.brake { BRAKE_MOST } else { 0.0 };
        pedals.brake = ramp(pedals.brake, brake, (BRAKE_DOWN_S, BRAKE_UP_S), dt_s);
        pedals.handbrake = if keys.handbrake { 1.0 } else { 0.0 };
        pedals.steering_rad = steer(pedals.steering_rad, keys, speed_mps, handling, dt_s);
    }

    fn step_levers(&mut self, levers: Levers, speed_mps: f64, handling: &Handling) {
        let is_shifting = self.is_shifting();
        let pedals = &mut self.pedals;
        pedals.gas = if is_shifting { 0.0 } else { levers.gas };
        (pedals.brake, pedals.handbrake) = (levers.brake, levers.handbrake);
        let most =
            if levers.eases { most_steering(speed_mps, handling) } else { handling.steering_limit_rad };
        pedals.steering_rad = levers.steering * most;
    }
}

fn ramp(from: f64, to: f64, (down_s, up_s): (f64, f64), dt_s: f64) -> f64 {
    if to > from { (from + dt_s / down_s).min(to) } else { (from - dt_s / up_s).max(to) }
}

/// The angle that asks for no more sideways than is comfortable.
fn most_steering(speed_mps: f64, handling: &Handling) -> f64 {
    let angle_rad = trig::atan2(handling.wheelbase_m * LATERAL_MPS2, speed_mps * speed_mps);
    angle_rad.min(handling.steering_limit_rad)
}

fn steer(angle_rad: f64, keys: Keys, speed_mps: f64, handling: &Handling, dt_s: f64) -> f64 {
    let most = most_steering(speed_mps, handling);
    let wanted = match (keys.left, keys.right) {
        (true, false) => most,
        (false, true) => -most,
        _ => 0.0,
    };
    let is_back = wanted == 0.0 || wanted * angle_rad < 0.0 || wanted.abs() < angle_rad.abs();
    let step = if is_back { CENTRE_RADPS } else { STEER_RADPS } * dt_s;
    angle_rad + (wanted - angle_rad).clamp(-step, step)
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAR: Handling = Handling { wheelbase_m: 3.0, steering_limit_rad: 0.7 };
    const DT: f64 = 1.0 / 60.0;

    fn hold(driver: &mut Driver, keys: Keys, speed_mps: f64, seconds: f64) -> Pedals {
        for _ in 0..(seconds / DT) as usize {
            driver.step(Hands::Keys(keys), speed_mps, &CAR, DT);
        }
        driver.pedals()
    }

    #[test]
    fn pedals_go_down_and_up_gradually_and_the_brake_wins() {
        let mut driver = Driver::default();
        let gas = Keys { gas: true, ..Keys::default() };
        let soon = hold(&mut driver, gas, 5.0, 0.2).gas;
        assert!((0.2..0.4).contains(&soon), "{soon}");
        assert_eq!(hold(&mut driver, gas, 5.0, 1.0).gas, 1.0);
        let both = hold(&mut driver, Keys { brake: true, ..gas }, 5.0, 0.6);
        assert_eq!((both.gas, both.brake), (0.0, BRAKE_MOST));
        let none = hold(&mut driver, Keys::default(), 5.0, 0.6);
        assert_eq!((none.gas, none.brake), (0.0, 0.0));
    }

    #[test]
    fn the_wheel_turns_less_at_speed_and_comes_back_alone() {
        let left = Keys { left: true, ..Keys::default() };
        let mut driver = Driver::default();
        assert_eq!(hold(&mut driver, left, 0.0, 2.0).steering_rad, CAR.steering_limit_rad);
        let fast = hold(&mut driver, left, 12.0, 2.0).steering_rad;
        assert!((fast - trig::atan2(3.0 * LATERAL_MPS2, 144.0)).abs() < 1e-9, "{fast}");
        assert_eq!(hold(&mut driver, Keys::default(), 12.0, 1.0).steering_rad, 0.0);
        let right = hold(&mut driver, Keys { right: true, ..Keys::default() }, 12.0, 2.0);
        assert!((right.steering_rad + fast).abs() < 1e-9);
    }

    #[test]
    fn reverse_is_engaged_at_a_stand_only_and_gas_waits_for_it() {
        let gas = Keys { gas: true, ..Keys::default() };
        let mut driver = Driver::default();
        driver.shift();
        let rolling = hold(&mut driver, gas, 8.0, 1.0);
        assert!(!rolling.reverse && rolling.gas == 0.0 && driver.is_shifting());
        let standing = hold(&mut driver, gas, 0.2, 1.0);
        assert!(standing.reverse && standing.gas == 1.0 && !driver.is_shifting());
    }

    #[test]
    fn an_indicator_is_switched_off_by_its_own_key() {
        let mut driver = Driver::taking_over(0.2);
        driver.indicate(Indicator::Left);
        driver.indicate(Indicator::Right);
        assert_eq!(driver.pedals().indicator, Indicator::Right);
        driver.indicate(Indicator::Right);
        assert_eq!((driver.pedals().indicator, driver.pedals().steering_rad), (Indicator::Off, 0.2));
    }

    #[test]
    fn levers_are_where_they_are_and_a_stick_steers_less_at_speed() {
        let levers = Levers { steering: 0.5, gas: 0.3, brake: 0.1, handbrake: 1.0, eases: false };
        let mut driver = Driver::default();
        let pedals = driver.step(Hands::Levers(levers), 12.0, &CAR, DT);
        assert_eq!((pedals.gas, pedals.brake, pedals.handbrake), (0.3, 0.1, 1.0));
        assert_eq!(pedals.steering_rad, 0.5 * CAR.steering_limit_rad, "a wheel is the car's");
        let eased = driver.step(Hands::Levers(Levers { eases: true, ..levers }), 12.0, &CAR, DT);
        assert_eq!(eased.steering_rad, 0.5 * most_steering(12.0, &CAR));
        driver.shift();
        let shifting = driver.step(Hands::Levers(levers), 12.0, &CAR, DT);
        assert_eq!((shifting.gas, shifting.reverse), (0.0, false), "not before it is slow enough");
        let standing = driver.step(Hands::Levers(levers), 0.1, &CAR, DT);
        assert_eq!((standing.gas, standing.reverse), (0.3, true));
        driver.let_go();
        assert_eq!((driver.pedals().gas, driver.pedals().brake, driver.pedals().handbrake), (0.0, 0.0, 0.0));
    }
}
