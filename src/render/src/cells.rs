//! Uniform grid of ground cells: the ground cut along cell edges, so that each view draws only the cells that it sees.

use city3d_scene::{CELL_M, LodMesh, Mesh, SceneObject, Surface, Vertex};
use glam::Vec3;
use std::collections::BTreeMap;

/// Larger triangles are not cut.
const MAX_CUT_EXTENT_M: f32 = 3.0 * CELL_M;
/// A mesh with a larger triangle is the land around the city. None of its triangles is cut: where a small one borders on
/// a large one, corners on their edge would be those of one of them alone, and pixels between them would show nothing.
const LAND_EXTENT_M: f32 = 1000.0;
/// Uncut triangles belong to the coarse cell of this size that contains their middle.
const COARSE_CELL_M: f32 = 16.0 * CELL_M;
const COARSE_CELL_OFFSET: i32 = 1 << 20;

/// Meshes by cell.
type Cells = BTreeMap<[i32; 2], Mesh>;

/// Splits the ground of some surfaces into cells, each with its levels of detail. Later objects lie on top and come
/// first in a cell, so that the early depth test rejects the ground under them.
pub(super) fn split_ground(ground: &[SceneObject], of: &dyn Fn(Surface) -> bool) -> Vec<Vec<LodMesh>> {
    // Objects without these surfaces would only add identical levels.
    let has = |mesh: &Mesh| mesh.indices.iter().any(|&k| of(mesh.vertices[k as usize].finish.surface));
    let ground: Vec<&SceneObject> =
        ground.iter().filter(|object| object.levels.first().is_some_and(|level| has(&level.mesh))).collect();
    let mut errors: Vec<f32> = ground.iter().flat_map(|o| &o.levels).map(|level| level.error_m).collect();
    errors.sort_by(f32::total_cmp);
    errors.dedup();
    let mut found: BTreeMap<[i32; 2], Vec<LodMesh>> = BTreeMap::new();
    for error_m in errors {
        let mut cells = Cells::new();
        for object in ground.iter().rev() {
            let level = object.levels.iter().rev().find(|level| level.error_m <= error_m);
            if let Some(level) = level.or(object.levels.first()) {
                cut_mesh(&mut cells, &level.mesh, of);
            }
        }
        for (at, mesh) in cells {
            found.entry(at).or_default().push(LodMesh { mesh, error_m });
        }
    }
    let below_m = |at: [i32; 2]| if at[0] > COARSE_CELL_OFFSET / 2 { BELOW_LAND_M } else { BELOW_M };
    let with_stand_in = |(at, mut levels): ([i32; 2], Vec<LodMesh>)| {
        let ground = levels.first().filter(|level| {
            level.mesh.vertices.first().is_some_and(|vertex| vertex.finish.surface != Surface::Line)
        });
        levels.extend(ground.map(|level| stand_in(&level.mesh, below_m(at))));
        levels
    };
    found.into_iter().map(with_stand_in).collect()
}

/// Error of what stands in for hidden ground: so large that nothing else is drawn with it.
const STAND_IN_M: f32 = 1e9;
/// So far below the ground it lies: that of a coarse cell covers parts of other cells, which may be seen.
const BELOW_LAND_M: f32 = 2.0;
const BELOW_M: f32 = 0.05;

/// A rectangle that stands in for a cell of the ground where that is hidden.
fn stand_in(ground: &Mesh, below_m: f32) -> LodMesh {
    let [low, high] = ground.bounds();
    let z = low.z - below_m;
    let mut mesh = Mesh::default();
    if let Some(vertex) = ground.vertices.first() {
        let corners = [(low.x, low.y), (high.x, low.y), (high.x, high.y), (low.x, high.y)];
        mesh.vertices = corners.map(|(x, y)| Vertex { position: Vec3::new(x, y, z), ..*vertex }).to_vec();
        mesh.indices = vec![0, 1, 2, 0, 2, 3];
    }
    LodMesh { mesh, error_m: STAND_IN_M }
}

fn cut_mesh(cells: &mut Cells, mesh: &Mesh, of: &dyn Fn(Surface) -> bool) {
    let corner = |k: u32| mesh.vertices[k as usize];
    let is_land =
        mesh.indices.chunks_exact(3).any(|t| extent(&[t[0], t[1], t[2]].map(corner)) > LAND_EXTENT_M);
    let largest_m = if is_land { 0.0 } else { MAX_CUT_EXTENT_M };
    let mut triangles = mesh.indices.chunks_exact(3).peekable();
    while let Some(t) = triangles.next() {
        let corners = [t[0], t[1], t[2]].map(corner);
        if !of(corners[0].finish.surface) {
            continue;
        }
        // Two triangles of one planar quad are cut together, which gives half as many pieces.
        let fourth = triangles
            .next_if(|next| next[0] == t[0] && next[1] == t[2] && is_planar_quad(&corners, &corner(next[2])));
        let polygon = match fourth {
            Some(next) => &[corners[0], corners[1], corners[2], corner(next[2])][..],
            None => &corners,
        };
        split_into(cells, polygon, largest_m);
    }
}

