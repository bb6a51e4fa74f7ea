//! Converts the entities of the lane layers to straight and circular pieces.

use super::{
    EntitiesByLayer, JOIN_TOLERANCE_M, MAX_COORDINATE_M, MAX_LANES_LENGTH_M, MAX_PIECES, in_map, lane_kind,
};
use crate::LaneKind;
use crate::dxf::{Drawing, Entity, EntityShape, PolyVertex};
use crate::error::{Diagnostics, MapErrorKind};
use city3d_geometry::lab::{Pose2, Segment};
use city3d_geometry::{trig, wrap_angle};
use glam::DVec2;

/// Arcs of larger radii lose precision; the author meant a straight line.
const MAX_RADIUS_M: f64 = 1e6;

/// A straight or circular part of a lane, as drawn.
#[derive(Clone, Debug)]
pub(crate) struct LanePiece {
    /// Index in the drawing.
    pub entity: usize,
    /// Follows from the layer of the entity.
    pub kind: LaneKind,
    /// Laboratory metres; an ARC runs counter-clockwise.
    pub segment: Segment,
    /// Whether the drawing gives it a direction of travel, which then is the segment's.
    pub directed: bool,
}

/// A LINE on an arrow or stop-line layer.
#[derive(Clone, Copy, Debug)]
pub(super) struct DrawnLine<'a> {
    /// Its LINE or straight LWPOLYLINE, for messages.
    pub entity: &'a Entity,
    /// Start as drawn, laboratory metres.
    pub from: DVec2,
    /// End as drawn, laboratory metres.
    pub to: DVec2,
}

/// The pieces of all lanes, by entity and along it.
pub(crate) fn build(drawing: &Drawing, metres: f64, diagnostics: &mut Diagnostics) -> Vec<LanePiece> {
    let mut pieces = Vec::new();
    let mut any = false;
    for (index, entity) in drawing.entities.iter().enumerate() {
        let Some(kind) = lane_kind(&entity.layer) else { continue };
        any = true;
        let (segments, directed) = match (segments_of(&entity.shape, metres), &entity.shape) {
            (Some(found), _) => found,
            (None, EntityShape::Circle { .. }) => {
                let message = "a CIRCLE has no place where a lane could start".to_owned();
                diagnostics.error(MapErrorKind::Unsupported, entity, message, "draw the ring as two ARCs");
                continue;
            }
            (None, _) => {
                diagnostics
                    .note(entity, format!("text ignored: names belong on layer {}", super::layers::NAMES));
                continue;
            }
        };
        if segments.is_empty() {
            let message = "a polyline of fewer than two vertices".to_owned();
            diagnostics.error(MapErrorKind::Degenerate, entity, message, "delete it");
        }
        for segment in segments {
            if check(&segment, entity, diagnostics) {
                pieces.push(LanePiece { entity: index, kind, segment, directed });
            }
        }
        if pieces.len() > MAX_PIECES {
            let message = format!("more than {MAX_PIECES} lines and arcs of lanes");
            diagnostics.error(MapErrorKind::Size, entity, message, "split the map");
            return Vec::new();
        }
    }
    if !any {
        let message = "the drawing has no lanes".to_owned();
        let remedy = "draw centre lines of lanes on layer LANES";
        diagnostics.error_at(MapErrorKind::Size, 1, String::new(), message, remedy);
    }
    let length: f64 = pieces.iter().map(|piece: &LanePiece| piece.segment.length).sum();
    if length > MAX_LANES_LENGTH_M {
        let message = format!("{length:.0} m of lanes, more than {MAX_LANES_LENGTH_M} laboratory metres");
        let remedy = "check $INSUNITS: the map is drawn at laboratory scale";
        diagnostics.error_at(MapErrorKind::Size, 1, String::new(), message, remedy);
    }
    pieces
}

/// The segments of an entity in metres, and whether it gives them a direction of travel; `None` of a
/// circle and a text.
pub(crate) fn segments_of(shape: &EntityShape, metres: f64) -> Option<(Vec<Segment>, bool)> {
    match shape {
        EntityShape::Line { from, to } => Some((vec![Segment::line(*from * metres, *to * metres)], true)),
        EntityShape::Arc { centre, radius, from_deg, to_deg } => {
            Some((vec![arc(*centre * metres, radius * metres, *from_deg, *to_deg)], false))
        }
        EntityShape::Polyline { vertices, closed } => {
            Some((polyline_segments(vertices, *closed, metres), true))
        }
        EntityShape::Circle { .. } | EntityShape::Text { .. } => None,
    }
}

