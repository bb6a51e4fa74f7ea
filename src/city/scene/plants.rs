//! Trees of several kinds and hedges.

use super::{Level, Object, Place};
use super::grounds::ring_of;
use super::mesh::{Class, Finish, Mesh, Surface, Vertex};
use crate::city::Shape;
use glam::{Vec2, Vec3};
use std::f32::consts::{PI, TAU};

const BARK: Finish = Finish::new(Surface::Wood, [104, 84, 66], Class::Vegetation);
const BIRCH: Finish = Finish::new(Surface::Wood, [206, 202, 192], Class::Vegetation);
const HEDGE: Finish = Finish::new(Surface::Leaves, [108, 140, 74], Class::Vegetation);

/// Greens of crowns.
const GREENS: [[u8; 3]; 6] =
    [[118, 150, 70], [98, 138, 66], [138, 160, 78], [92, 126, 72], [126, 142, 60], [112, 146, 88]];

/// Faces around a crown and from its bottom to its top, and around a trunk.
#[derive(Clone, Copy)]
pub(super) struct Leafage {
    around: u32,
    rings: u32,
    trunk: u32,
    /// Whether a crown of several clumps has all of them.
    clumps: bool,
}

impl Leafage {
    const NEAR: Self = Self { around: 9, rings: 6, trunk: 6, clumps: true };
    const DISTANT: Self = Self { around: 5, rings: 3, trunk: 3, clumps: true };
    /// For trees of a few pixels.
    const FAR: Self = Self { around: 4, rings: 3, trunk: 3, clumps: false };
}

/// A tree at all its levels of detail.
pub(super) fn tree_object(place: &Place<'_>) -> Object {
    let level = |(leafage, error_m)| {
        let mut mesh = Mesh::default();
        tree(&mut mesh, place, leafage);
        Level { mesh, error_m }
    };
    Object {
        levels: [(Leafage::NEAR, 0.0), (Leafage::DISTANT, 0.30), (Leafage::FAR, 0.75)].map(level).to_vec(),
    }
}

/// A trunk and its crown; the drawing's circle is the crown's, the kind is drawn by lot.
fn tree(mesh: &mut Mesh, place: &Place<'_>, leafage: Leafage) {
    let Shape::Circle { centre, radius_m } = place.piece.shape else { return };
    let foot = centre.as_vec2().extend(0.08);
    let radius = radius_m as f32;
    let green = GREENS[(place.dice(1) * GREENS.len() as f32) as usize % GREENS.len()];
    let leaves = Finish::new(Surface::Leaves, green, Class::Vegetation);
    let scale = 0.85 + 0.4 * place.dice(2);
    match place.dice(3) {
        // Round crowns of three clumps.
        d if d < 0.52 => {
            let height = (2.5 * radius + 1.6) * scale;
            mesh.frustum(foot, [0.05 * radius + 0.09, 0.05], height - 1.0 * radius, leafage.trunk, BARK);
            let turn = place.dice(4) * TAU;
            let top = foot + Vec3::Z * (height - 0.86 * radius);
            let crown = if leafage.clumps { Vec3::new(0.84, 0.84, 0.86) } else { Vec3::new(1.0, 1.0, 0.98) };
            blob(mesh, top, crown * radius, (place.seed, leafage), leaves);
            for k in 0..if leafage.clumps { 3 } else { 0 } {
                let (sin, cos) = (turn + TAU / 3.0 * (k as f32 + 0.3 * place.dice(5))).sin_cos();
                let low = Vec3::new(cos, sin, 0.0) * (0.44 * radius) - Vec3::Z * (0.46 * radius);
                let size = Vec3::new(0.62, 0.62, 0.58) * radius;
                blob(mesh, top + low, size, (place.seed + 7 + k, leafage), leaves.shaded(0.94));
            }
        }
        // Upright, one clump.
        d if d < 0.74 => {
            let height = (3.2 * radius + 2.4) * scale;
            mesh.frustum(foot, [0.14, 0.09], height * 0.4, leafage.trunk, BIRCH);
            let middle = foot + Vec3::Z * (height * 0.62);
            let size = Vec3::new(0.72 * radius, 0.72 * radius, height * 0.40);
            blob(mesh, middle, size, (place.seed, leafage), leaves.shaded(1.06));
        }
        // Conifers of three cones.
        d if d < 0.90 => {
            let height = (3.4 * radius + 2.6) * scale;
            let needles = Finish::new(Surface::Leaves, [78, 112, 76], Class::Vegetation);
            mesh.frustum(foot, [0.17, 0.13], 1.2, leafage.trunk, BARK);
            for (from, to, wide) in [(0.13, 0.52, 0.92), (0.36, 0.76, 0.70), (0.60, 1.0, 0.46)] {
                let at = foot + Vec3::Z * (height * from);
                cone(
                    mesh,
                    at,
                    wide * radius,
                    height * (to - from),
                    leafage,
                    needles.shaded(0.85 + 0.3 * from),
                );
            }
        }
        // Wide and flat.
        _ => {
            let height = (1.7 * radius + 2.4) * scale;
            mesh.frustum(foot, [0.20, 0.10], height * 0.62, leafage.trunk, BARK);
            let middle = foot + Vec3::Z * (height * 0.74);
            blob(
                mesh,
                middle,
                Vec3::new(radius, radius, 0.52 * radius),
                (place.seed, leafage),
                leaves.shaded(0.97),
            );
        }
    }
}

