//! The reference path of the tracking control: a smooth curve through the poses of a trajectory.
//!
//! Consecutive poses are joined by a cubic Hermite spline in the frame of their chord with both headings at
//! its ends, so that an arc sampled every few metres stays an arc (the chord alone would be 0.2 m off).
//! Beyond the first and the last pose the path continues with its curvature there.
//!
//! Each vehicle queries its position every tick, and each trajectory becomes a path, so headings are unit
//! vectors and angles are rare.

use city3d_geometry::digest::{Digest, StateHash};
use city3d_geometry::{Pose2, trig, wrap_angle};
use city3d_workers::prefetch_slice;
use glam::DVec2;
use serde::{Deserialize, Serialize};

/// Poses closer than this are one node.
const SPACING_M: f64 = 0.05;
/// Least spacing of nodes behind the vehicle.
const KEPT_SPACING_M: f64 = 0.5;
/// Cosine of 0.7 rad. A heading that differs more from the chord is noise; the chord replaces it.
const LEAST_COSINE: f64 = 0.765;
/// More than distances and stations are rounded by.
const ROUNDING_M: f64 = 1e-6;
/// Largest curvature of any vehicle.
const MAX_CURVATURE: f64 = 0.5;
/// At a self-intersection the branch along the vehicle's heading counts: a heading difference above this,
/// which no bend requires, adds this many metres per radian.
const HEADING_RAD: f64 = 1.2;
const HEADING_WEIGHT_M: f64 = 5.0;

/// A node of the path. Spans follow from their two nodes: in a city of thousands the time of a search is that of reading
/// memory, and a span is needed for few of the nodes that are read and kept.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct PathNode {
    station: f64,
    pose: Pose2,
    /// Unit vector of the heading.
    forward: DVec2,
}

/// A path with stations: arc lengths from an origin that is kept as the path is renewed.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Path {
    nodes: Vec<PathNode>,
}

/// The nearest point of a path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct NearestPoint {
    /// Arc length along the path, metres.
    pub station: f64,
    /// Unit vector along the path.
    pub tangent: DVec2,
    /// Left-positive.
    pub curvature: f64,
    /// Signed distance from the query point to the path, positive if the path is to its left.
    pub path_to_left_m: f64,
}

/// The best candidate so far, and the search radius.
struct NearestSearch {
    cost: f64,
    within_m: f64,
    nearest: Option<NearestPoint>,
}

impl NearestSearch {
    fn offer(&mut self, distance_squared: f64, nearest: NearestPoint, forward: DVec2) {
        let cost = distance_squared + aside(nearest.tangent, forward);
        if cost < self.cost {
            *self = Self { cost, within_m: cost.sqrt(), nearest: Some(nearest) };
        }
    }
}

impl Digest for Path {
    fn digest(&self, hash: &mut StateHash) {
        self.digest_from(0, hash);
    }
}

impl Path {
    pub(super) fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    pub(super) fn end(&self) -> f64 {
        self.nodes.last().map_or(0.0, |node| node.station)
    }

    /// Asks for its first nodes, at most so many.
    pub(super) fn fetch(&self, most: usize) {
        prefetch_slice(&self.nodes[..most.min(self.nodes.len())]);
    }

    /// The digest of the nodes from one on.
    fn digest_from(&self, first: usize, hash: &mut StateHash) {
        for node in &self.nodes[first..] {
            node.pose.digest(hash);
            hash.number(node.station);
        }
    }

    /// Restarts with one pose at `station`.
    pub(super) fn restart(&mut self, station: f64, pose: Pose2) {
        self.nodes.clear();
        self.nodes.push(PathNode { station, pose, forward: pose.forward() });
    }

    /// Appends a pose and returns its station. A pose not ahead of the end is skipped.
    pub(super) fn push(&mut self, pose: Pose2) -> f64 {
        let Some(last) = self.nodes.last() else {
            self.restart(0.0, pose);
            return 0.0;
        };
        let offset = pose.position - last.pose.position;
        let ahead = offset.dot(last.forward);
        if offset.length_squared() < SPACING_M * SPACING_M {
            return last.station + ahead.clamp(0.0, SPACING_M);
        }
        if ahead < 0.0 {
            return last.station;
        }
        // On a straight line all have the same heading.
        let is_straight = pose.yaw_rad.to_bits() == last.pose.yaw_rad.to_bits();
        let forward = if is_straight { last.forward } else { pose.forward() };
        let mut node = PathNode { station: 0.0, pose, forward };
        node.station = last.station + CubicSpan::between(last, &node).length();
        self.nodes.push(node);
        node.station
    }

