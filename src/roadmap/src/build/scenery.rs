//! Builds scenery: footprints with their names and heights.

use super::labels::shorten;
use super::{EntitiesByLayer, MAX_COORDINATE_M, REACH_M, in_map, pieces, place};
use crate::dxf::{Entity, EntityShape as Drawn};
use crate::error::{Diagnostics, MapErrorKind};
use crate::{Footprint, PlacedModel, Scenery, SceneryKind, layers};
use city3d_geometry::lab::Segment;
use city3d_geometry::{point_in_polygon, trig};
use glam::DVec2;
use std::f64::consts::PI;

/// Largest distance between an arc of an outline and its chords; large arcs turn by at most 3 degrees per
/// chord.
const FLATTENING_M: f64 = 1e-3;
/// Most corners of all scenery.
const MAX_POINTS: usize = 100_000;
const FINEST_CHORD_RAD: f64 = PI / 60.0;

/// All scenery, ordered by kind, then as in the file.
pub(super) fn build(by_layer: &EntitiesByLayer, metres: f64, diagnostics: &mut Diagnostics) -> Vec<Scenery> {
    let mut all = Vec::new();
    let mut points = 0;
    for kind in SceneryKind::ALL {
        let Some(entities) = by_layer.get(kind.layer()) else { continue };
        let mut pieces = Vec::new();
        for &entity in entities {
            if matches!(entity.shape, Drawn::Text { .. }) {
                continue;
            }
            if let Some(shape) = shape(entity, kind, metres, diagnostics) {
                points += match &shape {
                    Footprint::Polygon(points) | Footprint::Polyline(points) => points.len(),
                    Footprint::Circle { .. } => 1,
                };
                if points > MAX_POINTS {
                    let message = format!("scenery of more than {MAX_POINTS} points");
                    diagnostics.error(MapErrorKind::Size, entity, message, "draw plainer outlines");
                    return all;
                }
                pieces.push(Scenery { kind, name: String::new(), height_m: None, front_rad: None, shape });
            }
        }
        for &entity in entities {
            if let Drawn::Text { at, text, .. } = &entity.shape {
                label(&mut pieces, entity, (*at * metres, text), metres, diagnostics);
            }
        }
        all.extend(pieces);
    }
    all
}

/// Models that texts on their layer name: "shed.glb", or "shed.glb turn=90 scale=1.2".
pub(super) fn models(
    by_layer: &EntitiesByLayer,
    metres: f64,
    diagnostics: &mut Diagnostics,
) -> Vec<PlacedModel> {
    let mut placed = Vec::new();
    for &entity in by_layer.get(layers::MODELS).into_iter().flatten() {
        let Drawn::Text { at, text, .. } = &entity.shape else {
            diagnostics.note(entity, format!("layer {} takes texts only: ignored", layers::MODELS));
            continue;
        };
        let at = *at * metres;
        if !in_map(at) {
            far(entity, diagnostics);
            continue;
        }
        let (rest, size) = trailing(text, "scale=");
        let (file, turn) = trailing(rest, "turn=");
        let number =
            |key: &str, text: Option<&str>, usual: f64, range: std::ops::RangeInclusive<f64>| match text {
                None => Ok(usual),
                Some(text) => match text.trim().parse::<f64>() {
                    Ok(value) if range.contains(&value) => Ok(value),
                    _ => Err(format!(
                        "\"{key}{}\" is not a number from {} to {}",
                        shorten(text),
                        range.start(),
                        range.end()
                    )),
                },
            };
        let turn = number("turn=", turn, 0.0, -360.0..=360.0);
        let size = number("scale=", size, 1.0, 0.001..=1000.0);
        let is_file = file.to_ascii_lowercase().ends_with(".glb") && !file.chars().any(char::is_control);
        match (turn, size) {
            (Ok(turn_deg), Ok(size)) if is_file => placed.push(PlacedModel {
                file: file.to_owned(),
                at,
                front_rad: turn_deg.to_radians(),
                size,
                line: entity.line,
            }),
            (turn, size) => {
                let message = turn
                    .err()
                    .or(size.err())
                    .unwrap_or_else(|| format!("\"{}\" is not the name of a model", shorten(text)));
                let remedy = "write the name of a .glb file, then turn in degrees and scale if need be, such as \"shed.glb turn=90 scale=1.2\"";
                diagnostics.error(MapErrorKind::Text, entity, message, remedy);
            }
        }
    }
    placed
}

