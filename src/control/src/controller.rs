//! Longitudinal control algorithms of one vehicle, by name.

use super::cacc::{CaccGains, CaccInputs};
use super::ploeg::{PloegGains, PloegInputs};
use super::{DriverParams, LeaderState};
use city3d_geometry::trig;
use std::f64::consts::TAU;
use std::fmt::Debug;

/// Longitudinal controller: decides the acceleration along the path.
pub trait Controller: Debug + Send + Sync {
    /// Acceleration along the path, laboratory m/s2, for an allowed speed `desired_mps` and one leader (or a
    /// free road). Of several leaders the least acceleration applies.
    fn acceleration(&self, own: OwnMotion, desired_mps: f64, ahead: Option<LeaderState>) -> f64;

    /// Acceleration towards the end of the route, where the vehicle has to stand: the end is told as a leader at rest.
    fn acceleration_to_end(&self, own: OwnMotion, desired_mps: f64, end: LeaderState) -> f64 {
        self.acceleration(own, desired_mps, Some(end))
    }

    /// Acceleration of a member of a platoon behind its predecessor, in place of those on a free road and behind that
    /// vehicle. Bounds on speed, right of way and other leaders still apply.
    fn platoon_acceleration(&self, own: OwnMotion, desired_mps: f64, platoon: &PlatoonBroadcast) -> f64 {
        self.acceleration(own, desired_mps, Some(platoon.predecessor))
    }

    /// Whether its vehicle may be in a platoon.
    fn can_platoon(&self) -> bool {
        false
    }
}

/// Own motion of the vehicle, laboratory metres.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct OwnMotion {
    /// Speed of the plan.
    pub planned_mps: f64,
    /// Acceleration of the plan in the last control step.
    pub planned_mps2: f64,
    /// As estimated from measured poses.
    pub measured_mps: f64,
    /// Safety margin on measured distances.
    pub margin_m: f64,
    /// Duration of the last control step; 0 in the first one.
    pub step_s: f64,
    /// Time of the control step.
    pub now_s: f64,
}

/// What the other members of a platoon tell a member, laboratory metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlatoonBroadcast {
    /// Gap to the predecessor, and its speed.
    pub predecessor: LeaderState,
    /// Acceleration that is planned for the predecessor in this control step.
    pub predecessor_mps2: f64,
    /// Speed of the leader of the platoon.
    pub leader_mps: f64,
    /// Acceleration that is planned for the leader in this control step.
    pub leader_mps2: f64,
    /// Spacing for controllers that keep a constant one.
    pub spacing_m: f64,
    /// Time headway for controllers that keep a constant one.
    pub headway_s: f64,
}

/// Name of the algorithm that ignores leaders.
pub const CRUISE: &str = "cruise";
/// Name of the algorithm of a vehicle that stays where it is: an obstacle.
pub const PARKED: &str = "parked";
/// Names of all control algorithms.
pub const CONTROLLERS: [&str; 6] = ["idm", CRUISE, "cacc", "ploeg", "sinusoid", PARKED];

/// Whether a vehicle with this algorithm heeds nobody: neither leaders nor right of way.
pub fn heeds_nobody(name: &str) -> bool {
    matches!(name, CRUISE | PARKED)
}

/// Creates a control algorithm by name; `None` for an unknown one.
///
/// `idm`: intelligent driver model within the safe speed of Gipps. `cruise`: constant speed whatever is
/// ahead, up to the end of its route. `cacc`, `ploeg`: cooperative adaptive cruise control at constant spacing or time headway behind the predecessor
/// in a platoon, else as `idm`. `sinusoid`: a sinusoidal speed below the allowed one, as far as `idm` permits behind a leader.
/// `parked`: it stays where it is.
pub fn controller(name: &str, params: DriverParams) -> Option<Box<dyn Controller>> {
    match name {
        "idm" => Some(Box::new(Idm(params))),
        CRUISE => Some(Box::new(Cruise(params))),
        "cacc" => Some(Box::new(Cacc { alone: Idm(params), gains: CaccGains::default() })),
        "ploeg" => Some(Box::new(Ploeg { alone: Idm(params), gains: PloegGains::default() })),
        "sinusoid" => Some(Box::new(Sinusoid(Idm(params)))),
        PARKED => Some(Box::new(Parked(params))),
        _ => None,
    }
}

