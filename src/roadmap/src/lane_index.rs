//! Lanes near a point, found without a look at every lane of a map.

use crate::{Lane, LaneId, RoadMap};
use city3d_geometry::Frame;
use glam::DVec2;
use rstar::primitives::{GeomWithData, Rectangle};
use rstar::{AABB, RTree};

/// The lanes of a map by their bounding boxes, in an R-tree.
#[derive(Clone, Debug, Default)]
pub struct LaneIndex {
    boxes: RTree<GeomWithData<Rectangle<[f64; 2]>, LaneId>>,
    widest_m: f64,
}

impl LaneIndex {
    /// The index of a map.
    pub fn new<F: Frame>(map: &RoadMap<F>) -> Self {
        let of = |lane: &Lane<F>| {
            let [low, high] = bounds(lane);
            GeomWithData::new(Rectangle::from_corners(low.to_array(), high.to_array()), lane.id)
        };
        Self {
            boxes: RTree::bulk_load(map.lanes.iter().map(of).collect()),
            widest_m: map.lanes.iter().map(|lane| lane.width_m).fold(0.0, f64::max),
        }
    }

    /// Width of the widest lane, metres of the map; 0 without lanes.
    pub fn widest_m(&self) -> f64 {
        self.widest_m
    }

    /// In the order of their ids, all lanes whose centre lines are within a distance of a point, metres of the map, and
    /// some that are farther.
    pub fn near(&self, point: DVec2, within_m: f64) -> Vec<LaneId> {
        let around = AABB::from_corners((point - within_m).to_array(), (point + within_m).to_array());
        let mut lanes: Vec<LaneId> =
            self.boxes.locate_in_envelope_intersecting(around).map(|found| found.data).collect();
        lanes.sort_unstable();
        lanes
    }
}

/// Corners of a box that contains the centre line of a lane.
fn bounds<F: Frame>(lane: &Lane<F>) -> [DVec2; 2] {
    let step_m = lane.width_m / 4.0;
    let points = lane.curve.sample(step_m).into_iter().map(|(_, point)| point.pose.position);
    let [low, high] =
        points.fold([DVec2::INFINITY, DVec2::NEG_INFINITY], |[low, high], at| [low.min(at), high.max(at)]);
    // Between two samples a curve is within half a step of one of them.
    [low - step_m / 2.0, high + step_m / 2.0]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Grid, LabMap, load_map};
    use proptest::prelude::*;
    use std::sync::LazyLock;

    static CITY: LazyLock<(LabMap, LaneIndex)> = LazyLock::new(|| {
        let grid = Grid { size: "3x3".parse().unwrap(), ..Grid::default() };
        let map = load_map(grid.to_dxf().unwrap().as_bytes()).unwrap().map;
        let index = LaneIndex::new(&map);
        (map, index)
    });

    proptest! {
        #[test]
        fn no_lane_within_the_distance_is_left_out(x in 0.0..1.0, y in 0.0..1.0, within_m in 0.01..2.0) {
            let (map, index) = &*CITY;
            let [low, high] = map.bounds();
            let point = low + (high - low) * DVec2::new(x, y);
            let found = index.near(point, within_m);
            prop_assert!(found.is_sorted());
            for lane in &map.lanes {
                let is_within = lane.curve.project(point).distance <= within_m;
                prop_assert!(!is_within || found.contains(&lane.id), "{}", lane.name);
            }
            prop_assert!(found.len() < map.lanes.len());
        }
    }
}
