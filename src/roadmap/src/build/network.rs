//! The graph of pieces: joins ends, splits pieces where others branch off, and reports faulty joints.

use super::pieces::LanePiece;
use super::{JOIN_TOLERANCE_M, KINK_TOLERANCE_DEG, REACH_M, SILENT_JOIN_M, named, place};
use crate::dxf::Drawing;
use crate::error::{Diagnostics, MapErrorKind};
use city3d_geometry::lab::{Curve, Pose2, Segment};
use city3d_geometry::wrap_angle;
use glam::DVec2;
use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::PI;

/// Ends within this angle count as aligned when a gap is reported.
const GAP_ANGLE_DEG: f64 = 5.0;

/// An end of a piece: twice its index, plus one for the end that the segment runs to.
pub(super) type PieceEnd = usize;

/// How two piece ends that meet in one point continue each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Tangency {
    /// One continues the other.
    Through,
    /// Side by side: both arrive or both leave.
    Beside,
}

/// Pieces and the nodes where their ends meet.
#[derive(Debug)]
pub(super) struct PieceGraph {
    /// Lines and arcs of lanes; splitting adds to them.
    pub pieces: Vec<LanePiece>,
    nodes: Vec<DVec2>,
    /// By end.
    node_of: Vec<usize>,
    /// By node, in order.
    ends_at: Vec<Vec<PieceEnd>>,
}

impl PieceGraph {
    /// Joins ends, splits pieces, and reports gaps, kinks and duplicate lanes.
    pub(super) fn join(pieces: Vec<LanePiece>, drawing: &Drawing, diagnostics: &mut Diagnostics) -> Self {
        let mut network = Self { pieces, nodes: Vec::new(), node_of: Vec::new(), ends_at: Vec::new() };
        network.find_nodes(drawing, diagnostics);
        network.split(diagnostics);
        network.refit();
        network.report_overlaps(drawing, diagnostics);
        network.report_gaps(drawing, diagnostics);
        network.report_kinks(drawing, diagnostics);
        network
    }

    pub(super) fn node(&self, end: PieceEnd) -> usize {
        self.node_of[end]
    }

    pub(super) fn node_position(&self, node: usize) -> DVec2 {
        self.nodes[node]
    }

    pub(super) fn node_count(&self) -> usize {
        self.nodes.len()
    }

    pub(super) fn ends_at(&self, node: usize) -> &[PieceEnd] {
        &self.ends_at[node]
    }

    /// Swaps the ends of a piece in the node lists.
    pub(super) fn swap_ends(&mut self, piece: usize) {
        let (a, b) = (2 * piece, 2 * piece + 1);
        let nodes = [self.node_of[a], self.node_of[b]];
        if nodes[0] == nodes[1] {
            return;
        }
        for (node, old, new) in [(nodes[0], a, b), (nodes[1], b, a)] {
            let ends = &mut self.ends_at[node];
            for end in ends.iter_mut().filter(|end| **end == old) {
                *end = new;
            }
            ends.sort_unstable();
        }
        self.node_of.swap(a, b);
    }

    fn pose(&self, end: PieceEnd) -> Pose2 {
        let segment = &self.pieces[end / 2].segment;
        if end.is_multiple_of(2) { segment.start } else { segment.end() }
    }

    /// The heading that leaves the node into the piece.
    fn leaving(&self, end: PieceEnd) -> f64 {
        let yaw = self.pose(end).yaw_rad;
        if end.is_multiple_of(2) { yaw } else { wrap_angle(yaw + PI) }
    }

    /// Deviation from straight on between one end and the other.
    fn kink(&self, a: PieceEnd, b: PieceEnd) -> f64 {
        wrap_angle(self.leaving(a) - self.leaving(b) + PI).abs()
    }

    /// `None` where two ends in one point are not tangent to each other.
    pub(super) fn relation(&self, a: PieceEnd, b: PieceEnd) -> Option<Tangency> {
        let kink = self.kink(a, b);
        if kink <= KINK_TOLERANCE_DEG.to_radians() {
            Some(Tangency::Through)
        } else if PI - kink <= KINK_TOLERANCE_DEG.to_radians() {
            Some(Tangency::Beside)
        } else {
            None
        }
    }

