//! Spruces: tiers of hanging branches.

use super::super::foliage::limb;
use super::super::mesh::{Mesh, Vertex};
use super::{BARK, NEEDLES, TreeDetail};
use glam::{Vec2, Vec3};
use std::f32::consts::TAU;

/// A spruce: tiers of hanging branches, each a star.
pub(super) fn spruce(mesh: &mut Mesh, seed: u32, detail: TreeDetail) {
    let hash_to_unit = |salt: u32| super::super::hash_to_unit(seed, salt);
    let height = 4.5 * (0.92 + 0.2 * hash_to_unit(1));
    let (sides, tiers, trunk) = match detail {
        TreeDetail::Near | TreeDetail::Clumps(..) => (12, 6, 5),
        TreeDetail::Hull([8, _], _) => (8, 4, 3),
        TreeDetail::Hull([7, _], _) => (6, 3, 3),
        TreeDetail::Hull([5, _], _) => (5, 2, 3),
        TreeDetail::Hull(..) => (4, 1, 3),
    };
    // Up into the tiers, which hang over it.
    limb(mesh, &[(Vec3::ZERO, 0.11), (Vec3::Z * (0.5 * height), 0.05)], trunk, BARK.shaded(0.8));
    let first = 0.09 * height;
    for k in 0..tiers {
        let part = k as f32 / tiers as f32;
        let (from, wide) =
            (first + (height - first) * part, (1.0 - part) * (0.95 + 0.1 * hash_to_unit(10 + k)));
        // Tiers reach into those above them, the last to the tip.
        let next = first + (height - first) * (k + 1) as f32 / tiers as f32;
        let to = if k + 1 == tiers {
            height
        } else {
            (from + (height - from) * (0.30 + 1.1 / tiers as f32))
                .max(next + 0.45 * (height - next))
                .min(height)
        };
        let is_star = tiers > 3;
        tier(
            mesh,
            Vec3::Z * from,
            [wide, to - from],
            (TAU * hash_to_unit(20 + k), sides, is_star),
            0.84 + 0.30 * part,
        );
    }
}

/// A tier: a cone with a jagged rim, dark below.
fn tier(
    mesh: &mut Mesh,
    foot: Vec3,
    [radius, height]: [f32; 2],
    (turn, sides, is_star): (f32, u32, bool),
    tone: f32,
) {
    let finish = NEEDLES.shaded(tone);
    let base = mesh.vertices.len() as u32;
    for k in 0..=sides {
        let (sin, cos) = (turn + TAU * (k % sides) as f32 / sides as f32).sin_cos();
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
