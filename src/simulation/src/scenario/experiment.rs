//! A validated experiment: everything that a run depends on, apart from incoming commands.

use super::counted::counted;
use super::feasibility::STEERING_RESERVE;
use super::inflow::{Inflow, PlannedArrival};
use super::models::UserModels;
use super::placement::MovedStart;
use super::time_of_day::TimeOfDay;
use crate::environment::{EnvironmentProfile, EnvironmentSpec};
use city3d_control::coordination::ControlZone;
use city3d_control::coordination::platoon::PlatoonParams;
use city3d_control::{
    Algorithms, CavGeometry, CavSetup, CoordinationRules, DriverParams, RightOfWayParams, Role,
    SignalControl, SignalPlan, TrafficRules,
};
use city3d_dynamics::vehicle::{ModelKind, VehicleSpec};
use city3d_geometry::{Lab, LengthScale, Pose2, trig};
use city3d_protocol::snapshot::{Appearance, Dimensions, Setup, VehicleId};
use city3d_roadmap::{CityMap, LabMap, LaneId};
use city3d_sensors::{Sensor, Weather};
use city3d_workers::Workers;
use sha2::{Digest, Sha256};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// Step rates, per second of simulated time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rates {
    /// Physics steps.
    pub physics_hz: u32,
    /// Control steps; divides the physics rate.
    pub control_hz: u32,
}

impl Rates {
    /// Physics step, simulated seconds.
    pub fn dt_s(&self) -> f64 {
        1.0 / f64::from(self.physics_hz)
    }

    /// Physics steps from one control step to the next.
    ///
    /// # Panics
    /// When the control rate is 0.
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
pub struct Expectations {
    /// A collision makes the run fail.
    pub collisions_forbidden: bool,
}

/// Start state of a vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Start {
    /// First lane of the route.
    pub lane: LaneId,
    /// Position of the front-axle centre along the lane, laboratory metres.
    pub at_m: f64,
    /// Laboratory m/s.
    pub speed_mps: f64,
}

/// One vehicle of an experiment.
#[derive(Clone, Debug, PartialEq)]
pub struct PlannedVehicle {
    /// Unique in the experiment, from 1 to [`LARGEST_ID`](super::LARGEST_ID).
    pub id: VehicleId,
    /// Unique in the experiment; part of ROS topics.
    pub name: String,
    /// Body type and colour.
    pub appearance: Appearance,
    /// Build and tracking control, full scale.
    pub spec: VehicleSpec,
    /// Name of the control algorithm.
    pub controller: String,
    /// Laboratory units.
    pub driver: DriverParams,
    /// A person drives from the start; the algorithm takes over when the person hands back.
    pub is_human: bool,
    /// Successive lanes; the first is that of the start.
    pub route: Vec<LaneId>,
    /// Lane, position and speed at time 0.
    pub start: Start,
    /// It leaves the city at the end of its route.
    pub leaves: bool,
    /// Whether it is coordinated.
    pub role: Role,
    /// Sensors that the vehicle carries; empty for none.
    pub sensors: Vec<Sensor>,
    /// Link of a physical vehicle, which is measured instead of simulated.
    pub physical: Option<Physical>,
}

/// Link parameters of a physical vehicle.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Physical {
    /// UDP address for its trajectories.
    pub address: String,
    /// Its subject name in motion capture.
    pub subject: String,
}

/// Pose of the middle of the outline for these dimensions, see [`PlannedVehicle::pose_on`].
pub fn pose_on(size: &Dimensions, map: &CityMap, lane: LaneId, axle_at_m: f64) -> Pose2 {
    let curve = &map.lane(lane).curve;
    let mut axle = curve.at(axle_at_m).pose;
    let curvature = curve.at(axle_at_m - size.wheelbase_m / 2.0).curvature;
    axle.yaw_rad -= trig::asin((size.wheelbase_m * curvature).clamp(-1.0, 1.0));
    axle.advanced(-size.front_axle_m())
}

