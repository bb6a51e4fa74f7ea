//! The city as observed over the link: estimates motion from poses and builds snapshots, so that a remote process
//! writes the same files.

use crate::environment::EnvironmentSpec;
use crate::scenario::Experiment;
use city3d_estimation::{MotionEstimate, MotionFilter, NoiseModel, Odometer, StandstillChange};
use city3d_geometry::{Pose2, trig};
use city3d_protocol::snapshot::{
    Aspect, Event, EventKind, FrameSnapshot, SignalAspects, Status, VehicleId, VehicleInfo, VehicleState,
};
use city3d_protocol::wire::{Measurement, ObservedVehicle, Poses};
use glam::{DQuat, DVec3};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// Factor on the noise of single poses that accounts for errors with a correlation time.
const CORRELATED_NOISE: f64 = 1.4;

/// Builds snapshots from poses. Pedals, steering and wheels, which poses do not show, stay at rest.
#[derive(Debug)]
pub struct ObservedCity {
    experiment: Arc<Experiment>,
    noise: NoiseModel,
    snapshot: FrameSnapshot,
    tracks: BTreeMap<VehicleId, VehicleTrack>,
    /// All vehicles that have been observed.
    known: BTreeSet<VehicleId>,
    /// Static data that the city has described.
    described: BTreeMap<VehicleId, VehicleInfo>,
    /// The description has changed since the roster was made.
    is_roster_old: bool,
}

/// Motion filter and odometer of a vehicle, city metres.
#[derive(Debug)]
struct VehicleTrack {
    filter: MotionFilter,
    odometer: Odometer,
    is_physical: bool,
}

impl VehicleTrack {
    fn new(filter: MotionFilter, is_physical: bool) -> Self {
        let odometer = if is_physical { Odometer::of_unknown_speed() } else { Odometer::default() };
        Self { filter, odometer, is_physical }
    }
}

/// Observed state of a vehicle at one instant. City metres.
#[derive(Clone, Copy, Debug)]
pub struct ObservedMotion {
    /// Id in the city.
    pub vehicle: VehicleId,
    /// As the city reports it.
    pub status: Status,
    /// On the ground.
    pub position: DVec3,
    /// City from body.
    pub orientation: DQuat,
    /// `None` while the vehicle is unseen: the city keeps it at a place.
    pub motion: Option<MotionEstimate>,
}

impl ObservedMotion {
    /// From an estimate of the motion in the plane.
    pub fn planar(vehicle: VehicleId, status: Status, motion: &MotionEstimate) -> Self {
        let (position, orientation) =
            (motion.pose.position.extend(0.0), rotation_about_z(motion.pose.yaw_rad));
        Self { vehicle, status, position, orientation, motion: Some(*motion) }
    }
}

fn rotation_about_z(yaw_rad: f64) -> DQuat {
    let (sin, cos) = trig::sin_cos(yaw_rad / 2.0);
    DQuat::from_xyzw(0.0, 0.0, sin, cos)
}

/// Noise of the city's poses of physical vehicles. These are estimates already: their errors are correlated over some
/// poses, so that averaging does not reduce them and they look like motion.
fn carried_noise(noise: NoiseModel, experiment: &Experiment) -> NoiseModel {
    let laboratory = [&EnvironmentSpec::TESTBED, &experiment.testbed];
    let position_m = laboratory.map(|spec| spec.position_noise_m).into_iter().fold(0.0, f64::max);
    let heading_rad = laboratory.map(|spec| spec.yaw_noise_rad).into_iter().fold(0.0, f64::max);
    noise.stated(CORRELATED_NOISE * experiment.scale.city_from_lab(position_m), heading_rad)
}

impl ObservedCity {
    /// An observed city before its first poses.
    pub fn new(experiment: Arc<Experiment>) -> Self {
        let noise = NoiseModel::LABORATORY.to_city(experiment.scale);
        Self {
            noise,
            snapshot: FrameSnapshot {
                signals: vec![Aspect::Dark; experiment.city_map.signals.len()],
                ..FrameSnapshot::default()
            },
            experiment,
            tracks: BTreeMap::new(),
            known: BTreeSet::new(),
            described: BTreeMap::new(),
            is_roster_old: false,
        }
    }

