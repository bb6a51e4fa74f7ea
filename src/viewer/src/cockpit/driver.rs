//! Manual driver: rate-limited pedals and steering from keys; direct positions from gamepads and steering wheels.

use super::LeverPositions;
use city3d_geometry::trig;
use city3d_protocol::snapshot::{Indicator, Pedals};

/// Driving keys that are held down.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct HeldKeys {
    /// Presses the gas pedal; the brake key wins.
    pub gas: bool,
    /// Presses the brake pedal.
    pub brake: bool,
    /// Applies the handbrake fully.
    pub handbrake: bool,
    /// Steers to the left; with `right` the steering returns to the centre.
    pub left: bool,
    /// Steers to the right.
    pub right: bool,
}

/// The input of the driver: keys, or analogue controls.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DriverInput {
    /// Keys: pedals and steering move at limited rates.
    HeldKeys(HeldKeys),
    /// Calibrated positions of a gamepad or a steering wheel, which apply at once.
    LeverPositions(LeverPositions),
}

/// Geometry that limits the steering angle, city metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SteeringGeometry {
    /// Distance from the rear axle to the front axle.
    pub wheelbase_m: f64,
    /// Largest steering angle of the front axle's middle, to either side.
    pub steering_limit_rad: f64,
}

/// Time of full pedal travel down, and back up.
const GAS_DOWN_S: f64 = 0.7;
const GAS_UP_S: f64 = 0.2;
const BRAKE_DOWN_S: f64 = 0.35;
const BRAKE_UP_S: f64 = 0.15;
/// Brake pedal of a held key: a full stop without locked wheels.
const MAX_KEY_BRAKE: f64 = 0.8;
/// Steering rate away from the centre and back, rad/s at the front axle.
const STEER_RATE_RADPS: f64 = 0.6;
const CENTRE_RATE_RADPS: f64 = 1.2;
/// Limit of the lateral acceleration that keys and sticks request, so that a car does not skid at speed.
const MAX_LATERAL_MPS2: f64 = 5.0;
/// The gear changes only below this speed.
const MAX_SHIFT_SPEED_MPS: f64 = 1.0;

/// Turns keys and analogue controls into pedals over time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ManualDriver {
    pedals: Pedals,
    /// The requested gear.
    wants_reverse: bool,
}

impl ManualDriver {
    /// Takes over a moving vehicle: the steering starts at its present angle.
    pub fn taking_over(steering_rad: f64) -> Self {
        let pedals = Pedals { steering_rad, ..Pedals::default() };
        Self { pedals, wants_reverse: false }
    }

    /// Present pedals, steering angle, gear and indicators.
    pub fn pedals(&self) -> Pedals {
        self.pedals
    }

    /// Requests the other direction; it engages once the vehicle is slow enough.
    pub fn shift(&mut self) {
        self.wants_reverse = !self.wants_reverse;
    }

    /// Whether the requested gear is not engaged yet.
    pub fn is_shifting(&self) -> bool {
        self.wants_reverse != self.pedals.reverse
    }

    /// Switches an indicator on, or off where it is on.
    pub fn indicate(&mut self, wanted: Indicator) {
        let pedals = &mut self.pedals;
        pedals.indicator = if pedals.indicator == wanted { Indicator::Off } else { wanted };
    }

    /// Releases all pedals and the handbrake.
    pub fn release_pedals(&mut self) {
        (self.pedals.gas, self.pedals.brake, self.pedals.handbrake) = (0.0, 0.0, 0.0);
    }

    /// Advances pedals and steering by `dt_s`, for a vehicle at `speed_mps`.
    pub fn step(
        &mut self,
        hands: DriverInput,
        speed_mps: f64,
        steering_geometry: &SteeringGeometry,
        dt_s: f64,
    ) -> Pedals {
        if speed_mps.abs() < MAX_SHIFT_SPEED_MPS {
            self.pedals.reverse = self.wants_reverse;
        }
        match hands {
            DriverInput::HeldKeys(keys) => self.step_keys(keys, speed_mps, steering_geometry, dt_s),
            DriverInput::LeverPositions(levers) => self.step_levers(levers, speed_mps, steering_geometry),
        }
        self.pedals
    }

