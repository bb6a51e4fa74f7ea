//! Special buildings by name: canopies, pavilions, towers, domes.

use super::buildings::DARK;
use super::mesh::{Class, Finish, Mesh, Surface, Vertex};
use super::{Wall, lettering};
use glam::{Vec2, Vec3};
use std::f32::consts::{FRAC_PI_2, TAU};

const STONE: Finish = Finish::new(Surface::Concrete, [226, 220, 206], Class::Building);
const COPPER: Finish = Finish::new(Surface::Metal, [112, 158, 142], Class::Building);
const SLATE: Finish = Finish::new(Surface::RoofTiles, [92, 94, 102], Class::Building);
const RED: Finish = Finish::new(Surface::Metal, [190, 44, 40], Class::Building);
const WHITE: Finish = Finish::new(Surface::Metal, [236, 236, 232], Class::Building);
const LENS: Finish = Finish::new(Surface::Lantern, [255, 250, 235], Class::Building);

fn middle(ring: &[Vec2]) -> Vec2 {
    ring.iter().copied().sum::<Vec2>() / ring.len().max(1) as f32
}

/// Builds an open structure; false if the name means a closed building.
pub(super) fn pavilion(mesh: &mut Mesh, name: &str, ring: &[Vec2], height: f32) -> bool {
    let centre = middle(ring);
    let columns = |mesh: &mut Mesh, inset: f32, radius: f32, finish: Finish| {
        for corner in ring {
            let foot = corner.lerp(centre, inset).extend(0.1);
            mesh.frustum(foot, [radius, radius * 0.9], height - 0.7, 10, finish);
        }
    };
    if name.contains("canopy") {
        columns(mesh, 0.18, 0.22, WHITE);
        let slab: Vec<Vec3> = ring.iter().map(|p| p.extend(height - CANOPY_M)).collect();
        mesh.prism(&slab, CANOPY_M, RED, WHITE.shaded(0.8));
        let under: Vec<Vec3> = slab.iter().rev().copied().collect();
        let first = mesh.vertices.len();
        mesh.plate(&under, WHITE, 2.0);
        mesh.set_openness(first, 130);
        for lens in lights(name, ring, height) {
            let half = Vec3::new(0.55, 0.16, 0.0);
            let corner = |x: f32, y: f32| lens + Vec3::new(x * half.x, y * half.y, -0.012);
            mesh.plate(
                &[corner(-1.0, -1.0), corner(-1.0, 1.0), corner(1.0, 1.0), corner(1.0, -1.0)],
                LENS,
                2.0,
            );
        }
        // Islands for the pumps.
        for (at, along) in islands(ring) {
            let yaw = along.to_angle();
            mesh.block(at.extend(0.1), Vec3::new(ISLAND_M, 1.1, ISLAND_TOP_M - 0.1), yaw, STONE);
        }
        return true;
    }
    if name.contains("bandstand") {
        let floor: Vec<Vec3> = ring.iter().map(|p| p.extend(0.1)).collect();
        mesh.prism(&floor, 0.5, STONE, Finish::new(Surface::Wood, [150, 116, 84], Class::Building));
        columns(mesh, 0.08, 0.10, WHITE);
        let peak = centre.extend(height + 0.9);
        for (k, corner) in ring.iter().enumerate() {
            let out = |p: Vec2| (p + (p - centre) * 0.12).extend(height - 0.65);
            let (a, b) = (out(*corner), out(ring[(k + 1) % ring.len()]));
            mesh.plate(&[a, b, peak], COPPER, 2.0);
            let first = mesh.vertices.len();
            mesh.plate(&[b, a, peak], STONE.shaded(0.8), 2.0);
            mesh.set_openness(first, 100);
        }
        return true;
    }
    false
}

/// Roof thickness of a canopy.
const CANOPY_M: f32 = 0.7;
/// Length and top height of an island under a canopy.
const ISLAND_M: f32 = 4.4;
const ISLAND_TOP_M: f32 = 0.28;

/// Centre and direction of the islands under a canopy.
fn islands(ring: &[Vec2]) -> [(Vec2, Vec2); 2] {
    let across = (ring[1] - ring[0]).normalize_or(Vec2::X);
    let place = |part: f32| middle(ring) + across * (part * ring[0].distance(ring[1]));
    [-0.22, 0.22].map(|part| (place(part), across.perp()))
}

