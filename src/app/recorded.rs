//! `city3d replay POSES`: vehicles that were measured elsewhere drive as they were recorded, into the same files
//! as any run.

use super::files::{Files, LogArgs, conclude};
use super::{Failure, ScenarioArgs, load, progress};
use crate::estimation::{LONGEST_GAP_S, MotionEstimate, NoiseModel, smooth};
use crate::geom::Pose2;
use crate::record::{COLUMNS, MeasuredPose, Origin, POSE_COLUMNS, is_log, is_ros1_bag, read_bag, read_poses};
use crate::runner::{SeenCity, SeenMotion, Summary};
use crate::scenario::Experiment;
use crate::snapshot::{Status, VehicleId};
use crate::wire::{Phase, Poses};
use std::collections::BTreeMap;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Poses with the scenario that they are of.
pub struct Recorded<'a> {
    pub poses: &'a Path,
    pub scenario: &'a str,
    pub out: &'a Path,
    pub log: LogArgs,
    pub json: bool,
}

impl Recorded<'_> {
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

    /// The table of a run of ours is no table of poses: it is of the city, and its run can be watched itself.
    fn tell_own_table(&self) -> Result<(), Failure> {
        let text = std::fs::File::open(self.poses).map(BufReader::new).and_then(|mut file| {
            let mut line = String::new();
            file.read_line(&mut line).map(|_| line)
        });
        if text.is_ok_and(|header| header.trim_end() == COLUMNS.join(",")) {
            let (path, folder) = (self.poses.display(), self.poses.parent().unwrap_or(Path::new(".")));
            let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
            return Err(Failure::bad_input(format!(
                "{path} is the vehicles.csv of a run of City3D, in full-scale metres: watch the run itself, by city3d \
                 replay {}. A table of poses has the columns {}, in laboratory metres",
                folder.display(),
                POSE_COLUMNS.join(", ")
            )));
        }
        Ok(())
    }

    /// Says what in the poses is hardly meant so.
    fn warn(&self, poses: &BTreeMap<VehicleId, Vec<MeasuredPose>>, experiment: &Experiment) {
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
                "{path}: the scenario has no vehicle {}; it has {}. They are shown with the usual measures",
                strangers.join(", "),
                known.take(20).collect::<Vec<_>>().join(", ")
            );
        }
        if let Some(share) = outside(poses, experiment) {
            let factor = experiment.scale.factor();
            tracing::warn!(
                "{path}: {:.0} % of the poses lie outside of the map. Laboratory metres are needed: are these \
                 full-scale ones? Then divide x and y by {factor}",
                share * 100.0
            );
        }
        for (vehicle, poses) in poses {
            for (before, after) in gaps(poses) {
                tracing::warn!(
                    "{path}: vehicle {vehicle} was not measured from {:.2} s to {:.2} s and is not there meanwhile",
                    before - from_s,
                    after - from_s
                );
            }
        }
    }

    /// The poses of a table, or of a bag by the names of the scenario's vehicles.
    fn read(&self) -> Result<BTreeMap<VehicleId, Vec<MeasuredPose>>, Failure> {
        if !is_bag(self.poses) {
            self.tell_own_table()?;
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
        poses: &BTreeMap<VehicleId, Vec<MeasuredPose>>,
        from_s: f64,
        experiment: &Arc<Experiment>,
    ) -> Result<Summary, Failure> {
        let mut files = Files::begin(Some(PathBuf::from(self.out)), experiment, Origin::Recorded, self.log)?;
        let mut city = SeenCity::new(Arc::clone(experiment));
        let bar = progress::simulated_seconds(experiment.duration_s);
        let last = (experiment.duration_s * f64::from(experiment.rates.physics_hz) + 1e-6).floor() as u64;
        let mut smoothed = Smoothed::new(poses, from_s, experiment);
        for tick in 0..=last {
            let time_s = experiment.rates.time_s(tick);
            let head = Poses {
                tick,
                time_s,
                state_hash: 0,
                phase: Phase::Running,
                part: 0,
                parts: 1,
                vehicles: Vec::new(),
            };
            let snapshot = city.show(&head, &smoothed.at(tick));
            if tick == 0 {
                files.first(snapshot)?;
            } else {
                files.tick(None, snapshot)?;
            }
            if tick % 100 == 0 {
                progress::show(&bar, time_s);
            }
        }
        bar.finish_and_clear();
        files.finish(experiment, city.snapshot(), None)
    }
}