    /// Takes static data from a description of the city, or from one part of it. It replaces what the plan of the
    /// experiment says of these vehicles, from the next poses on.
    pub fn describe(&mut self, vehicles: impl IntoIterator<Item = VehicleInfo>) {
        for info in vehicles {
            // Poses of physical vehicles have other noise: their filter starts anew.
            if self.tracks.get(&info.id).is_some_and(|track| track.is_physical != info.is_physical()) {
                self.tracks.remove(&info.id);
            }
            self.is_roster_old |= self.described.get(&info.id) != Some(&info);
            self.described.insert(info.id, info);
        }
    }

    /// Takes what signal heads show, for the next snapshot.
    pub fn show_signals(&mut self, aspects: &SignalAspects) {
        for (head, aspect) in &aspects.heads {
            if let Some(shown) = self.snapshot.signals.get_mut(head.index()) {
                *shown = *aspect;
            }
        }
    }

    /// Whether the static data of a vehicle is known, from the plan of the experiment or a description.
    pub fn knows(&self, id: VehicleId) -> bool {
        self.described.contains_key(&id) || self.experiment.planned(id).is_some()
    }

    fn is_physical(&self, id: VehicleId) -> bool {
        self.described.get(&id).map_or_else(|| self.experiment.is_physical(id), VehicleInfo::is_physical)
    }

    /// Snapshot of the last poses; without vehicles before the first.
    pub fn snapshot(&self) -> &FrameSnapshot {
        &self.snapshot
    }

    /// Adds the poses of one complete tick.
    pub fn add_poses(&mut self, head: &Poses, vehicles: &[ObservedVehicle]) -> &FrameSnapshot {
        let motions: Vec<ObservedMotion> =
            vehicles.iter().map(|seen| self.estimate(head.time_s, seen)).collect();
        self.build_snapshot(head, &motions)
    }

    /// Updates the filter with a pose, and predicts the motion at a time.
    fn estimate(&mut self, time_s: f64, seen: &ObservedVehicle) -> ObservedMotion {
        let Measurement { vehicle, stamp_s, position, orientation } = seen.pose;
        let position = position * self.experiment.scale.factor();
        let observed = ObservedMotion { vehicle, status: seen.status, position, orientation, motion: None };
        if seen.status == Status::Unseen {
            return observed;
        }
        let forward = orientation * DVec3::X;
        let pose = Pose2::at(position.truncate(), trig::atan2(forward.y, forward.x));
        let (start_mps, is_physical) = (self.start_mps(time_s, seen), self.is_physical(vehicle));
        let experiment = &self.experiment;
        let track = self.tracks.entry(vehicle).or_insert_with(|| {
            let noise = if is_physical { carried_noise(self.noise, experiment) } else { self.noise };
            let filter = match start_mps {
                Some(speed_mps) => MotionFilter::moving(noise, stamp_s, pose, speed_mps),
                None => MotionFilter::of_exact_poses(noise),
            };
            VehicleTrack::new(filter, is_physical)
        });
        track.filter.update(stamp_s, pose);
        let motion = track.filter.at(time_s);
        let Some(at) = motion.map(|motion| motion.pose) else { return observed };
        ObservedMotion {
            position: at.position.extend(position.z),
            orientation: rotation_about_z(at.yaw_rad - pose.yaw_rad) * orientation,
            motion,
            ..observed
        }
    }

    /// Initial speed of a simulated vehicle at the start of the experiment, or of an arrival when it is first seen.
    fn start_mps(&self, time_s: f64, seen: &ObservedVehicle) -> Option<f64> {
        let id = seen.pose.vehicle;
        let planned = self.experiment.planned(id)?;
        let is_arrival = self.experiment.arrival(id).is_some() && !self.known.contains(&id);
        let is_start = (time_s == 0.0 || is_arrival) && planned.physical.is_none();
        is_start.then(|| self.experiment.scale.city_from_lab(planned.start.speed_mps))
    }

