//! A map without a scenario: the city that it draws, without vehicles.

use super::{Experiment, Library, LoadError, Overrides, ScenarioRequest};
use std::path::Path;

/// Nothing happens in it, however long it runs.
const DURATION_S: f64 = 60.0;

/// Whether a request names a map (.dxf) in place of a scenario.
pub fn is_map(request: &ScenarioRequest) -> bool {
    Path::new(&request.scenario).extension().is_some_and(|extension| extension.eq_ignore_ascii_case("dxf"))
}

/// Reads the map that a request names, as a city without vehicles.
///
/// # Errors
/// Where it cannot be read, or has problems; each has its place and remedy.
pub fn map_alone(request: &ScenarioRequest) -> Result<Experiment, LoadError> {
    let path = Path::new(&request.scenario);
    let text = |part: Option<&std::ffi::OsStr>| {
        toml::Value::String(part.unwrap_or(path.as_os_str()).to_string_lossy().into_owned())
    };
    let (name, map) = (text(path.file_stem()), text(path.file_name()));
    let scenario = format!("name = {name}\nmap = {map}\nduration_s = {DURATION_S:?}\n");
    let overrides = Overrides { allows_no_vehicles: true, ..request.overrides };
    let request = ScenarioRequest { overrides, ..request.clone() };
    request.read_text(&scenario, &Library::beside(path))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_map_alone_is_a_city_without_vehicles() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("town.DXF");
        let request =
            ScenarioRequest { scenario: path.to_string_lossy().into_owned(), ..ScenarioRequest::default() };
        assert!(is_map(&request));
        let said = map_alone(&request).unwrap_err().to_string();
        assert!(said.contains("town.DXF"), "{said}");
        std::fs::write(&path, Library::default().map("crossing").unwrap()).unwrap();
        let experiment = map_alone(&request).unwrap();
        assert_eq!((experiment.name.as_str(), experiment.vehicles.len()), ("town", 0));
        assert!(!experiment.city_map.lanes.is_empty());
    }
}
