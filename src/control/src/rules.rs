//! Rules of the traffic, and the algorithms that may be named in them.

use super::coordination::platoon::PlatoonParams;
use super::coordination::{ControlZone, CoordinationParams, Coordinators, ZoneCoordination};
use super::{Drivers, RightOfWayParams, SetupError, SignalPlan};

/// Rules of the traffic: who goes first, which vehicles are coordinated, and the signals.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TrafficRules {
    /// Right of way at junctions.
    pub right_of_way: RightOfWayParams,
    /// Coordination in control zones; `None` without.
    pub coordination: Option<CoordinationRules>,
    /// How platoons are formed; `None` for none.
    pub platoons: Option<PlatoonParams>,
    /// Traffic signals; their heads are those of the map.
    pub signals: Vec<SignalPlan>,
}

/// Coordination of a map.
#[derive(Clone, Debug, PartialEq)]
pub struct CoordinationRules {
    /// Name of the algorithm, one of [`Coordinators`].
    pub algorithm: String,
    /// Gaps and tolerances.
    pub params: CoordinationParams,
    /// The control zones.
    pub zones: Vec<ControlZone>,
}

impl CoordinationRules {
    /// Coordination by these rules, before its first step.
    ///
    /// # Errors
    /// When the algorithm is not one of `coordinators`.
    pub(super) fn start(self, coordinators: &Coordinators) -> Result<ZoneCoordination, SetupError> {
        let algorithm = coordinators.coordinator(&self.algorithm);
        let algorithm = algorithm.ok_or_else(|| SetupError::UnknownCoordinator {
            name: self.algorithm,
            known: coordinators.names().map(str::to_owned).collect(),
        })?;
        Ok(ZoneCoordination::new(self.params, self.zones, algorithm))
    }
}

/// The algorithms that a program knows by name.
#[derive(Clone, Debug, Default)]
pub struct Algorithms {
    /// Longitudinal control of single vehicles.
    pub drivers: Drivers,
    /// Coordination of the vehicles in control zones.
    pub coordinators: Coordinators,
}