    /// Builds the snapshot of one tick from the vehicles' motions, in id order.
    pub fn build_snapshot(&mut self, head: &Poses, vehicles: &[ObservedMotion]) -> &FrameSnapshot {
        let is_later = head.time_s > self.snapshot.time_s;
        let before = std::mem::take(&mut self.snapshot.vehicles);
        self.snapshot.events.clear();
        (self.snapshot.tick, self.snapshot.time_s) = (head.tick, head.time_s);
        self.snapshot.state_hash = head.state_hash;
        for seen in vehicles {
            let old = before.binary_search_by_key(&seen.vehicle, |state| state.id).ok();
            self.note(seen, old.map(|index| before[index].status));
            let state = self.state_of(seen, is_later);
            self.snapshot.vehicles.push(state);
        }
        let ids = |vehicles: &[VehicleState]| vehicles.iter().map(|state| state.id).collect::<Vec<_>>();
        let has_changed = ids(&before) != ids(&self.snapshot.vehicles);
        if std::mem::take(&mut self.is_roster_old) || has_changed {
            self.snapshot.roster = self.roster();
            let is_there = |id: &VehicleId| self.snapshot.vehicle(*id).is_some();
            let lost: Vec<VehicleId> = ids(&before).into_iter().filter(|id| !is_there(id)).collect();
            for vehicle in lost {
                // An arrival does not come back, whoever else is only hidden.
                let has_left = self.experiment.planned(vehicle).is_some_and(|planned| planned.leaves);
                let (time_s, kind) = if has_left {
                    self.tracks.remove(&vehicle);
                    (self.step_began_s(), EventKind::Remove)
                } else {
                    (head.time_s, EventKind::Unseen)
                };
                self.snapshot.events.push(Event { time_s, vehicle, kind });
            }
        }
        &self.snapshot
    }

    /// State of a vehicle, after its odometer was updated; adds its events of stopping and moving off.
    fn state_of(&mut self, seen: &ObservedMotion, is_later: bool) -> VehicleState {
        let ObservedMotion { vehicle: id, status, position, orientation, motion } = *seen;
        let mut state = VehicleState { id, status, position, orientation, ..VehicleState::default() };
        let (noise, is_physical) = (self.noise, self.is_physical(id));
        let track = self
            .tracks
            .entry(id)
            .or_insert_with(|| VehicleTrack::new(MotionFilter::of_exact_poses(noise), is_physical));
        // The city decides with all poses whether a physical vehicle stands.
        let found_to_stand = match status {
            _ if !track.is_physical => None,
            Status::Driving => Some(false),
            Status::Stopped => Some(true),
            _ => None,
        };
        if let Some(motion) = &motion {
            let change = match found_to_stand.filter(|_| is_later) {
                Some(stands) => track.odometer.update_known(motion, stands),
                None if is_later => track.odometer.update(motion),
                None => None,
            };
            let kind = change.map(|change| match change {
                StandstillChange::Stopped => EventKind::Stop,
                StandstillChange::MovedOff { stood_s } => EventKind::Go { stood_s },
            });
            let time_s = self.snapshot.time_s;
            self.snapshot.events.extend(kind.map(|kind| Event { time_s, vehicle: id, kind }));
            let observed = track.odometer.reported(motion);
            state.velocity_mps = observed.velocity_mps.extend(0.0);
            state.speed_mps = observed.speed_mps;
            state.acceleration_mps2 = observed.acceleration_mps2;
            state.yaw_rate_radps = observed.yaw_rate_radps;
        }
        state.distance_m = track.odometer.distance_m();
        state
    }

    /// Adds the events of a change of status; `old` is `None` for a vehicle that was absent.
    fn note(&mut self, seen: &ObservedMotion, old: Option<Status>) {
        let (time_s, vehicle, status) = (self.snapshot.time_s, seen.vehicle, seen.status);
        let is_first = self.known.insert(vehicle);
        if is_first && self.experiment.arrival(vehicle).is_some() {
            let time_s = self.step_began_s();
            self.snapshot.events.push(Event { time_s, vehicle, kind: EventKind::Spawn });
        } else if old.is_none() {
            let kind = if is_first { EventKind::Spawn } else { EventKind::SeenAgain };
            self.snapshot.events.push(Event { time_s, vehicle, kind });
        }
        let mut happened = |kind| self.snapshot.events.push(Event { time_s, vehicle, kind });
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
    }

