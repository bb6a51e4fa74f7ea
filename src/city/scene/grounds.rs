//! Level scenery: parks, beds, ponds, squares and car parks.

use super::Place;
use super::markings::WHITE;
use super::mesh::{Class, Finish, Mesh, Surface};
use super::polygon::{Region, counter_clockwise};
use super::roads::{ASPHALT, band, level};
use crate::city::{SceneryKind, Shape};
use crate::geom::point_in_polygon;
use glam::{DVec2, Vec2};

const LAWN: Finish = Finish::new(Surface::Grass, [92, 122, 62], Class::Grass);
const SQUARE: Finish = Finish::new(Surface::Slabs, [196, 182, 160], Class::Pavement);
const STONE: Finish = Finish::new(Surface::Concrete, [176, 172, 164], Class::Wall);
const SOIL: Finish = Finish::new(Surface::Flowers, [255, 255, 255], Class::Vegetation);
const POND: Finish = Finish::new(Surface::Water, [58, 96, 104], Class::Water);

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

/// Grass, beds, water, paving and car parks.
pub(super) fn ground(mesh: &mut Mesh, place: &Place<'_>) {
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
            rim(mesh, &ring, 0.24);
            level(mesh, &region, 0.19, POND, 5.0);
        }
        SceneryKind::Paving => level(mesh, &region, 0.145, SQUARE, 3.2),
        SceneryKind::Parking => {
            level(mesh, &region, 0.165, ASPHALT.shaded(1.1), 5.0);
            rim(mesh, &ring, 0.26);
            bays(mesh, &ring);
        }
        _ => level(mesh, &region, 0.125, LAWN, 6.0),
    }
}

/// A low stone edge around a ring.
fn rim(mesh: &mut Mesh, ring: &[DVec2], top: f32) {
    let profile = [Vec2::new(-0.14, 0.1), Vec2::new(-0.14, top), Vec2::new(0.12, top), Vec2::new(0.12, 0.08)];
    for pair in profile.windows(2) {
        band(mesh, ring, [pair[0], pair[1]], STONE);
    }
}

/// Slanted bays in rows along the longest edge, an aisle between each two.
fn bays(mesh: &mut Mesh, ring: &[DVec2]) {
    let count = ring.len();
    let edge = |k: usize| ring[(k + 1) % count] - ring[k];
    let longest = (0..count).max_by(|&a, &b| edge(a).length().total_cmp(&edge(b).length())).unwrap_or(0);
    let Some(along) = edge(longest).try_normalize() else { return };
    let into = along.perp();
    let depth = ring.iter().map(|p| (*p - ring[longest]).dot(into)).fold(0.0, f64::max);
    let length = edge(longest).length();
    let mut rows = vec![(0.45, 1.0)];
    if depth > 2.0 * BAY_DEPTH_M {
        rows.push((depth - 0.45, -1.0));
    }
    for (at, towards) in rows {
        let mut x = 0.8;
        while x < length - SLANT_M - 0.5 {
            let foot = ring[longest] + along * x + into * at;
            let tip = foot + along * SLANT_M + into * (towards * (BAY_DEPTH_M - 0.45));
            if point_in_polygon(foot, ring) && point_in_polygon(tip, ring) {
                let half = (tip - foot).try_normalize().unwrap_or(into).perp() * 0.055;
                let corners = counter_clockwise(&[foot - half, tip - half, tip + half, foot + half]);
                let uvs: Vec<Vec2> = corners.iter().map(|p| p.as_vec2() / 2.0).collect();
                let corners: Vec<_> = corners.iter().map(|p| p.as_vec2().extend(0.178)).collect();
                mesh.face(&corners, &uvs, WHITE);
            }
            x += BAY_M;
        }
    }
}
