//! Least-squares adjustment of a lane network: the smallest displacement of all ends, and of the middles of
//! arcs, under which every joint is one point with one tangent, lines stay straight and arcs circular.
//!
//! Unknowns are the position and the tangent of each joint. An edge is an arc exactly if its chord has the
//! mean heading of its ends, and a line if these headings are also equal. The constrained problem is solved
//! by the augmented Lagrangian method (Nocedal and Wright, Numerical Optimization, chapter 17) with
//! Levenberg-Marquardt steps on the normal equations.

use super::sparse::BlockSystem;
use city3d_geometry::lab::Segment;
use city3d_geometry::{trig, wrap_angle};
use glam::{DMat3, DVec2, DVec3};
use std::f64::consts::TAU;

/// Weight of constraints, where displacements have weight 1.
const PENALTY: f64 = 1e4;
/// Constraints hold within this, metres.
const CONVERGED_M: f64 = 1e-11;
const MAX_MULTIPLIER_STEPS: usize = 60;
const MAX_STEPS: usize = 40;
const FIRST_DAMPING: f64 = 1e-2;
const LEAST_DAMPING: f64 = 1e-12;
/// Lever arm that converts an angle to a length, metres.
const LEVER_M: f64 = 0.1;
/// Regularisation: keeps undetermined unknowns where they are.
const KEEP: f64 = 1e-9;
/// Trust region: largest step of a joint, metres and radians.
const MAX_STEP: f64 = 0.05;
/// Edges keep at least this length, metres, and this share of their chord; arcs this share of their sweep.
const MIN_CHORD_M: f64 = 2e-3;
const MIN_CHORD_SHARE: f64 = 0.2;
const MIN_SWEEP_SHARE: f64 = 0.1;

/// Constraint slots of an edge: equations, then inequalities.
const OFF_CHORD: usize = 0;
const TURN: usize = 1;
const CIRCLE: usize = 2;
const FIRST_INEQUALITY: usize = 3;
const SWEEP: usize = 3;
const CHORD: usize = 4;
const SLOTS: usize = 5;

/// A joint of the adjustment: position and tangent.
#[derive(Clone, Copy, Debug)]
pub(super) struct JointNode {
    /// Laboratory metres.
    pub at: DVec2,
    /// Heading of the tangent, counter-clockwise from east.
    pub tangent_rad: f64,
}

/// An edge of the adjustment network: a stroke, or a part of one, between two joints.
#[derive(Clone, Debug)]
pub(super) struct NetworkEdge {
    /// Start and end.
    pub nodes: [usize; 2],
    /// Whether the heading at each end is opposite to the tangent of its joint.
    pub against: [bool; 2],
    /// As drawn.
    pub drawn: Segment,
    /// Ends whose displacement is penalised; others lie on a stroke that is split.
    pub anchored: [bool; 2],
    /// The edge before it on the same arc, which shares its circle.
    pub same_circle_as: Option<usize>,
}

/// Gradients by start node and end node: x, y, tangent.
type Gradient = [DVec3; 2];
type Residual = (f64, Gradient);

/// The shape of an edge between its joints, with gradients.
struct EdgeShape {
    /// The mean of the headings at both ends.
    mean_rad: f64,
    /// Deviation of the chord from the mean heading, metres; 0 for an arc.
    off_m: Residual,
    chord_m: Residual,
    sweep_rad: Residual,
}

/// What a residual of the normal equations stands for.
#[derive(Clone, Copy)]
enum ResidualKind {
    Displacement,
    /// Index of its multiplier.
    Constraint(usize),
}

impl ResidualKind {
    fn weight(self) -> f64 {
        match self {
            Self::Displacement => 1.0,
            Self::Constraint(_) => PENALTY,
        }
    }
}

/// The least-squares problem; [`Self::solve`] moves its joints.
#[derive(Clone, Debug)]
pub(super) struct Adjustment {
    /// Joints: as drawn at first, adjusted after the solution.
    pub nodes: Vec<JointNode>,
    /// Edges between the joints.
    pub members: Vec<NetworkEdge>,
    /// By edge: whole turns that make the sweep that of the drawing.
    turns_rad: Vec<f64>,
    start: Vec<JointNode>,
}

