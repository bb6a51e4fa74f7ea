//! Strokes: the lines and arcs of lanes as drawn, trimmed step by step, with the uncertainty of their ends.

use crate::LaneKind;
pub(super) use crate::build::network::Tangency;
use crate::build::pieces::segments_of;
use crate::dxf::Entity;
use city3d_geometry::lab::Segment;
use city3d_geometry::{trig, wrap_angle};
use glam::DVec2;
use std::f64::consts::{FRAC_PI_6, PI};

/// An end of a stroke: twice its index, plus one for the end that the segment runs to.
pub(super) type StrokeEnd = usize;

/// Allowed heading difference at a joint besides what the position tolerance explains.
const BASE_ANGLE_RAD: f64 = 2.0 * PI / 180.0;

/// A line or an arc of a lane.
#[derive(Clone, Debug)]
pub(super) struct LaneStroke {
    /// Index in the drawing.
    pub entity: usize,
    /// Index among the segments of the entity: 0 except in polylines.
    pub part: usize,
    /// Follows from the layer of the entity.
    pub kind: LaneKind,
    /// Whether the drawing gives it a direction of travel.
    pub directed: bool,
    /// As drawn, laboratory metres.
    pub drawn: Segment,
    /// The rest after trimming.
    pub rest: Segment,
    /// Length trimmed off each end, metres.
    pub trimmed_m: [f64; 2],
    /// Whether it was removed because it lies along another stroke.
    pub dropped: bool,
}

/// All strokes of a drawing.
#[derive(Clone, Debug)]
pub(super) struct LaneStrokes {
    /// In the order of the file, dropped ones included.
    pub all: Vec<LaneStroke>,
    /// Largest displacement of an end, metres.
    pub tolerance_m: f64,
}

impl LaneStrokes {
    pub(super) fn of(entities: &[Entity], kinds: &[Option<LaneKind>], metres: f64, tolerance_m: f64) -> Self {
        let mut all = Vec::new();
        for (index, (entity, kind)) in entities.iter().zip(kinds).enumerate() {
            let Some(kind) = *kind else { continue };
            let Some((segments, directed)) = segments_of(&entity.shape, metres) else { continue };
            for (part, drawn) in segments.into_iter().enumerate() {
                all.push(LaneStroke {
                    entity: index,
                    part,
                    kind,
                    directed,
                    drawn,
                    rest: drawn,
                    trimmed_m: [0.0; 2],
                    dropped: false,
                });
            }
        }
        Self { all, tolerance_m }
    }

    /// The remaining strokes, by index.
    pub(super) fn kept(&self) -> impl Iterator<Item = (usize, &LaneStroke)> {
        self.all.iter().enumerate().filter(|(_, stroke)| !stroke.dropped)
    }

    /// The ends of the remaining strokes.
    pub(super) fn ends(&self) -> impl Iterator<Item = StrokeEnd> {
        self.kept().flat_map(|(index, _)| [2 * index, 2 * index + 1])
    }

    pub(super) fn of_end(&self, end: StrokeEnd) -> &LaneStroke {
        &self.all[end / 2]
    }

    pub(super) fn position(&self, end: StrokeEnd) -> DVec2 {
        let rest = &self.of_end(end).rest;
        if end.is_multiple_of(2) { rest.start.position } else { rest.end().position }
    }

    /// The heading that leaves the end into its stroke.
    pub(super) fn leaving(&self, end: StrokeEnd) -> f64 {
        let rest = &self.of_end(end).rest;
        if end.is_multiple_of(2) { rest.start.yaw_rad } else { wrap_angle(rest.end().yaw_rad + PI) }
    }

    /// Whether travel leaves through the end into its stroke; `None` if the drawing does not say.
    pub(super) fn goes_out(&self, end: StrokeEnd) -> Option<bool> {
        self.of_end(end).directed.then_some(end.is_multiple_of(2))
    }

    /// Heading uncertainty of a stroke whose ends are off by the tolerance: rotation of its chord, and for an
    /// arc the change of its sweep at fixed radius. A short stroke may even be reversed.
    fn heading_error(&self, stroke: usize) -> f64 {
        let rest = &self.all[stroke].rest;
        let chord = rest.start.position.distance(rest.end().position);
        let ratio = |length: f64| 1.5 * self.tolerance_m / length.max(1e-9);
        let of_chord = |length: f64| if ratio(length) < 1.0 { trig::asin(ratio(length)) } else { PI };
        let Some(radius) = rest.radius() else { return of_chord(chord) };
        let half_sweep = rest.length / radius / 2.0;
        let lever = radius * trig::cos(half_sweep).abs().max(0.05);
        // The chord of a nearly full ring is short, yet its direction is well known.
        let length = if chord > radius { chord } else { rest.length };
        of_chord(length) + (ratio(lever) / 2.0).min(FRAC_PI_6)
    }

    /// Allowed heading difference of two strokes where they meet.
    pub(super) fn angle_tolerance(&self, a: usize, b: usize) -> f64 {
        BASE_ANGLE_RAD + self.heading_error(a) + self.heading_error(b)
    }

    pub(super) fn heading_error_of_end(&self, end: StrokeEnd) -> f64 {
        self.heading_error(end / 2)
    }

    /// Whether a point may be within the tolerance of a stroke: a cheap bound before a projection.
    pub(super) fn reaches(&self, stroke: usize, point: DVec2) -> bool {
        let rest = &self.all[stroke].rest;
        let middle = rest.pose_at(rest.length / 2.0).position;
        middle.distance(point) <= rest.length / 2.0 + self.tolerance_m
    }

    /// Whether the directions of travel allow a relation of two ends.
    pub(super) fn directions_allow(&self, a: StrokeEnd, b: StrokeEnd, relation: Tangency) -> bool {
        match (self.goes_out(a), self.goes_out(b)) {
            (Some(a), Some(b)) => (a == b) == (relation == Tangency::Beside),
            _ => true,
        }
    }

    /// Deviation from straight on between one end and the other.
    pub(super) fn kink(&self, a: StrokeEnd, b: StrokeEnd) -> f64 {
        wrap_angle(self.leaving(a) - self.leaving(b) + PI).abs()
    }

    /// Takes a length off an end.
    pub(super) fn trim(&mut self, end: StrokeEnd, by_m: f64) {
        let stroke = &mut self.all[end / 2];
        let rest = stroke.rest;
        let start = if end.is_multiple_of(2) { rest.pose_at(by_m) } else { rest.start };
        stroke.rest = Segment::new(start, rest.length - by_m, rest.curvature);
        stroke.trimmed_m[end % 2] += by_m;
    }
}
