//! The road network: lane graph, conflict zones, control lines, scenery, routes, their import from DXF, and repair.

mod across;
mod build;
pub mod dxf;
mod error;
mod grid;
mod lane_index;
pub mod layers;
mod map;
mod repair;
mod route;

pub use across::LEFT_TURN_RAD;
pub use build::{DEFAULT_SPEED_MPS, JOIN_TOLERANCE_M, LANE_WIDTH_M, LoadedMap, load_map, map_of_drawing};
pub use error::{MapError, MapErrorKind, MapErrors, MapNote};
pub use grid::{Grid, GridArm, GridControl, GridError, GridSize};
pub use lane_index::LaneIndex;
pub use map::{
    CityMap, ConflictZone, ControlLine, ControlLineKind, Footprint, LabMap, Lane, LaneId, LaneKind,
    PlacedModel, RoadMap, Scenery, SceneryKind, SignalHead, ZoneId, ZoneKind, ZoneSide,
};
pub use repair::{MAX_REPAIR_TOLERANCE_M, RepairAction, RepairChange, RepairedMap, repair_map};
