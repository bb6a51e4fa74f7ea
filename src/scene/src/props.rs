//! Garden walls, playgrounds, and placement of furniture.

use super::doorways::{Way, opened};
use super::furniture::{Furniture, FurnitureKind};
use super::grounds::ring_of;
use super::lanes::LaneBoxIndex;
use super::mesh::{Class, Finish, Mesh, Surface};
use super::polygon::Region;
use super::roads::level;
use super::{SceneObject, SeededScenery};
use city3d_roadmap::{Footprint, Scenery};
use glam::{DVec2, Vec2, Vec3};

const STONE_WALL: Finish = Finish::new(Surface::Brick, [188, 168, 146], Class::Wall);
const COPING: Finish = Finish::new(Surface::Concrete, [196, 192, 184], Class::Wall);
const SLATS: Finish = Finish::new(Surface::Wood, [150, 108, 70], Class::Furniture);
const IRON: Finish = Finish::new(Surface::Metal, [58, 60, 62], Class::Furniture);

/// Depth of furniture feet in lawns and between slabs.
const FOOT_M: f32 = 0.13;

/// A prism along an open line.
pub(super) fn along(mesh: &mut Mesh, line: &[DVec2], width: f32, height: f32, side: Finish, top: Finish) {
    for pair in line.windows(2) {
        let (a, b) = (pair[0].as_vec2(), pair[1].as_vec2());
        let Some(ahead) = (b - a).try_normalize() else { continue };
        let half = ahead.perp() * (width / 2.0);
        // Pieces overlap in corners.
        let (a, b) = (a - ahead * (width / 2.0), b + ahead * (width / 2.0));
        let ring = [a - half, b - half, b + half, a + half].map(|p| p.extend(0.05));
        mesh.prism(&ring, height, side, top);
    }
}

/// A wall within a polygon, or along what openings at these ways leave of a line.
pub(super) fn wall(mesh: &mut Mesh, place: &SeededScenery<'_>, ways: &[Way]) {
    let height = place.piece.height_m.map_or(0.9, |h| h as f32);
    match &place.piece.shape {
        Footprint::Polyline(line) => {
            let left = opened(line, ways);
            left.iter().for_each(|line| along(mesh, line, 0.30, height, STONE_WALL, STONE_WALL));
            for pair in left.iter().flat_map(|line| line.windows(2)) {
                let (a, b) = (pair[0].as_vec2(), pair[1].as_vec2());
                let yaw = (b - a).to_angle();
                let size = Vec3::new(a.distance(b) + 0.4, 0.42, 0.10);
                mesh.block(((a + b) / 2.0).extend(0.05 + height), size, yaw, COPING);
            }
        }
        shape => {
            let ring: Vec<Vec3> = ring_of(shape).iter().map(|p| p.as_vec2().extend(0.05)).collect();
            mesh.prism(&ring, height, STONE_WALL, COPING);
        }
    }
}

fn middle(shape: &Footprint) -> Vec2 {
    match shape {
        Footprint::Circle { centre, .. } => centre.as_vec2(),
        Footprint::Polygon(points) | Footprint::Polyline(points) => {
            points.iter().map(|p| p.as_vec2()).sum::<Vec2>() / points.len().max(1) as f32
        }
    }
}

/// Length, width and heading of a rectangular ground plan.
fn rectangle(shape: &Footprint) -> (f32, f32, f32) {
    match shape {
        Footprint::Polygon(points) | Footprint::Polyline(points) if points.len() > 2 => {
            let (a, b) = ((points[1] - points[0]).as_vec2(), (points[2] - points[1]).as_vec2());
            if a.length() >= b.length() {
                (a.length(), b.length(), a.to_angle())
            } else {
                (b.length(), a.length(), b.to_angle())
            }
        }
        _ => (1.8, 0.6, 0.0),
    }
}

/// A street lamp whose arm reaches over the nearest lane.
pub(super) fn lamp(
    place: &SeededScenery<'_>,
    lanes: &LaneBoxIndex<'_>,
    furniture: &Furniture,
) -> SceneObject {
    let foot = middle(&place.piece.shape);
    let nearest = lanes.nearest(foot.as_dvec2());
    let towards = nearest.map_or(Vec2::X, |at| (at.as_vec2() - foot).normalize_or(Vec2::X));
    // The stated height scales the lamp.
    let stated = place.piece.height_m.zip(furniture.height(FurnitureKind::Lamp));
    let scale = stated.map_or(1.0, |(stated, own)| stated as f32 / own);
    furniture.place(FurnitureKind::Lamp, foot.extend(0.08), towards, scale)
}

/// Middle of a bench, and where one looks who sits on it.
pub(super) fn bench_place(bench: &Scenery) -> (Vec2, Vec2) {
    let (.., yaw) = rectangle(&bench.shape);
    (middle(&bench.shape), -Vec2::from_angle(yaw).perp())
}

