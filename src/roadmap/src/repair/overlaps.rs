//! Removes duplicate lanes: drops strokes that lie along others, and trims ends that run past the start of
//! another.

use super::along::{OverlapExtent, StrokeOverlap, other_end, runs_along, same_direction};
use super::joints::{self, Joints};
use super::strokes::{LaneStrokes, StrokeEnd, Tangency};
use std::collections::BTreeSet;

/// A stroke that was dropped or trimmed, by index.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Cut {
    /// The stroke lies along the other over its whole length.
    Dropped { stroke: usize, along: usize },
    /// The end ran along the other stroke.
    Trimmed { end: StrokeEnd, by_m: f64, along: usize },
}

/// Drops and trims until no lane is drawn twice; returns the joints of the rest.
pub(super) fn remove(strokes: &mut LaneStrokes, cuts: &mut Vec<Cut>) -> Joints {
    // Each round drops a stroke or removes a free end, which bounds the rounds.
    for _ in 0..4 * strokes.all.len() + 4 {
        let joints = joints::find(strokes);
        let finder = OverlapFinder { strokes, joints: &joints };
        let twins = finder.duplicate_chains();
        let changes = if twins.is_empty() { finder.overhangs() } else { twins };
        if changes.is_empty() {
            return joints;
        }
        for change in changes {
            match change {
                PlannedCut::Drop { stroke, along } => {
                    strokes.all[stroke].dropped = true;
                    cuts.push(Cut::Dropped { stroke, along });
                }
                PlannedCut::Trim { end, beside, by_m } => {
                    strokes.trim(end, by_m);
                    let along = beside / 2;
                    cuts.push(Cut::Trimmed { end, by_m, along });
                }
            }
        }
    }
    joints::find(strokes)
}

#[derive(Clone, Copy, Debug)]
enum PlannedCut {
    Drop { stroke: usize, along: usize },
    Trim { end: StrokeEnd, beside: StrokeEnd, by_m: f64 },
}

/// A chain of strokes between two branching joints.
struct Chain {
    strokes: Vec<usize>,
    /// Its first and last end.
    ends: [StrokeEnd; 2],
}

struct OverlapFinder<'a> {
    strokes: &'a LaneStrokes,
    joints: &'a Joints,
}

