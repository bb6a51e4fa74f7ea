//! Kerbs along the outline of the asphalt, lowered at driveways.

use super::grounds::{covers, ring_of};
use super::mesh::{Class, Finish, Mesh, Surface};
use super::polygon::{Region, mitre};
use super::roads::{KERB_M, PAVEMENT, PAVEMENT_REPEAT_M, band_along};
use city3d_roadmap::Footprint;
use glam::{DVec2, Vec2};

const STONE: Finish = Finish::new(Surface::Concrete, [186, 184, 178], Class::Pavement);
/// Height of kerbstones, and of lowered ones.
const TOP_M: f32 = KERB_M + 0.006;
const LOWERED_M: f32 = 0.03;
/// Width, including their faces.
pub(super) const WIDTH_M: f64 = 0.20;
/// Length of the ramp from full height to lowered stones.
const RAMP_M: f64 = 0.9;
/// Length of the pavement ramp behind lowered stones.
const APRON_M: f64 = 1.3;
/// Largest distance between a driveway and the face of the kerb.
const DRIVE_WITHIN_M: f64 = 3.0;

/// Outline error from which on kerbs are not lowered.
pub(super) const EVEN_FROM_M: f32 = TOP_M - LOWERED_M;

/// A closed kerb, the road to its left: corners and their arc lengths.
pub(super) struct Kerb {
    ring: Vec<DVec2>,
    stations: Vec<f64>,
    /// Lowered intervals.
    lowered: Vec<[f64; 2]>,
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

    /// Height of the stones at a corner.
    fn top(&self, corner: usize) -> f32 {
        let s = self.stations[corner % self.stations.len()];
        let share = self.lowered.iter().map(|&[a, b]| ((a - s).max(s - b) / RAMP_M).clamp(0.0, 1.0));
        LOWERED_M + (TOP_M - LOWERED_M) * share.fold(1.0, f64::min) as f32
    }

    /// Corners of each lowered interval with its ramps.
    fn falls(&self) -> impl Iterator<Item = Vec<usize>> {
        self.lowered.iter().map(|&[a, b]| {
            let within = a - RAMP_M - 1e-3..=b + RAMP_M + 1e-3;
            (0..self.ring.len()).filter(|&k| within.contains(&self.stations[k])).collect()
        })
    }

    fn beside(&self, corner: usize, out: f64) -> DVec2 {
        self.ring[corner] + mitre(&self.ring, corner) * out
    }

    /// The aprons: pavement ramps down to lowered kerbs.
    pub(super) fn aprons(&self) -> Vec<Region> {
        let ring = |fall: Vec<usize>| -> Vec<DVec2> {
            let back = fall.iter().map(|&k| self.beside(k, APRON_M));
            fall.iter().rev().map(|&k| self.ring[k]).chain(back).collect()
        };
        self.falls().map(|fall| Region::simple(&ring(fall))).collect()
    }

    /// Draws kerbstones and aprons.
    pub(super) fn draw(&self, mesh: &mut Mesh) {
        let face = |k: usize| [Vec2::ZERO, Vec2::new(0.02, self.top(k))];
        let lid = |k: usize| [Vec2::new(0.02, self.top(k)), Vec2::new(WIDTH_M as f32, self.top(k))];
        let uv = |along: f32, edge: Vec2| Vec2::new(along, edge.x + edge.y) / 2.0;
        band_along(mesh, &self.ring, face, STONE.shaded(0.86), uv);
        band_along(mesh, &self.ring, lid, STONE, uv);
        for fall in self.falls() {
            for pair in fall.windows(2) {
                let low = |k: usize| {
                    self.beside(k, WIDTH_M - 0.01).as_vec2().extend(self.top(k) - (TOP_M - KERB_M))
                };
                let high = |k: usize| self.beside(k, APRON_M).as_vec2().extend(KERB_M);
                let corners = [low(pair[1]), low(pair[0]), high(pair[0]), high(pair[1])];
                let uvs = corners.map(|p| p.truncate() / PAVEMENT_REPEAT_M);
                mesh.face(&corners, &uvs, PAVEMENT);
            }
        }
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
    use super::super::grounds::distance_to;
    use super::super::tests::city;
    use super::super::{SceneDescription, SceneryKind};
    use super::*;
    use glam::Vec3;

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

    fn square() -> Vec<DVec2> {
        [(0.0, 0.0), (30.0, 0.0), (30.0, 20.0), (0.0, 20.0)].map(DVec2::from).to_vec()
    }

    #[test]
    fn stones_are_low_before_a_drive_and_high_beside_it() {
        let drive = Footprint::Polygon(
            [(12.0, -3.5), (16.0, -3.5), (16.0, -2.0), (12.0, -2.0)].map(DVec2::from).to_vec(),
        );
        let mut mesh = Mesh::default();
        let kerb = Kerb::new(&square(), &[&drive]);
        kerb.draw(&mut mesh);
        let stone = |x: f32| top(&mesh, Surface::Concrete, Vec2::new(x, -0.1)).unwrap();
        for low in [12.1, 14.0, 15.9] {
            assert!((stone(low) - LOWERED_M).abs() < 1e-4, "{low}: {}", stone(low));
        }
        for high in [2.0, 10.9, 17.1, 29.0] {
            assert!((stone(high) - TOP_M).abs() < 1e-4, "{high}: {}", stone(high));
        }
        // The pavement meets the stones, and its own height further back, and is cut out for the slope.
        let slope = |x: f32, y: f32| top(&mesh, Surface::Slabs, Vec2::new(x, y)).unwrap();
        assert!((slope(14.0, -0.2) - LOWERED_M).abs() < 0.008, "{}", slope(14.0, -0.2));
        assert!((slope(14.0, -1.299) - KERB_M).abs() < 1e-3, "{}", slope(14.0, -1.299));
        let aprons = kerb.aprons();
        assert_eq!(aprons.len(), 1);
        let sum: f64 =
            aprons[0].triangulate().iter().map(|t| super::super::polygon::doubled_area(t) / 2.0).sum();
        // Found in steps of a tenth.
        assert!((sum - (4.0 + 2.0 * RAMP_M) * APRON_M).abs() < 0.15, "{sum}");
        // Without drives, and with one that is too far, nothing falls.
        let far = Footprint::Polygon(
            [(12.0, -6.0), (16.0, -6.0), (16.0, -3.2), (12.0, -3.2)].map(DVec2::from).to_vec(),
        );
        assert!(
            Kerb::new(&square(), &[&far]).lowered.is_empty() && Kerb::new(&square(), &[]).lowered.is_empty()
        );
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
