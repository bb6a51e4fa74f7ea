//! Scenario files, validated into an [`Experiment`].

mod changes;
mod counted;
mod document;
mod experiment;
mod feasibility;
mod fields;
mod grid_scenario;
mod inflow;
mod map_alone;
mod models;
mod placement;
mod read;
mod read_coordination;
mod read_inflows;
mod read_platoon;
mod read_sensors;
mod read_settings;
mod read_signals;
mod read_traffic;
mod read_vehicles;
mod route_data;
mod source;
mod time_of_day;
mod traffic;
mod vehicle_type;

pub(crate) use changes::literal;
pub use changes::{ChangeError, ScenarioChange, with_changes};
pub use counted::counted;
pub use document::{EditError, ScenarioDocument, StatedVehicle, VehicleEdit};
pub use experiment::{Expectations, Experiment, Physical, PlannedVehicle, Rates, Start, pose_on};
pub use fields::Problem;
pub use grid_scenario::grid_scenario;
pub use inflow::{ArrivalProcess, Inflow, PlannedArrival};
pub use map_alone::{is_map, map_alone};
pub use models::UserModels;
pub use placement::MovedStart;
pub use read::{LoadError, MOST_SEED, Overrides, ScenarioError, ScenarioRequest, read_experiment};
pub use read_vehicles::{LARGEST_ID, is_topic_name};
pub use route_data::{
    ArrivalData, ConflictKind, LaneConflict, LaneData, RouteBody, RouteConflict, RouteData, RouteLane,
    RoutePassage, RoutePoint, RouteStart, VehicleRoute, Way, WayConflict, lane_conflicts, lane_data,
};
pub use source::{Library, MapCache, SourceError, shipped_scenarios};
pub use time_of_day::TimeOfDay;
