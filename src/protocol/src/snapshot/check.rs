//! Validation of vehicle specifications.

use super::{GRAVITY_MPS2, VehicleSpec};
use city3d_geometry::trig;
use std::f64::consts::{FRAC_PI_3, TAU};

/// An invalid value of a specification.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{field} is {found}; {remedy}")]
pub struct SpecError {
    /// Path of the field, as in a scenario file.
    pub field: String,
    /// The invalid value as text, or what is invalid about it.
    pub found: String,
    /// What would be right.
    pub remedy: String,
}

struct SpecErrors(Vec<SpecError>);

impl SpecErrors {
    fn add(&mut self, field: &str, found: impl std::fmt::Display, remedy: impl Into<String>) {
        self.0.push(SpecError { field: field.into(), found: found.to_string(), remedy: remedy.into() });
    }

    /// NaN is in no range.
    fn range(&mut self, field: &str, value: f64, low: f64, high: f64) {
        if !(low..=high).contains(&value) {
            self.add(field, value, format!("set it between {low} and {high}"));
        }
    }
}

impl VehicleSpec {
    /// All errors of the specification; empty if it is valid.
    pub fn validate(&self) -> Vec<SpecError> {
        let mut errors = SpecErrors(Vec::new());
        self.check_ranges(&mut errors);
        if errors.0.is_empty() {
            // These checks relate values and presume that each is valid.
            self.check_relations(&mut errors);
        }
        errors.0
    }

    fn check_ranges(&self, errors: &mut SpecErrors) {
        let d = &self.dimensions;
        let c = &self.control;
        for (field, value, low, high) in [
            ("dimensions.length_m", d.length_m, 0.5, 30.0),
            ("dimensions.width_m", d.width_m, 0.3, 5.0),
            ("dimensions.height_m", d.height_m, 0.3, 6.0),
            ("dimensions.wheelbase_m", d.wheelbase_m, 0.3, d.length_m.max(0.3)),
            ("dimensions.track_m", d.track_m, 0.2, d.width_m.max(0.2)),
            ("dimensions.wheel_radius_m", d.wheel_radius_m, 0.05, 1.0),
            ("mass_kg", self.mass_kg, 10.0, 60_000.0),
            ("yaw_inertia_factor", self.yaw_inertia_factor, 0.3, 3.0),
            ("centre_of_mass.height_m", self.centre_of_mass.height_m, 0.05, 3.0),
            ("motor.gear_ratio", self.motor.gear_ratio, 0.1, 100.0),
            ("motor.max_power_w", self.motor.max_power_w, 100.0, 5e6),
            ("brake_torque_nm", self.brake_torque_nm, 1.0, 1e6),
            ("handbrake_torque_nm", self.handbrake_torque_nm, 0.0, 1e6),
            ("steering_limit_rad", self.steering_limit_rad, 0.05, FRAC_PI_3),
            ("steering_rate_radps", self.steering_rate_radps, 0.05, 20.0),
            ("suspension.rest_length_m", self.suspension.rest_length_m, 0.02, 2.0),
            ("suspension.frequency_hz", self.suspension.frequency_hz, 0.5, 5.0),
            ("suspension.damping_ratio", self.suspension.damping_ratio, 0.05, 2.0),
            ("tyre_friction", self.tyre_friction, 0.01, 3.0),
            ("tyre_cornering", self.tyre_cornering, 2.0, 60.0),
            ("drag_area_m2", self.drag_area_m2, 0.0, 20.0),
            ("rolling_resistance", self.rolling_resistance, 0.0, 0.2),
            ("control.k_e", c.k_e, 0.0, 50.0),
            ("control.k_s", c.k_s, 0.01, 50.0),
            ("control.k_a", c.k_a, -1.0, 0.0),
            ("control.k_y", c.k_y, 0.0, 2.0),
            ("control.speed_p", c.speed_p, 0.0, 50.0),
            ("control.speed_i", c.speed_i, 0.0, 50.0),
            ("control.speed_d", c.speed_d, 0.0, 50.0),
        ] {
            errors.range(field, value, low, high);
        }
        let arm = d.wheelbase_m * 0.45;
        errors.range("centre_of_mass.ahead_m", self.centre_of_mass.ahead_m, -arm, arm);
        self.check_torque_curve(errors);
    }

