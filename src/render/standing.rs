//! The standing city on the GPU: one buffer, cut into square cells so that each view draws what it
//! may see, near cells first.

use super::frustum::{Frustum, Sharpness};
use super::passes::city::gpu_data::Vertex as GpuVertex;
use crate::city::scene::{Mesh, SceneDescription, Vertex};
use glam::Vec3;
use std::collections::BTreeMap;
use std::ops::Range;
use wgpu::util::DeviceExt;

/// Edge of a cell.
const CELL_M: f32 = 26.0;
/// Upright and higher than this above the ground: drawn before the ground.
const RISES_ABOVE_M: f32 = 0.3;

#[derive(Clone, Debug)]
struct Cell {
    bounds: [Vec3; 2],
    indices: Range<u32>,
}

/// By how much the outline of a tree of few faces differs from that of its full mesh.
const COARSENESS_M: f32 = 0.30;

/// Something upright in a cell: its full mesh and, where there is one, the one for a distance.
#[derive(Clone, Debug)]
struct Raised {
    near: Cell,
    distant: Option<Cell>,
}

#[derive(Debug)]
pub(super) struct Standing {
    vertices: wgpu::Buffer,
    indices: wgpu::Buffer,
    raised: Vec<Raised>,
    ground: Vec<Cell>,
}

/// What a view needs of the standing city.
#[derive(Clone, Copy, Debug)]
pub(super) struct Gaze<'a> {
    pub(super) frustum: &'a Frustum,
    pub(super) sharpness: Sharpness,
    pub(super) eye: Vec3,
    /// See [`super::Quality::coarse_below_px`].
    pub(super) coarse_below_px: f32,
}

/// Indices of the cells that a view may see, near ones first.
#[derive(Clone, Debug, Default)]
pub(super) struct SeenCells {
    pub(super) raised: Vec<Range<u32>>,
    pub(super) ground: Vec<Range<u32>>,
}

fn near_first<'c>(cells: impl Iterator<Item = (f32, &'c Cell)>) -> Vec<Range<u32>> {
    let mut cells: Vec<_> = cells.collect();
    cells.sort_by(|a, b| a.0.total_cmp(&b.0));
    cells.into_iter().map(|(_, cell)| cell.indices.clone()).collect()
}

/// What one cell holds before it is packed.
#[derive(Default)]
struct Bucket {
    mesh: Mesh,
    /// New index of a vertex of the source, for the source mesh at hand.
    slots: std::collections::HashMap<u32, u32>,
}

type Buckets = BTreeMap<[i32; 2], Bucket>;

impl Standing {
    pub(super) fn new(device: &wgpu::Device, scene: &SceneDescription) -> Self {
        let (mut raised, mut ground) = sort_into_cells(&scene.meshes);
        let (mut distant, _) = sort_into_cells(&scene.distant);
        let mut packed = Packed::default();
        // All full meshes first: shadows draw them in one piece.
        let near: Vec<_> = raised.iter_mut().map(|(at, b)| (*at, packed.add(&mut b.mesh))).collect();
        let raised = near.into_iter().map(|(at, near)| {
            let distant = distant.get_mut(&at).map(|bucket| packed.add(&mut bucket.mesh));
            Raised { near, distant }
        });
        let raised = raised.collect();
        let ground = ground.values_mut().map(|bucket| packed.add(&mut bucket.mesh)).collect();
        let buffer = |label, contents, usage| {
            device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
                label: Some(label),
                contents,
                usage,
            })
        };
        Self {
            vertices: buffer("city", bytemuck::cast_slice(&packed.vertices), wgpu::BufferUsages::VERTEX),
            indices: buffer("city", bytemuck::cast_slice(&packed.indices), wgpu::BufferUsages::INDEX),
            raised,
            ground,
        }
    }

    /// What a view may see.
    pub(super) fn seen(&self, gaze: &Gaze<'_>) -> SeenCells {
        let raised = self.raised.iter().filter_map(|place| {
            let distance_m = gaze.sees(&place.near)?;
            let coarse = gaze.sharpness.pixels(COARSENESS_M, distance_m) < gaze.coarse_below_px;
            Some((distance_m, place.distant.as_ref().filter(|_| coarse).unwrap_or(&place.near)))
        });
        let ground = self.ground.iter().filter_map(|cell| Some((gaze.sees(cell)?, cell)));
        SeenCells { raised: near_first(raised), ground: near_first(ground) }
    }

    /// Draws cells of [`Standing::seen`]; the pipeline and its groups are set already.
    pub(super) fn draw(&self, pass: &mut wgpu::RenderPass<'_>, cells: &[Range<u32>]) {
        pass.set_vertex_buffer(0, self.vertices.slice(..));
        pass.set_index_buffer(self.indices.slice(..), wgpu::IndexFormat::Uint32);
        for indices in cells {
            pass.draw_indexed(indices.clone(), 0, 0..1);
        }
    }

    /// Everything that throws a shadow.
    pub(super) fn draw_shadows(&self, pass: &mut wgpu::RenderPass<'_>) {
        let Some((first, last)) = self.raised.first().zip(self.raised.last()) else { return };
        pass.set_vertex_buffer(0, self.vertices.slice(..));
        pass.set_index_buffer(self.indices.slice(..), wgpu::IndexFormat::Uint32);
        pass.draw_indexed(first.near.indices.start..last.near.indices.end, 0, 0..1);
    }
}

