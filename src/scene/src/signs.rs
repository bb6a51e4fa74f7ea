//! Road signs at control lines and car parks: a post and a face towards approaching traffic.

use super::SceneObject;
use super::lanes::LaneBoxIndex;
use super::mesh::{Class, Finish, Mesh, Surface};
use super::roads::RoadField;
use city3d_geometry::Pose2;
use city3d_roadmap::{CityMap, ControlLineKind, Footprint, Lane, LaneKind, SceneryKind};
use glam::{DVec2, Vec2, Vec3};

/// Atlas cells along and up the layer of [`Surface::Signs`].
const CELLS: usize = 4;
const FACE: Finish = Finish::new(Surface::Signs, [255, 255, 255], Class::Sign);
const BACK: Finish = Finish::new(Surface::Metal, [126, 130, 134], Class::Sign);
const POST: Finish = Finish::new(Surface::Metal, [118, 122, 126], Class::Pole);

/// The sign at a texture coordinate, counted from the lowest row, and the position inside its cell.
pub fn sign_cell([u, v]: [f32; 2]) -> (usize, [f32; 2]) {
    let (x, y) = (u * CELLS as f32, v * CELLS as f32);
    (y.floor() as usize * CELLS + x.floor() as usize, [x.fract(), y.fract()])
}

#[derive(Clone, Copy)]
enum Sign {
    Yield = 0,
    Stop = 1,
    Roundabout = 2,
    Parking = 3,
}

impl Sign {
    /// Corners in cell coordinates from -1 to 1, counter-clockwise for a reader.
    fn outline(self) -> Vec<Vec2> {
        let round = |count: usize, turn: f32, radius: f32| {
            (0..count)
                .map(|k| Vec2::from_angle(turn + std::f32::consts::TAU * k as f32 / count as f32) * radius)
                .collect()
        };
        match self {
            Self::Yield => vec![Vec2::new(0.0, -1.0), Vec2::new(1.0, 0.74), Vec2::new(-1.0, 0.74)],
            Self::Stop => round(8, std::f32::consts::FRAC_PI_8, 1.06),
            Self::Roundabout => round(12, 0.0, 0.99),
            Self::Parking => vec![
                Vec2::new(-0.97, -0.97),
                Vec2::new(0.97, -0.97),
                Vec2::new(0.97, 0.97),
                Vec2::new(-0.97, 0.97),
            ],
        }
    }
}

/// Half the width of a sign.
const HALF_M: f32 = 0.36;
/// Height of a sign's middle.
const MIDDLE_M: f32 = 2.35;

/// Signs on a post, read by traffic that drives along `towards`.
fn stand(foot: Vec2, towards: Vec2, signs: &[Sign]) -> SceneObject {
    let mut object = SceneObject::of_one_level(draw(foot, towards, signs, 5));
    object.add_level(draw(foot, towards, signs, 3), 0.04);
    object.add_level(draw(foot, towards, signs, 1), 0.115);
    object
}

/// Mesh with this number of post faces; three and one are distant levels of detail, the sign face square in
/// the latter.
fn draw(foot: Vec2, towards: Vec2, signs: &[Sign], sides: u32) -> Mesh {
    let mut mesh = Mesh::default();
    let top = MIDDLE_M + HALF_M + 0.05;
    // A pointed post has no lid.
    let thin = if sides > 3 { 0.038 } else { 0.0 };
    mesh.frustum(foot.extend(0.1), [0.038, thin], top - 0.1, sides.max(3), POST);
    // Readers look along `towards` and share its right.
    let right = (-towards.perp()).extend(0.0);
    for (k, &sign) in signs.iter().enumerate() {
        let middle = foot.extend(MIDDLE_M - 0.80 * k as f32) - towards.extend(0.0) * 0.05;
        let mut outline = sign.outline();
        if sides == 1 && outline.len() > 4 {
            outline = Sign::Parking.outline().into_iter().map(|p| p * 0.92).collect();
        } else if sides == 3 && outline.len() == 12 {
            outline = outline.into_iter().step_by(2).collect();
        }
        let place = |p: Vec2, back: f32| {
            middle + right * (p.x * HALF_M) + Vec3::Z * (p.y * HALF_M) + towards.extend(0.0) * back
        };
        let corners: Vec<Vec3> = outline.iter().map(|&p| place(p, 0.0)).collect();
        let cell = Vec2::new((sign as usize % CELLS) as f32, (sign as usize / CELLS) as f32);
        let uvs: Vec<Vec2> = outline
            .iter()
            .map(|p| (cell + (*p * 0.97 + 1.0).clamp(Vec2::ZERO, Vec2::splat(2.0)) / 2.0) / CELLS as f32)
            .collect();
        mesh.face(&corners, &uvs, FACE);
        if sides == 1 && k > 0 {
            continue;
        }
        let behind: Vec<Vec3> = outline.iter().rev().map(|&p| place(p, 0.012)).collect();
        mesh.plate(&behind, BACK, 1.0);
    }
    mesh
}

