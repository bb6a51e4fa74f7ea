//! Detects strokes that run along others: duplicate lanes, whole or in part.

use super::strokes::{LaneStrokes, StrokeEnd};
use super::{turn_of, unit};
use city3d_geometry::trig;

/// Duplicate strokes turn by the same angle within this, besides what the tolerance explains.
const BASE_TURN_RAD: f64 = 0.035;

/// The overlap of a stroke with another one, from one of its ends on.
#[derive(Clone, Copy)]
pub(super) struct StrokeOverlap {
    /// End of the stroke at which the overlap begins.
    pub end: StrokeEnd,
    /// Index of the other stroke.
    pub other: usize,
    /// How much of the stroke overlaps.
    pub share: OverlapExtent,
    /// Length of the overlap on the stroke itself.
    pub length_m: f64,
    /// Length on the other stroke, from beside the end to its own end ahead.
    pub other_length_m: f64,
    /// End of the other stroke that the overlap runs to.
    pub other_end: StrokeEnd,
}

/// How much of a stroke overlaps another one.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum OverlapExtent {
    /// All of it, up to its other end.
    Whole,
    /// A part, up to the end of the other stroke.
    Part,
}

pub(super) fn other_end(end: StrokeEnd) -> StrokeEnd {
    end ^ 1
}

/// The overlap of the stroke of an end with another stroke.
pub(super) fn runs_along(strokes: &LaneStrokes, end: StrokeEnd, other: usize) -> Option<StrokeOverlap> {
    let tolerance = strokes.tolerance_m;
    if !strokes.reaches(other, strokes.position(end)) {
        return None;
    }
    let (mine, rest) = (strokes.of_end(end), &strokes.all[other].rest);
    let foot = rest.project(strokes.position(end));
    let tangent = rest.pose_at(foot.s);
    let turn = turn_of(tangent.yaw_rad, strokes.leaving(end));
    if foot.distance > tolerance || turn > strokes.angle_tolerance(end / 2, other) {
        return None;
    }
    // The end of the other stroke in this direction, and its distance.
    let ahead = tangent.forward().dot(unit(strokes.leaving(end))) > 0.0;
    let (reached, other_length_m) =
        if ahead { (2 * other + 1, rest.length - foot.s) } else { (2 * other, foot.s) };
    let far = rest.project(strokes.position(other_end(end)));
    let far_turn = turn_of(rest.pose_at(far.s).yaw_rad, strokes.leaving(other_end(end)));
    let way = if ahead { far.s - foot.s } else { foot.s - far.s };
    if far.distance <= tolerance
        && far_turn <= strokes.angle_tolerance(end / 2, other)
        && (way - mine.rest.length).abs() <= 2.0 * tolerance
        && way > 0.0
    {
        let same = turns_alike(strokes, end, other) && middle_is_near(strokes, end, other, mine.rest.length);
        return same.then_some(StrokeOverlap {
            end,
            other,
            share: OverlapExtent::Whole,
            length_m: mine.rest.length,
            other_length_m,
            other_end: reached,
        });
    }
    if mine.directed && strokes.all[other].directed && !same_direction(strokes, end, other) {
        return None;
    }
    // Close ends are joined, not trimmed.
    if other_length_m <= 1e-6 || strokes.position(reached).distance(strokes.position(end)) <= tolerance {
        return None;
    }
    let back = mine.rest.project(strokes.position(reached));
    let length_m = if end.is_multiple_of(2) { back.s } else { mine.rest.length - back.s };
    let back_turn = turn_of(mine.rest.pose_at(back.s).yaw_rad, strokes.leaving(reached));
    let inside = length_m > 0.0 && length_m < mine.rest.length;
    let meets = back.distance <= tolerance
        && back_turn <= strokes.angle_tolerance(end / 2, other)
        && (length_m - other_length_m).abs() <= 2.0 * tolerance;
    (inside && meets && middle_is_near(strokes, end, other, length_m)).then_some(StrokeOverlap {
        end,
        other,
        share: OverlapExtent::Part,
        length_m,
        other_length_m,
        other_end: reached,
    })
}

pub(super) fn same_direction(strokes: &LaneStrokes, end: StrokeEnd, along: usize) -> bool {
    let other = &strokes.all[along].rest;
    let mine = &strokes.of_end(end).rest;
    let foot = other.pose_at(other.project(strokes.position(end)).s);
    let here = mine.pose_at(mine.project(strokes.position(end)).s);
    foot.forward().dot(here.forward()) > 0.0
}

/// Whether two strokes have similar curvature: a branch stays near at first, but turns away.
fn turns_alike(strokes: &LaneStrokes, end: StrokeEnd, other: usize) -> bool {
    let (mine, rest) = (&strokes.of_end(end).rest, &strokes.all[other].rest);
    let sign = if same_direction(strokes, end, other) { 1.0 } else { -1.0 };
    let turn = (mine.curvature - sign * rest.curvature).abs() * mine.length;
    let (a, b) = (mine.curvature, sign * rest.curvature);
    // A line is not an arc, and the radius of a short arc is uncertain.
    let leeway = 0.1 + strokes.tolerance_m / mine.length;
    let same_shape = a == b || (a * b > 0.0 && (a - b).abs() <= leeway * a.abs().max(b.abs()));
    // Change of the sweep of an arc of fixed radius whose chord is off by the tolerance.
    let bend = mine.curvature.abs().max(rest.curvature.abs());
    let lever = trig::cos(mine.curvature * mine.length / 2.0).abs().max(0.2);
    same_shape && turn <= BASE_TURN_RAD + 1.5 * strokes.tolerance_m * bend / lever
}

/// Whether the middle of the overlap is also near the other stroke.
fn middle_is_near(strokes: &LaneStrokes, end: StrokeEnd, other: usize, length_m: f64) -> bool {
    let mine = &strokes.of_end(end).rest;
    let half = length_m / 2.0;
    let s = if end.is_multiple_of(2) { half } else { mine.length - half };
    strokes.all[other].rest.project(mine.pose_at(s).position).distance <= strokes.tolerance_m
}
