//! `city3d replay POSES`: makes a run of poses that were measured elsewhere, smoothed, with the same files as any run.

use super::files::{LogArgs, conclude};
use super::{Failure, ScenarioArgs, load, progress};
use city3d_logbook::record::LogOrigin;
use city3d_session::recorded::{RecordedPoses, RecordedPosesError, is_bag};
use city3d_session::{RunFiles, RunFolders};
use city3d_simulation::scenario::Experiment;
use std::path::{Path, PathBuf};

/// Arguments of a replay of measured poses.
pub struct PosesReplay<'a> {
    pub poses: &'a Path,
    pub scenario: &'a str,
    pub out: &'a Path,
    pub log: LogArgs,
    pub json: bool,
}

impl From<RecordedPosesError> for Failure {
    fn from(error: RecordedPosesError) -> Self {
        Self::bad_input(error)
    }
}

impl PosesReplay<'_> {
    pub fn replay(&self) -> Result<(), Failure> {
        let poses = if is_bag(self.poses) {
            RecordedPoses::of_bag(self.poses, &*load::experiment(&self.scenario(None))?)
        } else {
            RecordedPoses::of_table(self.poses)
        }?;
        let experiment = load::experiment(&self.scenario(Some(poses.duration_s())))?;
        self.warn(&poses, &experiment);
        let folders = RunFolders::parts(Some(PathBuf::from(self.out)));
        let mut files = RunFiles::new(folders, LogOrigin::Recorded, self.log.options());
        files.begin(&experiment)?;
        let bar = progress::simulated_seconds(experiment.duration_s);
        let summary = poses.write(&experiment, files, &mut |time_s| progress::show(&bar, time_s))?;
        bar.finish_and_clear();
        conclude(&summary, &experiment, Some(self.out), self.json)
    }

    fn scenario(&self, duration: Option<f64>) -> ScenarioArgs {
        ScenarioArgs { scenario: self.scenario.to_owned(), duration, ..ScenarioArgs::default() }
    }

    /// Warns of poses that are probably wrong.
    fn warn(&self, poses: &RecordedPoses, experiment: &Experiment) {
        let path = self.poses.display();
        let strangers: Vec<String> = poses.strangers(experiment).iter().map(ToString::to_string).collect();
        if !strangers.is_empty() {
            let known = experiment.vehicles.iter().map(|planned| format!("{} {}", planned.id, planned.name));
            tracing::warn!(
                "{path}: the scenario has no vehicle {}; it has {}. The unknown ones are shown with default dimensions",
                strangers.join(", "),
                known.take(20).collect::<Vec<_>>().join(", ")
            );
        }
        if let Some(share) = poses.share_outside(experiment) {
            let factor = experiment.scale.factor();
            tracing::warn!(
                "{path}: {:.0} % of the poses lie outside of the map. Poses must be in laboratory metres; if these are \
                 full-scale metres, divide x and y by {factor}",
                share * 100.0
            );
        }
        for gap in poses.gaps() {
            tracing::warn!(
                "{path}: vehicle {} was not measured from {:.2} s to {:.2} s and is absent for that time",
                gap.vehicle,
                gap.from_s,
                gap.to_s
            );
        }
    }
}
