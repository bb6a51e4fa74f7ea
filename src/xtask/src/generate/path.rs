//! Builds centre lines from tangent lines and arcs, and fillets between them.

use city3d_geometry::lab::{Curve, Pose2, Segment};
use city3d_geometry::trig;
use glam::DVec2;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

pub(super) const EAST: f64 = 0.0;
pub(super) const NORTH: f64 = FRAC_PI_2;
pub(super) const WEST: f64 = PI;
pub(super) const SOUTH: f64 = -FRAC_PI_2;
pub(super) const QUARTER: f64 = FRAC_PI_2;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum TurnDirection {
    Left,
    Right,
}

impl TurnDirection {
    /// Left-positive.
    pub(super) fn sign(self) -> f64 {
        match self {
            Self::Left => 1.0,
            Self::Right => -1.0,
        }
    }

    fn opposite(self) -> Self {
        match self {
            Self::Left => Self::Right,
            Self::Right => Self::Left,
        }
    }
}

/// Builds a centre line from tangent pieces, each starting at the end pose of the one before.
#[derive(Clone, Debug)]
pub(super) struct CurveBuilder {
    at: Pose2,
    segments: Vec<Segment>,
}

impl CurveBuilder {
    pub(super) fn at(x: f64, y: f64, yaw_rad: f64) -> Self {
        Self { at: Pose2::new(x, y, yaw_rad), segments: Vec::new() }
    }

    fn piece(mut self, length: f64, curvature: f64) -> Self {
        let segment = Segment::new(self.at, length, curvature);
        self.at = segment.end();
        self.segments.push(segment);
        self
    }

    pub(super) fn turn(self, turn: TurnDirection, radius: f64, angle_rad: f64) -> Self {
        self.piece(radius * angle_rad, turn.sign() / radius)
    }

    pub(super) fn left(self, radius: f64, angle_rad: f64) -> Self {
        self.turn(TurnDirection::Left, radius, angle_rad)
    }

    pub(super) fn right(self, radius: f64, angle_rad: f64) -> Self {
        self.turn(TurnDirection::Right, radius, angle_rad)
    }

    /// Straight on to this x.
    pub(super) fn until_x(self, x: f64) -> Self {
        let length = (x - self.at.position.x) / self.at.forward().x;
        self.piece(length, 0.0)
    }

    /// Straight on to this y.
    pub(super) fn until_y(self, y: f64) -> Self {
        let length = (y - self.at.position.y) / self.at.forward().y;
        self.piece(length, 0.0)
    }

    /// Shifts sideways by `lateral` over `length` ahead, in two opposite arcs of equal radius (reverse
    /// curve).
    pub(super) fn shift(self, turn: TurnDirection, length: f64, lateral: f64) -> Self {
        let radius = (length * length + lateral * lateral) / (4.0 * lateral);
        let angle = 2.0 * trig::atan2(lateral, length);
        self.turn(turn, radius, angle).turn(turn.opposite(), radius, angle)
    }

    pub(super) fn curve(self) -> Curve {
        Curve::new(self.segments)
    }
}

/// A full circle, counter-clockwise from the east.
pub(super) fn ring(centre: DVec2, radius: f64) -> Curve {
    Curve::new(vec![Segment::arc(centre, radius, 0.0, TAU)])
}

/// A fillet: an arc tangent to two centre lines.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fillet {
    pub(super) arc: Segment,
    /// Arc length at which it leaves the first centre line.
    pub(super) from_s: f64,
    /// Arc length at which it joins the second centre line.
    pub(super) to_s: f64,
}

impl Fillet {
    pub(super) fn radius(&self) -> f64 {
        1.0 / self.arc.curvature.abs()
    }
}

/// The locus of the centres of all arcs of a radius that are tangent to a segment.
enum Locus {
    Line { point: DVec2, along: DVec2 },
    Circle { centre: DVec2, radius: f64 },
}

impl Locus {
    /// The offset of the segment by the radius towards the inside of the turn.
    fn of(segment: &Segment, turn: TurnDirection, radius: f64) -> Self {
        let offset = turn.sign() * radius;
        let start = segment.start;
        match segment.centre() {
            None => Self::Line { point: start.point_at(0.0, offset), along: start.forward() },
            Some(centre) => Self::Circle { centre, radius: (1.0 / segment.curvature - offset).abs() },
        }
    }

    fn meet(&self, other: &Self) -> Vec<DVec2> {
        match (self, other) {
            (Self::Line { point: p, along: d }, Self::Line { point: q, along: e }) => {
                let cross = d.perp_dot(*e);
                if cross.abs() < 1e-9 { Vec::new() } else { vec![*p + *d * ((*q - *p).perp_dot(*e) / cross)] }
            }
            (Self::Line { point, along }, Self::Circle { centre, radius })
            | (Self::Circle { centre, radius }, Self::Line { point, along }) => {
                let foot = *point + *along * (*centre - *point).dot(*along);
                let half = radius * radius - foot.distance_squared(*centre);
                if half < 0.0 {
                    Vec::new()
                } else {
                    vec![foot - *along * half.sqrt(), foot + *along * half.sqrt()]
                }
            }
            (Self::Circle { centre: a, radius: ra }, Self::Circle { centre: b, radius: rb }) => {
                let Some(along) = (*b - *a).try_normalize() else { return Vec::new() };
                let distance = a.distance(*b);
                let ahead = (distance * distance + ra * ra - rb * rb) / (2.0 * distance);
                let half = ra * ra - ahead * ahead;
                if half < 0.0 {
                    return Vec::new();
                }
                let foot = *a + along * ahead;
                vec![foot - along.perp() * half.sqrt(), foot + along.perp() * half.sqrt()]
            }
        }
    }
}

