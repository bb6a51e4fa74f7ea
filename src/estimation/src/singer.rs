//! Motion models: transitions and covariances of one scalar coordinate (Singer model, white angular
//! acceleration).

use city3d_geometry::trig;
use serde::{Deserialize, Serialize};

/// Longer steps are split: within one, process noise is its first-order term.
const LONGEST_STEP_S: f64 = 0.05;
/// Largest number of parts.
const MOST_PARTS: f64 = 40.0;

/// Splits a time step into equal parts: number and length.
pub(super) fn parts(dt_s: f64) -> (u32, f64) {
    let count = (dt_s.abs() / LONGEST_STEP_S).ceil().clamp(1.0, MOST_PARTS);
    (count as u32, dt_s / count)
}

/// Transition of the Singer model over one step: acceleration is a first-order Gauss-Markov process (Singer,
/// "Estimating optimal tracking filter performance for manned maneuvering targets", IEEE Trans. AES 6, 1970).
#[derive(Clone, Copy, Debug)]
pub(super) struct SingerTransition {
    /// Length of the step, seconds; negative backwards.
    pub dt_s: f64,
    /// Contribution of an acceleration to position and velocity, and its remaining share.
    pub position_s2: f64,
    /// Velocity that an initial acceleration of 1 adds.
    pub velocity_s: f64,
    /// Share of the initial acceleration that is left.
    pub remains: f64,
    /// Spectral density of the white jerk that drives it, m2/s5.
    density: f64,
}

impl SingerTransition {
    /// The transition over `dt_s`, for a standard deviation and a correlation time of accelerations.
    pub fn new(dt_s: f64, acceleration_std_mps2: f64, time_s: f64) -> Self {
        let remains = trig::exp(-dt_s / time_s);
        let velocity_s = time_s * (1.0 - remains);
        Self {
            dt_s,
            position_s2: time_s * (dt_s - velocity_s),
            velocity_s,
            remains,
            density: 2.0 * acceleration_std_mps2 * acceleration_std_mps2 / time_s,
        }
    }
}

/// Covariance of position, velocity and acceleration along one axis.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(super) struct Covariance3 {
    /// Variance of the position.
    pub pp: f64,
    /// Covariance of position and velocity.
    pub pv: f64,
    /// Covariance of position and acceleration.
    pub pa: f64,
    /// Variance of the velocity.
    pub vv: f64,
    /// Covariance of velocity and acceleration.
    pub va: f64,
    /// Variance of the acceleration.
    pub aa: f64,
}

/// Kalman gains of a measured position.
#[derive(Clone, Copy, Debug)]
pub(super) struct Gain3 {
    /// Of the position.
    pub p: f64,
    /// Of the velocity, 1/s.
    pub v: f64,
    /// Of the acceleration, 1/s2.
    pub a: f64,
}

impl Covariance3 {
    /// Diagonal covariance.
    pub fn diagonal(pp: f64, vv: f64, aa: f64) -> Self {
        Self { pp, pv: 0.0, pa: 0.0, vv, va: 0.0, aa }
    }

    /// Prediction: `F P F' + Q` of one step.
    #[must_use]
    pub fn after(&self, step: &SingerTransition) -> Self {
        let SingerTransition { dt_s: t, position_s2: f, velocity_s: g, remains: r, density } = *step;
        // Rows of F P.
        let (pp, pv, pa) = (
            self.pp + t * self.pv + f * self.pa,
            self.pv + t * self.vv + f * self.va,
            self.pa + t * self.va + f * self.aa,
        );
        let (vv, va) = (self.vv + g * self.va, self.va + g * self.aa);
        let (t, q) = (t.abs(), density);
        Self {
            pp: pp + step.dt_s * pv + f * pa + q * trig::powi(t, 5) / 20.0,
            pv: pv + g * pa + q * trig::powi(t, 4) / 8.0,
            pa: r * pa + q * trig::powi(t, 3) / 6.0,
            vv: vv + g * va + q * trig::powi(t, 3) / 3.0,
            va: r * va + q * t * t / 2.0,
            aa: r * r * self.aa + q * t,
        }
    }

    /// Correction by a measured position of this variance.
    #[must_use]
    pub fn measured(&self, variance: f64) -> (Self, Gain3) {
        let total = self.pp + variance;
        let gain = Gain3 { p: self.pp / total, v: self.pv / total, a: self.pa / total };
        let left = variance / total;
        let after = Self {
            pp: self.pp * left,
            pv: self.pv * left,
            pa: self.pa * left,
            vv: self.vv - gain.v * self.pv,
            va: self.va - gain.v * self.pa,
            aa: self.aa - gain.a * self.pa,
        };
        (after, gain)
    }
}

/// Symmetric information matrix of the backward pass, over position, velocity and acceleration.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Information3 {
    /// About the position.
    pub pp: f64,
    /// Common term of position and velocity.
    pub pv: f64,
    /// Common term of position and acceleration.
    pub pa: f64,
    /// About the velocity.
    pub vv: f64,
    /// Common term of velocity and acceleration.
    pub va: f64,
    /// About the acceleration.
    pub aa: f64,
}

