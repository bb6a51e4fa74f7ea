//! Spruces: tiers of hanging branches; near by, boughs with twigs around a dark inside.

use super::super::foliage::limb;
use super::super::mesh::{Finish, Mesh, Vertex};
use super::near;
use super::{BARK, LEAVES, NEEDLES, TreeDetail};
use glam::{Vec2, Vec3};
use std::f32::consts::TAU;

const TIERS: u32 = 6;
/// Tips of boughs around a tier; the sides of its star are twice as many.
const BOUGHS: u32 = 6;
/// What is dark inside of a tier near by: its radius and brightness as shares.
const INSIDE: f32 = 0.60;
const INSIDE_TONE: f32 = 0.80;
/// Where boughs begin, as a share of the radius of their tier, and their width as a share of their length.
const FOOT: f32 = 0.16;
const BOUGH_WIDE: f32 = 0.72;
/// Texture coordinate up from which on a spray is the bough of a conifer, as in `sprays.wgsl`.
const BOUGH_UV: f32 = 2048.0;
/// Brightness of boughs beside that of tiers, which have no gaps.
const BOUGH_TONE: f32 = 1.16;

/// A spruce, in radii of its crown.
pub(super) fn spruce(mesh: &mut Mesh, seed: u32, detail: TreeDetail) {
    let (sides, count, trunk) = match detail {
        TreeDetail::Near | TreeDetail::Clumps(..) => (2 * BOUGHS, TIERS, 5),
        TreeDetail::Hull([8, _], _) => (8, 4, 3),
        TreeDetail::Hull([7, _], _) => (6, 3, 3),
        TreeDetail::Hull([5, _], _) => (5, 2, 3),
        TreeDetail::Hull(..) => (4, 1, 3),
    };
    let tree = Spruce::new(seed);
    // Up into the tiers, which hang over it.
    limb(mesh, &[(Vec3::ZERO, 0.11), (Vec3::Z * (0.5 * tree.height), 0.05)], trunk, BARK.shaded(0.8));
    if matches!(detail, TreeDetail::Near) {
        return tree.boughs(mesh);
    }
    for tier in tree.tiers(count) {
        tier.cone(mesh, sides, count > 3);
    }
}

struct Spruce {
    seed: u32,
    height: f32,
}

/// A tier of hanging branches: a cone with its rim below.
#[derive(Clone, Copy)]
struct Tier {
    foot: f32,
    radius: f32,
    height: f32,
    turn: f32,
    tone: f32,
}

impl Spruce {
    fn new(seed: u32) -> Self {
        Self { seed, height: 4.5 * (0.92 + 0.2 * super::super::hash_to_unit(seed, 1)) }
    }

    fn hash_to_unit(&self, salt: u32) -> f32 {
        super::super::hash_to_unit(self.seed, salt)
    }

    fn tiers(&self, count: u32) -> impl Iterator<Item = Tier> {
        let Self { height, .. } = *self;
        let first = 0.09 * height;
        (0..count).map(move |k| {
            let part = k as f32 / count as f32;
            let foot = first + (height - first) * part;
            // Tiers reach into those above them, the last to the tip.
            let next = first + (height - first) * (k + 1) as f32 / count as f32;
            let top = if k + 1 == count {
                height
            } else {
                (foot + (height - foot) * (0.30 + 1.1 / count as f32))
                    .max(next + 0.45 * (height - next))
                    .min(height)
            };
            Tier {
                foot,
                radius: (1.0 - part) * (0.95 + 0.1 * self.hash_to_unit(10 + k)),
                height: top - foot,
                turn: TAU * self.hash_to_unit(20 + k),
                tone: 0.84 + 0.30 * part,
            }
        })
    }

    /// Boughs out to the tips of the tiers' stars, and shorter ones between them and above them.
    fn boughs(&self, mesh: &mut Mesh) {
        for (tier, k) in self.tiers(TIERS).zip(0..) {
            tier.inside().cone(mesh, 7, true);
            // Turn from tip to tip, height above the rim and length, as shares of the tier's.
            const WHORLS: [[f32; 3]; 4] =
                [[0.0, 0.0, 1.0], [0.5, 0.05, 0.86], [0.25, 0.17, 0.88], [0.75, 0.24, 0.80]];
            for (whorl, row) in WHORLS.into_iter().zip(0..) {
                for n in 0..BOUGHS {
                    let salt = 100 + 64 * k + BOUGHS * row + n;
                    let draw = |more: u32| self.hash_to_unit(salt + 1000 * more);
                    self.bough(mesh, &tier, (n as f32, whorl), &draw);
                }
            }
        }
        self.leader(mesh);
    }

