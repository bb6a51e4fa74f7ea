//! Garden walls, playgrounds, and placement of furniture.

use super::doorways::{Way, opened};
use super::furniture::{Furniture, FurnitureKind};
use super::grounds::ring_of;
use super::lanes::LaneBoxIndex;
use super::mesh::{Class, Finish, Mesh, Surface};
use super::{SceneObject, SeededScenery};
use city3d_roadmap::{Footprint, Scenery};
use glam::{DVec2, Vec2, Vec3};

const STONE_WALL: Finish = Finish::new(Surface::Brick, [188, 168, 146], Class::Wall);
const COPING: Finish = Finish::new(Surface::Concrete, [196, 192, 184], Class::Wall);
pub(super) const SLATS: Finish = Finish::new(Surface::Wood, [150, 108, 70], Class::Furniture);
pub(super) const IRON: Finish = Finish::new(Surface::Metal, [58, 60, 62], Class::Furniture);

/// Width of the coping of a wall.
pub(super) const WALL_WIDTH_M: f32 = 0.42;
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
            let left = opened(line, ways, &|_| true);
            left.iter().for_each(|line| along(mesh, line, 0.30, height, STONE_WALL, STONE_WALL));
            for pair in left.iter().flat_map(|line| line.windows(2)) {
                let (a, b) = (pair[0].as_vec2(), pair[1].as_vec2());
                let yaw = (b - a).to_angle();
                let size = Vec3::new(a.distance(b) + 0.4, WALL_WIDTH_M, 0.10);
                mesh.block(((a + b) / 2.0).extend(0.05 + height), size, yaw, COPING);
            }
        }
        shape => {
            let ring: Vec<Vec3> = ring_of(shape).iter().map(|p| p.as_vec2().extend(0.05)).collect();
            mesh.prism(&ring, height, STONE_WALL, COPING);
        }
    }
}

/// A low wall in place of those parts of a hedge.
pub(super) fn low_wall(
    mesh: &mut Mesh,
    place: &SeededScenery<'_>,
    ways: &[Way],
    is_wanted: &dyn Fn(DVec2) -> bool,
) {
    const WIDE_M: f32 = 0.24;
    const HIGH_M: f32 = 0.46;
    if let Footprint::Polyline(line) = &place.piece.shape {
        for line in opened(line, ways, is_wanted) {
            along(mesh, &line, WIDE_M, HIGH_M, STONE_WALL, COPING);
        }
    }
}

pub(super) fn middle(shape: &Footprint) -> Vec2 {
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