    /// Each end joins the first point of the file within the tolerance, or makes one.
    fn find_nodes(&mut self, drawing: &Drawing, diagnostics: &mut Diagnostics) {
        let cell =
            |p: DVec2| ((p.x / JOIN_TOLERANCE_M).floor() as i64, (p.y / JOIN_TOLERANCE_M).floor() as i64);
        let mut grid: BTreeMap<(i64, i64), Vec<usize>> = BTreeMap::new();
        for end in 0..2 * self.pieces.len() {
            let at = self.pose(end).position;
            let (x, y) = cell(at);
            let around = (x - 1..=x + 1).flat_map(|x| (y - 1..=y + 1).map(move |y| (x, y)));
            let near = around.filter_map(|c| grid.get(&c)).flatten().copied().min_by(|&a, &b| {
                self.nodes[a].distance(at).total_cmp(&self.nodes[b].distance(at)).then(a.cmp(&b))
            });
            let moved = near.map(|node| (node, self.nodes[node].distance(at)));
            match moved.filter(|&(_, by)| by <= JOIN_TOLERANCE_M) {
                Some((node, by)) => {
                    if by > SILENT_JOIN_M {
                        let other = &drawing.entities[self.pieces[self.ends_at[node][0] / 2].entity];
                        let entity = &drawing.entities[self.pieces[end / 2].entity];
                        let message = format!(
                            "end at {} moved by {:.3} mm to meet {}",
                            place(at),
                            by * 1e3,
                            named(other)
                        );
                        diagnostics.note(entity, message);
                    }
                    self.node_of.push(node);
                    self.ends_at[node].push(end);
                }
                None => {
                    grid.entry((x, y)).or_default().push(self.nodes.len());
                    self.node_of.push(self.nodes.len());
                    self.ends_at.push(vec![end]);
                    self.nodes.push(at);
                }
            }
        }
    }

    /// Splits pieces where an end of another one lies on them, tangent to them.
    fn split(&mut self, diagnostics: &mut Diagnostics) {
        let boxes: Vec<[DVec2; 2]> =
            self.pieces.iter().map(|piece| bounds(&piece.segment, JOIN_TOLERANCE_M)).collect();
        // By piece: arc length and node.
        let mut cuts: Vec<Vec<(f64, usize)>> = vec![Vec::new(); self.pieces.len()];
        for (node, &at) in self.nodes.iter().enumerate() {
            for (index, piece) in self.pieces.iter().enumerate() {
                let [low, high] = boxes[index];
                let outside = at.cmplt(low).any() || at.cmpgt(high).any();
                if outside || self.node_of[2 * index] == node || self.node_of[2 * index + 1] == node {
                    continue;
                }
                let s = piece.segment.project(at).s;
                let foot = piece.segment.pose_at(s);
                let inside = s > JOIN_TOLERANCE_M && s < piece.segment.length - JOIN_TOLERANCE_M;
                if !inside || foot.position.distance(at) > JOIN_TOLERANCE_M {
                    continue;
                }
                let tangent = self.ends_at[node].iter().any(|&end| {
                    let turn = wrap_angle(self.leaving(end) - foot.yaw_rad).abs();
                    turn.min(PI - turn) <= KINK_TOLERANCE_DEG.to_radians()
                });
                if tangent {
                    cuts[index].push((s, node));
                }
            }
        }
        let count: usize = cuts.iter().map(Vec::len).sum();
        if count == 0 {
            return;
        }
        diagnostics.note_all(format!("{count} branchings: lanes split where others start or end on them"));
        let mut pieces = Vec::with_capacity(self.pieces.len() + count);
        let mut node_of = Vec::with_capacity(2 * (self.pieces.len() + count));
        for (index, piece) in self.pieces.iter().enumerate() {
            cuts[index].sort_by(|a, b| a.0.total_cmp(&b.0));
            let length = piece.segment.length;
            let (mut from, mut node) = (0.0, self.node_of[2 * index]);
            let last = (length, self.node_of[2 * index + 1]);
            for &(s, next) in cuts[index].iter().chain([&last]) {
                if s - from < JOIN_TOLERANCE_M && s < length {
                    continue;
                }
                let segment = Segment::new(piece.segment.pose_at(from), s - from, piece.segment.curvature);
                pieces.push(LanePiece { segment, ..piece.clone() });
                node_of.extend([node, next]);
                (from, node) = (s, next);
            }
        }
        self.ends_at = vec![Vec::new(); self.nodes.len()];
        for (end, &node) in node_of.iter().enumerate() {
            self.ends_at[node].push(end);
        }
        (self.pieces, self.node_of) = (pieces, node_of);
    }

    /// Moves the ends of pieces to their nodes. Each piece is rotated and scaled about as little as its ends
    /// were apart, so that an arc keeps its sweep.
    fn refit(&mut self) {
        /// Rounding noise is not corrected: the radius stays as drawn.
        const NOISE_M: f64 = 1e-9;
        for index in 0..self.pieces.len() {
            let segment = self.pieces[index].segment;
            let (from, to) = (self.nodes[self.node_of[2 * index]], self.nodes[self.node_of[2 * index + 1]]);
            let end = segment.end().position;
            let start = segment.start.position;
            if start.distance(from) < NOISE_M && end.distance(to) < NOISE_M {
                continue;
            }
            let (old, new) = (end - start, to - from);
            // A closed ring has no chord to rotate.
            if old.length() < 10.0 * JOIN_TOLERANCE_M && segment.curvature != 0.0 || new.length() == 0.0 {
                continue;
            }
            let scale = new.length() / old.length();
            let turn = city3d_geometry::trig::atan2(old.perp_dot(new), old.dot(new));
            let start = Pose2::at(from, wrap_angle(segment.start.yaw_rad + turn));
            self.pieces[index].segment =
                Segment::new(start, segment.length * scale, segment.curvature / scale);
        }
    }

