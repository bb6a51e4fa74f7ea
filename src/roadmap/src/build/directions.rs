//! Assigns every piece its direction of travel, propagated from lines and arrows to arcs.

use super::network::{PieceEnd, PieceGraph, Tangency};
use super::pieces::DrawnLine;
use super::{REACH_M, named, place};
use crate::dxf::Drawing;
use crate::error::{Diagnostics, MapErrorKind};
use city3d_geometry::lab::Curve;
use city3d_geometry::{trig, wrap_angle};
use std::collections::{BTreeSet, VecDeque};
use std::f64::consts::PI;

/// An arrow belongs to a piece that it is parallel to within this angle.
const ARROW_ANGLE_DEG: f64 = 20.0;

/// Turns every piece into its direction of travel and marks it as directed.
///
/// Breadth-first propagation over tangent joints: where a directed piece arrives, pieces straight ahead leave
/// and pieces beside it arrive.
pub(super) fn assign(
    network: &mut PieceGraph,
    arrows: &[DrawnLine],
    drawing: &Drawing,
    diagnostics: &mut Diagnostics,
) {
    let mut spread = DirectionPropagation {
        network,
        drawing,
        forward: network.pieces.iter().map(|piece| piece.directed.then_some(true)).collect(),
        queue: VecDeque::new(),
        reported: BTreeSet::new(),
    };
    for index in 0..network.pieces.len() {
        if network.pieces[index].directed {
            spread.queue.push_back(index);
        }
    }
    for arrow in arrows {
        spread.arrow(arrow, diagnostics);
    }
    spread.run(diagnostics);
    for index in 0..network.pieces.len() {
        if spread.forward[index].is_none() {
            spread.undirected(index, diagnostics);
        }
    }
    let forward = spread.forward;
    network.orient(&forward);
}

struct DirectionPropagation<'a> {
    network: &'a PieceGraph,
    drawing: &'a Drawing,
    /// By piece: whether it is driven as drawn.
    forward: Vec<Option<bool>>,
    queue: VecDeque<usize>,
    reported: BTreeSet<(usize, usize)>,
}

/// Whether a piece arrives at one of its ends, given its direction.
fn comes_in(end: PieceEnd, forward: bool) -> bool {
    (end % 2 == 1) == forward
}

impl DirectionPropagation<'_> {
    fn arrow(&mut self, arrow: &DrawnLine, diagnostics: &mut Diagnostics) {
        let middle = (arrow.from + arrow.to) / 2.0;
        let along = arrow.to - arrow.from;
        let heading = trig::atan2(along.y, along.x);
        let mut nearest: Option<(f64, usize, bool)> = None;
        for (index, piece) in self.network.pieces.iter().enumerate() {
            let foot = piece.segment.pose_at(piece.segment.project(middle).s);
            let turn = wrap_angle(foot.yaw_rad - heading).abs();
            let distance = foot.position.distance(middle);
            let parallel = turn.min(PI - turn) <= ARROW_ANGLE_DEG.to_radians();
            if parallel && distance <= REACH_M && nearest.is_none_or(|(least, ..)| distance < least) {
                nearest = Some((distance, index, turn < PI / 2.0));
            }
        }
        let Some((_, index, forward)) = nearest else {
            let message = format!("the arrow at {} is not along a lane", place(middle));
            let remedy = "draw it within half a lane width of a lane and parallel to it, or delete it";
            diagnostics.error(MapErrorKind::Stray, arrow.entity, message, remedy);
            return;
        };
        match self.forward[index] {
            None => {
                self.forward[index] = Some(forward);
                self.queue.push_back(index);
            }
            Some(known) if known != forward => {
                let other = &self.drawing.entities[self.network.pieces[index].entity];
                let message = format!("the arrow points against {}", named(other));
                let remedy = "turn the arrow, or turn the line (a LINE is driven from its first point)";
                diagnostics.error(MapErrorKind::Direction, arrow.entity, message, remedy);
            }
            Some(_) => {}
        }
    }

    fn run(&mut self, diagnostics: &mut Diagnostics) {
        let network = self.network;
        while let Some(index) = self.queue.pop_front() {
            let Some(forward) = self.forward[index] else { continue };
            for end in [2 * index, 2 * index + 1] {
                for &other in network.ends_at(network.node(end)) {
                    let Some(relation) = (other != end).then(|| network.relation(end, other)).flatten()
                    else {
                        continue;
                    };
                    let other_in = comes_in(end, forward) == (relation == Tangency::Beside);
                    let other_forward = comes_in(other, true) == other_in;
                    match self.forward[other / 2] {
                        None => {
                            self.forward[other / 2] = Some(other_forward);
                            self.queue.push_back(other / 2);
                        }
                        Some(known) if known != other_forward => self.contradiction(end, other, diagnostics),
                        Some(_) => {}
                    }
                }
            }
        }
    }

    fn contradiction(&mut self, end: PieceEnd, other: PieceEnd, diagnostics: &mut Diagnostics) {
        let (first, second) = (end.min(other), end.max(other));
        if !self.reported.insert((first, second)) {
            return;
        }
        let entities = [first, second].map(|e| &self.drawing.entities[self.network.pieces[e / 2].entity]);
        let message = format!(
            "{} and {} run against each other at {}",
            named(entities[0]),
            named(entities[1]),
            place(self.network.node_position(self.network.node(end)))
        );
        let remedy = "turn one of them (REVERSE): a LINE is driven from its first point, and an ARC takes \
                      the direction of the lines and arrows it is joined to";
        diagnostics.error(MapErrorKind::Direction, entities[1], message, remedy);
    }

    /// Reports arcs without a direction, once per connected group.
    fn undirected(&mut self, index: usize, diagnostics: &mut Diagnostics) {
        let before = self.forward.iter().flatten().count();
        self.forward[index] = Some(true);
        self.queue.push_back(index);
        // Their contradictions are reported only once they have a direction.
        self.run(&mut Diagnostics::default());
        let joined = self.forward.iter().flatten().count() - before - 1;
        let entity = &self.drawing.entities[self.network.pieces[index].entity];
        let others = match joined {
            0 => String::new(),
            1 => " (nor has one arc that is joined to it)".to_owned(),
            n => format!(" (nor have {n} arcs that are joined to it)"),
        };
        let message = format!("the ARC has no direction of travel{others}");
        let remedy = "draw a LINE from tail to tip on layer ARROWS along it, or join it to a LINE";
        diagnostics.error(MapErrorKind::Direction, entity, message, remedy);
    }
}

impl PieceGraph {
    /// Reverses the pieces that are driven against their drawing.
    fn orient(&mut self, forward: &[Option<bool>]) {
        for (index, forward) in forward.iter().enumerate() {
            if *forward == Some(false) {
                self.swap_ends(index);
                let reversed = Curve::new(vec![self.pieces[index].segment]).reversed();
                self.pieces[index].segment = reversed.segments()[0];
            }
            self.pieces[index].directed = true;
        }
    }
}
