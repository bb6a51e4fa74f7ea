//! Ways drawn twice: strokes that lie along others are dropped, and ends that run past the start of another
//! are trimmed.

use super::along::{Along, Share, other_end, runs_along, same_direction};
use super::joints::{self, Joints};
use super::strokes::{End, Relation, Strokes};
use std::collections::BTreeSet;

/// What became of strokes, by index.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Cut {
    /// The first lies along the second, over its whole length.
    Dropped { stroke: usize, along: usize },
    /// The end ran along the other stroke.
    Trimmed { end: End, by_m: f64, along: usize },
}

/// Drops and trims until no way is drawn twice; returns the joints of what is left.
pub(super) fn remove(strokes: &mut Strokes, cuts: &mut Vec<Cut>) -> Joints {
    // Each round drops a stroke or takes a free end away: this bounds what cannot go on for ever.
    for _ in 0..4 * strokes.all.len() + 4 {
        let joints = joints::find(strokes);
        let finder = Finder { strokes, joints: &joints };
        let twins = finder.twin_chains();
        let changes = if twins.is_empty() { finder.overhangs() } else { twins };
        if changes.is_empty() {
            return joints;
        }
        for change in changes {
            match change {
                Change::Drop { stroke, along } => {
                    strokes.all[stroke].dropped = true;
                    cuts.push(Cut::Dropped { stroke, along });
                }
                Change::Trim { end, beside, by_m } => {
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
enum Change {
    Drop { stroke: usize, along: usize },
    Trim { end: End, beside: End, by_m: f64 },
}

/// Strokes in line between two joints at which lanes branch.
struct Chain {
    strokes: Vec<usize>,
    /// The ends with which it begins and ends.
    ends: [End; 2],
}

struct Finder<'a> {
    strokes: &'a Strokes,
    joints: &'a Joints,
}

impl Finder<'_> {
    /// Chains of strokes between the same joints, side by side all the way: the later ones are dropped. No stroke
    /// has a part in two changes of one round.
    fn twin_chains(&self) -> Vec<Change> {
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
                        dropped.strokes.iter().map(|&stroke| Change::Drop { stroke, along: along(stroke) }),
                    );
                }
            }
        }
        changes
    }

    /// The chains from two ends in one joint if they are the same way twice: the one to keep, and the other.
    fn twins(&self, a: End, b: End) -> Option<(Chain, Chain)> {
        if self.joints.relation(a, b) != Some(Relation::Beside) {
            return None;
        }
        let (one, two) = (self.chain(a), self.chain(b));
        let meet = self.joints.relation(one.ends[1], two.ends[1]) == Some(Relation::Beside);
        if !meet || one.strokes.iter().any(|k| two.strokes.contains(k)) || !self.side_by_side(&one, &two) {
            return None;
        }
        Some(if self.comes_first(&one, &two) { (one, two) } else { (two, one) })
    }

    /// Lanes of roads before ways across junctions, then by the earliest entity.
    fn comes_first(&self, one: &Chain, two: &Chain) -> bool {
        let rank = |chain: &Chain| {
            let strokes = chain.strokes.iter().map(|&k| &self.strokes.all[k]);
            strokes
                .map(|stroke| (stroke.kind != crate::city::LaneKind::Lane, stroke.entity, stroke.part))
                .min()
        };
        rank(one) <= rank(two)
    }

    /// From an end through all joints of two ends.
    fn chain(&self, first: End) -> Chain {
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
        let directions = self.strokes.directions_allow(one.ends[0], two.ends[0], Relation::Beside);
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

    /// Strokes with an end from which nothing goes on, along other strokes: dropped where all of one lies there,
    /// else one of the two is trimmed. Later strokes of the file come first.
    fn overhangs(&self) -> Vec<Change> {
        let free: Vec<End> = self.strokes.ends().filter(|&end| self.joints.is_free(end)).collect();
        let beside: Vec<Along> = free.iter().rev().flat_map(|&end| self.beside(end)).collect();
        let mut touched = BTreeSet::new();
        let mut changes = Vec::new();
        for share in [Share::Whole, Share::Part] {
            for along in beside.iter().filter(|along| along.share == share) {
                let strokes = [along.end / 2, along.other];
                if strokes.iter().any(|stroke| touched.contains(stroke)) {
                    continue;
                }
                let change = match share {
                    Share::Whole => self.drop(along),
                    Share::Part => self.trim(along),
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

    /// The strokes that one runs along from an end.
    fn beside(&self, end: End) -> Vec<Along> {
        let others = self.strokes.kept().filter(|&(other, _)| other != end / 2);
        others.filter_map(|(other, _)| runs_along(self.strokes, end, other)).collect()
    }

    /// Drops a stroke that lies along another. Where both end in one joint and the other one misses it by more,
    /// that one is trimmed instead.
    fn drop(&self, along: &Along) -> Option<Change> {
        let &Along { end, other, other_length_m, other_end: reached, .. } = along;
        if !self.can_be_dropped(end, other) {
            return None;
        }
        let far = other_end(end);
        let enough = self.strokes.all[other].rest.length - other_length_m > self.strokes.tolerance_m;
        let together = self.joints.relation(far, reached) == Some(Relation::Beside);
        if together && enough && self.misses_m(far, reached) < self.misses_m(reached, far) - 1e-6 {
            return Some(Change::Trim { end: reached, beside: end, by_m: other_length_m });
        }
        Some(Change::Drop { stroke: end / 2, along: other })
    }

    /// How far an end is from the others of its joint, one left aside.
    fn misses_m(&self, end: End, aside: End) -> f64 {
        let others = self.joints.joint(end).ends.iter().filter(|&&other| other != end && other != aside);
        let positions: Vec<_> = others.map(|&other| self.strokes.position(other)).collect();
        let middle = positions.iter().sum::<glam::DVec2>() / positions.len().max(1) as f64;
        if positions.is_empty() { 0.0 } else { middle.distance(self.strokes.position(end)) }
    }

    /// Whether nothing is lost with a stroke that lies along another: what is joined to its far end is joined to
    /// the other stroke as well, or is free.
    fn can_be_dropped(&self, end: End, along: usize) -> bool {
        let far = other_end(end);
        let beside = [2 * along, 2 * along + 1];
        let joined = beside.iter().any(|&b| self.joints.relation(far, b) == Some(Relation::Beside));
        let directions_known = self.strokes.of_end(end).directed && self.strokes.all[along].directed;
        let agree = !directions_known || same_direction(self.strokes, end, along);
        let both_free = self.joints.is_free(far);
        (both_free && self.joints.joint(far).ends.len() == 1) || (agree && (joined || both_free))
    }

    /// Which of two strokes that overlap is trimmed: the one whose end is joined to nothing, else the later one.
    fn trim(&self, along: &Along) -> Option<Change> {
        let &Along { end, other, length_m, other_length_m, other_end: reached, .. } = along;
        let tolerance = self.strokes.tolerance_m;
        let alone = |end: End| self.joints.joint(end).ends.len() == 1;
        let enough = |stroke: usize, by_m: f64| self.strokes.all[stroke].rest.length - by_m > tolerance / 2.0;
        let mine = Change::Trim { end, beside: reached, by_m: length_m };
        let theirs = Change::Trim { end: reached, beside: end, by_m: other_length_m };
        let (can_mine, can_theirs) =
            (enough(end / 2, length_m), self.joints.is_free(reached) && enough(other, other_length_m));
        let prefer_theirs = can_theirs && alone(reached) && (!alone(end) || other > end / 2);
        if prefer_theirs || (!can_mine && can_theirs) {
            return Some(theirs);
        }
        can_mine.then_some(mine)
    }
}
