//! Hedgerows along the boundaries of fields.

use super::super::hash_to_unit;
use super::super::mesh::{Class, Finish, Mesh, Surface};
use glam::{DVec2, Vec2, Vec3};

const HEDGEROW: Finish = Finish::new(Surface::Leaves, [98, 117, 68], Class::Vegetation);
/// Half the width at the foot, and metres in which the leaves repeat.
const HALF_M: f32 = 1.0;
const REPEAT_M: f32 = 2.6;
/// Spacing of the stations, fine and coarse, and how far they are off the line.
const STATIONS_M: [f64; 2] = [7.0, 27.0];
const SWAY_M: f64 = 1.1;

/// Profiles across a hedgerow: lateral position over half the width, share of the height, openness.
const GROWN: [(f32, f32, u8); 6] =
    [(1.0, 0.0, 80), (1.1, 0.6, 200), (0.3, 1.0, 250), (-0.5, 0.94, 245), (-1.1, 0.5, 190), (-1.0, 0.0, 80)];
const RIDGE: [(f32, f32, u8); 3] = [(1.1, 0.0, 110), (0.0, 1.0, 240), (-1.1, 0.0, 110)];

/// A hedgerow, which has stations along its line: between them it is straight.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hedgerow {
    pub(super) ends: [DVec2; 2],
    pub(super) seed: u32,
    /// Whether it is near enough to the town for a grown profile and many stations.
    pub(super) is_fine: bool,
}

impl Hedgerow {
    pub(super) fn length_m(&self) -> f64 {
        self.ends[0].distance(self.ends[1])
    }

    /// Number of its last station.
    pub(super) fn last(&self) -> u32 {
        let spacing_m = STATIONS_M[usize::from(!self.is_fine)];
        (self.length_m() / spacing_m).ceil().max(1.0) as u32
    }

    fn hash(&self, salt: u32) -> f32 {
        hash_to_unit(self.seed, salt)
    }

    fn left(&self) -> DVec2 {
        (self.ends[1] - self.ends[0]).normalize_or(DVec2::X).perp()
    }

    /// Place of a station.
    pub(super) fn station(&self, k: u32) -> DVec2 {
        let at = self.ends[0].lerp(self.ends[1], f64::from(k) / f64::from(self.last()));
        at + self.left() * (SWAY_M * (f64::from(self.hash(200 + k)) - 0.5))
    }

    /// Whether it has its gate at a station.
    pub(super) fn is_gate(&self, k: u32) -> bool {
        k == (self.hash(78) * self.last() as f32) as u32
    }

    fn tall_m(&self, k: u32) -> f32 {
        1.1 + 1.0 * self.hash(77) + 1.3 * self.hash(400 + k)
    }

    /// Draws it between two stations, on ground of these heights, with its grown profile or as a plain ridge. Its faces
    /// are flat: leaves thin out towards the outline of what is round.
    pub(super) fn draw(&self, mesh: &mut Mesh, stations: [u32; 2], ground_m: [f32; 2], is_grown: bool) {
        let right = -self.left().as_vec2();
        let feet = [0, 1].map(|end| self.station(stations[end]).as_vec2().extend(ground_m[end]));
        let tall_m = stations.map(|k| self.tall_m(k));
        let profile: &[(f32, f32, u8)] = if is_grown { &GROWN } else { &RIDGE };
        let corner = |end: usize, (out, up, _): (f32, f32, u8)| {
            let at = feet[end] + (right * (HALF_M * out)).extend(tall_m[end] * up);
            let uv = Vec2::new(-at.truncate().dot(right.perp()), tall_m[0] * up + HALF_M * (1.0 - out));
            (at, uv / REPEAT_M)
        };
        for pair in profile.windows(2) {
            let [p, q] = [pair[0], pair[1]];
            let corners = [corner(0, p), corner(1, p), corner(1, q), corner(0, q)];
            let (places, uvs): (Vec<Vec3>, Vec<Vec2>) = corners.into_iter().unzip();
            mesh.shaded_face(&places, &uvs, HEDGEROW, &[p.2, p.2, q.2, q.2]);
        }
    }
}
