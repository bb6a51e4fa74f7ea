//! Runs of poses that were measured elsewhere: a table or a bag is smoothed into the motions of the vehicles, and written
//! with the same files as any run.

use super::{Inputs, Moment, RunFiles, SessionError};
use city3d_estimation::{LONGEST_GAP_S, MotionEstimate, NoiseModel, smooth};
use city3d_geometry::Pose2;
use city3d_logbook::record::{COLUMNS, POSE_COLUMNS, RecordError, RecordedPose, read_bag, read_poses};
use city3d_protocol::snapshot::{Status, VehicleId};
use city3d_protocol::wire::{ExperimentPhase, Poses};
use city3d_simulation::runner::{ObservedCity, ObservedMotion, Summary};
use city3d_simulation::scenario::Experiment;
use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use thiserror::Error;

/// Shortest and longest time that poses may span, seconds.
const SPAN_S: std::ops::RangeInclusive<f64> = 0.01..=86_400.0;

/// Why measured poses make no run.
#[derive(Debug, Error)]
pub enum RecordedPosesError {
    /// The file cannot be read, or is no table and no bag of poses.
    #[error(transparent)]
    File(#[from] RecordError),
    /// The file is the `vehicles.csv` of a run of City3D, which is in city metres.
    #[error(
        "{path} is the vehicles.csv of a run of City3D, in full-scale metres: watch the run itself with city3d \
         replay {folder}. A table of poses has the columns {columns}, in laboratory metres",
        path = path.display(), folder = folder_of(path).display(), columns = POSE_COLUMNS.join(", ")
    )]
    OwnTable {
        /// Path of the table.
        path: PathBuf,
    },
    /// The poses span too short or too long a time.
    #[error(
        "{path}: the poses span {span_s} s; between {} and {} s are needed",
        SPAN_S.start(), SPAN_S.end(), path = path.display()
    )]
    Span {
        /// Path of the file.
        path: PathBuf,
        /// Time from the first pose to the last, seconds.
        span_s: f64,
    },
}

/// The folder of a file, as it can be given on a command line.
fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// The first line of a file, or so many bytes of it.
fn first_line(path: &Path, most: u64) -> std::io::Result<String> {
    let mut line = String::new();
    BufReader::new(std::fs::File::open(path)?).take(most).read_line(&mut line)?;
    Ok(line)
}

/// Time in which a vehicle was not measured, too long to bridge. Seconds since the first pose of all vehicles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeasurementGap {
    /// The vehicle, which is absent for that time.
    pub vehicle: VehicleId,
    /// Time of the last pose before the gap.
    pub from_s: f64,
    /// Time of the first pose after it.
    pub to_s: f64,
}

/// Poses of vehicles that were measured elsewhere, laboratory metres.
#[derive(Clone, Debug)]
pub struct RecordedPoses {
    /// In order of time.
    poses: BTreeMap<VehicleId, Vec<RecordedPose>>,
    /// Stamps of the first and the last pose.
    from_s: f64,
    to_s: f64,
}

impl RecordedPoses {
    /// Reads a table.
    ///
    /// # Errors
    /// When it cannot be read, is in city metres, or its poses span no suitable time.
    pub fn of_table(path: &Path) -> Result<Self, RecordedPosesError> {
        let own = COLUMNS.join(",");
        let poses = read_poses(path);
        let is_own = || first_line(path, own.len() as u64 + 2).is_ok_and(|line| line.trim_end() == own);
        if matches!(poses, Err(RecordError::Poses { .. })) && is_own() {
            return Err(RecordedPosesError::OwnTable { path: path.to_path_buf() });
        }
        Self::new(path, poses?)
    }

    /// Reads a bag, by the names of the scenario's vehicles and of their subjects.
    ///
    /// # Errors
    /// When it cannot be read, or its poses span no suitable time.
    pub fn of_bag(path: &Path, experiment: &Experiment) -> Result<Self, RecordedPosesError> {
        let named = experiment.vehicles.iter().map(|planned| (planned.name.clone(), planned.id));
        let tracked = experiment.physical().map(|(planned, physical)| (physical.subject.clone(), planned.id));
        Self::new(path, read_bag(path, &named.chain(tracked).collect())?)
    }

    fn new(path: &Path, poses: BTreeMap<VehicleId, Vec<RecordedPose>>) -> Result<Self, RecordedPosesError> {
        let times = || poses.values().flatten().map(|pose| pose.time_s);
        let (from_s, to_s) =
            (times().fold(f64::INFINITY, f64::min), times().fold(f64::NEG_INFINITY, f64::max));
        let span_s = to_s - from_s;
        if span_s < *SPAN_S.start() || span_s > *SPAN_S.end() {
            return Err(RecordedPosesError::Span { path: path.to_path_buf(), span_s });
        }
        Ok(Self { poses, from_s, to_s })
    }

    /// Time from the first pose to the last, seconds.
    pub fn duration_s(&self) -> f64 {
        self.to_s - self.from_s
    }

    /// Vehicles that the scenario does not have.
    pub fn strangers(&self, experiment: &Experiment) -> Vec<VehicleId> {
        let is_strange = |id: &&VehicleId| experiment.vehicles.iter().all(|planned| planned.id != **id);
        self.poses.keys().filter(is_strange).copied().collect()
    }

    /// The share of the poses outside of the map, where it is so large that the poses are probably wrong.
    pub fn share_outside(&self, experiment: &Experiment) -> Option<f64> {
        let [low, high] = experiment.city_map.bounds().map(|corner| corner / experiment.scale.factor());
        let is_outside = |pose: &&RecordedPose| {
            let at = pose.pose.position;
            at.cmplt(low - OUTSIDE_M).any() || at.cmpgt(high + OUTSIDE_M).any()
        };
        let all = || self.poses.values().flatten();
        let share = all().filter(is_outside).count() as f64 / all().count().max(1) as f64;
        (share > OUTSIDE_SHARE).then_some(share)
    }

