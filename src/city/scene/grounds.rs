//! Level scenery: parks, beds, ponds, squares and car parks.

use super::Place;
use super::mesh::{Class, Finish, Mesh, Surface};
use super::polygon::{Region, counter_clockwise};
use super::roads::{ASPHALT, band, level};
use crate::city::{SceneryKind, Shape};
use crate::geom::point_in_polygon;
use glam::{DVec2, Vec2, Vec3};

const LAWN: Finish = Finish::new(Surface::Grass, [98, 116, 68], Class::Grass);
const PAVED: Finish = Finish::new(Surface::Slabs, [184, 176, 160], Class::Pavement);
const SQUARE: Finish = Finish::new(Surface::Setts, [190, 176, 156], Class::Pavement);
const STONE: Finish = Finish::new(Surface::Concrete, [176, 172, 164], Class::Wall);
const SOIL: Finish = Finish::new(Surface::Flowers, [255, 255, 255], Class::Vegetation);
const POND: Finish = Finish::new(Surface::Water, [74, 112, 116], Class::Water);

const SWAN: Finish = Finish::new(Surface::Plain, [240, 240, 236], Class::Furniture);
const BEAK: Finish = Finish::new(Surface::Plain, [214, 112, 40], Class::Furniture);

/// A parking bay: along the row and into it.
const BAY_M: f64 = 3.0;
const BAY_DEPTH_M: f64 = 5.6;
/// How far a bay leans over from end to end.
const SLANT_M: f64 = 1.9;