    /// When the step began that the snapshot ends: vehicles come and go at the beginning of a step.
    fn step_began_s(&self) -> f64 {
        self.experiment.rates.time_s(self.snapshot.tick.saturating_sub(1))
    }

    fn roster(&self) -> Arc<Vec<VehicleInfo>> {
        let info = |state: &VehicleState| self.info(state.id);
        Arc::new(self.snapshot.vehicles.iter().map(info).collect())
    }

    fn info(&self, id: VehicleId) -> VehicleInfo {
        if let Some(info) = self.described.get(&id) {
            // Its pedals are not seen here, whatever model moves it.
            let model = if info.is_physical() { info.model.clone() } else { String::new() };
            return VehicleInfo { model, ..info.clone() };
        }
        let planned = self.experiment.planned(id);
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::{Library, Overrides, read_experiment};
    use city3d_protocol::snapshot::{Appearance, BodyType, VehicleSpec};
    use city3d_protocol::wire::ExperimentPhase;

    fn info(id: VehicleId, name: &str) -> VehicleInfo {
        let appearance = Appearance { body: BodyType::Van, colour: [1, 2, 3] };
        VehicleInfo::of(id, name, appearance, &VehicleSpec::default())
    }

    fn add_poses(city: &mut ObservedCity, tick: u64, ids: &[VehicleId]) {
        let time_s = tick as f64 / 100.0;
        let (phase, vehicles) = (ExperimentPhase::Running, Vec::new());
        let head = Poses { tick, time_s, state_hash: 0, phase, part: 0, parts: 1, vehicles };
        let seen = |id: &VehicleId| ObservedVehicle {
            pose: Measurement {
                vehicle: *id,
                stamp_s: time_s,
                position: DVec3::new(f64::from(id.0), 0.0, 0.0),
                orientation: DQuat::IDENTITY,
            },
            status: Status::Driving,
        };
        let seen: Vec<ObservedVehicle> = ids.iter().map(seen).collect();
        city.add_poses(&head, &seen);
    }

    #[test]
    fn a_description_tells_what_vehicles_look_like() {
        let (text, library) = Library::scenario("straight").unwrap();
        let experiment = read_experiment("straight", &text, &library, Overrides::default()).unwrap();
        let (planned, planned_name) = (experiment.vehicles[0].id, experiment.vehicles[0].name.clone());
        let guest = VehicleId(4000);
        let mut city = ObservedCity::new(Arc::new(experiment));
        assert!(city.knows(planned) && !city.knows(guest));
        let name_of = |city: &ObservedCity, id| {
            city.snapshot().roster.iter().find(|info| info.id == id).unwrap().name.clone()
        };
        add_poses(&mut city, 1, &[planned, guest]);
        assert_eq!(name_of(&city, planned), planned_name);
        assert_eq!(name_of(&city, guest), "vehicle4000");
        // Described later, and the plan is overruled.
        let described = [info(planned, "other"), info(guest, "guest")];
        city.describe(described.clone());
        assert!(city.knows(guest));
        assert_eq!(name_of(&city, guest), "vehicle4000", "until the next poses");
        add_poses(&mut city, 2, &[planned, guest]);
        // Their dynamics models are not seen in poses.
        let seen = described.clone().map(|info| VehicleInfo { model: String::new(), ..info });
        assert_eq!(*city.snapshot().roster, seen);
        // The same description again makes no new roster.
        let roster = Arc::clone(&city.snapshot().roster);
        city.describe(described);
        add_poses(&mut city, 3, &[planned, guest]);
        assert!(Arc::ptr_eq(&roster, &city.snapshot().roster));
    }

    #[test]
    fn a_vehicle_that_is_described_as_physical_is_filtered_as_one() {
        let (text, library) = Library::scenario("straight").unwrap();
        let experiment = read_experiment("straight", &text, &library, Overrides::default()).unwrap();
        let id = experiment.vehicles[0].id;
        let mut city = ObservedCity::new(Arc::new(experiment));
        add_poses(&mut city, 1, &[id]);
        assert!(!city.tracks[&id].is_physical);
        city.describe([VehicleInfo { model: "measured".to_owned(), ..info(id, "car") }]);
        add_poses(&mut city, 2, &[id]);
        assert!(city.tracks[&id].is_physical && city.snapshot().roster[0].is_physical());
    }
}
