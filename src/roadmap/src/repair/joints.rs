//! Clusters stroke ends into joints by least cost of moving them; the diameter of a cluster stays within the
//! tolerance.
//!
//! Small groups are partitioned exactly by branch and bound, larger ones by agglomerative clustering and
//! local search.

use super::along::runs_along;
use super::strokes::{LaneStrokes, StrokeEnd, Tangency};
use glam::DVec2;
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::f64::consts::PI;

/// Cost of a free end, in squared tolerances.
const LONE_COST: f64 = 2.0;
/// Cost of a free end that lies on another stroke, which could be split there.
const ON_STROKE_COST: f64 = 1.0;
/// Cost of a free end whose stroke runs along another: one of the two will be trimmed or dropped.
const TWICE_COST: f64 = 0.3;
/// Cost of a joint of only such ends.
const CHANCE_COST: f64 = 0.8;
/// Cost of a free end that lies exactly on another stroke.
const EXACT_COST: f64 = 0.02;
/// Cost of each joint: fewer joints are preferred.
const JOINT_COST: f64 = 0.5;
/// Cost of an end beside a stroke that is too short to diverge from it: it likely belongs to the other end of
/// that stroke.
const SHORT_COST: f64 = 1.0;
/// Cost of a heading that is off by all that the tolerance explains.
const HEADING_COST: f64 = 0.3;
/// Largest group that is searched exhaustively.
const MAX_EXHAUSTIVE: usize = 9;
/// Most partial partitions visited in one group before the best so far is taken.
const MAX_PARTITIONS: usize = 200_000;

/// Ends that meet in one point.
#[derive(Clone, Debug)]
pub(super) struct Joint {
    /// The first one sets the side for `with_first`.
    pub ends: Vec<StrokeEnd>,
    /// By end: whether it leaves to the same side as the first end.
    pub with_first: Vec<bool>,
}

impl Joint {
    /// Whether lanes go on through the joint: ends leave to both sides.
    pub(super) fn is_through(&self) -> bool {
        self.with_first.contains(&false)
    }
}

/// All joints; every remaining end is in one.
#[derive(Clone, Debug, Default)]
pub(super) struct Joints {
    /// Sorted by their ends.
    pub all: Vec<Joint>,
    /// Index of the joint of each end.
    pub of_end: BTreeMap<StrokeEnd, usize>,
}

impl Joints {
    pub(super) fn joint(&self, end: StrokeEnd) -> &Joint {
        &self.all[self.of_end[&end]]
    }

    /// Whether no lane continues from the end.
    pub(super) fn is_free(&self, end: StrokeEnd) -> bool {
        !self.joint(end).is_through()
    }

    /// How two ends of one joint continue each other; `None` if they are in different joints.
    pub(super) fn relation(&self, a: StrokeEnd, b: StrokeEnd) -> Option<Tangency> {
        if self.of_end[&a] != self.of_end[&b] {
            return None;
        }
        let joint = self.joint(a);
        let side = |end: StrokeEnd| joint.ends.iter().position(|&e| e == end).map(|k| joint.with_first[k]);
        Some(if side(a) == side(b) { Tangency::Beside } else { Tangency::Through })
    }

    pub(super) fn centre(&self, strokes: &LaneStrokes, joint: usize) -> DVec2 {
        mean(strokes, &self.all[joint].ends)
    }
}

fn mean(strokes: &LaneStrokes, ends: &[StrokeEnd]) -> DVec2 {
    ends.iter().map(|&end| strokes.position(end)).sum::<DVec2>() / ends.len() as f64
}

/// Finds the joints.
pub(super) fn find(strokes: &LaneStrokes) -> Joints {
    let mut joint_finder = JointFinder { strokes, rest_cost: rest_costs(strokes), settled: BTreeMap::new() };
    let units = joint_finder.units();
    for (unit, ends) in units.iter().enumerate() {
        if joint_finder.sides(ends).is_some_and(|(sides, _)| sides.contains(&false)) {
            joint_finder.settled.extend(ends.iter().map(|&end| (end, unit)));
        }
    }
    let mut found = Vec::new();
    for group in joint_finder.groups(&units) {
        let units: Vec<Vec<StrokeEnd>> = group.into_iter().map(|k| units[k].clone()).collect();
        found.extend(joint_finder.partition(&units));
    }
    let mut joints = Joints::default();
    found.sort();
    for ends in found {
        for &end in &ends {
            joints.of_end.insert(end, joints.all.len());
        }
        let with_first = joint_finder.sides(&ends).map_or_else(|| vec![true; ends.len()], |(sides, _)| sides);
        joints.all.push(Joint { ends, with_first });
    }
    joints
}