/// Tolerance for the fourth corner of a quad against the plane and the texture mapping of the others, metres and
/// repeats of the texture.
const FACE_TOLERANCE: f32 = 0.01;

/// Whether a fourth corner extends a triangle to a convex planar quad with an affine texture mapping.
fn is_planar_quad([a, b, c]: &[Vertex; 3], d: &Vertex) -> bool {
    let normal = (b.position - a.position).cross(c.position - a.position).normalize_or_zero();
    let corners = [a, b, c, d].map(|v| v.position);
    let is_convex = (0..4).all(|k| {
        let [p, q, r] = [k, (k + 1) % 4, (k + 2) % 4].map(|k| corners[k]);
        (q - p).cross(r - q).dot(normal) > 0.0
    });
    // d = a + x (b - a) + y (c - a), by least squares.
    let (e, f, g) = (b.position - a.position, c.position - a.position, d.position - a.position);
    let (ee, ef, ff) = (e.dot(e), e.dot(f), f.dot(f));
    let scale = 1.0 / (ee * ff - ef * ef);
    let (x, y) = ((ff * g.dot(e) - ef * g.dot(f)) * scale, (ee * g.dot(f) - ef * g.dot(e)) * scale);
    let uv = a.uv + (b.uv - a.uv) * x + (c.uv - a.uv) * y;
    is_convex
        && (e * x + f * y).distance(g) < FACE_TOLERANCE
        && uv.distance(d.uv) < FACE_TOLERANCE
        && [b, c, d].iter().all(|v| v.finish == a.finish && v.normal.distance(a.normal) < 0.1)
}

fn cell_of(at: Vec3) -> [i32; 2] {
    [at.x, at.y].map(|x| (x / CELL_M).floor() as i32)
}

/// Box of some corners.
fn bounds(corners: &[Vertex]) -> [Vec3; 2] {
    let positions = || corners.iter().map(|v| v.position);
    [positions().fold(Vec3::INFINITY, Vec3::min), positions().fold(Vec3::NEG_INFINITY, Vec3::max)]
}

/// Edge of the smallest square that covers some corners.
fn extent(corners: &[Vertex]) -> f32 {
    let [low, high] = bounds(corners);
    (high - low).truncate().max_element()
}

/// Cuts a convex polygon of the ground along the edges of cells, unless it is larger than `largest_m`.
fn split_into(cells: &mut Cells, corners: &[Vertex], largest_m: f32) {
    let [low, high] = bounds(corners);
    let (first, last) = (cell_of(low), cell_of(high));
    if extent(corners) > largest_m {
        let middle = (low + high) / 2.0 / COARSE_CELL_M;
        let at = [middle.x, middle.y].map(|x| COARSE_CELL_OFFSET + x.floor() as i32);
        return triangulate_fan(cells.entry(at).or_default(), corners);
    }
    for x in first[0]..=last[0] {
        let column = clip_polygon(
            &clip_polygon(corners, 0, x as f32 * CELL_M, true),
            0,
            (x + 1) as f32 * CELL_M,
            false,
        );
        for y in first[1]..=last[1] {
            let piece = clip_polygon(
                &clip_polygon(&column, 1, y as f32 * CELL_M, true),
                1,
                (y + 1) as f32 * CELL_M,
                false,
            );
            if piece.len() > 2 {
                triangulate_fan(cells.entry([x, y]).or_default(), &piece);
            }
        }
    }
}

/// Appends a convex polygon as a triangle fan.
fn triangulate_fan(mesh: &mut Mesh, corners: &[Vertex]) {
    let base = mesh.vertices.len() as u32;
    mesh.vertices.extend_from_slice(corners);
    for k in 2..corners.len() as u32 {
        mesh.indices.extend([base, base + k - 1, base + k]);
    }
}

