//! The path of the tracking control: a smooth curve through the poses of a trajectory.
//!
//! Between two poses runs a cubic in the frame of their chord that has both headings at its ends, so
//! that an arc sampled every few metres stays an arc (the chord alone would be 0.2 m off). Before the
//! first and behind the last pose the curve goes on with its curvature there.

use crate::geom::{Pose2, trig, wrap_angle};
use glam::DVec2;
use serde::{Deserialize, Serialize};
use std::f64::consts::FRAC_PI_2;

/// Poses nearer to one another than this are one node.
const SPACING_M: f64 = 0.05;
/// Nodes that the vehicle has passed are no nearer than this.
const KEPT_SPACING_M: f64 = 0.3;
/// Headings that differ more than this from the chord are noise, and the chord is taken instead.
const MAX_SLOPE: f64 = 0.7;
/// No vehicle of ours turns tighter.
const MAX_CURVATURE: f64 = 0.5;
/// Where a path passes a place twice, the branch that leads along the vehicle's heading is meant: a
/// larger difference, which no bend needs, counts as so many metres for each radian.
const HEADING_RAD: f64 = 1.2;
const HEADING_WEIGHT_M: f64 = 5.0;

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Node {
    pose: Pose2,
    station: f64,
}

/// A curve with stations: metres along it, from an origin that stays as the path is renewed.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Path {
    nodes: Vec<Node>,
}

/// The place on a path that is nearest to a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Nearest {
    pub station: f64,
    /// Of the path's tangent.
    pub heading_rad: f64,
    /// Left-positive.
    pub curvature: f64,
    /// How far to the left of the point the path runs.
    pub path_to_left_m: f64,
}

impl Path {
    pub(super) fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    pub(super) fn end(&self) -> f64 {
        self.nodes.last().map_or(0.0, |node| node.station)
    }

    /// A path that begins at `station`.
    pub(super) fn starting_at(station: f64, pose: Pose2) -> Self {
        Self { nodes: vec![Node { pose, station }] }
    }

    /// Adds a pose at the end and gives its station. One that is not ahead of the end is not added.
    pub(super) fn push(&mut self, pose: Pose2) -> f64 {
        let Some(last) = self.nodes.last() else {
            self.nodes.push(Node { pose, station: 0.0 });
            return 0.0;
        };
        let offset = pose.position - last.pose.position;
        if offset.length_squared() < SPACING_M * SPACING_M {
            return last.station + offset.dot(last.pose.forward()).clamp(0.0, SPACING_M);
        }
        let span = Span::between(last.pose, pose);
        if wrap_angle(span.chord_yaw - last.pose.yaw_rad).abs() > FRAC_PI_2 {
            return last.station;
        }
        let station = last.station + span.length;
        self.nodes.push(Node { pose, station });
        station
    }

    /// Leaves of the path what lies between two stations, thinned out where it is dense.
    pub(super) fn keep(&mut self, from: f64, to: f64) {
        let mut kept = f64::NEG_INFINITY;
        self.nodes.retain(|node| {
            let keeps = node.station >= from && node.station <= to && node.station - kept > KEPT_SPACING_M;
            if keeps {
                kept = node.station;
            }
            keeps
        });
    }