/// By end: the cost of leaving it without a joint through which lanes continue.
fn rest_costs(strokes: &LaneStrokes) -> BTreeMap<StrokeEnd, f64> {
    strokes
        .ends()
        .map(|end| {
            let at = strokes.position(end);
            let mut cost = LONE_COST;
            for (index, stroke) in strokes.kept().filter(|&(index, _)| index != end / 2) {
                if !strokes.reaches(index, at) {
                    continue;
                }
                if runs_along(strokes, end, index).is_some() {
                    cost = cost.min(TWICE_COST);
                }
                let foot = stroke.rest.project(at);
                let inside =
                    foot.s > strokes.tolerance_m && foot.s < stroke.rest.length - strokes.tolerance_m;
                if foot.distance > strokes.tolerance_m || !inside {
                    continue;
                }
                let turn = super::turn_of(stroke.rest.pose_at(foot.s).yaw_rad, strokes.leaving(end));
                if super::is_exact(foot.distance, turn) {
                    cost = cost.min(EXACT_COST);
                } else if turn <= strokes.angle_tolerance(index, end / 2) {
                    cost = cost.min(ON_STROKE_COST);
                }
            }
            (end, cost)
        })
        .collect()
}

/// Joints as lists of ends.
type Partition = Vec<Vec<StrokeEnd>>;

struct JointFinder<'a> {
    strokes: &'a LaneStrokes,
    rest_cost: BTreeMap<StrokeEnd, f64>,
    /// Ends that are joined as drawn or after trimming, with their unit.
    settled: BTreeMap<StrokeEnd, usize>,
}

