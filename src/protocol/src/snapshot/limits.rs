//! Performance limits of a vehicle in closed form: forces of motor, brakes and resistances.

use super::{Drive, GRAVITY_MPS2, VehicleSpec};
use city3d_geometry::trig;
use std::f64::consts::TAU;

/// Density of air at 15 degrees Celsius and sea level, kg/m3.
const AIR_DENSITY: f64 = 1.225;

impl VehicleSpec {
    /// Motor force at the road at full throttle, N, before the tyre limit: torque curve through the gear,
    /// limited by power.
    pub fn motor_force(&self, speed_mps: f64) -> f64 {
        let speed = speed_mps.abs();
        let radius = self.dimensions.wheel_radius_m;
        let rpm = speed / radius * self.motor.gear_ratio / TAU * 60.0;
        let force = self.motor.torque_at(rpm) * self.motor.gear_ratio / radius;
        // Below walking speed the power limit does not apply.
        force.min(self.motor.max_power_w / speed.max(0.1))
    }

    /// Air drag, N, against the motion.
    pub fn drag_force(&self, speed_mps: f64) -> f64 {
        0.5 * AIR_DENSITY * self.drag_area_m2 * speed_mps * speed_mps.abs()
    }

    /// Rolling resistance of all wheels on the level, N.
    pub fn rolling_force(&self) -> f64 {
        self.rolling_resistance * self.mass_kg * GRAVITY_MPS2
    }

    /// Force of the service brake at the road with the pedal fully down, N, before the tyre limit.
    pub fn brake_force(&self) -> f64 {
        self.brake_torque_nm / self.dimensions.wheel_radius_m
    }

    /// Force of the handbrake at the road, N, before the tyre limit.
    pub fn handbrake_force(&self) -> f64 {
        self.handbrake_torque_nm / self.dimensions.wheel_radius_m
    }

    /// Grip of all tyres on the level, N.
    pub fn grip_force(&self) -> f64 {
        self.tyre_friction * self.mass_kg * GRAVITY_MPS2
    }

    /// Distances from the centre of mass to the front and to the rear axle.
    pub fn axle_arms(&self) -> (f64, f64) {
        let half = self.dimensions.wheelbase_m / 2.0;
        (half - self.centre_of_mass.ahead_m, half + self.centre_of_mass.ahead_m)
    }

    /// Share of rotational kinetic energy when the front axle moves sideways about the rear axle, relative to
    /// translation at the same speed.
    pub fn turning_share(&self) -> f64 {
        let d = &self.dimensions;
        let (_, rear) = self.axle_arms();
        let block = (d.length_m * d.length_m + d.width_m * d.width_m) / 12.0;
        (rear * rear + self.yaw_inertia_factor * block) / (d.wheelbase_m * d.wheelbase_m)
    }

    /// Traction limit of the driven axle, N, with load transfer.
    fn traction_force(&self) -> f64 {
        let (front, rear) = self.axle_arms();
        let wheelbase = self.dimensions.wheelbase_m;
        let lever = self.tyre_friction * self.centre_of_mass.height_m;
        let grip = self.grip_force();
        match self.drive {
            Drive::All => grip,
            Drive::Front => grip * rear / (wheelbase + lever),
            // The lever arm may exceed the wheelbase: then the front wheels lift first.
            Drive::Rear => grip * front / (wheelbase - lever).max(front.max(0.01)),
        }
    }

    /// Largest acceleration on the level, straight ahead, m/s2: the smaller of motor force and traction
    /// limit, less drag and rolling resistance. Negative above the top speed.
    pub fn max_acceleration_at(&self, speed_mps: f64) -> f64 {
        let drive = self.motor_force(speed_mps).min(self.traction_force());
        (drive - self.drag_force(speed_mps) - self.rolling_force()) / self.mass_kg
    }

    /// Largest deceleration of the service brake on the level, m/s2, without drag: the smaller of brake force
    /// and grip.
    pub fn max_braking(&self) -> f64 {
        self.brake_force().min(self.grip_force()) / self.mass_kg
    }

    /// Turning radius of the front-axle centre at the steering limit, without tyre slip, m.
    pub fn min_turn_radius(&self) -> f64 {
        self.dimensions.wheelbase_m / trig::sin(self.steering_limit_rad)
    }

    /// Top speed: motor force and resistances are in balance, m/s.
    pub fn top_speed(&self) -> f64 {
        let (mut low, mut high) = (0.0, 200.0);
        for _ in 0..60 {
            let middle = (low + high) / 2.0;
            if self.max_acceleration_at(middle) > 0.0 { low = middle } else { high = middle }
        }
        low
    }
}

impl super::Motor {
    /// Torque at full throttle, N m: linear between the points, constant below the first, zero beyond the
    /// last.
    pub fn torque_at(&self, rpm: f64) -> f64 {
        let points = &self.torque_curve;
        let after = points.partition_point(|point| point.rpm <= rpm);
        match (after.checked_sub(1).map(|k| points[k]), points.get(after)) {
            (Some(a), Some(b)) => a.torque_nm + (b.torque_nm - a.torque_nm) * (rpm - a.rpm) / (b.rpm - a.rpm),
            (None, Some(first)) => first.torque_nm,
            (Some(last), None) if rpm <= last.rpm => last.torque_nm,
            _ => 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Motor, TorquePoint};
    use super::*;

    #[test]
    fn torque_follows_its_curve_and_ends_with_it() {
        let motor = Motor {
            torque_curve: vec![
                TorquePoint { rpm: 1000.0, torque_nm: 100.0 },
                TorquePoint { rpm: 3000.0, torque_nm: 300.0 },
            ],
            ..VehicleSpec::default().motor
        };
        for (rpm, torque) in [(0.0, 100.0), (2000.0, 200.0), (3000.0, 300.0), (3001.0, 0.0)] {
            assert!((motor.torque_at(rpm) - torque).abs() < 1e-9, "{rpm}");
        }
    }

    #[test]
    fn limits_follow_from_the_build() {
        let car = VehicleSpec::default();
        assert!((car.min_turn_radius() - 3.0 / 0.5f64.sqrt()).abs() < 1e-9);
        // Plenty of brake: the tyres decide.
        assert!((car.max_braking() - car.tyre_friction * GRAVITY_MPS2).abs() < 1e-9);
        let weak = VehicleSpec { brake_torque_nm: 1600.0 * 0.34, ..car.clone() };
        assert!((weak.max_braking() - 1.0).abs() < 1e-9);
        assert!(car.max_acceleration_at(0.0) > 3.0 && car.max_acceleration_at(12.5) > 3.0);
        // A rear-driven car presses its driven wheels down as it goes.
        let strong = |drive| {
            let mut car = VehicleSpec { drive, ..car.clone() };
            car.motor.torque_curve.iter_mut().for_each(|point| point.torque_nm *= 10.0);
            car.max_acceleration_at(1.0)
        };
        assert!(strong(Drive::Front) < strong(Drive::Rear) && strong(Drive::Rear) < strong(Drive::All));
        assert!(car.max_acceleration_at(car.top_speed() + 1.0) < 0.0);
    }
}
