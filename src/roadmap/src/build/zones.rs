//! Conflict zones: intervals of two lanes on which vehicles can touch.
//!
//! Zones come from swept-path analysis of the testbed's car, whose front-axle centre follows the centre line.
//! In a steady turn its rear axle follows a circle of radius sqrt(r^2 - wheelbase^2) about the same centre:
//! the inner side reaches farther in than on a straight, the outer front corner farther out. Two points
//! conflict where the centre lines are closer than the reach of both bodies plus a margin.

use super::JOIN_TOLERANCE_M;
use super::lanes::LaneGraph;
use super::neighbours::bounds;
use crate::error::{Diagnostics, MapErrorKind};
use crate::{ConflictZone, Lane, LaneId, ZoneId, ZoneKind, ZoneSide};
use city3d_geometry::lab::Pose2;
use city3d_geometry::{Lab, trig, wrap_angle};
use glam::DVec2;
use std::collections::BTreeMap;
use std::f64::consts::PI;

/// The reference car: half its width, its wheelbase, and from the rear axle to the front bumper.
const HALF_WIDTH_M: f64 = 0.05;
const WHEELBASE_M: f64 = 0.12;
const REAR_AXLE_TO_NOSE_M: f64 = 0.16;
/// Clearance between two vehicles.
const MARGIN_M: f64 = 0.01;
/// Sampling step along lanes; zones are rounded outwards by one step.
const STEP_M: f64 = 0.005;
/// Zones of two lanes closer than this are one.
const MERGED_BELOW_M: f64 = 0.02;
/// Points within this driving distance of each other are on one path and do not conflict.
const SAME_WAY_M: f64 = 0.3;
/// Lanes at a smaller angle run alongside; only the sides that face each other count.
const ALONGSIDE_RAD: f64 = PI / 6.0;
/// Most zones that a map may have.
const MAX_ZONES: usize = 10_000;

/// Zones by the ids of their lanes and where they begin.
pub(super) fn find(roads: &LaneGraph, diagnostics: &mut Diagnostics) -> Vec<ConflictZone> {
    let lanes = &roads.lanes;
    let swept_paths: Vec<SweptPath> = lanes.iter().map(|lane| SweptPath::new(lane, lanes)).collect();
    let ways: Vec<BTreeMap<LaneId, f64>> = (0..lanes.len()).map(|k| ways_on(lanes, k)).collect();
    let mut zones = Vec::new();
    for a in 0..lanes.len() {
        for b in a + 1..lanes.len() {
            if !swept_paths[a].may_touch(&swept_paths[b]) {
                continue;
            }
            let shared = [roads.nodes[a][0] == roads.nodes[b][0], roads.nodes[a][1] == roads.nodes[b][1]];
            let in_line = follows(&lanes[a], &lanes[b]) || follows(&lanes[b], &lanes[a]);
            // A lane that loops back to its own start conflicts there with its successors.
            if in_line && shared == [false, false] {
                continue;
            }
            let pair = LanePair {
                lanes: [&lanes[a], &lanes[b]],
                swept_paths: [&swept_paths[a], &swept_paths[b]],
                shared,
                gaps: [ways[a].get(&lanes[b].id).copied(), ways[b].get(&lanes[a].id).copied()],
            };
            for (kind, sides) in pair.zones() {
                let id = ZoneId(zones.len() as u32);
                zones.push(ConflictZone { id, kind, sides });
            }
            if zones.len() > MAX_ZONES {
                let message = format!("more than {MAX_ZONES} places where lanes conflict");
                diagnostics.error_at(MapErrorKind::Size, 1, String::new(), message, "split the map");
                return zones;
            }
        }
    }
    zones
}

fn follows(first: &Lane<Lab>, second: &Lane<Lab>) -> bool {
    first.successors.contains(&second.id)
}

