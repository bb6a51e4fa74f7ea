//! Reads a scenario file into an [`Experiment`].

use super::experiment::{Expectations, Experiment, PlannedVehicle, Rates};
use super::feasibility::infeasible_starts;
use super::fields::{Problem, Problems, TableFields};
use super::models::{ModelReader, UserModels};
use super::read_coordination::{read_coordination, slowest_cav};
use super::read_platoon::read_platoons;
use super::read_settings::{NamedSettings, read_environment, read_rates, read_right_of_way};
use super::read_signals::{check_room_before_signals, read_all_way_stops, read_signals};
use super::source::LARGEST_SCENARIO_BYTES;
use super::time_of_day::{read_time_of_day, read_weather};
use super::{ChangeError, Library, MovedStart, ScenarioChange, SourceError, placement, with_changes};
use crate::environment::EnvironmentProfile;
use city3d_dynamics::vehicle::ModelKind;
use city3d_geometry::LengthScale;
use city3d_protocol::snapshot::VehicleId;
use city3d_roadmap::{CityMap, LabMap};
use city3d_workers::Workers;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::ops::Range;
use std::sync::Arc;
use thiserror::Error;
use toml::de::DeTable;

/// A scenario that cannot be run.
#[derive(Debug, Error)]
pub enum ScenarioError {
    /// Problems of the scenario file, in its order.
    #[error("{}", join(file, problems))]
    Scenario {
        /// Name of the scenario for the message: its path, or its shipped name.
        file: String,
        /// Every problem found, with line, column and remedy.
        problems: Vec<Problem>,
    },
    /// Problems of the map that the scenario names.
    #[error("{}", join(file, problems))]
    Map {
        /// Name of the map, as the scenario states it.
        file: String,
        /// Every problem of the map or of the models in it, as text.
        problems: Vec<String>,
    },
    /// A file cannot be loaded.
    #[error(transparent)]
    Source(#[from] SourceError),
}

fn join<P: std::fmt::Display>(file: &str, problems: &[P]) -> String {
    let mut text = String::new();
    for (index, problem) in problems.iter().enumerate() {
        let newline = if index > 0 { "\n" } else { "" };
        // Writing to a string cannot fail.
        let _ = write!(text, "{newline}{file}: {problem}");
    }
    text
}

/// Most syntax errors reported.
const MOST_SYNTAX_ERRORS: usize = 10;

/// Command-line overrides of a scenario.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Overrides {
    /// Replaces the seed of the file.
    pub seed: Option<u64>,
    /// Replaces the duration of the file, simulated seconds.
    pub duration_s: Option<f64>,
    /// All vehicles get this dynamics model.
    pub model: Option<ModelKind>,
    /// Overrides the environment of the file.
    pub environment: Option<EnvironmentProfile>,
    /// Permits a file without vehicles, which arrive over the link.
    pub allows_no_vehicles: bool,
}

/// A scenario, and what is set otherwise than in it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ScenarioRequest {
    /// A file, or the name of a shipped scenario.
    pub scenario: String,
    /// What replaces values of the file.
    pub overrides: Overrides,
    /// Values of the file that are set otherwise, in this order.
    pub changes: Vec<ScenarioChange>,
}

/// Why a requested scenario cannot be loaded.
#[derive(Debug, Error)]
pub enum LoadError {
    /// The scenario file cannot be loaded.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// The scenario or its map has problems.
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
    /// A value cannot be set.
    #[error(transparent)]
    Change(#[from] ChangeError),
    /// The scenario has problems with the values that were set.
    #[error("{error}\n(with {changes})")]
    Changed {
        /// Its problems, with the lines of the scenario that has these values.
        error: ScenarioError,
        /// The keys and their values.
        changes: String,
    },
}

impl ScenarioRequest {
    /// Reads and validates the scenario.
    ///
    /// # Errors
    /// When it cannot be read, or has problems; each has its place and remedy.
    pub fn read(&self) -> Result<Experiment, LoadError> {
        let (text, library) = Library::scenario(&self.scenario)?;
        self.read_text(&text, &library)
    }

