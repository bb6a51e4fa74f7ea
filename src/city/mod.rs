//! The static world: lanes with their curves, junctions, signs and scenery.

pub mod dxf;
mod map;

pub use map::{
    CityMap, ConflictZone, ControlLine, ControlLineKind, LabMap, Lane, LaneId, LaneKind, RoadMap, Scenery,
    SceneryKind, Shape, ZoneId, ZoneKind, ZoneSide,
};

pub struct LoadedMap {
    pub map: LabMap,
}
#[derive(Debug)]
pub struct MapErrors {
    pub errors: Vec<String>,
}
pub fn load_map(_: &[u8]) -> Result<LoadedMap, MapErrors> {
    Err(MapErrors { errors: vec![] })
}
impl RoadMap {
    pub fn shortest_route(&self, _f: LaneId, _t: LaneId, _a: impl Fn(LaneId) -> bool) -> Option<Vec<LaneId>> {
        None
    }
}
