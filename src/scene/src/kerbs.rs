//! Kerbs along the outline of the asphalt, lowered at driveways.

use super::ground_sheet::KERB_M;
use super::grounds::{covers, ring_of};
use super::outlines::Corner;
use super::polygon::mitre;
use city3d_roadmap::Footprint;
use glam::DVec2;

/// Height of kerbstones, and of lowered ones.
const TOP_M: f32 = KERB_M + 0.006;
const LOWERED_M: f32 = 0.03;
/// Width of the stones.
pub(super) const WIDTH_M: f64 = 0.20;
/// Length of the ramp from full height to lowered stones.
const RAMP_M: f64 = 0.9;
/// Length of the pavement ramp behind lowered stones.
const APRON_M: f64 = 1.3;
/// Largest distance between a driveway and the face of the kerb.
const DRIVE_WITHIN_M: f64 = 3.0;
/// The backs of lowered stones are at most so far from their faces.
const BACK_WITHIN_M: f64 = 2.0 * WIDTH_M;

/// A closed kerb, the road to its left: corners and their arc lengths.
pub(super) struct Kerb {
    ring: Vec<DVec2>,
    stations: Vec<f64>,
    /// Lowered intervals.
    lowered: Vec<[f64; 2]>,
}

/// A stretch of lowered kerb with its ramps: its faces, and how much of the height is gone at each corner.
pub(super) struct Fall {
    line: Vec<(DVec2, f32)>,
}

impl Kerb {
    /// The kerb of an outline, lowered at these driveways.
    pub(super) fn new(ring: &[DVec2], drives: &[&Footprint]) -> Self {
        let drives: Vec<Driveway<'_>> = drives.iter().map(|shape| Driveway::new(shape)).collect();
        let is_far = |p: &DVec2| drives.iter().all(|drive| !drive.is_near(*p));
        // Starts far from all driveways, so that no interval wraps around.
        let mut ring = ring.to_vec();
        let first = ring.iter().position(is_far);
        ring.rotate_left(first.unwrap_or(0));
        let count = ring.len();
        let lowered = lowered(&ring, &drives);
        let bends: Vec<f64> = lowered.iter().flat_map(|&[a, b]| [a - RAMP_M, a, b, b + RAMP_M]).collect();
        let (mut corners, mut stations) = (Vec::new(), Vec::new());
        let mut along = 0.0;
        for k in 0..count {
            let (from, to) = (ring[k], ring[(k + 1) % count]);
            let length = from.distance(to);
            corners.push(from);
            stations.push(along);
            for &s in bends.iter().filter(|&&s| s > along + 1e-3 && s < along + length - 1e-3) {
                corners.push(from.lerp(to, (s - along) / length));
                stations.push(s);
            }
            along += length;
        }
        Self { ring: corners, stations, lowered }
    }

    /// How much of the height is gone at a corner, from 0 to 1.
    fn fall_at(&self, corner: usize) -> f32 {
        let s = self.stations[corner];
        let share = self.lowered.iter().map(|&[a, b]| ((a - s).max(s - b) / RAMP_M).clamp(0.0, 1.0));
        1.0 - share.fold(1.0, f64::min) as f32
    }

    /// Corners of each lowered interval with its ramps.
    fn fallen(&self) -> impl Iterator<Item = Vec<usize>> {
        self.lowered.iter().map(|&[a, b]| {
            let within = a - RAMP_M - 1e-3..=b + RAMP_M + 1e-3;
            (0..self.ring.len()).filter(|&k| within.contains(&self.stations[k])).collect()
        })
    }

    /// Its lowered stretches.
    pub(super) fn falls(&self) -> impl Iterator<Item = Fall> {
        self.fallen().map(|corners| Fall {
            line: corners.into_iter().map(|k| (self.ring[k], self.fall_at(k))).collect(),
        })
    }

    /// The upper edge of its faces; corners where it falls are at every level of detail.
    pub(super) fn face_corners(&self) -> Vec<Corner> {
        let kept: Vec<usize> = self.fallen().flatten().collect();
        let corner = |(k, &at): (usize, &DVec2)| Corner {
            at,
            height_m: TOP_M - (TOP_M - LOWERED_M) * self.fall_at(k),
            is_kept: kept.contains(&k),
        };
        self.ring.iter().enumerate().map(corner).collect()
    }

    /// Where the pavement behind lowered stones has come back to its height.
    pub(super) fn apron_backs(&self) -> impl Iterator<Item = DVec2> {
        self.fallen().flatten().map(|k| self.ring[k] + mitre(&self.ring, k) * APRON_M)
    }
}

