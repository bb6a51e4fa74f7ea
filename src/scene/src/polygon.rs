//! Polygons with holes: Boolean operations, simplification, triangulation.

use earcut::{Earcut, Refiner};
use glam::DVec2;
use i_overlay::core::fill_rule::FillRule;
use i_overlay::core::overlay_rule::OverlayRule;
use i_overlay::float::simplify::SimplifyShape;
use i_overlay::float::single::SingleFloatOverlay;
use i_overlay::float::slice::FloatSlice;
use i_overlay::mesh::float::outline::offset::OutlineOffset;
use i_overlay::mesh::float::style::OutlineStyle;

/// A region of the plane: the outer ring counter-clockwise, holes clockwise.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Region {
    /// City metres, the first corner not repeated.
    pub outer: Vec<DVec2>,
    /// One ring for each hole, as [`Self::outer`].
    pub holes: Vec<Vec<DVec2>>,
}

/// Twice the signed area, positive counter-clockwise.
pub fn doubled_area(ring: &[DVec2]) -> f64 {
    ring.iter().enumerate().map(|(k, a)| a.perp_dot(ring[(k + 1) % ring.len()])).sum()
}

/// The ring in counter-clockwise order.
pub fn counter_clockwise(ring: &[DVec2]) -> Vec<DVec2> {
    let mut ring = ring.to_vec();
    if doubled_area(&ring) < 0.0 {
        ring.reverse();
    }
    ring
}

/// The outward mitre vector at a corner of a counter-clockwise ring: longer than 1, so that an offset band
/// keeps its width.
pub(super) fn mitre(ring: &[DVec2], corner: usize) -> DVec2 {
    let count = ring.len();
    let at = |k: usize| ring[k % count];
    let along = |from: DVec2, to: DVec2| (to - from).try_normalize().unwrap_or(DVec2::X);
    let before = along(at(corner + count - 1), at(corner));
    let after = along(at(corner), at(corner + 1));
    let mean = (before + after).try_normalize().unwrap_or(before);
    -mean.perp() / mean.dot(before).max(0.4)
}

/// Line simplification by Douglas and Peucker 1973: drops points within `tolerance` of the line through those
/// kept.
pub fn simplify_ring(ring: &[DVec2], tolerance: f64) -> Vec<DVec2> {
    if ring.len() < 5 {
        return ring.to_vec();
    }
    // Split at the two points farthest apart from the first, so that both halves are open lines.
    let far = (1..ring.len())
        .max_by(|&a, &b| ring[a].distance_squared(ring[0]).total_cmp(&ring[b].distance_squared(ring[0])))
        .unwrap_or(ring.len() / 2);
    let mut closed = ring[far..].to_vec();
    closed.push(ring[0]);
    let mut out = simplify_line(&ring[..=far], tolerance);
    out.pop();
    out.extend(simplify_line(&closed, tolerance));
    out.pop();
    out
}

/// [`simplify_ring`] for an open line.
pub(super) fn simplify_line(line: &[DVec2], tolerance: f64) -> Vec<DVec2> {
    let (first, last) = (line[0], line[line.len() - 1]);
    let chord = (last - first).try_normalize();
    let off = |p: DVec2| match chord {
        Some(chord) => chord.perp_dot(p - first).abs(),
        None => p.distance(first),
    };
    let worst = (1..line.len() - 1).max_by(|&a, &b| off(line[a]).total_cmp(&off(line[b])));
    match worst {
        Some(k) if off(line[k]) > tolerance => {
            let mut out = simplify_line(&line[..=k], tolerance);
            out.pop();
            out.extend(simplify_line(&line[k..], tolerance));
            out
        }
        _ => vec![first, last],
    }
}

/// Regions in the format of the overlay library.
type Shapes = Vec<Vec<Vec<[f64; 2]>>>;

fn shapes(regions: &[Region]) -> Shapes {
    regions.iter().map(Region::contours).collect()
}

fn regions(shapes: Shapes) -> Vec<Region> {
    let ring = |contour: Vec<[f64; 2]>| contour.into_iter().map(DVec2::from).collect::<Vec<_>>();
    shapes
        .into_iter()
        .filter_map(|shape| {
            let mut rings = shape.into_iter().map(ring);
            Some(Region { outer: rings.next()?, holes: rings.collect() })
        })
        .collect()
}

