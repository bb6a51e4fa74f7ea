//! Control algorithms of one vehicle, by name.

use super::{Ahead, DriverParams};
use std::fmt::Debug;

/// Decides how one vehicle accelerates along its path.
pub trait Controller: Debug + Send {
    /// Acceleration along the path, laboratory m/s2: at `speed_mps`, where `desired_mps` is allowed,
    /// with respect to one thing ahead (or a free road). Of several things ahead the least
    /// acceleration counts.
    fn acceleration(&self, speed_mps: f64, desired_mps: f64, ahead: Option<Ahead>) -> f64;
}

/// The names that [`controller`] knows.
pub const CONTROLLERS: [&str; 2] = ["idm", "cruise"];

/// The control algorithm of a name, or `None` where there is none of that name.
///
/// `idm` follows the driver model. `cruise` holds the desired speed whatever is ahead: a
/// vehicle that others have to look out for.
pub fn controller(name: &str, params: DriverParams) -> Option<Box<dyn Controller>> {
    match name {
        "idm" => Some(Box::new(Idm(params))),
        "cruise" => Some(Box::new(Cruise(params))),
        _ => None,
    }
}

#[derive(Debug)]
struct Idm(DriverParams);

impl Controller for Idm {
    fn acceleration(&self, speed_mps: f64, desired_mps: f64, ahead: Option<Ahead>) -> f64 {
        self.0.acceleration(speed_mps, desired_mps, ahead)
    }
}

#[derive(Debug)]
struct Cruise(DriverParams);

impl Controller for Cruise {
    fn acceleration(&self, speed_mps: f64, desired_mps: f64, _ahead: Option<Ahead>) -> f64 {
        self.0.acceleration(speed_mps, desired_mps, None)
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
        let u = |name| controller(name, DriverParams::default()).unwrap().acceleration(0.2, 0.35, wall);
        assert_eq!(u("idm"), -0.2);
        assert!(u("cruise") > 0.0);
    }
}