    fn check_torque_curve(&self, errors: &mut SpecErrors) {
        const FIELD: &str = "motor.torque_curve";
        let points = &self.motor.torque_curve;
        if points.len() < 2 {
            errors.add(FIELD, format!("{} points", points.len()), "give at least two");
        }
        for (k, point) in points.iter().enumerate() {
            errors.range(&format!("{FIELD}[{k}].rpm"), point.rpm, 0.0, 50_000.0);
            errors.range(&format!("{FIELD}[{k}].torque_nm"), point.torque_nm, 0.0, 20_000.0);
        }
        if let Some(k) = points.windows(2).position(|pair| pair[1].rpm <= pair[0].rpm) {
            let found = format!("{} after {}", points[k + 1].rpm, points[k].rpm);
            errors.add(&format!("{FIELD}[{}].rpm", k + 1), found, "put the points in order of speed");
        }
        if points.iter().all(|point| point.torque_nm <= 0.0) {
            errors.add(FIELD, "without torque", "give the motor a torque above 0");
        }
    }

    fn check_relations(&self, errors: &mut SpecErrors) {
        let d = &self.dimensions;
        // At this angle the inner front wheel would turn by a right angle.
        let widest = 2.0 * d.wheelbase_m / trig::tan(self.steering_limit_rad);
        if d.track_m > 0.9 * widest {
            let limit = trig::atan(0.9 * 2.0 * d.wheelbase_m / d.track_m);
            errors.add(
                "steering_limit_rad",
                self.steering_limit_rad,
                format!("a track of {} m on this wheelbase allows {limit:.3}", d.track_m),
            );
        }
        let heave = self.suspension.frequency_hz * TAU;
        let sag = GRAVITY_MPS2 / (heave * heave);
        if self.suspension.rest_length_m < 1.2 * sag {
            errors.add(
                "suspension.rest_length_m",
                self.suspension.rest_length_m,
                format!(
                    "at {} Hz the body sinks {sag:.3} m: at least {:.3}",
                    self.suspension.frequency_hz,
                    1.2 * sag
                ),
            );
        }
        // Beyond it the vehicle tips over before its tyres slip.
        let tipping = d.track_m / (2.0 * self.tyre_friction);
        if self.centre_of_mass.height_m > tipping {
            errors.add(
                "centre_of_mass.height_m",
                self.centre_of_mass.height_m,
                format!("with this track and tyre friction it tips over above {tipping:.2}"),
            );
        }
        let standing = self.max_acceleration_at(0.0);
        if standing < 0.1 {
            errors.add(
                "motor",
                format!("{standing:.3} m/s2 at full gas from standing"),
                "more torque, a shorter gear or less rolling resistance has to give at least 0.1",
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Drive, TorquePoint};
    use super::*;

    fn fields(change: impl FnOnce(&mut VehicleSpec)) -> Vec<String> {
        let mut spec = VehicleSpec::default();
        change(&mut spec);
        spec.validate().into_iter().map(|error| error.field).collect()
    }

    #[test]
    fn sensible_cars_pass() {
        assert_eq!(VehicleSpec::default().validate(), []);
        assert!(fields(|s| s.steering_limit_rad = 20f64.to_radians()).is_empty());
        assert!(fields(|s| s.tyre_friction = 0.3).is_empty());
        assert!(fields(|s| s.drive = Drive::All).is_empty());
    }

    #[test]
    fn each_fault_names_its_field() {
        assert_eq!(fields(|s| s.mass_kg = -3.0), ["mass_kg"]);
        assert_eq!(fields(|s| s.mass_kg = f64::NAN), ["mass_kg"]);
        assert_eq!(fields(|s| s.dimensions.wheelbase_m = 9.0), ["dimensions.wheelbase_m"]);
        assert_eq!(fields(|s| s.centre_of_mass.height_m = 2.5), ["centre_of_mass.height_m"]);
        assert_eq!(fields(|s| s.suspension.rest_length_m = 0.1), ["suspension.rest_length_m"]);
        assert_eq!(fields(|s| s.steering_limit_rad = 1.04), Vec::<String>::new());
        assert_eq!(
            fields(|s| {
                s.steering_limit_rad = 1.04;
                s.dimensions.track_m = 2.4;
                s.dimensions.wheelbase_m = 2.0;
            }),
            ["steering_limit_rad"]
        );
        assert_eq!(fields(|s| s.motor.torque_curve.clear())[0], "motor.torque_curve");
        assert_eq!(
            fields(|s| s.motor.torque_curve.push(TorquePoint { rpm: 10.0, torque_nm: 5.0 })),
            ["motor.torque_curve[2].rpm"]
        );
        assert_eq!(fields(|s| s.motor.torque_curve[0].torque_nm = 0.0), ["motor"]);
        let message = VehicleSpec { mass_kg: 0.0, ..VehicleSpec::default() }.validate()[0].to_string();
        assert_eq!(message, "mass_kg is 0; set it between 10 and 60000");
    }
}