impl JointFinder<'_> {
    /// Units: ends in exactly the same point, as drawn or after trimming.
    fn units(&self) -> Vec<Vec<StrokeEnd>> {
        let mut units: Vec<Vec<StrokeEnd>> = Vec::new();
        let mut at: BTreeMap<(i64, i64), Vec<usize>> = BTreeMap::new();
        for end in self.strokes.ends() {
            let cell = cell(self.strokes.position(end), 1e-6);
            let near = around(cell).filter_map(|c| at.get(&c)).flatten().copied().find(|&unit: &usize| {
                let apart = self.strokes.position(units[unit][0]).distance(self.strokes.position(end));
                let mut together = units[unit].clone();
                together.push(end);
                apart <= 1e-6 && self.sides(&together).is_some()
            });
            match near {
                Some(unit) => units[unit].push(end),
                None => {
                    at.entry(cell).or_default().push(units.len());
                    units.push(vec![end]);
                }
            }
        }
        units
    }

    /// Connected groups of units within reach of each other, in order of discovery.
    fn groups(&self, units: &[Vec<StrokeEnd>]) -> Vec<Vec<usize>> {
        let place = |unit: usize| self.strokes.position(units[unit][0]);
        let tolerance = self.strokes.tolerance_m;
        let mut grid: BTreeMap<(i64, i64), Vec<usize>> = BTreeMap::new();
        for unit in 0..units.len() {
            grid.entry(cell(place(unit), tolerance)).or_default().push(unit);
        }
        let mut reached = vec![false; units.len()];
        let mut groups = Vec::new();
        for first in 0..units.len() {
            if std::mem::replace(&mut reached[first], true) {
                continue;
            }
            let mut group = Vec::new();
            let mut queue = VecDeque::from([first]);
            while let Some(unit) = queue.pop_front() {
                group.push(unit);
                let near = around(cell(place(unit), tolerance)).filter_map(|c| grid.get(&c)).flatten();
                for &other in near {
                    if !reached[other] && place(other).distance(place(unit)) <= tolerance {
                        reached[other] = true;
                        queue.push_back(other);
                    }
                }
            }
            groups.push(group);
        }
        groups
    }

    fn partition(&self, units: &[Vec<StrokeEnd>]) -> Partition {
        let mut best = self.local_search(units);
        if units.len() <= MAX_EXHAUSTIVE {
            let mut search = BranchAndBound {
                joint_finder: self,
                units,
                cost: self.cost(&best),
                best: best.clone(),
                looked_at: 0,
            };
            search.place(0, &mut Vec::new());
            best = search.best;
        }
        best.iter_mut().for_each(|ends| ends.sort_unstable());
        best
    }

    /// Agglomerative clustering: merges the nearest units first, then moves single ones while the cost falls.
    fn local_search(&self, units: &[Vec<StrokeEnd>]) -> Partition {
        /// Each sweep lowers the cost; this bounds the time on overly dense drawings.
        const MAX_SWEEPS: usize = 20;
        let mut search = LocalSearch {
            joint_finder: self,
            units,
            joint_of: (0..units.len()).collect(),
            joints: (0..units.len()).map(|unit| vec![unit]).collect(),
        };
        let pairs = self.near_pairs(units);
        for &(a, b) in &pairs {
            search.merge(a, b);
        }
        for _ in 0..MAX_SWEEPS {
            let mut changed = false;
            for &(a, b) in &pairs {
                changed |= search.move_to(a, b) || search.move_to(b, a) || search.merge(a, b);
            }
            if !changed {
                break;
            }
        }
        search.joints.iter().filter(|joint| !joint.is_empty()).map(|joint| search.ends(joint)).collect()
    }

    /// Units within the tolerance of each other, the nearest first.
    fn near_pairs(&self, units: &[Vec<StrokeEnd>]) -> Vec<(usize, usize)> {
        let place = |unit: usize| self.strokes.position(units[unit][0]);
        let tolerance = self.strokes.tolerance_m;
        let mut grid: BTreeMap<(i64, i64), Vec<usize>> = BTreeMap::new();
        let mut pairs = Vec::new();
        for unit in 0..units.len() {
            let here = cell(place(unit), tolerance);
            for &other in around(here).filter_map(|c| grid.get(&c)).flatten() {
                let apart = place(unit).distance(place(other));
                if apart <= tolerance {
                    pairs.push((apart, other, unit));
                }
            }
            grid.entry(here).or_default().push(unit);
        }
        pairs.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
        pairs.into_iter().map(|(_, a, b)| (a, b)).collect()
    }

    fn cost(&self, partition: &Partition) -> f64 {
        partition.iter().map(|ends| self.joint_cost(ends).unwrap_or(f64::INFINITY)).sum()
    }

    /// The cost of joining these ends, in squared tolerances; `None` if they cannot be one joint.
    fn joint_cost(&self, ends: &[StrokeEnd]) -> Option<f64> {
        if !self.fits(ends) {
            return None;
        }
        let (sides, heading_cost) = self.sides(ends)?;
        let joined = self.spread(ends) + heading_cost + self.beside_short(ends, &sides);
        // The ends of duplicates are arbitrary: joining them gains little.
        let by_chance = ends.iter().filter(|end| self.rest_cost[*end] <= TWICE_COST).count();
        if sides.contains(&false) {
            let chance = if by_chance == ends.len() { CHANCE_COST } else { 0.0 };
            // Existing joints are not merged.
            let settled: BTreeSet<usize> =
                ends.iter().filter_map(|end| self.settled.get(end)).copied().collect();
            return Some(joined + chance + JOINT_COST * settled.len().max(1) as f64);
        }
        let rest: f64 = ends.iter().map(|end| self.rest_cost[end]).sum();
        let joints = by_chance + usize::from(by_chance < ends.len());
        let cost = joined + rest + JOINT_COST * joints as f64;
        Some(cost)
    }

    /// Cost of ends beside short strokes.
    fn beside_short(&self, ends: &[StrokeEnd], sides: &[bool]) -> f64 {
        let length = |end: StrokeEnd| self.strokes.of_end(end).rest.length;
        let mut cost = 0.0;
        for (k, &a) in ends.iter().enumerate() {
            for &b in ends[..k].iter().zip(sides).filter(|&(_, side)| *side == sides[k]).map(|(b, _)| b) {
                let (short, long) = (length(a).min(length(b)), length(a).max(length(b)));
                let enough = 1.5 * self.strokes.tolerance_m;
                // Of two short ones, one duplicates the other.
                if long > enough {
                    cost += SHORT_COST * (1.0 - short / enough).max(0.0);
                }
            }
        }
        cost
    }

    /// Sum of squared distances from their mean, in squared tolerances.
    fn spread(&self, ends: &[StrokeEnd]) -> f64 {
        let middle = mean(self.strokes, ends);
        let sum: f64 = ends.iter().map(|&end| self.strokes.position(end).distance_squared(middle)).sum();
        sum / (self.strokes.tolerance_m * self.strokes.tolerance_m)
    }

    /// Whether all are within the tolerance of each other and no short stroke closes on itself.
    fn fits(&self, ends: &[StrokeEnd]) -> bool {
        ends.iter().enumerate().all(|(k, &a)| {
            ends[..k].iter().all(|&b| {
                let apart = self.strokes.position(a).distance(self.strokes.position(b));
                let ring =
                    a / 2 == b / 2 && self.strokes.of_end(a).rest.length < 4.0 * self.strokes.tolerance_m;
                apart <= self.strokes.tolerance_m && !ring
            })
        })
    }

    /// The side of a common tangent to which each end leaves, and the cost of heading errors.
    fn sides(&self, ends: &[StrokeEnd]) -> Option<(Vec<bool>, f64)> {
        let strokes = self.strokes;
        let reference = *ends.iter().min_by(|&&a, &&b| {
            strokes.heading_error_of_end(a).total_cmp(&strokes.heading_error_of_end(b)).then(a.cmp(&b))
        })?;
        let ways: &[Option<bool>] = match strokes.goes_out(reference) {
            Some(true) => &[Some(true)],
            Some(false) => &[Some(false)],
            None => &[Some(true), Some(false)],
        };
        let (mut sides, cost) = ways
            .iter()
            .filter_map(|&out| self.sides_where(ends, reference, out))
            // A joint with continuing lanes is preferred.
            .min_by(|a, b| {
                let stands = |sides: &[bool]| !sides.contains(&false);
                stands(&a.0).cmp(&stands(&b.0)).then(a.1.total_cmp(&b.1))
            })?;
        if !sides[0] {
            sides.iter_mut().for_each(|side| *side = !*side);
        }
        Some((sides, cost))
    }

    /// The same, given whether travel leaves to the side of the reference.
    fn sides_where(
        &self,
        ends: &[StrokeEnd],
        reference: StrokeEnd,
        out: Option<bool>,
    ) -> Option<(Vec<bool>, f64)> {
        let strokes = self.strokes;
        let mut sides = Vec::with_capacity(ends.len());
        let mut cost = 0.0;
        // The cheapest end to reverse if all leave to one side.
        let mut turnable: Option<(f64, usize)> = None;
        for (k, &end) in ends.iter().enumerate() {
            let off_through = if end == reference { PI } else { strokes.kink(reference, end) };
            let off = [PI - off_through, off_through];
            let tolerance = strokes.angle_tolerance(reference / 2, end / 2);
            let price = |off: f64| HEADING_COST * (off / tolerance) * (off / tolerance);
            let allowed = |beside: bool| {
                let direction = match (strokes.goes_out(end), out) {
                    (Some(this), Some(out)) => (this == out) == beside,
                    _ => true,
                };
                let off = if beside { off[0] } else { off[1] };
                direction && off <= tolerance && (beside || end != reference)
            };
            let beside = match (allowed(true), allowed(false)) {
                (true, true) => off[0] <= off[1],
                (true, false) => true,
                (false, true) => false,
                (false, false) => return None,
            };
            if beside && allowed(false) {
                let more = price(off[1]) - price(off[0]);
                if turnable.is_none_or(|(least, _)| more < least) {
                    turnable = Some((more, k));
                }
            }
            cost += price(if beside { off[0] } else { off[1] });
            sides.push(beside);
        }
        if let Some((more, k)) = turnable.filter(|_| !sides.contains(&false)) {
            sides[k] = false;
            cost += more;
        }
        Some((sides, cost))
    }
}

