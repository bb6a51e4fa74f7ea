//! Ground areas: parks, beds, ponds and squares.

use super::foliage::limb;
use super::mesh::{Class, Finish, Mesh, Surface};
use super::polygon::{Region, counter_clockwise};
use super::roads::{band, level};
use super::{SeededScenery, car_parks};
use city3d_geometry::point_in_polygon;
use city3d_roadmap::{Footprint, SceneryKind};
use glam::{DVec2, Vec2, Vec3};

const LAWN: Finish = Finish::new(Surface::Grass, [103, 122, 71], Class::Grass);
const PAVED: Finish = Finish::new(Surface::Slabs, [184, 176, 160], Class::Pavement);
const SQUARE: Finish = Finish::new(Surface::Setts, [190, 176, 156], Class::Pavement);
pub(super) const STONE: Finish = Finish::new(Surface::Concrete, [176, 172, 164], Class::Wall);
const SOIL: Finish = Finish::new(Surface::Flowers, [255, 255, 255], Class::Vegetation);
const POND: Finish = Finish::new(Surface::Water, [74, 112, 116], Class::Water);

const SWAN: Finish = Finish::new(Surface::Plain, [240, 240, 236], Class::Furniture);
const BEAK: Finish = Finish::new(Surface::Plain, [214, 112, 40], Class::Furniture);
/// Between the eyes and the bill.
const MASK: Finish = Finish::new(Surface::Plain, [34, 32, 32], Class::Furniture);

/// The footprint as a counter-clockwise ring; circles become polygons with edges of about half a metre.
pub(super) fn ring_of(shape: &Footprint) -> Vec<DVec2> {
    match shape {
        Footprint::Polygon(corners) | Footprint::Polyline(corners) => counter_clockwise(corners),
        Footprint::Circle { centre, radius_m } => {
            let count = ((radius_m * 10.0) as usize).clamp(12, 48);
            (0..count)
                .map(|k| {
                    let (sin, cos) = (std::f64::consts::TAU * k as f64 / count as f64).sin_cos();
                    *centre + DVec2::new(cos, sin) * *radius_m
                })
                .collect()
        }
    }
}

/// Distance from a footprint to a point: negative inside circles, zero inside polygons.
pub(super) fn distance_to(shape: &Footprint, point: DVec2) -> f64 {
    let to_segment = |a: DVec2, b: DVec2| {
        let along = b - a;
        let share = ((point - a).dot(along) / along.length_squared().max(1e-12)).clamp(0.0, 1.0);
        (a + along * share).distance(point)
    };
    match shape {
        Footprint::Circle { centre, radius_m } => centre.distance(point) - radius_m,
        Footprint::Polyline(line) => {
            line.windows(2).map(|w| to_segment(w[0], w[1])).fold(f64::INFINITY, f64::min)
        }
        Footprint::Polygon(ring) if point_in_polygon(point, ring) => 0.0,
        Footprint::Polygon(ring) => (0..ring.len())
            .map(|k| to_segment(ring[k], ring[(k + 1) % ring.len()]))
            .fold(f64::INFINITY, f64::min),
    }
}

/// Whether a footprint contains a point.
pub(super) fn covers(shape: &Footprint, point: DVec2) -> bool {
    match shape {
        Footprint::Circle { centre, radius_m } => centre.distance(point) <= *radius_m,
        Footprint::Polyline(_) => false,
        Footprint::Polygon(ring) => point_in_polygon(point, ring),
    }
}

