//! Hedges.

use super::doorways::{Way, opened};
use super::grounds::ring_of;
use super::mesh::{Class, Finish, Mesh, Surface, Vertex};
use super::{SceneObject, SeededScenery};
use city3d_roadmap::Footprint;
use glam::{DVec2, Vec2, Vec3};

const HEDGE: Finish = Finish::new(Surface::Leaves, [110, 136, 79], Class::Vegetation);

/// Spacing of cross-sections along a hedge.
const STATION_M: f32 = 1.5;
pub(super) const HEDGE_WIDTH_M: f32 = 0.9;
/// Repeats of the leaves over a metre.
const HEDGE_REPEATS: f32 = 1.15;

/// A clipped hedge within a polygon, or along what openings at these ways and places without room leave of a line.
pub(super) fn hedge(
    place: &SeededScenery<'_>,
    ways: &[Way],
    has_room: &dyn Fn(DVec2) -> bool,
) -> SceneObject {
    let height = place.piece.height_m.map_or(1.15, |h| h as f32);
    let left = match &place.piece.shape {
        Footprint::Polyline(line) => opened(line, ways, has_room),
        _ => Vec::new(),
    };
    let level = |is_near: bool| {
        let mut mesh = Mesh::default();
        match &place.piece.shape {
            Footprint::Polyline(_) => {
                for (pair, k) in left.iter().flat_map(|line| line.windows(2)).zip(0..) {
                    let ends = [pair[0].as_vec2(), pair[1].as_vec2()];
                    let seed = place.seed * 17 + k;
                    hedge_piece(&mut mesh, ends, height, seed, is_near);
                }
            }
            shape => {
                let ring: Vec<Vec3> = ring_of(shape).iter().map(|p| p.as_vec2().extend(0.05)).collect();
                mesh.prism(&ring, height, HEDGE, HEDGE.shaded(1.08));
            }
        }
        mesh
    };
    let mut hedge = SceneObject::of_one_level(level(true));
    hedge.add_level(level(false), 0.12);
    hedge
}

/// A straight hedge: uneven sides and a rounded top near by, a box from afar.
fn hedge_piece(mesh: &mut Mesh, [a, b]: [Vec2; 2], height: f32, seed: u32, is_near: bool) {
    let Some(ahead) = (b - a).try_normalize() else { return };
    let half = HEDGE_WIDTH_M / 2.0;
    // Pieces overlap in corners.
    let (a, b) = (a - ahead * half, b + ahead * half);
    let length = a.distance(b);
    let right = -ahead.perp();
    // Profile: lateral position over half the width, height over the whole, openness.
    let profile: &[(f32, f32, u8)] = if is_near {
        &[
            (0.92, 0.0, 90),
            (1.0, 0.45, 180),
            (0.97, 0.82, 220),
            (0.80, 0.96, 240),
            (0.42, 1.02, 250),
            (-0.42, 1.02, 250),
            (-0.80, 0.96, 240),
            (-0.97, 0.82, 220),
            (-1.0, 0.45, 180),
            (-0.92, 0.0, 90),
        ]
    } else {
        &[(1.0, 0.0, 90), (0.95, 0.96, 235), (-0.95, 0.96, 235), (-1.0, 0.0, 90)]
    };
    let stations = if is_near { (length / STATION_M).ceil().max(1.0) as u32 } else { 1 };
    // Strips between profile points are flat, like clipped hedges.
    let normal_of = |k: usize| {
        let ((out, up, _), (next, above, _)) = (profile[k], profile[k + 1]);
        (right * (above - up) * height).extend((out - next) * half).normalize_or(Vec3::Z)
    };
    let mut rims = Vec::new();
    for station in 0..=stations {
        let along = length * station as f32 / stations as f32;
        let mut round = 0.0;
        let mut rim = Vec::new();
        for (k, &(out, up, openness)) in profile.iter().enumerate() {
            let salt = station * 16 + k as u32;
            let jitter =
                if is_near && up > 0.0 { 0.08 * (super::hash_to_unit(seed, salt) - 0.5) } else { 0.0 };
            let out_m = half * out + jitter * out.signum();
            let z = 0.05 + height * up + 0.6 * jitter * up;
            if let Some(&(before, low, _)) = k.checked_sub(1).and_then(|k| profile.get(k)) {
                round += Vec2::new((out - before) * half, (up - low) * height).length();
            }
            let position = (a + ahead * along + right * out_m).extend(z);
            let uv = Vec2::new(along, round) * HEDGE_REPEATS;
            let finish = HEDGE.shaded(0.94 + 0.16 * super::hash_to_unit(seed, 500 + station));
            rim.push(Vertex { position, normal: Vec3::Z, uv, finish, openness });
        }
        rims.push(rim);
    }
    for k in 0..profile.len() - 1 {
        let base = mesh.vertices.len() as u32;
        for rim in &rims {
            for v in &rim[k..k + 2] {
                mesh.vertex(Vertex { normal: normal_of(k), ..*v });
            }
        }
        for c in (0..stations).map(|station| base + 2 * station) {
            mesh.indices.extend([c, c + 2, c + 3, c, c + 3, c + 1]);
        }
    }
    // Both ends.
    for (rim, facing) in [(&rims[0], -ahead), (&rims[rims.len() - 1], ahead)] {
        let rim: Vec<u32> = rim
            .iter()
            .map(|&v| {
                let across = v.position.truncate().dot(right);
                mesh.vertex(Vertex {
                    normal: facing.extend(0.1).normalize_or(Vec3::X),
                    uv: Vec2::new(across, v.position.z) * HEDGE_REPEATS,
                    ..v
                })
            })
            .collect();
        // From the middle of the foot: slivers along one side could be turned inside out.
        let [first, last] = [rim[0], rim[rim.len() - 1]].map(|k| mesh.vertices[k as usize]);
        let middle = mesh.vertex(Vertex {
            position: first.position.midpoint(last.position),
            uv: first.uv.midpoint(last.uv),
            ..first
        });
        for pair in rim.windows(2) {
            let (p, q) = if facing == ahead { (pair[1], pair[0]) } else { (pair[0], pair[1]) };
            mesh.indices.extend([middle, p, q]);
        }
    }
}
