//! The result of a repair: new geometry of the entities, and every change by handle in millimetres.

use super::adjust::middle_error;
use super::joints::Joints;
use super::network::AdjustmentNetwork;
use super::overlaps::Cut;
use super::strokes::{LaneStroke, LaneStrokes, StrokeEnd, Tangency};
use super::{MapErrorKind, named, place};
use crate::dxf::{Entity, EntityEdit, EntityShape, PolyVertex};
use crate::error::Diagnostics;
use crate::layers;
use city3d_geometry::lab::{Pose2, Segment};
use city3d_geometry::{trig, wrap_angle};
use glam::DVec2;
use std::collections::{BTreeMap, VecDeque};
use std::f64::consts::{FRAC_1_SQRT_2, FRAC_PI_2, PI};
use std::fmt;

/// Smaller displacements leave the entity unchanged, to the last digit.
const UNMOVED_M: f64 = 1e-7;
/// Distance from the lane end at which a line that was there is put.
const BEFORE_END_M: f64 = 1e-3;

/// One change of an entity.
#[derive(Clone, Debug, PartialEq)]
pub struct RepairChange {
    /// Line of the file.
    pub line: usize,
    /// Kind and handle: "ARC 2F".
    pub entity: String,
    /// What the repair did to the entity.
    pub action: RepairAction,
}

/// The kind of a change. Lengths in laboratory metres.
#[derive(Clone, Debug, PartialEq)]
pub enum RepairAction {
    /// The ends of a line or an arc were moved, each by this much; the radius of an arc may have changed.
    Moved {
        /// Displacement of the start, laboratory metres.
        start_m: f64,
        /// Displacement of the end, laboratory metres.
        end_m: f64,
        /// Radius of an arc before and after, laboratory metres; none for a line.
        radius_m: Option<[f64; 2]>,
    },
    /// Vertices of a polyline were moved, by at most this much; bulges may have changed.
    Vertices {
        /// Number of vertices that were moved.
        count: usize,
        /// Largest displacement of a vertex, laboratory metres.
        most_m: f64,
    },
    /// An end was trimmed because it ran along another entity.
    Trimmed {
        /// Whether the start was trimmed, rather than the end.
        at_start: bool,
        /// Length that was cut off, laboratory metres.
        by_m: f64,
        /// The entity along which that length lay: kind, handle and line of the file.
        along: String,
    },
    /// Deleted because it duplicates another entity.
    Deleted {
        /// Length of what was deleted, laboratory metres.
        length_m: f64,
        /// The entity that it duplicates: kind, handle and line of the file.
        along: String,
    },
    /// Deleted, because it is too short to be a lane.
    TooShort {
        /// Its length as drawn, laboratory metres.
        length_m: f64,
    },
    /// A stop or yield line was moved back to the end of its lane.
    LineMoved {
        /// Displacement of the line, laboratory metres.
        by_m: f64,
    },
}

impl RepairChange {
    pub(super) fn of(entity: &Entity, action: RepairAction) -> Self {
        Self { line: entity.line, entity: entity.label(), action }
    }

    pub(super) fn deleted_degenerate(&self) -> Option<EntityEdit> {
        matches!(self.action, RepairAction::TooShort { .. })
            .then(|| EntityEdit { line: self.line, shapes: Vec::new() })
    }
}

impl fmt::Display for RepairChange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "line {}, {}: ", self.line, self.entity)?;
        let mm = |metres: f64| metres * 1e3;
        match &self.action {
            RepairAction::Moved { start_m, end_m, radius_m } => {
                write!(f, "start moved by {:.3} mm, end by {:.3} mm", mm(*start_m), mm(*end_m))?;
                match radius_m {
                    Some([old, new]) => write!(f, ", radius {:.3} to {:.3} mm", mm(*old), mm(*new)),
                    None => Ok(()),
                }
            }
            RepairAction::Vertices { count, most_m } => {
                write!(f, "{count} vertices moved, by at most {:.3} mm", mm(*most_m))
            }
            RepairAction::Trimmed { at_start, by_m, along } => {
                let end = if *at_start { "start" } else { "end" };
                write!(f, "{end} trimmed by {:.3} mm, which lay along {along}", mm(*by_m))
            }
            RepairAction::Deleted { length_m, along } => {
                write!(f, "deleted, its {:.3} mm lie along {along}", mm(*length_m))
            }
            RepairAction::TooShort { length_m } => {
                write!(f, "deleted, a piece of {:.3} mm is too short for a lane", mm(*length_m))
            }
            RepairAction::LineMoved { by_m } => {
                write!(f, "moved by {:.3} mm with the end of its lane", mm(*by_m))
            }
        }
    }
}