/// Draws grass, beds, water, paving and car parks, whose rims are open towards these driveways; areas without
/// an edge of their own end where `beside_roads` says.
pub(super) fn ground(
    mesh: &mut Mesh,
    place: &SeededScenery<'_>,
    drives: &[&Footprint],
    beside_roads: impl Fn(&[DVec2]) -> Vec<Region>,
) {
    let ring = ring_of(&place.piece.shape);
    if ring.len() < 3 {
        return;
    }
    let region = Region::simple(&ring);
    match place.piece.kind {
        SceneryKind::Bed => {
            rim(mesh, &ring, 0.34);
            level(mesh, &region, 0.30, SOIL, 3.2);
        }
        SceneryKind::Water => {
            let top = Vec2::new(0.10, POND_M + 0.07);
            band(mesh, &ring, [Vec2::new(-0.30, POND_M - 0.03), top], SHORE);
            band(mesh, &ring, [top, Vec2::new(0.75, 0.11)], BANK);
            level(mesh, &region, POND_M, POND, 5.0);
        }
        SceneryKind::Paving => {
            let is_square = place.piece.name.contains("square") || place.piece.name.contains("court");
            // Paths cross squares.
            let (finish, repeat_m, height_m) =
                if is_square { (SQUARE, 2.2, 0.145) } else { (PAVED, 2.4, 0.155) };
            for region in beside_roads(&ring) {
                level(mesh, &region, height_m, finish, repeat_m);
            }
        }
        SceneryKind::Parking => {
            car_parks::car_park(mesh, &ring, drives);
        }
        _ => {
            for region in beside_roads(&ring) {
                level(mesh, &region, 0.125, LAWN, 6.0);
            }
        }
    }
}

/// Height of the water of ponds.
const POND_M: f32 = 0.165;
const SHORE: Finish = Finish::new(Surface::Sand, [172, 152, 116], Class::Grass);
const BANK: Finish = Finish::new(Surface::Grass, [97, 118, 65], Class::Grass);
const STONES: Finish = Finish::new(Surface::Concrete, [150, 146, 138], Class::Furniture);
const REEDS: Finish = Finish::new(Surface::Plain, [96, 118, 58], Class::Vegetation);

/// Stones, reeds and swans of a pond.
pub(super) fn pond_life(mesh: &mut Mesh, place: &SeededScenery<'_>) {
    let ring = ring_of(&place.piece.shape);
    if ring.len() < 3 {
        return;
    }
    if place.piece.name.contains("swan") {
        swans(mesh, place);
    }
    let count = ring.len() as u32;
    let at = |k: u32, out: f32| {
        let (here, next) = (ring[(k % count) as usize].as_vec2(), ring[((k + 1) % count) as usize].as_vec2());
        let outward = -(next - here).perp().normalize_or(Vec2::X);
        here.lerp(next, place.hash_to_unit(900 + k)) + outward * out
    };
    for k in 0..count / 2 {
        let hash_to_unit = |salt: u32| place.hash_to_unit(100 + 16 * k + salt);
        let spot = (hash_to_unit(1) * count as f32) as u32;
        if hash_to_unit(2) < 0.5 {
            let size = 0.16 + 0.26 * hash_to_unit(3);
            stone(
                mesh,
                at(spot, -0.12 + 0.2 * hash_to_unit(4)).extend(POND_M - 0.04),
                size,
                hash_to_unit(5) * 6.0,
            );
        } else {
            for blade in 0..9 {
                let hash_to_unit = |salt: u32| place.hash_to_unit(2000 + 160 * k + 8 * blade + salt);
                let foot = at(spot, -0.45 + 0.35 * hash_to_unit(1))
                    + Vec2::from_angle(std::f32::consts::TAU * hash_to_unit(2)) * (0.3 * hash_to_unit(3));
                reed(
                    mesh,
                    foot.extend(POND_M - 0.02),
                    0.5 + 0.6 * hash_to_unit(4),
                    std::f32::consts::TAU * hash_to_unit(5),
                );
            }
        }
    }
}

/// A boulder of a few faces.
fn stone(mesh: &mut Mesh, foot: Vec3, size: f32, turn: f32) {
    let ring = |radius: f32, z: f32, shift: f32| -> Vec<Vec3> {
        (0..5)
            .map(|k| {
                let out = Vec2::from_angle(turn + shift + std::f32::consts::TAU * k as f32 / 5.0);
                foot + (out * radius * (0.8 + 0.3 * ((k * 2 + 1) % 3) as f32 / 2.0)).extend(z)
            })
            .collect()
    };
    let (low, high) = (ring(size, 0.0, 0.0), ring(0.6 * size, 0.55 * size, 0.3));
    for k in 0..5 {
        let n = (k + 1) % 5;
        mesh.plate(&[low[k], low[n], high[n], high[k]], STONES.shaded(0.86), 1.5);
    }
    mesh.plate(&high, STONES, 1.5);
}