/// IDM below Gipps' safe speed.
#[derive(Debug)]
struct Idm(DriverParams);

/// Response time to a predecessor whose plan is known when it is made: the delays of link and drive are the same for both
/// vehicles.
const MEMBER_RESPONSE_S: f64 = 0.05;

impl Idm {
    /// Gipps' safe speed as the last word below what a platoon's controller wants.
    fn limit_member(&self, wanted_mps2: f64, own: OwnMotion, platoon: &PlatoonBroadcast) -> f64 {
        let params = DriverParams { response_time_s: MEMBER_RESPONSE_S, ..self.0 };
        let safe_mps2 = params.safe_acceleration(own.measured_mps, platoon.predecessor, own.margin_m);
        wanted_mps2.min(safe_mps2).clamp(params.min_acceleration_mps2, params.max_acceleration_mps2)
    }
}

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

    /// It heeds nobody, but beyond its route there is no way.
    fn acceleration_to_end(&self, own: OwnMotion, desired_mps: f64, end: LeaderState) -> f64 {
        Idm(self.0).acceleration(own, desired_mps, Some(end))
    }
}

/// Stands, and brakes to a stop if it does not.
#[derive(Debug)]
struct Parked(DriverParams);

impl Controller for Parked {
    fn acceleration(&self, own: OwnMotion, _desired_mps: f64, _ahead: Option<LeaderState>) -> f64 {
        if own.planned_mps > 0.0 { self.0.min_acceleration_mps2 } else { 0.0 }
    }
}

/// CACC at constant spacing in a platoon, IDM elsewhere.
#[derive(Debug)]
struct Cacc {
    alone: Idm,
    gains: CaccGains,
}

impl Controller for Cacc {
    fn acceleration(&self, own: OwnMotion, desired_mps: f64, ahead: Option<LeaderState>) -> f64 {
        self.alone.acceleration(own, desired_mps, ahead)
    }

    fn platoon_acceleration(&self, own: OwnMotion, _desired_mps: f64, platoon: &PlatoonBroadcast) -> f64 {
        let wanted_mps2 = self.gains.acceleration(CaccInputs {
            spacing_error_m: platoon.predecessor.gap_m - platoon.spacing_m,
            speed_mps: own.measured_mps,
            predecessor: (platoon.predecessor.speed_mps, platoon.predecessor_mps2),
            leader: (platoon.leader_mps, platoon.leader_mps2),
        });
        self.alone.limit_member(wanted_mps2, own, platoon)
    }

    fn can_platoon(&self) -> bool {
        true
    }
}

/// Ploeg's law in a platoon, IDM elsewhere.
#[derive(Debug)]
struct Ploeg {
    alone: Idm,
    gains: PloegGains,
}

impl Controller for Ploeg {
    fn acceleration(&self, own: OwnMotion, desired_mps: f64, ahead: Option<LeaderState>) -> f64 {
        self.alone.acceleration(own, desired_mps, ahead)
    }

    fn platoon_acceleration(&self, own: OwnMotion, _desired_mps: f64, platoon: &PlatoonBroadcast) -> f64 {
        let inputs = PloegInputs {
            distance_m: platoon.predecessor.gap_m - self.alone.0.standstill_gap_m,
            headway_s: platoon.headway_s,
            speed_mps: own.measured_mps,
            acceleration_mps2: own.planned_mps2,
            commanded_mps2: own.planned_mps2,
            predecessor: (platoon.predecessor.speed_mps, platoon.predecessor_mps2),
        };
        self.alone.limit_member(self.gains.acceleration(inputs, own.step_s), own, platoon)
    }

    fn can_platoon(&self) -> bool {
        true
    }
}

/// A speed that oscillates below the allowed one, as leaders of platoons drive in tests of string stability.
#[derive(Debug)]
struct Sinusoid(Idm);

impl Sinusoid {
    /// Its speed at a time. The mean is two amplitudes below the allowed speed: trajectories extend the present acceleration, and
    /// one that touched the allowed speed would flatten the wave.
    fn speed(&self, allowed_mps: f64, time_s: f64) -> f64 {
        let params = self.0.0;
        let swing = trig::sin(TAU * params.frequency_hz * time_s) - 2.0;
        (allowed_mps + params.amplitude_mps * swing).max(0.0)
    }
}