impl Gaze<'_> {
    /// The least distance to what a cell holds, if it may be seen.
    fn sees(&self, cell: &Cell) -> Option<f32> {
        let [low, high] = cell.bounds;
        self.frustum.may_see_box(cell.bounds).then(|| self.eye.clamp(low, high).distance(self.eye))
    }
}

/// What rises above the ground by the cell of its faces' middles, and the ground cut along cells.
fn sort_into_cells(meshes: &[Mesh]) -> (Buckets, Buckets) {
    let (mut raised, mut ground) = (Buckets::new(), Buckets::new());
    for mesh in meshes {
        for bucket in raised.values_mut() {
            bucket.slots.clear();
        }
        for triangle in mesh.indices.chunks_exact(3) {
            let corners = [triangle[0], triangle[1], triangle[2]].map(|k| mesh.vertices[k as usize]);
            if corners.iter().any(|v| v.position.z > RISES_ABOVE_M) {
                let middle = corners.iter().map(|v| v.position).sum::<Vec3>() / 3.0;
                let bucket = raised.entry(cell_of(middle)).or_default();
                for &k in triangle {
                    let slot = *bucket
                        .slots
                        .entry(k)
                        .or_insert_with(|| bucket.mesh.vertex(mesh.vertices[k as usize]));
                    bucket.mesh.indices.push(slot);
                }
            } else {
                split_into(&mut ground, corners);
            }
        }
    }
    (raised, ground)
}

fn cell_of(at: Vec3) -> [i32; 2] {
    [at.x, at.y].map(|x| (x / CELL_M).floor() as i32)
}

#[derive(Default)]
struct Packed {
    vertices: Vec<GpuVertex>,
    indices: Vec<u32>,
}

impl Packed {
    fn add(&mut self, mesh: &mut Mesh) -> Cell {
        mesh.weld();
        let (base, start) = (self.vertices.len() as u32, self.indices.len() as u32);
        self.vertices.extend(mesh.vertices.iter().map(pack));
        self.indices.extend(mesh.indices.iter().map(|k| k + base));
        Cell { bounds: mesh.bounds(), indices: start..self.indices.len() as u32 }
    }
}

/// A vertex as the shaders read it.
fn pack(v: &Vertex) -> GpuVertex {
    let [r, g, b] = v.finish.colour;
    GpuVertex {
        position: v.position.to_array(),
        normal: pack_normal(v.normal),
        colour: [r, g, b, v.openness],
        uv: v.uv.to_array(),
        material: v.finish.surface as u32 | (v.finish.class as u32) << 8,
    }
}

pub(super) fn pack_normal(n: Vec3) -> [i8; 4] {
    let [x, y, z] = n.to_array().map(|c| (c * 127.0).round() as i8);
    [x, y, z, 0]
}

/// Cuts a triangle of the ground along the cells' edges.
fn split_into(cells: &mut Buckets, corners: [Vertex; 3]) {
    let [low, high] = [
        corners[0].position.min(corners[1].position).min(corners[2].position),
        corners[0].position.max(corners[1].position).max(corners[2].position),
    ];
    let (first, last) = (cell_of(low), cell_of(high));
    // The plain around the city is one piece: nothing is gained by cutting it.
    let whole = high.x - low.x > 8.0 * CELL_M || high.y - low.y > 8.0 * CELL_M;
    if whole {
        return fan(&mut cells.entry([i32::MAX, i32::MAX]).or_default().mesh, &corners);
    }
    for x in first[0]..=last[0] {
        let column = clip(&clip(&corners, 0, x as f32 * CELL_M, true), 0, (x + 1) as f32 * CELL_M, false);
        for y in first[1]..=last[1] {
            let piece = clip(&clip(&column, 1, y as f32 * CELL_M, true), 1, (y + 1) as f32 * CELL_M, false);
            if piece.len() > 2 {
                fan(&mut cells.entry([x, y]).or_default().mesh, &piece);
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
    use crate::city::scene::{Class, Finish, Surface};
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
        let total: f32 = cells.values().map(|bucket| area(&bucket.mesh)).sum();
        let want = Vec3::new(120.0, 8.0, 0.0).cross(Vec3::new(61.0, 93.0, 0.0)).z / 2.0;
        assert!(cells.len() > 6 && (total / want - 1.0).abs() < 1e-4, "{total} {want}");
        for ([x, _], bucket) in &cells {
            let [low, high] = bucket.mesh.bounds();
            assert!(low.x >= *x as f32 * CELL_M - 1e-3 && high.x <= (x + 1) as f32 * CELL_M + 1e-3);
        }
    }
}
