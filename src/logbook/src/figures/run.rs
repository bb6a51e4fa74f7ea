//! A run as read from its log, or as it is seen while it goes on: the input of figures and tables.

use super::track::MatchedPath;
use crate::record::{LogEntry, LogOrigin, LogReader, NetworkCommand, RecordError};
use city3d_geometry::Pose2;
use city3d_protocol::snapshot::{
    Aspect, Dimensions, Event, SimCommand, Status, Trajectory, VehicleId, VehicleInfo, VehicleState,
};
use city3d_protocol::wire::Body;
use city3d_roadmap::LaneIndex;
use city3d_simulation::scenario::Experiment;
use glam::DVec2;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use thiserror::Error;

/// A log that has nothing to draw.
#[derive(Debug, Error)]
pub enum RunError {
    /// The log cannot be read.
    #[error(transparent)]
    Log(#[from] RecordError),
    /// No snapshot has a vehicle; `why` is the reason where the log is truncated, else empty.
    #[error("{path}: the log has no vehicle in any snapshot: there is nothing to draw{why}")]
    Empty {
        /// Path of the log.
        path: PathBuf,
        /// Reason of the truncation in brackets, after a space; else empty.
        why: String,
    },
    /// A logged datagram of the laboratory's link cannot be decoded into commands.
    #[error("{path}: tick {tick}: what came over the link is damaged: {reason}")]
    Network {
        /// Path of the log.
        path: PathBuf,
        /// Tick at the beginning of the step that carried the datagram out.
        tick: u64,
        /// What is wrong with the datagram, in words.
        reason: String,
    },
}

/// A vehicle in one snapshot of a log, city metres and SI units. Of one that was not measured, pose and distance are the last
/// ones, and all else is NaN.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TraceSample {
    /// Simulated time of the snapshot, seconds.
    pub time_s: f64,
    /// Whether its motion was known: a physical vehicle may not be measured.
    pub is_seen: bool,
    /// Middle of the outline.
    pub pose: Pose2,
    /// Along the heading.
    pub speed_mps: f64,
    /// Along the heading.
    pub acceleration_mps2: f64,
    /// Counter-clockwise seen from above.
    pub yaw_rate_radps: f64,
    /// Steering angle of the front axle's middle, left-positive.
    pub steering_rad: f64,
    /// Distance driven since the start.
    pub distance_m: f64,
    /// Front-axle centre from the desired path, left-positive.
    pub lateral_error_m: f64,
    /// Pedals in [0, 1].
    pub gas: f64,
    /// Brake pedal in [0, 1].
    pub brake: f64,
    /// Handbrake in [0, 1].
    pub handbrake: f64,
    /// Distance from the front-axle centre to its reference on the last trajectory; NaN without one.
    pub tracking_error_m: f64,
}

/// One vehicle of a run.
#[derive(Clone, Debug)]
pub struct Trace {
    /// Number of the vehicle, unique in the run.
    pub id: VehicleId,
    /// Name in the scenario, or in the setup that came over the link; made from the number where both lack.
    pub name: String,
    /// Outline and wheelbase, city metres.
    pub dimensions: Dimensions,
    /// In order of time.
    pub samples: Vec<TraceSample>,
    /// Lanes that the front axle has followed, with the station of each sample.
    pub track: MatchedPath,
    /// The scenario has it as a vehicle of the laboratory.
    is_planned_physical: bool,
}

impl Trace {
    /// Station of the front bumper along the matched path, city metres; NaN off the lanes.
    pub fn front_m(&self, sample: usize) -> f64 {
        self.track.stations_m[sample] + (self.dimensions.length_m - self.dimensions.wheelbase_m) / 2.0
    }

    /// Station of the front bumper at the first sample of known motion that is not before a time, city metres; NaN off the
    /// lanes and after the last sample.
    pub fn front_at_m(&self, time_s: f64) -> f64 {
        let first = self.samples.partition_point(|sample| sample.time_s < time_s);
        let seen = self.samples[first..].iter().position(|sample| sample.is_seen);
        seen.map_or(f64::NAN, |later| self.front_m(first + later))
    }
}

/// A run with the traces of its vehicles.
#[derive(Debug)]
pub struct RunLog {
    /// File of the log; empty for a run that goes on.
    pub path: PathBuf,
    /// Kind of program that wrote the log.
    pub origin: LogOrigin,
    /// Scenario, map and settings, as embedded in the log.
    pub experiment: Arc<Experiment>,
    /// Version of City3D that wrote the log.
    pub version: String,
    /// Why the log is truncated, if it is.
    pub truncation: Option<String>,
    /// In id order.
    pub vehicles: Vec<Trace>,
    /// Of each signal head, in id order: the times at which it changed, and what it has shown from then on. Empty
    /// without signals.
    pub aspects: Vec<Vec<(f64, Aspect)>>,
    /// In order of time.
    pub events: Vec<Event>,
    /// Time of the last snapshot.
    pub end_s: f64,
    /// Whether physical vehicles took part.
    pub has_physical: bool,
}

