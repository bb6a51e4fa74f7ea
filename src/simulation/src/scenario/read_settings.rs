//! Named and global settings of a scenario: vehicle types, drivers, rates, right of way, environment.

use super::experiment::Rates;
use super::fields::{TableFields, one_of};
use super::source::Library;
use super::vehicle_type::{VehicleType, read_vehicle_type};
use crate::environment::{EnvironmentProfile, EnvironmentSpec};
use city3d_control::{DriverParams, RightOfWayParams};
use city3d_dynamics::vehicle::ModelKind;
use std::collections::BTreeMap;

/// Named settings that vehicles refer to.
pub struct NamedSettings {
    /// Vehicle types; `default` always exists.
    pub types: BTreeMap<String, VehicleType>,
    /// Control algorithm and parameters.
    pub drivers: NamedDrivers,
}

impl NamedSettings {
    /// `model` replaces that of every type.
    pub fn read(
        root: &TableFields<'_, '_>,
        library: &Library,
        model: Option<ModelKind>,
        rates: Rates,
    ) -> Self {
        Self { types: read_types(root, model, rates), drivers: read_drivers(root, library) }
    }

    /// What signals have to reckon with: the fastest driver, the weakest braking and the longest response.
    pub fn worst_driver(&self) -> DriverParams {
        let drivers = || self.drivers.values().map(|(_, driver)| driver);
        DriverParams {
            desired_speed_mps: drivers().map(|d| d.desired_speed_mps).fold(0.0, f64::max),
            min_acceleration_mps2: drivers()
                .map(|d| d.min_acceleration_mps2)
                .fold(f64::NEG_INFINITY, f64::max),
            response_time_s: drivers().map(|d| d.response_time_s).fold(0.0, f64::max),
            ..DriverParams::default()
        }
    }
}

fn read_types(
    root: &TableFields<'_, '_>,
    model: Option<ModelKind>,
    rates: Rates,
) -> BTreeMap<String, VehicleType> {
    let mut types = BTreeMap::from([("default".to_owned(), VehicleType::default())]);
    if let Some(tables) = root.table("vehicle_type") {
        for (name, value) in tables.entries() {
            if let Some(fields) = tables.table_of(name.get_ref(), value) {
                types.insert(name.get_ref().to_string(), read_vehicle_type(fields, rates));
            }
        }
    }
    if let Some(model) = model {
        types.values_mut().for_each(|kind| kind.spec.model = model);
    }
    types
}

