//! `city3d replay POSES`: vehicles that were measured elsewhere drive as they were recorded, into the same files
//! as any run.

use super::files::{Files, LogArgs, conclude};
use super::{Failure, ScenarioArgs, load, progress};
use crate::geom::trig;
use crate::record::{MeasuredPose, Origin, is_log, is_ros1_bag, pose_at, read_bag, read_poses};
use crate::runner::{SeenCity, Summary};
use crate::scenario::Experiment;
use crate::snapshot::{Status, VehicleId};
use crate::wire::{Measurement, Phase, Poses, Seen};
use glam::{DQuat, DVec3};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A vehicle that is not seen for longer is not there.
const LONGEST_GAP_S: f64 = 1.0;

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
        let summary = self.write(&poses, from_s, &experiment)?;
        conclude(&summary, &experiment, Some(self.out), self.json)
    }

    /// The poses of a table, or of a bag by the names of the scenario's vehicles.
    fn read(&self) -> Result<BTreeMap<VehicleId, Vec<MeasuredPose>>, Failure> {
        if !is_bag(self.poses) {
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
        for tick in 0..=last {
            let time_s = experiment.rates.time_s(tick);
            let seen = seen_at(poses, from_s + time_s, time_s);
            let head = Poses {
                tick,
                time_s,
                state_hash: 0,
                phase: Phase::Running,
                part: 0,
                parts: 1,
                vehicles: Vec::new(),
            };
            let snapshot = city.see(&head, &seen);
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

/// The vehicles that are there at a time.
fn seen_at(poses: &BTreeMap<VehicleId, Vec<MeasuredPose>>, time_s: f64, stamp_s: f64) -> Vec<Seen> {
    let seen = |(&vehicle, poses): (&VehicleId, &Vec<MeasuredPose>)| {
        let pose = pose_at(poses, time_s, LONGEST_GAP_S)?;
        let position = DVec3::new(pose.position.x, pose.position.y, 0.0);
        let (sin, cos) = trig::sin_cos(pose.yaw_rad / 2.0);
        let orientation = DQuat::from_xyzw(0.0, 0.0, sin, cos);
        let pose = Measurement { vehicle, stamp_s, position, orientation };
        Some(Seen { pose, status: Status::Physical })
    };
    poses.iter().filter_map(seen).collect()
}