/// Whether a file is one in which ROS records.
fn is_bag(path: &Path) -> bool {
    is_ros1_bag(path) || is_log(path)
}

/// Poses farther than this from everything that the map has are not on it, laboratory metres.
const OUTSIDE_M: f64 = 1.0;
/// More of them than this are no strays.
const STRAY_SHARE: f64 = 0.1;

/// The share of the poses that lie outside of the map, where that is more than some strays.
fn outside(poses: &BTreeMap<VehicleId, Vec<MeasuredPose>>, experiment: &Experiment) -> Option<f64> {
    let [low, high] = experiment.city_map.bounds().map(|corner| corner / experiment.scale.factor());
    let is_outside = |pose: &&MeasuredPose| {
        let at = pose.pose.position;
        at.cmplt(low - OUTSIDE_M).any() || at.cmpgt(high + OUTSIDE_M).any()
    };
    let all = || poses.values().flatten();
    let share = all().filter(is_outside).count() as f64 / all().count().max(1) as f64;
    (share > STRAY_SHARE).then_some(share)
}

/// From when to when a vehicle was not measured, for longer than is bridged.
fn gaps(poses: &[MeasuredPose]) -> impl Iterator<Item = (f64, f64)> {
    let times = poses.windows(2).map(|pair| (pair[0].time_s, pair[1].time_s));
    times.filter(|(before, after)| after - before > LONGEST_GAP_S)
}

/// Recorded poses are smoothed in pieces this long, each with so much more on both sides that its ends are
/// smoothed as if all poses had been taken at once.
const PIECE_S: f64 = 60.0;
const MARGIN_S: f64 = 5.0;

/// How the vehicles moved at the ticks of the experiment, from all of their poses. City metres.
struct Smoothed<'a> {
    poses: &'a BTreeMap<VehicleId, Vec<MeasuredPose>>,
    /// Stamp of the experiment's beginning.
    from_s: f64,
    experiment: &'a Experiment,
    noise: NoiseModel,
    /// The first tick of the present piece, and the motions from there on.
    first: u64,
    motions: BTreeMap<VehicleId, Vec<Option<MotionEstimate>>>,
}

impl<'a> Smoothed<'a> {
    fn new(
        poses: &'a BTreeMap<VehicleId, Vec<MeasuredPose>>,
        from_s: f64,
        experiment: &'a Experiment,
    ) -> Self {
        let noise = NoiseModel::LABORATORY.scaled(experiment.scale.factor());
        Self { poses, from_s, experiment, noise, first: 0, motions: BTreeMap::new() }
    }

    fn ticks_per_piece(&self) -> u64 {
        (PIECE_S * f64::from(self.experiment.rates.physics_hz)) as u64
    }

    /// The vehicles that are there at a tick. Ticks come in order.
    fn at(&mut self, tick: u64) -> Vec<SeenMotion> {
        if self.motions.is_empty() || tick >= self.first + self.ticks_per_piece() {
            self.smooth_from(tick);
        }
        let index = (tick - self.first) as usize;
        let motion = |(&vehicle, motions): (&VehicleId, &Vec<Option<MotionEstimate>>)| {
            let motion = (*motions.get(index)?)?;
            Some(SeenMotion::planar(vehicle, Status::Physical, &motion))
        };
        self.motions.iter().filter_map(motion).collect()
    }

    fn smooth_from(&mut self, first: u64) {
        self.first = first;
        let times_s: Vec<f64> =
            (first..first + self.ticks_per_piece()).map(|tick| self.experiment.rates.time_s(tick)).collect();
        let (begin_s, end_s) = (times_s[0] - MARGIN_S, times_s[times_s.len() - 1] + MARGIN_S);
        let factor = self.experiment.scale.factor();
        for (&vehicle, poses) in self.poses {
            let from = poses.partition_point(|pose| pose.time_s - self.from_s < begin_s);
            let to = poses.partition_point(|pose| pose.time_s - self.from_s <= end_s);
            let near = poses[from..to].iter();
            let near: Vec<(f64, Pose2)> =
                near.map(|pose| (pose.time_s - self.from_s, pose.pose.scaled(factor))).collect();
            self.motions.insert(vehicle, smooth(&self.noise, &near, &times_s));
        }
    }
}
