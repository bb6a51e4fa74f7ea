//! Cooperative adaptive cruise control at constant time headway: the law of Ploeg et al. 2011 (Design and experimental
//! evaluation of cooperative adaptive cruise control, ITSC), with the values of Plexe.

/// Parameters of the law.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PloegGains {
    /// Gain k_p of the spacing error, 1/s^2.
    pub proportional: f64,
    /// Gain k_d of its rate, 1/s. Stable for k_d > k_p tau, with the lag tau of the drive.
    pub derivative: f64,
}

impl Default for PloegGains {
    fn default() -> Self {
        Self { proportional: 0.2, derivative: 0.7 }
    }
}

/// What the law is a function of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PloegInputs {
    /// Gap to the predecessor above the gap at standstill.
    pub distance_m: f64,
    /// Time headway h.
    pub headway_s: f64,
    /// Own speed.
    pub speed_mps: f64,
    /// Own acceleration.
    pub acceleration_mps2: f64,
    /// The own command of the step before, which is the state of the law.
    pub commanded_mps2: f64,
    /// Speed and commanded acceleration of the predecessor.
    pub predecessor: (f64, f64),
}

impl PloegGains {
    /// The commanded acceleration after a step of `step_s`, without bounds: `h u' = -u + k_p e + k_d e' + u_p` for the error
    /// `e = distance - h v`.
    ///
    /// The error is driven by nothing, and each member answers its predecessor by `1/(1 + h s)`: it is string stable for
    /// every headway as long as nothing is late.
    pub fn acceleration(&self, inputs: PloegInputs, step_s: f64) -> f64 {
        let (predecessor_mps, predecessor_mps2) = inputs.predecessor;
        let headway_s = inputs.headway_s.max(step_s);
        let error_m = inputs.distance_m - headway_s * inputs.speed_mps;
        let rate_mps = predecessor_mps - inputs.speed_mps - headway_s * inputs.acceleration_mps2;
        let target_mps2 = self.proportional * error_m + self.derivative * rate_mps + predecessor_mps2;
        inputs.commanded_mps2 + (target_mps2 - inputs.commanded_mps2) * step_s / headway_s
    }
}