impl RunLog {
    /// Reads a log, up to its last whole record.
    ///
    /// # Errors
    /// Where it is no log, or one without a vehicle in it.
    pub fn read(path: &Path) -> Result<Self, RunError> {
        let mut log = LogReader::open(path)?;
        let experiment = Arc::new(log.experiment()?);
        let mut builder = TraceBuilder::new(Arc::clone(&experiment));
        let mut events = Vec::new();
        while let Some(entry) = log.read()? {
            match entry {
                LogEntry::Event(event) => events.push(event),
                LogEntry::Command { command, .. } => builder.take(command),
                LogEntry::Network(command) => {
                    let damaged =
                        |reason| RunError::Network { path: path.into(), tick: command.tick, reason };
                    commands_of(&command, &experiment)
                        .map_err(damaged)?
                        .into_iter()
                        .for_each(|c| builder.take(c));
                }
                LogEntry::Snapshot(snapshot) => {
                    builder.see_signals(snapshot.time_s, &snapshot.signals);
                    let vehicles = snapshot.vehicles.iter();
                    vehicles.for_each(|vehicle| builder.see(snapshot.time_s, &vehicle.state()));
                }
                LogEntry::Tick { .. }
                | LogEntry::Arrival { .. }
                | LogEntry::Decisions(_)
                | LogEntry::Plans(_) => {}
            }
        }
        let truncation = log.truncation().map(ToString::to_string);
        if builder.traces.is_empty() {
            let why = truncation.map(|why| format!(" ({why})")).unwrap_or_default();
            return Err(RunError::Empty { path: path.to_path_buf(), why });
        }
        let version = log.version().to_owned();
        Ok(Self { path: path.to_path_buf(), version, truncation, events, ..builder.finish(log.origin()) })
    }

    /// The trace of a vehicle; `None` where no snapshot has it.
    pub fn vehicle(&self, id: VehicleId) -> Option<&Trace> {
        self.vehicles.binary_search_by_key(&id, |trace| trace.id).ok().map(|index| &self.vehicles[index])
    }

    /// Converts city to laboratory lengths, speeds or accelerations.
    pub fn lab(&self, city: f64) -> f64 {
        self.experiment.scale.lab_from_city(city)
    }
}

fn commands_of(command: &NetworkCommand, experiment: &Experiment) -> Result<Vec<SimCommand>, String> {
    let body = Body::from_log(command.kind, &command.body).map_err(|error| error.to_string())?;
    body.into_commands(experiment.scale, &experiment.vehicle_types)
}

/// Builds the traces of a run, from a log or while it goes on.
#[derive(Clone, Debug)]
pub struct TraceBuilder {
    experiment: Arc<Experiment>,
    traces: BTreeMap<VehicleId, Trace>,
    aspects: Vec<Vec<(f64, Aspect)>>,
    /// Names and dimensions of vehicles that came over the link.
    set_up: BTreeMap<VehicleId, (String, Dimensions)>,
    /// The last trajectory of each vehicle.
    wanted: BTreeMap<VehicleId, Trajectory>,
    end_s: f64,
    has_physical: bool,
}

impl TraceBuilder {
    /// No vehicle of the experiment has been seen yet.
    pub fn new(experiment: Arc<Experiment>) -> Self {
        let (traces, set_up, wanted) = (BTreeMap::new(), BTreeMap::new(), BTreeMap::new());
        Self { experiment, traces, aspects: Vec::new(), set_up, wanted, end_s: 0.0, has_physical: false }
    }

    /// The traces so far, in id order; nothing is known of their lanes.
    pub fn traces(&self) -> impl Iterator<Item = &Trace> {
        self.traces.values()
    }

    /// Takes name and dimensions of a vehicle that the experiment does not plan.
    pub fn describe(&mut self, info: &VehicleInfo) {
        if !self.traces.contains_key(&info.id) && !self.set_up.contains_key(&info.id) {
            self.set_up.insert(info.id, (info.name.clone(), info.dimensions));
        }
    }

