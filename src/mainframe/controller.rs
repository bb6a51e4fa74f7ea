//! Control algorithms of one vehicle, by name.

use super::{Ahead, DriverParams};
use std::fmt::Debug;

/// Decides how one vehicle accelerates along its path.
pub trait Controller: Debug + Send {
    /// Acceleration along the path, laboratory m/s2, where `desired_mps` is allowed, with respect to one thing
    /// ahead (or a free road). Of several things ahead the least acceleration counts.
    fn acceleration(&self, own: OwnMotion, desired_mps: f64, ahead: Option<Ahead>) -> f64;
}

/// The motion of the vehicle for which a controller decides, laboratory metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OwnMotion {
    /// Of the plan.
    pub planned_mps: f64,
    /// As estimated from measured poses.
    pub measured_mps: f64,
    /// By how much measured distances may be too long.
    pub margin_m: f64,
}

/// The control algorithm that holds its speed whatever is ahead.
pub const CRUISE: &str = "cruise";
/// The names that [`controller`] knows.
pub const CONTROLLERS: [&str; 2] = ["idm", CRUISE];

/// The control algorithm of a name, or `None` where there is none of that name.
///
/// `idm` follows the driver model within the safe speed of Gipps. `cruise` holds the desired speed whatever is ahead: a
/// vehicle that others have to look out for.
pub fn controller(name: &str, params: DriverParams) -> Option<Box<dyn Controller>> {
    match name {
        "idm" => Some(Box::new(Idm(params))),
        CRUISE => Some(Box::new(Cruise(params))),
        _ => None,
    }
}

#[derive(Debug)]
struct Idm(DriverParams);

impl Controller for Idm {
    fn acceleration(&self, own: OwnMotion, desired_mps: f64, ahead: Option<Ahead>) -> f64 {
        let Some(ahead) = ahead else { return self.0.acceleration(own.planned_mps, desired_mps, None) };
        // A vehicle that lags its plan while it brakes is faster than the plan.
        let speed_mps = own.planned_mps.max(own.measured_mps);
        let comfortable = self.0.acceleration(speed_mps, desired_mps, Some(ahead));
        comfortable.min(self.0.safe_acceleration(own.measured_mps, ahead, own.margin_m))
    }
}

#[derive(Debug)]
struct Cruise(DriverParams);

impl Controller for Cruise {
    fn acceleration(&self, own: OwnMotion, desired_mps: f64, _ahead: Option<Ahead>) -> f64 {
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
        let wall = Some(Ahead { gap_m: 0.05, speed_mps: 0.0 });
        let own = OwnMotion { planned_mps: 0.2, measured_mps: 0.2, margin_m: 0.0 };
        let u = |name| controller(name, DriverParams::default()).unwrap().acceleration(own, 0.35, wall);
        assert_eq!(u("idm"), -0.2);
        assert!(u("cruise") > 0.0);
    }
}