    /// Reads and validates the text of the scenario.
    ///
    /// # Errors
    /// When it has problems, or a value cannot be set.
    pub fn read_text(&self, text: &str, library: &Library) -> Result<Experiment, LoadError> {
        let read = |text: &str| read_experiment(&self.scenario, text, library, self.overrides);
        if self.changes.is_empty() {
            return Ok(read(text)?);
        }
        let changed = with_changes(text, &self.changes)?;
        read(&changed).map_err(|error| LoadError::Changed { error, changes: self.changes_as_text() })
    }

    fn changes_as_text(&self) -> String {
        self.changes.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ")
    }
}

impl Experiment {
    /// The experiment with another duration. Its vehicles stay the same, with more or fewer arrivals of inflows at the end.
    ///
    /// # Errors
    /// When its scenario cannot be read with that duration: it may bring more vehicles than there are ids.
    pub fn lasting(&self, duration_s: f64) -> Result<Self, ScenarioError> {
        let same = Self { duration_s, ..self.clone() };
        if self.inflows.is_empty() {
            return Ok(same);
        }
        let files = self.models.files.iter().map(|(name, file)| (name.clone(), file.to_vec()));
        let library = Library::kept(self.map_bytes.clone(), files.collect());
        let overrides = Overrides {
            seed: Some(self.seed),
            duration_s: Some(duration_s),
            model: self.model,
            environment: self.profile,
            allows_no_vehicles: true,
        };
        let Self { inflows, arrivals, .. } =
            read_experiment(&self.name, &self.scenario_text, &library, overrides)?;
        Ok(Self { inflows, arrivals, ..same })
    }
}

/// Reads and validates a scenario. `file` is the name that errors carry.
///
/// # Errors
/// Every problem of the file with line and column, or of its map with line and handle.
pub fn read_experiment(
    file: &str,
    text: &str,
    library: &Library,
    overrides: Overrides,
) -> Result<Experiment, ScenarioError> {
    let (bytes, most) = (text.len() as u64, LARGEST_SCENARIO_BYTES);
    if bytes > most {
        return Err(SourceError::TooLarge { path: file.into(), kind: "scenarios", bytes, most }.into());
    }
    let problems = Problems::new(text);
    let (document, syntax_errors) = DeTable::parse_recoverable(text);
    // A file of another kind has an error on every line.
    let is_other = syntax_errors.len() > MOST_SYNTAX_ERRORS;
    if is_other {
        let remedy =
            "a scenario has lines such as key = value and tables such as [[vehicle]], see docs/scenarios.md";
        problems.add(&(0..0), format!("this does not look like a scenario: {remedy}"));
    }
    for error in syntax_errors.iter().take(if is_other { 2 } else { usize::MAX }) {
        let remedy = match error.message() {
            "duplicate key" => "; it is there already: keep one",
            message if message.contains("recursion") || message.contains("recurse") => "; nest less deeply",
            _ => "",
        };
        problems.add(&error.span().unwrap_or(0..0), format!("{}{remedy}", error.message()));
    }
    let fail = |problems: Problems<'_>| ScenarioError::Scenario {
        file: file.to_owned(),
        problems: problems.into_sorted(),
    };
    if !syntax_errors.is_empty() {
        return Err(fail(problems));
    }
    let root = TableFields::new(document.get_ref(), 0..0, &problems);
    let map_name = root.string("map").unwrap_or("ids3c");
    let map_bytes = match library.map(map_name) {
        Ok(bytes) => bytes,
        Err(error) => {
            root.wrong("map", error.to_string());
            return Err(fail(problems));
        }
    };
    let map = library.load_map(&map_bytes).map_err(|errors| ScenarioError::Map {
        file: map_name.to_owned(),
        problems: errors.listed.iter().map(ToString::to_string).collect(),
    })?;
    let models = ModelReader::new(library);
    let reader = ScenarioReader { map: LabMap::clone(&map), library, models: &models, overrides };
    let mut experiment = reader.read(&root, text, map_bytes);
    let (models, faults) = models.finish(&experiment.lab_map.models);
    experiment.models = models;
    root.finish();
    if !problems.is_empty() {
        return Err(fail(problems));
    }
    if !faults.is_empty() {
        return Err(ScenarioError::Map { file: map_name.to_owned(), problems: faults });
    }
    Ok(experiment)
}