impl PlannedVehicle {
    /// Dimensions for control, laboratory metres.
    pub fn body_in_lab(&self, scale: LengthScale) -> CavGeometry {
        CavGeometry {
            length_m: scale.lab_from_city(self.spec.dimensions.length_m),
            width_m: scale.lab_from_city(self.spec.dimensions.width_m),
            wheelbase_m: scale.lab_from_city(self.spec.dimensions.wheelbase_m),
            min_turn_radius_m: scale.lab_from_city(self.spec.min_turn_radius() * STEERING_RESERVE),
        }
    }

    /// Pose of the middle of the outline for a front-axle position on a lane, city metres. In a bend the body
    /// is oriented as in a steady turn, its rear axle inside.
    pub fn pose_on(&self, map: &CityMap, lane: LaneId, axle_at_m: f64) -> Pose2 {
        pose_on(&self.spec.dimensions, map, lane, axle_at_m)
    }

    /// Start pose of the middle of its outline, laboratory metres.
    pub fn pose_in_lab(&self, map: &CityMap, scale: LengthScale) -> Pose2<Lab> {
        let at_m = scale.city_from_lab(self.start.at_m);
        self.pose_on(map, self.start.lane, at_m).to_lab(scale)
    }

    /// Its setup for the control framework.
    pub fn cav_setup(&self, scale: LengthScale) -> CavSetup {
        CavSetup {
            id: self.id,
            controller: self.controller.clone(),
            driver: self.driver,
            body: self.body_in_lab(scale),
            route: self.route.clone(),
            speed_mps: self.start.speed_mps,
            role: self.role,
            leaves: self.leaves,
        }
    }

    /// Its setup command. The pose is converted through laboratory metres, so that it has the same bits
    /// whether or not it came over the link.
    pub fn setup(&self, map: &CityMap, scale: LengthScale) -> Setup {
        Setup {
            id: self.id,
            name: self.name.clone(),
            appearance: self.appearance,
            pose: self.pose_in_lab(map, scale).to_city(scale),
            speed_mps: scale.city_from_lab(self.start.speed_mps),
            spec: self.spec.clone(),
        }
    }
}

/// Everything that a run depends on.
#[derive(Clone, Debug)]
pub struct Experiment {
    /// Name that the scenario states.
    pub name: String,
    /// Empty where the scenario has none.
    pub description: String,
    /// Seed of the random streams of traffic and environment.
    pub seed: u64,
    /// Traffic is drawn from the seed.
    pub traffic_is_drawn: bool,
    /// Duration of a run, simulated seconds.
    pub duration_s: f64,
    /// Passages and trips that begin earlier do not count in the totals of the measures.
    pub warm_up_s: f64,
    /// Step rates of physics and control.
    pub rates: Rates,
    /// City metres for one laboratory metre.
    pub scale: LengthScale,
    /// Road map in laboratory metres, for the control framework.
    pub lab_map: Arc<LabMap>,
    /// The same map in city metres, for the world.
    pub city_map: Arc<CityMap>,
    /// In id order.
    pub vehicles: Vec<PlannedVehicle>,
    /// Sources of traffic, in the order of the scenario.
    pub inflows: Vec<Inflow>,
    /// The vehicles of all inflows, in order of time and, at equal times, of the inflows. Their ids increase, and follow
    /// those of `vehicles`.
    pub arrivals: Arc<Vec<PlannedArrival>>,
    /// Vehicle types by name; `default` always exists.
    pub vehicle_types: BTreeMap<String, VehicleSpec>,
    /// Vehicles whose starts overlapped others and were moved.
    pub moved: Vec<MovedStart>,
    /// Right of way at junctions, laboratory units.
    pub right_of_way: RightOfWayParams,
    /// Traffic signals; their heads are those of the maps.
    pub signals: Vec<SignalPlan>,
    /// Coordination of vehicles in control zones; `None` without.
    pub coordination: Option<CoordinationRules>,
    /// Control zones, whose passages are measured whether or not vehicles are coordinated there.
    pub control_zones: Vec<ControlZone>,
    /// How platoons are formed; `None` for none. Laboratory units.
    pub platoons: Option<PlatoonParams>,
    /// The algorithms that vehicles and control zones may name.
    pub algorithms: Algorithms,
    /// Threads of its worlds and its control; results do not depend on them. All processors, unless somebody sets them.
    pub workers: Workers,
    /// Environment between the control framework and the simulated vehicles.
    pub environment: EnvironmentSpec,
    /// Environment of the robots of `city3d testbed`.
    pub testbed: EnvironmentSpec,
    /// Affects rendering only.
    pub time_of_day: TimeOfDay,
    /// Affects rendering only.
    pub weather: Weather,
    /// A vehicle without a trajectory for this time stops on its path.
    pub link_timeout_s: f64,
    /// What makes a run fail.
    pub expectations: Expectations,
    /// Affects rendering only.
    pub models: UserModels,
    /// Scenario text and map bytes as read, for logs.
    pub scenario_text: String,
    /// Content of the map file.
    pub map_bytes: Vec<u8>,
    /// Dynamics model that overrides those of the scenario.
    pub model: Option<ModelKind>,
    /// Environment profile that overrides the scenario's.
    pub profile: Option<EnvironmentProfile>,
}