    /// The place nearest to `point` for a vehicle that looks along `yaw_rad`, between two stations;
    /// the ends' extensions count where the range reaches them. `None` for an empty path.
    pub(super) fn nearest(&self, point: DVec2, yaw_rad: f64, from: f64, to: f64) -> Option<Nearest> {
        let (first, last) = (self.nodes.first()?, self.nodes.last()?);
        let mut best: Option<(f64, Nearest)> = None;
        let mut offer = |distance_squared: f64, nearest: Nearest| {
            let cost = distance_squared + aside(nearest.heading_rad, yaw_rad);
            if best.is_none_or(|(least, _)| cost < least) {
                best = Some((cost, nearest));
            }
        };
        let begin = self.nodes.partition_point(|node| node.station < from).saturating_sub(1);
        // The chords tell which few of the cubics can be the nearest.
        let reachable = || self.nodes[begin..].windows(2).take_while(|pair| pair[0].station <= to);
        let bound = reachable().map(|pair| chord_cost(pair, point, yaw_rad).1).fold(f64::INFINITY, f64::min);
        for pair in reachable().filter(|pair| chord_cost(pair, point, yaw_rad).0 <= bound) {
            let span = Span::between(pair[0].pose, pair[1].pose);
            let (distance_squared, nearest) = span.nearest(point, pair[0].station);
            offer(distance_squared, nearest);
        }
        let curvature_of = |pair: Option<&[Node]>| {
            pair.map_or(0.0, |pair| Span::between(pair[0].pose, pair[1].pose).curvature)
        };
        if first.station >= from || self.nodes.len() == 1 {
            let nearest = extension(first, curvature_of(self.nodes.get(..2)), point);
            if nearest.station < first.station || self.nodes.len() == 1 {
                offer(nearest.path_to_left_m * nearest.path_to_left_m, nearest);
            }
        }
        if last.station <= to {
            let pair = self.nodes.len().checked_sub(2).map(|k| &self.nodes[k..]);
            let nearest = extension(last, curvature_of(pair), point);
            if nearest.station > last.station {
                offer(nearest.path_to_left_m * nearest.path_to_left_m, nearest);
            }
        }
        best.map(|(_, nearest)| nearest)
    }
}

/// What a path that leads elsewhere costs, m2.
fn aside(heading_rad: f64, yaw_rad: f64) -> f64 {
    let excess = HEADING_WEIGHT_M * (wrap_angle(heading_rad - yaw_rad).abs() - HEADING_RAD).max(0.0);
    excess * excess
}

/// Bounds of the cost of the cubic between two nodes. It stays nearer to its chord than a third of its
/// length, even at the largest slopes.
fn chord_cost(pair: &[Node], point: DVec2, yaw_rad: f64) -> (f64, f64) {
    let (start, offset) = (pair[0].pose.position, pair[1].pose.position - pair[0].pose.position);
    let share = ((point - start).dot(offset) / offset.length_squared().max(1e-12)).clamp(0.0, 1.0);
    let distance = (start + offset * share - point).length();
    let bulge = offset.length() / 3.0;
    let [first, second] = [0, 1].map(|k| aside(pair[k].pose.yaw_rad, yaw_rad));
    let nearer = (distance - bulge).max(0.0);
    let farther = distance + bulge;
    // Headings in between may turn outside those of the ends; half of the lesser is safe for our bends.
    (nearer * nearer + 0.5 * first.min(second), farther * farther + 2.0 * first.max(second))
}

/// The circle (or line) that goes on from a node, and its place nearest to a point.
fn extension(node: &Node, curvature: f64, point: DVec2) -> Nearest {
    let offset = point - node.pose.position;
    let (ahead, left) = (offset.dot(node.pose.forward()), offset.dot(node.pose.left()));
    let (along, turn, to_left) = if curvature.abs() < 1e-6 {
        (ahead, 0.0, -left)
    } else {
        let from_centre = DVec2::new(curvature * ahead, 1.0 - curvature * left);
        let turn = trig::atan2(from_centre.x, from_centre.y);
        (turn / curvature, turn, (from_centre.length() - 1.0) / curvature)
    };
    Nearest {
        station: node.station + along,
        heading_rad: wrap_angle(node.pose.yaw_rad + turn),
        curvature,
        path_to_left_m: to_left,
    }
}

/// The cubic between two poses.
struct Span {
    start: DVec2,
    chord: DVec2,
    chord_length: f64,
    chord_yaw: f64,
    /// Slopes against the chord at both ends.
    slopes: [f64; 2],
    length: f64,
    curvature: f64,
}

/// The tangent of an angle within [`MAX_SLOPE`], to a hundredth: this runs for every pose of every
/// trajectory.
fn tangent(angle_rad: f64) -> f64 {
    let square = angle_rad * angle_rad;
    angle_rad * (1.0 + square * (1.0 / 3.0 + square * (2.0 / 15.0)))
}

