//! The static world: lanes with their curves, junctions, signs and scenery.

pub mod dxf;
mod map;
pub mod scene;

pub use map::{
    CityMap, ConflictZone, ControlLine, ControlLineKind, LabMap, Lane, LaneId, LaneKind, RoadMap, Scenery,
    SceneryKind, Shape, ZoneId, ZoneKind, ZoneSide,
};