    fn step_keys(&mut self, keys: HeldKeys, speed_mps: f64, steering_geometry: &SteeringGeometry, dt_s: f64) {
        let gas = keys.gas && !keys.brake && !self.is_shifting();
        let pedals = &mut self.pedals;
        pedals.gas = limit_rate(pedals.gas, if gas { 1.0 } else { 0.0 }, (GAS_DOWN_S, GAS_UP_S), dt_s);
        let brake = if keys.brake { MAX_KEY_BRAKE } else { 0.0 };
        pedals.brake = limit_rate(pedals.brake, brake, (BRAKE_DOWN_S, BRAKE_UP_S), dt_s);
        pedals.handbrake = if keys.handbrake { 1.0 } else { 0.0 };
        pedals.steering_rad = steer(pedals.steering_rad, keys, speed_mps, steering_geometry, dt_s);
    }

    fn step_levers(&mut self, levers: LeverPositions, speed_mps: f64, steering_geometry: &SteeringGeometry) {
        let is_shifting = self.is_shifting();
        let pedals = &mut self.pedals;
        pedals.gas = if is_shifting { 0.0 } else { levers.gas };
        (pedals.brake, pedals.handbrake) = (levers.brake, levers.handbrake);
        let most = if levers.speed_sensitive {
            max_steering_rad(speed_mps, steering_geometry)
        } else {
            steering_geometry.steering_limit_rad
        };
        pedals.steering_rad = levers.steering * most;
    }
}

fn limit_rate(from: f64, to: f64, (down_s, up_s): (f64, f64), dt_s: f64) -> f64 {
    if to > from { (from + dt_s / down_s).min(to) } else { (from - dt_s / up_s).max(to) }
}

/// The steering angle at the lateral acceleration limit (kinematic bicycle).
fn max_steering_rad(speed_mps: f64, steering_geometry: &SteeringGeometry) -> f64 {
    let angle_rad = trig::atan2(steering_geometry.wheelbase_m * MAX_LATERAL_MPS2, speed_mps * speed_mps);
    angle_rad.min(steering_geometry.steering_limit_rad)
}

