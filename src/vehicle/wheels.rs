//! Steering gear and wheels, which both models share.

use super::{ModelKind, VehicleSpec, raycast};
use crate::geom::trig;
use crate::snapshot::VehicleState;
use glam::DVec2;

/// The front axle's angle one step on: towards the desired one, at no more than the steering rate,
/// inside the limit.
pub(super) fn steered(spec: &VehicleSpec, actual_rad: f64, desired_rad: f64, dt_s: f64) -> f64 {
    let limit = spec.steering_limit_rad;
    // A desired angle that is not a number leaves the wheels where they are.
    let desired = if desired_rad.is_nan() { actual_rad } else { desired_rad };
    let step = spec.steering_rate_radps * dt_s;
    (actual_rad + (desired.clamp(-limit, limit) - actual_rad).clamp(-step, step)).clamp(-limit, limit)
}

/// Directions of the left and right front wheel, body frame, when the axle's middle turns by
/// `axle_rad`: all wheels roll about one point on the rear axle's line (Ackermann).
pub(super) fn front_headings(spec: &VehicleSpec, axle_rad: f64) -> [DVec2; 2] {
    let tangent = trig::tan(axle_rad);
    let narrowing = tangent * spec.dimensions.track_m / (2.0 * spec.dimensions.wheelbase_m);
    [1.0 - narrowing, 1.0 + narrowing].map(|along| DVec2::new(along, tangent).normalize_or(DVec2::X))
}

/// The angle of a direction of the body frame, left-positive.
pub(super) fn angle_of(heading: DVec2) -> f64 {
    trig::atan2(heading.y, heading.x)
}

/// Steers and lifts the wheels of a state as its steering angle and its pose on flat ground have them: for states
/// that tell these alone, as those of logs do.
pub fn set_wheels(spec: &VehicleSpec, state: &mut VehicleState) {
    let [left, right] = front_headings(spec, state.steering_rad).map(angle_of);
    (state.wheels[0].steer_rad, state.wheels[1].steer_rad) = (left, right);
    if spec.model == ModelKind::Raycast {
        let lifts = raycast::lifts_m(spec, state.position, state.orientation);
        state.wheels.iter_mut().zip(lifts).for_each(|(wheel, lift_m)| wheel.lift_m = lift_m);
    }
}

/// A pedal's value, whatever came in.
pub(super) fn pedal(value: f64) -> f64 {
    if value.is_nan() { 0.0 } else { value.clamp(0.0, 1.0) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steering_keeps_its_rate_and_limit() {
        let spec = VehicleSpec::default();
        assert!((steered(&spec, 0.0, 5.0, 0.01) - spec.steering_rate_radps * 0.01).abs() < 1e-12);
        assert_eq!(steered(&spec, 0.1, f64::NAN, 0.01), 0.1);
        let mut angle = 0.0;
        for _ in 0..1000 {
            angle = steered(&spec, angle, -5.0, 0.01);
        }
        assert_eq!(angle, -spec.steering_limit_rad);
    }

    #[test]
    fn both_front_wheels_turn_about_one_point() {
        let spec = VehicleSpec::default();
        let d = spec.dimensions;
        for axle in [-0.7, -0.1, 0.2, 0.7] {
            let [left, right] = front_headings(&spec, axle).map(angle_of);
            let centre = d.wheelbase_m / trig::tan(axle);
            assert!((d.wheelbase_m / trig::tan(left) + d.track_m / 2.0 - centre).abs() < 1e-9);
            assert!((d.wheelbase_m / trig::tan(right) - d.track_m / 2.0 - centre).abs() < 1e-9);
        }
        assert_eq!(front_headings(&spec, 0.0).map(angle_of), [0.0, 0.0]);
    }
}
