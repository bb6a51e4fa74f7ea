//! Planar outlines and their overlap (separating axis theorem).

use super::{Frame, Pose2};
use glam::DVec2;

/// An oriented rectangle: the outline of a vehicle seen from above.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct OrientedRect {
    /// Metres of the frame.
    pub centre: DVec2,
    /// Unit vector along the length.
    pub axis: DVec2,
    /// Half the length and half the width.
    pub half: DVec2,
}

/// The penetration of two outlines: their depth along the axis of least overlap.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Overlap {
    /// Metres of the frame, above 0.
    pub depth: f64,
}

impl OrientedRect {
    /// The outline about the middle `pose`: `length` along its heading, `width` across, metres of the frame.
    pub fn new<F: Frame>(pose: Pose2<F>, length: f64, width: f64) -> Self {
        Self { centre: pose.position, axis: pose.forward(), half: DVec2::new(length / 2.0, width / 2.0) }
    }

    /// Front left, rear left, rear right, front right: counter-clockwise.
    pub fn corners(&self) -> [DVec2; 4] {
        let (ahead, left) = (self.axis * self.half.x, self.axis.perp() * self.half.y);
        let c = self.centre;
        [c + ahead + left, c - ahead + left, c - ahead - left, c + ahead - left]
    }

    /// Radius of the circumscribed circle.
    pub fn radius(&self) -> f64 {
        self.half.length()
    }

    /// Overlap with another outline; `None` if the two are apart or only touch.
    pub fn overlap(&self, other: &Self) -> Option<Overlap> {
        let offset = other.centre - self.centre;
        let mut depth = f64::INFINITY;
        for axis in [self.axis, self.axis.perp(), other.axis, other.axis.perp()] {
            let reach = self.reach(axis) + other.reach(axis) - offset.dot(axis).abs();
            if reach <= 0.0 {
                return None;
            }
            depth = depth.min(reach);
        }
        Some(Overlap { depth })
    }

    /// Distance between two outlines; 0 if they overlap.
    pub fn distance(&self, other: &Self) -> f64 {
        if self.overlap(other).is_some() {
            return 0.0;
        }
        // The distance of disjoint convex polygons is attained at a corner of one of them.
        let to = |rect: &Self, point: DVec2| {
            let offset = point - rect.centre;
            let beside = DVec2::new(offset.dot(rect.axis), offset.dot(rect.axis.perp())).abs() - rect.half;
            beside.max(DVec2::ZERO).length()
        };
        let ours = self.corners().into_iter().map(|corner| to(other, corner));
        let theirs = other.corners().into_iter().map(|corner| to(self, corner));
        ours.chain(theirs).fold(f64::INFINITY, f64::min)
    }

    /// Overlap with a convex polygon given by its corners in order.
    pub fn overlap_convex(&self, polygon: &[DVec2]) -> Option<Overlap> {
        let edges = (0..polygon.len()).filter_map(|k| {
            let edge = polygon[(k + 1) % polygon.len()] - polygon[k];
            edge.try_normalize().map(DVec2::perp)
        });
        let mut depth = f64::INFINITY;
        for axis in [self.axis, self.axis.perp()].into_iter().chain(edges) {
            let middle = self.centre.dot(axis);
            let (low, high) = polygon
                .iter()
                .map(|p| p.dot(axis) - middle)
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)));
            let half = self.reach(axis);
            let reach = (half - low).min(high + half);
            if reach <= 0.0 {
                return None;
            }
            depth = depth.min(reach);
        }
        Some(Overlap { depth })
    }

    /// Overlap with any simple polygon, convex or not.
    pub fn overlaps_polygon(&self, polygon: &[DVec2]) -> bool {
        let corners = self.corners();
        let inside_self = |p: DVec2| {
            let offset = p - self.centre;
            offset.dot(self.axis).abs() < self.half.x && offset.dot(self.axis.perp()).abs() < self.half.y
        };
        polygon.iter().any(|&p| inside_self(p))
            || corners.iter().any(|&c| point_in_polygon(c, polygon))
            || (0..polygon.len()).any(|k| {
                let (a, b) = (polygon[k], polygon[(k + 1) % polygon.len()]);
                (0..4).any(|j| segments_cross(a, b, corners[j], corners[(j + 1) % 4]))
            })
    }

    fn reach(&self, axis: DVec2) -> f64 {
        self.half.x * self.axis.dot(axis).abs() + self.half.y * self.axis.perp_dot(axis).abs()
    }
}

