//! Tree lines around the city that close the view where streets end.

use super::mesh::{Class, Finish, Mesh, Surface, Vertex};
use super::{SceneObject, Wall};
use glam::{Vec2, Vec3};
use std::f32::consts::TAU;

const WOODS: Finish = Finish::new(Surface::Leaves, [66, 84, 56], Class::Vegetation);
/// Number of points around the city at which a tree line bends.
const POINTS: u32 = 72;
const METRES_PER_REPEAT: f32 = 7.0;
/// Texture repeat from above, where the leaf pattern passes for crowns.
const TOPS_PER_REPEAT_M: f32 = 31.0;
/// Range of the random offset of tree lines.
const WANDER_M: f32 = 9.0;

/// A tree line; lines farther away are taller.
struct TreeRow {
    away_m: f32,
    tall_m: f32,
    /// Brightness factor of its colour.
    tone: f32,
    /// Number of crowns per segment.
    crowns: u32,
    /// Outline of a crown from right to left seen from the city: share of its width, share of its height,
    /// openness.
    outline: &'static [(f32, f32, u8)],
}

const NEAR_OUTLINE: [(f32, f32, u8); 6] = [
    (0.0, 0.0, 190),
    (0.14, 0.62, 230),
    (0.36, 0.96, 255),
    (0.62, 1.0, 255),
    (0.87, 0.60, 230),
    (1.0, 0.0, 190),
];
const FAR_OUTLINE: [(f32, f32, u8); 5] =
    [(0.0, 0.0, 190), (0.16, 0.66, 240), (0.42, 1.0, 250), (0.78, 0.80, 245), (1.0, 0.0, 190)];

const ROWS: [TreeRow; 3] = [
    TreeRow { away_m: 44.0, tall_m: 7.5, tone: 1.0, crowns: 3, outline: &NEAR_OUTLINE },
    TreeRow { away_m: 66.0, tall_m: 11.0, tone: 0.95, crowns: 2, outline: &FAR_OUTLINE },
    TreeRow { away_m: 94.0, tall_m: 15.5, tone: 0.9, crowns: 2, outline: &FAR_OUTLINE },
];
/// Depth of the canopy behind the last line, and of its slope to the ground.
const BEYOND_M: f32 = 34.0;
const EDGE_M: f32 = 16.0;

/// Drop of the canopy behind a line below the next one.
const TOPS_FALL_M: f32 = 0.5;

/// Position and height of a tree line at a point.
fn place(ground: [Vec2; 2], number: u32, k: u32) -> (Vec2, f32) {
    let row = &ROWS[number as usize];
    let wander = WANDER_M * (super::hash_to_unit(k % POINTS, 31 + number) - 0.5);
    let tall = row.tall_m * (0.72 + 0.45 * super::hash_to_unit(k % POINTS, 37 + number));
    (around(ground, k, row.away_m + wander), tall)
}

/// A point at a distance from the city's box, between a circle and a square.
fn around([low, high]: [Vec2; 2], k: u32, away_m: f32) -> Vec2 {
    let (middle, half) = ((low + high) / 2.0, (high - low) / 2.0);
    let (sin, cos) = (TAU * (k % POINTS) as f32 / POINTS as f32).sin_cos();
    let square = 1.0 / cos.abs().max(sin.abs()).powf(0.55);
    middle + Vec2::new(cos * half.x, sin * half.y) * square + Vec2::new(cos, sin) * away_m
}

/// Tree lines of varying height around the city's box with canopies between them. Each segment is an object:
/// short ones can be culled behind houses.
pub(super) fn woods(city: [Vec2; 2]) -> Vec<SceneObject> {
    let mut woods = Vec::new();
    for (number, row) in (0_u32..).zip(&ROWS) {
        let mut along = 0.0;
        for k in 0..POINTS {
            let mut mesh = Mesh::default();
            along =
                crowns(&mut mesh, (row, number), k, [k, k + 1].map(|k| RowEdge::of(city, number, k)), along);
            tops(&mut mesh, city, number, k);
            woods.push(SceneObject::of_one_level(mesh));
        }
    }
    woods
}

/// The opaque lower part of the tree lines as occluders.
pub(super) fn walls(city: [Vec2; 2]) -> Vec<Wall> {
    let wall = |number: u32, k: u32| {
        let ((to, a), (from, b)) = (place(city, number, k), place(city, number, k + 1));
        Wall { from, to, height_m: a.min(b) }
    };
    (0..ROWS.len() as u32).flat_map(|number| (0..POINTS).map(move |k| wall(number, k))).collect()
}

/// Cross-section of a tree line at a point, up to where its crowns separate.
#[derive(Clone, Copy)]
struct RowEdge {
    at: Vec2,
    /// Rear lines begin just below the canopy that hides the rest.
    foot_m: f32,
    high_m: f32,
}

impl RowEdge {
    fn of(city: [Vec2; 2], number: u32, k: u32) -> Self {
        let (at, high_m) = place(city, number, k);
        let before = number.checked_sub(1).map(|before| place(city, before, k).1);
        Self { at, foot_m: before.map_or(0.0, |high_m| high_m - 2.0 * TOPS_FALL_M), high_m }
    }

    fn towards(self, other: Self, part: f32) -> Self {
        let between = |a: f32, b: f32| a + (b - a) * part;
        Self {
            at: self.at.lerp(other.at, part),
            foot_m: between(self.foot_m, other.foot_m),
            high_m: between(self.high_m, other.high_m),
        }
    }
}

