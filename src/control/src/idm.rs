//! Intelligent driver model (IDM; the paper, eq. 9-10; Treiber, Hennecke and Helbing 2000) with the bounds of
//! the double-integrator plan model (eq. 7-8) and the safe speed of Gipps 1981.

use city3d_geometry::trig;
use serde::{Deserialize, Serialize};

/// IDM parameters of a driver, laboratory units.
///
/// ```
/// use city3d_control::{DriverParams, LeaderState};
///
/// let driver = DriverParams::default();
/// // No acceleration at the desired speed on a free road, and hard braking towards an obstacle.
/// assert_eq!(driver.acceleration(0.35, 0.35, None), 0.0);
/// let obstacle = LeaderState { gap_m: 0.1, speed_mps: 0.0 };
/// assert_eq!(driver.acceleration(0.35, 0.35, Some(obstacle)), driver.min_acceleration_mps2);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DriverParams {
    /// Desired speed v_0 on a free road; posted limits and curve speeds may be lower.
    pub desired_speed_mps: f64,
    /// u_max of eq. 8 and `a` of the driver model, positive.
    pub max_acceleration_mps2: f64,
    /// u_min of eq. 8, negative.
    pub min_acceleration_mps2: f64,
    /// Desired time headway T.
    pub headway_s: f64,
    /// Bumper to bumper distance at standstill s_0.
    pub standstill_gap_m: f64,
    /// Exponent delta of the free-road term.
    pub exponent: f64,
    /// Comfortable lateral acceleration in bends.
    pub lateral_acceleration_mps2: f64,
    /// Response time tau: delay between a decision and the motion, of link and drive together. Safe speeds
    /// and stopping distances include it.
    pub response_time_s: f64,
    /// Amplitude of the speed of the driver `sinusoid`.
    #[serde(default)]
    pub amplitude_mps: f64,
    /// Frequency of the speed of the driver `sinusoid`.
    #[serde(default)]
    pub frequency_hz: f64,
}

impl Default for DriverParams {
    /// The usual target speed of the testbed, with accelerations that a full-scale tyre can provide.
    fn default() -> Self {
        Self {
            desired_speed_mps: 0.35,
            max_acceleration_mps2: 0.12,
            min_acceleration_mps2: -0.20,
            headway_s: 1.0,
            standstill_gap_m: 0.08,
            exponent: 4.0,
            lateral_acceleration_mps2: 0.12,
            response_time_s: 0.3,
            amplitude_mps: 0.0,
            frequency_hz: 0.0,
        }
    }
}

/// The leader of the car-following model: a vehicle or an obstacle ahead.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LeaderState {
    /// Gap from the own front bumper to its rear.
    pub gap_m: f64,
    /// Speed of the leader, laboratory m/s; 0 for an obstacle.
    pub speed_mps: f64,
}

/// Shortest time to correct a speed error: a control step and some margin.
const SHORTEST_RESPONSE_S: f64 = 0.05;
/// Smallest gap: the model divides by it.
const LEAST_GAP_M: f64 = 0.002;

impl DriverParams {
    /// IDM acceleration at `speed_mps` for a desired speed, clamped to [u_min, u_max].
    pub fn acceleration(&self, speed_mps: f64, desired_mps: f64, ahead: Option<LeaderState>) -> f64 {
        let u = self.wanted_acceleration(speed_mps, desired_mps, ahead);
        u.clamp(self.min_acceleration_mps2, self.max_acceleration_mps2)
    }

    /// IDM acceleration without bounds (eq. 9).
    pub fn wanted_acceleration(&self, speed_mps: f64, desired_mps: f64, ahead: Option<LeaderState>) -> f64 {
        let ratio = speed_mps / desired_mps.max(1e-6);
        let free = 1.0 - self.power(ratio);
        let interaction = ahead.map_or(0.0, |ahead| {
            let ratio = self.desired_gap(speed_mps, ahead.speed_mps) / ahead.gap_m.max(LEAST_GAP_M);
            ratio * ratio
        });
        self.max_acceleration_mps2 * (free - interaction)
    }

