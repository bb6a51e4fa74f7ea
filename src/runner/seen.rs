//! The city as it is seen over the laboratory's link: from poses to snapshots, so that the same files can
//! be written there.

use crate::scenario::Experiment;
use crate::snapshot::{Event, EventKind, FrameSnapshot, Status, VehicleId, VehicleInfo, VehicleState};
use crate::wire::{Measurement, Poses, Seen};
use glam::DVec3;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// As for vehicles of the world: one stands below the first speed, and moves again above the second.
const STANDS_MPS: f64 = 0.1;
const MOVES_MPS: f64 = 0.4;

/// Puts poses together to snapshots. What a pose does not tell stays at rest: pedals, steering, wheels.
#[derive(Debug)]
pub struct SeenCity {
    experiment: Arc<Experiment>,
    snapshot: FrameSnapshot,
    /// Since when each vehicle of the snapshot stands.
    standing_since_s: Vec<Option<f64>>,
    /// Velocities of vehicles that are seen for the first time, or again, city metres a second.
    expected_mps: BTreeMap<VehicleId, DVec3>,
    /// All that have been seen.
    met: BTreeSet<VehicleId>,
}

impl SeenCity {
    pub fn new(experiment: Arc<Experiment>) -> Self {
        Self {
            experiment,
            snapshot: FrameSnapshot::default(),
            standing_since_s: Vec::new(),
            expected_mps: BTreeMap::new(),
            met: BTreeSet::new(),
        }
    }

    /// How a vehicle moves, laboratory metres a second, when it is seen for the first time or again: one pose does
    /// not tell, and without this it begins at rest.
    pub fn expect(&mut self, vehicle: VehicleId, velocity_mps: DVec3) {
        self.expected_mps.insert(vehicle, velocity_mps * self.experiment.scale.factor());
    }

    pub fn snapshot(&self) -> &FrameSnapshot {
        &self.snapshot
    }

    /// Takes the poses of one tick in, of all its parts.
    pub fn see(&mut self, head: &Poses, vehicles: &[Seen]) -> &FrameSnapshot {
        let dt_s = head.time_s - self.snapshot.time_s;
        let before = std::mem::take(&mut self.snapshot.vehicles);
        let standing = std::mem::take(&mut self.standing_since_s);
        self.snapshot.events.clear();
        (self.snapshot.tick, self.snapshot.time_s) = (head.tick, head.time_s);
        self.snapshot.state_hash = head.state_hash;
        for seen in vehicles {
            let index = before.binary_search_by_key(&seen.pose.vehicle, |state| state.id).ok();
            let old = index.map(|index| &before[index]);
            let state = self.state_of(seen, old, dt_s);
            let since_s = index.and_then(|index| standing[index]);
            let since_s = self.note(&state, old.map(|old| old.status), since_s);
            self.standing_since_s.push(since_s);
            self.snapshot.vehicles.push(state);
        }
        self.expected_mps.clear();
        let ids = |vehicles: &[VehicleState]| vehicles.iter().map(|state| state.id).collect::<Vec<_>>();
        if ids(&before) != ids(&self.snapshot.vehicles) {
            self.snapshot.roster = self.roster();
            let is_there = |id: &VehicleId| self.snapshot.vehicle(*id).is_some();
            let lost: Vec<VehicleId> = ids(&before).into_iter().filter(|id| !is_there(id)).collect();
            let unseen = |vehicle| Event { time_s: head.time_s, vehicle, kind: EventKind::Unseen };
            self.snapshot.events.extend(lost.into_iter().map(unseen));
        }
        &self.snapshot
    }

    fn state_of(&self, seen: &Seen, old: Option<&VehicleState>, dt_s: f64) -> VehicleState {
        let Measurement { vehicle: id, position, orientation, .. } = seen.pose;
        let position = position * self.experiment.scale.factor();
        let mut state =
            VehicleState { id, status: seen.status, position, orientation, ..VehicleState::default() };
        if let Some(old) = old {
            state.distance_m = old.distance_m;
            (state.velocity_mps, state.speed_mps) = (old.velocity_mps, old.speed_mps);
            if dt_s > 0.0 {
                state.velocity_mps = (position - old.position) / dt_s;
                state.speed_mps = state.velocity_mps.truncate().dot(state.forward());
                state.acceleration_mps2 = (state.speed_mps - old.speed_mps) / dt_s;
                state.distance_m += state.speed_mps.abs() * dt_s;
            }
        } else if let Some(&velocity_mps) = self.expected_mps.get(&id) {
            state.velocity_mps = velocity_mps;
            state.speed_mps = velocity_mps.truncate().dot(state.forward());
        }
        state
    }

    /// What has happened to a vehicle, and since when it stands.
    fn note(&mut self, state: &VehicleState, old: Option<Status>, since_s: Option<f64>) -> Option<f64> {
        let (time_s, vehicle, status) = (self.snapshot.time_s, state.id, state.status);
        let mut happened = |kind| self.snapshot.events.push(Event { time_s, vehicle, kind });
        if old.is_none() {
            happened(if self.met.insert(vehicle) { EventKind::Spawn } else { EventKind::SeenAgain });
        }
        if old != Some(status) {
            match status {
                Status::LinkLost => happened(EventKind::LinkLost),
                Status::Yielding => happened(EventKind::Yield),
                Status::Finished => happened(EventKind::Finish),
                _ => {}
            }
            if old == Some(Status::LinkLost) {
                happened(EventKind::LinkBack);
            }
        }
        let speed_mps = state.speed_mps.abs();
        match since_s {
            None if speed_mps < STANDS_MPS && state.distance_m > 0.0 => {
                happened(EventKind::Stop);
                Some(time_s)
            }
            Some(since_s) if speed_mps > MOVES_MPS => {
                happened(EventKind::Go { stood_s: time_s - since_s });
                None
            }
            unchanged => unchanged,
        }
    }

    fn roster(&self) -> Arc<Vec<VehicleInfo>> {
        let info = |state: &VehicleState| self.info(state.id);
        Arc::new(self.snapshot.vehicles.iter().map(info).collect())
    }

    fn info(&self, id: VehicleId) -> VehicleInfo {
        let planned = self.experiment.vehicles.iter().find(|planned| planned.id == id);
        let spec = planned.map_or_else(Default::default, |planned| planned.spec.clone());
        VehicleInfo {
            id,
            name: planned.map_or_else(|| format!("vehicle{id}"), |planned| planned.name.clone()),
            dimensions: spec.dimensions,
            appearance: planned.map_or_else(Default::default, |planned| planned.appearance),
            model: String::new(),
        }
    }
}