/// The backs of kerbstones as a ring, lowered along these falls.
pub(super) fn back_corners(ring: &[DVec2], falls: &[Fall]) -> Vec<Corner> {
    let mut corners: Vec<Corner> = Vec::new();
    for (k, &from) in ring.iter().enumerate() {
        let to = ring[(k + 1) % ring.len()];
        corners.push(Corner { at: from, height_m: KERB_M, is_kept: false });
        // A corner beside each one of a fall.
        let along = to - from;
        let beside = falls.iter().filter(|fall| fall.is_near(from, to)).flat_map(|fall| &fall.line);
        let mut shares: Vec<f64> = beside
            .map(|(at, _)| ((*at - from).dot(along) / along.length_squared().max(1e-12), *at))
            .filter(|(share, at)| {
                (0.0..1.0).contains(share) && from.lerp(to, *share).distance(*at) < BACK_WITHIN_M
            })
            .map(|(share, _)| share)
            .collect();
        shares.sort_by(f64::total_cmp);
        let bends = shares.into_iter().map(|share| Corner {
            at: from.lerp(to, share),
            height_m: KERB_M,
            is_kept: true,
        });
        corners.extend(bends);
    }
    for corner in &mut corners {
        corner.height_m = pavement_height(falls, corner.at);
        corner.is_kept |= corner.height_m < KERB_M;
    }
    corners
}

/// Height of the pavement at a place, with ramps down to lowered stones.
pub(super) fn pavement_height(falls: &[Fall], at: DVec2) -> f32 {
    let lowered = |fall: &Fall| {
        let (away, share) = fall.nearest(at);
        let back = ((away - WIDTH_M) / (APRON_M - WIDTH_M)).clamp(0.0, 1.0);
        share * (1.0 - back as f32)
    };
    KERB_M - (TOP_M - LOWERED_M) * falls.iter().map(lowered).fold(0.0, f32::max)
}

impl Fall {
    /// Whether an edge may be the back of it.
    fn is_near(&self, from: DVec2, to: DVec2) -> bool {
        let (low, high) = (from.min(to) - BACK_WITHIN_M, from.max(to) + BACK_WITHIN_M);
        self.line.iter().any(|(at, _)| at.cmpge(low).all() && at.cmple(high).all())
    }

    /// Distance from the stretch, and how much of the height is gone at its nearest point.
    fn nearest(&self, point: DVec2) -> (f64, f32) {
        let to_edge = |pair: &[(DVec2, f32)]| {
            let [(a, from), (b, to)] = [pair[0], pair[1]];
            let along = b - a;
            let share = ((point - a).dot(along) / along.length_squared().max(1e-12)).clamp(0.0, 1.0);
            (a.lerp(b, share).distance(point), from + (to - from) * share as f32)
        };
        let edges = self.line.windows(2).map(to_edge);
        edges.min_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or((f64::INFINITY, 0.0))
    }
}

/// A driveway with the bounding box of its reach.
struct Driveway<'a> {
    shape: &'a Footprint,
    reach: [DVec2; 2],
}

impl<'a> Driveway<'a> {
    fn new(shape: &'a Footprint) -> Self {
        let ring = ring_of(shape);
        let low = ring.iter().copied().fold(DVec2::INFINITY, DVec2::min);
        let high = ring.iter().copied().fold(DVec2::NEG_INFINITY, DVec2::max);
        Self { shape, reach: [low - DRIVE_WITHIN_M - RAMP_M, high + DRIVE_WITHIN_M + RAMP_M] }
    }

    fn is_near(&self, at: DVec2) -> bool {
        at.cmpge(self.reach[0]).all() && at.cmple(self.reach[1]).all()
    }

    /// Whether it lies outwards of a point of the kerb.
    fn is_met(&self, at: DVec2, outward: DVec2) -> bool {
        const LOOK_M: f64 = 0.5;
        let looks = (1..).map(|n| f64::from(n) * LOOK_M).take_while(|&out| out <= DRIVE_WITHIN_M);
        self.is_near(at) && looks.into_iter().any(|out| covers(self.shape, at + outward * out))
    }
}

