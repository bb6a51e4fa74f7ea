//! Builds the adjustment network from joints: splits strokes where others branch off, and reports faults
//! beyond the tolerance.

use super::adjust::{Adjustment, JointNode, NetworkEdge};
use super::joints::Joints;
use super::strokes::{LaneStrokes, StrokeEnd, Tangency};
use super::{is_exact, turn_of};
use crate::build::{REACH_M, SILENT_JOIN_M, named, place};
use crate::dxf::Entity;
use crate::error::{Diagnostics, MapErrorKind};
use city3d_geometry::lab::Segment;
use city3d_geometry::wrap_angle;
use glam::DVec2;
use std::collections::BTreeMap;
use std::f64::consts::{FRAC_PI_2, PI};

/// Ends within this angle count as aligned when a gap is reported; for two free ends the second angle
/// applies.
const GAP_ANGLE_RAD: f64 = 5.0 * PI / 180.0;
const FREE_GAP_ANGLE_RAD: f64 = 15.0 * PI / 180.0;

/// The adjustment network, and the edges of each stroke.
pub(super) struct AdjustmentNetwork {
    /// Joints and edges for the solver.
    pub adjustment: Adjustment,
    /// By stroke, in order along it.
    pub members: BTreeMap<usize, Vec<usize>>,
}

/// Position of a joint on a stroke, metres along it.
#[derive(Clone, Copy)]
struct Split {
    s: f64,
    joint: usize,
}

/// Builds the adjustment network of the strokes that are left.
pub(super) struct NetworkBuilder<'a> {
    /// Lines and arcs of lanes, trimmed.
    pub strokes: &'a LaneStrokes,
    /// Clusters of their ends.
    pub joints: &'a Joints,
    /// Entities of the drawing, for messages.
    pub entities: &'a [Entity],
}

