//! What a user wants to open: by its name a scenario, a map or a log, and how it begins.

use crate::ui::runs::{EntryKind, OpenRequest, has_run, kind_of};
use city3d_logbook::record::is_log;
use city3d_sensors::Weather;
use city3d_simulation::scenario::{ScenarioRequest, shipped_scenarios};
use std::path::{Path, PathBuf};

/// Another subject of the window.
#[derive(Clone, Debug, PartialEq)]
pub struct Opening {
    /// What is shown.
    pub target: OpenTarget,
    /// Time of day; by default the scenario's.
    pub hours: Option<f64>,
    /// Weather; by default the scenario's.
    pub weather: Option<Weather>,
    /// The run starts at once.
    pub starts: bool,
}

/// What a window can be opened on.
#[derive(Clone, Debug, PartialEq)]
pub enum OpenTarget {
    /// A scenario, or a map alone.
    Scenario(ScenarioRequest),
    /// The log of a recorded run.
    Log(PathBuf),
}

impl Opening {
    /// A scenario that waits for its start, in its own light.
    pub fn scenario(request: ScenarioRequest) -> Self {
        Self { target: OpenTarget::Scenario(request), hours: None, weather: None, starts: false }
    }

    /// A log, in the light of its scenario.
    pub fn log(log: PathBuf) -> Self {
        Self { target: OpenTarget::Log(log), hours: None, weather: None, starts: false }
    }

    /// What a request names.
    ///
    /// # Errors
    /// Why it cannot be opened, and what can be.
    pub fn of(request: &OpenRequest) -> Result<Self, String> {
        let target = target(request)?;
        Ok(Self { target, hours: request.hours, weather: None, starts: request.starts })
    }

    /// Its name for the user.
    pub fn name(&self) -> String {
        match &self.target {
            OpenTarget::Scenario(request) => request.scenario.clone(),
            OpenTarget::Log(log) => log.display().to_string(),
        }
    }
}

/// The log in the folder of a run.
pub fn log_in(folder: &Path) -> PathBuf {
    folder.join("run.mcap")
}

const RIGHT: &str = "Choose a scenario (.toml), a map (.dxf), a log (.mcap) or the folder of a recorded run.";

fn target(request: &OpenRequest) -> Result<OpenTarget, String> {
    let what = &request.what;
    let name = what.to_string_lossy().into_owned();
    let is_shipped = shipped_scenarios().any(|shipped| *shipped == name);
    let overrides = request.overrides;
    let scenario =
        |scenario| OpenTarget::Scenario(ScenarioRequest { scenario, overrides, changes: Vec::new() });
    match kind_of(what) {
        EntryKind::Run if has_run(what) => Ok(OpenTarget::Log(log_in(what))),
        EntryKind::Log => Ok(OpenTarget::Log(what.clone())),
        EntryKind::Scenario | EntryKind::Map => Ok(scenario(name)),
        EntryKind::Shipped => Ok(scenario(name)),
        _ if is_shipped => Ok(scenario(name)),
        EntryKind::Run | EntryKind::Folder => Err(format!("{name} is a folder without a run.mcap. {RIGHT}")),
        EntryKind::Other if is_log(what) => Ok(OpenTarget::Log(what.clone())),
        EntryKind::Other if what.exists() => {
            Err(format!("{name} is no scenario, no map and no log. {RIGHT}"))
        }
        EntryKind::Other => Err(format!("There is no {name}. {RIGHT}")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_opened_is_known_by_its_name_and_by_what_is_in_it() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::create_dir(at("run-1")).unwrap();
        std::fs::create_dir(at("empty")).unwrap();
        std::fs::write(at("run-1/run.mcap"), "").unwrap();
        std::fs::write(at("notes.txt"), "mine").unwrap();
        let of = |what: PathBuf| Opening::of(&OpenRequest { what, ..OpenRequest::default() });
        assert_eq!(of(at("run-1")).unwrap().target, OpenTarget::Log(at("run-1/run.mcap")));
        assert_eq!(of(at("x.mcap")).unwrap().target, OpenTarget::Log(at("x.mcap")));
        for name in ["roundabout", "mine.toml", "town.dxf"] {
            assert!(
                matches!(of(name.into()).unwrap().target, OpenTarget::Scenario(of) if of.scenario == name)
            );
        }
        for (name, why) in
            [("empty", "without a run.mcap"), ("notes.txt", "no scenario"), ("gone", "There is no")]
        {
            let said = of(at(name)).unwrap_err();
            assert!(said.contains(why) && said.contains("Choose a scenario (.toml)"), "{said}");
        }
    }
}