fn steer(
    angle_rad: f64,
    keys: HeldKeys,
    speed_mps: f64,
    steering_geometry: &SteeringGeometry,
    dt_s: f64,
) -> f64 {
    let most = max_steering_rad(speed_mps, steering_geometry);
    let wanted = match (keys.left, keys.right) {
        (true, false) => most,
        (false, true) => -most,
        _ => 0.0,
    };
    let is_back = wanted == 0.0 || wanted * angle_rad < 0.0 || wanted.abs() < angle_rad.abs();
    let step = if is_back { CENTRE_RATE_RADPS } else { STEER_RATE_RADPS } * dt_s;
    angle_rad + (wanted - angle_rad).clamp(-step, step)
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAR: SteeringGeometry = SteeringGeometry { wheelbase_m: 3.0, steering_limit_rad: 0.7 };
    const DT: f64 = 1.0 / 60.0;

    fn hold(driver: &mut ManualDriver, keys: HeldKeys, speed_mps: f64, seconds: f64) -> Pedals {
        for _ in 0..(seconds / DT) as usize {
            driver.step(DriverInput::HeldKeys(keys), speed_mps, &CAR, DT);
        }
        driver.pedals()
    }

    #[test]
    fn pedals_go_down_and_up_gradually_and_the_brake_wins() {
        let mut driver = ManualDriver::default();
        let gas = HeldKeys { gas: true, ..HeldKeys::default() };
        let soon = hold(&mut driver, gas, 5.0, 0.2).gas;
        assert!((0.2..0.4).contains(&soon), "{soon}");
        assert_eq!(hold(&mut driver, gas, 5.0, 1.0).gas, 1.0);
        let both = hold(&mut driver, HeldKeys { brake: true, ..gas }, 5.0, 0.6);
        assert_eq!((both.gas, both.brake), (0.0, MAX_KEY_BRAKE));
        let none = hold(&mut driver, HeldKeys::default(), 5.0, 0.6);
        assert_eq!((none.gas, none.brake), (0.0, 0.0));
    }

    #[test]
    fn the_wheel_turns_less_at_speed_and_comes_back_alone() {
        let left = HeldKeys { left: true, ..HeldKeys::default() };
        let mut driver = ManualDriver::default();
        assert_eq!(hold(&mut driver, left, 0.0, 2.0).steering_rad, CAR.steering_limit_rad);
        let fast = hold(&mut driver, left, 12.0, 2.0).steering_rad;
        assert!((fast - trig::atan2(3.0 * MAX_LATERAL_MPS2, 144.0)).abs() < 1e-9, "{fast}");
        assert_eq!(hold(&mut driver, HeldKeys::default(), 12.0, 1.0).steering_rad, 0.0);
        let right = hold(&mut driver, HeldKeys { right: true, ..HeldKeys::default() }, 12.0, 2.0);
        assert!((right.steering_rad + fast).abs() < 1e-9);
    }

    #[test]
    fn reverse_is_engaged_at_a_stand_only_and_gas_waits_for_it() {
        let gas = HeldKeys { gas: true, ..HeldKeys::default() };
        let mut driver = ManualDriver::default();
        driver.shift();
        let rolling = hold(&mut driver, gas, 8.0, 1.0);
        assert!(!rolling.reverse && rolling.gas == 0.0 && driver.is_shifting());
        let standing = hold(&mut driver, gas, 0.2, 1.0);
        assert!(standing.reverse && standing.gas == 1.0 && !driver.is_shifting());
    }

    #[test]
    fn an_indicator_is_switched_off_by_its_own_key() {
        let mut driver = ManualDriver::taking_over(0.2);
        driver.indicate(Indicator::Left);
        driver.indicate(Indicator::Right);
        assert_eq!(driver.pedals().indicator, Indicator::Right);
        driver.indicate(Indicator::Right);
        assert_eq!((driver.pedals().indicator, driver.pedals().steering_rad), (Indicator::Off, 0.2));
    }

    #[test]
    fn levers_are_where_they_are_and_a_stick_steers_less_at_speed() {
        let levers =
            LeverPositions { steering: 0.5, gas: 0.3, brake: 0.1, handbrake: 1.0, speed_sensitive: false };
        let mut driver = ManualDriver::default();
        let pedals = driver.step(DriverInput::LeverPositions(levers), 12.0, &CAR, DT);
        assert_eq!((pedals.gas, pedals.brake, pedals.handbrake), (0.3, 0.1, 1.0));
        assert_eq!(pedals.steering_rad, 0.5 * CAR.steering_limit_rad, "a wheel is the car's");
        let eased = driver.step(
            DriverInput::LeverPositions(LeverPositions { speed_sensitive: true, ..levers }),
            12.0,
            &CAR,
            DT,
        );
        assert_eq!(eased.steering_rad, 0.5 * max_steering_rad(12.0, &CAR));
        driver.shift();
        let shifting = driver.step(DriverInput::LeverPositions(levers), 12.0, &CAR, DT);
        assert_eq!((shifting.gas, shifting.reverse), (0.0, false), "not before it is slow enough");
        let standing = driver.step(DriverInput::LeverPositions(levers), 0.1, &CAR, DT);
        assert_eq!((standing.gas, standing.reverse), (0.3, true));
        driver.release_pedals();
        assert_eq!((driver.pedals().gas, driver.pedals().brake, driver.pedals().handbrake), (0.0, 0.0, 0.0));
    }
}