impl NetworkBuilder<'_> {
    /// Builds the network and reports free ends that should be joined.
    pub(super) fn build(&self, diagnostics: &mut Diagnostics) -> AdjustmentNetwork {
        let mut splits: BTreeMap<usize, Vec<Split>> = BTreeMap::new();
        for joint in 0..self.joints.all.len() {
            for (stroke, s) in self.branchings(joint, diagnostics) {
                splits.entry(stroke).or_default().push(Split { s, joint });
            }
        }
        let nodes: Vec<JointNode> = (0..self.joints.all.len())
            .map(|joint| JointNode {
                at: self.joints.centre(self.strokes, joint),
                tangent_rad: self.tangent(joint),
            })
            .collect();
        let mut members = Vec::new();
        let mut of_stroke = BTreeMap::new();
        for (index, _) in self.strokes.kept() {
            let mut here = splits.remove(&index).unwrap_or_default();
            here.sort_by(|a, b| a.s.total_cmp(&b.s));
            let first = members.len();
            self.split(index, &here, &nodes, &mut members);
            of_stroke.insert(index, (first..members.len()).collect());
        }
        AdjustmentNetwork { adjustment: Adjustment::new(nodes, members), members: of_stroke }
    }

    /// The mean heading of a joint towards the side of its first end, from the ends with the least heading
    /// error.
    fn tangent(&self, joint: usize) -> f64 {
        let joint = &self.joints.all[joint];
        let mut sum = DVec2::ZERO;
        for (&end, &with_first) in joint.ends.iter().zip(&joint.with_first) {
            let error = self.strokes.heading_error_of_end(end).max(1e-4);
            let leaving = super::unit(self.strokes.leaving(end));
            sum += leaving * (if with_first { 1.0 } else { -1.0 } / (error * error));
        }
        city3d_geometry::trig::atan2(sum.y, sum.x)
    }

    fn split(&self, index: usize, splits: &[Split], nodes: &[JointNode], members: &mut Vec<NetworkEdge>) {
        let rest = &self.strokes.all[index].rest;
        let against_at_end = |end: StrokeEnd| {
            let joint = self.joints.joint(end);
            let with = joint.ends.iter().position(|&e| e == end).is_none_or(|k| joint.with_first[k]);
            with != end.is_multiple_of(2)
        };
        let (start, end) = (2 * index, 2 * index + 1);
        let mut from = (0.0, self.joints.of_end[&start], against_at_end(start), true);
        let between = splits.iter().map(|split| {
            let heading = rest.pose_at(split.s).yaw_rad;
            let against = wrap_angle(heading - nodes[split.joint].tangent_rad).abs() > FRAC_PI_2;
            (split.s, split.joint, against, false)
        });
        let last = (rest.length, self.joints.of_end[&end], against_at_end(end), true);
        for (number, to) in between.chain([last]).enumerate() {
            members.push(NetworkEdge {
                nodes: [from.1, to.1],
                against: [from.2, to.2],
                drawn: Segment::new(rest.pose_at(from.0), to.0 - from.0, rest.curvature),
                anchored: [from.3, to.3],
                same_circle_as: (number > 0 && rest.curvature != 0.0).then(|| members.len() - 1),
            });
            from = to;
        }
    }

    /// The strokes that a joint splits.
    fn branchings(&self, joint: usize, diagnostics: &mut Diagnostics) -> Vec<(usize, f64)> {
        let at = self.joints.centre(self.strokes, joint);
        let ends = &self.joints.all[joint].ends;
        let through = self.joints.all[joint].is_through();
        // If lanes continue in measured ends, an exactly near stroke is a coincidence.
        let measured = ends.iter().any(|&end| self.strokes.position(end).distance(at) > SILENT_JOIN_M);
        if through && measured {
            return Vec::new();
        }
        let mut exact = Vec::new();
        // Distance, stroke, place on it.
        let mut near: Option<(f64, usize, f64)> = None;
        for (index, stroke) in self.strokes.kept() {
            if ends.iter().any(|end| end / 2 == index) {
                continue;
            }
            let foot = stroke.rest.project(at);
            let inside = (self.strokes.tolerance_m.min(1e-3)..stroke.rest.length).contains(&foot.s)
                && foot.s < stroke.rest.length - self.strokes.tolerance_m.min(1e-3);
            if foot.distance > self.strokes.tolerance_m || !inside {
                continue;
            }
            let heading = stroke.rest.pose_at(foot.s).yaw_rad;
            let turn = |end: StrokeEnd| turn_of(heading, self.strokes.leaving(end));
            if ends.iter().any(|&end| is_exact(foot.distance, turn(end))) {
                exact.push((index, foot.s));
            } else if !through
                && ends.iter().all(|&end| turn(end) <= self.strokes.angle_tolerance(index, end / 2))
                && near.is_none_or(|(least, ..)| foot.distance < least)
            {
                near = Some((foot.distance, index, foot.s));
            }
        }
        if through || !exact.is_empty() {
            return exact;
        }
        if let Some(other) = self.gap(joint) {
            self.report_gap(ends[0], other, diagnostics);
            return Vec::new();
        }
        if let Some((_, index, s)) = near {
            return vec![(index, s)];
        }
        if let Some(other) = self.kink(joint) {
            self.report_kink(ends[0], other, diagnostics);
        }
        Vec::new()
    }

    /// The nearest end beyond the tolerance that continues from a free joint.
    fn gap(&self, joint: usize) -> Option<StrokeEnd> {
        let at = self.joints.centre(self.strokes, joint);
        let this = &self.joints.all[joint];
        let lined_up = |other: StrokeEnd| {
            this.ends.iter().any(|&end| {
                let off = self.strokes.kink(end, other);
                let free = self.joints.is_free(other);
                let ahead = (self.strokes.position(other) - at).dot(-super::unit(self.strokes.leaving(end)));
                let short = other / 2 == end / 2 && self.strokes.of_end(end).rest.length <= 2.0 * REACH_M;
                ahead >= -self.strokes.tolerance_m
                    && !short
                    && off <= if free { FREE_GAP_ANGLE_RAD } else { GAP_ANGLE_RAD }
                    && self.strokes.directions_allow(end, other, Tangency::Through)
            })
        };
        let distance = |end: StrokeEnd| self.strokes.position(end).distance(at);
        self.strokes
            .ends()
            .filter(|&end| self.joints.of_end[&end] != joint && distance(end) <= REACH_M && lined_up(end))
            .min_by(|&a, &b| distance(a).total_cmp(&distance(b)).then(a.cmp(&b)))
    }

    /// A free end within the tolerance, but at an angle.
    fn kink(&self, joint: usize) -> Option<StrokeEnd> {
        let at = self.joints.centre(self.strokes, joint);
        self.strokes.ends().find(|&end| {
            self.joints.of_end[&end] != joint
                && self.joints.is_free(end)
                && self.strokes.position(end).distance(at) <= self.strokes.tolerance_m
        })
    }

    fn report_gap(&self, end: StrokeEnd, other: StrokeEnd, diagnostics: &mut Diagnostics) {
        let apart_m = self.strokes.position(end).distance(self.strokes.position(other));
        // Two free ends have one gap between them.
        if self.joints.is_free(other) && other < end {
            return;
        }
        let [entity, to] = [end, other].map(|end| &self.entities[self.strokes.of_end(end).entity]);
        let message = format!(
            "gap of {:.1} mm at {} between {} and {}, beyond the tolerance of {:.1} mm",
            apart_m * 1e3,
            place(self.strokes.position(end)),
            named(entity),
            named(to),
            self.strokes.tolerance_m * 1e3
        );
        diagnostics.error(MapErrorKind::Gap, entity, message, "move the ends together");
    }

    fn report_kink(&self, end: StrokeEnd, other: StrokeEnd, diagnostics: &mut Diagnostics) {
        if other < end {
            return;
        }
        let [entity, to] = [end, other].map(|end| &self.entities[self.strokes.of_end(end).entity]);
        let message = format!(
            "kink of {:.1} degrees at {} between {} and {}, more than the tolerance of {:.1} mm explains",
            self.strokes.kink(end, other).to_degrees(),
            place(self.strokes.position(end)),
            named(entity),
            named(to),
            self.strokes.tolerance_m * 1e3
        );
        diagnostics.error(MapErrorKind::Kink, entity, message, "join them by an arc tangent to both");
    }
}