    /// [`Self::push`], with the digest of what comes to the path: the processor works on both at once, for a digest is a chain
    /// of multiplications that wait for each other.
    pub(super) fn push_into(&mut self, pose: Pose2, hash: &mut StateHash) -> f64 {
        let count = self.nodes.len();
        let station = self.push(pose);
        self.digest_from(count, hash);
        station
    }

    /// Keeps the path between two stations, thinned out where it is dense.
    pub(super) fn keep(&mut self, from: f64, to: f64) {
        let nodes = &mut self.nodes;
        // What lies ahead is most of a path and is not read.
        let begin = nodes.iter().take_while(|node| node.station < from).count();
        let count = nodes[begin..].iter().take_while(|node| node.station <= to).count();
        // Kept nodes move to the front.
        let mut kept = 0;
        for index in begin..begin + count {
            if kept == 0 || nodes[index].station - nodes[kept - 1].station > KEPT_SPACING_M {
                nodes[kept] = nodes[index];
                kept += 1;
            }
        }
        nodes.truncate(kept);
    }

    /// The nearest point to `point` between two stations, for a vehicle with heading `forward`; extensions
    /// count if the range reaches them. `None` for an empty path.
    pub(super) fn nearest(&self, point: DVec2, forward: DVec2, from: f64, to: f64) -> Option<NearestPoint> {
        let (first, last) = (self.nodes.first()?, self.nodes.last()?);
        // One after the other, as the processor fetches them: the stretch is near the front, and what is read first is hardly
        // ever at hand.
        let begin = self.nodes.iter().take_while(|node| node.station < from).count().saturating_sub(1);
        let mut best = NearestSearch { cost: f64::INFINITY, within_m: f64::INFINITY, nearest: None };
        let stretch = &self.nodes[begin..];
        let count = stretch.windows(2).take_while(|ends| ends[0].station <= to).count();
        let spans = || stretch.windows(2).take(count);
        let to_middle = |ends: &[PathNode]| middle(&ends[0], &ends[1]).distance_squared(point);
        // The likeliest span first: it bounds the search in the others.
        if let Some(likeliest) = least(spans().map(to_middle)) {
            let nearest_of = |index: usize| {
                let (from, to) = (&stretch[index], &stretch[index + 1]);
                let span = CubicSpan::between(from, to);
                span.nearest(point - middle(from, to), from, to)
            };
            let (distance_squared, nearest) = nearest_of(likeliest);
            best.offer(distance_squared, nearest, forward);
            for (index, ends) in spans().enumerate() {
                if index != likeliest && may_be_within(&ends[0], &ends[1], point, best.within_m) {
                    let (distance_squared, nearest) = nearest_of(index);
                    best.offer(distance_squared, nearest, forward);
                }
            }
        }
        let is_one = self.nodes.len() == 1;
        if is_one || (first.station >= from && first.ahead_of(point) < 0.0) {
            let curvature = self
                .nodes
                .get(1)
                .map_or(0.0, |second| CubicSpan::between(first, second).curvature(first, second));
            let nearest = extension(first, curvature, point);
            best.offer(nearest.path_to_left_m * nearest.path_to_left_m, nearest, forward);
        }
        if !is_one && last.station <= to && last.ahead_of(point) > 0.0 {
            let before = &self.nodes[self.nodes.len() - 2];
            let nearest = extension(last, CubicSpan::between(before, last).curvature(before, last), point);
            best.offer(nearest.path_to_left_m * nearest.path_to_left_m, nearest, forward);
        }
        best.nearest
    }
}

impl PathNode {
    /// Longitudinal distance of a point from the node.
    fn ahead_of(&self, point: DVec2) -> f64 {
        (point - self.pose.position).dot(self.forward)
    }
}

/// Of the chord between two nodes.
fn middle(from: &PathNode, to: &PathNode) -> DVec2 {
    from.pose.position + (to.pose.position - from.pose.position) / 2.0
}

