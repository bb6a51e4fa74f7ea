//! The city as it is seen over the laboratory's link: from poses to snapshots, so that the same files can
//! be written there.

use crate::environment::EnvironmentSpec;
use crate::estimation::{MotionEstimate, MotionFilter, NoiseModel, Odometer, StandChange};
use crate::geom::{Pose2, trig};
use crate::scenario::Experiment;
use crate::snapshot::{Event, EventKind, FrameSnapshot, Status, VehicleId, VehicleInfo, VehicleState};
use crate::wire::{Measurement, Poses, Seen};
use glam::{DQuat, DVec3};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// Errors that last count as so much larger ones of single poses.
const LASTING: f64 = 1.4;

/// Puts poses together to snapshots. What a pose does not tell stays at rest: pedals, steering, wheels.
#[derive(Debug)]
pub struct SeenCity {
    experiment: Arc<Experiment>,
    noise: NoiseModel,
    snapshot: FrameSnapshot,
    tracks: BTreeMap<VehicleId, Track>,
    /// All that have been seen.
    met: BTreeSet<VehicleId>,
}

/// What is known of a vehicle, city metres.
#[derive(Debug)]
struct Track {
    filter: MotionFilter,
    odometer: Odometer,
}

impl Track {
    fn new(filter: MotionFilter) -> Self {
        Self { filter, odometer: Odometer::default() }
    }
}

/// A vehicle at one instant. City metres.
#[derive(Clone, Copy, Debug)]
pub struct SeenMotion {
    pub vehicle: VehicleId,
    pub status: Status,
    /// On the ground.
    pub position: DVec3,
    /// City from body.
    pub orientation: DQuat,
    /// `None` of one that nobody sees: it is kept somewhere.
    pub motion: Option<MotionEstimate>,
}

impl SeenMotion {
    /// Of a vehicle whose motion in the plane is all that is known.
    pub fn planar(vehicle: VehicleId, status: Status, motion: &MotionEstimate) -> Self {
        let (position, orientation) = (motion.pose.position.extend(0.0), turned(motion.pose.yaw_rad));
        Self { vehicle, status, position, orientation, motion: Some(*motion) }
    }
}

fn turned(yaw_rad: f64) -> DQuat {
    let (sin, cos) = trig::sin_cos(yaw_rad / 2.0);
    DQuat::from_xyzw(0.0, 0.0, sin, cos)
}

/// Of the city's poses of physical vehicles, which are estimates by themselves: their errors last for some poses, so
/// that they are no smaller than measured ones, and they cannot be told from motion.
fn carried_noise(noise: NoiseModel, experiment: &Experiment) -> NoiseModel {
    let laboratory = [&EnvironmentSpec::TESTBED, &experiment.testbed];
    let position_m = laboratory.map(|spec| spec.position_noise_m).into_iter().fold(0.0, f64::max);
    let heading_rad = laboratory.map(|spec| spec.yaw_noise_rad).into_iter().fold(0.0, f64::max);
    noise.stated(LASTING * experiment.scale.city_from_lab(position_m), heading_rad)
}

impl SeenCity {
    pub fn new(experiment: Arc<Experiment>) -> Self {
        let noise = NoiseModel::LABORATORY.scaled(experiment.scale.factor());
        let (tracks, met) = (BTreeMap::new(), BTreeSet::new());
        Self { experiment, noise, snapshot: FrameSnapshot::default(), tracks, met }
    }

    pub fn snapshot(&self) -> &FrameSnapshot {
        &self.snapshot
    }

    /// Takes the poses of one tick in, of all its parts.
    pub fn see(&mut self, head: &Poses, vehicles: &[Seen]) -> &FrameSnapshot {
        let motions: Vec<SeenMotion> = vehicles.iter().map(|seen| self.estimate(head.time_s, seen)).collect();
        self.show(head, &motions)
    }

