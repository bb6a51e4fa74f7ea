//! From the text of a scenario file to an [`Experiment`].

use super::experiment::{Experiment, Outcome, PlannedVehicle, Rates, Start};
use super::feasibility::infeasibilities;
use super::fields::{Fields, Problem, Problems, one_of};
use super::traffic::{self, Share, TrafficError, TrafficSpec};
use super::vehicle_type::{MODELS, read_vehicle_type};
use super::{Library, SourceError, placement};
use crate::city::{LabMap, LaneId, load_map};
use crate::environment::EnvironmentSpec;
use crate::geom::LengthScale;
use crate::mainframe::{CONTROLLERS, DriverParams, RightOfWayParams};
use crate::snapshot::{Appearance, BodyType, VehicleId};
use crate::vehicle::{ModelKind, VehicleSpec};
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
    Scenario { file: String, problems: Vec<Problem> },
    /// Problems of the map that the scenario names.
    #[error("{}", join(file, problems))]
    Map { file: String, problems: Vec<String> },
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

/// What the command line may change of a scenario.
#[derive(Clone, Copy, Debug, Default)]
pub struct Overrides {
    pub seed: Option<u64>,
    pub duration_s: Option<f64>,
    /// All vehicles get this dynamics model.
    pub model: Option<ModelKind>,
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
    let problems = Problems::new(text);
    let (document, syntax_errors) = DeTable::parse_recoverable(text);
    for error in &syntax_errors {
        problems.add(&error.span().unwrap_or(0..0), error.message().to_owned());
    }
    let fail = |problems: Problems<'_>| ScenarioError::Scenario {
        file: file.to_owned(),
        problems: problems.into_sorted(),
    };
    if !syntax_errors.is_empty() {
        return Err(fail(problems));
    }
    let root = Fields::new(document.get_ref(), 0..0, &problems);
    let map_name = root.string("map").unwrap_or("ids3c");
    let map_bytes = match library.map(map_name) {
        Ok(bytes) => bytes,
        Err(error) => {
            root.wrong("map", error.to_string());
            return Err(fail(problems));
        }
    };
    let loaded = load_map(&map_bytes).map_err(|errors| ScenarioError::Map {
        file: map_name.to_owned(),
        problems: errors.listed.iter().map(ToString::to_string).collect(),
    })?;
    let experiment = Reader { map: Arc::new(loaded.map), overrides }.read(&root, text, map_bytes);
    root.finish();
    if problems.is_empty() { Ok(experiment) } else { Err(fail(problems)) }
}

struct Reader {
    map: Arc<LabMap>,
    overrides: Overrides,
}

/// Named parts of the file that vehicles refer to.
struct Named {
    types: BTreeMap<String, VehicleSpec>,
    drivers: BTreeMap<String, (String, DriverParams)>,
}

impl Reader {
    fn read(&self, root: &Fields<'_, '_>, text: &str, map_bytes: Vec<u8>) -> Experiment {
        let name =
            root.required_string("name", "a short name of the experiment").unwrap_or_default().to_owned();
        let description = root.string("description").unwrap_or_default().to_owned();
        let seed = root.integer("seed", 0..=i64::MAX as u64).unwrap_or(1);
        let mut duration_s = root.required_number("duration_s", 0.01..=86_400.0);
        let mut link_timeout_s = 0.5;
        root.number("link_timeout_s", 0.02..=60.0, &mut link_timeout_s);
        let mut factor = LengthScale::TESTBED.factor();
        root.number("length_scale", 1.0..=1000.0, &mut factor);
        let scale = LengthScale::new(factor).unwrap_or_default();
        let mut collisions_forbidden = true;
        root.boolean("collisions_forbidden", &mut collisions_forbidden);
        duration_s = self.overrides.duration_s.unwrap_or(duration_s);
        let seed = self.overrides.seed.unwrap_or(seed);
        let named = Named { types: self.read_types(root), drivers: read_drivers(root) };
        let mut vehicles = self.read_vehicles(root, scale, &named);
        self.read_traffic(root, scale, &named, seed, duration_s, &mut vehicles);
        if vehicles.is_empty() {
            root.problems.add(&(0..0), "no vehicles: add [[vehicle]] tables or a [traffic] table");
        }
        vehicles.sort_by_key(|vehicle| vehicle.id);
        let city_map = Arc::new(self.map.to_city(scale));
        let moved = placement::resolve(&city_map, scale, &mut vehicles).unwrap_or_else(|id| {
            let message =
                format!("vehicle {id} overlaps another at the start, and behind it no place is free");
            root.problems.add(&(0..0), message);
            Vec::new()
        });
        Experiment {
            name,
            description,
            seed,
            duration_s,
            rates: read_rates(root),
            scale,
            city_map,
            lab_map: Arc::clone(&self.map),
            vehicles,
            moved,
            right_of_way: read_right_of_way(root),
            environment: read_environment(root),
            link_timeout_s,
            outcome: Outcome { collisions_forbidden },
            scenario_text: text.to_owned(),
            map_bytes,
        }
    }