impl Controller for Sinusoid {
    fn acceleration(&self, own: OwnMotion, desired_mps: f64, ahead: Option<LeaderState>) -> f64 {
        if ahead.is_some() {
            return self.0.acceleration(own, desired_mps, ahead);
        }
        let params = self.0.0;
        let step_s = own.step_s.max(LEAST_STEP_S);
        let wanted_mps2 = (self.speed(desired_mps, own.now_s + step_s) - own.planned_mps) / step_s;
        wanted_mps2.clamp(params.min_acceleration_mps2, params.max_acceleration_mps2)
    }

    /// It may lead one.
    fn can_platoon(&self) -> bool {
        true
    }
}

/// The first control step has no duration.
const LEAST_STEP_S: f64 = 1e-3;

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
        let wall = LeaderState { gap_m: 0.05, speed_mps: 0.0 };
        let own = OwnMotion { planned_mps: 0.2, measured_mps: 0.2, ..OwnMotion::default() };
        let u = |name| controller(name, DriverParams::default()).unwrap().acceleration(own, 0.35, Some(wall));
        assert_eq!(u("idm"), -0.2);
        assert!(u("cruise") > 0.0);
        // It stops at the end of its route as others do.
        let cruise = controller("cruise", DriverParams::default()).unwrap();
        assert_eq!(cruise.acceleration_to_end(own, 0.35, wall), -0.2);
    }

    #[test]
    fn a_sinusoid_swings_below_the_allowed_speed() {
        let params = DriverParams { amplitude_mps: 0.02, frequency_hz: 0.1, ..DriverParams::default() };
        let driver = controller("sinusoid", params).unwrap();
        let (step_s, mut speed_mps, mut speeds) = (0.02, 0.2, Vec::new());
        for step in 0..1000 {
            let now_s = f64::from(step) * step_s;
            let own = OwnMotion { planned_mps: speed_mps, step_s, now_s, ..OwnMotion::default() };
            speed_mps += driver.acceleration(own, 0.24, None) * step_s;
            speeds.push(speed_mps);
        }
        let (low, high) = speeds.iter().fold((f64::MAX, 0.0_f64), |(l, h), v| (l.min(*v), h.max(*v)));
        assert!((low - 0.18).abs() < 1e-6 && (high - 0.22).abs() < 1e-6, "{low} {high}");
        // The highest speed is that of a quarter of the period, after 2.5 s.
        assert!((speeds[124] - 0.22).abs() < 1e-9, "{}", speeds[124]);
        let wall = Some(LeaderState { gap_m: 0.1, speed_mps: 0.0 });
        let own = OwnMotion { planned_mps: 0.2, measured_mps: 0.2, step_s, ..OwnMotion::default() };
        assert_eq!(driver.acceleration(own, 0.24, wall), -0.2);
    }

    #[test]
    fn outside_of_platoons_their_controllers_are_idm_and_inside_they_brake_for_a_predecessor_too_near() {
        let own = OwnMotion { planned_mps: 0.3, measured_mps: 0.3, step_s: 0.02, ..OwnMotion::default() };
        for name in ["cacc", "ploeg"] {
            let driver = controller(name, DriverParams::default()).unwrap();
            let idm = controller("idm", DriverParams::default()).unwrap();
            for ahead in [None, Some(LeaderState { gap_m: 0.3, speed_mps: 0.25 })] {
                let (u, v) = (driver.acceleration(own, 0.35, ahead), idm.acceleration(own, 0.35, ahead));
                assert_eq!(u, v, "{name}");
            }
            // The predecessor stands 0.1 m ahead, and says that it speeds up.
            let platoon = PlatoonBroadcast {
                predecessor: LeaderState { gap_m: 0.1, speed_mps: 0.0 },
                predecessor_mps2: 0.12,
                leader_mps: 0.3,
                leader_mps2: 0.12,
                spacing_m: 0.05,
                headway_s: 0.1,
            };
            assert_eq!(driver.platoon_acceleration(own, 0.35, &platoon), -0.2, "{name}");
        }
    }
}