/// Whether the span between two nodes may have a point within a distance of `point`: false only where it certainly has none,
/// by the plane across each end of its chord and by the circle around its middle. Neither root nor quotient.
fn may_be_within(from: &PathNode, to: &PathNode, point: DVec2, within_m: f64) -> bool {
    let within_m = within_m + ROUNDING_M;
    // A bound on the distance of the cubic from the middle of its chord: even at the largest slopes it stays within a third of
    // the chord's length of the chord, and the chord is no longer than the arc.
    let reach_m = within_m + (0.5 + 1.0 / 3.0) * (to.station - from.station);
    if middle(from, to).distance_squared(point) > reach_m * reach_m {
        return false;
    }
    let chord = to.pose.position - from.pose.position;
    // Over the length of the chord; positive outside.
    let outside = (point - to.pose.position).dot(chord).max((from.pose.position - point).dot(chord));
    outside <= 0.0 || outside * outside <= within_m * within_m * chord.length_squared()
}

/// Index of the first of the least numbers.
fn least(numbers: impl Iterator<Item = f64>) -> Option<usize> {
    let smaller = |best: (usize, f64), next: (usize, f64)| if next.1 < best.1 { next } else { best };
    numbers.enumerate().reduce(smaller).map(|(index, _)| index)
}

/// Penalty for a branch in another direction, m2.
fn aside(tangent: DVec2, forward: DVec2) -> f64 {
    // Cosine of HEADING_RAD: nearly always the directions agree.
    if tangent.dot(forward) > 0.3624 {
        return 0.0;
    }
    let excess = HEADING_WEIGHT_M * (angle_between(forward, tangent).abs() - HEADING_RAD).max(0.0);
    excess * excess
}

/// Angle from one unit vector to another, left-positive.
pub(super) fn angle_between(from: DVec2, to: DVec2) -> f64 {
    trig::atan2(from.perp_dot(to), from.dot(to))
}

/// The nearest point on the circular or straight extension of a node.
fn extension(node: &PathNode, curvature: f64, point: DVec2) -> NearestPoint {
    let offset = point - node.pose.position;
    let (ahead, left) = (offset.dot(node.forward), offset.dot(node.forward.perp()));
    let (along, tangent, to_left) = if curvature.abs() < 1e-6 {
        (ahead, node.forward, -left)
    } else {
        let from_centre = DVec2::new(curvature * ahead, 1.0 - curvature * left);
        let distance = from_centre.length();
        let turn = trig::atan2(from_centre.x, from_centre.y);
        let unit = from_centre / distance.max(1e-12);
        (turn / curvature, node.forward * unit.y + node.forward.perp() * unit.x, (distance - 1.0) / curvature)
    };
    NearestPoint { station: node.station + along, tangent, curvature, path_to_left_m: to_left }
}

/// A cubic Hermite span between two poses.
#[derive(Clone, Copy, Debug)]
struct CubicSpan {
    /// Unit vector.
    chord: DVec2,
    chord_length: f64,
    /// End slopes relative to the chord.
    slopes: [f64; 2],
    /// Whether the headings at its ends are those of the poses.
    has_headings: bool,
}

impl CubicSpan {
    fn between(from: &PathNode, to: &PathNode) -> Self {
        let offset = to.pose.position - from.pose.position;
        let chord_length = offset.length().max(1e-9);
        let chord = offset / chord_length;
        let cosines = [from.forward.dot(chord), to.forward.dot(chord)];
        let has_headings = cosines.iter().all(|cosine| *cosine > LEAST_COSINE);
        let slopes = if has_headings {
            [chord.perp_dot(from.forward) / cosines[0], chord.perp_dot(to.forward) / cosines[1]]
        } else {
            [0.0; 2]
        };
        Self { chord, chord_length, slopes, has_headings }
    }

    /// Arc length to second order.
    fn length(&self) -> f64 {
        let [a, b] = self.slopes;
        self.chord_length * (1.0 + (2.0 * a * a + 2.0 * b * b - a * b) / 30.0)
    }

    /// Mean curvature, for the nodes at its ends.
    fn curvature(&self, from: &PathNode, to: &PathNode) -> f64 {
        let turn = if self.has_headings { wrap_angle(to.pose.yaw_rad - from.pose.yaw_rad) } else { 0.0 };
        (turn / self.length()).clamp(-MAX_CURVATURE, MAX_CURVATURE)
    }

    /// Lateral offset over the chord's length, and slope, at a share of the chord.
    fn cubic(&self, u: f64) -> (f64, f64) {
        let [a, b] = self.slopes;
        let w = 1.0 - u;
        (a * u * w * w - b * u * u * w, a * w * (1.0 - 3.0 * u) + b * u * (3.0 * u - 2.0))
    }

