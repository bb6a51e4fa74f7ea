//! The vehicles of a recorded run: names, appearances and specifications, which snapshots leave out because they do
//! not change.

use city3d_dynamics::vehicle::set_wheels;
use city3d_logbook::record::{LogEntry, LoggedSnapshot};
use city3d_logbook::replay::commands_of;
use city3d_protocol::snapshot::{Appearance, FrameSnapshot, SimCommand, VehicleId, VehicleInfo, VehicleSpec};
use city3d_protocol::wire::Body;
use city3d_simulation::scenario::Experiment;
use std::collections::BTreeMap;
use std::sync::Arc;

/// The vehicles of a log, by its scenario and by what came over the laboratory's link.
#[derive(Debug)]
pub(super) struct VehicleRegistry {
    experiment: Arc<Experiment>,
    vehicles: BTreeMap<VehicleId, (VehicleInfo, VehicleSpec)>,
    /// The roster of the last snapshot; the next snapshot mostly has the same vehicles.
    roster: Arc<Vec<VehicleInfo>>,
}

impl VehicleRegistry {
    pub(super) fn of(experiment: Arc<Experiment>) -> Self {
        let mut registry = Self { vehicles: BTreeMap::new(), roster: Arc::default(), experiment };
        let planned = Arc::clone(&registry.experiment);
        for vehicle in &planned.vehicles {
            registry.add(vehicle.id, &vehicle.name, vehicle.appearance, &vehicle.spec);
        }
        registry
    }

    fn add(&mut self, id: VehicleId, name: &str, appearance: Appearance, spec: &VehicleSpec) {
        self.vehicles.insert(id, (VehicleInfo::of(id, name, appearance, spec), spec.clone()));
        self.roster = Arc::default();
    }

    /// Registers a vehicle that came over the link; returns whether it is new.
    pub(super) fn register(&mut self, entry: &LogEntry) -> bool {
        let LogEntry::Network(command) = entry else { return false };
        if !Body::is_setup(command.kind) {
            return false;
        }
        let count = self.vehicles.len();
        // A damaged message registers no vehicle.
        for command in commands_of(command, &self.experiment).unwrap_or_default() {
            if let SimCommand::Spawn(setup) = command {
                self.add(setup.id, &setup.name, setup.appearance, &setup.spec);
            }
        }
        self.vehicles.len() > count
    }

    /// The full snapshot of a logged one.
    pub(super) fn snapshot(&mut self, logged: &LoggedSnapshot) -> FrameSnapshot {
        let ids = || logged.vehicles.iter().map(|vehicle| vehicle.id);
        if !self.roster.iter().map(|info| info.id).eq(ids()) {
            self.roster = Arc::new(ids().map(|id| self.info(id)).collect());
        }
        let state = |logged: &city3d_logbook::record::LoggedVehicle| {
            let mut state = logged.state();
            let registered = self.vehicles.get(&state.id).map(|(_, spec)| spec);
            let arrived = || self.experiment.arrival(state.id).map(|arrival| &arrival.vehicle.spec);
            if let Some(spec) = registered.or_else(arrived) {
                set_wheels(spec, &mut state);
            }
            state
        };
        FrameSnapshot {
            tick: logged.tick,
            time_s: logged.time_s,
            state_hash: logged.state_hash,
            vehicles: logged.vehicles.iter().map(state).collect(),
            roster: Arc::clone(&self.roster),
            events: Vec::new(),
            signals: logged.signals.clone(),
        }
    }

    fn info(&self, id: VehicleId) -> VehicleInfo {
        let unknown =
            || VehicleInfo::of(id, &format!("vehicle{id}"), Appearance::default(), &VehicleSpec::default());
        let arrived = || {
            let vehicle = &self.experiment.arrival(id)?.vehicle;
            Some(VehicleInfo::of(id, &vehicle.name, vehicle.appearance, &vehicle.spec))
        };
        let registered = self.vehicles.get(&id).map(|(info, _)| info.clone());
        registered.or_else(arrived).unwrap_or_else(unknown)
    }
}
