//! The ground cut into square cells, so that each view draws what it may see of it.

use crate::city::scene::{Level, Mesh, Object, Surface, Vertex};
use glam::Vec3;
use std::collections::BTreeMap;

/// Edge of a cell.
const CELL_M: f32 = 13.0;
/// Triangles as large as this stay in one piece: they lie around the city.
const WHOLE_FROM_M: f32 = 200.0;

/// Meshes by the cell they lie in.
type Cells = BTreeMap<[i32; 2], Mesh>;

/// What a part of the ground has of some surfaces, cut along the edges of cells: the levels of each cell.
pub(super) fn cut(object: &Object, of: &dyn Fn(Surface) -> bool) -> Vec<Vec<Level>> {
    let mut found: BTreeMap<[i32; 2], Vec<Level>> = BTreeMap::new();
    for level in &object.levels {
        for (at, mesh) in cut_mesh(&level.mesh, of) {
            found.entry(at).or_default().push(Level { mesh, error_m: level.error_m });
        }
    }
    found.into_values().collect()
}

fn cut_mesh(mesh: &Mesh, of: &dyn Fn(Surface) -> bool) -> Cells {
    let mut cells = Cells::new();
    for triangle in mesh.indices.chunks_exact(3) {
        let corners = [triangle[0], triangle[1], triangle[2]].map(|k| mesh.vertices[k as usize]);
        if of(corners[0].finish.surface) {
            split_into(&mut cells, corners);
        }
    }
    cells
}

fn cell_of(at: Vec3) -> [i32; 2] {
    [at.x, at.y].map(|x| (x / CELL_M).floor() as i32)
}

/// Cuts a triangle of the ground along the cells' edges.
fn split_into(cells: &mut Cells, corners: [Vertex; 3]) {
    let [low, high] = [
        corners[0].position.min(corners[1].position).min(corners[2].position),
        corners[0].position.max(corners[1].position).max(corners[2].position),
    ];
    let (first, last) = (cell_of(low), cell_of(high));
    let whole = (high - low).truncate().max_element() > WHOLE_FROM_M;
    if whole {
        return fan(cells.entry([i32::MAX, i32::MAX]).or_default(), &corners);
    }
    for x in first[0]..=last[0] {
        let column = clip(&clip(&corners, 0, x as f32 * CELL_M, true), 0, (x + 1) as f32 * CELL_M, false);
        for y in first[1]..=last[1] {
            let piece = clip(&clip(&column, 1, y as f32 * CELL_M, true), 1, (y + 1) as f32 * CELL_M, false);
            if piece.len() > 2 {
                fan(cells.entry([x, y]).or_default(), &piece);
            }
        }
    }
}

fn fan(mesh: &mut Mesh, corners: &[Vertex]) {
    let base = mesh.vertices.len() as u32;
    mesh.vertices.extend_from_slice(corners);
    for k in 2..corners.len() as u32 {
        mesh.indices.extend([base, base + k - 1, base + k]);
    }
}

/// The part of a convex polygon on one side of a line across an axis (Sutherland and Hodgman 1974).
fn clip(corners: &[Vertex], axis: usize, at: f32, keep_above: bool) -> Vec<Vertex> {
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
    use crate::city::scene::{Class, Finish};
    use glam::Vec2;

    #[test]
    fn cutting_keeps_the_area() {
        let finish = Finish::new(Surface::Asphalt, [255; 3], Class::Road);
        let corner = |x, y| Vertex {
            position: Vec3::new(x, y, 0.0),
            normal: Vec3::Z,
            uv: Vec2::new(x, y),
            finish,
            openness: 255,
        };
        let mut cells = BTreeMap::new();
        split_into(&mut cells, [corner(-50.0, -3.0), corner(70.0, 5.0), corner(11.0, 90.0)]);
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
        let want = Vec3::new(120.0, 8.0, 0.0).cross(Vec3::new(61.0, 93.0, 0.0)).z / 2.0;
        assert!(cells.len() > 6 && (total / want - 1.0).abs() < 1e-4, "{total} {want}");
        for ([x, _], mesh) in &cells {
            let [low, high] = mesh.bounds();
            assert!(low.x >= *x as f32 * CELL_M - 1e-3 && high.x <= (x + 1) as f32 * CELL_M + 1e-3);
        }
    }
}
