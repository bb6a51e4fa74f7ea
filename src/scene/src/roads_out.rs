//! Which places lie on the roads that lead out of a town: they are drawn as roads, and so they are roads to whoever drives there.

use super::land::{CountryRoad, roads_out};
use city3d_roadmap::CityMap;
use glam::DVec2;
use std::sync::{Arc, OnceLock};

/// The roads that lead out of the town of a map. They are found once they are asked for.
#[derive(Debug)]
pub struct RoadsOut {
    map: Arc<CityMap>,
    roads: OnceLock<Vec<CountryRoad>>,
}

impl RoadsOut {
    /// Those of a map.
    pub fn of(map: &Arc<CityMap>) -> Self {
        Self { map: Arc::clone(map), roads: OnceLock::new() }
    }

    /// Whether a place is on the asphalt of such a road, or no farther beside it than this, city metres.
    pub fn is_near(&self, at: DVec2, beside_m: f64) -> bool {
        let roads = self.roads.get_or_init(|| roads_out(&self.map));
        roads.iter().any(|road| road.is_near(at, beside_m))
    }
}