/// The remedy for an unknown scenery layer.
pub(super) fn kinds_remedy() -> String {
    let layers: Vec<&str> = SceneryKind::ALL.iter().map(|kind| kind.layer()).collect();
    format!("use one of {}", layers.join(", "))
}

fn shape(
    entity: &Entity,
    kind: SceneryKind,
    metres: f64,
    diagnostics: &mut Diagnostics,
) -> Option<Footprint> {
    let (points, closed) = match &entity.shape {
        Drawn::Circle { centre, radius } => {
            let (centre, radius_m) = (*centre * metres, radius * metres);
            if !in_map(centre + radius_m) || !in_map(centre - radius_m) {
                far(entity, diagnostics);
                return None;
            }
            return Some(Footprint::Circle { centre, radius_m });
        }
        Drawn::Line { from, to } => (vec![*from * metres, *to * metres], false),
        Drawn::Arc { centre, radius, from_deg, to_deg } => {
            (flatten(&[pieces::arc(*centre * metres, radius * metres, *from_deg, *to_deg)], false), false)
        }
        Drawn::Polyline { vertices, closed } => {
            let points = flatten(&pieces::polyline_segments(vertices, *closed, metres), *closed);
            let returns = points.len() > 3 && points[0].distance(points[points.len() - 1]) < FLATTENING_M;
            (points, *closed || returns)
        }
        Drawn::Text { .. } => return None,
    };
    if !points.iter().all(|&p| in_map(p)) {
        far(entity, diagnostics);
        return None;
    }
    outline(points, closed, entity, kind, diagnostics)
}

fn outline(
    mut points: Vec<DVec2>,
    closed: bool,
    entity: &Entity,
    kind: SceneryKind,
    diagnostics: &mut Diagnostics,
) -> Option<Footprint> {
    points.dedup_by(|a, b| a.distance(*b) < 1e-9);
    if closed {
        while points.len() > 1 && points[0].distance(points[points.len() - 1]) < FLATTENING_M {
            points.pop();
        }
        if points.len() < 3 || area(&points).abs() < 1e-8 {
            let message = "the outline has no area".to_owned();
            diagnostics.error(
                MapErrorKind::Degenerate,
                entity,
                message,
                "draw three corners or more, or delete it",
            );
            return None;
        }
        return Some(Footprint::Polygon(points));
    }
    if !matches!(kind, SceneryKind::Wall | SceneryKind::Hedge) {
        let message = format!("an open line on layer {}", kind.layer());
        let remedy = "close the polyline, or draw a CIRCLE; only walls and hedges may be open";
        diagnostics.error(MapErrorKind::Unsupported, entity, message, remedy);
        return None;
    }
    if points.len() < 2 {
        diagnostics.error(MapErrorKind::Degenerate, entity, "a line without length".to_owned(), "delete it");
        return None;
    }
    Some(Footprint::Polyline(points))
}

fn far(entity: &Entity, diagnostics: &mut Diagnostics) {
    let message = format!("it reaches farther than {MAX_COORDINATE_M} laboratory metres from the origin");
    let remedy = "check its coordinates and $INSUNITS: the map is drawn at laboratory scale";
    diagnostics.error(MapErrorKind::Number, entity, message, remedy);
}