/// Intervals of a ring in front of driveways.
fn lowered(ring: &[DVec2], drives: &[Driveway<'_>]) -> Vec<[f64; 2]> {
    /// Search step for driveways.
    const STEP_M: f64 = 0.1;
    let mut stretches: Vec<[f64; 2]> = Vec::new();
    let mut start = 0.0;
    for (k, &from) in ring.iter().enumerate() {
        let to = ring[(k + 1) % ring.len()];
        let length = from.distance(to);
        let outward = -(to - from).try_normalize().unwrap_or(DVec2::X).perp();
        let (low, high) = (from.min(to), from.max(to));
        let near: Vec<&Driveway<'_>> = drives
            .iter()
            .filter(|drive| low.cmple(drive.reach[1]).all() && high.cmpge(drive.reach[0]).all())
            .collect();
        let steps = if near.is_empty() { 0 } else { (length / STEP_M).ceil() as usize };
        for step in 0..steps {
            let s = step as f64 * STEP_M;
            let at = from.lerp(to, s / length);
            if !near.iter().any(|drive| drive.is_met(at, outward)) {
                continue;
            }
            match stretches.last_mut() {
                // Gaps of a step or two are closed.
                Some([_, last]) if start + s - *last < 2.0 * RAMP_M + 0.5 => *last = start + s,
                _ => stretches.push([start + s; 2]),
            }
        }
        start += length;
    }
    stretches
}

#[cfg(test)]
mod tests {
    use super::super::ground_sheet::{GRASS_M, GroundSheet};
    use super::super::grounds::distance_to;
    use super::super::mesh::{Mesh, Surface};
    use super::super::outlines::Cover;
    use super::super::tests::city;
    use super::super::{SceneDescription, SceneryKind};
    use super::*;
    use glam::{Vec2, Vec3};

    /// Highest point of a mesh's surfaces of a finish above a place.
    fn top(mesh: &Mesh, surface: Surface, at: Vec2) -> Option<f32> {
        let heights = mesh.indices.chunks_exact(3).filter_map(|t| {
            let [a, b, c] = [t[0], t[1], t[2]].map(|k| mesh.vertices[k as usize]);
            if a.finish.surface != surface {
                return None;
            }
            let [p, q, r] = [a, b, c].map(|v| v.position);
            let area = (q - p).truncate().perp_dot((r - p).truncate());
            let share = |from: Vec3, to: Vec3| (to - from).truncate().perp_dot(at - from.truncate()) / area;
            let (u, v, w) = (share(q, r), share(r, p), share(p, q));
            (area.abs() > 1e-9 && u.min(v).min(w) >= 0.0).then_some(u * p.z + v * q.z + w * r.z)
        });
        heights.reduce(f32::max)
    }

    /// Where the road begins, off the lines of the grid.
    const ORIGIN: DVec2 = DVec2::new(1.0, 1.5);

    fn rectangle(low: [f64; 2], high: [f64; 2]) -> Footprint {
        let ring = [low, [high[0], low[1]], high, [low[0], high[1]]];
        Footprint::Polygon(ring.map(|at| ORIGIN + DVec2::from(at)).to_vec())
    }

    /// A road of 30 m by 20 m, and what lies so far around it.
    fn square(around: f64) -> Vec<DVec2> {
        [(0.0, 0.0), (30.0, 0.0), (30.0, 20.0), (0.0, 20.0)]
            .map(|(x, y)| {
                let out = |value: f64| if value > 0.0 { around } else { -around };
                ORIGIN + DVec2::new(x + out(x), y + out(y))
            })
            .to_vec()
    }

    /// The ground around the road.
    fn ground(kerb: &Kerb) -> Mesh {
        let falls: Vec<Fall> = kerb.falls().collect();
        let grass = |at: DVec2| Corner { at, height_m: GRASS_M, is_kept: false };
        let rings = [
            (Cover::Road, kerb.face_corners()),
            (Cover::Kerb, back_corners(&square(WIDTH_M), &falls)),
            (Cover::Pavement, square(2.0).into_iter().map(grass).collect()),
        ];
        let box_ = [DVec2::splat(-5.0), DVec2::splat(35.0)];
        GroundSheet::new(box_, &rings, |at| pavement_height(&falls, at), kerb.apron_backs()).mesh(0.0)
    }

    #[test]
    fn stones_are_low_before_a_drive_and_high_beside_it() {
        let drive = rectangle([12.0, -3.5], [16.0, -2.0]);
        let mesh = ground(&Kerb::new(&square(0.0), &[&drive]));
        // The stones slope to the pavement by less than a centimetre.
        let origin = ORIGIN.as_vec2();
        let stone = |x: f32| top(&mesh, Surface::Concrete, origin + Vec2::new(x, -0.01)).unwrap();
        for low in [12.1, 14.0, 15.9] {
            assert!((stone(low) - LOWERED_M).abs() < 1e-3, "{low}: {}", stone(low));
        }
        for high in [2.0, 10.9, 17.1, 29.0] {
            assert!((stone(high) - TOP_M).abs() < 1e-3, "{high}: {}", stone(high));
        }
        // The pavement meets the stones, and comes back to its own height further back.
        let slope = |x: f32, y: f32| top(&mesh, Surface::Slabs, origin + Vec2::new(x, y)).unwrap();
        for x in [12.5, 14.0, 15.5] {
            assert!((slope(x, -0.202) - LOWERED_M).abs() < 0.008, "{}", slope(x, -0.202));
            assert!((slope(x, -1.299) - KERB_M).abs() < 2e-3, "{}", slope(x, -1.299));
        }
        assert!((slope(5.0, -0.202) - KERB_M).abs() < 2e-3 && (slope(5.0, -1.999) - GRASS_M).abs() < 2e-3);
        // Without drives, and with one that is too far, nothing falls.
        let far = rectangle([12.0, -6.0], [16.0, -3.2]);
        for drives in [&[&far][..], &[]] {
            assert!(Kerb::new(&square(0.0), drives).lowered.is_empty());
        }
    }

    #[test]
    fn every_car_park_of_the_city_is_reached_over_a_lowered_kerb() {
        let map = city();
        let scene = SceneDescription::from_map(&map);
        let roads = &scene.ground[0].levels[0].mesh;
        for park in map.scenery.iter().filter(|piece| piece.kind == SceneryKind::Parking) {
            let low = roads.vertices.iter().filter(|v| {
                v.finish.surface == Surface::Concrete
                    && (0.02..LOWERED_M + 0.001).contains(&v.position.z)
                    && distance_to(&park.shape, v.position.truncate().as_dvec2()) < 6.5
            });
            assert!(low.count() >= 4, "{} cannot be driven into", park.name);
        }
    }
}