    fn read_types(&self, root: &Fields<'_, '_>) -> BTreeMap<String, VehicleSpec> {
        let mut types = BTreeMap::from([("default".to_owned(), VehicleSpec::default())]);
        if let Some(tables) = root.table("vehicle_type") {
            for (name, value) in tables.entries() {
                if let Some(fields) = tables.table_of(name.get_ref(), value) {
                    types.insert(name.get_ref().to_string(), read_vehicle_type(fields));
                }
            }
        }
        if let Some(model) = self.overrides.model {
            types.values_mut().for_each(|spec| spec.model = model);
        }
        types
    }

    fn read_vehicles(&self, root: &Fields<'_, '_>, scale: LengthScale, named: &Named) -> Vec<PlannedVehicle> {
        let mut vehicles: Vec<PlannedVehicle> = Vec::new();
        for (index, fields) in root.tables("vehicle").into_iter().enumerate() {
            let default_id = index as u64 + 1;
            let id = VehicleId(fields.integer("id", 0..=65_535).unwrap_or(default_id) as u32);
            let name = fields.string("name").map_or_else(|| format!("cav{id}"), str::to_owned);
            if let Some(other) = vehicles.iter().find(|other| other.id == id) {
                fields.wrong("id", format!("vehicle id {id} is taken by \"{}\"; choose another", other.name));
            }
            if vehicles.iter().any(|other| other.name == name) {
                fields.wrong("name", format!("the name \"{name}\" is taken; choose another"));
            }
            if !is_topic_name(&name) {
                let remedy =
                    "use letters, digits and underscores, a letter first: it becomes part of a ROS topic";
                fields.wrong("name", format!("\"{name}\" cannot be a name; {remedy}"));
            }
            let vehicle = self.read_vehicle(&fields, id, name, named);
            if let Some(vehicle) = vehicle {
                for problem in infeasibilities(&self.map, scale, &vehicle) {
                    fields.problems.add(&fields.span_of("route"), problem);
                }
                vehicles.push(vehicle);
            }
            fields.finish();
        }
        vehicles
    }

    fn read_vehicle(
        &self,
        fields: &Fields<'_, '_>,
        id: VehicleId,
        name: String,
        named: &Named,
    ) -> Option<PlannedVehicle> {
        let appearance = read_appearance(fields, id);
        let spec = self.read_spec(fields, named);
        let driver = pick(fields, "driver", &named.drivers);
        let route = self.read_route(fields);
        let mut at_m = f64::NAN;
        fields.number("at_m", 0.0..=1000.0, &mut at_m);
        if at_m.is_nan() && fields.entry("at_m").is_none() {
            let meaning = "at_m is missing: where on the first lane of the route the front axle starts";
            fields.problems.add(&fields.span, format!("{meaning}, in laboratory metres"));
        }
        let mut speed_mps = 0.0;
        fields.number("speed_mps", 0.0..=2.0, &mut speed_mps);
        let (spec, (controller, driver), route) = (spec?, driver?, route?);
        let length_m = self.map.lane(route[0]).curve.length();
        if at_m > length_m {
            let lane = &self.map.lane(route[0]).name;
            fields.wrong("at_m", format!("at_m is {at_m}; lane \"{lane}\" is only {length_m:.3} m long"));
        }
        let start = Start { lane: route[0], at_m, speed_mps };
        Some(PlannedVehicle { id, name, appearance, spec, controller, driver, route, start })
    }

