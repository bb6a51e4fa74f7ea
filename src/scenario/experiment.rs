//! A validated experiment: everything a run depends on, apart from the commands that come in.

use super::feasibility::STEERING_RESERVE;
use super::models::Models;
use super::placement::Moved;
use super::time_of_day::TimeOfDay;
use crate::city::{CityMap, LabMap, LaneId};
use crate::environment::{EnvironmentSpec, Profile};
use crate::geom::{LengthScale, Pose2, trig};
use crate::mainframe::{Body, CavSetup, DriverParams, RightOfWayParams};
use crate::sensor::Sensor;
use crate::snapshot::{Appearance, Dimensions, Setup, VehicleId};
use crate::vehicle::{ModelKind, VehicleSpec};
use std::collections::BTreeMap;
use std::sync::Arc;

/// How often things happen, per second of simulated time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rates {
    /// Physics steps.
    pub physics_hz: u32,
    /// Control steps; divides the physics rate.
    pub control_hz: u32,
}

impl Rates {
    pub fn dt_s(&self) -> f64 {
        1.0 / f64::from(self.physics_hz)
    }

    pub fn ticks_per_control(&self) -> u64 {
        u64::from(self.physics_hz / self.control_hz)
    }

    /// Simulated time of a tick.
    pub fn time_s(&self, tick: u64) -> f64 {
        tick as f64 / f64::from(self.physics_hz)
    }
}

impl Default for Rates {
    fn default() -> Self {
        Self { physics_hz: 100, control_hz: 50 }
    }
}

/// What a scenario expects of its run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Outcome {
    /// A collision makes the run fail.
    pub collisions_forbidden: bool,
}

/// Where a vehicle starts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Start {
    pub lane: LaneId,
    /// Front-axle centre along the lane, laboratory metres.
    pub at_m: f64,
    /// Laboratory m/s.
    pub speed_mps: f64,
}

/// One vehicle of an experiment.
#[derive(Clone, Debug, PartialEq)]
pub struct PlannedVehicle {
    pub id: VehicleId,
    pub name: String,
    pub appearance: Appearance,
    pub spec: VehicleSpec,
    /// Name of the control algorithm.
    pub controller: String,
    /// Laboratory units.
    pub driver: DriverParams,
    /// A person is at the wheel from the start; the algorithm drives once the person gives it back.
    pub is_human: bool,
    pub route: Vec<LaneId>,
    pub start: Start,
    pub sensors: Vec<Sensor>,
    /// Of a vehicle of the laboratory, which is measured instead of simulated.
    pub physical: Option<Physical>,
}

/// How a vehicle of the laboratory is reached.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Physical {
    /// UDP address that takes its trajectories.
    pub address: String,
    /// What motion capture knows it by.
    pub subject: String,
}

/// Middle of the outline of a vehicle of these measures, see [`PlannedVehicle::pose_on`].
pub fn pose_on(size: &Dimensions, map: &CityMap, lane: LaneId, axle_at_m: f64) -> Pose2 {
    let curve = &map.lane(lane).curve;
    let mut axle = curve.at(axle_at_m).pose;
    let curvature = curve.at(axle_at_m - size.wheelbase_m / 2.0).curvature;
    axle.yaw_rad -= trig::asin((size.wheelbase_m * curvature).clamp(-1.0, 1.0));
    axle.advanced(-size.front_axle_m())
}

impl PlannedVehicle {
    /// The measures that control needs, laboratory metres.
    pub fn body_in_lab(&self, scale: LengthScale) -> Body {
        Body {
            length_m: scale.lab_from_city(self.spec.dimensions.length_m),
            wheelbase_m: scale.lab_from_city(self.spec.dimensions.wheelbase_m),
            min_turn_radius_m: scale.lab_from_city(self.spec.min_turn_radius() * STEERING_RESERVE),
        }
    }