/// Clearances of a post, metres.
#[derive(Clone, Copy)]
struct SignClearance {
    /// From crowns; negative values are inside.
    trees_m: f64,
    buildings_m: f64,
}

/// Clearances in order of preference: off door steps first, and farther away before inside leaves.
const CLEAR: [SignClearance; 3] = [
    SignClearance { trees_m: HALF_M as f64, buildings_m: 0.8 },
    SignClearance { trees_m: HALF_M as f64, buildings_m: 0.25 },
    SignClearance { trees_m: -0.4, buildings_m: 0.25 },
];

/// The nearest free position behind the kerb to the right of a pose.
fn roadside(map: &CityMap, field: &RoadField, pose: Pose2, clear: SignClearance) -> Option<DVec2> {
    let beside = |out: f64| pose.point_at(0.0, -out);
    let kerb = (10..60).map(|k| f64::from(k) * 0.1).find(|&out| field.distance.at(beside(out)) > 0.75)?;
    let at = beside(kerb);
    let clear_of_things = map.scenery.iter().all(|piece| {
        let least_m = match piece.kind {
            SceneryKind::Building => clear.buildings_m,
            SceneryKind::Tree => clear.trees_m,
            SceneryKind::Wall | SceneryKind::Hedge | SceneryKind::Lamp => 0.25,
            _ => return true,
        };
        super::grounds::distance_to(&piece.shape, at) > least_m
    });
    clear_of_things.then_some(at)
}

/// A free place behind the kerb at a line or some way before it, and the driving direction there.
pub(super) fn at_line(map: &CityMap, field: &RoadField, lane: &Lane, at_m: f64) -> Option<(DVec2, Vec2)> {
    let try_at = |back: f64, clear: SignClearance| {
        let pose = lane.curve.at((at_m - back).max(0.0)).pose;
        Some((roadside(map, field, pose, clear)?, pose.forward().as_vec2()))
    };
    CLEAR
        .into_iter()
        .find_map(|clear| [0.3, 0.9, 1.8, 3.0, 4.5, 6.5].into_iter().find_map(|back| try_at(back, clear)))
}

/// Signs at stop and yield lines and at car parks.
pub(super) fn signs(map: &CityMap, field: &RoadField, lanes: &LaneBoxIndex<'_>) -> Vec<SceneObject> {
    let mut found = Vec::new();
    let mut standing: Vec<DVec2> = Vec::new();
    for line in &map.lines {
        let lane = map.lane(line.lane);
        // A signal takes the place of the sign.
        if map.signals.iter().any(|head| head.lane == line.lane) {
            continue;
        }
        // The right neighbour is closer to the kerb.
        if lane.right.is_some_and(|right| map.lines.iter().any(|l| l.lane == right)) {
            continue;
        }
        let Some((at, towards)) = at_line(map, field, lane, line.at_m) else { continue };
        if standing.iter().any(|known| known.distance(at) < 1.2) {
            continue;
        }
        // Lanes of a roundabout turn left throughout.
        let is_ring = |lane: &Lane| {
            let bend = |part: f64| lane.curve.at(lane.curve.length() * part).curvature;
            lane.kind == LaneKind::Lane && [0.1, 0.5, 0.9].iter().all(|&part| bend(part) > 0.04)
        };
        let next = |lane: &Lane| lane.successors.iter().map(|&id| map.lane(id)).collect::<Vec<_>>();
        let into_ring =
            next(lane).into_iter().any(|after| is_ring(after) || next(after).into_iter().any(is_ring));
        let signs: &[Sign] = match line.kind {
            ControlLineKind::Stop => &[Sign::Stop],
            ControlLineKind::Yield if into_ring => &[Sign::Yield, Sign::Roundabout],
            ControlLineKind::Yield => &[Sign::Yield],
        };
        found.push(stand(at.as_vec2(), towards, signs));
        standing.push(at);
    }
    for piece in map.scenery.iter().filter(|piece| piece.kind == SceneryKind::Parking) {
        let Footprint::Polygon(corners) = &piece.shape else { continue };
        let middle = corners.iter().copied().sum::<DVec2>() / corners.len().max(1) as f64;
        // At the corner nearest to a road, read from the road.
        let away = |at: DVec2| lanes.nearest(at).map_or(f64::INFINITY, |nearest| nearest.distance(at));
        let nearest = corners.iter().min_by(|a, b| away(**a).total_cmp(&away(**b)));
        if let Some(corner) = nearest {
            let at = corner.lerp(middle, 0.06);
            let towards = (middle - *corner).try_normalize().unwrap_or(DVec2::X);
            found.push(stand(at.as_vec2(), towards.as_vec2(), &[Sign::Parking]));
        }
    }
    found
}
