//! A scenario file that is edited: vehicles are added, changed and removed, and everything else stays as it was written,
//! with its comments, order and spelling.

mod layout;
#[cfg(test)]
mod tests;

use super::read_sensors::MOUNTS;
use super::read_settings::HUMAN;
use super::vehicle_type::MODELS;
use city3d_protocol::snapshot::{BodyType, VehicleId};
use layout::{keep_comments, put_behind, replace_value, set_route};
use std::fmt;
use thiserror::Error;
use toml_edit::{Array, ArrayOfTables, DocumentMut, Item, Table, Value, value};

/// Why a scenario cannot be edited.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum EditError {
    /// The text is no TOML.
    #[error("this is not TOML: {0}")]
    Syntax(String),
    /// The vehicles are not written as `[[vehicle]]` tables.
    #[error("the vehicles are written as an inline list; write them as [[vehicle]] tables to edit them here")]
    Inline,
}

/// A vehicle as its `[[vehicle]]` table states it. What the table leaves out is `None`, or its default.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StatedVehicle {
    /// Stated, or by its place in the file.
    pub id: VehicleId,
    /// Stated, or by its id.
    pub name: String,
    /// Name of a `[vehicle_type]`.
    pub vehicle_type: Option<String>,
    /// Dynamics model in place of the type's.
    pub model: Option<String>,
    /// Body type, or a `.glb` file.
    pub shape: Option<String>,
    /// Name of a `[driver]`, or `human`.
    pub driver: Option<String>,
    /// Lanes: the first, those in between, the last.
    pub route: Vec<String>,
    /// Front-axle centre along the first lane, laboratory metres.
    pub at_m: f64,
    /// Initial speed, laboratory m/s.
    pub speed_mps: f64,
    /// It leaves the city at the end of its route.
    pub leaves: bool,
    /// Mounts of its own cameras; `None` where it carries the sensors of its type.
    pub cameras: Option<Vec<String>>,
}

/// A change of a vehicle. `None` takes the key out, so that the default applies.
#[derive(Clone, Debug, PartialEq)]
pub enum VehicleEdit {
    /// Another name.
    Name(String),
    /// Another `[vehicle_type]`.
    Type(Option<String>),
    /// Another dynamics model.
    Model(Option<String>),
    /// Another body type.
    Shape(Option<String>),
    /// Another `[driver]`, or `human`.
    Driver(Option<String>),
    /// Another route: names of lanes.
    Route(Vec<String>),
    /// Another start along the first lane, laboratory metres.
    At(f64),
    /// Another initial speed, laboratory m/s.
    Speed(f64),
    /// Whether it leaves the city at the end of its route.
    Leaves(bool),
    /// Own cameras by their mounts, or the sensors of its type.
    Cameras(Option<Vec<String>>),
}

/// The text of a scenario, and the changes of it.
#[derive(Clone, Debug)]
pub struct ScenarioDocument {
    document: DocumentMut,
}

/// Names of the keys that are written.
const NAME: &str = "name";
const DESCRIPTION: &str = "description";
const VEHICLE: &str = "vehicle";
const SENSOR: &str = "sensor";

