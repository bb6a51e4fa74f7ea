//! Playgrounds: sand with a swing, a tower with a slide, and a climbing arch.

use super::SeededScenery;
use super::foliage::limb;
use super::grounds::ring_of;
use super::mesh::{Class, Finish, Mesh, Surface};
use super::polygon::Region;
use super::props::{IRON, SLATS, along, middle};
use super::roads::level;
use glam::{Vec2, Vec3};
use std::f32::consts::PI;

const RED: Finish = Finish::new(Surface::Metal, [188, 58, 48], Class::Furniture);
const BLUE: Finish = Finish::new(Surface::Metal, [52, 104, 166], Class::Furniture);
const YELLOW: Finish = Finish::new(Surface::Metal, [222, 176, 58], Class::Furniture);
const SAND: Finish = Finish::new(Surface::Sand, [222, 196, 148], Class::Pavement);
const SAND_M: f32 = 0.17;

/// The playground of a place.
pub(super) fn playground(mesh: &mut Mesh, place: &SeededScenery<'_>) {
    let ring = ring_of(&place.piece.shape);
    if ring.len() < 3 {
        return;
    }
    level(mesh, &Region::simple(&ring), SAND_M, SAND, 4.0);
    let mut border = ring.clone();
    border.push(ring[0]);
    along(mesh, &border, 0.16, 0.30, SLATS, SLATS);
    let centre = middle(&place.piece.shape).extend(SAND_M - 0.02);
    swing(mesh, centre + Vec3::new(-1.6, -1.5, 0.0));
    tower(mesh, centre + Vec3::new(1.7, 1.2, 0.0));
    arch(mesh, centre + Vec3::new(1.75, -1.9, 0.0));
}

/// A tube between two places.
fn tube(mesh: &mut Mesh, ends: [Vec3; 2], radius: f32, finish: Finish) {
    let sides = if radius > 0.03 { 6 } else { 3 };
    limb(mesh, &ends.map(|end| (end, radius)), sides, finish);
}

/// Two seats on chains from a bar between two pairs of slanted legs.
fn swing(mesh: &mut Mesh, at: Vec3) {
    const HALF_M: f32 = 1.6;
    const TOP_M: f32 = 2.25;
    for x in [-HALF_M, HALF_M] {
        for y in [-0.75, 0.75] {
            tube(mesh, [at + Vec3::new(1.04 * x, y, 0.0), at + Vec3::new(x, 0.0, TOP_M)], 0.045, RED);
        }
    }
    tube(mesh, [-HALF_M - 0.06, HALF_M + 0.06].map(|x| at + Vec3::new(x, 0.0, TOP_M)), 0.05, RED);
    // One seat hangs as whoever was on it left it.
    for (x, pushed) in [(-0.72, 0.0), (0.72, 0.16)] {
        let seat = at + Vec3::new(x, pushed, 0.48 + 0.08 * pushed);
        mesh.block(seat, Vec3::new(0.46, 0.19, 0.035), 0.0, IRON);
        for side in [-0.2, 0.2] {
            tube(mesh, [seat + Vec3::X * side, at + Vec3::new(x + side, 0.0, TOP_M)], 0.011, IRON);
        }
    }
}