    fn report_overlaps(&self, drawing: &Drawing, diagnostics: &mut Diagnostics) {
        let mut by_nodes: BTreeMap<(usize, usize), Vec<usize>> = BTreeMap::new();
        for index in 0..self.pieces.len() {
            let (a, b) = (self.node_of[2 * index], self.node_of[2 * index + 1]);
            by_nodes.entry((a.min(b), a.max(b))).or_default().push(index);
        }
        for same in by_nodes.values() {
            let middle = |k: usize| {
                let segment = &self.pieces[k].segment;
                segment.pose_at(segment.length / 2.0).position
            };
            for (k, &a) in same.iter().enumerate() {
                let Some(&b) =
                    same[k + 1..].iter().find(|&&b| middle(a).distance(middle(b)) <= JOIN_TOLERANCE_M)
                else {
                    continue;
                };
                let entities = [a, b].map(|p| &drawing.entities[self.pieces[p].entity]);
                let message = format!(
                    "{:.1} mm near {} are drawn twice, here and by {}",
                    self.pieces[a].segment.length * 1e3,
                    place(middle(a)),
                    named(entities[0])
                );
                let remedy = "delete one, or trim it to where the other starts";
                diagnostics.error(MapErrorKind::Overlap, entities[1], message, remedy);
            }
        }
    }

    /// Reports a free end with another one aligned a little ahead.
    fn report_gaps(&self, drawing: &Drawing, diagnostics: &mut Diagnostics) {
        let dangling = |end: PieceEnd| self.ends_at[self.node_of[end]].len() == 1;
        let ends: Vec<(DVec2, f64)> =
            (0..self.node_of.len()).map(|end| (self.nodes[self.node_of[end]], self.leaving(end))).collect();
        for end in (0..ends.len()).filter(|&end| dangling(end)) {
            let lined_up = |other: &PieceEnd| {
                let distance = ends[*other].0.distance(ends[end].0);
                // The other end of the same piece does not count.
                distance <= REACH_M
                    && (other / 2 != end / 2 || self.pieces[end / 2].segment.length > 2.0 * REACH_M)
                    && wrap_angle(ends[*other].1 - ends[end].1 + PI).abs() <= GAP_ANGLE_DEG.to_radians()
            };
            let nearest = (0..ends.len()).filter(|&other| other != end).filter(lined_up).min_by(|&a, &b| {
                let distance = |e: PieceEnd| ends[e].0.distance(ends[end].0);
                distance(a).total_cmp(&distance(b)).then(a.cmp(&b))
            });
            let Some(other) = nearest.filter(|&other| !(dangling(other) && other < end)) else { continue };
            let entities = [end, other].map(|e| &drawing.entities[self.pieces[e / 2].entity]);
            let message = format!(
                "gap of {:.1} mm at {} between {} and {}",
                ends[end].0.distance(ends[other].0) * 1e3,
                place(ends[end].0),
                named(entities[0]),
                named(entities[1])
            );
            diagnostics.error(MapErrorKind::Gap, entities[0], message, "move the ends together");
        }
    }

    /// Reports an end that meets others but is tangent to none.
    fn report_kinks(&self, drawing: &Drawing, diagnostics: &mut Diagnostics) {
        let mut reported = BTreeSet::new();
        for ends in &self.ends_at {
            for &end in ends {
                let others = || ends.iter().copied().filter(move |&other| other != end);
                if others().any(|other| self.relation(end, other).is_some()) {
                    continue;
                }
                let straightest =
                    others().min_by(|&a, &b| self.kink(end, a).total_cmp(&self.kink(end, b)).then(a.cmp(&b)));
                let Some(other) = straightest else { continue };
                if !reported.insert((end.min(other), end.max(other))) {
                    continue;
                }
                let entities =
                    [end.min(other), end.max(other)].map(|e| &drawing.entities[self.pieces[e / 2].entity]);
                let message = format!(
                    "kink of {:.1} degrees at {} between {} and {}",
                    self.kink(end, other).to_degrees(),
                    place(self.nodes[self.node_of[end]]),
                    named(entities[0]),
                    named(entities[1])
                );
                let remedy = "joints must be tangent within 1 degree: join them by an arc tangent to both";
                diagnostics.error(MapErrorKind::Kink, entities[1], message, remedy);
            }
        }
    }
}

/// The bounding box of a segment.
fn bounds(segment: &Segment, margin: f64) -> [DVec2; 2] {
    // A chord of a tenth of a turn leaves its arc by less than 5 % of the radius.
    let step = segment.radius().map_or(segment.length, |radius| radius * PI / 5.0);
    let sagitta = segment.radius().map_or(0.0, |radius| radius * 0.05);
    let points = Curve::new(vec![*segment]).sample(step);
    let (low, high) = points.iter().fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(low, high), (_, p)| {
        (low.min(p.pose.position), high.max(p.pose.position))
    });
    [low - (margin + sagitta), high + (margin + sagitta)]
}
