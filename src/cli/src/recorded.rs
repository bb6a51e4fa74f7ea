//! `city3d replay POSES`: makes a run of poses that were measured elsewhere, smoothed, with the same files as any run.

use super::files::{LogArgs, conclude};
use super::{Failure, ScenarioArgs, load, progress};
use city3d_estimation::{LONGEST_GAP_S, MotionEstimate, NoiseModel, smooth};
use city3d_geometry::Pose2;
use city3d_logbook::record::{
    COLUMNS, LogOrigin, POSE_COLUMNS, RecordedPose, is_log, is_ros1_bag, read_bag, read_poses,
};
use city3d_protocol::snapshot::{Status, VehicleId};
use city3d_protocol::wire::{ExperimentPhase, Poses};
use city3d_session::{Inputs, Moment, RunFiles, RunFolders};
use city3d_simulation::runner::{ObservedCity, ObservedMotion, Summary};
use city3d_simulation::scenario::Experiment;
use std::collections::BTreeMap;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Arguments of a replay of measured poses.
pub struct RecordedPoses<'a> {
    pub poses: &'a Path,
    pub scenario: &'a str,
    pub out: &'a Path,
    pub log: LogArgs,
    pub json: bool,
}

impl RecordedPoses<'_> {
    pub fn replay(&self) -> Result<(), Failure> {
        let poses = self.read()?;
        let times = || poses.values().flatten().map(|pose| pose.time_s);
        let (from_s, to_s) =
            (times().fold(f64::INFINITY, f64::min), times().fold(f64::NEG_INFINITY, f64::max));
        if to_s - from_s < 0.01 || to_s - from_s > 86_400.0 {
            let path = self.poses.display();
            return Err(Failure::bad_input(format!(
                "{path}: the poses span {} s; between 0.01 and 86400 s are needed",
                to_s - from_s
            )));
        }
        let scenario = self.scenario.to_owned();
        let args = ScenarioArgs { scenario, duration: Some(to_s - from_s), ..ScenarioArgs::default() };
        let experiment = load::experiment(&args)?;
        self.warn(&poses, &experiment);
        let summary = self.write(&poses, from_s, &experiment)?;
        conclude(&summary, &experiment, Some(self.out), self.json)
    }

    /// Rejects the `vehicles.csv` of a City3D run, which is in city metres.
    fn reject_own_table(&self) -> Result<(), Failure> {
        let text = std::fs::File::open(self.poses).map(BufReader::new).and_then(|mut file| {
            let mut line = String::new();
            file.read_line(&mut line).map(|_| line)
        });
        if text.is_ok_and(|header| header.trim_end() == COLUMNS.join(",")) {
            let (path, folder) = (self.poses.display(), self.poses.parent().unwrap_or(Path::new(".")));
            let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
            return Err(Failure::bad_input(format!(
                "{path} is the vehicles.csv of a run of City3D, in full-scale metres: watch the run itself with city3d \
                 replay {}. A table of poses has the columns {}, in laboratory metres",
                folder.display(),
                POSE_COLUMNS.join(", ")
            )));
        }
        Ok(())
    }

    /// Warns of poses that are probably wrong.
    fn warn(&self, poses: &BTreeMap<VehicleId, Vec<RecordedPose>>, experiment: &Experiment) {
        let path = self.poses.display();
        let from_s = poses.values().flatten().map(|pose| pose.time_s).fold(f64::INFINITY, f64::min);
        let strangers: Vec<String> = poses
            .keys()
            .filter(|id| experiment.vehicles.iter().all(|planned| planned.id != **id))
            .map(ToString::to_string)
            .collect();
        if !strangers.is_empty() {
            let known = experiment.vehicles.iter().map(|planned| format!("{} {}", planned.id, planned.name));
            tracing::warn!(
                "{path}: the scenario has no vehicle {}; it has {}. The unknown ones are shown with default dimensions",
                strangers.join(", "),
                known.take(20).collect::<Vec<_>>().join(", ")
            );
        }
        if let Some(share) = outside(poses, experiment) {
            let factor = experiment.scale.factor();
            tracing::warn!(
                "{path}: {:.0} % of the poses lie outside of the map. Poses must be in laboratory metres; if these are \
                 full-scale metres, divide x and y by {factor}",
                share * 100.0
            );
        }
        for (vehicle, poses) in poses {
            for (before, after) in gaps(poses) {
                tracing::warn!(
                    "{path}: vehicle {vehicle} was not measured from {:.2} s to {:.2} s and is absent for that time",
                    before - from_s,
                    after - from_s
                );
            }
        }
    }

    /// Reads the poses from a table, or from a bag by the names of the scenario's vehicles.
    fn read(&self) -> Result<BTreeMap<VehicleId, Vec<RecordedPose>>, Failure> {
        if !is_bag(self.poses) {
            self.reject_own_table()?;
            return read_poses(self.poses).map_err(Failure::bad_input);
        }
        let scenario = self.scenario.to_owned();
        let experiment = load::experiment(&ScenarioArgs { scenario, ..ScenarioArgs::default() })?;
        let named = experiment.vehicles.iter().map(|planned| (planned.name.clone(), planned.id));
        let tracked = experiment.physical().map(|(planned, physical)| (physical.subject.clone(), planned.id));
        read_bag(self.poses, &named.chain(tracked).collect()).map_err(Failure::bad_input)
    }

    fn write(
        &self,
        poses: &BTreeMap<VehicleId, Vec<RecordedPose>>,
        from_s: f64,
        experiment: &Arc<Experiment>,
    ) -> Result<Summary, Failure> {
        let folders = RunFolders::parts(Some(PathBuf::from(self.out)));
        let mut files = RunFiles::new(folders, LogOrigin::Recorded, self.log.options());
        files.begin(experiment)?;
        let mut city = ObservedCity::new(Arc::clone(experiment));
        let bar = progress::simulated_seconds(experiment.duration_s);
        let last = (experiment.duration_s * f64::from(experiment.rates.physics_hz) + 1e-6).floor() as u64;
        let mut smoothed = SmoothedMotions::new(poses, from_s, experiment);
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
                progress::show(&bar, time_s);
            }
        }
        bar.finish_and_clear();
        Ok(files.conclude(&Moment::first(experiment, city.snapshot()))?)
    }
}