impl ScenarioDocument {
    /// Mounts of cameras that a vehicle may carry.
    pub fn mounts() -> impl Iterator<Item = &'static str> {
        MOUNTS.iter().map(|(name, _)| *name)
    }

    /// Dynamics models that a vehicle may have.
    pub fn models() -> impl Iterator<Item = &'static str> {
        MODELS.iter().map(|(name, _)| *name)
    }

    /// Body types that a vehicle may have besides those of `.glb` files.
    pub fn shapes() -> impl Iterator<Item = &'static str> {
        BodyType::SHIPPED.iter().map(|(name, _)| *name)
    }

    /// Takes a scenario for editing; whether it can be run is not looked at.
    ///
    /// # Errors
    /// Where the text is no TOML, or its vehicles are inline tables.
    pub fn parse(text: &str) -> Result<Self, EditError> {
        let document: DocumentMut =
            text.parse().map_err(|error: toml_edit::TomlError| EditError::Syntax(error.to_string()))?;
        match document.get(VEHICLE) {
            None | Some(Item::ArrayOfTables(_)) => Ok(Self { document }),
            Some(_) => Err(EditError::Inline),
        }
    }

    /// Sets the name of the scenario.
    pub fn set_name(&mut self, name: &str) {
        replace_value(self.document.as_table_mut(), NAME, Value::from(name));
    }

    /// What the scenario is about; empty where the file does not say it.
    pub fn description(&self) -> &str {
        self.document.get(DESCRIPTION).and_then(Item::as_str).unwrap_or_default()
    }

    /// Sets the description, behind the name where there was none; an empty one is taken out.
    pub fn set_description(&mut self, description: &str) {
        let is_new = !self.document.contains_key(DESCRIPTION);
        let table = self.document.as_table_mut();
        set_or_remove(table, DESCRIPTION, (!description.is_empty()).then(|| description.into()));
        if is_new {
            put_behind(table, DESCRIPTION, NAME);
        }
    }

    /// The vehicles in the order of the file.
    pub fn vehicles(&self) -> Vec<StatedVehicle> {
        let tables = self.document.get(VEHICLE).and_then(Item::as_array_of_tables);
        tables
            .into_iter()
            .flat_map(ArrayOfTables::iter)
            .enumerate()
            .map(|(k, table)| stated(k, table))
            .collect()
    }

    /// Names of the `[vehicle_type]` tables; `default` is always there.
    pub fn types(&self) -> Vec<String> {
        self.names_in("vehicle_type", &["default"])
    }

    /// Names of the `[driver]` tables; `default` and `human` are always there.
    pub fn drivers(&self) -> Vec<String> {
        self.names_in("driver", &["default", HUMAN])
    }

    /// Control algorithm of vehicles without a driver.
    pub fn default_controller(&self) -> &str {
        let driver = self.document.get("driver").and_then(|drivers| drivers.get("default"));
        driver.and_then(|driver| driver.get("controller")).and_then(Item::as_str).unwrap_or("idm")
    }

    /// States a `[driver]` of this name with a control algorithm, unless there is one of this name.
    pub fn state_driver(&mut self, name: &str, controller: &str) {
        let mut drivers = Table::new();
        drivers.set_implicit(true);
        let drivers = self.document.entry("driver").or_insert(Item::Table(drivers));
        let Some(drivers) = drivers.as_table_mut().filter(|drivers| !drivers.contains_key(name)) else {
            return;
        };
        let mut driver = Table::new();
        driver.decor_mut().set_prefix("\n");
        driver.insert("controller", value(controller));
        drivers.insert(name, Item::Table(driver));
    }

    fn names_in(&self, key: &str, always: &[&str]) -> Vec<String> {
        let tables = self.document.get(key).and_then(Item::as_table_like);
        let stated = tables.into_iter().flat_map(|tables| tables.iter()).map(|(name, _)| name.to_owned());
        let mut names: Vec<String> = always.iter().map(|name| (*name).to_owned()).collect();
        names.extend(stated.filter(|name| !always.contains(&name.as_str())));
        names
    }

    /// Adds a vehicle behind the last one; returns its place in the file. Its id follows from the place. Keys with default
    /// values are left out.
    pub fn add_vehicle(&mut self, vehicle: &StatedVehicle) -> usize {
        let mut table = Table::new();
        table.decor_mut().set_prefix("\n");
        table.insert("name", value(&vehicle.name));
        let vehicles = self.document.entry(VEHICLE).or_insert(Item::ArrayOfTables(ArrayOfTables::new()));
        // `parse` has refused everything else.
        let Some(vehicles) = vehicles.as_array_of_tables_mut() else { return 0 };
        let index = vehicles.len();
        vehicles.push(table);
        for edit in [
            VehicleEdit::Type(vehicle.vehicle_type.clone()),
            VehicleEdit::Model(vehicle.model.clone()),
            VehicleEdit::Shape(vehicle.shape.clone()),
            VehicleEdit::Driver(vehicle.driver.clone()),
            VehicleEdit::Route(vehicle.route.clone()),
            VehicleEdit::At(vehicle.at_m),
            VehicleEdit::Speed(vehicle.speed_mps),
            VehicleEdit::Leaves(vehicle.leaves),
            VehicleEdit::Cameras(vehicle.cameras.clone()),
        ] {
            self.edit_vehicle(index, edit);
        }
        index
    }

    /// Removes the vehicle at a place in the file. Comments above it stay. Without a vehicle at this place nothing happens.
    pub fn remove_vehicle(&mut self, index: usize) {
        let Some(vehicles) = self.tables() else { return };
        if index >= vehicles.len() {
            return;
        }
        let removed = vehicles.remove(index);
        if vehicles.is_empty() {
            self.document.remove(VEHICLE);
        }
        keep_comments(&mut self.document, &removed);
    }

    /// Changes the vehicle at a place in the file. Without a vehicle at this place nothing happens.
    pub fn edit_vehicle(&mut self, index: usize, edit: VehicleEdit) {
        let Some(table) = self.tables().and_then(|tables| tables.get_mut(index)) else { return };
        match edit {
            VehicleEdit::Name(name) => replace_value(table, "name", name.into()),
            VehicleEdit::Type(of) => set_or_remove(table, "type", of.map(Value::from)),
            VehicleEdit::Model(model) => set_or_remove(table, "model", model.map(Value::from)),
            VehicleEdit::Shape(shape) => set_or_remove(table, "shape", shape.map(Value::from)),
            VehicleEdit::Driver(driver) => set_or_remove(table, "driver", driver.map(Value::from)),
            VehicleEdit::Route(lanes) => set_route(table, &lanes),
            VehicleEdit::At(at_m) => replace_value(table, "at_m", at_m.into()),
            VehicleEdit::Speed(mps) => {
                let states_it = table.contains_key("speed_mps") || mps != 0.0;
                set_or_remove(table, "speed_mps", states_it.then(|| mps.into()));
            }
            VehicleEdit::Leaves(leaves) => set_or_remove(table, "leaves", leaves.then(|| true.into())),
            VehicleEdit::Cameras(None) => _ = table.remove(SENSOR),
            VehicleEdit::Cameras(Some(mounts)) => set_cameras(table, &mounts),
        }
    }

    fn tables(&mut self) -> Option<&mut ArrayOfTables> {
        self.document.get_mut(VEHICLE).and_then(Item::as_array_of_tables_mut)
    }
}