/// Flattens lines and arcs to points; closed outlines do not repeat the first point.
fn flatten(segments: &[Segment], closed: bool) -> Vec<DVec2> {
    let mut points = Vec::new();
    for segment in segments {
        let sweep = (segment.length * segment.curvature).abs();
        let chord = segment.radius().map_or(f64::INFINITY, |radius| {
            let angle = 2.0 * trig::acos((1.0 - FLATTENING_M / radius).clamp(-1.0, 1.0));
            angle.max(FINEST_CHORD_RAD)
        });
        let pieces = (sweep / chord).ceil().clamp(1.0, 2.0 * PI / FINEST_CHORD_RAD) as usize;
        for k in 0..pieces {
            points.push(segment.pose_at(segment.length * k as f64 / pieces as f64).position);
        }
    }
    if let Some(last) = segments.last().filter(|_| !closed) {
        points.push(last.end().position);
    }
    points
}

fn area(points: &[DVec2]) -> f64 {
    (0..points.len()).map(|k| points[k].perp_dot(points[(k + 1) % points.len()])).sum::<f64>() / 2.0
}

/// Gives the item under a text its name, with the height and the front side that may follow: "theatre h=0.4
/// front=N".
fn label(
    pieces: &mut [Scenery],
    entity: &Entity,
    (at, text): (DVec2, &str),
    metres: f64,
    diagnostics: &mut Diagnostics,
) {
    let smallest = pieces
        .iter()
        .enumerate()
        .filter_map(|(k, piece)| extent_under(&piece.shape, at).map(|extent| (extent, k)))
        .min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let Some((_, index)) = smallest else {
        let message =
            format!("the text \"{}\" at {} is not on a piece of its layer", shorten(text), place(at));
        let remedy = "put its insertion point inside the outline, or on the line, that it names";
        diagnostics.error(MapErrorKind::Stray, entity, message, remedy);
        return;
    };
    let piece = &mut pieces[index];
    if !piece.name.is_empty() || piece.height_m.is_some() {
        let message = format!("\"{}\" is on the same piece as \"{}\"", shorten(text), shorten(&piece.name));
        diagnostics.error(MapErrorKind::Name, entity, message, "delete one of the two texts");
        return;
    }
    let (text, front) = trailing(text, "front=");
    let (name, height) = trailing(text, "h=");
    piece.name = name.to_owned();
    if let Some(front) = front {
        const SIDES: [(&str, f64); 4] = [("E", 0.0), ("N", 0.5 * PI), ("W", PI), ("S", -0.5 * PI)];
        match SIDES.iter().find(|(letter, _)| front.trim().eq_ignore_ascii_case(letter)) {
            Some((_, angle)) => piece.front_rad = Some(*angle),
            None => {
                let message = format!("\"front={}\" is not a side", shorten(front));
                let remedy = "write one of front=N, front=E, front=S and front=W";
                diagnostics.error(MapErrorKind::Text, entity, message, remedy);
            }
        }
    }
    if let Some(height) = height {
        match height.trim().parse::<f64>() {
            Ok(value) if value > 0.0 && value * metres <= MAX_COORDINATE_M => {
                piece.height_m = Some(value * metres);
            }
            _ => {
                let message = format!("\"h={}\" is not a height", shorten(height));
                let remedy = "write a positive number in units of the drawing, such as \"h=0.3\"";
                diagnostics.error(MapErrorKind::Text, entity, message, remedy);
            }
        }
    }
}

/// Splits a text at a key into the text before it and the value after it.
fn trailing<'a>(text: &'a str, key: &str) -> (&'a str, Option<&'a str>) {
    match text.trim().rsplit_once(key) {
        Some((name, value)) if name.is_empty() || name.ends_with(' ') => (name.trim(), Some(value)),
        _ => (text.trim(), None),
    }
}

/// Area of the footprint if it contains the point; 0 for a line that passes through it.
fn extent_under(shape: &Footprint, at: DVec2) -> Option<f64> {
    match shape {
        Footprint::Polygon(points) => point_in_polygon(at, points).then(|| area(points).abs()),
        Footprint::Circle { centre, radius_m } => {
            (centre.distance(at) <= *radius_m).then_some(PI * radius_m * radius_m)
        }
        Footprint::Polyline(points) => {
            let on = points.windows(2).any(|pair| {
                let segment = Segment::line(pair[0], pair[1]);
                segment.pose_at(segment.project(at).s).position.distance(at) <= REACH_M
            });
            on.then_some(0.0)
        }
    }
}