/// The ground plan as a counter-clockwise ring; circles in pieces of half a metre or so.
pub(super) fn ring_of(shape: &Shape) -> Vec<DVec2> {
    match shape {
        Shape::Polygon(corners) | Shape::Polyline(corners) => counter_clockwise(corners),
        Shape::Circle { centre, radius_m } => {
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

/// From a shape to a point: negative inside circles, zero inside polygons.
pub(super) fn distance_to(shape: &Shape, point: DVec2) -> f64 {
    let to_segment = |a: DVec2, b: DVec2| {
        let along = b - a;
        let share = ((point - a).dot(along) / along.length_squared().max(1e-12)).clamp(0.0, 1.0);
        (a + along * share).distance(point)
    };
    match shape {
        Shape::Circle { centre, radius_m } => centre.distance(point) - radius_m,
        Shape::Polyline(line) => {
            line.windows(2).map(|w| to_segment(w[0], w[1])).fold(f64::INFINITY, f64::min)
        }
        Shape::Polygon(ring) if point_in_polygon(point, ring) => 0.0,
        Shape::Polygon(ring) => (0..ring.len())
            .map(|k| to_segment(ring[k], ring[(k + 1) % ring.len()]))
            .fold(f64::INFINITY, f64::min),
    }
}

/// Whether a point lies in a shape, without the way to its edge.
pub(super) fn covers(shape: &Shape, point: DVec2) -> bool {
    match shape {
        Shape::Circle { centre, radius_m } => centre.distance(point) <= *radius_m,
        Shape::Polyline(_) => false,
        Shape::Polygon(ring) => point_in_polygon(point, ring),
    }
}

/// Grass, beds, water, paving and car parks, whose rims are open towards these drives.
pub(super) fn ground(mesh: &mut Mesh, place: &Place<'_>, drives: &[&Shape]) {
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
            level(mesh, &region, height_m, finish, repeat_m);
        }
        SceneryKind::Parking => {
            level(mesh, &region, 0.165, ASPHALT, 5.0);
            open_rim(mesh, &ring, 0.26, drives);
            bays(mesh, &ring);
        }
        _ => level(mesh, &region, 0.125, LAWN, 6.0),
    }
}

/// Height of the water of ponds.
const POND_M: f32 = 0.165;
const SHORE: Finish = Finish::new(Surface::Sand, [172, 152, 116], Class::Grass);
const BANK: Finish = Finish::new(Surface::Grass, [92, 112, 62], Class::Grass);
const STONES: Finish = Finish::new(Surface::Concrete, [150, 146, 138], Class::Furniture);
const REEDS: Finish = Finish::new(Surface::Plain, [96, 118, 58], Class::Vegetation);

/// What stands on the banks of a pond and swims on it: stones, reeds, swans.
pub(super) fn pond_life(mesh: &mut Mesh, place: &Place<'_>) {
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
        here.lerp(next, place.dice(900 + k)) + outward * out
    };
    for k in 0..count / 2 {
        let dice = |salt: u32| place.dice(100 + 16 * k + salt);
        let spot = (dice(1) * count as f32) as u32;
        if dice(2) < 0.5 {
            let size = 0.16 + 0.26 * dice(3);
            stone(mesh, at(spot, -0.12 + 0.2 * dice(4)).extend(POND_M - 0.04), size, dice(5) * 6.0);
        } else {
            for blade in 0..9 {
                let dice = |salt: u32| place.dice(2000 + 160 * k + 8 * blade + salt);
                let foot = at(spot, -0.45 + 0.35 * dice(1))
                    + Vec2::from_angle(std::f32::consts::TAU * dice(2)) * (0.3 * dice(3));
                reed(mesh, foot.extend(POND_M - 0.02), 0.5 + 0.6 * dice(4), std::f32::consts::TAU * dice(5));
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

/// A blade that is seen from both sides.
fn reed(mesh: &mut Mesh, foot: Vec3, height: f32, turn: f32) {
    let side = Vec2::from_angle(turn).extend(0.0) * 0.018;
    let tip = foot + Vec3::Z * height + Vec2::from_angle(turn + 1.3).extend(0.0) * (0.22 * height);
    let finish = REEDS.shaded(0.8 + 0.35 * (turn / std::f32::consts::TAU));
    mesh.shaded_face(&[foot - side, foot + side, tip], &[Vec2::ZERO; 3], finish, &[110, 110, 250]);
    mesh.shaded_face(&[foot + side, foot - side, tip], &[Vec2::ZERO; 3], finish, &[110, 110, 250]);
}

/// Two swans on their pond.
fn swans(mesh: &mut Mesh, place: &Place<'_>) {
    let Shape::Circle { centre, radius_m } = place.piece.shape else { return };
    for (turn, away) in [(0.7_f32, 0.35), (3.4, 0.45)] {
        let out = Vec2::from_angle(turn);
        let at = (centre.as_vec2() + out * (radius_m as f32 * away)).extend(POND_M - 0.02);
        let ahead = Vec2::from_angle(turn + 1.9).extend(0.0);
        let side = Vec3::Z.cross(ahead);
        // A section across the body from the tail to the breast: along, half width, height.
        let rows = [
            (-0.55, 0.02, 0.40),
            (-0.30, 0.20, 0.34),
            (0.05, 0.26, 0.36),
            (0.36, 0.16, 0.30),
            (0.46, 0.03, 0.20),
        ];
        let ridge = |(x, _, high): (f32, f32, f32)| at + ahead * x + Vec3::Z * high;
        let edge =
            |(x, half, _): (f32, f32, f32), sign: f32| at + ahead * x + side * (half * sign) + Vec3::Z * 0.06;
        for pair in rows.windows(2) {
            let [a, b] = [pair[0], pair[1]];
            mesh.plate(&[edge(a, -1.0), edge(b, -1.0), ridge(b), ridge(a)], SWAN, 1.0);
            mesh.plate(&[edge(b, 1.0), edge(a, 1.0), ridge(a), ridge(b)], SWAN, 1.0);
        }
        let neck = at + ahead * 0.40;
        mesh.frustum(neck + Vec3::Z * 0.16, [0.06, 0.035], 0.56, 6, SWAN);
        let head = neck + ahead * 0.07 + Vec3::Z * 0.70;
        mesh.block(head, Vec3::new(0.22, 0.09, 0.09), ahead.y.atan2(ahead.x), SWAN);
        mesh.block(head + ahead * 0.15, Vec3::new(0.10, 0.05, 0.05), ahead.y.atan2(ahead.x), BEAK);
    }
}

/// A low stone edge around a ring.
fn rim(mesh: &mut Mesh, ring: &[DVec2], top: f32) {
    let profile = [Vec2::new(-0.14, 0.1), Vec2::new(-0.14, top), Vec2::new(0.12, top), Vec2::new(0.12, 0.08)];
    for pair in profile.windows(2) {
        band(mesh, ring, [pair[0], pair[1]], STONE);
    }
}

/// A [`rim`] with gaps where drives reach it.
fn open_rim(mesh: &mut Mesh, ring: &[DVec2], top: f32, drives: &[&Shape]) {
    /// Drives end this near the ring, and gaps are found in steps of so much.
    const NEAR_M: f64 = 0.3;
    const STEP_M: f64 = 0.1;
    let count = ring.len();
    let along = |k: usize| (ring[(k + 1) % count] - ring[k % count]).try_normalize().unwrap_or(DVec2::X);
    // Outwards at a corner, longer there so that the edge keeps its width.
    let outward = |k: usize| {
        let (before, after) = (along(k + count - 1), along(k));
        let mean = (before + after).try_normalize().unwrap_or(after);
        -mean.perp() / mean.dot(after).max(0.4)
    };
    for k in 0..count {
        let (from, to) = (ring[k], ring[(k + 1) % count]);
        let steps = (from.distance(to) / STEP_M).ceil().max(1.0) as usize;
        let at = |step: usize| from.lerp(to, step as f64 / steps as f64);
        let is_closed = |step: usize| drives.iter().all(|drive| distance_to(drive, at(step)) > NEAR_M);
        let mut step = 0;
        while step < steps {
            let first = step;
            while step < steps && is_closed(step) && is_closed(step + 1) {
                step += 1;
            }
            if step > first {
                let end = |step: usize, corner: usize| {
                    if step == 0 || step == steps { outward(corner) } else { -along(k).perp() }
                };
                let (a, b) = (end(first, k), end(step, (k + 1) % count));
                let corner = |at: DVec2, out: DVec2| at.as_vec2().extend(0.08) + out.as_vec2().extend(0.0);
                let quad = [
                    corner(at(first), a * 0.12),
                    corner(at(step), b * 0.12),
                    corner(at(step), b * -0.14),
                    corner(at(first), a * -0.14),
                ];
                mesh.prism(&quad, top - 0.08, STONE, STONE);
            }
            step += 1;
        }
    }
}

/// A parking bay: the middle of its mouth, where a car in it looks, and its number.
pub(super) struct Bay {
    pub(super) mouth: DVec2,
    pub(super) into: DVec2,
}

/// Rows of slanted bays along the longest edge, an aisle between each two: the feet and tips of the
/// lines between bays, row by row.
fn bay_lines(ring: &[DVec2]) -> Vec<Vec<[DVec2; 2]>> {
    let count = ring.len();
    let edge = |k: usize| ring[(k + 1) % count] - ring[k];
    let longest = (0..count).max_by(|&a, &b| edge(a).length().total_cmp(&edge(b).length())).unwrap_or(0);
    let Some(along) = edge(longest).try_normalize() else { return Vec::new() };
    let into = along.perp();
    let depth = ring.iter().map(|p| (*p - ring[longest]).dot(into)).fold(0.0, f64::max);
    let length = edge(longest).length();
    let mut rows = vec![(0.45, 1.0)];
    if depth > 2.0 * BAY_DEPTH_M {
        rows.push((depth - 0.45, -1.0));
    }
    rows.into_iter()
        .map(|(at, towards)| {
            let mut lines = Vec::new();
            let mut x = 0.8;
            while x < length - SLANT_M - 0.5 {
                let foot = ring[longest] + along * x + into * at;
                let tip = foot + along * SLANT_M + into * (towards * (BAY_DEPTH_M - 0.45));
                if point_in_polygon(foot, ring) && point_in_polygon(tip, ring) {
                    lines.push([foot, tip]);
                }
                x += BAY_M;
            }
            lines
        })
        .collect()
}

/// The bays of a car park.
pub(super) fn bays_of(ring: &[DVec2]) -> Vec<Bay> {
    let between = |pair: &[[DVec2; 2]]| {
        let [a, b] = [pair[0], pair[1]];
        let (foot, tip) = ((a[0] + b[0]) / 2.0, (a[1] + b[1]) / 2.0);
        Bay { mouth: tip, into: (foot - tip).try_normalize().unwrap_or(DVec2::X) }
    };
    bay_lines(ring).iter().flat_map(|row| row.windows(2).map(between).collect::<Vec<_>>()).collect()
}

/// Heights of paint in car parks.
const PAINT_M: f32 = 0.178;
const BLUE: Finish = Finish::new(Surface::Paint, [44, 92, 158], Class::Marking);

fn bays(mesh: &mut Mesh, ring: &[DVec2]) {
    let rows = bay_lines(ring);
    for &[foot, tip] in rows.iter().flatten() {
        super::markings::straight_line(mesh, foot, tip, PAINT_M);
    }
    for row in &rows {
        aisle_arrows(mesh, ring, row);
    }
    if let Some(bay) = bays_of(ring).first() {
        wheelchair_bay(mesh, bay);
    }
}

/// Arrows along the aisle in front of a row of bays, where there is room for it.
fn aisle_arrows(mesh: &mut Mesh, ring: &[DVec2], row: &[[DVec2; 2]]) {
    const AISLE_M: f64 = 2.0;
    let (Some([foot, tip]), Some([last, _])) = (row.first(), row.last()) else { return };
    let Some(along) = (*last - *foot).try_normalize() else { return };
    let into = if (*tip - *foot).dot(along.perp()) > 0.0 { along.perp() } else { -along.perp() };
    // Bays on the left have traffic of one direction, those on the right of the other.
    let (length, ahead) = ((*last - *foot).length(), along * into.dot(along.perp()).signum());
    let mut s = 4.0;
    while s < length {
        let middle = *foot + along * (s + SLANT_M) + into * (BAY_DEPTH_M - 0.45 + AISLE_M);
        let at = |x: f64, y: f64| middle + ahead * x + ahead.perp() * y;
        let room = [at(-2.0, -1.4), at(-2.0, 1.4), at(2.0, 1.4), at(2.0, -1.4)];
        if room.iter().all(|&corner| point_in_polygon(corner, ring)) {
            let white = |mesh: &mut Mesh, corners: &[DVec2]| {
                super::markings::figure(mesh, corners, PAINT_M, super::markings::WHITE);
            };
            white(mesh, &[at(-1.3, -0.08), at(0.4, -0.08), at(0.4, 0.08), at(-1.3, 0.08)]);
            white(mesh, &[at(0.4, -0.32), at(1.3, 0.0), at(0.4, 0.32)]);
        }
        s += 14.0;
    }
}

/// A bay for wheelchairs: blue, with the sign on it.
fn wheelchair_bay(mesh: &mut Mesh, bay: &Bay) {
    let (up, right) = (bay.into, -bay.into.perp());
    let middle = bay.mouth + up * 2.3;
    let at = |x: f64, y: f64| middle + right * x + up * y;
    let square = [at(-0.85, -0.95), at(0.85, -0.95), at(0.85, 0.95), at(-0.85, 0.95)];
    super::markings::figure(mesh, &square, PAINT_M, BLUE);
    let z = PAINT_M + 0.006;
    let mut stroke = |points: &[(f64, f64)], half: f64| {
        for pair in points.windows(2) {
            let (a, b) = (at(pair[0].0, pair[0].1), at(pair[1].0, pair[1].1));
            let Some(ahead) = (b - a).try_normalize() else { continue };
            let (long, side) = (ahead * half, ahead.perp() * half);
            let corners = [a - long - side, b + long - side, b + long + side, a - long + side];
            super::markings::figure(mesh, &corners, z, super::markings::WHITE);
        }
    };
    // Head, body, legs, and most of a wheel.
    stroke(&[(-0.14, 0.62), (-0.10, 0.62)], 0.09);
    stroke(&[(-0.12, 0.42), (-0.08, 0.02), (0.26, 0.02), (0.42, -0.46), (0.56, -0.42)], 0.055);
    let wheel = (0..=9).map(|k| {
        let (sin, cos) = (2.1 + 4.1 * f64::from(k) / 9.0).sin_cos();
        (-0.06 + 0.40 * cos, -0.22 + 0.40 * sin)
    });
    stroke(&wheel.collect::<Vec<_>>(), 0.045);
}
