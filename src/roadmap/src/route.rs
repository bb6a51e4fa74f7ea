//! Shortest paths through the lane graph (Dijkstra 1959).

use super::{ConflictZone, ControlLine, Lane, LaneId, RoadMap, Scenery, ZoneId};
use city3d_geometry::Frame;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// A path cost as the key of the priority queue: `f64` with a total order.
#[derive(PartialEq)]
struct QueueCost(f64);

impl Eq for QueueCost {}

impl PartialOrd for QueueCost {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for QueueCost {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.0.total_cmp(&other.0)
    }
}

impl<F: Frame> RoadMap<F> {
    /// Indexes the zones by lane. Lanes and zones are given in id order.
    pub(super) fn new(
        lanes: Vec<Lane<F>>,
        zones: Vec<ConflictZone>,
        lines: Vec<ControlLine>,
        scenery: Vec<Scenery>,
    ) -> Self {
        let mut on_lane: Vec<Vec<(f64, ZoneId)>> = vec![Vec::new(); lanes.len()];
        for zone in &zones {
            for side in &zone.sides {
                on_lane[side.lane.index()].push((side.from_m, zone.id));
            }
        }
        let by_place = |mut zones: Vec<(f64, ZoneId)>| {
            zones.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            zones.into_iter().map(|(_, id)| id).collect()
        };
        let zones_of_lane = on_lane.into_iter().map(by_place).collect();
        let (signals, models) = (Vec::new(), Vec::new());
        Self { lanes, zones, lines, signals, scenery, models, zones_of_lane }
    }

    /// The shortest path over allowed lanes, both ends included, by Dijkstra's algorithm. The cost of a path
    /// is the sum of the lengths of its lanes, whole lanes counted. Ties are broken by lane id. `None` if no
    /// path exists or either end is not allowed.
    pub fn shortest_route(
        &self,
        from: LaneId,
        to: LaneId,
        allowed: impl Fn(LaneId) -> bool,
    ) -> Option<Vec<LaneId>> {
        self.cheapest_route(from, to, |lane| allowed(lane).then(|| self.lane(lane).curve.length()))
    }

    /// The cheapest path, both ends included, by Dijkstra's algorithm. Costs are positive; a lane whose cost
    /// is `None` is closed. Ties are broken by lane id. `None` if no path exists or either end is closed.
    pub fn cheapest_route(
        &self,
        from: LaneId,
        to: LaneId,
        cost: impl Fn(LaneId) -> Option<f64>,
    ) -> Option<Vec<LaneId>> {
        let mut best = vec![f64::INFINITY; self.lanes.len()];
        let mut before: Vec<Option<LaneId>> = vec![None; self.lanes.len()];
        let mut open = BinaryHeap::new();
        best[from.index()] = cost(from)?;
        open.push(Reverse((QueueCost(best[from.index()]), from)));
        while let Some(Reverse((QueueCost(so_far), lane))) = open.pop() {
            if lane == to {
                let mut route = vec![to];
                while let Some(previous) = before[route[route.len() - 1].index()] {
                    route.push(previous);
                }
                route.reverse();
                return Some(route);
            }
            if so_far > best[lane.index()] {
                continue;
            }
            for &next in &self.lane(lane).successors {
                let Some(cost) = cost(next) else { continue };
                let longer = so_far + cost;
                if longer < best[next.index()] {
                    best[next.index()] = longer;
                    before[next.index()] = Some(lane);
                    open.push(Reverse((QueueCost(longer), next)));
                }
            }
        }
        None
    }

    /// The shortest cycle through a lane, the lane itself last; `None` if the lane is on no cycle.
    pub fn shortest_loop(&self, lane: LaneId) -> Option<Vec<LaneId>> {
        let length = |way: &Vec<LaneId>| way.iter().map(|lane| self.lane(*lane).curve.length()).sum::<f64>();
        let ways = self.lane(lane).successors.iter();
        let ways = ways.filter_map(|next| self.shortest_route(*next, lane, |_| true));
        ways.min_by(|a, b| length(a).total_cmp(&length(b)))
    }

    /// The tightest radius of a lane's centre line, in metres of the map; infinite of a straight lane.
    pub fn min_radius(&self, lane: LaneId) -> f64 {
        let curve = &self.lane(lane).curve;
        curve.min_radius(0.0, curve.length())
    }
}