    /// Desired gap s* of eq. 10.
    pub fn desired_gap(&self, speed_mps: f64, leader_mps: f64) -> f64 {
        let comfort = 2.0 * (self.min_acceleration_mps2.abs() * self.max_acceleration_mps2).sqrt();
        let dynamic = speed_mps * self.headway_s + speed_mps * (speed_mps - leader_mps) / comfort;
        self.standstill_gap_m + dynamic.max(0.0)
    }

    /// Gipps safe speed: the highest speed from which the vehicle, after its response time, can brake by
    /// u_min and keep `margin_m` behind a leader that may brake as hard (Gipps 1981, eq. 2, with equal
    /// braking of both).
    pub fn safe_speed(&self, ahead: LeaderState, margin_m: f64) -> f64 {
        let braking = self.min_acceleration_mps2.abs();
        let lost = braking * self.response_time_s;
        let way_m = (ahead.gap_m - margin_m).max(0.0);
        let leader_mps = ahead.speed_mps.max(0.0);
        (lost * lost + 2.0 * braking * way_m + leader_mps * leader_mps).sqrt() - lost
    }

    /// Largest acceleration that stays below the safe speed; u_min above it.
    pub fn safe_acceleration(&self, speed_mps: f64, ahead: LeaderState, margin_m: f64) -> f64 {
        let u =
            (self.safe_speed(ahead, margin_m) - speed_mps) / self.response_time_s.max(SHORTEST_RESPONSE_S);
        if u < 0.0 { self.min_acceleration_mps2 } else { u.min(self.max_acceleration_mps2) }
    }

    /// Stopping distance at full braking, without the response time.
    pub fn stopping_distance(&self, speed_mps: f64) -> f64 {
        speed_mps * speed_mps / (2.0 * self.min_acceleration_mps2.abs())
    }

    /// The highest speed at the end of a step from which full braking stops within `distance_m` of where the step begins;
    /// 0 where none does.
    pub fn stopping_speed(&self, distance_m: f64, speed_mps: f64, step_s: f64) -> f64 {
        let braking_mps2 = -self.min_acceleration_mps2;
        // v^2 = 2 b (d - (v + v_0) T/2).
        let half = braking_mps2 * step_s / 2.0;
        let square = half * half + 2.0 * braking_mps2 * distance_m - 2.0 * half * speed_mps;
        if square > 0.0 { (square.sqrt() - half).max(0.0) } else { 0.0 }
    }

    fn power(&self, ratio: f64) -> f64 {
        if self.exponent == 4.0 {
            let square = ratio * ratio;
            return square * square;
        }
        trig::pow(ratio, self.exponent)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Treiber's road values, in which the model's published behaviour is known.
    fn treiber() -> DriverParams {
        DriverParams {
            desired_speed_mps: 120.0 / 3.6,
            max_acceleration_mps2: 0.73,
            min_acceleration_mps2: -1.67,
            headway_s: 1.6,
            standstill_gap_m: 2.0,
            exponent: 4.0,
            lateral_acceleration_mps2: 3.0,
            response_time_s: 0.0,
            ..DriverParams::default()
        }
    }

    #[test]
    fn free_road_and_equilibrium_are_those_of_the_publication() {
        let driver = treiber();
        assert_eq!(driver.acceleration(0.0, driver.desired_speed_mps, None), 0.73);
        assert!(driver.acceleration(driver.desired_speed_mps, driver.desired_speed_mps, None).abs() < 1e-12);
        // Equilibrium gap s_e(v) = (s0 + v T) / sqrt(1 - (v/v0)^4).
        let v = 20.0;
        let gap = (2.0 + v * 1.6) / (1.0 - trig::powi(v / driver.desired_speed_mps, 4)).sqrt();
        let u =
            driver.acceleration(v, driver.desired_speed_mps, Some(LeaderState { gap_m: gap, speed_mps: v }));
        assert!(u.abs() < 1e-12, "{u}");
    }

    #[test]
    fn both_bounds_hold() {
        let driver = treiber();
        let wall = LeaderState { gap_m: 1.0, speed_mps: 0.0 };
        assert_eq!(driver.acceleration(30.0, 33.0, Some(wall)), -1.67);
        assert_eq!(driver.acceleration(30.0, 5.0, None), -1.67);
        let leaving = LeaderState { gap_m: 100.0, speed_mps: 60.0 };
        assert!(driver.acceleration(1.0, 33.0, Some(leaving)) <= 0.73);
    }
}
