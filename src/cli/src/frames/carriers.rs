//! Vehicles that carry cameras: those of a scenario, or those that came to a served city over the link.

use super::super::Failure;
use city3d_logbook::record::{LogEntry, LogOrigin, LogReader};
use city3d_protocol::snapshot::VehicleId;
use city3d_protocol::wire::Body;
use city3d_sensors::Sensor;
use city3d_simulation::scenario::{Experiment, PlannedVehicle};
use std::collections::BTreeMap;
use std::path::Path;

/// A vehicle with its camera sensors.
#[derive(Clone, Debug)]
pub(super) struct CameraCarrier {
    pub(super) id: VehicleId,
    pub(super) name: String,
    pub(super) sensors: Vec<Sensor>,
}

/// The vehicles of an experiment.
pub(super) fn of_experiment(experiment: &Experiment) -> Vec<CameraCarrier> {
    let carrier = |planned: &PlannedVehicle| CameraCarrier {
        id: planned.id,
        name: planned.name.clone(),
        sensors: planned.sensors.clone(),
    };
    experiment.vehicles.iter().map(carrier).collect()
}

/// The vehicles of a log. Vehicles come over the link without sensors: number and name match them to those of the
/// scenario.
pub(super) fn of_log(path: &Path, experiment: &Experiment) -> Result<Vec<CameraCarrier>, Failure> {
    let mut log = LogReader::open(path).map_err(Failure::bad_input)?;
    if log.origin() != LogOrigin::Served {
        return Ok(of_experiment(experiment));
    }
    let planned = of_experiment(&log.planned().map_err(Failure::bad_input)?);
    let mut carriers = BTreeMap::new();
    while let Some(entry) = log.read().map_err(Failure::bad_input)? {
        let LogEntry::Network(command) = entry else { continue };
        if !Body::is_setup(command.kind) {
            continue;
        }
        let body = Body::from_log(command.kind, &command.body).map_err(Failure::bad_input)?;
        let Body::Setup { setup, .. } = body else { continue };
        let known = planned.iter().find(|known| known.id == setup.id && known.name == setup.name);
        let carrier =
            known.cloned().unwrap_or(CameraCarrier { id: setup.id, name: setup.name, sensors: Vec::new() });
        carriers.insert(setup.id, carrier);
    }
    Ok(carriers.into_values().collect())
}
