//! Longitudinal control algorithms of one vehicle, by name.

use super::{DriverParams, LeaderState};
use std::fmt::Debug;

/// Longitudinal controller: decides the acceleration along the path.
pub trait Controller: Debug + Send {
    /// Acceleration along the path, laboratory m/s2, for an allowed speed `desired_mps` and one leader (or a
    /// free road). Of several leaders the least acceleration applies.
    fn acceleration(&self, own: OwnMotion, desired_mps: f64, ahead: Option<LeaderState>) -> f64;
}

/// Own motion of the vehicle, laboratory metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OwnMotion {
    /// Speed of the plan.
    pub planned_mps: f64,
    /// As estimated from measured poses.
    pub measured_mps: f64,
    /// Safety margin on measured distances.
    pub margin_m: f64,
}

/// Name of the algorithm that ignores leaders.
pub const CRUISE: &str = "cruise";
/// Names of all control algorithms.
pub const CONTROLLERS: [&str; 2] = ["idm", CRUISE];

/// Creates a control algorithm by name; `None` for an unknown one.
///
/// `idm`: intelligent driver model within the safe speed of Gipps. `cruise`: constant speed whatever is
/// ahead.
pub fn controller(name: &str, params: DriverParams) -> Option<Box<dyn Controller>> {
    match name {
        "idm" => Some(Box::new(Idm(params))),
        CRUISE => Some(Box::new(Cruise(params))),
        _ => None,
    }
}

/// IDM below Gipps' safe speed.
#[derive(Debug)]
struct Idm(DriverParams);

impl Controller for Idm {
    fn acceleration(&self, own: OwnMotion, desired_mps: f64, ahead: Option<LeaderState>) -> f64 {
        let Some(ahead) = ahead else { return self.0.acceleration(own.planned_mps, desired_mps, None) };
        // A lagging vehicle is faster than its braking plan.
        let speed_mps = own.planned_mps.max(own.measured_mps);
        let comfortable = self.0.acceleration(speed_mps, desired_mps, Some(ahead));
        comfortable.min(self.0.safe_acceleration(own.measured_mps, ahead, own.margin_m))
    }
}

#[derive(Debug)]
struct Cruise(DriverParams);

impl Controller for Cruise {
    fn acceleration(&self, own: OwnMotion, desired_mps: f64, _ahead: Option<LeaderState>) -> f64 {
        self.0.acceleration(own.planned_mps, desired_mps, None)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_name_has_its_algorithm_and_no_other() {
        for name in CONTROLLERS {
            assert!(controller(name, DriverParams::default()).is_some(), "{name}");
        }
        assert!(controller("IDM2", DriverParams::default()).is_none());
    }

    #[test]
    fn cruise_does_not_see_what_idm_brakes_for() {
        let wall = Some(LeaderState { gap_m: 0.05, speed_mps: 0.0 });
        let own = OwnMotion { planned_mps: 0.2, measured_mps: 0.2, margin_m: 0.0 };
        let u = |name| controller(name, DriverParams::default()).unwrap().acceleration(own, 0.35, wall);
        assert_eq!(u("idm"), -0.2);
        assert!(u("cruise") > 0.0);
    }
}