    fn read_spec(&self, fields: &Fields<'_, '_>, named: &Named) -> Option<VehicleSpec> {
        let mut spec = pick(fields, "type", &named.types)?;
        fields.choice("model", &MODELS, &mut spec.model);
        if let Some(model) = self.overrides.model {
            spec.model = model;
        }
        Some(spec)
    }

    /// Lane names, first to last, joined by the shortest ways.
    fn read_route(&self, fields: &Fields<'_, '_>) -> Option<Vec<LaneId>> {
        let Some(names) = fields.strings("route") else {
            if fields.entry("route").is_none() {
                let meaning =
                    "route is missing: names of lanes, the first where it starts, the last where it ends";
                fields.problems.add(&fields.span, meaning);
            }
            return None;
        };
        let mut route: Vec<LaneId> = Vec::new();
        for (name, span) in &names {
            let lane = self.lane(fields, name, span)?;
            let Some(&last) = route.last() else {
                route.push(lane);
                continue;
            };
            let Some(way) = self.map.shortest_route(last, lane, |_| true) else {
                let from = &self.map.lane(last).name;
                fields.problems.add(span, format!("no way leads from lane \"{from}\" to lane \"{name}\""));
                return None;
            };
            route.extend_from_slice(&way[1..]);
        }
        if route.is_empty() {
            fields.wrong("route", "route is empty; name at least the lane where the vehicle starts");
            return None;
        }
        Some(route)
    }

    fn lane(&self, fields: &Fields<'_, '_>, name: &str, span: &Range<usize>) -> Option<LaneId> {
        let lane = self.map.lane_by_name(name);
        if lane.is_none() {
            let remedy = one_of(name, self.map.lanes.iter().map(|lane| lane.name.as_str()));
            fields.problems.add(span, format!("the map has no lane \"{name}\"; {remedy}"));
        }
        lane.map(|lane| lane.id)
    }

    fn read_traffic(
        &self,
        root: &Fields<'_, '_>,
        scale: LengthScale,
        named: &Named,
        seed: u64,
        duration_s: f64,
        vehicles: &mut Vec<PlannedVehicle>,
    ) {
        let Some(fields) = root.table("traffic") else { return };
        let count = fields.integer("vehicles", 1..=10_000).unwrap_or(50) as usize;
        let (mut spread, mut start_speed_mps) = (0.1, 0.0);
        fields.number("spread", 0.0..=0.5, &mut spread);
        fields.number("start_speed_mps", 0.0..=1.0, &mut start_speed_mps);
        let shares = read_shares(&fields, named);
        let driver = pick(&fields, "driver", &named.drivers);
        let span = fields.span.clone();
        fields.finish();
        let Some((controller, driver)) = driver.filter(|_| !shares.is_empty()) else { return };
        let fastest = driver.desired_speed_mps * (1.0 + spread);
        let spec = TrafficSpec {
            vehicles: count,
            shares,
            controller,
            driver,
            spread,
            route_length_m: fastest * duration_s + 10.0,
        };
        let drawn = match traffic::draw(&self.map, scale, seed, &spec) {
            Ok(drawn) => drawn,
            Err(error) => {
                root.problems.add(&span, error_text(error, count));
                return;
            }
        };
        let mut is_infeasible = false;
        let first_id = vehicles.iter().map(|vehicle| vehicle.id.0).max().unwrap_or(0) + 1;
        for (drawn, id) in drawn.into_iter().zip((first_id..).map(VehicleId)) {
            let vehicle = PlannedVehicle {
                id,
                name: format!("cav{id}"),
                appearance: default_appearance(id),
                start: Start { lane: drawn.route[0], at_m: drawn.at_m, speed_mps: start_speed_mps },
                spec: drawn.spec,
                controller: spec.controller.clone(),
                driver: drawn.driver,
                route: drawn.route,
            };
            // One vehicle that cannot do it stands for all that are built alike.
            let problems = infeasibilities(&self.map, scale, &vehicle);
            if !is_infeasible {
                problems.iter().for_each(|problem| root.problems.add(&span, problem));
            }
            is_infeasible |= !problems.is_empty();
            vehicles.push(vehicle);
        }
    }
}

