//! Bounding boxes of lanes for fast proximity queries.

use city3d_roadmap::{CityMap, Lane};
use glam::DVec2;

pub(super) struct LaneBoxIndex<'a> {
    map: &'a CityMap,
    /// Box around the centre line, by lane.
    boxes: Vec<[DVec2; 2]>,
}

/// Sampling step of the boxes; the error is much less than a lane width.
const STEP_M: f64 = 1.0;

impl<'a> LaneBoxIndex<'a> {
    pub(super) fn new(map: &'a CityMap) -> Self {
        let around = |lane: &Lane| {
            let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
            for (_, point) in lane.curve.sample(STEP_M) {
                (low, high) = (low.min(point.pose.position), high.max(point.pose.position));
            }
            [low, high]
        };
        Self { map, boxes: map.lanes.iter().map(around).collect() }
    }

    /// Lanes within a distance of a lane, counted in the widths of both, itself included.
    pub(super) fn near(&self, lane: &Lane, widths: f64) -> impl Iterator<Item = &'a Lane> {
        let of = move |lane: &Lane| {
            let [low, high] = self.boxes[lane.id.index()];
            [low - lane.width_m * widths, high + lane.width_m * widths]
        };
        let [low, high] = of(lane);
        self.map.lanes.iter().filter(move |other| {
            let [other_low, other_high] = of(other);
            low.cmple(other_high).all() && other_low.cmple(high).all()
        })
    }

    /// The nearest point on any centre line.
    pub(super) fn nearest(&self, point: DVec2) -> Option<DVec2> {
        // The boxes contain samples; between them a lane may bulge out a little.
        let least =
            |[low, high]: [DVec2; 2]| (point.clamp(low, high).distance(point) - STEP_M / 2.0).max(0.0);
        let mut by_distance: Vec<(f64, &Lane)> =
            self.map.lanes.iter().zip(&self.boxes).map(|(lane, &bounds)| (least(bounds), lane)).collect();
        by_distance.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut best: Option<(f64, DVec2)> = None;
        for (least, lane) in by_distance {
            if best.is_some_and(|(distance, _)| distance <= least) {
                break;
            }
            let foot = lane.curve.at(lane.curve.project(point).s).pose.position;
            let distance = foot.distance(point);
            if best.is_none_or(|(known, _)| distance < known) {
                best = Some((distance, foot));
            }
        }
        best.map(|(_, foot)| foot)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::city;

    #[test]
    fn the_nearest_point_is_that_of_a_search_through_all_lanes() {
        let map = city();
        let boxes = LaneBoxIndex::new(&map);
        for k in 0..60 {
            let point = DVec2::new(-80.0 + 2.7 * f64::from(k), 75.0 - 40.0 * f64::from(k % 5));
            let feet = map.lanes.iter().map(|lane| lane.curve.project(point).distance);
            let want = feet.fold(f64::INFINITY, f64::min);
            let found = boxes.nearest(point).unwrap().distance(point);
            assert!((found - want).abs() < 1e-6, "{found} m to a lane at {point}, {want} m in truth");
        }
    }
}