impl fmt::Display for ScenarioDocument {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.document.fmt(f)
    }
}

fn stated(index: usize, table: &Table) -> StatedVehicle {
    let text = |key: &str| table.get(key).and_then(Item::as_str).map(str::to_owned);
    let number = |key: &str| {
        let item = table.get(key);
        item.and_then(|item| item.as_float().or_else(|| item.as_integer().map(|whole| whole as f64)))
    };
    let id = table.get("id").and_then(Item::as_integer).and_then(|id| u32::try_from(id).ok());
    let id = id.unwrap_or(index as u32 + 1);
    let route = table.get("route").and_then(Item::as_array);
    let lanes = route.into_iter().flat_map(Array::iter).filter_map(Value::as_str);
    StatedVehicle {
        id: VehicleId(id),
        name: text("name").unwrap_or_else(|| format!("cav{id}")),
        vehicle_type: text("type"),
        model: text("model"),
        shape: text("shape"),
        driver: text("driver"),
        route: lanes.map(str::to_owned).collect(),
        at_m: number("at_m").unwrap_or_default(),
        speed_mps: number("speed_mps").unwrap_or_default(),
        leaves: table.get("leaves").and_then(Item::as_bool).unwrap_or_default(),
        cameras: table.get(SENSOR).map(|sensors| {
            let tables = sensors.as_array_of_tables().into_iter().flat_map(ArrayOfTables::iter);
            tables.filter_map(mount_of).map(str::to_owned).collect()
        }),
    }
}

/// Mount of a sensor; `None` where it has a position of its own.
fn mount_of(sensor: &Table) -> Option<&str> {
    match sensor.get("mount") {
        Some(mount) => mount.as_str(),
        None if sensor.contains_key("position_m") => None,
        None => MOUNTS.first().map(|(name, _)| *name),
    }
}

fn set_or_remove(table: &mut Table, key: &str, new: Option<Value>) {
    match new {
        Some(new) => replace_value(table, key, new),
        None => _ = table.remove(key),
    }
}

/// Gives a vehicle exactly one camera at each of these mounts. Sensors with positions of their own stay, and so do those
/// that are at one of the mounts already.
fn set_cameras(table: &mut Table, mounts: &[String]) {
    let mut sensors = match table.remove(SENSOR) {
        Some(Item::ArrayOfTables(sensors)) => sensors,
        _ => ArrayOfTables::new(),
    };
    sensors.retain(|sensor| mount_of(sensor).is_none_or(|at| mounts.iter().any(|mount| mount == at)));
    let missing =
        mounts.iter().filter(|mount| !sensors.iter().any(|sensor| mount_of(sensor) == Some(mount.as_str())));
    let missing: Vec<&String> = missing.collect();
    for mount in missing {
        let mut sensor = Table::new();
        sensor.decor_mut().set_prefix("\n");
        sensor.insert("kind", value("camera"));
        sensor.insert("mount", value(mount));
        sensors.push(sensor);
    }
    let item = if sensors.is_empty() { value(Array::new()) } else { Item::ArrayOfTables(sensors) };
    table.insert(SENSOR, item);
}