/// Whether two segments cross in their interiors.
fn segments_cross(a: DVec2, b: DVec2, c: DVec2, d: DVec2) -> bool {
    let side = |p: DVec2, q: DVec2, r: DVec2| (q - p).perp_dot(r - p);
    side(a, b, c) * side(a, b, d) < 0.0 && side(c, d, a) * side(c, d, b) < 0.0
}

/// The convex hull of points, counter-clockwise (monotone chain, Andrew 1979).
pub fn convex_hull(points: &[DVec2]) -> Vec<DVec2> {
    let mut sorted = points.to_vec();
    sorted.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    sorted.dedup();
    if sorted.len() < 3 {
        return sorted;
    }
    let half = |points: &mut dyn Iterator<Item = DVec2>| {
        let mut chain: Vec<DVec2> = Vec::new();
        for p in points {
            while chain.len() >= 2 {
                let (a, b) = (chain[chain.len() - 2], chain[chain.len() - 1]);
                if (b - a).perp_dot(p - a) > 0.0 {
                    break;
                }
                chain.pop();
            }
            chain.push(p);
        }
        chain.pop();
        chain
    };
    let mut hull = half(&mut sorted.iter().copied());
    hull.extend(half(&mut sorted.iter().rev().copied()));
    hull
}

/// Whether a simple polygon contains a point (even-odd rule).
pub fn point_in_polygon(point: DVec2, polygon: &[DVec2]) -> bool {
    let mut inside = false;
    for (k, &a) in polygon.iter().enumerate() {
        let b = polygon[(k + 1) % polygon.len()];
        if (a.y > point.y) != (b.y > point.y) {
            let x = a.x + (point.y - a.y) / (b.y - a.y) * (b.x - a.x);
            inside ^= point.x < x;
        }
    }
    inside
}

#[cfg(test)]
mod tests {
    use super::*;

    fn car(x: f64, y: f64, yaw: f64) -> OrientedRect {
        OrientedRect::new(Pose2::<crate::City>::new(x, y, yaw), 5.0, 2.5)
    }

    #[test]
    fn rectangles_touch_at_their_edges_only() {
        assert!(car(0.0, 0.0, 0.0).overlap(&car(5.01, 0.0, 0.0)).is_none());
        let overlap = car(0.0, 0.0, 0.0).overlap(&car(4.9, 0.0, 0.0)).unwrap();
        assert!((overlap.depth - 0.1).abs() < 1e-12);
        // Corner to side: the bounding circles meet and the outlines do not.
        assert!(
            car(0.0, 0.0, 0.0).overlap(&car(4.4, 1.9, std::f64::consts::FRAC_PI_4)).is_none()
                || car(4.4, 1.9, std::f64::consts::FRAC_PI_4)
                    .corners()
                    .iter()
                    .any(|c| c.x < 2.5 && c.y < 1.25)
        );
    }

    #[test]
    fn convex_walls_are_hit_from_either_side() {
        let wall = [DVec2::new(3.0, -5.0), DVec2::new(3.5, -5.0), DVec2::new(3.5, 5.0), DVec2::new(3.0, 5.0)];
        assert!(car(0.4, 0.0, 0.0).overlap_convex(&wall).is_none());
        assert!(car(0.6, 0.0, 0.0).overlap_convex(&wall).is_some());
        assert!(car(5.9, 0.0, 3.0).overlap_convex(&wall).is_some());
        assert!(car(6.3, 0.0, 0.0).overlap_convex(&wall).is_none());
    }

    #[test]
    fn the_hull_drops_inner_points() {
        let points =
            [(0.0, 0.0), (2.0, 0.0), (1.0, 0.5), (2.0, 2.0), (0.0, 2.0), (1.0, 1.0)].map(DVec2::from);
        assert_eq!(convex_hull(&points).len(), 4);
        assert!(point_in_polygon(DVec2::new(1.0, 1.5), &convex_hull(&points)));
        assert!(!point_in_polygon(DVec2::new(3.0, 1.5), &convex_hull(&points)));
    }
}