/// A platform under a roof, with boards for a rail, a ladder and a slide.
fn tower(mesh: &mut Mesh, at: Vec3) {
    const HALF_M: f32 = 0.6;
    const FLOOR_M: f32 = 1.3;
    const POSTS_M: f32 = 2.4;
    let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(Vec2::from);
    for corner in corners {
        let foot = at + (corner * HALF_M).extend(0.0);
        tube(mesh, [foot, foot + Vec3::Z * POSTS_M], 0.06, SLATS);
    }
    mesh.block(at + Vec3::Z * (FLOOR_M - 0.08), Vec3::new(1.3, 1.3, 0.08), 0.0, SLATS.shaded(0.9));
    let under = corners.map(|corner| at + (corner * 0.65).extend(FLOOR_M - 0.08));
    mesh.plate(&[under[3], under[2], under[1], under[0]], SLATS.shaded(0.6), 2.0);
    for (k, colour) in [(0.0, BLUE), (0.24, YELLOW)] {
        let up = Vec3::Z * (FLOOR_M + 0.16 + k);
        mesh.block(at + up - Vec3::Y * HALF_M, Vec3::new(1.2, 0.04, 0.18), 0.0, colour);
        mesh.block(at + up + Vec3::X * HALF_M, Vec3::new(0.04, 1.2, 0.18), 0.0, colour);
    }
    let peak = at + Vec3::Z * (POSTS_M + 0.62);
    let eaves = corners.map(|corner| at + (corner * 0.86).extend(POSTS_M - 0.06));
    for k in 0..4 {
        let [a, b] = [eaves[k], eaves[(k + 1) % 4]];
        mesh.plate(&[a, b, peak], RED, 2.0);
        mesh.plate(&[b, a, peak], RED.shaded(0.5), 2.0);
    }
    // The ladder, to the left of the slide.
    let rail = |x: f32, share: f32| at + Vec3::new(x, HALF_M + 0.45 * (1.0 - share), share * (FLOOR_M + 0.1));
    for x in [-0.26, 0.26] {
        tube(mesh, [rail(x, 0.0), rail(x, 1.0)], 0.028, YELLOW);
    }
    for k in 1..5_u8 {
        let share = f32::from(k) / 5.0;
        tube(mesh, [rail(-0.26, share), rail(0.26, share)], 0.022, YELLOW);
    }
    slide(mesh, at + Vec3::new(-HALF_M, 0.0, FLOOR_M));
}

/// A chute that runs out level, from the place of its upper edge.
fn slide(mesh: &mut Mesh, at: Vec3) {
    const HALF_M: f32 = 0.26;
    const WALL_M: f32 = 0.15;
    let line = [(0.05, 0.0), (-0.30, -0.03), (-0.75, -0.26), (-2.0, -0.90), (-2.45, -1.04), (-2.8, -1.06)];
    let both_sides = |mesh: &mut Mesh, corners: [Vec3; 4], tone: f32| {
        mesh.plate(&corners, YELLOW, 2.0);
        let [a, b, c, d] = corners;
        mesh.plate(&[a, d, c, b], YELLOW.shaded(tone), 2.0);
    };
    for pair in line.windows(2) {
        let [upper, lower] = [pair[0], pair[1]].map(|(x, z)| at + Vec3::new(x, 0.0, z));
        let (left, up) = (Vec3::Y * HALF_M, Vec3::Z * WALL_M);
        both_sides(mesh, [upper + left, lower + left, lower - left, upper - left], 0.6);
        both_sides(mesh, [upper - left, lower - left, lower - left + up, upper - left + up], 0.85);
        both_sides(mesh, [lower + left, upper + left, upper + left + up, lower + left + up], 0.85);
    }
    let foot = at + Vec3::new(-2.3, 0.0, -1.0);
    for y in [-HALF_M, HALF_M] {
        tube(mesh, [foot + Vec3::new(0.0, y, -0.35), foot + Vec3::Y * y], 0.025, IRON);
    }
}

/// A ladder bent to an arch.
fn arch(mesh: &mut Mesh, at: Vec3) {
    const RADII_M: Vec2 = Vec2::new(1.25, 1.45);
    const PARTS: u8 = 8;
    let on = |k: u8, y: f32| {
        let (sin, cos) = (PI * f32::from(k) / f32::from(PARTS)).sin_cos();
        at + Vec3::new(RADII_M.x * cos, y, RADII_M.y * sin)
    };
    for k in 0..PARTS {
        for y in [-0.42, 0.42] {
            tube(mesh, [on(k, y), on(k + 1, y)], 0.032, BLUE);
        }
        if k > 0 {
            tube(mesh, [on(k, -0.42), on(k, 0.42)], 0.024, YELLOW);
        }
    }
}
