//! Builds control lines and signal heads from drawn lines, one for each lane crossed.

use super::pieces::{DrawnLine, lines_of};
use super::{EntitiesByLayer, JOIN_TOLERANCE_M, place};
use crate::error::{Diagnostics, MapErrorKind};
use crate::{ControlLine, ControlLineKind, Lane, LaneId, SignalHead, layers};
use city3d_geometry::Lab;
use city3d_geometry::lab::Segment;
use std::f64::consts::FRAC_1_SQRT_2;

/// A line at a joint belongs to the lane that ends there, not to its successors.
const AT_JOINT_M: f64 = 0.01;

/// Control lines in the order of kinds and of the file, those of one drawn line by lane.
pub(super) fn build(
    lanes: &[Lane<Lab>],
    by_layer: &EntitiesByLayer,
    metres: f64,
    diagnostics: &mut Diagnostics,
) -> Vec<ControlLine> {
    let mut lines = Vec::new();
    for (layer, kind) in
        [(layers::STOP_LINES, ControlLineKind::Stop), (layers::YIELD_LINES, ControlLineKind::Yield)]
    {
        for (drawn, lane, at_m) in crossings_of(lanes, (by_layer, layer), metres, diagnostics) {
            lines.push(ControlLine { kind, lane, at_m, ends: [drawn.from, drawn.to] });
        }
    }
    lines
}

/// Signal heads in the order of the file, those of one drawn line by lane.
pub(super) fn signal_heads(
    lanes: &[Lane<Lab>],
    by_layer: &EntitiesByLayer,
    metres: f64,
    diagnostics: &mut Diagnostics,
) -> Vec<SignalHead> {
    let crossed = crossings_of(lanes, (by_layer, layers::SIGNALS), metres, diagnostics);
    crossed.into_iter().map(|(_, lane, at_m)| SignalHead { lane, at_m }).collect()
}

/// The lines of a layer, each with every lane that it crosses and where.
fn crossings_of<'a>(
    lanes: &[Lane<Lab>],
    (by_layer, layer): (&EntitiesByLayer<'a>, &str),
    metres: f64,
    diagnostics: &mut Diagnostics,
) -> Vec<(DrawnLine<'a>, LaneId, f64)> {
    let mut found = Vec::new();
    for drawn in lines_of(by_layer, layer, metres, diagnostics) {
        let crossed = crossed_lanes(lanes, &drawn);
        if crossed.is_empty() {
            let message = format!("the line at {} crosses no lane", place((drawn.from + drawn.to) / 2.0));
            let remedy = "draw it across the centre line of a lane, within 45 degrees of square to it";
            diagnostics.error(MapErrorKind::Stray, drawn.entity, message, remedy);
        }
        found.extend(crossed.into_iter().map(|(lane, at_m)| (drawn, lane, at_m)));
    }
    found
}

/// Lanes whose centre line the drawn line crosses at more than 45 degrees, and where.
fn crossed_lanes(lanes: &[Lane<Lab>], drawn: &DrawnLine) -> Vec<(LaneId, f64)> {
    let mut crossed: Vec<(LaneId, f64)> = Vec::new();
    for lane in lanes {
        let first = lane
            .curve
            .segments()
            .iter()
            .enumerate()
            .flat_map(|(k, segment)| {
                let station = lane.curve.station(k);
                crossings(segment, drawn).into_iter().map(move |s| station + s)
            })
            .min_by(f64::total_cmp);
        if let Some(s) = first {
            crossed.push((lane.id, s.clamp(0.0, lane.curve.length())));
        }
    }
    let at_end_of_predecessor = |&(id, s): &(LaneId, f64)| {
        s < AT_JOINT_M
            && crossed.iter().any(|&(other, at)| {
                other != id
                    && lanes[id.index()].predecessors.contains(&other)
                    && lanes[other.index()].curve.length() - at < AT_JOINT_M
            })
    };
    crossed.iter().filter(|&c| !at_end_of_predecessor(c)).copied().collect()
}

/// Arc lengths on a segment where the line meets it within 45 degrees of square.
fn crossings(segment: &Segment, drawn: &DrawnLine) -> Vec<f64> {
    let along = drawn.to - drawn.from;
    let length = along.length();
    let Some(direction) = along.try_normalize() else { return Vec::new() };
    // Parameters along the drawn line, in metres from its start.
    let mut at: Vec<f64> = Vec::new();
    match segment.centre() {
        None => {
            let forward = segment.start.forward();
            let across = direction.perp_dot(forward);
            if across != 0.0 {
                at.push((segment.start.position - drawn.from).perp_dot(forward) / across);
            }
        }
        Some(centre) => {
            let radius = 1.0 / segment.curvature.abs();
            let to_centre = centre - drawn.from;
            let middle = to_centre.dot(direction);
            let square = radius * radius - (to_centre - direction * middle).length_squared();
            if square >= 0.0 {
                at.extend([middle - square.sqrt(), middle + square.sqrt()]);
            }
        }
    }
    at.retain(|&t| t >= -JOIN_TOLERANCE_M && t <= length + JOIN_TOLERANCE_M);
    at.into_iter()
        .filter_map(|t| {
            let point = drawn.from + direction * t;
            let s = segment.project(point).s;
            let foot = segment.pose_at(s);
            let meets = foot.position.distance(point) <= JOIN_TOLERANCE_M;
            let square = foot.forward().perp_dot(direction).abs() >= FRAC_1_SQRT_2 - 1e-9;
            (meets && square).then_some(s)
        })
        .collect()
}