/// A clump of leaves: a ball, bulging here and there, darker below.
fn blob(mesh: &mut Mesh, centre: Vec3, size: Vec3, (seed, leafage): (u32, Leafage), finish: Finish) {
    let Leafage { around, rings, .. } = leafage;
    let bulge = |k: u32, ring: u32| {
        let h = (k % around).wrapping_mul(73_856_093)
            ^ ring.wrapping_mul(19_349_663)
            ^ seed.wrapping_mul(83_492_791);
        0.86 + 0.26 * ((h.wrapping_mul(0x9E37_79B1) >> 16) & 0xff) as f32 / 255.0
    };
    let base = mesh.vertices.len() as u32;
    for ring in 0..=rings {
        let (sin_up, cos_up) = (PI * (ring as f32 / rings as f32 - 0.5)).sin_cos();
        for k in 0..=around {
            let (sin, cos) = (TAU * (k as f32 + 0.5 * (ring % 2) as f32) / around as f32).sin_cos();
            let out = Vec3::new(cos * cos_up, sin * cos_up, sin_up);
            let pole = ring == 0 || ring == rings;
            let swell = if pole { 0.95 } else { bulge(k, ring) };
            let normal = (out / size).normalize_or(Vec3::Z);
            let openness = (176.0 + 79.0 * (0.5 + 0.5 * sin_up)) as u8;
            let uv = Vec2::new(k as f32 / around as f32 * 2.0, ring as f32 / rings as f32)
                * (size.x / 0.8).max(0.9);
            mesh.vertex(Vertex { position: centre + out * size * swell, normal, uv, finish, openness });
        }
    }
    for ring in 0..rings {
        for k in 0..around {
            let a = base + ring * (around + 1) + k;
            let b = a + around + 1;
            if ring > 0 {
                mesh.indices.extend([a, a + 1, b + 1]);
            }
            if ring + 1 < rings || ring == 0 {
                mesh.indices.extend([a, b + 1, b]);
            }
        }
    }
}

fn cone(mesh: &mut Mesh, foot: Vec3, radius: f32, height: f32, leafage: Leafage, finish: Finish) {
    let sides = leafage.around;
    let base = mesh.vertices.len() as u32;
    for k in 0..=sides {
        let (sin, cos) = (TAU * k as f32 / sides as f32).sin_cos();
        let normal = Vec3::new(cos * height, sin * height, radius).normalize_or(Vec3::Z);
        let uv = Vec2::new(k as f32 / sides as f32 * 2.0, 0.0);
        let rim = foot + Vec3::new(cos, sin, 0.0) * radius;
        mesh.vertex(Vertex { position: rim, normal, uv, finish, openness: 170 });
        let tip = foot + Vec3::Z * height;
        mesh.vertex(Vertex { position: tip, normal, uv: uv + Vec2::Y * height / 2.0, finish, openness: 255 });
    }
    let middle = mesh.vertex(Vertex {
        position: foot + Vec3::Z * 0.1,
        normal: -Vec3::Z,
        uv: Vec2::ZERO,
        finish: finish.shaded(0.6),
        openness: 110,
    });
    for k in 0..sides {
        let a = base + 2 * k;
        mesh.indices.extend([a, a + 2, a + 1]);
        mesh.indices.extend([a + 2, a, middle]);
    }
}

/// A clipped hedge along a line or within a polygon.
pub(super) fn hedge(mesh: &mut Mesh, place: &Place<'_>) {
    let height = place.piece.height_m.map_or(1.15, |h| h as f32);
    match &place.piece.shape {
        Shape::Polyline(line) => super::props::along(mesh, line, 0.9, height, HEDGE, HEDGE.shaded(1.08)),
        shape => {
            let ring: Vec<Vec3> = ring_of(shape).iter().map(|p| p.as_vec2().extend(0.05)).collect();
            mesh.prism(&ring, height, HEDGE, HEDGE.shaded(1.08));
        }
    }
}