impl Experiment {
    /// The experiment with worlds and control on the thread that steps them, as where many runs are made side by side.
    #[must_use]
    pub fn on_one_thread(self) -> Self {
        Self { workers: Workers::alone(), ..self }
    }

    /// Setups of the vehicles that are there from the beginning, for the control framework.
    pub fn cav_setups(&self) -> Vec<CavSetup> {
        self.vehicles.iter().map(|vehicle| vehicle.cav_setup(self.scale)).collect()
    }

    /// The arrival with this id, if it is one of an inflow.
    pub fn arrival(&self, id: VehicleId) -> Option<&PlannedArrival> {
        let index = self.arrivals.binary_search_by_key(&id, |arrival| arrival.vehicle.id).ok()?;
        Some(&self.arrivals[index])
    }

    /// Whether a vehicle of this id and name is an arrival of an inflow.
    pub fn is_arrival(&self, id: VehicleId, name: &str) -> bool {
        self.arrival(id).is_some_and(|arrival| arrival.vehicle.name == name)
    }

    /// SHA-256 of the scenario's text, in hexadecimal digits.
    pub fn text_digest(&self) -> String {
        Sha256::digest(self.scenario_text.as_bytes()).iter().map(|byte| format!("{byte:02x}")).collect()
    }

    /// Name of the environment between the control framework and the simulated vehicles: that of its profile, or `own` where
    /// the scenario disturbs an ideal one by values of its own.
    pub fn environment_name(&self) -> &'static str {
        if self.environment == EnvironmentSpec::IDEAL {
            EnvironmentProfile::Ideal.name()
        } else if self.environment == self.testbed {
            // That of the robots is that of the profile, which the scenario may have changed.
            EnvironmentProfile::Testbed.name()
        } else {
            "own"
        }
    }

    /// Whether another seed makes another run.
    pub fn depends_on_seed(&self) -> bool {
        self.traffic_is_drawn || self.environment != EnvironmentSpec::IDEAL || self.has_noisy_testbed()
    }

    /// Whether vehicles of the laboratory are measured with noise and losses where the environment of the others is ideal.
    pub fn is_ideal_but_for_lab(&self) -> bool {
        self.environment == EnvironmentSpec::IDEAL && self.has_noisy_testbed()
    }

    /// Whether the testbed of physical vehicles draws noise and occlusions, whatever the environment of the others.
    fn has_noisy_testbed(&self) -> bool {
        self.testbed != EnvironmentSpec::IDEAL && self.physical().next().is_some()
    }

    /// Seed and environment of its runs, in words.
    pub fn conditions(&self) -> String {
        let but = if self.is_ideal_but_for_lab() { " but for lab vehicles" } else { "" };
        format!("seed {}, {} environment{but}", self.seed, self.environment_name())
    }

    /// The vehicle with this id, whether it is there from the beginning or arrives later.
    pub fn planned(&self, id: VehicleId) -> Option<&PlannedVehicle> {
        let planned = self.vehicles.iter().find(|planned| planned.id == id);
        planned.or_else(|| self.arrival(id).map(|arrival| &arrival.vehicle))
    }

    /// Rules of the traffic, for the control framework.
    pub fn rules(&self) -> TrafficRules {
        TrafficRules {
            right_of_way: self.right_of_way,
            coordination: self.coordination.clone(),
            platoons: self.platoons,
            signals: self.signals.clone(),
        }
    }

    /// The physical vehicles.
    pub fn physical(&self) -> impl Iterator<Item = (&PlannedVehicle, &Physical)> {
        self.vehicles.iter().filter_map(|planned| Some((planned, planned.physical.as_ref()?)))
    }

    /// Whether a vehicle is physical.
    pub fn is_physical(&self, vehicle: VehicleId) -> bool {
        self.physical().any(|(planned, _)| planned.id == vehicle)
    }

    /// The experiment without its vehicles, which arrive over the link. It still knows which of them come and go.
    pub fn without_vehicles(self) -> Self {
        Self { vehicles: Vec::new(), moved: Vec::new(), ..self }
    }

    /// What the experiment has, in words.
    pub fn contents(&self) -> String {
        let sensors: usize = self.vehicles.iter().map(|vehicle| vehicle.sensors.len()).sum();
        let (vehicles, duration_s, seed) = (self.vehicles.len(), self.duration_s, self.seed);
        let (vehicles, sensors) = (counted(vehicles, "vehicle"), counted(sensors, "sensor"));
        format!("{vehicles}, {sensors}, {duration_s} s, seed {seed}")
    }

    /// Who goes first at junctions, in words: the algorithm of coordination, signals, or the right of way alone.
    pub fn junction_control(&self) -> String {
        let mut words: BTreeSet<&str> = BTreeSet::new();
        words.extend(self.coordination.as_ref().map(|rules| rules.algorithm.as_str()));
        words.extend(self.signals.iter().map(|signal| match signal.control {
            SignalControl::FixedTime => "fixed-time signals",
            SignalControl::Counted(_) => "Webster's signals",
            SignalControl::Actuated(_) => "actuated signals",
        }));
        if words.is_empty() { "right of way".to_owned() } else { joined(words) }
    }

    /// The control algorithms of the vehicles, in words; empty for a scenario without vehicles.
    pub fn controllers(&self) -> String {
        let arrivals = self.arrivals.iter().map(|arrival| &arrival.vehicle);
        joined(self.vehicles.iter().chain(arrivals).map(|vehicle| vehicle.controller.as_str()).collect())
    }

    /// What each inflow brings, in words.
    pub fn inflow_contents(&self) -> impl Iterator<Item = String> + '_ {
        self.inflows.iter().enumerate().map(|(index, inflow)| {
            let own = || self.arrivals.iter().filter(move |arrival| arrival.inflow == index);
            let humans = own().filter(|arrival| arrival.vehicle.role == Role::Human).count();
            format!(
                "inflow {}: {}, {humans} of them with human drivers, on lane \"{}\"",
                inflow.name,
                counted(own().count(), "vehicle"),
                self.lab_map.lane(inflow.lane).name
            )
        })
    }

    /// Number of physics steps of the whole run.
    pub fn ticks(&self) -> u64 {
        (self.duration_s * f64::from(self.rates.physics_hz)).round() as u64
    }
}

fn joined(words: BTreeSet<&str>) -> String {
    words.into_iter().collect::<Vec<_>>().join(" and ")
}
