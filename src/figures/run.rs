//! A run as its log tells it: what figures and tables are made from.

use super::track::{Boxes, Track};
use crate::environment::EnvironmentSpec;
use crate::geom::Pose2;
use crate::record::{Entry, LogReader, LoggedVehicle, NetworkCommand, Origin, RecordError};
use crate::scenario::Experiment;
use crate::snapshot::{Dimensions, Event, SimCommand, Status, Trajectory, VehicleId};
use crate::wire::Body;
use glam::DVec2;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// A log from which nothing can be drawn.
#[derive(Debug, Error)]
pub enum RunError {
    #[error(transparent)]
    Log(#[from] RecordError),
    #[error("{path}: the log has no vehicle in any snapshot: there is nothing to draw{why}")]
    Empty { path: PathBuf, why: String },
    #[error("{path}: tick {tick}: what came over the link is damaged: {reason}")]
    Network { path: PathBuf, tick: u64, reason: String },
}

/// A vehicle in one snapshot of a log, city metres and SI units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    pub time_s: f64,
    /// Middle of the outline.
    pub pose: Pose2,
    /// Along the heading.
    pub speed_mps: f64,
    /// Driven since the beginning.
    pub distance_m: f64,
    /// Front-axle centre from the desired path, left-positive.
    pub lateral_error_m: f64,
    /// Pedals in [0, 1].
    pub gas: f64,
    pub brake: f64,
    pub handbrake: f64,
    /// From the front-axle centre to where the last trajectory wants it now; not a number without one.
    pub tracking_error_m: f64,
}

/// One vehicle of a run.
#[derive(Clone, Debug)]
pub struct Trace {
    pub id: VehicleId,
    pub name: String,
    pub dimensions: Dimensions,
    /// In order of time.
    pub samples: Vec<Sample>,
    pub track: Track,
}

impl Trace {
    /// Front bumper along the vehicle's way, city metres; not a number off the lanes.
    pub fn front_m(&self, sample: usize) -> f64 {
        self.track.stations_m[sample] + (self.dimensions.length_m - self.dimensions.wheelbase_m) / 2.0
    }
}

/// A run as its log tells it.
#[derive(Debug)]
pub struct RunLog {
    pub path: PathBuf,
    pub origin: Origin,
    pub experiment: Experiment,
    /// Of City3D that has written the log.
    pub version: String,
    /// Why the log has no end, where it is torn.
    pub torn: Option<String>,
    /// In id order.
    pub vehicles: Vec<Trace>,
    /// In order of time.
    pub events: Vec<Event>,
    /// Of the last snapshot.
    pub end_s: f64,
    /// Vehicles of the laboratory were among them.
    pub has_physical: bool,
}

impl RunLog {
    /// Reads a log, up to its last whole record.
    ///
    /// # Errors
    /// Where it is no log, or one without a vehicle in it.
    pub fn read(path: &Path) -> Result<Self, RunError> {
        let mut log = LogReader::open(path)?;
        let experiment = log.experiment()?;
        let mut reading = Reading::new(&experiment);
        let mut events = Vec::new();
        while let Some(entry) = log.read()? {
            match entry {
                Entry::Event(event) => events.push(event),
                Entry::Command { command, .. } => reading.take(command),
                Entry::Network(command) => {
                    let damaged =
                        |reason| RunError::Network { path: path.into(), tick: command.tick, reason };
                    commands_of(&command, &experiment)
                        .map_err(damaged)?
                        .into_iter()
                        .for_each(|c| reading.take(c));
                }
                Entry::Snapshot(snapshot) => {
                    let vehicles = snapshot.vehicles.iter();
                    vehicles.for_each(|vehicle| reading.see(snapshot.time_s, vehicle));
                }
                Entry::Tick { .. } => {}
            }
        }
        let torn = log.torn().map(str::to_owned);
        if reading.traces.is_empty() {
            let why = torn.map(|why| format!(" ({why})")).unwrap_or_default();
            return Err(RunError::Empty { path: path.to_path_buf(), why });
        }
        let (origin, version) = (log.origin(), log.version().to_owned());
        let Reading { traces, end_s, has_physical, .. } = reading;
        let mut vehicles: Vec<Trace> = traces.into_values().collect();
        let boxes = Boxes::of(&experiment.city_map);
        for trace in &mut vehicles {
            let axle_m = trace.dimensions.front_axle_m();
            let poses: Vec<Pose2> = trace.samples.iter().map(|sample| sample.pose.advanced(axle_m)).collect();
            trace.track = Track::of(&experiment.city_map, &boxes, &poses);
            if !origin.has_world() {
                // It has no path of its own: how far from the middle of the lane takes its place.
                let lateral = trace.track.lateral_m.iter();
                trace.samples.iter_mut().zip(lateral).for_each(|(sample, &m)| sample.lateral_error_m = m);
            }
        }
        let path = path.to_path_buf();
        Ok(Self { path, origin, experiment, version, torn, vehicles, events, end_s, has_physical })
    }