fn error_text(error: TrafficError, count: usize) -> String {
    match error {
        TrafficError::NoRoom { placed } => {
            format!("vehicles = {count}, and the map has starting places for {placed}; ask for fewer")
        }
        TrafficError::NoNetwork { share } => format!(
            "vehicles of type number {} in shares find no closed way on this map that they can drive; \
             give them a larger steering_limit_deg",
            share + 1
        ),
    }
}

/// The named thing a field refers to; the one called "default" where the field is not there.
fn pick<T: Clone>(fields: &Fields<'_, '_>, key: &'static str, named: &BTreeMap<String, T>) -> Option<T> {
    let name = match fields.entry(key) {
        Some(_) => fields.string(key)?,
        None => "default",
    };
    let found = named.get(name).cloned();
    if found.is_none() {
        fields.wrong(
            key,
            format!("{key} \"{name}\" is not defined; {}", one_of(name, named.keys().map(String::as_str))),
        );
    }
    found
}

fn read_shares(fields: &Fields<'_, '_>, named: &Named) -> Vec<Share> {
    let Some(table) = fields.table("types") else {
        return vec![Share { spec: named.types["default"].clone(), weight: 1.0 }];
    };
    let mut shares = Vec::new();
    for (name, value) in table.entries() {
        let key: &str = name.get_ref();
        let Some(spec) = named.types.get(key) else {
            let remedy = one_of(key, named.types.keys().map(String::as_str));
            fields.problems.add(&name.span(), format!("vehicle type \"{key}\" is not defined; {remedy}"));
            continue;
        };
        let weight = match value.get_ref() {
            toml::de::DeValue::Float(weight) => weight.as_str().parse().ok(),
            toml::de::DeValue::Integer(weight) => weight.as_str().parse().ok(),
            _ => None,
        };
        match weight.filter(|weight: &f64| weight.is_finite() && *weight > 0.0) {
            Some(weight) => shares.push(Share { spec: spec.clone(), weight }),
            None => {
                fields.problems.add(&value.span(), format!("the share of \"{key}\" must be a number above 0"))
            }
        }
    }
    shares
}

fn read_drivers(root: &Fields<'_, '_>) -> BTreeMap<String, (String, DriverParams)> {
    let mut drivers = BTreeMap::from([("default".to_owned(), ("idm".to_owned(), DriverParams::default()))]);
    let Some(tables) = root.table("driver") else { return drivers };
    for (name, value) in tables.entries() {
        let Some(fields) = tables.table_of(name.get_ref(), value) else { continue };
        let controller = fields.string("controller").unwrap_or("idm").to_owned();
        if !CONTROLLERS.contains(&controller.as_str()) {
            let remedy = one_of(&controller, CONTROLLERS.into_iter());
            fields.wrong("controller", format!("there is no control algorithm \"{controller}\"; {remedy}"));
        }
        let mut params = DriverParams::default();
        fields.number("desired_speed_mps", 0.01..=2.0, &mut params.desired_speed_mps);
        fields.number("max_acceleration_mps2", 0.001..=10.0, &mut params.max_acceleration_mps2);
        fields.number("min_acceleration_mps2", -10.0..=-0.001, &mut params.min_acceleration_mps2);
        fields.number("headway_s", 0.1..=10.0, &mut params.headway_s);
        fields.number("standstill_gap_m", 0.005..=1.0, &mut params.standstill_gap_m);
        fields.number("exponent", 1.0..=10.0, &mut params.exponent);
        fields.number("lateral_acceleration_mps2", 0.001..=10.0, &mut params.lateral_acceleration_mps2);
        fields.finish();
        drivers.insert(name.get_ref().to_string(), (controller, params));
    }
    drivers
}