impl Adjustment {
    pub(super) fn new(nodes: Vec<JointNode>, members: Vec<NetworkEdge>) -> Self {
        let mut adjustment =
            Self { start: nodes.clone(), nodes, turns_rad: vec![0.0; members.len()], members };
        for k in 0..adjustment.members.len() {
            let drawn = &adjustment.members[k].drawn;
            let wanted = drawn.length * drawn.curvature;
            let raw = adjustment.heading(k, 1) - adjustment.heading(k, 0);
            adjustment.turns_rad[k] = libm::round((wanted - raw) / TAU) * TAU;
        }
        adjustment
    }

    /// Heading of an edge at its start or end, up to whole turns.
    fn heading(&self, member: usize, end: usize) -> f64 {
        let member = &self.members[member];
        let turn = if member.against[end] { std::f64::consts::PI } else { 0.0 };
        self.nodes[member.nodes[end]].tangent_rad + turn
    }

    fn is_ring(&self, member: usize) -> bool {
        self.members[member].nodes[0] == self.members[member].nodes[1]
    }

    /// Solves the adjustment; returns whether all constraints hold.
    pub(super) fn solve(&mut self) -> bool {
        let mut multipliers = vec![0.0; SLOTS * self.members.len()];
        let mut damping = FIRST_DAMPING;
        for _ in 0..MAX_MULTIPLIER_STEPS {
            let Some(last_m) = self.descend(&multipliers, &mut damping) else { return false };
            let mut next = vec![0.0; multipliers.len()];
            let mut worst_m: f64 = 0.0;
            self.for_rows(&multipliers, |row, residual, _| {
                if let ResidualKind::Constraint(index) = row {
                    next[index] = residual;
                    worst_m = worst_m.max((residual - multipliers[index]).abs());
                }
            });
            multipliers = next;
            if worst_m < CONVERGED_M && last_m < 1e2 * CONVERGED_M {
                return true;
            }
        }
        false
    }

    /// Takes Levenberg-Marquardt steps (Nocedal and Wright, chapter 10) under fixed multipliers until they
    /// are small or do not help. Returns the last step, metres, `None` where numbers fail.
    fn descend(&mut self, multipliers: &[f64], damping: &mut f64) -> Option<f64> {
        let mut merit = self.merit(multipliers);
        let mut last_m = 0.0;
        for _ in 0..MAX_STEPS {
            let moves = self.normal_equations(multipliers, *damping).solve();
            let longest = moves.iter().map(|by| by.abs().max_element()).fold(0.0, f64::max);
            if !longest.is_finite() {
                return None;
            }
            let before = self.nodes.clone();
            let scale = (MAX_STEP / longest.max(1e-300)).min(1.0);
            for (node, by) in self.nodes.iter_mut().zip(&moves) {
                node.at += by.truncate() * scale;
                node.tangent_rad += by.z * scale;
            }
            let after = self.merit(multipliers);
            if after <= merit {
                (merit, last_m) = (after, longest);
                *damping = (*damping * 0.1).max(LEAST_DAMPING);
                if longest < CONVERGED_M {
                    break;
                }
            } else {
                self.nodes = before;
                // The gain is within rounding.
                if longest < 10.0 * CONVERGED_M {
                    break;
                }
                *damping *= 10.0;
            }
        }
        Some(last_m)
    }

    /// The augmented Lagrangian, up to a constant.
    fn merit(&self, multipliers: &[f64]) -> f64 {
        let mut sum = 0.0;
        self.for_rows(multipliers, |row, residual, _| sum += row.weight() * residual * residual);
        sum
    }

