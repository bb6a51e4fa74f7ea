//! Cooperative adaptive cruise control (CACC) at constant spacing: the law of the California PATH platoons (Rajamani 2012,
//! Vehicle Dynamics and Control, eq. 7.39), with the values of Plexe (Segata et al. 2014).

/// Parameters of the law.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CaccGains {
    /// Weight C1 of the leader's motion against the predecessor's, 0 to 1.
    pub leader_weight: f64,
    /// Damping ratio xi of the spacing error, at least 1.
    pub damping: f64,
    /// Bandwidth omega_n of the spacing error. Plexe states 0.2 Hz and uses the number in rad/s, as here.
    pub bandwidth_rad_s: f64,
}

impl Default for CaccGains {
    fn default() -> Self {
        Self { leader_weight: 0.5, damping: 1.0, bandwidth_rad_s: 0.2 }
    }
}

/// What the law is a function of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CaccInputs {
    /// Gap to the predecessor above the constant spacing: negative where it is too near.
    pub spacing_error_m: f64,
    /// Own speed.
    pub speed_mps: f64,
    /// Speed and commanded acceleration of the predecessor.
    pub predecessor: (f64, f64),
    /// Speed and commanded acceleration of the leader of the platoon.
    pub leader: (f64, f64),
}

impl CaccGains {
    /// The commanded acceleration, without bounds.
    ///
    /// With the commands of predecessor and leader of the same instant the error decays as
    /// `1/(s^2 + 2 xi omega_n s + omega_n^2)` and is driven by nothing, so that every member moves exactly as the leader.
    pub fn acceleration(&self, inputs: CaccInputs) -> f64 {
        let Self { leader_weight: c1, damping: xi, bandwidth_rad_s: omega } = *self;
        let root = xi + (xi * xi - 1.0).max(0.0).sqrt();
        let (predecessor_mps, predecessor_mps2) = inputs.predecessor;
        let (leader_mps, leader_mps2) = inputs.leader;
        (1.0 - c1) * predecessor_mps2 + c1 * leader_mps2
            - (2.0 * xi - c1 * root) * omega * (inputs.speed_mps - predecessor_mps)
            - c1 * root * omega * (inputs.speed_mps - leader_mps)
            + omega * omega * inputs.spacing_error_m
    }
}