fn read_rates(root: &Fields<'_, '_>) -> Rates {
    let mut rates = Rates::default();
    if let Some(fields) = root.table("rates") {
        let physics = fields.integer("physics_hz", 20..=2000).unwrap_or(u64::from(rates.physics_hz));
        let control = fields.integer("control_hz", 1..=2000).unwrap_or(u64::from(rates.control_hz));
        if physics % control != 0 {
            let message = format!("control_hz is {control}; it must divide physics_hz, which is {physics}");
            fields.wrong("control_hz", message);
        } else {
            rates = Rates { physics_hz: physics as u32, control_hz: control as u32 };
        }
        fields.finish();
    }
    rates
}

fn read_right_of_way(root: &Fields<'_, '_>) -> RightOfWayParams {
    let mut params = RightOfWayParams::default();
    if let Some(fields) = root.table("right_of_way") {
        fields.number("clear_area_m", 0.0..=10.0, &mut params.clear_area_m);
        fields.number("clear_time_s", 0.0..=30.0, &mut params.clear_time_s);
        fields.number("patience_s", 0.0..=3600.0, &mut params.patience_s);
        fields.boolean("full_stop", &mut params.full_stop);
        fields.number("reroute_s", 1.0..=1e9, &mut params.reroute_s);
        fields.finish();
    }
    params
}

fn read_environment(root: &Fields<'_, '_>) -> EnvironmentSpec {
    const PROFILES: [(&str, EnvironmentSpec); 2] =
        [("ideal", EnvironmentSpec::IDEAL), ("testbed", EnvironmentSpec::TESTBED)];
    let mut spec = EnvironmentSpec::IDEAL;
    if let Some(fields) = root.table("environment") {
        fields.choice("profile", &PROFILES, &mut spec);
        fields.number("measurement_delay_s", 0.0..=5.0, &mut spec.measurement_delay_s);
        fields.number("command_delay_s", 0.0..=5.0, &mut spec.command_delay_s);
        fields.number("jitter_s", 0.0..=5.0, &mut spec.jitter_s);
        fields.number("loss", 0.0..=0.99, &mut spec.loss);
        fields.number("position_noise_m", 0.0..=0.1, &mut spec.position_noise_m);
        fields.number("yaw_noise_rad", 0.0..=0.5, &mut spec.yaw_noise_rad);
        fields.finish();
    }
    spec
}

const BODIES: [(&str, BodyType); 4] = [
    ("sedan", BodyType::Sedan),
    ("hatchback", BodyType::Hatchback),
    ("suv", BodyType::Suv),
    ("van", BodyType::Van),
];

/// Colours that tell many cars apart and that cars are sold in.
const PALETTE: [[u8; 3]; 10] = [
    [178, 34, 34],
    [28, 79, 140],
    [230, 230, 226],
    [38, 40, 44],
    [222, 158, 28],
    [62, 112, 66],
    [150, 156, 162],
    [96, 48, 110],
    [206, 92, 30],
    [70, 140, 160],
];

fn default_appearance(id: VehicleId) -> Appearance {
    let index = id.0 as usize;
    Appearance {
        body: BODIES[index / PALETTE.len() % BODIES.len()].1,
        colour: PALETTE[index % PALETTE.len()],
    }
}

fn read_appearance(fields: &Fields<'_, '_>, id: VehicleId) -> Appearance {
    let mut appearance = default_appearance(id);
    fields.choice("shape", &BODIES, &mut appearance.body);
    if let Some(text) = fields.string("colour") {
        match parse_colour(text) {
            Some(colour) => appearance.colour = colour,
            None => fields.wrong("colour", format!("colour is \"{text}\"; write it as \"#rrggbb\"")),
        }
    }
    appearance
}

fn parse_colour(text: &str) -> Option<[u8; 3]> {
    let digits = text.strip_prefix('#').filter(|digits| digits.len() == 6 && digits.is_ascii())?;
    let value = u32::from_str_radix(digits, 16).ok()?;
    let [_, red, green, blue] = value.to_be_bytes();
    Some([red, green, blue])
}

/// Whether a text can be part of a ROS topic.
fn is_topic_name(name: &str) -> bool {
    let mut characters = name.chars();
    characters.next().is_some_and(|c| c.is_ascii_alphabetic())
        && name.len() <= 64
        && characters.all(|c| c.is_ascii_alphanumeric() || c == '_')
}
