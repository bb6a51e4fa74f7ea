//! Strokes that run along others: the same way drawn twice, as a whole or in part.

use super::strokes::{End, Strokes};
use super::{turn_of, unit};
use crate::geom::trig;

/// Strokes that are one way twice turn by the same angle within this, besides what the tolerance explains.
const BASE_TURN_RAD: f64 = 0.035;

/// A stroke that runs along another one, from one of its ends on.
#[derive(Clone, Copy)]
pub(super) struct Along {
    pub end: End,
    pub other: usize,
    pub share: Share,
    /// Of the part that runs along: on the stroke itself.
    pub length_m: f64,
    /// On the other one, from beside the end to the end of the other one that lies ahead.
    pub other_length_m: f64,
    pub other_end: End,
}

/// How much of a stroke runs along another one.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Share {
    /// All of it does, up to its other end.
    Whole,
    /// A part does, up to where the other stroke has its end.
    Part,
}

pub(super) fn other_end(end: End) -> End {
    end ^ 1
}

/// How the stroke of an end runs along another, from that end on.
pub(super) fn runs_along(strokes: &Strokes, end: End, other: usize) -> Option<Along> {
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
    // Along the other stroke in the direction of mine: to its end, and how far that is.
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
        return same.then_some(Along {
            end,
            other,
            share: Share::Whole,
            length_m: mine.rest.length,
            other_length_m,
            other_end: reached,
        });
    }
    if mine.directed && strokes.all[other].directed && !same_direction(strokes, end, other) {
        return None;
    }
    // Ends that are near are joined, not trimmed.
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
    (inside && meets && middle_is_near(strokes, end, other, length_m)).then_some(Along {
        end,
        other,
        share: Share::Part,
        length_m,
        other_length_m,
        other_end: reached,
    })
}

pub(super) fn same_direction(strokes: &Strokes, end: End, along: usize) -> bool {
    let other = &strokes.all[along].rest;
    let mine = &strokes.of_end(end).rest;
    let foot = other.pose_at(other.project(strokes.position(end)).s);
    let here = mine.pose_at(mine.project(strokes.position(end)).s);
    foot.forward().dot(here.forward()) > 0.0
}

/// Whether two strokes bend alike: a short way that branches off stays near, but turns away.
fn turns_alike(strokes: &Strokes, end: End, other: usize) -> bool {
    let (mine, rest) = (&strokes.of_end(end).rest, &strokes.all[other].rest);
    let sign = if same_direction(strokes, end, other) { 1.0 } else { -1.0 };
    let turn = (mine.curvature - sign * rest.curvature).abs() * mine.length;
    let (a, b) = (mine.curvature, sign * rest.curvature);
    // A line is no arc, and the radius of a short arc is less well known.
    let leeway = 0.1 + strokes.tolerance_m / mine.length;
    let same_shape = a == b || (a * b > 0.0 && (a - b).abs() <= leeway * a.abs().max(b.abs()));
    // A chord that is off by the tolerance changes the sweep of an arc of fixed radius by this.
    let bend = mine.curvature.abs().max(rest.curvature.abs());
    let lever = trig::cos(mine.curvature * mine.length / 2.0).abs().max(0.2);
    same_shape && turn <= BASE_TURN_RAD + 1.5 * strokes.tolerance_m * bend / lever
}

/// Whether the middle of a length from an end on lies along the other stroke too.
fn middle_is_near(strokes: &Strokes, end: End, other: usize, length_m: f64) -> bool {
    let mine = &strokes.of_end(end).rest;
    let half = length_m / 2.0;
    let s = if end.is_multiple_of(2) { half } else { mine.length - half };
    strokes.all[other].rest.project(mine.pose_at(s).position).distance <= strokes.tolerance_m
}