    /// Normal equations of the next step.
    fn normal_equations(&self, multipliers: &[f64], damping: f64) -> BlockSystem {
        let mut system = BlockSystem::new(self.nodes.len());
        for (node, (now, start)) in self.nodes.iter().zip(&self.start).enumerate() {
            let damping = DVec3::new(1.0, 1.0, LEVER_M * LEVER_M) * damping;
            system.add(node, node, DMat3::from_diagonal(DVec3::splat(KEEP) + damping));
            let off = (start.at - now.at).extend(start.tangent_rad - now.tangent_rad);
            system.add_right(node, off * KEEP);
        }
        self.for_rows(multipliers, |row, residual, gradient| {
            let weight = row.weight();
            for (k, &(a, by_a)) in gradient.iter().enumerate() {
                system.add_right(a, by_a * (-weight * residual));
                system.add(a, a, outer(by_a, by_a) * weight);
                for &(b, by_b) in &gradient[k + 1..] {
                    let cross = outer(by_a, by_b) * weight;
                    // A joint that appears twice in a row adds to its own block for both.
                    system.add(a, b, if a == b { cross + cross.transpose() } else { cross });
                }
            }
        });
        system
    }

    /// Calls `take` for every residual with its gradient by joint; constraints include their multiplier over
    /// the penalty.
    fn for_rows(&self, multipliers: &[f64], mut take: impl FnMut(ResidualKind, f64, &[(usize, DVec3)])) {
        for (k, member) in self.members.iter().enumerate() {
            let ends = [member.drawn.start.position, member.drawn.end().position];
            for (end, drawn) in ends.into_iter().enumerate().filter(|&(end, _)| member.anchored[end]) {
                let (node, off) = (member.nodes[end], self.nodes[member.nodes[end]].at - drawn);
                take(ResidualKind::Displacement, off.x, &[(node, DVec3::X)]);
                take(ResidualKind::Displacement, off.y, &[(node, DVec3::Y)]);
            }
            if self.is_ring(k) {
                continue;
            }
            let shape = self.shape(k);
            for (slot, (residual, gradient)) in self.constraints(k, &shape) {
                let index = SLOTS * k + slot;
                let residual = residual + multipliers[index];
                // An inequality counts only where it is violated.
                if slot < FIRST_INEQUALITY || residual < 0.0 {
                    let [a, b] = member.nodes;
                    take(ResidualKind::Constraint(index), residual, &[(a, gradient[0]), (b, gradient[1])]);
                }
            }
            if member.drawn.curvature == 0.0 {
                continue;
            }
            let known = 1.0 / middle_error(&member.drawn);
            let (middle_m, [by_a, by_b]) = scaled(self.middle_displacement(k, &shape), known);
            take(ResidualKind::Displacement, middle_m, &[(member.nodes[0], by_a), (member.nodes[1], by_b)]);
            if let Some(before) = member.same_circle_as {
                let index = SLOTS * k + CIRCLE;
                let (residual, gradient) = self.circle_change(before, k);
                take(ResidualKind::Constraint(index), residual + multipliers[index], &gradient);
            }
        }
    }

    /// Displacement of the middle of an arc from the drawing, left-positive.
    fn middle_displacement(&self, member: usize, shape: &EdgeShape) -> Residual {
        let NetworkEdge { nodes: [a, b], drawn, .. } = &self.members[member];
        let middle = drawn.pose_at(drawn.length / 2.0).position;
        let from_chord = middle - (self.nodes[*a].at + self.nodes[*b].at) / 2.0;
        let along = super::unit(shape.mean_rad);
        let left = along.perp();
        // The arc lies to the right of its chord by the sagitta where it turns left.
        let ((chord, by_chord), (sweep, by_sweep)) = (shape.chord_m, shape.sweep_rad);
        let tangent = trig::tan(sweep / 4.0);
        let sagitta = chord / 2.0 * tangent;
        let by_node = (-left / 2.0).extend(-along.dot(from_chord) / 2.0);
        let gradient = [0, 1].map(|k| {
            by_node + by_chord[k] * (tangent / 2.0) + by_sweep[k] * (chord / 8.0 * (1.0 + tangent * tangent))
        });
        (left.dot(from_chord) + sagitta, gradient)
    }