    /// Middle of the outline when its front-axle centre stands at a place of a lane, city metres. In a
    /// bend the body is turned as in a steady turn, its rear axle inside.
    pub fn pose_on(&self, map: &CityMap, lane: LaneId, axle_at_m: f64) -> Pose2 {
        pose_on(&self.spec.dimensions, map, lane, axle_at_m)
    }

    /// Where it starts: the middle of its outline, laboratory metres.
    pub fn pose_in_lab(&self, map: &CityMap, scale: LengthScale) -> Pose2 {
        let at_m = scale.city_from_lab(self.start.at_m);
        self.pose_on(map, self.start.lane, at_m).scaled(1.0 / scale.factor())
    }

    /// What brings it into the city. Its pose went through laboratory metres, so that it is the same to
    /// the last bit whether it came over the laboratory's link or not.
    pub fn setup(&self, map: &CityMap, scale: LengthScale) -> Setup {
        Setup {
            id: self.id,
            name: self.name.clone(),
            appearance: self.appearance,
            pose: self.pose_in_lab(map, scale).scaled(scale.factor()),
            speed_mps: scale.city_from_lab(self.start.speed_mps),
            spec: self.spec.clone(),
        }
    }
}

/// Everything a run depends on.
#[derive(Clone, Debug)]
pub struct Experiment {
    pub name: String,
    pub description: String,
    pub seed: u64,
    pub duration_s: f64,
    pub rates: Rates,
    pub scale: LengthScale,
    pub lab_map: Arc<LabMap>,
    pub city_map: Arc<CityMap>,
    /// In id order.
    pub vehicles: Vec<PlannedVehicle>,
    /// The builds that the file names; `default` is always there.
    pub vehicle_types: BTreeMap<String, VehicleSpec>,
    /// Those whose places overlapped others, already moved.
    pub moved: Vec<Moved>,
    pub right_of_way: RightOfWayParams,
    pub environment: EnvironmentSpec,
    /// What stands between control and the robots of `city3d testbed`.
    pub testbed: EnvironmentSpec,
    /// For pictures.
    pub time_of_day: TimeOfDay,
    /// Without a trajectory for so long a vehicle stops on its path.
    pub link_timeout_s: f64,
    pub outcome: Outcome,
    /// For pictures; nothing that moves depends on them.
    pub models: Models,
    /// The scenario file and the map, as they were read: what a log keeps.
    pub scenario_text: String,
    pub map_bytes: Vec<u8>,
    /// The dynamics model that all vehicles have been given instead of the scenario's.
    pub model: Option<ModelKind>,
    /// The environment that was asked for instead of the scenario's.
    pub profile: Option<Profile>,
}

impl Experiment {
    /// What the control framework is told of the vehicles.
    pub fn cav_setups(&self) -> Vec<CavSetup> {
        let setup = |vehicle: &PlannedVehicle| CavSetup {
            id: vehicle.id,
            controller: vehicle.controller.clone(),
            driver: vehicle.driver,
            body: vehicle.body_in_lab(self.scale),
            route: vehicle.route.clone(),
            speed_mps: vehicle.start.speed_mps,
        };
        self.vehicles.iter().map(setup).collect()
    }

    /// The vehicles of the laboratory among its vehicles.
    pub fn physical(&self) -> impl Iterator<Item = (&PlannedVehicle, &Physical)> {
        self.vehicles.iter().filter_map(|planned| Some((planned, planned.physical.as_ref()?)))
    }

    /// Whether a vehicle is one of the laboratory.
    pub fn is_physical(&self, vehicle: VehicleId) -> bool {
        self.physical().any(|(planned, _)| planned.id == vehicle)
    }

    /// The same without its vehicles: they come over the link.
    pub fn without_vehicles(self) -> Self {
        Self { vehicles: Vec::new(), moved: Vec::new(), ..self }
    }

    /// Number of physics steps of the whole run.
    pub fn ticks(&self) -> u64 {
        (self.duration_s * f64::from(self.rates.physics_hz)).round() as u64
    }
}