    /// Squared distance to the nearest point, and that point; the offset is that of the query point from the middle.
    fn nearest(&self, offset: DVec2, from: &PathNode, to: &PathNode) -> (f64, NearestPoint) {
        let local = offset / self.chord_length;
        let (x, y) = (0.5 + local.dot(self.chord), local.dot(self.chord.perp()));
        let mut u = x.clamp(0.0, 1.0);
        for _ in 0..3 {
            let (offset, slope) = self.cubic(u);
            u = (u + ((x - u) + (y - offset) * slope) / (1.0 + slope * slope)).clamp(0.0, 1.0);
        }
        let (offset, slope) = self.cubic(u);
        let miss = DVec2::new(u - x, offset - y) * self.chord_length;
        let tangent = DVec2::new(1.0, slope) / (1.0 + slope * slope).sqrt();
        let nearest = NearestPoint {
            station: from.station + u * (to.station - from.station),
            tangent: self.chord * tangent.x + self.chord.perp() * tangent.y,
            curvature: self.curvature(from, to),
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
            let forward = DVec2::new(-sin, cos);
            let station = 10.0 * angle;
            let point = DVec2::new(10.5 * cos, 10.5 * sin);
            let near = path.nearest(point, forward, station - 6.0, station + 6.0).unwrap();
            assert!((near.path_to_left_m - 0.5).abs() < 0.01, "{angle} {near:?}");
            assert!((near.station - 10.0 * angle).abs() < 0.03, "{angle} {near:?}");
            assert!(angle_between(forward, near.tangent).abs() < 0.02, "{angle} {near:?}");
            assert!((near.curvature - 0.1).abs() < 0.002);
        }
    }

    #[test]
    fn a_thinned_path_is_where_it_was() {
        let mut path = circle(0.01, 200);
        let whole = path.clone();
        path.keep(3.0, 15.0);
        assert!(path.nodes.len() < 40 && path.nodes[0].station >= 3.0 && path.end() <= 15.0);
        for k in 4..14 {
            let (sin, cos) = trig::sin_cos(0.1 * f64::from(k));
            let near = |path: &Path| {
                path.nearest(DVec2::new(9.0 * cos, 9.0 * sin), DVec2::new(-sin, cos), 0.0, 20.0)
            };
            let (thin, dense) = (near(&path).unwrap(), near(&whole).unwrap());
            assert!((thin.station - dense.station).abs() < 0.01, "{thin:?} {dense:?}");
            assert!((thin.path_to_left_m - dense.path_to_left_m).abs() < 1e-3, "{thin:?} {dense:?}");
        }
    }

    #[test]
    fn where_a_path_crosses_itself_the_branch_ahead_is_meant() {
        // East along the x axis, round a loop, and back across it to the south.
        let mut path = Path::default();
        for k in 0..=10 {
            path.push(Pose2::new(-20.0 + 2.0 * f64::from(k), 0.0, 0.0));
        }
        for k in 1..=15 {
            let angle = f64::from(k) * 0.1 * std::f64::consts::PI;
            let (sin, cos) = trig::sin_cos(angle);
            path.push(Pose2::new(10.0 * sin, 10.0 - 10.0 * cos, wrap_angle(angle)));
        }
        for k in 1..=10 {
            path.push(Pose2::new(-10.0, 10.0 - 2.0 * f64::from(k), -std::f64::consts::FRAC_PI_2));
        }
        let place = DVec2::new(-10.2, 0.1);
        let east = path.nearest(place, DVec2::X, f64::NEG_INFINITY, f64::INFINITY).unwrap();
        let south = path.nearest(place, -DVec2::Y, f64::NEG_INFINITY, f64::INFINITY).unwrap();
        assert!((east.station - 9.8).abs() < 0.05 && east.tangent.x > 0.99, "{east:?}");
        assert!(south.station > 60.0 && south.tangent.y < -0.99, "{south:?}");
    }

    #[test]
    fn poses_on_one_spot_are_one_node() {
        let mut path = Path::default();
        for _ in 0..20 {
            path.push(Pose2::new(3.0, 4.0, 1.0));
        }
        assert_eq!(path.nodes.len(), 1);
        let pose: Pose2 = Pose2::new(3.0, 4.0, 1.0);
        let point = pose.point_at(-2.0, -0.5);
        let near = path.nearest(point, pose.forward(), -5.0, 5.0).unwrap();
        assert!((near.path_to_left_m - 0.5).abs() < 1e-9 && (near.station + 2.0).abs() < 1e-9);
        assert!(Path::default().nearest(point, DVec2::X, -5.0, 5.0).is_none());
    }
}
