//! Ways across the junction at the end of a lane, and which of two approaches conflict there.

use super::{LaneId, LaneKind, RoadMap, ZoneKind};
use city3d_geometry::{Frame, wrap_angle};
use std::f64::consts::{FRAC_PI_4, PI};

/// Longest chain of connectors across a junction.
const MOST_CONNECTORS: usize = 12;
/// A way that turns left by more than this gives way to oncoming traffic.
pub const LEFT_TURN_RAD: f64 = 0.8;

impl<F: Frame> RoadMap<F> {
    /// The ways across the junction at the end of a lane: each a chain of connectors, up to the lane behind the
    /// junction, which is not listed. Empty for a lane without connectors at its end.
    pub fn ways_across(&self, approach: LaneId) -> Vec<Vec<LaneId>> {
        let mut ways = Vec::new();
        let mut open: Vec<Vec<LaneId>> = vec![Vec::new()];
        while let Some(way) = open.pop() {
            let last = way.last().copied().unwrap_or(approach);
            let successors = &self.lane(last).successors;
            let connectors = successors.iter().filter(|next| self.lane(**next).kind == LaneKind::Connector);
            let leaves = successors.len() > connectors.clone().count() || successors.is_empty();
            if leaves && !way.is_empty() {
                ways.push(way.clone());
            }
            if way.len() < MOST_CONNECTORS {
                open.extend(connectors.filter(|next| !way.contains(*next)).map(|&next| {
                    let mut longer = way.clone();
                    longer.push(next);
                    longer
                }));
            }
        }
        ways.sort();
        ways
    }

    /// The lanes that lead to a junction: those of roads whose ends are starts of its connectors, in id order.
    /// `is_of_junction` tells its connectors by their names.
    pub fn approaches(&self, is_of_junction: impl Fn(&str) -> bool) -> Vec<LaneId> {
        let connectors = self.lanes.iter().filter(|lane| lane.kind == LaneKind::Connector);
        let own = connectors.filter(|lane| is_of_junction(&lane.name));
        let mut approaches: Vec<LaneId> = own
            .flat_map(|lane| lane.predecessors.iter().copied())
            .filter(|&before| self.lane(before).kind == LaneKind::Lane)
            .collect();
        approaches.sort_unstable();
        approaches.dedup();
        approaches
    }

    /// Whether two approaches must not have green at once: they are of different arms and their ways meet, and it is not
    /// merely a left turn that gives way to oncoming traffic.
    pub fn approaches_conflict(&self, one: LaneId, other: LaneId) -> bool {
        let heading = |lane: LaneId| self.lane(lane).curve.end().yaw_rad;
        let angle = wrap_angle(heading(other) - heading(one)).abs();
        self.meetings(one, other).any(|turns| {
            let turns_left = turns.iter().any(|turn| *turn > LEFT_TURN_RAD);
            // Lanes of one arm; of opposite arms; of arms beside one another.
            match angle {
                _ if angle < FRAC_PI_4 => false,
                _ if angle > PI - FRAC_PI_4 => !turns_left,
                _ => true,
            }
        })
    }

    /// For each place where ways from two approaches cross or join, the angles by which the two ways turn.
    fn meetings(&self, one: LaneId, other: LaneId) -> impl Iterator<Item = [f64; 2]> + '_ {
        let others = self.ways_across(other);
        let pairs = self
            .ways_across(one)
            .into_iter()
            .flat_map(move |way| others.clone().into_iter().map(move |there| (way.clone(), there)));
        pairs.flat_map(|(way, there)| {
            let turns = [&way, &there].map(|lanes| lanes.iter().map(|lane| self.turn_of(*lane)).sum::<f64>());
            let zones = way.iter().flat_map(|lane| self.zones_on(*lane)).filter(|zone| {
                let sides = zone.sides.map(|side| side.lane);
                zone.kind != ZoneKind::Diverge
                    && (0..2).any(|k| way.contains(&sides[k]) && there.contains(&sides[1 - k]))
            });
            zones.map(|_| turns).collect::<Vec<_>>()
        })
    }

    /// Total turning angle of a lane, left-positive.
    pub fn turn_of(&self, lane: LaneId) -> f64 {
        let curve = &self.lane(lane).curve;
        wrap_angle(curve.end().yaw_rad - curve.start().yaw_rad)
    }
}
