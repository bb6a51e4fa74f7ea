//! Extrusion of polygons to convex solids.

use super::vector;
use city3d_geometry::point_in_polygon;
use glam::DVec2;
use rapier3d_f64::math::{Pose, Vector};
use rapier3d_f64::prelude::SharedShape;

/// Extrudes a simple polygon from the ground up: one convex solid, or one for each triangle of a concave
/// outline. `None` for an outline without area.
pub(super) fn extruded(polygon: &[DVec2], height_m: f64) -> Option<SharedShape> {
    if !polygon.iter().all(|corner| corner.is_finite()) || !height_m.is_finite() || height_m <= 0.0 {
        return None;
    }
    let mut corners = polygon.to_vec();
    corners.dedup_by(|a, b| a.distance_squared(*b) < 1e-6);
    if corners.len() > 1 && corners[0].distance_squared(corners[corners.len() - 1]) < 1e-6 {
        corners.pop();
    }
    let area = doubled_area(&corners);
    if corners.len() < 3 || area.abs() < 1e-4 {
        return None;
    }
    if area < 0.0 {
        corners.reverse();
    }
    let convex = (0..corners.len()).all(|k| turn(&corners, k) >= -1e-9);
    if convex {
        return prism(&corners, height_m);
    }
    let pieces: Vec<_> = triangles(&corners)
        .iter()
        .filter_map(|triangle| prism(triangle, height_m))
        .map(|shape| (Pose::IDENTITY, shape))
        .collect();
    (!pieces.is_empty()).then(|| SharedShape::compound(pieces))
}

fn prism(corners: &[DVec2], height_m: f64) -> Option<SharedShape> {
    let points: Vec<Vector> = corners
        .iter()
        .flat_map(|corner| [vector(corner.extend(0.0)), vector(corner.extend(height_m))])
        .collect();
    SharedShape::convex_hull(&points)
}

fn doubled_area(corners: &[DVec2]) -> f64 {
    (0..corners.len()).map(|k| corners[k].perp_dot(corners[(k + 1) % corners.len()])).sum()
}

/// Positive at a convex corner of a counter-clockwise outline.
fn turn(corners: &[DVec2], k: usize) -> f64 {
    let n = corners.len();
    let (before, here, after) = (corners[(k + n - 1) % n], corners[k], corners[(k + 1) % n]);
    (here - before).perp_dot(after - here)
}

/// Triangulates a simple counter-clockwise polygon by ear clipping.
fn triangles(polygon: &[DVec2]) -> Vec<[DVec2; 3]> {
    let mut rest = polygon.to_vec();
    let mut triangles = Vec::new();
    while rest.len() > 3 {
        let n = rest.len();
        let ear = (0..n).find(|&k| {
            let triangle = [rest[(k + n - 1) % n], rest[k], rest[(k + 1) % n]];
            turn(&rest, k) > 1e-12
                && rest.iter().all(|p| triangle.contains(p) || !point_in_polygon(*p, &triangle))
        });
        // A self-intersecting outline runs out of ears; its rest is dropped.
        let Some(k) = ear else {
            match (0..n).find(|&k| turn(&rest, k).abs() <= 1e-12) {
                Some(flat) => {
                    rest.remove(flat);
                    continue;
                }
                None => return triangles,
            }
        };
        triangles.push([rest[(k + n - 1) % n], rest[k], rest[(k + 1) % n]]);
        rest.remove(k);
    }
    if let [a, b, c] = rest[..] {
        triangles.push([a, b, c]);
    }
    triangles
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_triangles_of_a_concave_outline_cover_its_area() {
        let outline =
            [(0.0, 0.0), (6.0, 0.0), (6.0, 4.0), (4.0, 4.0), (4.0, 1.0), (2.0, 1.0), (2.0, 4.0), (0.0, 4.0)]
                .map(DVec2::from);
        let triangles = triangles(&outline);
        let covered: f64 = triangles.iter().map(|t| doubled_area(t)).sum();
        assert!((covered - doubled_area(&outline)).abs() < 1e-9);
        assert_eq!(triangles.len(), outline.len() - 2);
        assert!(extruded(&outline, 3.0).is_some_and(|shape| shape.as_compound().is_some()));
        assert!(extruded(&outline[..3], 3.0).is_some_and(|shape| shape.as_compound().is_none()));
    }
}
