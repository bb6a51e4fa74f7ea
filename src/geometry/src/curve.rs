//! Curves of straight lines and circular arcs, parametrised by arc length.

use super::{City, Frame, Lab, LengthScale, Pose2, trig, wrap_angle};
use glam::DVec2;
use serde::{Deserialize, Serialize};

/// A piece of constant curvature: a straight line (curvature 0) or a circular arc.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(bound = "")]
pub struct Segment<F: Frame = City> {
    /// First point, with the heading of the tangent there.
    pub start: Pose2<F>,
    /// Arc length, metres of the frame.
    pub length: f64,
    /// Signed, left-positive, 1 / radius.
    pub curvature: f64,
    start_sin: f64,
    start_cos: f64,
}

/// A point of a curve with its tangent and curvature.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CurvePoint<F: Frame = City> {
    /// Position, with the heading of the tangent.
    pub pose: Pose2<F>,
    /// Signed, left-positive, 1 / radius.
    pub curvature: f64,
}

/// The projection of a point onto a curve: its nearest point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CurveProjection {
    /// Arc length of the nearest point from the start of the curve.
    pub s: f64,
    /// Signed distance of the point from the curve's tangent there, positive where the point lies to
    /// the left.
    pub lateral: f64,
    /// Distance to the nearest point; exceeds |`lateral`| beyond the ends.
    pub distance: f64,
}

impl<F: Frame> Segment<F> {
    /// A segment from its first point on, of an arc length and a curvature (left-positive, 1 / radius).
    pub fn new(start: Pose2<F>, length: f64, curvature: f64) -> Self {
        let (start_sin, start_cos) = trig::sin_cos(start.yaw_rad);
        Self { start, length, curvature, start_sin, start_cos }
    }

    /// A straight line between two points.
    pub fn line(from: DVec2, to: DVec2) -> Self {
        let along = to - from;
        let yaw_rad = trig::atan2(along.y, along.x);
        Self::new(Pose2::at(from, yaw_rad), along.length(), 0.0)
    }

    /// An arc about `centre` from one angle, through `sweep_rad` (positive is counter-clockwise).
    pub fn arc(centre: DVec2, radius: f64, from_angle_rad: f64, sweep_rad: f64) -> Self {
        let (sin, cos) = trig::sin_cos(from_angle_rad);
        let turn = if sweep_rad >= 0.0 { 1.0 } else { -1.0 };
        let yaw_rad = wrap_angle(from_angle_rad + turn * std::f64::consts::FRAC_PI_2);
        let position = centre + DVec2::new(cos, sin) * radius;
        Self::new(Pose2::at(position, yaw_rad), radius * sweep_rad.abs(), turn / radius)
    }

    /// The centre of an arc; `None` for a line.
    pub fn centre(&self) -> Option<DVec2> {
        (self.curvature != 0.0).then(|| self.start.position + self.left() / self.curvature)
    }

    /// Unsigned radius of an arc; `None` for a line.
    pub fn radius(&self) -> Option<f64> {
        (self.curvature != 0.0).then(|| 1.0 / self.curvature.abs())
    }

    fn forward(&self) -> DVec2 {
        DVec2::new(self.start_cos, self.start_sin)
    }

    fn left(&self) -> DVec2 {
        DVec2::new(-self.start_sin, self.start_cos)
    }

    /// The pose at arc length `s` from the segment's start, also beyond its ends.
    pub fn pose_at(&self, s: f64) -> Pose2<F> {
        if self.curvature == 0.0 {
            let position = self.start.position + self.forward() * s;
            return Pose2::at(position, self.start.yaw_rad);
        }
        let turned = s * self.curvature;
        let (sin, cos) = trig::sin_cos(turned);
        let position = self.turned_to(sin, cos);
        Pose2::at(position, wrap_angle(self.start.yaw_rad + turned))
    }

    /// The pose at the last point.
    pub fn end(&self) -> Pose2<F> {
        self.pose_at(self.length)
    }

    /// The nearest point of the segment.
    pub fn project(&self, point: DVec2) -> CurveProjection {
        self.project_within(point, 0.0, self.length)
    }