struct ScenarioReader<'m> {
    map: LabMap,
    library: &'m Library,
    models: &'m ModelReader<'m>,
    overrides: Overrides,
}

/// Context for reading vehicles.
pub(super) struct ReadContext<'m> {
    /// Road map in laboratory metres.
    pub map: &'m LabMap,
    /// Loads the models that vehicles name.
    pub models: &'m ModelReader<'m>,
    /// City metres for one laboratory metre.
    pub scale: LengthScale,
    /// All vehicles get this dynamics model.
    pub model: Option<ModelKind>,
    /// Seed of the traffic.
    pub seed: u64,
    /// Duration of the run, simulated seconds: the routes of the traffic last longer.
    pub duration_s: f64,
    /// Step rates, which limit those of sensors.
    pub rates: Rates,
}

/// The vehicles read so far.
#[derive(Default)]
pub(super) struct FleetBuilder {
    /// Vehicles without errors that prevent reading them.
    pub vehicles: Vec<PlannedVehicle>,
    /// Names of all vehicles by id, including invalid ones.
    pub names: BTreeMap<VehicleId, String>,
    /// Source tables of the vehicles.
    pub places: BTreeMap<VehicleId, Range<usize>>,
    /// The first randomly drawn vehicle, if any.
    pub first_drawn: Option<VehicleId>,
}

impl FleetBuilder {
    /// Whether the file has no vehicles at all, not even wrong ones.
    fn is_empty(&self) -> bool {
        self.places.is_empty()
    }

    /// Moves vehicles whose places overlap.
    fn place(&mut self, root: &TableFields<'_, '_>, map: &CityMap, scale: LengthScale) -> Vec<MovedStart> {
        self.vehicles.sort_by_key(|vehicle| vehicle.id);
        placement::resolve(map, scale, &mut self.vehicles).unwrap_or_else(|id| {
            let name = self.names.get(&id).map_or("", String::as_str);
            let message = format!(
                "{name} (id {id}) overlaps another vehicle at the start, and behind that one no place is \
                 free; start it elsewhere with at_m or route"
            );
            root.problems.add(&self.places.get(&id).cloned().unwrap_or_default(), message);
            Vec::new()
        })
    }
}

impl FleetBuilder {
    /// Lowers infeasible start speeds of automatically placed vehicles; stated starts must be feasible.
    fn check_starts(
        &mut self,
        root: &TableFields<'_, '_>,
        map: &LabMap,
        scale: LengthScale,
        moved: &[MovedStart],
    ) {
        for _ in 0..MOST_ROUNDS {
            let infeasible = infeasible_starts(map, scale, &self.vehicles);
            let is_found = |id: VehicleId| {
                self.first_drawn.is_some_and(|first| id >= first)
                    || moved.iter().any(|moved| moved.vehicle == id)
            };
            let (found, stated): (Vec<_>, Vec<_>) =
                infeasible.into_iter().partition(|start| is_found(start.vehicle));
            if found.is_empty() {
                for start in stated {
                    let place = self.places.get(&start.vehicle).cloned().unwrap_or_default();
                    root.problems.add(&place, start.message);
                }
                return;
            }
            for start in found {
                let slowed = self.vehicles.iter_mut().filter(|vehicle| vehicle.id == start.vehicle);
                slowed.for_each(|vehicle| vehicle.start.speed_mps = start.most_mps * SLOWER);
            }
        }
    }
}

/// Slowing a vehicle may make the one behind it infeasible: largest number of rounds.
const MOST_ROUNDS: usize = 64;
/// Start speed of a slowed vehicle as a share of the highest feasible one.
const SLOWER: f64 = 0.95;

/// Largest seed: TOML has no larger integers.
pub const MOST_SEED: u64 = i64::MAX as u64;
/// Characters of the longest name of a scenario: folders are named after it.
const LONGEST_NAME: usize = 100;