/// Lamps under a canopy, over its pumps.
pub(super) fn lights(name: &str, ring: &[Vec2], height: f32) -> Vec<Vec3> {
    let over = |(at, _): (Vec3, Vec2)| at.truncate().extend(height - CANOPY_M);
    pumps(name, ring).into_iter().map(over).collect()
}

/// Fuel pumps under a canopy: position and direction.
pub(super) fn pumps(name: &str, ring: &[Vec2]) -> Vec<(Vec3, Vec2)> {
    if !name.contains("canopy") || ring.len() < 3 {
        return Vec::new();
    }
    let on_island = |(at, along): (Vec2, Vec2)| {
        [-1.1_f32, 1.1].map(|away| ((at + along * away).extend(ISLAND_TOP_M), along.perp()))
    };
    islands(ring).into_iter().flat_map(on_island).collect()
}

/// Height of a filling station's price board, and its distance from the canopy.
const BOARD_M: f32 = 4.6;
const BOARD_AWAY_M: f32 = 2.3;

/// Position and direction of the price board.
pub(super) fn price_board(name: &str, ring: &[Vec2]) -> Option<(Vec2, Vec2)> {
    let away = (*ring.first()? - *ring.get(1)?).try_normalize()?;
    name.contains("canopy").then(|| (ring[0] + away * BOARD_AWAY_M, away.perp()))
}

/// A board on two posts, read from both sides.
pub(super) fn price_board_at((at, along): (Vec2, Vec2)) -> Mesh {
    let mut mesh = Mesh::default();
    let yaw = along.to_angle();
    let class = |finish: Finish| Finish { class: Class::Sign, ..finish };
    for end in [-0.72_f32, 0.72] {
        let post = Finish { class: Class::Pole, ..WHITE.shaded(0.8) };
        mesh.block((at + along * end).extend(0.1), Vec3::new(0.14, 0.14, BOARD_M - 0.1), yaw, post);
    }
    for (from, to, finish) in [(3.5, BOARD_M, RED), (1.5, 3.5, DARK.shaded(0.5))] {
        let first = mesh.vertices.len();
        mesh.block(at.extend(from), Vec3::new(1.6, 0.22, to - from), yaw, class(finish));
        mesh.set_openness(first, 235);
    }
    for side in [-1.0_f32, 1.0] {
        let across = (along * side).extend(0.0);
        let face = |z: f32, out: f32| (at - along.perp() * (side * out)).extend(z);
        let board = class(Finish::new(Surface::Plain, [232, 206, 110], Class::Sign));
        for (z, text) in [(4.05, "FUEL"), (3.02, "1 79"), (2.48, "1 86"), (1.94, "1 58")] {
            lettering::write(&mut mesh, text, face(z, 0.115), across, [1.36, 0.34], board);
        }
    }
    mesh
}

/// Whether [`pavilion`] builds it.
pub(super) fn is_open(name: &str) -> bool {
    name.contains("canopy") || name.contains("bandstand")
}

/// Portico of a theatre: height share of its columns, height of the lintel, and its projection from the wall.
const PORTICO: f32 = 0.62;
const LINTEL_M: f32 = 0.9;
const PORTICO_OUT_M: f32 = 1.45;

/// Height of the name board on a portico, and its distance from the wall.
pub(super) fn board_on_portico(name: &str, height: f32) -> Option<(f32, f32)> {
    let z = 0.1 + PORTICO * height + LINTEL_M / 2.0;
    name.contains("theatre").then_some((z, PORTICO_OUT_M + 0.06))
}

/// How far what stands on the ground before a building is from its walls, metres.
pub(super) fn projection_m(name: &str) -> f64 {
    if name.contains("theatre") { f64::from(PORTICO_OUT_M) } else { 0.0 }
}

/// Half width of the town hall's tower.
const CLOCKS_OUT_M: f32 = 1.8;