    /// Times in which vehicles were not measured and are absent, by vehicle.
    pub fn gaps(&self) -> impl Iterator<Item = MeasurementGap> {
        self.poses.iter().flat_map(move |(&vehicle, poses)| {
            let times = poses.windows(2).map(|pair| (pair[0].time_s, pair[1].time_s));
            times.filter(|(before, after)| after - before > LONGEST_GAP_S).map(move |(before, after)| {
                MeasurementGap { vehicle, from_s: before - self.from_s, to_s: after - self.from_s }
            })
        })
    }

    /// Writes the files of the run for the duration of the experiment, or until `stop` is set; `progress` hears the
    /// simulated time.
    ///
    /// # Errors
    /// When a file cannot be written.
    pub fn write(
        &self,
        experiment: &Arc<Experiment>,
        mut files: RunFiles,
        stop: &AtomicBool,
        progress: &mut dyn FnMut(f64),
    ) -> Result<Summary, SessionError> {
        let mut city = ObservedCity::new(Arc::clone(experiment));
        let last = (experiment.duration_s * f64::from(experiment.rates.physics_hz) + 1e-6).floor() as u64;
        let mut smoothed = SmoothedMotions::new(self, experiment);
        let mut is_stopped = false;
        for tick in 0..=last {
            let time_s = experiment.rates.time_s(tick);
            let head = Poses {
                tick,
                time_s,
                state_hash: 0,
                phase: ExperimentPhase::Running,
                part: 0,
                parts: 1,
                vehicles: Vec::new(),
            };
            let snapshot = city.build_snapshot(&head, &smoothed.at(tick));
            let moment = match tick {
                0 => Moment::first(experiment, snapshot),
                _ => Moment::tick(experiment, snapshot, Inputs::None, None, (tick - 1, time_s)),
            };
            files.record_or_fail(&moment)?;
            if tick % 100 == 0 {
                progress(time_s);
            }
            is_stopped = tick < last && stop.load(Ordering::Relaxed);
            if is_stopped {
                break;
            }
        }
        files.conclude(&Moment::first(experiment, city.snapshot()), is_stopped)
    }
}

/// Poses farther than this from the bounds of the map are outside of it, laboratory metres.
const OUTSIDE_M: f64 = 1.0;
/// A larger share of poses outside of the map is reported.
const OUTSIDE_SHARE: f64 = 0.1;

/// Length of the chunks in which poses are smoothed, and the overlap on both sides that makes the result the same as
/// smoothing all poses at once.
const CHUNK_S: f64 = 60.0;
const OVERLAP_S: f64 = 5.0;
/// Most motions of all vehicles in a chunk, which has 1 s at least: many vehicles have shorter chunks.
const MOST_MOTIONS: u64 = 1_000_000;

/// Motions of the vehicles at the ticks of the experiment, smoothed chunk by chunk. City metres.
struct SmoothedMotions<'a> {
    recorded: &'a RecordedPoses,
    experiment: &'a Experiment,
    noise: NoiseModel,
    /// The first tick of the present chunk, and the motions from there on.
    first: u64,
    motions: BTreeMap<VehicleId, Vec<Option<MotionEstimate>>>,
}

impl<'a> SmoothedMotions<'a> {
    fn new(recorded: &'a RecordedPoses, experiment: &'a Experiment) -> Self {
        let noise = NoiseModel::LABORATORY.to_city(experiment.scale);
        Self { recorded, experiment, noise, first: 0, motions: BTreeMap::new() }
    }

    fn ticks_per_chunk(&self) -> u64 {
        let second = u64::from(self.experiment.rates.physics_hz);
        let most = MOST_MOTIONS / (self.recorded.poses.len() as u64).max(1);
        most.clamp(second, CHUNK_S as u64 * second)
    }

    /// Motions of the vehicles that are present at a tick. Ticks come in order.
    fn at(&mut self, tick: u64) -> Vec<ObservedMotion> {
        if self.motions.is_empty() || tick >= self.first + self.ticks_per_chunk() {
            self.smooth_from(tick);
        }
        let index = (tick - self.first) as usize;
        let motion = |(&vehicle, motions): (&VehicleId, &Vec<Option<MotionEstimate>>)| {
            let motion = (*motions.get(index)?)?;
            Some(ObservedMotion::planar(vehicle, Status::Physical, &motion))
        };
        self.motions.iter().filter_map(motion).collect()
    }

    fn smooth_from(&mut self, first: u64) {
        self.first = first;
        let times_s: Vec<f64> =
            (first..first + self.ticks_per_chunk()).map(|tick| self.experiment.rates.time_s(tick)).collect();
        let (begin_s, end_s) = (times_s[0] - OVERLAP_S, times_s[times_s.len() - 1] + OVERLAP_S);
        let (scale, start_s) = (self.experiment.scale, self.recorded.from_s);
        for (&vehicle, poses) in &self.recorded.poses {
            let from = poses.partition_point(|pose| pose.time_s - start_s < begin_s);
            let to = poses.partition_point(|pose| pose.time_s - start_s <= end_s);
            let near = poses[from..to].iter();
            let near: Vec<(f64, Pose2)> =
                near.map(|pose| (pose.time_s - start_s, pose.pose.to_city(scale))).collect();
            self.motions.insert(vehicle, smooth(&self.noise, &near, &times_s));
        }
    }
}
