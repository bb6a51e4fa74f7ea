//! Ways of a route that go far round, as to a lane that the road leads to only from elsewhere.

use crate::ui::DecimalSeparator;
use city3d_roadmap::{CityMap, LaneId};
use glam::DVec2;

/// A way is a detour where it is this many times as long as the straight line, and longer by this, metres of the city.
const TIMES: f64 = 3.0;
const LONGER_M: f64 = 60.0;
/// The straight line counts at least so much, metres of the city: a lane beside the last one begins next to its end.
const LEAST_M: f64 = 5.0;

/// A way between two lanes of a route that goes far round.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Detour {
    lane: String,
    /// From the end of the lane before it, metres of the city.
    way_m: f64,
    straight_m: f64,
    /// A lane beside it that is much nearer, and its way.
    beside: Option<(String, f64)>,
}

impl Detour {
    /// The way from one lane to the next of a route, by their names; `None` where it is not far round.
    pub fn between(map: &CityMap, from: &str, to: &str) -> Option<Self> {
        let (from, to) = (map.lane_by_name(from)?.id, map.lane_by_name(to)?.id);
        // A lane twice in succession means a lap.
        if from == to {
            return None;
        }
        let (way_m, straight_m) = (way_m(map, from, to)?, straight_m(map, from, to));
        if way_m < TIMES * straight_m || way_m < straight_m + LONGER_M {
            return None;
        }
        let near = beside(map, to).filter_map(|lane| Some((lane, way_m_of(map, from, lane)?)));
        let near = near.filter(|(_, other_m)| *other_m < way_m / 2.0);
        let nearest = near.min_by(|a, b| a.1.total_cmp(&b.1));
        let name = |lane: LaneId| map.lane(lane).name.clone();
        Some(Self { lane: name(to), way_m, straight_m, beside: nearest.map(|(lane, m)| (name(lane), m)) })
    }

    /// What the user has to know.
    pub fn words(&self, decimal: DecimalSeparator) -> String {
        let metres = |m: f64| decimal.fixed(m, 0);
        let times = decimal.fixed(self.way_m / self.straight_m, 0);
        let way = format!(
            "the way to {} is {} m, {times} times the straight distance",
            self.lane,
            metres(self.way_m)
        );
        match &self.beside {
            Some((lane, m)) => format!("{way}; to {lane} beside it: {} m", metres(*m)),
            None => way,
        }
    }
}

/// From the end of a lane to the beginning of another one along the shortest way.
fn way_m(map: &CityMap, from: LaneId, to: LaneId) -> Option<f64> {
    let way = map.shortest_route(from, to, |_| true)?;
    Some(way[1..way.len() - 1].iter().map(|lane| map.lane(*lane).curve.length()).sum())
}

/// The same, where the lane may be the one that the way begins with.
fn way_m_of(map: &CityMap, from: LaneId, to: LaneId) -> Option<f64> {
    if from == to { Some(0.0) } else { way_m(map, from, to) }
}

fn straight_m(map: &CityMap, from: LaneId, to: LaneId) -> f64 {
    let position = |pose: city3d_geometry::Pose2| -> DVec2 { pose.position };
    let (end, begin) = (map.lane(from).curve.end(), map.lane(to).curve.start());
    position(end).distance(position(begin)).max(LEAST_M)
}

/// The lanes of the same direction beside a lane.
fn beside(map: &CityMap, lane: LaneId) -> impl Iterator<Item = LaneId> {
    let left = std::iter::successors(map.lane(lane).left, |lane| map.lane(*lane).left);
    let right = std::iter::successors(map.lane(lane).right, |lane| map.lane(*lane).right);
    left.take(MOST_BESIDE).chain(right.take(MOST_BESIDE))
}

/// Lanes of a road to either side at most.
const MOST_BESIDE: usize = 8;