/// Towers, domes and spires on closed buildings.
pub(super) fn additions(mesh: &mut Mesh, name: &str, ring: &[Vec2], height: f32) {
    let centre = middle(ring);
    let yaw = (ring[1] - ring[0]).to_angle();
    if name.contains("town hall") {
        let foot = centre.extend(height - 0.5);
        mesh.block(foot, Vec3::new(2.0 * CLOCKS_OUT_M, 2.0 * CLOCKS_OUT_M, 6.5), yaw, STONE);
        spire(mesh, centre.extend(height + 6.0), 2.0, 4.2, yaw, COPPER);
    } else if name.contains("chapel") {
        let foot = ring[0].lerp(centre, 0.35);
        mesh.block(foot.extend(0.1), Vec3::new(3.2, 3.2, height + 2.5), yaw, STONE);
        spire(mesh, foot.extend(height + 2.6), 1.8, 6.0, yaw, SLATE);
    } else if name.contains("observatory") {
        dome(mesh, centre.extend(height), 0.34 * ring[0].distance(ring[1]).min(ring[1].distance(ring[2])));
    } else if name.contains("hose tower") {
        spire(mesh, centre.extend(height + 0.5), 0.56 * ring[0].distance(ring[1]), 1.6, yaw, SLATE);
    } else if name.contains("factory") || name.contains("mill") {
        mesh.frustum(ring[2].lerp(centre, 0.3).extend(0.1), [0.9, 0.6], height + 7.0, 14, DARK.shaded(2.0));
    } else if name.contains("theatre") {
        // A portico along the first side.
        let out = -(ring[1] - ring[0]).normalize_or(Vec2::X).perp();
        for k in 0..5 {
            let at = ring[0].lerp(ring[1], 0.16 + 0.17 * k as f32) + out * 0.9;
            mesh.frustum(at.extend(0.1), [0.34, 0.28], PORTICO * height, 12, STONE);
        }
        let slab = (ring[0] + ring[1]) / 2.0 + out * (PORTICO_OUT_M - 0.75);
        let size = Vec3::new(0.8 * ring[0].distance(ring[1]), 1.5, LINTEL_M);
        mesh.block(slab.extend(0.1 + PORTICO * height), size, yaw, STONE);
    }
}

/// A square tower of a closed building as walls, and its spire as narrower ones: what hides there.
pub(super) fn tower(name: &str, ring: &[Vec2], height: f32) -> Vec<Wall> {
    let centre = middle(ring);
    let (foot, half, top, spire_m) = if name.contains("town hall") {
        (centre, CLOCKS_OUT_M, height + 6.0, 4.2)
    } else if name.contains("chapel") {
        (ring[0].lerp(centre, 0.35), 1.6, height + 2.6, 6.0)
    } else {
        return Vec::new();
    };
    let yaw = (ring[1] - ring[0]).to_angle();
    let square = |half: f32, height_m: f32| {
        let corner = move |k: usize| {
            let out = Vec2::from_angle(yaw + FRAC_PI_2 * (k as f32 + 0.5));
            foot + out * (half * std::f32::consts::SQRT_2)
        };
        (0..4).map(move |k| Wall { from: corner(k), to: corner(k + 1), height_m })
    };
    let steps = [(1.0, 0.0), (0.7, 0.3), (0.4, 0.6), (0.15, 0.85)];
    steps.into_iter().flat_map(|(width, up)| square(width * half, top + up * spire_m)).collect()
}

/// Radius of a tower or dome on the roof, if any.
pub(super) fn spire_reach(name: &str, ring: &[Vec2]) -> Option<f32> {
    let has_one = ["town hall", "observatory", "hose tower"].iter().any(|known| name.contains(known));
    let short = ring[0].distance(ring[1]).min(ring[1].distance(ring[2]));
    has_one.then(|| if name.contains("town hall") { 2.9 } else { 0.8 * short })
}

fn spire(mesh: &mut Mesh, foot: Vec3, half: f32, height: f32, yaw: f32, finish: Finish) {
    let corner = |k: usize| {
        let at = Vec2::from_angle(yaw + FRAC_PI_2 * (k as f32 + 0.5)) * (half * std::f32::consts::SQRT_2);
        foot + at.extend(0.0)
    };
    for k in 0..4 {
        mesh.plate(&[corner(k), corner(k + 1), foot + Vec3::Z * height], finish, 3.0);
    }
}