/// An arc that runs counter-clockwise between two angles; no sweep at all where they are equal.
pub(super) fn arc(centre: DVec2, radius: f64, from_deg: f64, to_deg: f64) -> Segment {
    let sweep_deg = libm::fmod(libm::fmod(to_deg - from_deg, 360.0) + 360.0, 360.0);
    Segment::arc(centre, radius, libm::fmod(from_deg, 360.0).to_radians(), sweep_deg.to_radians())
}

/// The pieces of a polyline. A bulge is the tangent of a quarter of the swept angle, so that with
/// chord c the radius is c (1 + b^2) / (4 b) and the arc leaves its chord by half the swept angle.
pub(super) fn polyline_segments(vertices: &[PolyVertex], closed: bool, metres: f64) -> Vec<Segment> {
    let mut segments = Vec::new();
    let count = if closed { vertices.len() } else { vertices.len().saturating_sub(1) };
    for (k, vertex) in vertices.iter().enumerate().take(count) {
        let next = vertices[(k + 1) % vertices.len()].at * metres;
        let line = Segment::line(vertex.at * metres, next);
        let half_sweep = 2.0 * trig::atan(vertex.bulge);
        let curvature = 4.0 * vertex.bulge / (line.length * (1.0 + vertex.bulge * vertex.bulge));
        // Bulges within rounding noise are straight, and a vertex that is repeated has no curvature.
        if line.length == 0.0 || curvature.abs() * MAX_RADIUS_M < 1.0 {
            segments.push(line);
            continue;
        }
        let start = Pose2::at(line.start.position, wrap_angle(line.start.yaw_rad - half_sweep));
        segments.push(Segment::new(start, 2.0 * half_sweep / curvature, curvature));
    }
    segments
}

/// Checks that a piece of a lane lies on the map and is no arc that is practically straight. Farther away, and with larger
/// radii, computations are not finite.
pub(crate) fn check_extent(segment: &Segment, entity: &Entity, diagnostics: &mut Diagnostics) -> bool {
    let end = segment.end();
    let finite = segment.length.is_finite() && segment.curvature.is_finite() && end.is_finite();
    let inside = in_map(segment.start.position) && in_map(end.position);
    if !finite || !inside || segment.length > MAX_COORDINATE_M {
        let message = format!("it reaches farther than {MAX_COORDINATE_M} laboratory metres from the origin");
        let remedy = "check its coordinates and $INSUNITS: the map is drawn at laboratory scale";
        diagnostics.error(MapErrorKind::Number, entity, message, remedy);
        return false;
    }
    if segment.radius().is_some_and(|radius| radius > MAX_RADIUS_M) {
        let message = format!("the arc has a radius over {MAX_RADIUS_M:e} m: it is practically straight");
        diagnostics.error(MapErrorKind::Number, entity, message, "draw a LINE");
        return false;
    }
    true
}

/// Whether a piece has a length and lies within the permitted coordinates.
fn check(segment: &Segment, entity: &Entity, diagnostics: &mut Diagnostics) -> bool {
    if !check_extent(segment, entity, diagnostics) {
        return false;
    }
    if segment.length < JOIN_TOLERANCE_M {
        let message =
            format!("a length of {:.3} mm at {}", segment.length * 1e3, super::place(segment.end().position));
        let remedy = "delete it, or give it at least 1 mm (an ARC needs two different angles)";
        diagnostics.error(MapErrorKind::Degenerate, entity, message, remedy);
        return false;
    }
    true
}

/// The LINEs of a layer, in laboratory metres; also polylines of one straight piece.
pub(super) fn lines_of<'a>(
    by_layer: &EntitiesByLayer<'a>,
    layer: &str,
    metres: f64,
    diagnostics: &mut Diagnostics,
) -> Vec<DrawnLine<'a>> {
    let mut lines = Vec::new();
    for &entity in by_layer.get(layer).into_iter().flatten() {
        let ends = match &entity.shape {
            EntityShape::Line { from, to } => Some((*from, *to)),
            EntityShape::Polyline { vertices, closed: false }
                if vertices.len() == 2 && vertices[0].bulge == 0.0 =>
            {
                Some((vertices[0].at, vertices[1].at))
            }
            EntityShape::Text { .. } => {
                diagnostics.note(entity, format!("text on layer {layer} ignored"));
                continue;
            }
            _ => None,
        };
        match ends {
            None => {
                let message = format!("layer {layer} takes straight lines only");
                diagnostics.error(MapErrorKind::Unsupported, entity, message, "draw a LINE");
            }
            Some((from, to)) => {
                let (from, to) = (from * metres, to * metres);
                if check(&Segment::line(from, to), entity, diagnostics) {
                    lines.push(DrawnLine { entity, from, to });
                }
            }
        }
    }
    lines
}
