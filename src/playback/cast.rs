//! Who takes part in a recorded run: what its snapshots leave out of a vehicle, because it does not change.

use crate::record::{Entry, LoggedSnapshot};
use crate::replay::commands_of;
use crate::scenario::Experiment;
use crate::snapshot::{Appearance, FrameSnapshot, SimCommand, VehicleId, VehicleInfo, VehicleSpec};
use crate::vehicle::set_wheels;
use crate::wire::Body;
use std::collections::BTreeMap;
use std::sync::Arc;

/// The vehicles of a log, by its scenario and by what came over the laboratory's link.
#[derive(Debug)]
pub(super) struct Cast {
    experiment: Arc<Experiment>,
    members: BTreeMap<VehicleId, (VehicleInfo, VehicleSpec)>,
    /// That of the last snapshot: the next one mostly has the same vehicles.
    roster: Arc<Vec<VehicleInfo>>,
}

impl Cast {
    pub(super) fn of(experiment: Arc<Experiment>) -> Self {
        let mut cast = Self { members: BTreeMap::new(), roster: Arc::default(), experiment };
        let planned = Arc::clone(&cast.experiment);
        for vehicle in &planned.vehicles {
            cast.add(vehicle.id, &vehicle.name, vehicle.appearance, &vehicle.spec);
        }
        cast
    }

    fn add(&mut self, id: VehicleId, name: &str, appearance: Appearance, spec: &VehicleSpec) {
        self.members.insert(id, (VehicleInfo::of(id, name, appearance, spec), spec.clone()));
        self.roster = Arc::default();
    }

    /// Takes in vehicles that came over the link; whether there is a new one.
    pub(super) fn meet(&mut self, entry: &Entry) -> bool {
        let Entry::Network(command) = entry else { return false };
        if !Body::is_setup(command.kind) {
            return false;
        }
        let count = self.members.len();
        // What is damaged brings nobody.
        for command in commands_of(command, &self.experiment).unwrap_or_default() {
            if let SimCommand::Spawn(setup) = command {
                self.add(setup.id, &setup.name, setup.appearance, &setup.spec);
            }
        }
        self.members.len() > count
    }

    /// The instant as it is shown.
    pub(super) fn snapshot(&mut self, logged: &LoggedSnapshot) -> FrameSnapshot {
        let ids = || logged.vehicles.iter().map(|vehicle| vehicle.id);
        if !self.roster.iter().map(|info| info.id).eq(ids()) {
            self.roster = Arc::new(ids().map(|id| self.info(id)).collect());
        }
        let state = |logged: &crate::record::LoggedVehicle| {
            let mut state = logged.state();
            if let Some((_, spec)) = self.members.get(&state.id) {
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
        }
    }

    fn info(&self, id: VehicleId) -> VehicleInfo {
        let unknown =
            || VehicleInfo::of(id, &format!("vehicle{id}"), Appearance::default(), &VehicleSpec::default());
        self.members.get(&id).map_or_else(unknown, |(info, _)| info.clone())
    }
}
