//! Labels of runs in figures and tables: what tells them apart.

use super::run::RunLog;
use city3d_simulation::environment::EnvironmentSpec;
use city3d_simulation::scenario::Experiment;
use std::collections::BTreeSet;

impl RunLog {
    /// The environment between control framework and vehicles, for labels.
    pub fn setting(&self) -> &'static str {
        if self.has_physical {
            "physical"
        } else if self.experiment.environment == EnvironmentSpec::IDEAL {
            "ideal"
        } else {
            "testbed emulator"
        }
    }
}

/// What a run is of: scenario, seed and environment, and whether physical vehicles take part.
pub(super) fn conditions(experiment: &Experiment, has_physical: bool) -> String {
    let physical = if has_physical { ", with lab vehicles" } else { "" };
    let of_run = experiment.conditions();
    // Those may have told it.
    let physical = if of_run.ends_with("lab vehicles") { "" } else { physical };
    format!("{}, {of_run}{physical}", experiment.name)
}

/// Labels of runs: that of a single one tells its scenario, seed and environment, those of several are what they differ in.
pub(super) fn labels(runs: &[RunLog]) -> Vec<String> {
    if let [run] = runs {
        return vec![conditions(&run.experiment, run.has_physical)];
    }
    let aspects: [Vec<String>; 5] = [
        runs.iter().map(|run| run.experiment.name.clone()).collect(),
        runs.iter().map(|run| run.experiment.junction_control()).collect(),
        runs.iter().map(|run| run.experiment.controllers()).collect(),
        runs.iter().map(|run| run.setting().to_owned()).collect(),
        runs.iter().map(|run| format!("seed {}", run.experiment.seed)).collect(),
    ];
    let found = joined(&aspects, runs.len());
    if is_unique(&found) {
        return found;
    }
    let folder = |run: &RunLog| {
        let parent = run.path.parent().and_then(|parent| parent.file_name());
        parent.map_or_else(|| run.path.display().to_string(), |name| name.to_string_lossy().into_owned())
    };
    let folders: Vec<String> = runs.iter().map(folder).collect();
    let is_told = is_unique(&folders);
    let place = |index: usize| match is_told {
        true => folders[index].clone(),
        false => format!("run {}", char::from(b'A' + (index % 26) as u8)),
    };
    let name = |(index, run): (usize, &RunLog)| match found[index].as_str() {
        "" => format!("{}, {}", run.setting(), place(index)),
        words => format!("{words}, {}", place(index)),
    };
    runs.iter().enumerate().map(name).collect()
}

/// For each run the aspects that are not the same in all of them.
fn joined(aspects: &[Vec<String>], runs: usize) -> Vec<String> {
    let differ = |aspect: &&Vec<String>| aspect.iter().any(|word| *word != aspect[0]);
    let words = |run: usize| {
        let own = aspects.iter().filter(differ).map(|aspect| aspect[run].as_str());
        own.filter(|word| !word.is_empty()).collect::<Vec<_>>().join(", ")
    };
    (0..runs).map(words).collect()
}

fn is_unique(words: &[String]) -> bool {
    words.iter().collect::<BTreeSet<_>>().len() == words.len()
}