impl Information3 {
    /// `F' L F` of one step backwards.
    #[must_use]
    pub fn before(&self, step: &SingerTransition) -> Self {
        let SingerTransition { dt_s: t, position_s2: f, velocity_s: g, remains: r, .. } = *step;
        // Columns of L F.
        let (pv, vv) = (self.pp * t + self.pv, self.pv * t + self.vv);
        let (pa, va, aa) = (
            self.pp * f + self.pv * g + self.pa * r,
            self.pv * f + self.vv * g + self.va * r,
            self.pa * f + self.va * g + self.aa * r,
        );
        Self { pp: self.pp, pv, pa, vv: t * pv + vv, va: t * pa + va, aa: f * pa + g * va + r * aa }
    }

    /// `H' H / S + (I - K H)' L (I - K H)` of a measured position with innovation variance `S`.
    #[must_use]
    pub fn with(&self, gain: Gain3, innovation: f64) -> Self {
        let left = 1.0 - gain.p;
        // Row p of L (I - K H), then the product from the other side.
        let pp = self.pp * left - self.pv * gain.v - self.pa * gain.a;
        let vp = self.pv * left - self.vv * gain.v - self.va * gain.a;
        let ap = self.pa * left - self.va * gain.v - self.aa * gain.a;
        Self { pp: left * pp - gain.v * vp - gain.a * ap + 1.0 / innovation, pv: vp, pa: ap, ..*self }
    }
}

impl Covariance3 {
    /// Diagonal of `P - P L P`: variances given all later poses.
    pub fn smoothed(&self, later: &Information3) -> [f64; 3] {
        let left = |p: f64, v: f64, a: f64, own: f64| {
            let along = p * (later.pp * p + later.pv * v + later.pa * a)
                + v * (later.pv * p + later.vv * v + later.va * a)
                + a * (later.pa * p + later.va * v + later.aa * a);
            (own - along).max(0.0)
        };
        [
            left(self.pp, self.pv, self.pa, self.pp),
            left(self.pv, self.vv, self.va, self.vv),
            left(self.pa, self.va, self.aa, self.aa),
        ]
    }
}

/// Covariance of an angle and its rate, driven by white angular acceleration.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(super) struct Covariance2 {
    /// Variance of the angle, rad2.
    pub pp: f64,
    /// Covariance of angle and rate, rad2/s.
    pub pv: f64,
    /// Variance of the rate, rad2/s2.
    pub vv: f64,
}

impl Covariance2 {
    /// Prediction: `F P F' + Q` over a time, for a spectral density of angular accelerations (rad2/s3).
    #[must_use]
    pub fn after(&self, dt_s: f64, density: f64) -> Self {
        let t = dt_s.abs();
        Self {
            pp: self.pp + 2.0 * dt_s * self.pv + dt_s * dt_s * self.vv + density * trig::powi(t, 3) / 3.0,
            pv: self.pv + dt_s * self.vv + density * dt_s * t / 2.0,
            vv: self.vv + density * t,
        }
    }

    /// Correction by a measured angle of this variance; also returns the gains of angle and rate.
    #[must_use]
    pub fn measured(&self, variance: f64) -> (Self, [f64; 2]) {
        let total = self.pp + variance;
        let gain = [self.pp / total, self.pv / total];
        let left = variance / total;
        (Self { pp: self.pp * left, pv: self.pv * left, vv: self.vv - gain[1] * self.pv }, gain)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_acceleration_moves_as_in_closed_form() {
        // Of a(t) = exp(-t / 0.5): its first and second integrals.
        let step = SingerTransition::new(0.05, 0.15, 0.5);
        let exp = 0.904_837_418_035_959_6;
        assert!((step.remains - exp).abs() < 1e-15);
        assert!((step.velocity_s - 0.5 * (1.0 - exp)).abs() < 1e-15);
        assert!((step.position_s2 - (0.25 * (0.1 - 1.0 + exp))).abs() < 1e-15);
    }

    #[test]
    fn the_spread_of_accelerations_stays_that_of_the_model() {
        let mut covariance = Covariance3::diagonal(0.0, 0.0, 0.0);
        let step = SingerTransition::new(0.01, 0.15, 0.5);
        for _ in 0..1000 {
            covariance = covariance.after(&step);
        }
        assert!((covariance.aa.sqrt() - 0.15).abs() < 0.003, "{}", covariance.aa.sqrt());
    }

    #[test]
    fn long_steps_are_taken_in_parts() {
        assert_eq!(parts(0.01), (1, 0.01));
        assert_eq!(parts(0.2), (4, 0.05));
        let (count, part_s) = parts(10.0);
        assert_eq!((count, part_s), (40, 0.25));
        assert_eq!(parts(-0.02), (1, -0.02));
    }
}
