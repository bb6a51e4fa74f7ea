//! Constrained Laplacian smoothing of road outlines. Where junctions lie close together, the union of their
//! lanes has a wavy outline, while real kerbs are one curve.

use super::field::DistanceField;
use glam::DVec2;
use rayon::prelude::*;

/// Spacing of the resampled outline.
const STEP_M: f64 = 0.4;
/// Smoothing iterations: each moves every point halfway to the mean of its neighbours, which removes waves
/// shorter than about `STEP_M` times the square root of this number.
const ITERATIONS: usize = 50;
/// Shorter outlines are islands, which would shrink.
const MIN_LENGTH_M: f64 = 45.0;
/// Largest displacement of a point.
const MAX_DISPLACEMENT_M: f64 = 1.6;

/// Smooths rings that have the road to their left. Points are projected out of the lanes, whose distance
/// field is `lanes`, and stay where the new position `is_taken`.
pub(super) fn smooth_outlines(
    rings: &[Vec<DVec2>],
    lanes: &DistanceField,
    is_taken: impl Fn(DVec2) -> bool + Sync,
) -> Vec<Vec<DVec2>> {
    rings.par_iter().map(|ring| smooth_outline(ring, lanes, &is_taken)).collect()
}

fn smooth_outline(ring: &[DVec2], lanes: &DistanceField, is_taken: &impl Fn(DVec2) -> bool) -> Vec<DVec2> {
    let original = resampled(ring);
    if original.len() < (MIN_LENGTH_M / STEP_M) as usize {
        return ring.to_vec();
    }
    let count = original.len();
    let mut points = original.clone();
    for _ in 0..ITERATIONS {
        let mut before = points[count - 1];
        for k in 0..count {
            let (here, after) = (points[k], points[(k + 1) % count]);
            let mut to = here + ((before + after) / 2.0 - here) / 2.0;
            let into = lanes.at(to);
            if into < 0.0 {
                to += gradient_direction(lanes, to) * f64::from(-into);
            }
            before = here;
            if to.distance(original[k]) < MAX_DISPLACEMENT_M && !is_taken(to) {
                points[k] = to;
            }
        }
    }
    points
}

/// The normalised gradient of a field.
fn gradient_direction(field: &DistanceField, at: DVec2) -> DVec2 {
    const REACH_M: f64 = 0.2;
    let along = |step: DVec2| f64::from(field.at(at + step)) - f64::from(field.at(at - step));
    DVec2::new(along(DVec2::X * REACH_M), along(DVec2::Y * REACH_M)).try_normalize().unwrap_or(DVec2::ZERO)
}

/// The ring resampled at even distances of about [`STEP_M`].
fn resampled(ring: &[DVec2]) -> Vec<DVec2> {
    let end = |k: usize| ring[(k + 1) % ring.len()];
    let length: f64 = (0..ring.len()).map(|k| ring[k].distance(end(k))).sum();
    let count = (length / STEP_M).ceil().max(3.0) as usize;
    let step = length / count as f64;
    let mut points = Vec::with_capacity(count);
    let mut along = 0.0;
    for (k, &from) in ring.iter().enumerate() {
        let piece = from.distance(end(k));
        while points.len() < count && points.len() as f64 * step < along + piece {
            points.push(from.lerp(end(k), (points.len() as f64 * step - along) / piece));
        }
        along += piece;
    }
    points
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A road along x of half width 3 with two bays in its upper edge, between which a tip of pavement stands.
    fn lanes() -> DistanceField {
        let mut field = DistanceField::new([DVec2::new(-40.0, -12.0), DVec2::new(40.0, 12.0)], 0.25);
        let value = |p: DVec2| {
            let bay = |x: f64| DVec2::new(p.x - x, p.y - 1.0).length() - 4.0;
            let ends = p.x.abs() - 30.0;
            (p.y.abs() - 3.0).max(ends).min(bay(-4.0)).min(bay(4.0))
        };
        field.lower([DVec2::new(-40.0, -12.0), DVec2::new(40.0, 12.0)], |_| -100.0, value);
        field
    }

    /// The sharpest turn of an outline over two metres, where it is within 9 m of the middle.
    fn sharpest(ring: &[DVec2]) -> f64 {
        let points = resampled(ring);
        let count = points.len();
        let turn = |k: usize| {
            let (a, b, c) = (points[(k + count - 3) % count], points[k], points[(k + 3) % count]);
            (b - a).angle_to(c - b).abs()
        };
        (0..count).filter(|&k| points[k].x.abs() < 9.0 && points[k].y > 0.0).map(turn).fold(0.0, f64::max)
    }

    #[test]
    fn a_tip_between_two_bays_is_drawn_back_and_lanes_stay_within() {
        let lanes = lanes();
        let ring = lanes.contours(0.0);
        assert_eq!(ring.len(), 1);
        let smoothed = smooth_outlines(&ring, &lanes, |_| false);
        let (was, is) = (sharpest(&ring[0]), sharpest(&smoothed[0]));
        assert!(was > 0.9 && is < 0.45, "{was} {is}");
        for &p in &smoothed[0] {
            assert!(lanes.at(p) > -0.03, "{p} is {} in", lanes.at(p));
        }
        let moved =
            resampled(&ring[0]).iter().zip(&smoothed[0]).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max);
        assert!(moved < MAX_DISPLACEMENT_M, "{moved}");
    }

    #[test]
    fn nothing_is_pulled_over_what_stands_there() {
        let lanes = lanes();
        let post = DVec2::new(0.0, 4.2);
        let smoothed = smooth_outlines(&lanes.contours(0.0), &lanes, |p| p.distance(post) < 0.8);
        let nearest = smoothed[0].iter().map(|p| p.distance(post)).fold(f64::INFINITY, f64::min);
        assert!(nearest > 0.79, "{nearest}");
    }
}