impl ScenarioReader<'_> {
    fn read(self, root: &TableFields<'_, '_>, text: &str, map_bytes: Vec<u8>) -> Experiment {
        let name =
            root.required_string("name", "a short name of the experiment").unwrap_or_default().to_owned();
        let length = name.chars().count();
        if length > LONGEST_NAME {
            root.wrong("name", format!("name has {length} characters; it may have {LONGEST_NAME}"));
        }
        let description = root.string("description").unwrap_or_default().to_owned();
        let seed = root.integer("seed", 0..=MOST_SEED).unwrap_or(1);
        let mut duration_s = root.required_number("duration_s", 0.01..=86_400.0);
        let mut warm_up_s = 0.0;
        root.number("warm_up_s", 0.0..=86_400.0, &mut warm_up_s);
        let mut link_timeout_s = 0.5;
        root.number("link_timeout_s", 0.02..=60.0, &mut link_timeout_s);
        let mut factor = LengthScale::TESTBED.factor();
        root.number("length_scale", 1.0..=100.0, &mut factor);
        let scale = LengthScale::new(factor).unwrap_or_default();
        let mut collisions_forbidden = true;
        root.boolean("collisions_forbidden", &mut collisions_forbidden);
        duration_s = self.overrides.duration_s.unwrap_or(duration_s);
        let seed = self.overrides.seed.unwrap_or(seed);
        let rates = read_rates(root);
        let named = NamedSettings::read(root, self.library, self.overrides.model, rates);
        let mut map = self.map;
        read_all_way_stops(root, &mut map);
        let signals = read_signals(root, &mut map, &named.worst_driver());
        let model = self.overrides.model;
        let basis = ReadContext { map: &map, models: self.models, scale, model, seed, duration_s, rates };
        let mut fleet = FleetBuilder::default();
        basis.read_vehicles(root, &named, &mut fleet);
        basis.read_traffic(root, &named, &mut fleet);
        let demand = basis.read_inflows(root, &named, &fleet);
        // Errors under these keys have been reported.
        let traffic_is_drawn = ["traffic", "inflow"].map(|key| root.entry(key).is_some()).contains(&true);
        let is_asked_for =
            ["vehicle", "traffic", "inflow"].map(|key| root.entry(key).is_some()).contains(&true);
        let needs_vehicles = !self.overrides.allows_no_vehicles && demand.inflows.is_empty();
        if needs_vehicles && fleet.is_empty() && (!is_asked_for || root.problems.is_empty()) {
            root.problems
                .add(&(0..0), "no vehicles: add [[vehicle]] or [[inflow]] tables, or a [traffic] table");
        }
        let (environment, testbed) = read_environment(root, self.overrides.environment);
        let city_map = Arc::new(map.to_city(scale));
        // Robots stand when an experiment begins, and other vehicles must not run into them.
        if fleet.vehicles.iter().any(|vehicle| vehicle.physical.is_some()) {
            fleet.vehicles.iter_mut().for_each(|vehicle| vehicle.start.speed_mps = 0.0);
        }
        // Positions are checked once every vehicle has one.
        let moved = if root.problems.is_empty() { fleet.place(root, &city_map, scale) } else { Vec::new() };
        if root.problems.is_empty() {
            fleet.check_starts(root, &map, scale, &moved);
            check_room_before_signals(root, &map, scale, &fleet.vehicles);
        }
        let arriving = demand.arrivals.iter().map(|arrival| &arrival.vehicle);
        let slowest = slowest_cav(fleet.vehicles.iter().chain(arriving));
        let coordination = read_coordination(root, &map, self.library, slowest);
        Experiment {
            name,
            description,
            seed,
            traffic_is_drawn,
            duration_s,
            warm_up_s,
            rates,
            scale,
            city_map,
            lab_map: Arc::new(map),
            vehicles: fleet.vehicles,
            moved,
            inflows: demand.inflows,
            arrivals: Arc::new(demand.arrivals),
            vehicle_types: named.types.into_iter().map(|(name, build)| (name, build.spec)).collect(),
            right_of_way: read_right_of_way(root),
            signals,
            control_zones: coordination.zones,
            coordination: coordination.rules,
            platoons: read_platoons(root),
            algorithms: self.library.algorithms().clone(),
            workers: Workers::of_machine(),
            environment,
            testbed,
            time_of_day: read_time_of_day(root),
            weather: read_weather(root),
            link_timeout_s,
            expectations: Expectations { collisions_forbidden },
            models: UserModels::default(),
            scenario_text: text.to_owned(),
            map_bytes,
            model,
            profile: self.overrides.environment,
        }
    }
}