/// Clips a convex polygon against an axis-aligned line (Sutherland and Hodgman 1974).
fn clip_polygon(corners: &[Vertex], axis: usize, at: f32, keep_above: bool) -> Vec<Vertex> {
    let side = |v: &Vertex| if keep_above { v.position[axis] - at } else { at - v.position[axis] };
    let mut kept = Vec::with_capacity(corners.len() + 1);
    for (k, a) in corners.iter().enumerate() {
        let b = &corners[(k + 1) % corners.len()];
        let (da, db) = (side(a), side(b));
        if da >= 0.0 {
            kept.push(*a);
        }
        if (da > 0.0 && db < 0.0) || (da < 0.0 && db > 0.0) {
            let t = da / (da - db);
            let mut between = *a;
            between.position = a.position.lerp(b.position, t);
            between.position[axis] = at;
            between.normal = a.normal.lerp(b.normal, t);
            between.uv = a.uv.lerp(b.uv, t);
            kept.push(between);
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;
    use city3d_scene::{Class, Finish};
    use glam::Vec2;

    fn vertex(x: f32, y: f32) -> Vertex {
        let finish = Finish::new(Surface::Asphalt, [255; 3], Class::Road);
        Vertex { position: Vec3::new(x, y, 0.0), normal: Vec3::Z, uv: Vec2::new(x, y), finish, openness: 255 }
    }

    #[test]
    fn what_lies_on_top_comes_first_and_faces_are_cut_whole() {
        let face = |z: f32| {
            let mut vertices = [(1.0, 1.0), (30.0, 1.0), (30.0, 5.0), (1.0, 5.0)].map(|(x, y)| vertex(x, y));
            vertices.iter_mut().for_each(|v| v.position.z = z);
            Mesh { vertices: vertices.to_vec(), indices: vec![0, 1, 2, 0, 2, 3] }
        };
        let levels = [0.0, 0.1].map(|error_m| LodMesh { mesh: face(0.0), error_m });
        let ground = [SceneObject::of_levels(levels.to_vec()), SceneObject::of_one_level(face(0.01))];
        let cells = split_ground(&ground, &|_| true);
        assert_eq!(cells.len(), 3);
        for levels in &cells {
            let errors: Vec<f32> = levels.iter().map(|level| level.error_m).collect();
            assert_eq!(errors, [0.0, 0.1, STAND_IN_M]);
            let heights =
                levels[1].mesh.indices.iter().map(|&k| levels[1].mesh.vertices[k as usize].position.z);
            // Two triangles each, the upper face first.
            assert_eq!(heights.collect::<Vec<_>>(), [[0.01; 6], [0.0; 6]].concat());
        }
        // Not one face: bent, dented, with a texture that is not even.
        let corners = [vertex(0.0, 0.0), vertex(1.0, 0.0), vertex(1.0, 1.0)];
        assert!(is_planar_quad(&corners, &vertex(0.0, 1.0)));
        let bent = Vertex { position: Vec3::new(0.0, 1.0, 0.1), ..vertex(0.0, 1.0) };
        let drawn = Vertex { uv: Vec2::new(0.0, 1.3), ..vertex(0.0, 1.0) };
        for other in [bent, drawn, vertex(0.9, 0.2), vertex(0.5, 0.5)] {
            assert!(!is_planar_quad(&corners, &other), "{other:?}");
        }
    }

    #[test]
    fn cutting_keeps_the_area() {
        let mut cells = BTreeMap::new();
        split_into(
            &mut cells,
            &[vertex(-15.0, -3.0), vertex(20.0, 5.0), vertex(3.0, 30.0)],
            MAX_CUT_EXTENT_M,
        );
        let area = |mesh: &Mesh| -> f32 {
            mesh.indices
                .chunks(3)
                .map(|t| {
                    let p = [t[0], t[1], t[2]].map(|k| mesh.vertices[k as usize].position);
                    (p[1] - p[0]).cross(p[2] - p[0]).z / 2.0
                })
                .sum()
        };
        let total: f32 = cells.values().map(area).sum();
        let want = Vec3::new(35.0, 8.0, 0.0).cross(Vec3::new(18.0, 33.0, 0.0)).z / 2.0;
        assert!(cells.len() > 6 && (total / want - 1.0).abs() < 1e-4, "{total} {want}");
        for ([x, _], mesh) in &cells {
            let [low, high] = mesh.bounds();
            assert!(low.x >= *x as f32 * CELL_M - 1e-3 && high.x <= (x + 1) as f32 * CELL_M + 1e-3);
        }
    }

    #[test]
    fn the_land_around_the_city_is_not_cut() {
        let count = |far: f32| {
            let vertices = vec![
                vertex(100.0, 0.0),
                vertex(130.0, 0.0),
                vertex(130.0, 30.0),
                vertex(130.0, 0.0),
                vertex(far, 60.0),
                vertex(130.0, 30.0),
            ];
            let land = SceneObject::of_one_level(Mesh { vertices, indices: (0..6).collect() });
            let cells = split_ground(&[land], &|_| true);
            for [ground, stand_in] in
                cells.iter().filter_map(|levels| <&[LodMesh; 2]>::try_from(&levels[..]).ok())
            {
                let ([low, high], [from, to]) = (ground.mesh.bounds(), stand_in.mesh.bounds());
                assert!(
                    from.truncate() == low.truncate() && to.truncate() == high.truncate() && to.z < low.z
                );
            }
            assert!(cells.iter().any(|levels| levels.len() == 2));
            cells.iter().map(|levels| levels[0].mesh.triangle_count()).sum::<usize>()
        };
        // Two triangles, the smaller of which would be cut beside one that is just large.
        assert_eq!(count(5000.0), 2);
        assert!(count(180.0) > 5);
    }
}
