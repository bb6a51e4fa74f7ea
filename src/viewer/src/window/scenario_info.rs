//! What the panels show of an experiment besides its state: drivers, routes, cameras, steering and walls.

use crate::cockpit::SteeringGeometry;
use crate::ui::{ControlZoneArea, DriverNames, ScenarioCamera, ScenarioChoice, VehicleNames};
use city3d_logbook::measures::RunMeasures;
use city3d_protocol::snapshot::VehicleId;
use city3d_roadmap::LaneId;
use city3d_scene::{RoadsOut, SceneDescription, Wall};
use city3d_sensors::{Sensor, SensorKind};
use city3d_simulation::scenario::{Experiment, Library};
use std::collections::BTreeMap;

/// Data of an experiment for the panels.
pub(super) struct ScenarioInfo {
    pub names: VehicleNames,
    pub drivers: DriverNames,
    pub routes: BTreeMap<VehicleId, Vec<LaneId>>,
    pub cameras: BTreeMap<VehicleId, Vec<ScenarioCamera>>,
    pub steering_geometry: BTreeMap<VehicleId, SteeringGeometry>,
    pub control_zones: Vec<ControlZoneArea>,
    pub walls: Vec<Wall>,
    pub roads_out: RoadsOut,
    /// The vehicle that the scenario reserves for a person.
    pub own: Option<VehicleId>,
    /// Pedals, steering and lateral errors are known; otherwise only poses are.
    pub has_control_data: bool,
    /// Measures of the recorded run that is shown, where its folder has them.
    pub recorded: Option<RunMeasures>,
}

fn own_camera(sensor: &Sensor) -> ScenarioCamera {
    let SensorKind::Camera(camera) = sensor.kind;
    ScenarioCamera { name: sensor.name.clone(), mount: camera.mount, lens: camera.lens }
}

impl ScenarioInfo {
    pub fn of(experiment: &Experiment) -> Self {
        let arriving = || experiment.arrivals.iter().map(|arrival| &arrival.vehicle);
        let vehicles = || experiment.vehicles.iter().chain(arriving());
        Self {
            names: vehicles().map(|v| (v.id, v.name.clone())).collect(),
            drivers: vehicles().map(|v| (v.id, v.controller.clone())).collect(),
            routes: vehicles().map(|v| (v.id, v.route.clone())).collect(),
            cameras: vehicles().map(|v| (v.id, v.sensors.iter().map(own_camera).collect())).collect(),
            steering_geometry: vehicles()
                .map(|v| {
                    let wheelbase_m = v.spec.dimensions.wheelbase_m;
                    (v.id, SteeringGeometry { wheelbase_m, steering_limit_rad: v.spec.steering_limit_rad })
                })
                .collect(),
            control_zones: ControlZoneArea::all(experiment),
            walls: SceneDescription::walls_of(&experiment.city_map),
            roads_out: RoadsOut::of(&experiment.city_map),
            own: vehicles().find(|v| v.is_human).map(|v| v.id),
            has_control_data: true,
            recorded: None,
        }
    }
}

/// A shipped scenario with its description.
pub(super) fn choice(name: &str) -> ScenarioChoice {
    let text = Library::scenario(name).map(|(text, _)| text).unwrap_or_default();
    let table = text.parse::<toml::Table>().unwrap_or_default();
    let description = table.get("description").and_then(toml::Value::as_str).unwrap_or_default();
    ScenarioChoice { name: name.to_owned(), description: description.to_owned() }
}