/// Draws the crowns of a segment; `along` is the arc length around the line before it; returns the one after
/// it.
fn crowns(mesh: &mut Mesh, (row, number): (&TreeRow, u32), k: u32, [a, b]: [RowEdge; 2], along: f32) -> f32 {
    let hash_to_unit = |salt: u32| super::hash_to_unit(k, salt + number);
    let then = along + a.at.distance(b.at) / METRES_PER_REPEAT;
    // Points run counter-clockwise. Crowns also take light from above when seen against the sun.
    let inward = (b.at - a.at).perp().extend(0.0).normalize_or(Vec3::X);
    for crown in 0..row.crowns {
        let salt = 50 + 8 * crown;
        let [from, to] = [crown, crown + 1].map(|c| c as f32 / row.crowns as f32);
        let lean = 0.16 * (hash_to_unit(salt) - 0.5);
        let normal = (inward + Vec3::Z * (0.7 + 0.8 * hash_to_unit(salt + 4))).normalize_or(Vec3::Z);
        let finish = WOODS.shaded(row.tone * (0.82 + 0.32 * hash_to_unit(salt + 2)));
        let rise = (1.0 + 1.6 * hash_to_unit(salt + 6)) * 3.0 / row.crowns as f32;
        let base = mesh.vertices.len() as u32;
        // Dark at the ground.
        let foot_of = |edge: RowEdge| (60.0 + 130.0 * edge.foot_m / edge.high_m) as u8;
        let foot = [(1.0, None), (0.0, None)];
        let top = row.outline.iter().map(|&(part, above, openness)| (part, Some((above, openness))));
        for (part, above) in foot.into_iter().chain(top) {
            let bent = if (0.2..0.75).contains(&part) { part + lean } else { part };
            let part = from + (to - from) * bent;
            let edge = a.towards(b, part);
            let (z, openness) = match above {
                Some((above, openness)) => (edge.high_m + rise * above, openness),
                None => (edge.foot_m, foot_of(edge)),
            };
            let u = along + (then - along) * part;
            let uv = Vec2::new(u, z / METRES_PER_REPEAT);
            mesh.vertex(Vertex { position: edge.at.extend(z), normal, uv, finish, openness });
        }
        // Two triangles below the outline, and a fan of it: edges inside a crown cost as much as others.
        let last = mesh.vertices.len() as u32 - 1;
        mesh.indices.extend([base, base + 1, base + 2, base, base + 2, last]);
        mesh.indices.extend((base + 3..last).flat_map(|corner| [base + 2, corner, corner + 1]));
    }
    then
}

/// Draws the canopy behind a segment, up to the next line or down to the ground.
fn tops(mesh: &mut Mesh, city: [Vec2; 2], number: u32, k: u32) {
    let row = &ROWS[number as usize];
    let next = ROWS.get(number as usize + 1);
    // Offset, height and openness from the line outwards.
    let lines = |k: u32| -> Vec<(Vec3, u8)> {
        let (at, high) = place(city, number, k);
        let mut lines = vec![(at.extend(high), 210)];
        match next {
            Some(_) => {
                let (behind, _) = place(city, number + 1, k);
                lines.push((behind.extend(high - TOPS_FALL_M), 110));
            }
            None => {
                let bump = 2.5 * (super::hash_to_unit(k % POINTS, 43) - 0.3);
                let beyond = |away_m: f32| around(city, k, row.away_m + away_m);
                lines.push((beyond(0.5 * BEYOND_M).extend(high + bump), 235));
                lines.push((beyond(BEYOND_M).extend(0.85 * high), 220));
                lines.push((beyond(BEYOND_M + EDGE_M).extend(0.0), 90));
            }
        }
        lines
    };
    // The canopy is in the light, the sides of crowns in shade.
    let tone = |k: u32, step: usize| {
        row.tone * (1.2 + 0.4 * super::hash_to_unit(k % POINTS, 61 + 4 * number + step as u32))
    };
    let (here, there) = (lines(k), lines(k + 1));
    for step in 0..here.len() - 1 {
        let corners =
            [(k, &here, step), (k, &here, step + 1), (k + 1, &there, step + 1), (k + 1, &there, step)];
        let positions = corners.map(|(_, line, step)| line[step].0);
        let uvs = positions.map(|at| (at.truncate() + Vec2::splat(at.z)) / TOPS_PER_REPEAT_M);
        let first = mesh.vertices.len();
        mesh.face(&positions, &uvs, WOODS);
        for (vertex, (k, line, step)) in mesh.vertices[first..].iter_mut().zip(corners) {
            (vertex.openness, vertex.finish) = (line[step].1, WOODS.shaded(tone(k, step)));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn crowns_take_their_light_on_the_side_of_the_city() {
        let city = [Vec2::splat(-50.0), Vec2::splat(50.0)];
        for (number, row) in (0_u32..).zip(&ROWS) {
            let mut mesh = Mesh::default();
            for k in 0..POINTS {
                crowns(&mut mesh, (row, number), k, [k, k + 1].map(|k| RowEdge::of(city, number, k)), 0.0);
            }
            assert!(mesh.vertices.len() > 500);
            for v in mesh.vertices {
                assert!(v.normal.truncate().dot(v.position.truncate()) < 0.0, "{v:?}");
            }
        }
    }
}