    pub fn vehicle(&self, id: VehicleId) -> Option<&Trace> {
        self.vehicles.binary_search_by_key(&id, |trace| trace.id).ok().map(|index| &self.vehicles[index])
    }

    /// What stood between control framework and vehicles, as figures say it.
    pub fn setting(&self) -> &'static str {
        if self.has_physical {
            "physical"
        } else if self.experiment.environment == EnvironmentSpec::IDEAL {
            "ideal"
        } else {
            "testbed emulator"
        }
    }

    /// Laboratory metres of city metres, and the same of speeds and accelerations.
    pub fn lab(&self, city: f64) -> f64 {
        self.experiment.scale.lab_from_city(city)
    }
}

fn commands_of(command: &NetworkCommand, experiment: &Experiment) -> Result<Vec<SimCommand>, String> {
    let body = Body::from_log(command.kind, &command.body).map_err(|error| error.to_string())?;
    body.into_commands(experiment.scale, &experiment.vehicle_types)
}

/// A log while it is read.
struct Reading<'a> {
    experiment: &'a Experiment,
    traces: BTreeMap<VehicleId, Trace>,
    /// Of vehicles that came over the link.
    set_up: BTreeMap<VehicleId, (String, Dimensions)>,
    /// The last one of each vehicle.
    wanted: BTreeMap<VehicleId, Trajectory>,
    end_s: f64,
    has_physical: bool,
}

impl<'a> Reading<'a> {
    fn new(experiment: &'a Experiment) -> Self {
        let (traces, set_up, wanted) = (BTreeMap::new(), BTreeMap::new(), BTreeMap::new());
        Self { experiment, traces, set_up, wanted, end_s: 0.0, has_physical: false }
    }

    fn take(&mut self, command: SimCommand) {
        match command {
            SimCommand::Spawn(setup) => {
                self.set_up.insert(setup.id, (setup.name, setup.spec.dimensions));
            }
            SimCommand::Follow(trajectory) => {
                self.wanted.insert(trajectory.vehicle, trajectory);
            }
            _ => {}
        }
    }

    fn begin(&self, id: VehicleId) -> Trace {
        let planned = self.experiment.vehicles.iter().find(|planned| planned.id == id);
        let planned = planned.map(|planned| (planned.name.clone(), planned.spec.dimensions));
        let unknown = || (format!("vehicle{id}"), crate::snapshot::VehicleSpec::default().dimensions);
        let (name, dimensions) = planned.or_else(|| self.set_up.get(&id).cloned()).unwrap_or_else(unknown);
        Trace { id, name, dimensions, samples: Vec::new(), track: Track::default() }
    }

    fn see(&mut self, time_s: f64, vehicle: &LoggedVehicle) {
        let state = vehicle.state();
        self.end_s = self.end_s.max(time_s);
        self.has_physical |= state.status == Status::Physical;
        if !self.traces.contains_key(&state.id) {
            self.has_physical |= self.experiment.is_physical(state.id);
            self.traces.insert(state.id, self.begin(state.id));
        }
        let Some(trace) = self.traces.get_mut(&state.id) else { return };
        // A city that was set back begins anew, and with it the trace.
        if trace.samples.last().is_some_and(|last| last.time_s >= time_s) {
            trace.samples.clear();
        }
        let pose = state.pose();
        let axle = pose.point_at(trace.dimensions.front_axle_m(), 0.0);
        let wanted = self.wanted.get(&state.id).and_then(|trajectory| wanted_at(trajectory, time_s));
        trace.samples.push(Sample {
            time_s,
            pose,
            speed_mps: state.speed_mps,
            distance_m: state.distance_m,
            lateral_error_m: state.told_lateral_error_m().unwrap_or(f64::NAN),
            gas: state.gas,
            brake: state.brake,
            handbrake: state.handbrake,
            tracking_error_m: wanted.map_or(f64::NAN, |wanted| wanted.distance(axle)),
        });
    }
}

/// Where a trajectory wants the front-axle centre at a time.
fn wanted_at(trajectory: &Trajectory, time_s: f64) -> Option<DVec2> {
    let after = trajectory.points.partition_point(|point| point.time_s <= time_s);
    let (next, last) = (trajectory.points.get(after), trajectory.points.get(after.checked_sub(1)?));
    match (last, next) {
        (Some(a), Some(b)) => {
            let share = (time_s - a.time_s) / (b.time_s - a.time_s);
            Some(a.pose.position.lerp(b.pose.position, share))
        }
        (Some(a), None) => Some(a.pose.position),
        _ => None,
    }
}
