//! Who carries cameras: the vehicles of a scenario, or those that came to a served city over the link.

use super::super::Failure;
use crate::record::{Entry, LogReader, Origin};
use crate::scenario::{Experiment, PlannedVehicle};
use crate::sensor::Sensor;
use crate::snapshot::VehicleId;
use crate::wire::Body;
use std::collections::BTreeMap;
use std::path::Path;

/// A vehicle that a camera may sit on.
#[derive(Clone, Debug)]
pub(super) struct Carrier {
    pub(super) id: VehicleId,
    pub(super) name: String,
    pub(super) sensors: Vec<Sensor>,
}

/// The vehicles of an experiment.
pub(super) fn of_experiment(experiment: &Experiment) -> Vec<Carrier> {
    let carrier = |planned: &PlannedVehicle| Carrier {
        id: planned.id,
        name: planned.name.clone(),
        sensors: planned.sensors.clone(),
    };
    experiment.vehicles.iter().map(carrier).collect()
}

/// Those of a log. Over the link vehicles come without sensors: one that its scenario knows by number and name has
/// those of the scenario.
pub(super) fn of_log(path: &Path, experiment: &Experiment) -> Result<Vec<Carrier>, Failure> {
    let mut log = LogReader::open(path).map_err(Failure::bad_input)?;
    if log.origin() != Origin::Served {
        return Ok(of_experiment(experiment));
    }
    let planned = of_experiment(&log.planned().map_err(Failure::bad_input)?);
    let mut carriers = BTreeMap::new();
    while let Some(entry) = log.read().map_err(Failure::bad_input)? {
        let Entry::Network(command) = entry else { continue };
        if !Body::is_setup(command.kind) {
            continue;
        }
        let body = Body::from_log(command.kind, &command.body).map_err(Failure::bad_input)?;
        let Body::Setup { setup, .. } = body else { continue };
        let known = planned.iter().find(|known| known.id == setup.id && known.name == setup.name);
        let carrier =
            known.cloned().unwrap_or(Carrier { id: setup.id, name: setup.name, sensors: Vec::new() });
        carriers.insert(setup.id, carrier);
    }
    Ok(carriers.into_values().collect())
}