    /// The nearest point of the part between two arc lengths.
    fn project_within(&self, point: DVec2, from_s: f64, to_s: f64) -> CurveProjection {
        if self.curvature == 0.0 {
            let offset = point - self.start.position;
            let (along, lateral) = (offset.dot(self.forward()), offset.dot(self.left()));
            let s = along.clamp(from_s, to_s);
            return CurveProjection { s, lateral, distance: DVec2::new(along - s, lateral).length() };
        }
        let s = self.nearest_s(point, from_s, to_s);
        let (sin, cos) = trig::sin_cos(s * self.curvature);
        let foot = self.turned_to(sin, cos);
        let offset = point - foot;
        let left = self.left() * cos - self.forward() * sin;
        CurveProjection { s, lateral: offset.dot(left), distance: offset.length() }
    }

    /// The point at which an arc has turned by an angle.
    fn turned_to(&self, sin: f64, cos: f64) -> DVec2 {
        self.start.position
            + self.forward() * (sin / self.curvature)
            + self.left() * ((1.0 - cos) / self.curvature)
    }

    /// The nearest arc length on an arc within an interval: where its normal passes through the point, else
    /// the nearer end.
    fn nearest_s(&self, point: DVec2, from_s: f64, to_s: f64) -> f64 {
        let radius = 1.0 / self.curvature.abs();
        let centre = self.start.position + self.left() / self.curvature;
        let (start_from_centre, from_centre) = (self.start.position - centre, point - centre);
        let turned = trig::atan2(start_from_centre.perp_dot(from_centre), start_from_centre.dot(from_centre))
            * self.curvature.signum();
        // The angle is measured from the middle of the interval, so that long arcs wrap at the far side.
        let middle = (from_s + to_s) / 2.0 / radius;
        ((middle + wrap_angle(turned - middle)) * radius).clamp(from_s, to_s)
    }

    fn reversed(&self) -> Self {
        let end = self.end();
        let start = Pose2::at(end.position, wrap_angle(end.yaw_rad + std::f64::consts::PI));
        Self::new(start, self.length, -self.curvature)
    }
}

/// A chain of segments, each starting where the one before ends.
///
/// ```
/// use city3d_geometry::{Curve, Segment};
/// use glam::DVec2;
///
/// let curve: Curve = Curve::new(vec![Segment::line(DVec2::ZERO, DVec2::new(10.0, 0.0))]);
/// let foot = curve.project(DVec2::new(4.0, 1.5));
/// assert_eq!((foot.s, foot.lateral), (4.0, 1.5));
/// assert_eq!(curve.at(foot.s).pose.position, DVec2::new(4.0, 0.0));
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(bound = "")]
pub struct Curve<F: Frame = City> {
    segments: Vec<Segment<F>>,
    /// Arc length at the start of each segment, and the whole length at the end.
    stations: Vec<f64>,
}

impl<F: Frame> Curve<F> {
    /// The curve of these segments, each of which has to start where the one before ends.
    ///
    /// # Panics
    /// If there is no segment: an empty curve has no tangent.
    pub fn new(segments: Vec<Segment<F>>) -> Self {
        assert!(!segments.is_empty(), "a curve needs at least one segment");
        let mut stations = Vec::with_capacity(segments.len() + 1);
        let mut s = 0.0;
        for segment in &segments {
            stations.push(s);
            s += segment.length;
        }
        stations.push(s);
        Self { segments, stations }
    }

    /// In order of arc length; at least one.
    pub fn segments(&self) -> &[Segment<F>] {
        &self.segments
    }

    /// Arc length of the whole curve, metres of the frame.
    pub fn length(&self) -> f64 {
        self.stations[self.segments.len()]
    }

    /// Arc length at the start of each segment, and the whole length at the end.
    pub fn stations(&self) -> &[f64] {
        &self.stations
    }

    /// Arc length at which segment `index` starts.
    ///
    /// # Panics
    /// If `index` exceeds the number of segments; equal to it, the answer is the whole length.
    pub fn station(&self, index: usize) -> f64 {
        self.stations[index]
    }

    fn segment_index_at(&self, s: f64) -> usize {
        self.stations[1..self.segments.len()].partition_point(|&end| end <= s)
    }