/// The named setting that a field refers to; "default" if the field is missing.
pub fn pick<T: Clone>(
    fields: &TableFields<'_, '_>,
    key: &'static str,
    named: &BTreeMap<String, T>,
) -> Option<T> {
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

/// Name of the human driver. Its parameters apply to the algorithm that drives after the person hands back.
pub const HUMAN: &str = "human";

/// Whether a table names the person as its driver.
pub fn is_human(fields: &TableFields<'_, '_>) -> bool {
    fields.entry("driver").and_then(|value| value.get_ref().as_str()) == Some(HUMAN)
}

/// Control algorithm and parameters by the name of the driver.
pub type NamedDrivers = BTreeMap<String, (String, DriverParams)>;

fn read_drivers(root: &TableFields<'_, '_>, library: &Library) -> NamedDrivers {
    let mut drivers = stated_drivers(root, library);
    // The person may hand over to an algorithm.
    let usual = drivers["default"].clone();
    drivers.entry(HUMAN.to_owned()).or_insert(usual);
    drivers
}

/// The drivers of the file, and the default one.
fn stated_drivers(root: &TableFields<'_, '_>, library: &Library) -> NamedDrivers {
    let mut drivers = BTreeMap::from([("default".to_owned(), ("idm".to_owned(), DriverParams::default()))]);
    let Some(tables) = root.table("driver") else { return drivers };
    for (name, value) in tables.entries() {
        let Some(fields) = tables.table_of(name.get_ref(), value) else { continue };
        let controller = fields.string("controller").unwrap_or("idm").to_owned();
        let is_known = library.algorithms().drivers.names().any(|name| name == controller);
        if !is_known && !library.is_of_log() {
            let remedy = one_of(&controller, library.algorithms().drivers.names());
            fields.wrong("controller", format!("there is no control algorithm \"{controller}\"; {remedy}"));
        }
        let mut params = DriverParams::default();
        fields.number("desired_speed_mps", 0.01..=2.0, &mut params.desired_speed_mps);
        fields.number("max_acceleration_mps2", 0.001..=10.0, &mut params.max_acceleration_mps2);
        fields.number("min_acceleration_mps2", -10.0..=-0.001, &mut params.min_acceleration_mps2);
        fields.number("headway_s", 0.1..=10.0, &mut params.headway_s);
        fields.number("response_time_s", 0.0..=2.0, &mut params.response_time_s);
        fields.number("standstill_gap_m", 0.005..=1.0, &mut params.standstill_gap_m);
        fields.number("exponent", 1.0..=10.0, &mut params.exponent);
        fields.number("lateral_acceleration_mps2", 0.001..=10.0, &mut params.lateral_acceleration_mps2);
        fields.number("amplitude_mps", 0.0..=1.0, &mut params.amplitude_mps);
        fields.number("frequency_hz", 0.0..=5.0, &mut params.frequency_hz);
        fields.finish();
        drivers.insert(name.get_ref().to_string(), (controller, params));
    }
    drivers
}

/// Reads `[rates]`; missing fields keep their defaults.
pub fn read_rates(root: &TableFields<'_, '_>) -> Rates {
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

/// Reads `[right_of_way]`; missing fields keep their defaults.
pub fn read_right_of_way(root: &TableFields<'_, '_>) -> RightOfWayParams {
    let mut params = RightOfWayParams::default();
    if let Some(fields) = root.table("right_of_way") {
        fields.number("clear_area_m", 0.0..=10.0, &mut params.clear_area_m);
        fields.number("clear_time_s", 0.0..=30.0, &mut params.clear_time_s);
        fields.number("patience_s", 0.0..=3600.0, &mut params.patience_s);
        fields.boolean("full_stop", &mut params.full_stop);
        fields.number("reroute_s", 1.0..=1e9, &mut params.reroute_s);
        // Changes the lines of the map, and is read with them.
        fields.entry("all_way_stop");
        fields.finish();
    }
    params
}

/// The environment of the scenario or its override; and that of robots, which is always a laboratory's.
pub fn read_environment(
    root: &TableFields<'_, '_>,
    instead: Option<EnvironmentProfile>,
) -> (EnvironmentSpec, EnvironmentSpec) {
    let mut profile = EnvironmentProfile::Ideal;
    let mut testbed = EnvironmentSpec::TESTBED;
    let fields = root.table("environment");
    if let Some(fields) = &fields {
        fields.choice(
            "profile",
            &EnvironmentProfile::ALL.map(|profile| (profile.name(), profile)),
            &mut profile,
        );
        if let Some(fields) = fields.table("testbed") {
            read_conditions(&fields, &mut testbed);
            fields.finish();
        }
    }
    let profile = instead.unwrap_or(profile);
    let mut spec = match profile {
        EnvironmentProfile::Ideal => EnvironmentSpec::IDEAL,
        EnvironmentProfile::Testbed => testbed,
    };
    if let Some(fields) = fields {
        read_conditions(&fields, &mut spec);
        fields.finish();
    }
    let robots = if profile == EnvironmentProfile::Testbed { spec } else { testbed };
    (spec, robots)
}

fn read_conditions(fields: &TableFields<'_, '_>, spec: &mut EnvironmentSpec) {
    fields.number("measurement_delay_s", 0.0..=5.0, &mut spec.measurement_delay_s);
    fields.number("command_delay_s", 0.0..=5.0, &mut spec.command_delay_s);
    fields.number("jitter_s", 0.0..=5.0, &mut spec.jitter_s);
    fields.number("loss", 0.0..=0.99, &mut spec.loss);
    fields.number("position_noise_m", 0.0..=0.1, &mut spec.position_noise_m);
    fields.number("yaw_noise_rad", 0.0..=0.5, &mut spec.yaw_noise_rad);
    fields.number("occlusion_every_s", 0.0..=3600.0, &mut spec.occlusion_every_s);
    fields.number("occlusion_s", 0.0..=60.0, &mut spec.occlusion_s);
    fields.number("actuator_lag_s", 0.0..=2.0, &mut spec.actuator_lag_s);
    fields.number("speed_disturbance", 0.0..=0.5, &mut spec.speed_disturbance);
    fields.number("disturbance_time_s", 0.0..=3600.0, &mut spec.disturbance_time_s);
}