    fn bough(
        &self,
        mesh: &mut Mesh,
        tier: &Tier,
        (n, [between, up, long]): (f32, [f32; 3]),
        draw: &dyn Fn(u32) -> f32,
    ) {
        let is_tip = between == 0.0;
        let vary = if is_tip { 0.0 } else { 0.5 * (draw(1) - 0.5) };
        let turn = tier.turn + TAU * (n + between + 0.4 * vary) / BOUGHS as f32;
        let level = Vec2::from_angle(turn);
        let long = if is_tip { long } else { long * (0.86 + 0.2 * draw(2)) };
        let z = tier.foot + tier.height * up;
        let radius = tier.radius * long;
        // The rim of a tier hangs below its foot, and so do the tips of its boughs.
        let tip = (level * radius).extend(z - 0.05 * tier.height);
        let rise = tier.height * (0.20 + 0.10 * draw(3));
        let foot = (level * (FOOT * radius)).extend((z + rise).min(self.height - 0.02));
        let tone = tier.tone * BOUGH_TONE * (0.84 + 0.32 * draw(4));
        let along = tip - foot;
        let across = along.cross(Vec3::Z).normalize_or(Vec3::X);
        let over = across.cross(along).normalize_or(Vec3::Z);
        self.strip(mesh, [foot, tip], (across, over), tone, near::cell(draw(5), draw(6)));
    }

    /// The tip of the tree: two boughs that cross.
    fn leader(&self, mesh: &mut Mesh) {
        let top = Vec3::Z * self.height;
        for (side, k) in [Vec3::X, Vec3::Y].into_iter().zip(0..) {
            let foot = top - Vec3::Z * 0.42;
            let cell = near::cell(self.hash_to_unit(90 + k), self.hash_to_unit(94 + k));
            self.strip(mesh, [foot, top], (side, side.cross(Vec3::Z)), 1.10 * BOUGH_TONE, cell);
        }
    }

    /// A rhombus from foot to tip that sags at its sides, on which the shader finds twigs with needles.
    fn strip(
        &self,
        mesh: &mut Mesh,
        [foot, tip]: [Vec3; 2],
        (across, over): (Vec3, Vec3),
        tone: f32,
        cell: Vec2,
    ) {
        let along = tip - foot;
        let length = along.length();
        let ahead = along / length.max(1e-6);
        let cell = cell + Vec2::Y * (BOUGH_UV - near::SPRAY_UV);
        near::rhombus(mesh, cell, |[aside, far], uv| {
            let sag = 0.32 * aside.abs();
            let position = foot + along * far + across * (aside * BOUGH_WIDE * length)
                - Vec3::Z * (sag * length * over.z);
            let out = position.truncate().extend(0.0).normalize_or_zero();
            let normal =
                (over * 0.7 + out * 0.6 + across * (0.6 * aside) + ahead * 0.15).normalize_or(Vec3::Z);
            // Farther out there is more light, and on the upper boughs.
            let height = position.z / self.height;
            let open = (0.40 + 0.46 * far) * (0.82 + 0.18 * height);
            let finish = bough_finish(tone * (0.86 + 0.26 * far));
            Vertex { position, normal, uv, finish, openness: (255.0 * open) as u8 }
        });
    }
}

/// Boughs are drawn as leaves are, by their coordinates in the colours of needles.
fn bough_finish(tone: f32) -> Finish {
    Finish { surface: LEAVES.surface, ..NEEDLES }.shaded(tone)
}

impl Tier {
    fn inside(self) -> Self {
        let rise = 0.10 * self.height;
        Self {
            foot: self.foot + rise,
            radius: INSIDE * self.radius,
            height: 0.9 * self.height - rise,
            tone: INSIDE_TONE * self.tone,
            ..self
        }
    }

    /// A cone with a jagged rim, dark below; without both far away.
    fn cone(&self, mesh: &mut Mesh, sides: u32, is_star: bool) {
        let Self { radius, height, .. } = *self;
        let foot = Vec3::Z * self.foot;
        let finish = NEEDLES.shaded(self.tone);
        let base = mesh.vertices.len() as u32;
        for k in 0..=sides {
            let (sin, cos) = (self.turn + TAU * (k % sides) as f32 / sides as f32).sin_cos();
            let normal = Vec3::new(cos * height, sin * height, 0.8 * radius).normalize_or(Vec3::Z);
            let is_notch = is_star && k % 2 == 1;
            let (out, drop) = if is_notch { (0.70, 0.16 * height) } else { (1.0, -0.05 * height) };
            let uv = Vec2::new(k as f32 / sides as f32 * (TAU * radius).round().max(1.0), 0.0);
            let rim = foot + Vec3::new(cos * out, sin * out, 0.0) * radius + Vec3::Z * drop;
            let openness = if is_notch { 120 } else { 225 };
            mesh.vertex(Vertex { position: rim, normal, uv, finish, openness });
            let tip = foot + Vec3::Z * height;
            mesh.vertex(Vertex { position: tip, normal, uv: uv + Vec2::Y * height, finish, openness: 130 });
        }
        for k in 0..sides {
            let a = base + 2 * k;
            mesh.indices.extend([a, a + 2, a + 1]);
        }
        if !is_star {
            return;
        }
        let middle = mesh.vertex(Vertex {
            position: foot + Vec3::Z * (0.16 * height),
            normal: -Vec3::Z,
            uv: Vec2::ZERO,
            finish: finish.shaded(0.6),
            openness: 60,
        });
        for k in 0..sides {
            let a = base + 2 * k;
            mesh.indices.extend([a + 2, a, middle]);
        }
    }
}