    /// Takes a pose in, and tells where the vehicle is at a time.
    fn estimate(&mut self, time_s: f64, seen: &Seen) -> SeenMotion {
        let Measurement { vehicle, stamp_s, position, orientation } = seen.pose;
        let position = position * self.experiment.scale.factor();
        let told = SeenMotion { vehicle, status: seen.status, position, orientation, motion: None };
        if seen.status == Status::Unseen {
            return told;
        }
        let forward = orientation * DVec3::X;
        let pose = Pose2 { position: position.truncate(), yaw_rad: trig::atan2(forward.y, forward.x) };
        let start_mps = self.start_mps(time_s, seen);
        let experiment = &self.experiment;
        let track = self.tracks.entry(vehicle).or_insert_with(|| {
            let noise = if experiment.is_physical(vehicle) {
                carried_noise(self.noise, experiment)
            } else {
                self.noise
            };
            Track::new(match start_mps {
                Some(speed_mps) => MotionFilter::moving(noise, stamp_s, pose, speed_mps),
                None => MotionFilter::new(noise),
            })
        });
        track.filter.update(stamp_s, pose);
        let motion = track.filter.at(time_s);
        let Some(at) = motion.map(|motion| motion.pose) else { return told };
        SeenMotion {
            position: at.position.extend(position.z),
            orientation: turned(at.yaw_rad - pose.yaw_rad) * orientation,
            motion,
            ..told
        }
    }

    /// The speed with which a simulated vehicle is set up at the beginning of the experiment.
    fn start_mps(&self, time_s: f64, seen: &Seen) -> Option<f64> {
        let planned = self.experiment.vehicles.iter().find(|planned| planned.id == seen.pose.vehicle)?;
        let is_start = time_s == 0.0 && planned.physical.is_none();
        is_start.then(|| self.experiment.scale.city_from_lab(planned.start.speed_mps))
    }

    /// Makes the snapshot of one tick out of the vehicles' motions, in the order of their ids.
    pub fn show(&mut self, head: &Poses, vehicles: &[SeenMotion]) -> &FrameSnapshot {
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

    /// Its state, after its odometer has counted; comes to a stand or moves off.
    fn state_of(&mut self, seen: &SeenMotion, is_later: bool) -> VehicleState {
        let SeenMotion { vehicle: id, status, position, orientation, motion } = *seen;
        let mut state = VehicleState { id, status, position, orientation, ..VehicleState::default() };
        let (noise, is_physical) = (self.noise, self.experiment.is_physical(id));
        let track = self.tracks.entry(id).or_insert_with(|| Track::new(MotionFilter::new(noise)));
        // Of a physical vehicle the city has found out with all its poses whether it stands.
        let found_to_stand = match status {
            _ if !is_physical => None,
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
                StandChange::Stopped => EventKind::Stop,
                StandChange::MovedOff { stood_s } => EventKind::Go { stood_s },
            });
            let time_s = self.snapshot.time_s;
            self.snapshot.events.extend(kind.map(|kind| Event { time_s, vehicle: id, kind }));
            let told = track.odometer.told(motion);
            state.velocity_mps = told.velocity_mps.extend(0.0);
            state.speed_mps = told.speed_mps;
            state.acceleration_mps2 = told.acceleration_mps2;
            state.yaw_rate_radps = told.yaw_rate_radps;
        }
        state.distance_m = track.odometer.distance_m();
        state
    }

    /// What has happened to a vehicle since its status before, `None` where it was not there.
    fn note(&mut self, seen: &SeenMotion, old: Option<Status>) {
        let (time_s, vehicle, status) = (self.snapshot.time_s, seen.vehicle, seen.status);
        let is_met = self.met.insert(vehicle);
        let mut happened = |kind| self.snapshot.events.push(Event { time_s, vehicle, kind });
        if old.is_none() {
            happened(if is_met { EventKind::Spawn } else { EventKind::SeenAgain });
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