/// Whether a file is a bag of ROS 1 or ROS 2 (MCAP).
fn is_bag(path: &Path) -> bool {
    is_ros1_bag(path) || is_log(path)
}

/// Poses farther than this from the bounds of the map are outside of it, laboratory metres.
const OUTSIDE_M: f64 = 1.0;
/// A larger share of poses outside of the map is reported.
const OUTSIDE_SHARE: f64 = 0.1;

/// The share of the poses outside of the map, where it exceeds [`OUTSIDE_SHARE`].
fn outside(poses: &BTreeMap<VehicleId, Vec<RecordedPose>>, experiment: &Experiment) -> Option<f64> {
    let [low, high] = experiment.city_map.bounds().map(|corner| corner / experiment.scale.factor());
    let is_outside = |pose: &&RecordedPose| {
        let at = pose.pose.position;
        at.cmplt(low - OUTSIDE_M).any() || at.cmpgt(high + OUTSIDE_M).any()
    };
    let all = || poses.values().flatten();
    let share = all().filter(is_outside).count() as f64 / all().count().max(1) as f64;
    (share > OUTSIDE_SHARE).then_some(share)
}

/// Gaps of the measurement, from and to, that are too long to bridge.
fn gaps(poses: &[RecordedPose]) -> impl Iterator<Item = (f64, f64)> {
    let times = poses.windows(2).map(|pair| (pair[0].time_s, pair[1].time_s));
    times.filter(|(before, after)| after - before > LONGEST_GAP_S)
}

/// Length of the chunks in which poses are smoothed, and the overlap on both sides that makes the result the same as
/// smoothing all poses at once.
const CHUNK_S: f64 = 60.0;
const OVERLAP_S: f64 = 5.0;

/// Motions of the vehicles at the ticks of the experiment, smoothed chunk by chunk. City metres.
struct SmoothedMotions<'a> {
    poses: &'a BTreeMap<VehicleId, Vec<RecordedPose>>,
    /// Stamp of the start of the experiment.
    from_s: f64,
    experiment: &'a Experiment,
    noise: NoiseModel,
    /// The first tick of the present chunk, and the motions from there on.
    first: u64,
    motions: BTreeMap<VehicleId, Vec<Option<MotionEstimate>>>,
}

impl<'a> SmoothedMotions<'a> {
    fn new(
        poses: &'a BTreeMap<VehicleId, Vec<RecordedPose>>,
        from_s: f64,
        experiment: &'a Experiment,
    ) -> Self {
        let noise = NoiseModel::LABORATORY.to_city(experiment.scale);
        Self { poses, from_s, experiment, noise, first: 0, motions: BTreeMap::new() }
    }

    fn ticks_per_chunk(&self) -> u64 {
        (CHUNK_S * f64::from(self.experiment.rates.physics_hz)) as u64
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
        let scale = self.experiment.scale;
        for (&vehicle, poses) in self.poses {
            let from = poses.partition_point(|pose| pose.time_s - self.from_s < begin_s);
            let to = poses.partition_point(|pose| pose.time_s - self.from_s <= end_s);
            let near = poses[from..to].iter();
            let near: Vec<(f64, Pose2)> =
                near.map(|pose| (pose.time_s - self.from_s, pose.pose.to_city(scale))).collect();
            self.motions.insert(vehicle, smooth(&self.noise, &near, &times_s));
        }
    }
}