/// Local search over the partitions of a group.
struct LocalSearch<'a> {
    joint_finder: &'a JointFinder<'a>,
    units: &'a [Vec<StrokeEnd>],
    joint_of: Vec<usize>,
    /// Units by joint; empty after a merge.
    joints: Vec<Vec<usize>>,
}

impl LocalSearch<'_> {
    fn ends(&self, joint: &[usize]) -> Vec<StrokeEnd> {
        joint.iter().flat_map(|&unit| self.units[unit].iter().copied()).collect()
    }

    fn cost(&self, joint: &[usize]) -> f64 {
        if joint.is_empty() {
            return 0.0;
        }
        self.joint_finder.joint_cost(&self.ends(joint)).unwrap_or(f64::INFINITY)
    }

    /// Replaces two joints if that lowers the cost.
    fn exchange(&mut self, indices: [usize; 2], joints: [Vec<usize>; 2]) -> bool {
        let before: f64 = indices.iter().map(|&k| self.cost(&self.joints[k])).sum();
        let after: f64 = joints.iter().map(|joint| self.cost(joint)).sum();
        if after >= before - 1e-9 {
            return false;
        }
        for (index, joint) in indices.into_iter().zip(joints) {
            for &unit in &joint {
                self.joint_of[unit] = index;
            }
            self.joints[index] = joint;
        }
        true
    }

    fn merge(&mut self, a: usize, b: usize) -> bool {
        let (one, two) = (self.joint_of[a], self.joint_of[b]);
        one != two
            && self
                .exchange([one, two], [[self.joints[one].clone(), self.joints[two].clone()].concat(), vec![]])
    }

    /// Moves a unit into the joint of another.
    fn move_to(&mut self, unit: usize, other: usize) -> bool {
        let (from, to) = (self.joint_of[unit], self.joint_of[other]);
        if from == to || self.joints[from].len() == 1 {
            return false;
        }
        let rest = self.joints[from].iter().copied().filter(|&u| u != unit).collect();
        let more = [self.joints[to].clone(), vec![unit]].concat();
        self.exchange([from, to], [rest, more])
    }
}

