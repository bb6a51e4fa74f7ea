//! The folder of the run that is shown, where its pictures, videos and charts belong, and the scenario of a log that can be
//! run again.

use super::{ViewedRun, ViewerState};
use city3d_session::RunPhase;
use city3d_simulation::scenario::{Experiment, Library, Overrides, ScenarioRequest, shipped_scenarios};
use std::path::{Path, PathBuf};

impl ViewerState {
    /// Where files that are made of the run go: beside its log, or into the working folder where it has none. A run that waits
    /// for its start gets its folder now, so that nothing of it lies beside the log of the run before.
    pub fn files_folder(&self) -> PathBuf {
        let folder = match &self.source {
            ViewedRun::Log(_) => Path::new(&self.request.scenario).parent().map(Path::to_path_buf),
            ViewedRun::Run(_) | ViewedRun::Ended(_) => {
                let run_state = self.run_state();
                let waits = run_state.phase == RunPhase::Ready;
                if let Some(next) = run_state.next_folder.as_ref().filter(|_| waits) {
                    // Where it cannot be made, the working folder takes the file.
                    let _ = std::fs::create_dir_all(next);
                }
                if waits { run_state.next_folder.clone() } else { run_state.folder.clone() }
            }
        };
        let may_write = |folder: &PathBuf| {
            folder.metadata().is_ok_and(|found| found.is_dir() && !found.permissions().readonly())
        };
        folder.filter(may_write).unwrap_or_default()
    }
}

/// The scenario that a log is of, shipped or one of these files, with what was set otherwise: it can be run again.
pub(super) fn request_of(experiment: &Experiment, files: &[PathBuf]) -> Option<ScenarioRequest> {
    let is_of = |name: &&str| {
        Library::scenario(name).is_ok_and(|(text, _)| text.as_str() == experiment.scenario_text.as_str())
    };
    let is_in = |file: &&PathBuf| {
        file.extension().is_some_and(|extension| extension == "toml")
            && std::fs::read_to_string(file).is_ok_and(|text| text == experiment.scenario_text.as_str())
    };
    let shipped = shipped_scenarios().find(is_of).map(str::to_owned);
    let scenario = shipped.or_else(|| files.iter().find(is_in).map(|file| file.display().to_string()))?;
    let overrides = Overrides {
        seed: Some(experiment.seed),
        duration_s: Some(experiment.duration_s),
        model: experiment.model,
        environment: experiment.profile,
        allows_no_vehicles: false,
    };
    Some(ScenarioRequest { scenario, overrides, changes: Vec::new() })
}