impl Span {
    fn between(from: Pose2, to: Pose2) -> Self {
        let offset = to.position - from.position;
        let chord_length = offset.length().max(1e-9);
        let chord = offset / chord_length;
        let chord_yaw = trig::atan2(chord.y, chord.x);
        let angles = [from.yaw_rad, to.yaw_rad].map(|yaw| wrap_angle(yaw - chord_yaw));
        let usable = angles.iter().all(|angle| angle.abs() < MAX_SLOPE);
        let slopes = if usable { angles.map(tangent) } else { [0.0; 2] };
        let [a, b] = slopes;
        // Second order of the arc length of the cubic.
        let length = chord_length * (1.0 + (2.0 * a * a + 2.0 * b * b - a * b) / 30.0);
        let turn = if usable { angles[1] - angles[0] } else { 0.0 };
        let curvature = (turn / length).clamp(-MAX_CURVATURE, MAX_CURVATURE);
        Self { start: from.position, chord, chord_length, chord_yaw, slopes, length, curvature }
    }

    /// Offset to the left of the chord over its length, and slope, at a share of the chord.
    fn cubic(&self, u: f64) -> (f64, f64) {
        let [a, b] = self.slopes;
        let w = 1.0 - u;
        (a * u * w * w - b * u * u * w, a * w * (1.0 - 3.0 * u) + b * u * (3.0 * u - 2.0))
    }

    fn nearest(&self, point: DVec2, station: f64) -> (f64, Nearest) {
        let local = (point - self.start) / self.chord_length;
        let (x, y) = (local.dot(self.chord), local.dot(self.chord.perp()));
        let mut u = x.clamp(0.0, 1.0);
        for _ in 0..3 {
            let (offset, slope) = self.cubic(u);
            u = (u + ((x - u) + (y - offset) * slope) / (1.0 + slope * slope)).clamp(0.0, 1.0);
        }
        let (offset, slope) = self.cubic(u);
        let miss = DVec2::new(u - x, offset - y) * self.chord_length;
        let tangent = DVec2::new(1.0, slope) / (1.0 + slope * slope).sqrt();
        let nearest = Nearest {
            station: station + u * self.length,
            heading_rad: wrap_angle(self.chord_yaw + trig::atan(slope)),
            curvature: self.curvature,
            path_to_left_m: tangent.perp_dot(miss),
        };
        (miss.length_squared(), nearest)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Poses on a circle of radius 10 around the origin, counter-clockwise from its east.
    fn circle(step_rad: f64, count: u32) -> Path {
        let mut path = Path::default();
        for k in 0..count {
            let angle = f64::from(k) * step_rad;
            let (sin, cos) = trig::sin_cos(angle);
            path.push(Pose2::new(10.0 * cos, 10.0 * sin, wrap_angle(angle + std::f64::consts::FRAC_PI_2)));
        }
        path
    }

    #[test]
    fn a_coarsely_sampled_arc_stays_an_arc() {
        let path = circle(0.4, 8);
        for k in -10..40 {
            let angle = 0.1 * f64::from(k);
            let (sin, cos) = trig::sin_cos(angle);
            let yaw = angle + std::f64::consts::FRAC_PI_2;
            let station = 10.0 * angle;
            let near =
                path.nearest(DVec2::new(10.5 * cos, 10.5 * sin), yaw, station - 6.0, station + 6.0).unwrap();
            assert!((near.path_to_left_m - 0.5).abs() < 0.01, "{angle} {near:?}");
            assert!((near.station - 10.0 * angle).abs() < 0.03, "{angle} {near:?}");
            assert!(wrap_angle(near.heading_rad - yaw).abs() < 0.02, "{angle} {near:?}");
            assert!((near.curvature - 0.1).abs() < 0.002);
        }
    }

    #[test]
    fn poses_on_one_spot_are_one_node() {
        let mut path = Path::default();
        for _ in 0..20 {
            path.push(Pose2::new(3.0, 4.0, 1.0));
        }
        assert_eq!(path.nodes.len(), 1);
        let point = Pose2::new(3.0, 4.0, 1.0).point_at(-2.0, -0.5);
        let near = path.nearest(point, 1.0, -5.0, 5.0).unwrap();
        assert!((near.path_to_left_m - 0.5).abs() < 1e-9 && (near.station + 2.0).abs() < 1e-9);
        assert!(Path::default().nearest(point, 1.0, -5.0, 5.0).is_none());
    }
}
