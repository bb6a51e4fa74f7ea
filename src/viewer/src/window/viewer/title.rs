//! The title of the window, and the time that it shows.

use super::ViewerState;
use city3d_simulation::scenario::{Overrides, ScenarioChange, ScenarioRequest};
use std::path::Path;

/// Longest text of a changed value; the title names longer ones by their keys alone.
const LONGEST_VALUE: usize = 24;

impl ViewerState {
    /// Simulated time that the window shows in numbers, seconds: the interpolated picture is a part of a step behind it.
    pub fn clock_s(&self) -> f64 {
        self.clock_s
    }

    /// Title of the window: the scenario, or the edited file, with what replaces values of it, or the log, and the program.
    pub fn title(&self) -> String {
        if self.player().is_some() {
            return format!("Replay of {} - City3D", self.experiment().name);
        }
        let edited = self.editor.as_ref().filter(|_| self.edits).and_then(|editor| editor.file());
        let path = edited.unwrap_or(Path::new(&self.request.scenario));
        let name = path.file_name().unwrap_or(path.as_os_str());
        let set = replaced(&self.request);
        let set = if set.is_empty() { set } else { format!(" ({set})") };
        format!("{}{set} - City3D", name.display())
    }
}

/// What replaces values of a scenario, in words.
fn replaced(request: &ScenarioRequest) -> String {
    let Overrides { environment, seed, duration_s, .. } = &request.overrides;
    let environment = environment.map(|profile| profile.name().to_owned());
    let seed = seed.map(|seed| format!("seed {seed}"));
    let duration = duration_s.map(|seconds| format!("{seconds} s"));
    let overrides = [environment, seed, duration].into_iter().flatten();
    overrides.chain(request.changes.iter().map(change)).collect::<Vec<_>>().join(", ")
}

/// A changed value as it is given on the command line.
fn change(change: &ScenarioChange) -> String {
    let value = match &change.value {
        toml::Value::String(text) => text.clone(),
        other => other.to_string(),
    };
    if value.chars().count() > LONGEST_VALUE { change.key.clone() } else { format!("{}={value}", change.key) }
}
