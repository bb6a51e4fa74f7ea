//! Ackermann steering geometry, steering-rate limit and wheel rotation of all dynamics models.

use super::{ModelKind, VehicleSpec, raycast};
use city3d_geometry::trig;
use city3d_protocol::snapshot::VehicleState;
use glam::DVec2;

/// Steering angle after one step towards the desired one, within rate and limit.
pub(super) fn steered(spec: &VehicleSpec, actual_rad: f64, desired_rad: f64, dt_s: f64) -> f64 {
    let limit = spec.steering_limit_rad;
    // NaN holds the steering angle.
    let desired = if desired_rad.is_nan() { actual_rad } else { desired_rad };
    let step = spec.steering_rate_radps * dt_s;
    (actual_rad + (desired.clamp(-limit, limit) - actual_rad).clamp(-step, step)).clamp(-limit, limit)
}

/// Ackermann steering: all wheels roll about one point on the rear axle's line.
#[derive(Clone, Copy, Debug)]
pub(super) struct AckermannSteering {
    /// Directions of the left and right front wheel, body frame.
    pub headings: [DVec2; 2],
    /// Tangent of the steering angle.
    tangent: f64,
}

impl AckermannSteering {
    /// At a steering angle of the front axle's middle.
    pub(super) fn at(spec: &VehicleSpec, axle_rad: f64) -> Self {
        let tangent = trig::tan(axle_rad);
        let narrowing = tangent * spec.dimensions.track_m / (2.0 * spec.dimensions.wheelbase_m);
        let direction = |along: f64| DVec2::new(along, tangent).normalize_or(DVec2::X);
        Self { headings: [1.0 - narrowing, 1.0 + narrowing].map(direction), tangent }
    }

    /// The directions as angles, left-positive.
    pub(super) fn wheel_angles_rad(&self) -> [f64; 2] {
        self.headings.map(|heading| trig::atan2(heading.y, heading.x))
    }

    /// Of a vehicle without tyre slip, at the speed of its rear axle.
    pub(super) fn yaw_rate_radps(&self, spec: &VehicleSpec, speed_mps: f64) -> f64 {
        speed_mps * self.tangent / spec.dimensions.wheelbase_m
    }
}

/// Sets wheel angles and suspension travel of a state from its steering angle and its pose on flat ground:
/// for states that lack them, such as those of logs.
pub fn set_wheels(spec: &VehicleSpec, state: &mut VehicleState) {
    let [left, right] = AckermannSteering::at(spec, state.steering_rad).wheel_angles_rad();
    (state.wheels[0].steer_rad, state.wheels[1].steer_rad) = (left, right);
    if spec.model == ModelKind::Raycast {
        let lifts = raycast::lifts_m(spec, state.position, state.orientation);
        state.wheels.iter_mut().zip(lifts).for_each(|(wheel, lift_m)| wheel.lift_m = lift_m);
    }
}

/// Clamps a pedal value; NaN is zero.
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
            let [left, right] = AckermannSteering::at(&spec, axle).wheel_angles_rad();
            let centre = d.wheelbase_m / trig::tan(axle);
            assert!((d.wheelbase_m / trig::tan(left) + d.track_m / 2.0 - centre).abs() < 1e-9);
            assert!((d.wheelbase_m / trig::tan(right) - d.track_m / 2.0 - centre).abs() < 1e-9);
        }
        assert_eq!(AckermannSteering::at(&spec, 0.0).wheel_angles_rad(), [0.0, 0.0]);
    }
}