/// Lanes reachable from a lane, with the least distance between its end and their start.
fn ways_on(lanes: &[Lane<Lab>], from: usize) -> BTreeMap<LaneId, f64> {
    let mut reached: BTreeMap<LaneId, f64> = BTreeMap::new();
    let mut open: Vec<(LaneId, f64)> = lanes[from].successors.iter().map(|&id| (id, 0.0)).collect();
    while let Some((id, gap)) = open.pop() {
        if gap > SAME_WAY_M || reached.get(&id).is_some_and(|&known| known <= gap) {
            continue;
        }
        reached.insert(id, gap);
        let lane = &lanes[id.index()];
        open.extend(lane.successors.iter().map(|&next| (next, gap + lane.curve.length())));
    }
    reached
}

/// Half widths, left and right, that the reference car sweeps in a steady turn of this curvature.
fn swept_half_widths(curvature: f64) -> [f64; 2] {
    if curvature == 0.0 {
        return [HALF_WIDTH_M; 2];
    }
    let radius = 1.0 / curvature.abs();
    let rear = (radius * radius - WHEELBASE_M * WHEELBASE_M).max(0.0).sqrt();
    let inner = HALF_WIDTH_M + radius - rear;
    let outer = trig::hypot(rear + HALF_WIDTH_M, REAR_AXLE_TO_NOSE_M) - radius;
    if curvature > 0.0 { [inner, outer] } else { [outer, inner] }
}

fn wider(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0].max(b[0]), a[1].max(b[1])]
}

/// The swept path of the reference car along a lane.
struct SweptPath {
    length: f64,
    bounds: [DVec2; 2],
    /// Start and half widths (left, right) of each interval; an interval lasts until the next one starts.
    widths: Vec<(f64, [f64; 2])>,
    widest: f64,
}

impl SweptPath {
    fn new(lane: &Lane<Lab>, lanes: &[Lane<Lab>]) -> Self {
        // The rear axle follows a wheelbase behind: the widths of a segment apply that far beyond its end.
        let mut intervals: Vec<(f64, f64, [f64; 2])> = Vec::new();
        add_tails(lane, lanes, 0.0, &mut intervals);
        for (k, segment) in lane.curve.segments().iter().enumerate() {
            let from = lane.curve.station(k);
            intervals.push((from, from + segment.length + WHEELBASE_M, swept_half_widths(segment.curvature)));
        }
        let length = lane.curve.length();
        let mut starts: Vec<f64> = intervals.iter().flat_map(|&(from, to, _)| [from, to]).collect();
        starts.push(0.0);
        starts.retain(|&s| (0.0..length).contains(&s));
        starts.sort_by(f64::total_cmp);
        starts.dedup();
        let widths: Vec<(f64, [f64; 2])> = starts
            .into_iter()
            .map(|s| {
                let here = intervals.iter().filter(|&&(from, to, _)| from <= s && s < to);
                (s, here.map(|&(.., sides)| sides).fold([HALF_WIDTH_M; 2], wider))
            })
            .collect();
        let widest = widths.iter().flat_map(|&(_, sides)| sides).fold(HALF_WIDTH_M, f64::max);
        Self { length, bounds: bounds(lane, widest + MARGIN_M), widths, widest }
    }

    /// Half widths, left and right, around an arc length.
    fn sides_at(&self, s: f64) -> [f64; 2] {
        let after = |s: f64| self.widths.partition_point(|&(from, _)| from <= s);
        let (first, last) = (after(s - STEP_M).saturating_sub(1), after(s + STEP_M));
        self.widths[first..last].iter().map(|&(_, sides)| sides).fold([HALF_WIDTH_M; 2], wider)
    }

    /// Reach of a body here towards a point of another lane: on the side of that point, or the larger of both
    /// where the lanes cross.
    fn reach_towards(&self, place: LanePoint, other: LanePoint) -> f64 {
        let [left, right] = self.sides_at(place.s);
        let turn = wrap_angle(other.pose.yaw_rad - place.pose.yaw_rad).abs();
        if turn.min(PI - turn) > ALONGSIDE_RAD {
            return left.max(right);
        }
        let offset = other.pose.position - place.pose.position;
        if offset.dot(place.pose.left()) > 0.0 { left } else { right }
    }