    /// By slot: equations, then inequalities that hold where they are not negative.
    fn constraints(&self, member: usize, shape: &EdgeShape) -> Vec<(usize, Residual)> {
        let drawn = &self.members[member].drawn;
        let mut constraints = vec![(OFF_CHORD, shape.off_m)];
        if drawn.curvature == 0.0 {
            constraints.push((TURN, scaled(shape.sweep_rad, LEVER_M)));
        } else {
            let (sweep, gradient) = shape.sweep_rad;
            let turn = drawn.curvature.signum();
            let least = MIN_SWEEP_SHARE * drawn.length * drawn.curvature.abs();
            let spare = (turn * sweep - least, gradient.map(|g| g * turn));
            constraints.push((SWEEP, scaled(spare, LEVER_M)));
        }
        let drawn_chord_m = drawn.start.position.distance(drawn.end().position);
        let least_m = (MIN_CHORD_SHARE * drawn_chord_m).max(MIN_CHORD_M);
        constraints.push((CHORD, (shape.chord_m.0 - least_m, shape.chord_m.1)));
        constraints
    }

    /// The difference of the curvatures of two edges, as a sagitta over their common length.
    fn circle_change(&self, before: usize, member: usize) -> (f64, Vec<(usize, DVec3)>) {
        let length = self.members[before].drawn.length + self.members[member].drawn.length;
        let lever = length * length / 8.0;
        let mut residual = 0.0;
        let mut gradient = Vec::with_capacity(4);
        for (index, sign) in [(before, -lever), (member, lever)] {
            let shape = self.shape(index);
            let ((chord, by_chord), (sweep, by_sweep)) = (shape.chord_m, shape.sweep_rad);
            let curvature = 2.0 * trig::sin(sweep / 2.0) / chord;
            residual += sign * curvature;
            for end in [0, 1] {
                let by =
                    by_sweep[end] * (trig::cos(sweep / 2.0) / chord) - by_chord[end] * (curvature / chord);
                gradient.push((self.members[index].nodes[end], by * sign));
            }
        }
        (residual, gradient)
    }

    fn shape(&self, member: usize) -> EdgeShape {
        let [a, b] = self.members[member].nodes;
        let sweep = self.heading(member, 1) - self.heading(member, 0) + self.turns_rad[member];
        let mean = self.heading(member, 0) + sweep / 2.0;
        let along = super::unit(mean);
        let chord = self.nodes[b].at - self.nodes[a].at;
        let (off, length) = (along.perp_dot(chord), along.dot(chord));
        let left = along.perp();
        EdgeShape {
            mean_rad: mean,
            off_m: (off, [(-left).extend(-length / 2.0), left.extend(-length / 2.0)]),
            chord_m: (length, [(-along).extend(off / 2.0), along.extend(off / 2.0)]),
            sweep_rad: (sweep, [DVec3::NEG_Z, DVec3::Z]),
        }
    }

    /// The adjusted segment of consecutive edges of one stroke.
    pub(super) fn segment(&self, members: &[usize]) -> Segment {
        let (first, last) = (members[0], members[members.len() - 1]);
        let drawn = &self.members[first].drawn;
        let from = self.nodes[self.members[first].nodes[0]].at;
        let to = self.nodes[self.members[last].nodes[1]].at;
        if members.len() == 1 && self.is_ring(first) {
            let mut start = drawn.start;
            start.position = from;
            return Segment::new(start, drawn.length, drawn.curvature);
        }
        let line = Segment::line(from, to);
        if drawn.curvature == 0.0 {
            return line;
        }
        let sweep: f64 = members.iter().map(|&member| self.shape(member).sweep_rad.0).sum();
        let curvature = 2.0 * trig::sin(sweep / 2.0) / line.length;
        let mut start = line.start;
        start.yaw_rad = wrap_angle(line.start.yaw_rad - sweep / 2.0);
        Segment::new(start, sweep / curvature, curvature)
    }
}

/// How far the middle of an arc moves per unit of displacement of its ends at fixed radius: far near half a
/// turn.
pub(super) fn middle_error(drawn: &Segment) -> f64 {
    const MOST: f64 = 20.0;
    let lever = trig::tan(drawn.length * drawn.curvature / 2.0) / 2.0;
    (1.0 + lever * lever).sqrt().min(MOST)
}

fn outer(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}

fn scaled((value, gradient): Residual, factor: f64) -> Residual {
    (value * factor, gradient.map(|g| g * factor))
}
