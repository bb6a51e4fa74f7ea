//! Loads the experiment of a command's arguments.

use super::{Failure, ScenarioArgs};
use city3d_simulation::scenario::{Experiment, Library, read_experiment};
use std::path::{Path, PathBuf};
use std::sync::Arc;

pub fn experiment(args: &ScenarioArgs) -> Result<Arc<Experiment>, Failure> {
    city3d_session::load(&args.request()).map_err(Failure::bad_input)
}

/// The files that an experiment may have been read from: its scenario, its map and its models. Shipped ones are none.
pub fn inputs(scenario: &str, experiment: &Experiment) -> Vec<PathBuf> {
    let beside = Path::new(scenario).parent().unwrap_or(Path::new(""));
    let document: toml::Table = experiment.scenario_text.parse().unwrap_or_default();
    let map = document.get("map").and_then(toml::Value::as_str);
    let named = map.into_iter().chain(experiment.models.files.keys().map(String::as_str));
    let paths = named.flat_map(|name| [beside.join(name), PathBuf::from(name)]);
    std::iter::once(PathBuf::from(scenario)).chain(paths).collect()
}

/// The experiment of a served city: vehicles come over the link, so it may have none of its own.
pub fn city(args: &ScenarioArgs) -> Result<Experiment, Failure> {
    let mut request = args.request();
    request.overrides.allows_no_vehicles = true;
    request.read().map_err(Failure::bad_input)
}

/// The city with so much traffic, whatever its scenario says.
#[cfg(feature = "render")]
pub fn city_of(vehicles: u32, seed: Option<u64>) -> Result<Experiment, Failure> {
    let (text, library) = Library::scenario("city").map_err(Failure::bad_input)?;
    let mut table: toml::Table = text.parse().map_err(Failure::failed)?;
    if let Some(traffic) = table.get_mut("traffic").and_then(toml::Value::as_table_mut) {
        traffic.insert("vehicles".to_owned(), i64::from(vehicles).into());
    }
    let overrides = city3d_simulation::scenario::Overrides { seed, ..Default::default() };
    read_experiment("city", &table.to_string(), &library, overrides).map_err(Failure::bad_input)
}

/// The experiment of a text that was made from the scenario's.
pub fn from_text(args: &ScenarioArgs, text: &str, library: &Library) -> Result<Experiment, Failure> {
    let overrides = args.changed.overrides();
    read_experiment(&args.scenario, text, library, overrides).map_err(Failure::bad_input)
}