    /// The point at arc length `s`. The curve is extended straight beyond its ends.
    pub fn at(&self, s: f64) -> CurvePoint<F> {
        if s < 0.0 {
            let pose = self.segments[0].start.advanced(s);
            return CurvePoint { pose, curvature: 0.0 };
        }
        if s > self.length() {
            let end = self.segments[self.segments.len() - 1].end();
            return CurvePoint { pose: end.advanced(s - self.length()), curvature: 0.0 };
        }
        let index = self.segment_index_at(s);
        let segment = &self.segments[index];
        CurvePoint { pose: segment.pose_at(s - self.stations[index]), curvature: segment.curvature }
    }

    /// Curvature at arc length `s`, left-positive; 0 beyond either end.
    pub fn curvature_at(&self, s: f64) -> f64 {
        if s < 0.0 || s > self.length() {
            return 0.0;
        }
        self.segments[self.segment_index_at(s)].curvature
    }

    /// The pose at arc length 0.
    pub fn start(&self) -> Pose2<F> {
        self.segments[0].start
    }

    /// The pose at the end of the last segment.
    pub fn end(&self) -> Pose2<F> {
        self.segments[self.segments.len() - 1].end()
    }

    /// The nearest point of the whole curve.
    pub fn project(&self, point: DVec2) -> CurveProjection {
        self.project_within(point, 0.0, self.length())
    }

    /// The nearest point between two arc lengths.
    pub fn project_within(&self, point: DVec2, from_s: f64, to_s: f64) -> CurveProjection {
        let (from_s, to_s) = (from_s.clamp(0.0, self.length()), to_s.clamp(0.0, self.length()));
        let (first, last) = (self.segment_index_at(from_s), self.segment_index_at(to_s));
        let mut best: Option<CurveProjection> = None;
        for index in first..=last {
            let (segment, station) = (&self.segments[index], self.stations[index]);
            let from_here = (from_s - station).clamp(0.0, segment.length);
            let to_here = (to_s - station).clamp(from_here, segment.length);
            let foot = segment.project_within(point, from_here, to_here);
            if best.is_none_or(|best| foot.distance < best.distance) {
                best = Some(CurveProjection { s: station + foot.s, ..foot });
            }
        }
        best.unwrap_or(CurveProjection { s: from_s, lateral: 0.0, distance: f64::INFINITY })
    }

    /// The curve in the opposite direction.
    pub fn reversed(&self) -> Self {
        Self::new(self.segments.iter().rev().map(Segment::reversed).collect())
    }

    /// The part between two arc lengths, `from_s < to_s`, both on the curve.
    pub fn slice(&self, from_s: f64, to_s: f64) -> Self {
        let (from_s, to_s) = (from_s.max(0.0), to_s.min(self.length()));
        let mut segments = Vec::new();
        for (segment, &station) in self.segments.iter().zip(&self.stations) {
            let a = (from_s - station).max(0.0);
            let b = (to_s - station).min(segment.length);
            if b - a > 1e-12 {
                segments.push(Segment::new(segment.pose_at(a), b - a, segment.curvature));
            }
        }
        if segments.is_empty() {
            segments.push(Segment::new(self.at(from_s).pose, 0.0, 0.0));
        }
        Self::new(segments)
    }

    /// Samples at most `step` apart, both ends included; segment joints are hit exactly.
    pub fn sample(&self, step: f64) -> Vec<(f64, CurvePoint<F>)> {
        let mut points = Vec::new();
        for (segment, &station) in self.segments.iter().zip(&self.stations) {
            let pieces = (segment.length / step).ceil().max(1.0) as usize;
            for piece in 0..pieces {
                let s = segment.length * piece as f64 / pieces as f64;
                points.push((
                    station + s,
                    CurvePoint { pose: segment.pose_at(s), curvature: segment.curvature },
                ));
            }
        }
        let last = self.segments[self.segments.len() - 1];
        points.push((self.length(), CurvePoint { pose: last.end(), curvature: last.curvature }));
        points
    }

    /// The tightest radius between two arc lengths; infinite where the curve is straight.
    pub fn min_radius(&self, from_s: f64, to_s: f64) -> f64 {
        let (first, last) = (self.segment_index_at(from_s), self.segment_index_at(to_s));
        let tightest = self.segments[first..=last].iter().map(|s| s.curvature.abs()).fold(0.0, f64::max);
        if tightest > 0.0 { 1.0 / tightest } else { f64::INFINITY }
    }
}

