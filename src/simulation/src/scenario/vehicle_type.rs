//! `[vehicle_type.NAME]`: vehicle specifications and sensors. Full-scale SI units, angles in degrees.

use super::experiment::Rates;
use super::fields::TableFields;
use super::read_sensors::read_sensors;
use city3d_dynamics::vehicle::{Drive, ModelKind, TorquePoint, VehicleSpec};
use city3d_sensors::Sensor;

/// Dynamics models by their names in scenarios.
pub const MODELS: [(&str, ModelKind); 2] = [("raycast", ModelKind::Raycast), ("bicycle", ModelKind::Bicycle)];
const DRIVES: [(&str, Drive); 3] = [("front", Drive::Front), ("rear", Drive::Rear), ("all", Drive::All)];

/// A vehicle specification with its default sensors.
#[derive(Clone, Debug, Default)]
pub struct VehicleType {
    /// Build and tracking control, full scale.
    pub spec: VehicleSpec,
    /// Sensors of vehicles that state none themselves.
    pub sensors: Vec<Sensor>,
}

/// Reads a vehicle type; missing fields are those of the default car.
pub fn read_vehicle_type(fields: TableFields<'_, '_>, rates: Rates) -> VehicleType {
    let sensors = read_sensors(&fields, rates).unwrap_or_default();
    let mut spec = VehicleSpec::default();
    fields.choice("model", &MODELS, &mut spec.model);
    fields.choice("drive", &DRIVES, &mut spec.drive);
    fields.number("mass_kg", 100.0..=40_000.0, &mut spec.mass_kg);
    fields.number("yaw_inertia_factor", 0.2..=5.0, &mut spec.yaw_inertia_factor);
    fields.number("brake_torque_nm", 10.0..=200_000.0, &mut spec.brake_torque_nm);
    fields.number("handbrake_torque_nm", 0.0..=200_000.0, &mut spec.handbrake_torque_nm);
    fields.number("tyre_friction", 0.01..=3.0, &mut spec.tyre_friction);
    fields.number("tyre_cornering", 2.0..=60.0, &mut spec.tyre_cornering);
    fields.number("drag_area_m2", 0.0..=20.0, &mut spec.drag_area_m2);
    fields.number("rolling_resistance", 0.0..=0.5, &mut spec.rolling_resistance);
    degrees(&fields, "steering_limit_deg", 3.0..=60.0, &mut spec.steering_limit_rad);
    degrees(&fields, "steering_rate_deg_per_s", 3.0..=1000.0, &mut spec.steering_rate_radps);
    let size = &mut spec.dimensions;
    fields.number("length_m", 1.0..=25.0, &mut size.length_m);
    fields.number("width_m", 0.5..=5.0, &mut size.width_m);
    fields.number("height_m", 0.5..=5.0, &mut size.height_m);
    fields.number("wheelbase_m", 0.5..=20.0, &mut size.wheelbase_m);
    fields.number("track_m", 0.3..=4.5, &mut size.track_m);
    fields.number("wheel_radius_m", 0.1..=1.0, &mut size.wheel_radius_m);
    if let Some(centre) = fields.table("centre_of_mass") {
        centre.number("height_m", 0.05..=3.0, &mut spec.centre_of_mass.height_m);
        centre.number("ahead_m", -5.0..=5.0, &mut spec.centre_of_mass.ahead_m);
        centre.finish();
    }
    if let Some(motor) = fields.table("motor") {
        motor.number("gear_ratio", 0.1..=100.0, &mut spec.motor.gear_ratio);
        motor.number("max_power_w", 100.0..=2e6, &mut spec.motor.max_power_w);
        if let Some(curve) = motor.pairs("torque_curve") {
            spec.motor.torque_curve =
                curve.iter().map(|&[rpm, torque_nm]| TorquePoint { rpm, torque_nm }).collect();
        }
        motor.finish();
    }
    if let Some(suspension) = fields.table("suspension") {
        suspension.number("rest_length_m", 0.05..=2.0, &mut spec.suspension.rest_length_m);
        suspension.number("frequency_hz", 0.3..=10.0, &mut spec.suspension.frequency_hz);
        suspension.number("damping_ratio", 0.05..=3.0, &mut spec.suspension.damping_ratio);
        suspension.finish();
    }
    if let Some(control) = fields.table("control") {
        let gains = &mut spec.control;
        control.number("k_e", 0.0..=100.0, &mut gains.k_e);
        control.number("k_s", 0.001..=100.0, &mut gains.k_s);
        control.number("k_a", -1.0..=1.0, &mut gains.k_a);
        control.number("k_y", -5.0..=5.0, &mut gains.k_y);
        control.number("speed_p", 0.0..=100.0, &mut gains.speed_p);
        control.number("speed_i", 0.0..=100.0, &mut gains.speed_i);
        control.number("speed_d", 0.0..=100.0, &mut gains.speed_d);
        control.finish();
    }
    for error in spec.validate() {
        // Scenario names of the fields: dimensions without a table, angles in degrees.
        let field = error.field.strip_prefix("dimensions.").unwrap_or(&error.field);
        let path = field.split('.').map(|part| match part.split('[').next().unwrap_or(part) {
            "steering_limit_rad" => "steering_limit_deg",
            "steering_rate_radps" => "steering_rate_deg_per_s",
            key => key,
        });
        let message = format!("{field} is {}; {}", error.found, error.remedy);
        fields.problems.add(&fields.span_of_path(path), message);
    }
    fields.finish();
    VehicleType { spec, sensors }
}

fn degrees(
    fields: &TableFields<'_, '_>,
    key: &'static str,
    range: std::ops::RangeInclusive<f64>,
    into: &mut f64,
) {
    let mut value = into.to_degrees();
    fields.number(key, range, &mut value);
    *into = value.to_radians();
}
