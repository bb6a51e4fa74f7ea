//! The title of the window.

use super::ViewerState;
use city3d_simulation::scenario::Overrides;
use std::path::Path;

impl ViewerState {
    /// Title of the window: the scenario with what replaces values of it, or the log, and the program.
    pub fn title(&self) -> String {
        let path = Path::new(&self.request.scenario);
        let name = path.file_name().unwrap_or(path.as_os_str());
        let set = replaced(&self.request.overrides);
        let set = if set.is_empty() { set } else { format!(" ({set})") };
        format!("{}{set} - City3D", name.display())
    }
}

/// What replaces values of a scenario, in words.
fn replaced(overrides: &Overrides) -> String {
    let environment = overrides.environment.map(|profile| profile.name().to_owned());
    let seed = overrides.seed.map(|seed| format!("seed {seed}"));
    let duration = overrides.duration_s.map(|seconds| format!("{seconds} s"));
    let words: Vec<String> = [environment, seed, duration].into_iter().flatten().collect();
    words.join(", ")
}