/// Union of rings in either order, inset by a margin (polygon offsetting).
pub(super) fn inset_union<'r>(rings: impl IntoIterator<Item = &'r [DVec2]>, inset: f64) -> Vec<Region> {
    let simple: Vec<Region> = rings.into_iter().map(Region::simple).collect();
    let together = shapes(&simple).simplify_shape_as::<i64>(FillRule::NonZero);
    regions(together.outline_as::<i64>(&OutlineStyle::new(-inset)))
}

/// Boolean difference of regions.
pub(super) fn without(kept: &[Region], covered: &[Region]) -> Vec<Region> {
    regions(shapes(kept).overlay_as::<i64>(&shapes(covered), OverlayRule::Difference, FillRule::NonZero))
}

impl Region {
    /// The outer ring, then those of the holes.
    fn contours(&self) -> Vec<Vec<[f64; 2]>> {
        let contour = |ring: &Vec<DVec2>| ring.iter().map(DVec2::to_array).collect::<Vec<_>>();
        std::iter::once(&self.outer).chain(&self.holes).map(contour).collect()
    }

    /// A region without holes from a ring in either order.
    pub fn simple(ring: &[DVec2]) -> Self {
        Self { outer: counter_clockwise(ring), holes: Vec::new() }
    }

    /// Splits the region at the cells of a grid with a node at the origin. Triangles of a cell stay compact,
    /// while those of a city-wide region are slivers.
    pub fn in_squares(&self, edge: f64) -> Vec<Self> {
        let corners = || self.outer.iter().copied();
        let (low, high) =
            (corners().fold(DVec2::INFINITY, DVec2::min), corners().fold(-DVec2::INFINITY, DVec2::max));
        let between = |axis: usize| {
            let first = (low[axis] / edge).floor() as i64 + 1;
            (first..).map(|k| k as f64 * edge).take_while(move |&at| at < high[axis])
        };
        let (low, high) = (low - edge, high + edge);
        let lines: Vec<Vec<[f64; 2]>> = between(0)
            .map(|x| vec![[x, low.y], [x, high.y]])
            .chain(between(1).map(|y| vec![[low.x, y], [high.x, y]]))
            .collect();
        if lines.is_empty() {
            return vec![self.clone()];
        }
        regions(self.contours().slice_by_as::<i64>(&lines, FillRule::EvenOdd))
    }

