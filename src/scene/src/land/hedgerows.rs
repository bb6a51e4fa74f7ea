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
/// Parts of a grown stretch between two stations, and by how much they differ in width and height, as shares.
const PARTS: u32 = 2;
const UNEVEN: [f32; 2] = [0.34, 0.40];
/// How far a hedgerow is rounded beyond its end.
const END_M: f32 = 0.9;
/// Shorter ones have no gate.
const GATED_FROM_M: f64 = 60.0;

/// Profiles across a hedgerow: lateral position over half the width, share of the height, openness.
const GROWN: [(f32, f32, u8); 7] = [
    (0.95, 0.0, 80),
    (1.12, 0.42, 180),
    (0.82, 0.80, 225),
    (0.12, 1.0, 250),
    (-0.66, 0.88, 240),
    (-1.12, 0.46, 180),
    (-0.95, 0.0, 80),
];
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

    /// Place of a station. Hedgerows meet at their ends, which are on the line.
    pub(super) fn station(&self, k: u32) -> DVec2 {
        let at = self.ends[0].lerp(self.ends[1], f64::from(k) / f64::from(self.last()));
        let sway_m = if k == 0 || k == self.last() { 0.0 } else { SWAY_M };
        at + self.left() * (sway_m * (f64::from(self.hash(200 + k)) - 0.5))
    }

    /// Whether it has its gate at a station.
    pub(super) fn is_gate(&self, k: u32) -> bool {
        self.length_m() > GATED_FROM_M && k == (self.hash(78) * self.last() as f32) as u32
    }

    fn tall_m(&self, k: u32) -> f32 {
        1.1 + 1.0 * self.hash(77) + 1.3 * self.hash(400 + k)
    }

    /// Draws it between two stations, on ground of these heights, grown or as a plain ridge. Its faces are flat: leaves
    /// thin out towards the outline of what is round.
    pub(super) fn draw(&self, mesh: &mut Mesh, stations: [u32; 2], ground_m: [f32; 2], is_grown: bool) {
        let feet = [0, 1].map(|end| self.station(stations[end]).as_vec2().extend(ground_m[end]));
        let tall_m = stations.map(|k| self.tall_m(k));
        let parts = if is_grown { PARTS } else { 1 };
        let rib = |part: u32| {
            let share = part as f32 / parts as f32;
            let number = stations[0] * PARTS + part;
            let uneven = |salt: u32, most: f32| match is_grown {
                true => 1.0 + most * (self.hash(salt + number) - 0.5),
                false => 1.0,
            };
            Rib {
                foot: feet[0].lerp(feet[1], share),
                half_m: HALF_M * uneven(900, UNEVEN[0]),
                tall_m: (tall_m[0] + (tall_m[1] - tall_m[0]) * share) * uneven(2900, UNEVEN[1]),
            }
        };
        let profile: &[(f32, f32, u8)] = if is_grown { &GROWN } else { &RIDGE };
        for part in 0..parts {
            self.strips(mesh, [rib(part), rib(part + 1)], profile);
        }
    }

    /// Rounds a grown one off beyond a station where it ends, on ground of a height; `ahead` is away from it, 1 or -1 along
    /// the line.
    pub(super) fn end(&self, mesh: &mut Mesh, station: u32, ground_m: f32, ahead: f32) {
        let foot = self.station(station).as_vec2().extend(ground_m);
        let number = station * PARTS;
        let half_m = HALF_M * (1.0 + UNEVEN[0] * (self.hash(900 + number) - 0.5));
        let tall_m = self.tall_m(station) * (1.0 + UNEVEN[1] * (self.hash(2900 + number) - 0.5));
        let out = (-self.left().perp().as_vec2() * (END_M * ahead)).extend(0.0);
        let full = Rib { foot, half_m, tall_m };
        let less = |far: f32, share: f32| Rib {
            foot: foot + out * far,
            half_m: half_m * share,
            tall_m: tall_m * (0.25 + 0.75 * share),
        };
        for (a, b) in [(full, less(0.6, 0.72)), (less(0.6, 0.72), less(1.0, 0.12))] {
            let ribs = if ahead > 0.0 { [a, b] } else { [b, a] };
            self.strips(mesh, ribs, &GROWN);
        }
    }

    /// Strips from one rib to the next along the line.
    fn strips(&self, mesh: &mut Mesh, ribs: [Rib; 2], profile: &[(f32, f32, u8)]) {
        let right = -self.left().as_vec2();
        let corner = |rib: &Rib, (out, up, _): (f32, f32, u8)| {
            let at = rib.foot + (right * (rib.half_m * out)).extend(rib.tall_m * up);
            let uv = Vec2::new(-at.truncate().dot(right.perp()), ribs[0].tall_m * up + HALF_M * (1.0 - out));
            (at, uv / REPEAT_M)
        };
        for pair in profile.windows(2) {
            let [p, q] = [pair[0], pair[1]];
            let [a, b] = &ribs;
            let corners = [corner(a, p), corner(b, p), corner(b, q), corner(a, q)];
            let (places, uvs): (Vec<Vec3>, Vec<Vec2>) = corners.into_iter().unzip();
            mesh.shaded_face(&places, &uvs, HEDGEROW, &[p.2, p.2, q.2, q.2]);
        }
    }
}

/// A cross-section of a hedgerow.
#[derive(Clone, Copy, Debug)]
struct Rib {
    foot: Vec3,
    half_m: f32,
    tall_m: f32,
}
