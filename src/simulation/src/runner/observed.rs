//! The city as observed over the link: estimates motion from poses and builds snapshots, so that a remote process
//! writes the same files.

use crate::environment::EnvironmentSpec;
use crate::scenario::Experiment;
use city3d_estimation::{MotionEstimate, MotionFilter, NoiseModel, Odometer, StandstillChange};
use city3d_geometry::{Pose2, trig};
use city3d_protocol::snapshot::{
    Event, EventKind, FrameSnapshot, Status, VehicleId, VehicleInfo, VehicleState,
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
        Self { filter, odometer: Odometer::default(), is_physical }
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
        let (tracks, known) = (BTreeMap::new(), BTreeSet::new());
        Self { experiment, noise, snapshot: FrameSnapshot::default(), tracks, known }
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
        let start_mps = self.start_mps(time_s, seen);
        let experiment = &self.experiment;
        let track = self.tracks.entry(vehicle).or_insert_with(|| {
            let is_physical = experiment.is_physical(vehicle);
            let noise = if is_physical { carried_noise(self.noise, experiment) } else { self.noise };
            let filter = match start_mps {
                Some(speed_mps) => MotionFilter::moving(noise, stamp_s, pose, speed_mps),
                None => MotionFilter::new(noise),
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

    /// Initial speed of a simulated vehicle at the start of the experiment.
    fn start_mps(&self, time_s: f64, seen: &ObservedVehicle) -> Option<f64> {
        let planned = self.experiment.vehicles.iter().find(|planned| planned.id == seen.pose.vehicle)?;
        let is_start = time_s == 0.0 && planned.physical.is_none();
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
        if ids(&before) != ids(&self.snapshot.vehicles) {
            self.snapshot.roster = self.roster();
            let is_there = |id: &VehicleId| self.snapshot.vehicle(*id).is_some();
            let lost: Vec<VehicleId> = ids(&before).into_iter().filter(|id| !is_there(id)).collect();
            let unseen = |vehicle| Event { time_s: head.time_s, vehicle, kind: EventKind::Unseen };
            self.snapshot.events.extend(lost.into_iter().map(unseen));
        }
        &self.snapshot
    }

    /// State of a vehicle, after its odometer was updated; adds its events of stopping and moving off.
    fn state_of(&mut self, seen: &ObservedMotion, is_later: bool) -> VehicleState {
        let ObservedMotion { vehicle: id, status, position, orientation, motion } = *seen;
        let mut state = VehicleState { id, status, position, orientation, ..VehicleState::default() };
        let (noise, experiment) = (self.noise, &self.experiment);
        let track = self
            .tracks
            .entry(id)
            .or_insert_with(|| VehicleTrack::new(MotionFilter::new(noise), experiment.is_physical(id)));
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
        let mut happened = |kind| self.snapshot.events.push(Event { time_s, vehicle, kind });
        if old.is_none() {
            happened(if is_first { EventKind::Spawn } else { EventKind::SeenAgain });
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