/// Clocks on a tower, if any. They protrude so far that simplified towers do not cover them.
pub(super) fn clocks(name: &str, ring: &[Vec2], height: f32) -> Option<Mesh> {
    if !name.contains("town hall") || ring.len() < 3 {
        return None;
    }
    let yaw = (ring[1] - ring[0]).to_angle();
    let mut mesh = Mesh::default();
    for k in 0..4 {
        let out = Vec2::from_angle(yaw + FRAC_PI_2 * k as f32);
        clock(&mut mesh, (middle(ring) + out * CLOCKS_OUT_M).extend(height + 4.4), out);
    }
    Some(mesh)
}

/// A clock on a wall that faces `out`.
fn clock(mesh: &mut Mesh, centre: Vec3, out: Vec2) {
    const SIDES: u32 = 16;
    const RIM_M: f32 = 0.16;
    let across = out.perp().extend(0.0);
    let at = |k: u32, radius: f32, lift: f32| {
        let (sin, cos) = (TAU * k as f32 / SIDES as f32).sin_cos();
        centre + out.extend(0.0) * lift + (across * cos + Vec3::Z * sin) * radius
    };
    for k in 0..SIDES {
        let side = [at(k, 1.05, 0.0), at(k + 1, 1.05, 0.0), at(k + 1, 1.05, RIM_M), at(k, 1.05, RIM_M)];
        let face = [at(k, 1.05, RIM_M), at(k + 1, 1.05, RIM_M), at(k + 1, 0.92, RIM_M), at(k, 0.92, RIM_M)];
        mesh.plate(&side, DARK, 2.0);
        mesh.plate(&face, DARK, 2.0);
    }
    let dial: Vec<Vec3> = (0..SIDES).map(|k| at(k, 0.92, RIM_M)).collect();
    mesh.plate(&dial, WHITE, 2.0);
    for (angle, length) in [(FRAC_PI_2, 0.75_f32), (0.35, 0.5)] {
        let (sin, cos) = f32::sin_cos(angle);
        let along = across * cos + Vec3::Z * sin;
        let side = (across * -sin + Vec3::Z * cos) * 0.05;
        let foot = centre + out.extend(0.0) * (RIM_M + 0.02);
        mesh.plate(
            &[foot - side, foot + along * length - side, foot + along * length + side, foot + side],
            DARK,
            2.0,
        );
    }
}

fn dome(mesh: &mut Mesh, foot: Vec3, radius: f32) {
    const AROUND: u32 = 20;
    const RINGS: u32 = 6;
    mesh.frustum(foot, [radius, radius], 1.2, AROUND, STONE);
    let base = mesh.vertices.len() as u32;
    for ring in 0..=RINGS {
        let (up, wide) = (FRAC_PI_2 * ring as f32 / RINGS as f32).sin_cos();
        for k in 0..=AROUND {
            let (sin, cos) = (TAU * k as f32 / AROUND as f32).sin_cos();
            let normal = Vec3::new(cos * wide, sin * wide, up);
            let position = foot + Vec3::Z * 1.2 + normal * radius;
            mesh.vertex(Vertex { position, normal, uv: Vec2::ZERO, finish: WHITE, openness: 255 });
        }
    }
    for ring in 0..RINGS {
        for k in 0..AROUND {
            let a = base + ring * (AROUND + 1) + k;
            let b = a + AROUND + 1;
            mesh.indices.extend([a, a + 1, b + 1, a, b + 1, b]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tower_and_its_spire_hide_what_is_behind_them_nearly_up_to_the_tip() {
        let ring = [[-8.0, -6.0], [8.0, -6.0], [8.0, 6.0], [-8.0, 6.0]].map(Vec2::from);
        for name in ["town hall", "chapel"] {
            let mut mesh = Mesh::default();
            additions(&mut mesh, name, &ring, 10.0);
            let tip_m = mesh.vertices.iter().map(|vertex| vertex.position.z).fold(0.0, f32::max);
            let walls = tower(name, &ring, 10.0);
            let highest = walls.iter().max_by(|a, b| a.height_m.total_cmp(&b.height_m)).unwrap();
            assert!(
                (tip_m - 1.0..=tip_m).contains(&highest.height_m),
                "{name}: {highest:?}, tip at {tip_m} m"
            );
            let foot_m = walls.iter().map(|wall| wall.from.distance(wall.to)).fold(0.0, f32::max);
            assert!(foot_m > 3.0 && highest.from.distance(highest.to) < 0.2 * foot_m, "narrower towards it");
        }
    }
}
