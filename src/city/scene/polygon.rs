//! Polygons with holes into triangles, by ear clipping after cutting bridges to the holes
//! (D. Eberly, *Triangulation by Ear Clipping*, 2002).

use glam::DVec2;

/// A region of the plane: the outer ring counter-clockwise, holes clockwise.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Region {
    pub outer: Vec<DVec2>,
    pub holes: Vec<Vec<DVec2>>,
}

/// Twice the signed area, positive counter-clockwise.
pub fn doubled_area(ring: &[DVec2]) -> f64 {
    ring.iter().enumerate().map(|(k, a)| a.perp_dot(ring[(k + 1) % ring.len()])).sum()
}

/// The ring, counter-clockwise.
pub fn counter_clockwise(ring: &[DVec2]) -> Vec<DVec2> {
    let mut ring = ring.to_vec();
    if doubled_area(&ring) < 0.0 {
        ring.reverse();
    }
    ring
}

/// Drops points that lie within `tolerance` of the line through those kept (Douglas, Peucker 1973).
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

/// The same of a line from its first point to its last.
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

impl Region {
    /// A region without holes from a ring in either order.
    pub fn simple(ring: &[DVec2]) -> Self {
        Self { outer: counter_clockwise(ring), holes: Vec::new() }
    }

    /// Triangles that cover the region, corners counter-clockwise.
    pub fn triangulate(&self) -> Vec<[DVec2; 3]> {
        clip_ears(&self.bridged())
    }

    /// One ring that visits every hole over a bridge.
    fn bridged(&self) -> Vec<DVec2> {
        let mut ring = self.outer.clone();
        let mut holes: Vec<&Vec<DVec2>> = self.holes.iter().filter(|h| h.len() > 2).collect();
        let rightmost = |hole: &[DVec2]| hole.iter().map(|p| p.x).fold(f64::NEG_INFINITY, f64::max);
        holes.sort_by(|a, b| rightmost(b).total_cmp(&rightmost(a)));
        for hole in holes {
            let start = (0..hole.len()).max_by(|&a, &b| hole[a].x.total_cmp(&hole[b].x)).unwrap_or(0);
            let Some(at) = visible_corner(&ring, hole[start]) else { continue };
            let mut bridged = ring[..=at].to_vec();
            bridged.extend(hole[start..].iter().chain(&hole[..=start]));
            bridged.extend(&ring[at..]);
            ring = bridged;
        }
        ring
    }
}

/// The corner of the ring that a point sees when it looks along +x.
fn visible_corner(ring: &[DVec2], point: DVec2) -> Option<usize> {
    let mut best: Option<(f64, usize, DVec2)> = None;
    for (k, &a) in ring.iter().enumerate() {
        let b = ring[(k + 1) % ring.len()];
        // Edges of a counter-clockwise ring that go up bound it on the right.
        if a.y <= point.y && b.y >= point.y && b.y > a.y {
            let x = a.x + (point.y - a.y) / (b.y - a.y) * (b.x - a.x);
            if x >= point.x && best.is_none_or(|(least, ..)| x < least) {
                let corner = if a.x > b.x { k } else { (k + 1) % ring.len() };
                best = Some((x, corner, DVec2::new(x, point.y)));
            }
        }
    }
    let (_, corner, hit) = best?;
    // A reflex corner inside the triangle (point, hit, corner) would hide the corner.
    let tip = ring[corner];
    let hidden = |k: &usize| {
        let p = ring[*k];
        p != tip && inside_either_way(p, point, hit, tip) && is_reflex(ring, *k)
    };
    (0..ring.len())
        .filter(hidden)
        .min_by(|&a, &b| {
            let steep = |k: usize| {
                let d = ring[k] - point;
                (d.y.abs() / d.x.max(1e-12), d.length())
            };
            let ((sa, da), (sb, db)) = (steep(a), steep(b));
            sa.total_cmp(&sb).then(da.total_cmp(&db))
        })
        .or(Some(corner))
}

fn is_reflex(ring: &[DVec2], k: usize) -> bool {
    let (before, at, after) = (ring[(k + ring.len() - 1) % ring.len()], ring[k], ring[(k + 1) % ring.len()]);
    (at - before).perp_dot(after - at) <= 0.0
}

fn inside_either_way(p: DVec2, a: DVec2, b: DVec2, c: DVec2) -> bool {
    let (u, v, w) = ((b - a).perp_dot(p - a), (c - b).perp_dot(p - b), (a - c).perp_dot(p - c));
    (u >= 0.0 && v >= 0.0 && w >= 0.0) || (u <= 0.0 && v <= 0.0 && w <= 0.0)
}

fn clip_ears(ring: &[DVec2]) -> Vec<[DVec2; 3]> {
    let count = ring.len();
    if count < 3 {
        return Vec::new();
    }
    let mut next: Vec<usize> = (1..=count).map(|k| k % count).collect();
    let mut previous: Vec<usize> = (0..count).map(|k| (k + count - 1) % count).collect();
    let mut triangles = Vec::with_capacity(count - 2);
    let (mut at, mut left, mut misses) = (0, count, 0);
    while left > 3 {
        let (a, b, c) = (ring[previous[at]], ring[at], ring[next[at]]);
        let turn = (b - a).perp_dot(c - b);
        // After a whole round without an ear only degenerate corners are left: cut the flattest.
        let forced = misses > left;
        let ear = turn > 0.0 && (forced || is_ear(ring, &next, at, [a, b, c]));
        if ear || turn.abs() < 1e-12 || (forced && misses > 2 * left) {
            if turn > 1e-12 {
                triangles.push([a, b, c]);
            }
            next[previous[at]] = next[at];
            previous[next[at]] = previous[at];
            left -= 1;
            misses = 0;
            at = next[next[at]];
        } else {
            misses += 1;
            at = next[at];
        }
    }
    let (a, b, c) = (ring[previous[at]], ring[at], ring[next[at]]);
    if (b - a).perp_dot(c - b) > 1e-12 {
        triangles.push([a, b, c]);
    }
    triangles
}

fn is_ear(ring: &[DVec2], next: &[usize], at: usize, [a, b, c]: [DVec2; 3]) -> bool {
    let (low, high) = (a.min(b).min(c), a.max(b).max(c));
    let mut k = next[next[at]];
    let stop = at;
    while next[k] != stop {
        let p = ring[k];
        if p.x >= low.x && p.x <= high.x && p.y >= low.y && p.y <= high.y && p != a && p != b && p != c {
            let inside = (b - a).perp_dot(p - a) >= 0.0
                && (c - b).perp_dot(p - b) >= 0.0
                && (a - c).perp_dot(p - c) >= 0.0;
            if inside {
                return false;
            }
        }
        k = next[k];
    }
    true
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
                    let (sin, cos) = crate::geom::trig::sin_cos(std::f64::consts::TAU * k as f64 / n as f64);
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
