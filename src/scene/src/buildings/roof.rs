//! Flat roofs with parapets, gabled roofs with chimneys.

use super::super::SeededScenery;
use super::super::mesh::{Finish, Mesh, Surface};
use super::super::polygon::Region;
use super::super::roads::level;
use super::style::{BARE_BRICK, FLAT_ROOF, Style, TRIM, wall};
use super::{roof_plant, trimmings};
use glam::{Vec2, Vec3};

const PARAPET_M: f32 = 0.55;

pub(super) fn flat_roof([mesh, trim]: [&mut Mesh; 2], place: &SeededScenery<'_>, ring: &[Vec2], eaves: f32) {
    let plan: Vec<_> = ring.iter().map(|p| p.as_dvec2()).collect();
    level(mesh, &Region::simple(&plan), eaves, FLAT_ROOF, 3.0);
    let top = eaves + PARAPET_M;
    let profile = [
        Vec2::new(0.06, eaves - 0.25),
        Vec2::new(0.06, top),
        Vec2::new(-0.24, top),
        Vec2::new(-0.24, eaves - 0.02),
    ];
    for pair in profile.windows(2) {
        sharp_band(mesh, ring, [pair[0], pair[1]], TRIM);
    }
    roof_plant::plant([mesh, trim], place, ring, eaves);
}

/// A band along a ring with mitred corners: profile points are (outwards, height).
fn sharp_band(mesh: &mut Mesh, ring: &[Vec2], [from, to]: [Vec2; 2], finish: Finish) {
    let count = ring.len();
    let moved = |k: usize, out: f32| {
        let (before, at, after) = (ring[(k + count - 1) % count], ring[k], ring[(k + 1) % count]);
        let (a, b) = ((at - before).normalize_or(Vec2::X), (after - at).normalize_or(Vec2::X));
        let mean = (a + b).normalize_or(a);
        at - mean.perp() * (out / mean.dot(a).max(0.3))
    };
    for k in 0..count {
        let next = (k + 1) % count;
        let corners = [
            moved(k, from.x).extend(from.y),
            moved(next, from.x).extend(from.y),
            moved(next, to.x).extend(to.y),
            moved(k, to.x).extend(to.y),
        ];
        mesh.plate(&corners, finish, 2.0);
    }
}

/// The side of a rectangle from which its ridge runs on: the longer.
fn side_along(ring: &[Vec2]) -> usize {
    usize::from(ring[0].distance(ring[1]) < ring[1].distance(ring[2]))
}

/// Which sides of a building the eaves of its roof hang over; the others end in gables.
pub(super) fn eaves_over(ring: &[Vec2], is_gabled: bool) -> impl Fn(usize) -> bool {
    let along = is_gabled.then(|| side_along(ring));
    move |side| along.is_some_and(|along| side % 2 == along)
}

const OVERHANG_M: f32 = 0.4;

/// How far eaves hang below the top of the wall.
pub(super) fn overhang_drop(rise: f32, gable_m: f32) -> f32 {
    rise / (gable_m / 2.0) * OVERHANG_M
}

/// A gabled roof with overhanging eaves along the longer axis of a rectangle, gables and a chimney.
pub(super) fn gable_roof(
    [mesh, trim]: [&mut Mesh; 2],
    ring: &[Vec2],
    (eaves, rise): (f32, f32),
    style: &Style,
    place: &SeededScenery<'_>,
) {
    // a to b is the longer side.
    let turn = side_along(ring);
    let [a, b, c, d] = [0, 1, 2, 3].map(|k| ring[(k + turn) % 4]);
    let (ridge_a, ridge_b) = ((a + d) / 2.0, (b + c) / 2.0);
    let along = (b - a).normalize_or(Vec2::X) * OVERHANG_M;
    let out = (a - d).normalize_or(Vec2::Y);
    let half = a.distance(d) / 2.0;
    let slope_drop = overhang_drop(rise, 2.0 * half);
    let ridge = |p: Vec2, end: f32| (p + along * end).extend(eaves + rise);
    let eave = |p: Vec2, side: f32, end: f32| {
        (p + along * end + out * (side * OVERHANG_M)).extend(eaves - slope_drop)
    };
    let length = a.distance(b) + 2.0 * OVERHANG_M;
    let run = (half + OVERHANG_M).hypot(rise + slope_drop);
    let uvs =
        [Vec2::ZERO, Vec2::new(length, 0.0), Vec2::new(length, run), Vec2::new(0.0, run)].map(|uv| uv / 3.0);
    for (salt, (corners, lift)) in [
        ([eave(a, 1.0, -1.0), eave(b, 1.0, 1.0), ridge(ridge_b, 1.0), ridge(ridge_a, -1.0)], 0.14),
        ([eave(c, -1.0, 1.0), eave(d, -1.0, -1.0), ridge(ridge_a, -1.0), ridge(ridge_b, 1.0)], 0.14),
    ]
    .into_iter()
    .enumerate()
    {
        let top = corners.map(|p| p + Vec3::Z * lift);
        mesh.face(&top, &uvs, style.tiles);
        if !style.is_church {
            trimmings::roof_windows(trim, place, top, salt as u32);
        }
        // Underside and fascia.
        let [p, q, r, s] = corners;
        let first = mesh.vertices.len();
        mesh.plate(&[q, p, s, r], TRIM.shaded(0.85), 2.0);
        mesh.set_openness(first, 90);
        mesh.plate(&[p, q, top[1], top[0]], TRIM, 2.0);
        mesh.plate(&[q, r, top[2], top[1]], TRIM, 2.0);
        mesh.plate(&[s, p, top[0], top[3]], TRIM, 2.0);
    }
    let plain = if style.upper.surface == Surface::Sash {
        BARE_BRICK
    } else {
        // As bright as the wall below on the mean of both textures.
        wall(Surface::Concrete, style.upper.colour).shaded(0.92 / 0.90)
    };
    for [left, right, top] in [[d, a, ridge_a], [b, c, ridge_b]] {
        let corners = [left.extend(eaves), right.extend(eaves), top.extend(eaves + rise)];
        let first = mesh.vertices.len();
        mesh.plate(&corners, plain, 2.0);
        mesh.set_openness(first, 250);
    }
    if style.is_church {
        return;
    }
    let at = ridge_a.lerp(ridge_b, 0.22 + 0.5 * place.hash_to_unit(12)) + out * (0.25 * half);
    let chimney = wall(Surface::Brick, [150, 96, 80]);
    mesh.block(
        at.extend(eaves + 0.4 * rise),
        Vec3::new(0.7, 0.6, 0.6 * rise + 0.7),
        along.to_angle(),
        chimney,
    );
    trimmings::on_chimney(trim, place, at.extend(eaves + rise + 0.7), along);
}
