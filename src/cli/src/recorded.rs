//! `city3d replay POSES`: makes a run of poses that were measured elsewhere, smoothed, with the same files as any run.

use super::files::{LogArgs, conclude, fail_if_stopped};
use super::{ChangeArgs, Failure, ScenarioArgs, load, on_end, progress};
use city3d_logbook::record::{FileKind, LogOrigin, file_kind};
use city3d_session::recorded::{MeasurementGap, RecordedPoses, RecordedPosesError};
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
        let poses = if self.is_bag()? {
            RecordedPoses::of_bag(self.poses, &*load::experiment(&self.scenario(None))?)
        } else {
            RecordedPoses::of_table(self.poses)
        }?;
        let experiment = load::experiment(&self.scenario(Some(poses.duration_s())))?;
        self.examine(&poses, &experiment)?;
        let folders = RunFolders::parts(Some(PathBuf::from(self.out)));
        let options = self.log.options();
        let mut inputs = load::inputs(self.scenario, &experiment);
        inputs.push(self.poses.to_path_buf());
        let claimed = options.claim_folder(self.out, &inputs)?;
        let stop = on_end()?;
        let mut files = RunFiles::new(folders, LogOrigin::Recorded, options).in_claimed(Some(claimed));
        files.begin(&experiment)?;
        let bar = progress::simulated_seconds(experiment.duration_s);
        let summary = poses.write(&experiment, files, &stop, &mut |time_s| progress::show(&bar, time_s))?;
        bar.finish_and_clear();
        conclude(&summary, &experiment, Some(self.out), self.json)?;
        fail_if_stopped(&summary, &experiment)
    }

    /// Whether it is a bag rather than a table.
    fn is_bag(&self) -> Result<bool, Failure> {
        if self.poses.is_dir() {
            return Ok(true);
        }
        match file_kind(self.poses).map_err(Failure::bad_input)? {
            FileKind::Mcap | FileKind::Ros1Bag | FileKind::Sqlite | FileKind::Zstandard => Ok(true),
            FileKind::Text => Ok(false),
            FileKind::Other => Err(Failure::bad_input(format!(
                "{}: its first bytes are those of no bag (ROS 1 in format 2.0, MCAP, or SQLite) and of no table (text in UTF-8)",
                self.poses.display()
            ))),
        }
    }

    fn scenario(&self, duration: Option<f64>) -> ScenarioArgs {
        let changed = ChangeArgs { duration, ..ChangeArgs::default() };
        ScenarioArgs { scenario: self.scenario.to_owned(), changed }
    }

    /// Warns of poses that are probably wrong, and refuses those that certainly are.
    fn examine(&self, poses: &RecordedPoses, experiment: &Experiment) -> Result<(), Failure> {
        let path = self.poses.display();
        let strangers = poses.strangers(experiment);
        if strangers.len() > MOST_STRANGERS {
            return Err(Failure::bad_input(format!(
                "{path}: {} vehicles that the scenario does not have; at most {MOST_STRANGERS} are shown. Is id the right \
                 column?",
                strangers.len()
            )));
        }
        if !strangers.is_empty() {
            let known = experiment.vehicles.iter().map(|planned| format!("{} {}", planned.id, planned.name));
            tracing::warn!(
                "{path}: the scenario has no vehicle {}; it has {}. The unknown ones are shown with default dimensions",
                first_of(strangers.iter().map(ToString::to_string)),
                first_of(known)
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
        let mut gaps = poses.gaps();
        for MeasurementGap { vehicle, from_s, to_s } in gaps.by_ref().take(MOST_LISTED) {
            tracing::warn!(
                "{path}: vehicle {vehicle} was not measured from {from_s:.2} s to {to_s:.2} s and is absent for that time"
            );
        }
        let more = gaps.count();
        if more > 0 {
            tracing::warn!("{path}: {more} more gaps in which a vehicle is absent");
        }
        Ok(())
    }
}

/// Most vehicles that the scenario does not have.
const MOST_STRANGERS: usize = 1000;
/// Most things of one kind that warnings list.
const MOST_LISTED: usize = 20;

/// The first words of a list, and how many follow.
fn first_of(mut words: impl Iterator<Item = String>) -> String {
    let mut listed: Vec<String> = words.by_ref().take(MOST_LISTED).collect();
    let more = words.count();
    if more > 0 {
        listed.push(format!("and {more} more"));
    }
    listed.join(", ")
}