/// A blade of reed, visible from both sides.
fn reed(mesh: &mut Mesh, foot: Vec3, height: f32, turn: f32) {
    let side = Vec2::from_angle(turn).extend(0.0) * 0.018;
    let tip = foot + Vec3::Z * height + Vec2::from_angle(turn + 1.3).extend(0.0) * (0.22 * height);
    let finish = REEDS.shaded(0.8 + 0.35 * (turn / std::f32::consts::TAU));
    mesh.shaded_face(&[foot - side, foot + side, tip], &[Vec2::ZERO; 3], finish, &[110, 110, 250]);
    mesh.shaded_face(&[foot + side, foot - side, tip], &[Vec2::ZERO; 3], finish, &[110, 110, 250]);
}

/// Two swans on their pond.
fn swans(mesh: &mut Mesh, place: &SeededScenery<'_>) {
    let Footprint::Circle { centre, radius_m } = place.piece.shape else { return };
    for (turn, away) in [(0.7_f32, 0.35), (3.4, 0.45)] {
        let out = Vec2::from_angle(turn);
        let at = (centre.as_vec2() + out * (radius_m as f32 * away)).extend(POND_M);
        swan(mesh, at, Vec2::from_angle(turn + 1.9));
    }
}

/// A swan that swims at a place of the water: rump, folded wings, curved neck, head and bill.
fn swan(mesh: &mut Mesh, at: Vec3, ahead: Vec2) {
    let (ahead, left) = (ahead.extend(0.0), ahead.perp().extend(0.0));
    let place = |x: f32, y: f32, z: f32| at + ahead * x + left * y + Vec3::Z * z;
    let body = [
        (place(-0.66, 0.0, 0.24), 0.0),
        (place(-0.50, 0.0, 0.14), 0.11),
        (place(-0.22, 0.0, 0.06), 0.20),
        (place(0.08, 0.0, 0.04), 0.23),
        (place(0.32, 0.0, 0.06), 0.18),
        (place(0.44, 0.0, 0.09), 0.10),
        (place(0.49, 0.0, 0.10), 0.0),
    ];
    limb(mesh, &body, 8, SWAN);
    for side in [1.0, -1.0] {
        let wing = [
            (place(0.28, 0.13 * side, 0.15), 0.02),
            (place(0.12, 0.15 * side, 0.20), 0.10),
            (place(-0.20, 0.13 * side, 0.23), 0.12),
            (place(-0.50, 0.07 * side, 0.27), 0.06),
            (place(-0.68, 0.03 * side, 0.32), 0.0),
        ];
        limb(mesh, &wing, 6, SWAN.shaded(0.97));
    }
    let neck = [
        (place(0.36, 0.0, 0.10), 0.095),
        (place(0.44, 0.0, 0.24), 0.065),
        (place(0.42, 0.0, 0.38), 0.048),
        (place(0.36, 0.0, 0.52), 0.042),
        (place(0.37, 0.0, 0.64), 0.040),
        (place(0.44, 0.0, 0.71), 0.042),
    ];
    limb(mesh, &neck, 6, SWAN);
    let head =
        [(place(0.38, 0.0, 0.69), 0.025), (place(0.45, 0.0, 0.70), 0.052), (place(0.56, 0.0, 0.67), 0.026)];
    limb(mesh, &head, 6, SWAN);
    limb(mesh, &[(place(0.54, 0.0, 0.675), 0.027), (place(0.58, 0.0, 0.665), 0.022)], 5, MASK);
    limb(mesh, &[(place(0.58, 0.0, 0.665), 0.022), (place(0.68, 0.0, 0.630), 0.008)], 5, BEAK);
}

/// A low stone edge around a ring.
fn rim(mesh: &mut Mesh, ring: &[DVec2], top: f32) {
    let profile = [Vec2::new(-0.14, 0.1), Vec2::new(-0.14, top), Vec2::new(0.12, top), Vec2::new(0.12, 0.08)];
    for pair in profile.windows(2) {
        band(mesh, ring, [pair[0], pair[1]], STONE);
    }
}