impl OverlapFinder<'_> {
    /// Duplicate chains: between the same joints, side by side all the way. The later one is dropped. No
    /// stroke takes part in two changes of one round.
    fn duplicate_chains(&self) -> Vec<PlannedCut> {
        let mut touched = BTreeSet::new();
        let mut changes = Vec::new();
        for joint in &self.joints.all {
            for (k, &a) in joint.ends.iter().enumerate() {
                for &b in &joint.ends[k + 1..] {
                    let Some((kept, dropped)) = self.twins(a, b) else { continue };
                    let mut both = kept.strokes.iter().chain(&dropped.strokes);
                    if both.any(|stroke| touched.contains(stroke)) {
                        continue;
                    }
                    touched.extend(kept.strokes.iter().chain(&dropped.strokes).copied());
                    let along = |stroke: usize| self.nearest(stroke, &kept.strokes);
                    changes.extend(
                        dropped
                            .strokes
                            .iter()
                            .map(|&stroke| PlannedCut::Drop { stroke, along: along(stroke) }),
                    );
                }
            }
        }
        changes
    }

    /// The chains from two ends of one joint if they are duplicates: the one to keep, then the other.
    fn twins(&self, a: StrokeEnd, b: StrokeEnd) -> Option<(Chain, Chain)> {
        if self.joints.relation(a, b) != Some(Tangency::Beside) {
            return None;
        }
        let (one, two) = (self.chain(a), self.chain(b));
        let meet = self.joints.relation(one.ends[1], two.ends[1]) == Some(Tangency::Beside);
        if !meet || one.strokes.iter().any(|k| two.strokes.contains(k)) || !self.side_by_side(&one, &two) {
            return None;
        }
        Some(if self.comes_first(&one, &two) { (one, two) } else { (two, one) })
    }

    /// Road lanes before connectors, then the earliest entity.
    fn comes_first(&self, one: &Chain, two: &Chain) -> bool {
        let rank = |chain: &Chain| {
            let strokes = chain.strokes.iter().map(|&k| &self.strokes.all[k]);
            strokes.map(|stroke| (stroke.kind != crate::LaneKind::Lane, stroke.entity, stroke.part)).min()
        };
        rank(one) <= rank(two)
    }

    /// The chain from an end through all joints of two ends.
    fn chain(&self, first: StrokeEnd) -> Chain {
        let mut strokes = vec![first / 2];
        let mut last = other_end(first);
        loop {
            let joint = self.joints.joint(last);
            let next = joint.ends.iter().copied().find(|&end| end != last);
            match next.filter(|_| joint.ends.len() == 2 && joint.is_through()) {
                Some(next) if !strokes.contains(&(next / 2)) => {
                    strokes.push(next / 2);
                    last = other_end(next);
                }
                _ => return Chain { strokes, ends: [first, last] },
            }
        }
    }

    /// Whether two chains between the same joints keep within the tolerance of each other.
    fn side_by_side(&self, one: &Chain, two: &Chain) -> bool {
        let directions = self.strokes.directions_allow(one.ends[0], two.ends[0], Tangency::Beside);
        directions && self.within(one, two) && self.within(two, one)
    }

    fn within(&self, one: &Chain, two: &Chain) -> bool {
        const SAMPLES: usize = 8;
        one.strokes.iter().all(|&stroke| {
            let rest = &self.strokes.all[stroke].rest;
            (0..=SAMPLES).all(|k| {
                let point = rest.pose_at(rest.length * k as f64 / SAMPLES as f64).position;
                two.strokes.iter().any(|&other| {
                    self.strokes.all[other].rest.project(point).distance <= self.strokes.tolerance_m
                })
            })
        })
    }

    fn nearest(&self, stroke: usize, others: &[usize]) -> usize {
        let rest = &self.strokes.all[stroke].rest;
        let middle = rest.pose_at(rest.length / 2.0).position;
        let distance = |k: usize| self.strokes.all[k].rest.project(middle).distance;
        others.iter().copied().min_by(|&a, &b| distance(a).total_cmp(&distance(b))).unwrap_or(stroke)
    }

    /// Free strokes that lie along others: dropped if they lie there entirely, else one of the two is
    /// trimmed. Later strokes of the file come first.
    fn overhangs(&self) -> Vec<PlannedCut> {
        let free: Vec<StrokeEnd> = self.strokes.ends().filter(|&end| self.joints.is_free(end)).collect();
        let beside: Vec<StrokeOverlap> = free.iter().rev().flat_map(|&end| self.beside(end)).collect();
        let mut touched = BTreeSet::new();
        let mut changes = Vec::new();
        for share in [OverlapExtent::Whole, OverlapExtent::Part] {
            for along in beside.iter().filter(|along| along.share == share) {
                let strokes = [along.end / 2, along.other];
                if strokes.iter().any(|stroke| touched.contains(stroke)) {
                    continue;
                }
                let change = match share {
                    OverlapExtent::Whole => self.drop(along),
                    OverlapExtent::Part => self.trim(along),
                };
                if let Some(change) = change {
                    touched.extend(strokes);
                    changes.push(change);
                }
            }
            if !changes.is_empty() {
                break;
            }
        }
        changes
    }

    /// The overlaps of the stroke of an end with other strokes.
    fn beside(&self, end: StrokeEnd) -> Vec<StrokeOverlap> {
        let others = self.strokes.kept().filter(|&(other, _)| other != end / 2);
        others.filter_map(|(other, _)| runs_along(self.strokes, end, other)).collect()
    }

    /// Drops a stroke that lies along another. If both end in one joint and the other misses it by more, the
    /// other is trimmed instead.
    fn drop(&self, along: &StrokeOverlap) -> Option<PlannedCut> {
        let &StrokeOverlap { end, other, other_length_m, other_end: reached, .. } = along;
        if !self.can_be_dropped(end, other) {
            return None;
        }
        let far = other_end(end);
        let enough = self.strokes.all[other].rest.length - other_length_m > self.strokes.tolerance_m;
        let together = self.joints.relation(far, reached) == Some(Tangency::Beside);
        if together && enough && self.misses_m(far, reached) < self.misses_m(reached, far) - 1e-6 {
            return Some(PlannedCut::Trim { end: reached, beside: end, by_m: other_length_m });
        }
        Some(PlannedCut::Drop { stroke: end / 2, along: other })
    }

    /// Distance of an end from the mean of its joint, without one other end.
    fn misses_m(&self, end: StrokeEnd, aside: StrokeEnd) -> f64 {
        let others = self.joints.joint(end).ends.iter().filter(|&&other| other != end && other != aside);
        let positions: Vec<_> = others.map(|&other| self.strokes.position(other)).collect();
        let middle = positions.iter().sum::<glam::DVec2>() / positions.len().max(1) as f64;
        if positions.is_empty() { 0.0 } else { middle.distance(self.strokes.position(end)) }
    }

    /// Whether a duplicate stroke can be dropped without losing a connection: its far end is free, or joined
    /// to the other stroke as well.
    fn can_be_dropped(&self, end: StrokeEnd, along: usize) -> bool {
        let far = other_end(end);
        let beside = [2 * along, 2 * along + 1];
        let joined = beside.iter().any(|&b| self.joints.relation(far, b) == Some(Tangency::Beside));
        let directions_known = self.strokes.of_end(end).directed && self.strokes.all[along].directed;
        let agree = !directions_known || same_direction(self.strokes, end, along);
        let both_free = self.joints.is_free(far);
        (both_free && self.joints.joint(far).ends.len() == 1) || (agree && (joined || both_free))
    }

    /// Trims one of two overlapping strokes: the one with a free end, else the later one.
    fn trim(&self, along: &StrokeOverlap) -> Option<PlannedCut> {
        let &StrokeOverlap { end, other, length_m, other_length_m, other_end: reached, .. } = along;
        let tolerance = self.strokes.tolerance_m;
        let alone = |end: StrokeEnd| self.joints.joint(end).ends.len() == 1;
        let enough = |stroke: usize, by_m: f64| self.strokes.all[stroke].rest.length - by_m > tolerance / 2.0;
        let mine = PlannedCut::Trim { end, beside: reached, by_m: length_m };
        let theirs = PlannedCut::Trim { end: reached, beside: end, by_m: other_length_m };
        let (can_mine, can_theirs) =
            (enough(end / 2, length_m), self.joints.is_free(reached) && enough(other, other_length_m));
        let prefer_theirs = can_theirs && alone(reached) && (!alone(end) || other > end / 2);
        if prefer_theirs || (!can_mine && can_theirs) {
            return Some(theirs);
        }
        can_mine.then_some(mine)
    }
}
