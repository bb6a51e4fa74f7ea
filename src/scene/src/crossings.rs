//! Zebra crossings between the line where traffic stops and the junction, where there is room between two kerbs.

use super::roads::{RoadField, SHOULDER_M};
use city3d_geometry::Pose2;
use city3d_roadmap::CityMap;
use glam::DVec2;

/// Along the road.
pub(super) const DEEP_M: f64 = 2.8;
/// From the line to the crossing: the first distance at which there is room.
const AFTER_LINE_M: [f64; 4] = [0.8, 1.3, 1.9, 2.6];
/// Bars: their width, and from middle to middle.
const BAR_M: f64 = 0.50;
const PITCH_M: f64 = 1.0;
/// Clearance of bars from the kerb.
const OFF_KERB_M: f64 = 0.25;
/// By how much the distance to a kerb may differ along a crossing, where corners begin to round off.
const FLARE_M: f64 = 4.0;
/// Widths of roads that are crossed at one go.
const WIDE_M: std::ops::RangeInclusive<f64> = 5.0..=24.0;
/// Least distance between the middles of two crossings.
const APART_M: f64 = 9.0;

/// A place where people cross a road.
pub(super) struct Crossing {
    /// In the middle of the crossing along the road, on the lane whose line it follows.
    pose: Pose2,
    /// From there to the kerbs to the left and to the right.
    kerbs_m: [f64; 2],
}

impl Crossing {
    /// The bars on the road, each from end to end, of [`BAR_M`].
    pub(super) fn bars(&self, field: &RoadField) -> impl Iterator<Item = ([DVec2; 2], f64)> {
        let is_on_road = |at: DVec2| field.distance.at(at) < SHOULDER_M - OFF_KERB_M as f32 / 2.0;
        let [left, right] = self.kerbs_m.map(|m| m - OFF_KERB_M - BAR_M / 2.0);
        let count = ((left + right) / PITCH_M).floor();
        let rest = (left + right - count * PITCH_M) / 2.0;
        let pose = self.pose;
        (0..=count as u32).filter_map(move |k| {
            let aside = -right + rest + PITCH_M * f64::from(k);
            let ends = |aside: f64| [-DEEP_M / 2.0, DEEP_M / 2.0].map(|ahead| pose.point_at(ahead, aside));
            let corners = [aside - BAR_M / 2.0, aside + BAR_M / 2.0].map(ends);
            corners.into_iter().flatten().all(is_on_road).then(|| (ends(aside), BAR_M))
        })
    }

    /// Its ends on the faces of the kerbs, each with the unit vectors away from the road and along it.
    pub(super) fn ends(&self) -> [(DVec2, DVec2, DVec2); 2] {
        let ahead = self.pose.forward();
        let [left, right] = self.kerbs_m;
        [(left, 1.0), (right, -1.0)]
            .map(|(m, side)| (self.pose.point_at(0.0, side * m), ahead.perp() * side, ahead))
    }

    fn covers(&self, point: DVec2) -> bool {
        let from = point - self.pose.position;
        let (ahead, left) = (from.dot(self.pose.forward()), from.dot(self.pose.left()));
        ahead.abs() < DEEP_M / 2.0 + 0.6 && (-self.kerbs_m[1]..self.kerbs_m[0]).contains(&left)
    }

    fn middle(&self) -> DVec2 {
        self.pose.point_at(0.0, (self.kerbs_m[0] - self.kerbs_m[1]) / 2.0)
    }
}

/// The crossings of a map, at most one for the lines of an arm.
pub(super) fn crossings(map: &CityMap, field: &RoadField) -> Vec<Crossing> {
    let mut found: Vec<Crossing> = Vec::new();
    for line in &map.lines {
        let pose = map.lane(line.lane).curve.at(line.at_m).pose;
        let at = |gap: &f64| {
            let middle = pose.point_at(gap + DEEP_M / 2.0, 0.0);
            let crossing = crossing_at(field, Pose2::at(middle, pose.yaw_rad))?;
            let is_free = map.lines.iter().all(|other| {
                let [a, b] = other.ends;
                [a, a.midpoint(b), b].into_iter().all(|end| !crossing.covers(end))
            });
            is_free.then_some(crossing)
        };
        let Some(crossing) = AFTER_LINE_M.iter().find_map(at) else { continue };
        if found.iter().all(|known| known.middle().distance(crossing.middle()) > APART_M) {
            found.push(crossing);
        }
    }
    found
}

/// A crossing about a pose, if both kerbs run about along it.
fn crossing_at(field: &RoadField, pose: Pose2) -> Option<Crossing> {
    let stations = [-0.5, 0.0, 0.5].map(|part| pose.point_at(part * DEEP_M, 0.0));
    let mut kerbs_m = [0.0; 2];
    for (kerb_m, side) in kerbs_m.iter_mut().zip([1.0, -1.0]) {
        let out = stations.map(|from| kerb_from(field, from, pose.left() * side));
        let [Some(a), Some(b), Some(c)] = out else { return None };
        let (least, most) = (a.min(b).min(c), a.max(b).max(c));
        if most - least > FLARE_M {
            return None;
        }
        *kerb_m = b;
    }
    WIDE_M.contains(&(kerbs_m[0] + kerbs_m[1])).then_some(Crossing { pose, kerbs_m })
}

/// Distance to the face of the kerb.
fn kerb_from(field: &RoadField, from: DVec2, towards: DVec2) -> Option<f64> {
    const STEP_M: f64 = 0.05;
    let most = (WIDE_M.end() / STEP_M) as u32;
    (0..most)
        .map(|k| f64::from(k) * STEP_M)
        .find(|out| field.distance.at(from + towards * *out) >= SHOULDER_M)
}

#[cfg(test)]
mod tests {
    use super::super::roads::RoadField;
    use super::super::tests::city;
    use super::*;

    #[test]
    fn crossings_lead_from_kerb_to_kerb_beyond_the_lines() {
        let map = city();
        let field = RoadField::new(&map);
        let all = crossings(&map, &field);
        assert!(all.len() >= 6, "{}", all.len());
        for crossing in &all {
            assert!(crossing.bars(&field).count() >= 4, "at {}", crossing.middle());
            for ([from, to], width_m) in crossing.bars(&field) {
                for at in [from, to] {
                    let off = f64::from(field.distance.at(at));
                    assert!(
                        off < f64::from(SHOULDER_M) - 0.05,
                        "a bar of {width_m} m ends {off} m off at {at}"
                    );
                }
            }
            for (end, outward, along) in crossing.ends() {
                assert!((field.distance.at(end) - SHOULDER_M).abs() < 0.1, "{end}");
                assert!(field.distance.at(end + outward) > field.distance.at(end - outward));
                assert!(outward.dot(along).abs() < 1e-9);
            }
        }
    }
}