impl Curve<Lab> {
    /// The same curve in the city.
    pub fn to_city(&self, scale: LengthScale) -> Curve<City> {
        let factor = scale.factor();
        let scaled =
            |s: &Segment<Lab>| Segment::new(s.start.to_city(scale), s.length * factor, s.curvature / factor);
        Curve::new(self.segments.iter().map(scaled).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{FRAC_PI_2, PI};

    fn corner<F: Frame>() -> Curve<F> {
        Curve::new(vec![
            Segment::line(DVec2::ZERO, DVec2::new(2.0, 0.0)),
            Segment::arc(DVec2::new(2.0, 1.0), 1.0, -FRAC_PI_2, FRAC_PI_2),
            Segment::line(DVec2::new(3.0, 1.0), DVec2::new(3.0, 4.0)),
        ])
    }

    #[test]
    fn points_follow_line_arc_line() {
        let curve: Curve = corner();
        assert!((curve.length() - (5.0 + FRAC_PI_2)).abs() < 1e-12);
        let on_arc = curve.at(2.0 + FRAC_PI_2 / 2.0);
        assert!((on_arc.pose.yaw_rad - PI / 4.0).abs() < 1e-12);
        assert_eq!(on_arc.curvature, 1.0);
        assert!(curve.end().position.distance(DVec2::new(3.0, 4.0)) < 1e-12);
        assert!(curve.at(-1.0).pose.position.distance(DVec2::new(-1.0, 0.0)) < 1e-12);
        let beyond = curve.at(curve.length() + 1.0).pose.position;
        assert!(beyond.distance(DVec2::new(3.0, 5.0)) < 1e-12);
    }

    #[test]
    fn projection_inverts_the_curve_and_signs_the_side() {
        let curve: Curve = corner();
        for k in 0..=60 {
            let s = curve.length() * f64::from(k) / 60.0;
            for lateral in [-0.3, 0.0, 0.4] {
                let pose = curve.at(s).pose;
                let foot = curve.project(pose.point_at(0.0, lateral));
                assert!((foot.s - s).abs() < 1e-9 && (foot.lateral - lateral).abs() < 1e-9, "{s} {foot:?}");
            }
        }
    }

    #[test]
    fn right_turns_reverse_and_scale() {
        let curve: Curve = corner();
        let back = curve.reversed();
        assert!(back.end().position.distance(DVec2::ZERO) < 1e-12);
        assert_eq!(back.segments()[1].curvature, -1.0);
        let big = corner::<Lab>().to_city(LengthScale::TESTBED);
        assert!((big.length() - 25.0 * curve.length()).abs() < 1e-9);
        assert!((big.min_radius(0.0, big.length()) - 25.0).abs() < 1e-9);
        let part = curve.slice(1.0, 3.0);
        assert!((part.length() - 2.0).abs() < 1e-12);
        assert!(part.end().position.distance(curve.at(3.0).pose.position) < 1e-12);
    }

    #[test]
    fn arcs_of_more_than_half_a_turn_project_all_round() {
        let ring: Segment = Segment::arc(DVec2::ZERO, 2.0, 0.1, 6.0);
        for k in 0..=40 {
            let s = ring.length * f64::from(k) / 40.0;
            assert!((ring.project(ring.pose_at(s).point_at(0.0, 0.2)).s - s).abs() < 1e-9);
        }
    }

    #[test]
    fn of_an_arc_of_several_turns_the_part_that_is_asked_for_is_found() {
        let spiral: Curve = Curve::new(vec![Segment::arc(DVec2::ZERO, 2.0, 0.3, -15.0)]);
        for k in 0..=30 {
            let s = spiral.length() * f64::from(k) / 30.0;
            let foot = spiral.project_within(spiral.at(s).pose.point_at(0.0, 0.2), s - 2.0, s + 2.0);
            assert!((foot.s - s).abs() < 1e-9 && (foot.lateral - 0.2).abs() < 1e-9, "{s} {foot:?}");
            assert!((foot.distance - 0.2).abs() < 1e-9);
        }
    }
}