    fn may_touch(&self, other: &Self) -> bool {
        self.bounds[0].cmple(other.bounds[1]).all() && other.bounds[0].cmple(self.bounds[1]).all()
    }
}

/// Adds the widths that the ends of preceding lanes require at the start of this one, up to a wheelbase back.
fn add_tails(lane: &Lane<Lab>, lanes: &[Lane<Lab>], behind: f64, intervals: &mut Vec<(f64, f64, [f64; 2])>) {
    for &id in &lane.predecessors {
        let before = &lanes[id.index()];
        let length = before.curve.length();
        for (k, segment) in before.curve.segments().iter().enumerate() {
            let end = length - (before.curve.station(k) + segment.length);
            let lasts = WHEELBASE_M - behind - end;
            if lasts > 0.0 {
                intervals.push((0.0, lasts, swept_half_widths(segment.curvature)));
            }
        }
        // Chains of very short lanes are followed a few lanes back and no further.
        if behind + length < WHEELBASE_M && intervals.len() < 32 {
            add_tails(before, lanes, behind + length.max(JOIN_TOLERANCE_M), intervals);
        }
    }
}

struct LanePair<'a> {
    lanes: [&'a Lane<Lab>; 2],
    swept_paths: [&'a SweptPath; 2],
    /// Whether they start, and whether they end, in one point.
    shared: [bool; 2],
    /// Driving distance from the end of the first lane to the start of the second, and the reverse.
    gaps: [Option<f64>; 2],
}

/// A point of a lane.
#[derive(Clone, Copy)]
struct LanePoint {
    s: f64,
    pose: Pose2,
}

/// An interval of one lane that conflicts with the other, and the interval of their nearest points on the
/// other.
#[derive(Clone, Copy)]
struct ConflictInterval {
    from: f64,
    to: f64,
    feet: (f64, f64),
}

impl LanePair<'_> {
    fn zones(&self) -> Vec<(ZoneKind, [ZoneSide; 2])> {
        let mut zones: Vec<[(f64, f64); 2]> = Vec::new();
        for interval in self.intervals(0) {
            zones.push([(interval.from, interval.to), interval.feet]);
        }
        for interval in self.intervals(1) {
            zones.push([interval.feet, (interval.from, interval.to)]);
        }
        // Intervals that overlap, or nearly, on both lanes are one zone.
        let near = |a: (f64, f64), b: (f64, f64)| a.0 <= b.1 + MERGED_BELOW_M && b.0 <= a.1 + MERGED_BELOW_M;
        let mut k = 0;
        while k < zones.len() {
            let joined =
                (k + 1..zones.len()).find(|&l| (0..2).all(|side| near(zones[k][side], zones[l][side])));
            if let Some(l) = joined {
                let other = zones.remove(l);
                for (side, other) in zones[k].iter_mut().zip(other) {
                    *side = (side.0.min(other.0), side.1.max(other.1));
                }
                // The zone has grown and may now reach others.
                k = 0;
            } else {
                k += 1;
            }
        }
        zones.sort_by(|a, b| a[0].0.total_cmp(&b[0].0).then(a[1].0.total_cmp(&b[1].0)));
        zones.into_iter().map(|sides| (self.kind(sides), self.sides(sides))).collect()
    }

    fn sides(&self, sides: [(f64, f64); 2]) -> [ZoneSide; 2] {
        [0, 1].map(|k| ZoneSide { lane: self.lanes[k].id, from_m: sides[k].0, to_m: sides[k].1 })
    }

    fn kind(&self, sides: [(f64, f64); 2]) -> ZoneKind {
        if self.shared[1] && (0..2).all(|k| sides[k].1 >= self.swept_paths[k].length) {
            ZoneKind::Merge
        } else if self.shared[0] && (0..2).all(|k| sides[k].0 <= 0.0) {
            ZoneKind::Diverge
        } else {
            ZoneKind::Cross
        }
    }

    /// Conflicting intervals of one of the lanes, rounded outwards.
    fn intervals(&self, of: usize) -> Vec<ConflictInterval> {
        let (lane, other) = (self.lanes[of], self.lanes[1 - of]);
        let (track, other_track) = (self.swept_paths[of], self.swept_paths[1 - of]);
        let round = |from: f64, to: f64, length: f64| ((from - STEP_M).max(0.0), (to + STEP_M).min(length));
        let steps = (track.length / STEP_M).ceil().max(1.0) as usize;
        let widest = track.widest + other_track.widest + MARGIN_M;
        // The distance changes by no more than the step: some steps can be skipped.
        let skipped = |distance: f64| (((distance - widest) / STEP_M).floor().max(0.0) as usize).max(1);
        let mut intervals: Vec<ConflictInterval> = Vec::new();
        let mut step = 0;
        while step <= steps {
            let s = track.length * step as f64 / steps as f64;
            let here = LanePoint { s, pose: lane.curve.at(s).pose };
            // The box around the other lane has its widest reach in it: the lane is no nearer than this, and far lanes are
            // told without a projection.
            let [low, high] = other_track.bounds;
            let outside = here.pose.position.distance(here.pose.position.clamp(low, high));
            let least = outside + other_track.widest + MARGIN_M;
            if least >= widest {
                step += skipped(least);
                continue;
            }
            let foot = other.curve.project(here.pose.position).s;
            let there = LanePoint { s: foot, pose: other.curve.at(foot).pose };
            let distance = there.pose.position.distance(here.pose.position);
            let reach = track.reach_towards(here, there) + other_track.reach_towards(there, here) + MARGIN_M;
            if distance >= reach || self.same_way(of, s, foot) {
                step += skipped(distance);
                continue;
            }
            let (from, to) = round(s, s, track.length);
            let feet = round(foot, foot, other_track.length);
            match intervals.last_mut().filter(|last| from <= last.to + MERGED_BELOW_M) {
                Some(last) if feet.0 <= last.feet.1 + 0.1 && last.feet.0 <= feet.1 + 0.1 => {
                    last.to = to;
                    last.feet = (last.feet.0.min(feet.0), last.feet.1.max(feet.1));
                }
                _ => intervals.push(ConflictInterval { from, to, feet }),
            }
            step += 1;
        }
        intervals
    }

    /// Whether a short drive leads from one point to the other.
    fn same_way(&self, of: usize, s: f64, foot: f64) -> bool {
        let on = |gap: Option<f64>, behind: f64, ahead: f64| {
            gap.is_some_and(|gap| gap + behind + ahead < SAME_WAY_M)
        };
        on(self.gaps[of], self.swept_paths[of].length - s, foot)
            || on(self.gaps[1 - of], self.swept_paths[1 - of].length - foot, s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn swept_widths_are_those_of_the_reference_car() {
        // Rear axle on a circle of 0.16 m, its inner side at 0.11 m, the front axle on 0.20 m; the nose
        // 0.16 m ahead of the rear axle and 0.21 m from the centre across it.
        let [left, right] = swept_half_widths(1.0 / 0.2);
        assert!((left - 0.09).abs() < 1e-12 && (right - (trig::hypot(0.21, 0.16) - 0.2)).abs() < 1e-12);
        assert_eq!(swept_half_widths(-1.0 / 0.2), [right, left]);
        assert_eq!(swept_half_widths(0.0), [HALF_WIDTH_M; 2]);
        // The concentric lanes of the roundabouts leave each other room.
        let (inner, outer) = (swept_half_widths(1.0 / 0.466), swept_half_widths(1.0 / 0.617));
        assert!(inner[1] + outer[0] + MARGIN_M < 0.617 - 0.466);
    }
}