/// A bench, and for some a bin beside it.
pub(super) fn bench(
    place: &SeededScenery<'_>,
    furniture: &Furniture,
    is_free: impl Fn(Vec2) -> bool,
) -> Vec<SceneObject> {
    let (length, ..) = rectangle(&place.piece.shape);
    let (at, front) = bench_place(place.piece);
    let ahead = front.perp();
    let mut pieces = vec![furniture.place(FurnitureKind::Bench, at.extend(FOOT_M), front, 1.0)];
    let beside = [1.0_f32, -1.0].map(|side| at + ahead * (side * (length / 2.0 + 0.55)));
    if place.hash_to_unit(2) < 0.5
        && let Some(&spot) = beside.iter().find(|&&spot| is_free(spot))
    {
        pieces.push(furniture.place(FurnitureKind::Bin, spot.extend(FOOT_M), front, 1.0));
    }
    pieces
}

pub(super) fn picnic_table(place: &SeededScenery<'_>, furniture: &Furniture) -> SceneObject {
    let (.., yaw) = rectangle(&place.piece.shape);
    let front = -Vec2::from_angle(yaw).perp();
    furniture.place(FurnitureKind::PicnicTable, middle(&place.piece.shape).extend(FOOT_M), front, 1.0)
}

/// Sand with a swing, a slide and a climbing frame.
pub(super) fn playground(mesh: &mut Mesh, place: &SeededScenery<'_>) {
    const RED: Finish = Finish::new(Surface::Metal, [204, 58, 48], Class::Furniture);
    const BLUE: Finish = Finish::new(Surface::Metal, [52, 108, 178], Class::Furniture);
    const YELLOW: Finish = Finish::new(Surface::Metal, [236, 190, 60], Class::Furniture);
    let ring = ring_of(&place.piece.shape);
    if ring.len() < 3 {
        return;
    }
    let sand = Finish::new(Surface::Sand, [222, 196, 148], Class::Pavement);
    level(mesh, &Region::simple(&ring), 0.17, sand, 4.0);
    let mut border = ring.clone();
    border.push(ring[0]);
    along(mesh, &border, 0.16, 0.30, SLATS, SLATS);
    let centre = middle(&place.piece.shape).extend(0.15);
    // Swing.
    let swing = centre + Vec3::new(-1.9, -1.4, 0.0);
    for x in [-1.5, 1.5] {
        for y in [-0.6_f32, 0.6] {
            mesh.block(swing + Vec3::new(x, y * 0.7, 0.0), Vec3::new(0.09, 0.09, 2.2), 0.0, RED);
        }
    }
    mesh.block(swing + Vec3::Z * 2.15, Vec3::new(3.2, 0.10, 0.10), 0.0, RED);
    for x in [-0.7, 0.7] {
        mesh.block(swing + Vec3::new(x, 0.0, 0.55), Vec3::new(0.45, 0.22, 0.05), 0.0, IRON);
        for dx in [-0.2, 0.2] {
            mesh.block(swing + Vec3::new(x + dx, 0.0, 0.58), Vec3::new(0.025, 0.025, 1.6), 0.0, IRON);
        }
    }
    // Tower with a slide.
    let tower = centre + Vec3::new(1.7, 1.2, 0.0);
    for (x, y) in [(-0.6, -0.6), (0.6, -0.6), (-0.6, 0.6), (0.6, 0.6)] {
        mesh.block(tower + Vec3::new(x, y, 0.0), Vec3::new(0.11, 0.11, 2.3), 0.0, SLATS);
    }
    mesh.block(tower + Vec3::Z * 1.25, Vec3::new(1.3, 1.3, 0.08), 0.0, SLATS);
    let peak = tower + Vec3::Z * 3.0;
    let eaves =
        [(-0.8, -0.8), (0.8, -0.8), (0.8, 0.8), (-0.8, 0.8)].map(|(x, y)| tower + Vec3::new(x, y, 2.3));
    for k in 0..4 {
        mesh.plate(&[eaves[k], eaves[(k + 1) % 4], peak], BLUE, 2.0);
    }
    let slide = [(-0.6, -0.3, 1.3), (-0.6, 0.3, 1.3), (-3.0, 0.3, 0.2), (-3.0, -0.3, 0.2)]
        .map(|(x, y, z)| tower + Vec3::new(x, y, z));
    mesh.plate(&slide, YELLOW, 2.0);
    let [a, b, c, d] = slide;
    mesh.plate(&[a, d, c, b], YELLOW, 2.0);
    // Climbing dome of hoops, as a low frame.
    let frame = centre + Vec3::new(1.6, -1.9, 0.0);
    for k in 0..4 {
        let x = -0.9 + 0.6 * k as f32;
        mesh.block(frame + Vec3::new(x, 0.0, 0.0), Vec3::new(0.07, 0.07, 1.5), 0.0, YELLOW);
        mesh.block(
            frame + Vec3::new(0.0, 0.0, 0.35 + 0.36 * k as f32),
            Vec3::new(1.9, 0.06, 0.06),
            0.0,
            BLUE,
        );
    }
}