    /// Constrained Delaunay triangulation: ear clipping, then Lawson edge flips. Corners are
    /// counter-clockwise.
    pub fn triangulate(&self) -> Vec<[DVec2; 3]> {
        let mut points: Vec<[f64; 2]> = self.outer.iter().map(DVec2::to_array).collect();
        let mut starts: Vec<u32> = Vec::new();
        for hole in self.holes.iter().filter(|hole| hole.len() > 2) {
            starts.push(points.len() as u32);
            points.extend(hole.iter().map(DVec2::to_array));
        }
        let mut corners: Vec<u32> = Vec::new();
        Earcut::new().earcut(points.iter().copied(), &starts, &mut corners);
        // Edge flips shorten edges: on a software adapter edges cost more than the area that they enclose.
        Refiner::new().refine(&mut corners, &points);
        let at = |k: u32| DVec2::from(points[k as usize]);
        let triangles = corners.chunks_exact(3).map(|t| [at(t[0]), at(t[1]), at(t[2])]);
        let upright = triangles.map(|t| if doubled_area(&t) < 0.0 { [t[0], t[2], t[1]] } else { t });
        upright.filter(|t| doubled_area(t) > 1e-12).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(region: &Region) -> f64 {
        region.triangulate().iter().map(|t| doubled_area(t) / 2.0).sum()
    }

    fn square(low: f64, high: f64) -> Vec<DVec2> {
        [(low, low), (high, low), (high, high), (low, high)].map(DVec2::from).to_vec()
    }

    #[test]
    fn triangles_cover_the_region_once() {
        let mut hole = square(1.0, 2.0);
        hole.reverse();
        let mut other = square(2.5, 3.5);
        other.reverse();
        let region = Region { outer: square(0.0, 4.0), holes: vec![hole, other] };
        assert!((area(&region) - 14.0).abs() < 1e-9, "{}", area(&region));
        assert!(region.triangulate().iter().all(|t| doubled_area(t) > 0.0));
    }

    #[test]
    fn a_star_with_a_round_hole() {
        let ring = |n: usize, r: fn(usize) -> f64| -> Vec<DVec2> {
            (0..n)
                .map(|k| {
                    let (sin, cos) =
                        city3d_geometry::trig::sin_cos(std::f64::consts::TAU * k as f64 / n as f64);
                    DVec2::new(cos, sin) * r(k)
                })
                .collect()
        };
        let outer = ring(40, |k| if k % 2 == 0 { 10.0 } else { 6.0 });
        let mut hole = ring(33, |_| 3.0);
        hole.reverse();
        let want = (doubled_area(&outer) + doubled_area(&hole)) / 2.0;
        let region = Region { outer, holes: vec![hole] };
        assert!((area(&region) - want).abs() < 1e-9);
    }

    #[test]
    fn squares_hold_the_region_among_them() {
        // A frame around a hole that lies across several squares.
        let mut hole = square(1.0, 7.5);
        hole.reverse();
        let region = Region { outer: square(-2.0, 9.0), holes: vec![hole] };
        let parts = region.in_squares(2.0);
        let sum: f64 = parts.iter().map(area).sum();
        assert!((sum - (121.0 - 42.25)).abs() < 1e-6, "{sum}");
        let mut squares: Vec<_> = parts
            .iter()
            .map(|part| {
                let low = part.outer.iter().copied().fold(DVec2::INFINITY, DVec2::min);
                let high = part.outer.iter().copied().fold(-DVec2::INFINITY, DVec2::max);
                let square = (low / 2.0 + 1e-6).floor();
                assert!((high / 2.0 - 1e-6).floor() == square, "{part:?}");
                square.as_ivec2().to_array()
            })
            .collect();
        squares.sort_unstable();
        squares.dedup();
        // Of 6 by 6 squares the hole fills the middle 3 by 3 but for the last row and column.
        assert_eq!(squares.len(), 36 - 4, "{squares:?}");
        assert_eq!(Region::simple(&square(0.2, 0.9)).in_squares(2.0).len(), 1);
    }

    #[test]
    fn what_is_covered_is_cut_out_but_for_a_rim() {
        // Two touching rings of opposite order on a larger one.
        let rectangle = |low: [f64; 2], high: [f64; 2]| {
            [low, [high[0], low[1]], high, [low[0], high[1]]].map(DVec2::from).to_vec()
        };
        let (a, mut b) = (rectangle([0.0, 0.0], [4.0, 3.0]), rectangle([3.99, 0.0], [8.0, 3.0]));
        b.reverse();
        let covered = inset_union([&a[..], &b[..]], 0.5);
        assert_eq!(covered.len(), 1);
        assert!((area(&covered[0]) - 7.0 * 2.0).abs() < 1e-3, "{covered:?}");
        let kept = without(&[Region::simple(&rectangle([-2.0, -2.0], [10.0, 5.0]))], &covered);
        assert_eq!((kept.len(), kept[0].holes.len()), (1, 1));
        assert!((area(&kept[0]) - (12.0 * 7.0 - 14.0)).abs() < 1e-3, "{kept:?}");
        // Shapes narrower than two insets vanish.
        assert!(inset_union([&rectangle([0.0, 0.0], [9.0, 0.9])[..]], 0.5).is_empty());
    }

    #[test]
    fn simplifying_keeps_corners_and_drops_the_rest() {
        let mut ring = Vec::new();
        for (a, b) in [
            ((0.0, 0.0), (4.0, 0.0)),
            ((4.0, 0.0), (4.0, 4.0)),
            ((4.0, 4.0), (0.0, 4.0)),
            ((0.0, 4.0), (0.0, 0.0)),
        ] {
            for k in 0..10 {
                ring.push(DVec2::from(a).lerp(DVec2::from(b), f64::from(k) / 10.0));
            }
        }
        assert_eq!(simplify_ring(&ring, 0.01).len(), 4);
    }
}