/// An adjusted network with the strokes and entities that it came from.
pub(super) struct RepairOutcome<'a> {
    /// Lines and arcs of lanes, trimmed.
    pub strokes: &'a LaneStrokes,
    /// The network after its solution.
    pub network: &'a AdjustmentNetwork,
    /// Entities of the drawing as read.
    pub entities: &'a [Entity],
    /// Metres per drawing unit.
    pub metres: f64,
}

impl RepairOutcome<'_> {
    /// The adjusted stroke; as drawn if it has not moved.
    fn adjusted(&self, index: usize) -> Segment {
        let rest = self.strokes.all[index].rest;
        let new = self.network.adjustment.segment(&self.network.members[&index]);
        let moved = displacement(&rest, &new).into_iter().fold(0.0, f64::max);
        if moved < UNMOVED_M { rest } else { new }
    }

    /// Reports ends, and middles of arcs, that would have to move farther than the tolerance.
    pub(super) fn check(&self, diagnostics: &mut Diagnostics) {
        let tolerance_m = self.strokes.tolerance_m;
        for (index, stroke) in self.strokes.kept() {
            let moved = displacement(&stroke.rest, &self.adjusted(index));
            let middle_m = moved[1] / middle_error(&stroke.rest);
            let (at, by_m) = [(0.0, moved[0]), (0.5, middle_m), (1.0, moved[2])]
                .into_iter()
                .max_by(|a, b| a.1.total_cmp(&b.1))
                .unwrap_or_default();
            if by_m <= tolerance_m {
                continue;
            }
            let entity = &self.entities[stroke.entity];
            let message = format!(
                "at {} it would have to move by {:.1} mm to be tangent to its neighbours, beyond the tolerance \
                 of {:.1} mm",
                place(stroke.rest.pose_at(at * stroke.rest.length).position),
                by_m * 1e3,
                tolerance_m * 1e3
            );
            let remedy = "draw the joint anew: join its pieces by an arc tangent to both";
            diagnostics.error(MapErrorKind::Kink, entity, message, remedy);
        }
    }

    /// Strokes by lane entity, in order along it.
    fn by_entity(&self) -> BTreeMap<usize, Vec<usize>> {
        let mut by_entity: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        for (index, stroke) in self.strokes.all.iter().enumerate() {
            by_entity.entry(stroke.entity).or_default().push(index);
        }
        by_entity
    }

    fn is_changed(&self, stroke: &LaneStroke, index: usize) -> bool {
        stroke.dropped || stroke.drawn != self.adjusted(index)
    }

    /// The geometry of the entities that have changed.
    pub(super) fn edits(&self) -> Vec<EntityEdit> {
        let mut edits = Vec::new();
        for (entity, strokes) in self.by_entity() {
            if !strokes.iter().any(|&index| self.is_changed(&self.strokes.all[index], index)) {
                continue;
            }
            let entity = &self.entities[entity];
            let shapes = match &entity.shape {
                EntityShape::Polyline { closed, .. } => self.polylines(&strokes, *closed),
                shape => {
                    let kept = strokes.iter().filter(|&&index| !self.strokes.all[index].dropped);
                    kept.map(|&index| self.shape(shape, index)).collect()
                }
            };
            edits.push(EntityEdit { line: entity.line, shapes });
        }
        edits
    }

    fn shape(&self, drawn: &EntityShape, index: usize) -> EntityShape {
        let segment = self.adjusted(index);
        match (drawn, segment.centre(), segment.radius()) {
            (EntityShape::Arc { .. }, Some(centre), Some(radius)) => {
                // An ARC runs counter-clockwise.
                let (from, to) = (segment.start.yaw_rad, segment.start.yaw_rad + segment.length / radius);
                EntityShape::Arc {
                    centre: centre / self.metres,
                    radius: radius / self.metres,
                    from_deg: degrees(from - FRAC_PI_2),
                    to_deg: degrees(to - FRAC_PI_2),
                }
            }
            _ => EntityShape::Line {
                from: segment.start.position / self.metres,
                to: segment.end().position / self.metres,
            },
        }
    }

    /// A polyline, or several if strokes in its middle were dropped.
    fn polylines(&self, strokes: &[usize], closed: bool) -> Vec<EntityShape> {
        let whole = strokes.iter().all(|&index| !self.strokes.all[index].dropped);
        let mut runs: Vec<Vec<usize>> = strokes
            .split(|&index| self.strokes.all[index].dropped)
            .filter(|run| !run.is_empty())
            .map(<[usize]>::to_vec)
            .collect();
        let wraps = |runs: &[Vec<usize>]| {
            let ends = [strokes.first(), strokes.last()];
            runs.len() > 1 && ends.iter().flatten().all(|&&index| !self.strokes.all[index].dropped)
        };
        if closed && !whole && wraps(&runs) {
            let first = runs.remove(0);
            if let Some(last) = runs.last_mut() {
                last.extend(first);
            }
        }
        let closed = closed && whole;
        runs.iter().map(|run| self.polyline(run, closed)).collect()
    }

    fn polyline(&self, run: &[usize], closed: bool) -> EntityShape {
        let mut vertices = Vec::with_capacity(run.len() + 1);
        for &index in run {
            let segment = self.adjusted(index);
            let bulge = trig::tan(segment.length * segment.curvature / 4.0);
            vertices.push(PolyVertex { at: segment.start.position / self.metres, bulge });
        }
        if let Some(&last) = run.last().filter(|_| !closed) {
            let at = self.adjusted(last).end().position / self.metres;
            vertices.push(PolyVertex { at, bulge: 0.0 });
        }
        EntityShape::Polyline { vertices, closed }
    }

    /// Every change of a lane.
    pub(super) fn report(&self, cuts: &[Cut], changes: &mut Vec<RepairChange>) {
        let name = |stroke: usize| named(&self.entities[self.strokes.all[stroke].entity]);
        for &cut in cuts {
            let (stroke, action) = match cut {
                Cut::Dropped { stroke, along } => {
                    let length_m = self.strokes.all[stroke].rest.length;
                    (stroke, RepairAction::Deleted { length_m, along: name(along) })
                }
                Cut::Trimmed { end, by_m, along } => {
                    let at_start = end.is_multiple_of(2);
                    (end / 2, RepairAction::Trimmed { at_start, by_m, along: name(along) })
                }
            };
            changes.push(RepairChange::of(&self.entities[self.strokes.all[stroke].entity], action));
        }
        for (entity, strokes) in self.by_entity() {
            let moved: Vec<(usize, [f64; 3])> = strokes
                .iter()
                .filter(|&&index| !self.strokes.all[index].dropped)
                .map(|&index| (index, displacement(&self.strokes.all[index].rest, &self.adjusted(index))))
                .filter(|(_, by)| by.iter().any(|&by_m| by_m >= UNMOVED_M))
                .collect();
            let entity = &self.entities[entity];
            match (moved.first(), &entity.shape) {
                (None, _) => {}
                (_, EntityShape::Polyline { closed, .. }) => {
                    changes.push(RepairChange::of(entity, vertices_moved(&moved, *closed, strokes.len())));
                }
                (Some(&(index, [start_m, _, end_m])), _) => {
                    let radii = [self.strokes.all[index].rest.radius(), self.adjusted(index).radius()];
                    let radius_m = match radii {
                        [Some(old), Some(new)] => Some([old, new]),
                        _ => None,
                    };
                    changes.push(RepairChange::of(entity, RepairAction::Moved { start_m, end_m, radius_m }));
                }
            }
        }
    }

    /// Moves stop, yield and signal lines at lane ends back if they would lie behind the end.
    pub(super) fn control_lines(&self, joints: &Joints, changes: &mut Vec<RepairChange>) -> Vec<EntityEdit> {
        let out = self.directions(joints);
        let mut edits = Vec::new();
        for entity in self.entities {
            let on_layer = |layer: &str| entity.layer.eq_ignore_ascii_case(layer);
            let EntityShape::Line { from, to } = entity.shape else { continue };
            let is_line =
                [layers::STOP_LINES, layers::YIELD_LINES, layers::SIGNALS].into_iter().any(on_layer);
            if !is_line {
                continue;
            }
            let drawn = [from * self.metres, to * self.metres];
            let Some(by) = joints.all.iter().find_map(|joint| self.behind_end(&joint.ends, &out, drawn))
            else {
                continue;
            };
            let [from, to] = drawn.map(|at| (at + by) / self.metres);
            edits.push(EntityEdit { line: entity.line, shapes: vec![EntityShape::Line { from, to }] });
            changes.push(RepairChange::of(entity, RepairAction::LineMoved { by_m: by.length() }));
        }
        edits
    }

    /// By end: whether travel leaves through it into its stroke, propagated from lines over joints to arcs.
    fn directions(&self, joints: &Joints) -> Vec<Option<bool>> {
        let mut out = vec![None; 2 * self.strokes.all.len()];
        let mut queue: VecDeque<StrokeEnd> = VecDeque::new();
        for end in self.strokes.ends() {
            out[end] = self.strokes.goes_out(end);
            queue.extend(out[end].map(|_| end));
        }
        while let Some(end) = queue.pop_front() {
            let Some(goes_out) = out[end] else { continue };
            let beside = |other: StrokeEnd| joints.relation(end, other) == Some(Tangency::Beside);
            let mut found = vec![(end ^ 1, !goes_out)];
            found.extend(joints.joint(end).ends.iter().map(|&other| (other, goes_out == beside(other))));
            for (other, goes_out) in found {
                if out[other].is_none() {
                    out[other] = Some(goes_out);
                    queue.push_back(other);
                }
            }
        }
        out
    }

    /// The displacement that puts a line just before the end of the lanes that end here, if it crosses the
    /// continuation close behind it.
    fn behind_end(&self, ends: &[StrokeEnd], out: &[Option<bool>], line: [DVec2; 2]) -> Option<DVec2> {
        let along = line[1] - line[0];
        let incoming = ends.iter().find(|&&end| out[end] == Some(false))?;
        let index = incoming / 2;
        let end = self.adjusted(index).end();
        let pose = if incoming.is_multiple_of(2) { reversed(self.adjusted(index).start) } else { end };
        let square = pose.forward().perp_dot(along.try_normalize()?).abs();
        if square < FRAC_1_SQRT_2 {
            return None;
        }
        // The crossing of the line with the tangent.
        let behind = (line[0] - pose.position).perp_dot(along) / pose.forward().perp_dot(along);
        let at = (pose.position + pose.forward() * behind - line[0]).dot(along) / along.length_squared();
        // Only as far behind as the ends were off.
        let off = |end: &StrokeEnd| self.strokes.position(*end).distance(pose.position);
        let most = ends.iter().map(off).fold(0.0, f64::max);
        let stands_there = (0.0..=1.0).contains(&at) && (-BEFORE_END_M / 2.0..=most).contains(&behind);
        (stands_there && most >= UNMOVED_M).then(|| pose.forward() * -(behind + BEFORE_END_M))
    }
}

fn reversed(pose: Pose2) -> Pose2 {
    Pose2::at(pose.position, wrap_angle(pose.yaw_rad + PI))
}

/// Displacements of start, middle and end of a segment. The middle of a line moves with its ends.
fn displacement(old: &Segment, new: &Segment) -> [f64; 3] {
    let at = |segment: &Segment, share: f64| segment.pose_at(segment.length * share).position;
    [0.0, 0.5, 1.0].map(|share| at(old, share).distance(at(new, share)))
}

fn vertices_moved(moved: &[(usize, [f64; 3])], closed: bool, segments: usize) -> RepairAction {
    let starts = moved.iter().filter(|(_, by)| by[0] >= UNMOVED_M).count();
    let last = moved.last().is_some_and(|(_, by)| by[2] >= UNMOVED_M) && !closed && moved.len() == segments;
    let most_m = moved.iter().flat_map(|(_, by)| [by[0], by[2]]).fold(0.0, f64::max);
    RepairAction::Vertices { count: starts + usize::from(last), most_m }
}

fn degrees(angle_rad: f64) -> f64 {
    let degrees = libm::fmod(angle_rad.to_degrees(), 360.0);
    if degrees < 0.0 { degrees + 360.0 } else { degrees }
}
