//! Loads the experiment of a command's arguments.

use super::{Failure, ModelArg, ProfileArg, ScenarioArgs};
use crate::scenario::{Experiment, Library, Overrides, read_experiment};
use crate::vehicle::ModelKind;
use std::sync::Arc;

pub fn experiment(args: &ScenarioArgs) -> Result<Arc<Experiment>, Failure> {
    let experiment = read(args, false)?;
    for moved in &experiment.moved {
        tracing::warn!(
            "vehicle {} overlaps vehicle {} at the start; it starts {:.2} m further back on its lane",
            moved.vehicle,
            moved.behind,
            moved.by_m
        );
    }
    Ok(Arc::new(experiment))
}

/// The experiment of a served city: vehicles come over the link, so it may have none of its own.
pub fn city(args: &ScenarioArgs) -> Result<Experiment, Failure> {
    read(args, true)
}

/// The city with so much traffic, whatever its scenario says.
#[cfg(feature = "render")]
pub fn city_of(vehicles: u32, seed: Option<u64>) -> Result<Experiment, Failure> {
    let (text, library) = Library::scenario("city").map_err(Failure::bad_input)?;
    let mut table: toml::Table = text.parse().map_err(Failure::failed)?;
    if let Some(traffic) = table.get_mut("traffic").and_then(toml::Value::as_table_mut) {
        traffic.insert("vehicles".to_owned(), i64::from(vehicles).into());
    }
    let overrides = Overrides { seed, ..Overrides::default() };
    read_experiment("city", &table.to_string(), &library, overrides).map_err(Failure::bad_input)
}

fn read(args: &ScenarioArgs, allows_no_vehicles: bool) -> Result<Experiment, Failure> {
    let (text, library) = Library::scenario(&args.scenario).map_err(Failure::bad_input)?;
    from_text(args, &text, &library, allows_no_vehicles)
}

/// The experiment of a text that is the scenario's, or was made from it.
pub fn from_text(
    args: &ScenarioArgs,
    text: &str,
    library: &Library,
    allows_no_vehicles: bool,
) -> Result<Experiment, Failure> {
    let model = args.model.map(|model| match model {
        ModelArg::Raycast => ModelKind::Raycast,
        ModelArg::Bicycle => ModelKind::Bicycle,
    });
    let environment = args.environment.map(ProfileArg::profile);
    let overrides =
        Overrides { seed: args.seed, duration_s: args.duration, model, environment, allows_no_vehicles };
    read_experiment(&args.scenario, text, library, overrides).map_err(Failure::bad_input)
}
