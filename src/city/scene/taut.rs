//! Outlines of roads pulled taut: where lanes of junctions that lie close together meet, the union of their
//! outlines swings in and out; those who build kerbs draw one curve.

use super::field::Field;
use glam::DVec2;
use rayon::prelude::*;

/// Between the points of an outline that is pulled.
const STEP_M: f64 = 0.4;
/// How often each point moves halfway to the middle of its neighbours: swings shorter than about
/// `STEP_M` times the root of this are evened out.
const ROUNDS: usize = 50;
/// Shorter outlines are those of islands, which would shrink.
const LEAST_M: f64 = 45.0;
/// An outline moves no farther than this.
const FARTHEST_M: f64 = 1.6;

/// Rings with the road to their left, pulled taut into what is beside it: lanes stay within, as `lanes` has the
/// distance to them, and points stay where they are rather than move to where it `is_taken`.
pub(super) fn taut(
    rings: &[Vec<DVec2>],
    lanes: &Field,
    is_taken: impl Fn(DVec2) -> bool + Sync,
) -> Vec<Vec<DVec2>> {
    rings.par_iter().map(|ring| pulled(ring, lanes, &is_taken)).collect()
}

fn pulled(ring: &[DVec2], lanes: &Field, is_taken: &impl Fn(DVec2) -> bool) -> Vec<DVec2> {
    let at_first = even(ring);
    if at_first.len() < (LEAST_M / STEP_M) as usize {
        return ring.to_vec();
    }
    let count = at_first.len();
    let mut points = at_first.clone();
    for _ in 0..ROUNDS {
        let mut before = points[count - 1];
        for k in 0..count {
            let (here, after) = (points[k], points[(k + 1) % count]);
            let mut to = here + ((before + after) / 2.0 - here) / 2.0;
            let into = lanes.at(to);
            if into < 0.0 {
                to += slope(lanes, to) * f64::from(-into);
            }
            before = here;
            if to.distance(at_first[k]) < FARTHEST_M && !is_taken(to) {
                points[k] = to;
            }
        }
    }
    points
}

/// The direction in which a field grows.
fn slope(field: &Field, at: DVec2) -> DVec2 {
    const REACH_M: f64 = 0.2;
    let along = |step: DVec2| f64::from(field.at(at + step)) - f64::from(field.at(at - step));
    DVec2::new(along(DVec2::X * REACH_M), along(DVec2::Y * REACH_M)).try_normalize().unwrap_or(DVec2::ZERO)
}

/// Points on a ring at even distances of about [`STEP_M`].
fn even(ring: &[DVec2]) -> Vec<DVec2> {
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
    fn lanes() -> Field {
        let mut field = Field::new([DVec2::new(-40.0, -12.0), DVec2::new(40.0, 12.0)], 0.25);
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
        let points = even(ring);
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
        let ring = lanes.rings(0.0);
        assert_eq!(ring.len(), 1);
        let pulled = taut(&ring, &lanes, |_| false);
        let (was, is) = (sharpest(&ring[0]), sharpest(&pulled[0]));
        assert!(was > 0.9 && is < 0.45, "{was} {is}");
        for &p in &pulled[0] {
            assert!(lanes.at(p) > -0.03, "{p} is {} in", lanes.at(p));
        }
        let moved = even(&ring[0]).iter().zip(&pulled[0]).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max);
        assert!(moved < FARTHEST_M, "{moved}");
    }

    #[test]
    fn nothing_is_pulled_over_what_stands_there() {
        let lanes = lanes();
        let post = DVec2::new(0.0, 4.2);
        let pulled = taut(&lanes.rings(0.0), &lanes, |p| p.distance(post) < 0.8);
        let nearest = pulled[0].iter().map(|p| p.distance(post)).fold(f64::INFINITY, f64::min);
        assert!(nearest > 0.79, "{nearest}");
    }
}