/// Branch and bound over the partitions of a group (Land and Doig 1960).
struct BranchAndBound<'a> {
    joint_finder: &'a JointFinder<'a>,
    units: &'a [Vec<StrokeEnd>],
    cost: f64,
    best: Partition,
    looked_at: usize,
}

impl BranchAndBound<'_> {
    /// Assigns a unit to each joint so far, or to a new one. The cost of displacement only grows, which gives
    /// the bound.
    fn place(&mut self, unit: usize, joints: &mut Partition) {
        self.looked_at += 1;
        let bound: f64 = joints.iter().map(|ends| self.joint_finder.spread(ends)).sum();
        if self.looked_at > MAX_PARTITIONS || bound >= self.cost {
            return;
        }
        let Some(ends) = self.units.get(unit) else {
            let cost = self.joint_finder.cost(joints);
            if cost < self.cost {
                (self.cost, self.best) = (cost, joints.clone());
            }
            return;
        };
        for k in 0..joints.len() {
            let before = joints[k].len();
            joints[k].extend(ends);
            if self.joint_finder.fits(&joints[k]) && self.joint_finder.sides(&joints[k]).is_some() {
                self.place(unit + 1, joints);
            }
            joints[k].truncate(before);
        }
        joints.push(ends.clone());
        self.place(unit + 1, joints);
        joints.pop();
    }
}

fn cell(at: DVec2, size: f64) -> (i64, i64) {
    ((at.x / size).floor() as i64, (at.y / size).floor() as i64)
}

fn around((x, y): (i64, i64)) -> impl Iterator<Item = (i64, i64)> {
    (x - 1..=x + 1).flat_map(move |x| (y - 1..=y + 1).map(move |y| (x, y)))
}