    /// Matches the traces to lanes.
    pub fn finish(self, origin: LogOrigin) -> RunLog {
        let Self { experiment, traces, aspects, end_s, has_physical, .. } = self;
        let mut vehicles: Vec<Trace> = traces.into_values().collect();
        let lanes = LaneIndex::new(&experiment.city_map);
        for trace in &mut vehicles {
            let axle_m = trace.dimensions.front_axle_m();
            let poses: Vec<Pose2> = trace.samples.iter().map(|sample| sample.pose.advanced(axle_m)).collect();
            trace.track = MatchedPath::of(&experiment.city_map, &lanes, &poses);
            // Nobody knows where it was.
            for (k, _) in trace.samples.iter().enumerate().filter(|(_, sample)| !sample.is_seen) {
                (trace.track.stations_m[k], trace.track.lateral_m[k]) = (f64::NAN, f64::NAN);
            }
            if !origin.has_world() {
                // Logs of poses have no desired path: the offset from the lane centre replaces the lateral error.
                let lateral = trace.track.lateral_m.iter();
                trace.samples.iter_mut().zip(lateral).for_each(|(sample, &m)| sample.lateral_error_m = m);
            }
        }
        RunLog {
            path: PathBuf::new(),
            origin,
            experiment,
            version: String::new(),
            truncation: None,
            vehicles,
            aspects,
            events: Vec::new(),
            end_s,
            has_physical,
        }
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

    /// Adds what the signal heads show at a time; an earlier time than the last change begins all anew.
    pub fn see_signals(&mut self, time_s: f64, aspects: &[Aspect]) {
        let is_reset = |changes: &Vec<(f64, Aspect)>| changes.last().is_some_and(|last| last.0 >= time_s);
        if self.aspects.len() != aspects.len() || self.aspects.iter().any(is_reset) {
            self.aspects = vec![Vec::new(); aspects.len()];
        }
        for (changes, &aspect) in self.aspects.iter_mut().zip(aspects) {
            if changes.last().is_none_or(|last| last.1 != aspect) {
                changes.push((time_s, aspect));
            }
        }
    }

    fn begin(&self, id: VehicleId) -> Trace {
        let planned = self.experiment.planned(id);
        let planned = planned.map(|planned| (planned.name.clone(), planned.spec.dimensions));
        let unknown =
            || (format!("vehicle{id}"), city3d_protocol::snapshot::VehicleSpec::default().dimensions);
        let (name, dimensions) = planned.or_else(|| self.set_up.get(&id).cloned()).unwrap_or_else(unknown);
        let is_planned_physical = self.experiment.is_physical(id);
        let (samples, track) = (Vec::new(), MatchedPath::default());
        Trace { id, name, dimensions, samples, track, is_planned_physical }
    }

    /// Adds the state of a vehicle at a time; an earlier time than the last one begins its trace anew.
    pub fn see(&mut self, time_s: f64, state: &VehicleState) {
        self.end_s = self.end_s.max(time_s);
        if !self.traces.contains_key(&state.id) {
            self.traces.insert(state.id, self.begin(state.id));
        }
        let Some(trace) = self.traces.get_mut(&state.id) else { return };
        let is_physical = state.status == Status::Physical || trace.is_planned_physical;
        self.has_physical |= is_physical;
        // After a reset of the city the trace starts again.
        if trace.samples.last().is_some_and(|last| last.time_s >= time_s) {
            trace.samples.clear();
        }
        let pose = state.pose();
        let axle = pose.point_at(trace.dimensions.front_axle_m(), 0.0);
        let wanted = self.wanted.get(&state.id).and_then(|trajectory| wanted_at(trajectory, time_s));
        // The zeros of a vehicle that is not measured are no measurements.
        let is_seen = state.status != Status::Unseen;
        let known = |value: f64| if is_seen { value } else { f64::NAN };
        // What drives a vehicle of the laboratory is not measured: its own algorithms decide it.
        let pedal = |value: f64| if is_physical { f64::NAN } else { known(value) };
        trace.samples.push(TraceSample {
            time_s,
            is_seen,
            pose,
            speed_mps: known(state.speed_mps),
            acceleration_mps2: known(state.acceleration_mps2),
            yaw_rate_radps: known(state.yaw_rate_radps),
            steering_rad: known(state.steering_rad),
            distance_m: state.distance_m,
            lateral_error_m: known(state.tracked_lateral_error_m().unwrap_or(f64::NAN)),
            gas: pedal(state.gas),
            brake: pedal(state.brake),
            handbrake: pedal(state.handbrake),
            tracking_error_m: known(wanted.map_or(f64::NAN, |wanted| wanted.distance(axle))),
        });
    }
}

/// Reference of the front-axle centre at a time: linear interpolation of the trajectory.
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