/// Arc length at which an arc about `centre` touches the segment, if within its ends.
fn touch(segment: &Segment, centre: DVec2, turn: TurnDirection, radius: f64) -> Option<f64> {
    let s = segment.project(centre).s;
    let foot = segment.pose_at(s);
    (foot.point_at(0.0, turn.sign() * radius).distance(centre) < 1e-9).then_some(s)
}

/// The fillet of this radius between two centre lines; of several, the one that turns least. `None` if none
/// fits between their ends.
pub(super) fn fillet(from: &Curve, to: &Curve, turn: TurnDirection, radius: f64) -> Option<Fillet> {
    let mut best: Option<Fillet> = None;
    for (i, a) in from.segments().iter().enumerate() {
        for (j, b) in to.segments().iter().enumerate() {
            for centre in Locus::of(a, turn, radius).meet(&Locus::of(b, turn, radius)) {
                let (Some(s), Some(t)) = (touch(a, centre, turn, radius), touch(b, centre, turn, radius))
                else {
                    continue;
                };
                let (start, end) = (a.pose_at(s), b.pose_at(t));
                let mut sweep = (end.yaw_rad - start.yaw_rad) * turn.sign();
                sweep -= TAU * (sweep / TAU).floor();
                if !(1e-6..1.05 * PI).contains(&sweep) {
                    continue;
                }
                let arc = Segment::new(start, radius * sweep, turn.sign() / radius);
                if best.is_none_or(|b| arc.length < b.arc.length) {
                    best = Some(Fillet { arc, from_s: from.station(i) + s, to_s: to.station(j) + t });
                }
            }
        }
    }
    best
}

/// How the radius of a fillet is determined.
#[derive(Clone, Copy, Debug)]
pub(super) enum Fit {
    Radius(f64),
    /// The radius with which it starts at this point of the first centre line.
    Start(f64, f64),
    /// The radius with which it ends at this point of the second centre line.
    End(f64, f64),
}

/// Range and step of the radius search for a given start or end.
const RADII: (f64, f64) = (0.15, 1.0);
const RADIUS_STEP: f64 = 0.002;

/// The fillet of a fit; a given start or end is met within 1e-9.
pub(super) fn fit(from: &Curve, to: &Curve, turn: TurnDirection, fit: Fit) -> Option<Fillet> {
    let miss = |radius: f64| -> Option<f64> {
        let f = fillet(from, to, turn, radius)?;
        match fit {
            Fit::Radius(_) => Some(0.0),
            Fit::Start(x, y) => Some(f.from_s - from.project(DVec2::new(x, y)).s),
            Fit::End(x, y) => Some(f.to_s - to.project(DVec2::new(x, y)).s),
        }
    };
    if let Fit::Radius(radius) = fit {
        return fillet(from, to, turn, radius);
    }
    let steps = ((RADII.1 - RADII.0) / RADIUS_STEP) as usize;
    let radii = (0..=steps).map(|k| RADII.0 + k as f64 * RADIUS_STEP);
    let tried: Vec<(f64, f64)> = radii.filter_map(|r| Some((r, miss(r)?))).collect();
    let bracket = tried.windows(2).find(|w| (w[0].1 <= 0.0) != (w[1].1 <= 0.0))?;
    let (mut low, mut high) = (bracket[0].0, bracket[1].0);
    let low_side = bracket[0].1 <= 0.0;
    for _ in 0..60 {
        let middle = (low + high) / 2.0;
        if (miss(middle)? <= 0.0) == low_side { low = middle } else { high = middle }
    }
    if miss(low)?.abs() < 1e-9 { fillet(from, to, turn, low) } else { None }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(from: &Curve, to: &Curve, f: &Fillet) {
        let (start, end) = (from.at(f.from_s).pose, to.at(f.to_s).pose);
        assert!(start.position.distance(f.arc.start.position) < 1e-9);
        assert!(end.position.distance(f.arc.end().position) < 1e-9);
        assert!((end.forward() - f.arc.end().forward()).length() < 1e-9);
    }

    #[test]
    fn fillets_touch_lines_and_arcs() {
        let east = CurveBuilder::at(-1.0, 0.0, EAST).until_x(1.0).left(0.5, QUARTER).curve();
        let south = CurveBuilder::at(0.9, 1.0, SOUTH).until_y(-1.0).curve();
        let f = fillet(&east, &south, TurnDirection::Right, 0.3).unwrap();
        check(&east, &south, &f);
        assert!((f.from_s - 1.6).abs() < 1e-12, "{f:?}");
        let north = CurveBuilder::at(1.2, -1.0, NORTH).until_y(2.0).curve();
        let f = fillet(&east, &north, TurnDirection::Left, 0.35).unwrap();
        check(&east, &north, &f);
        let f = fit(&south, &east, TurnDirection::Left, Fit::Start(0.9, 0.3)).unwrap();
        check(&south, &east, &f);
        assert!((f.from_s - 0.7).abs() < 1e-9 && (f.radius() - 0.25).abs() < 1e-9, "{f:?}");
        assert!(
            fillet(&east, &south, TurnDirection::Right, 1.2).is_none(),
            "it would start beyond the end of the street"
        );
    }
}
