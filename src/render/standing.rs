//! The standing city on the GPU: its vertices once, and for each view a list of the triangles that it
//! may see, near ones first.
//!
//! The lists are made on the CPU, at a few nanoseconds a triangle. On a software adapter each triangle that
//! is not drawn saves a hundred times that, and on a GPU a view is three draw calls.

use super::cells;
use super::frustum::{Frustum, Sharpness};
use super::horizon::{Horizon, Sector};
use super::passes::city::gpu_data::Vertex as GpuVertex;
use super::sides::{self, Side};
use crate::city::scene::{self, Object, SceneDescription, Surface, Vertex, Wall};
use glam::Vec3;
use std::ops::Range;
use std::sync::Arc;
use wgpu::util::DeviceExt;

/// What can be told apart in the patterns of most surfaces, and how many pixels it takes to be worth a texture.
const PATTERN_M: f32 = 0.25;
const PATTERN_FROM_PX: f32 = 6.0;

/// So far around the city things throw shadows.
const CITY_MARGIN_M: f32 = 20.0;

fn is_near_city(scene: &SceneDescription, at: Vec3) -> bool {
    let [low, high] = scene.bounds.map(Vec3::truncate);
    let at = at.truncate();
    at.cmpge(low - CITY_MARGIN_M).all() && at.cmple(high + CITY_MARGIN_M).all()
}

/// A piece of the city at one level of detail or more, the finest first.
#[derive(Clone, Debug)]
struct Piece {
    bounds: [Vec3; 2],
    /// Its corners, the highest where one stands over others; none where they are many.
    tops: Vec<Vec3>,
    levels: Vec<Level>,
    /// Whether its pattern tells what it is: windows, doors, letters.
    is_figured: bool,
}

#[derive(Clone, Debug)]
struct Level {
    error_m: f32,
    main: Vec<Side>,
    /// See [`Apart`].
    apart: Vec<Side>,
}

impl Level {
    fn all(&self) -> impl Iterator<Item = &Side> {
        self.main.iter().chain(&self.apart)
    }
}

/// The standing city on one adapter.
#[derive(Debug)]
pub(super) struct Standing {
    pieces: Arc<Pieces>,
    vertices: wgpu::Buffer,
    /// Everything that throws a shadow.
    shadows: (wgpu::Buffer, u32),
    /// The lists of all views of a batch.
    lists: wgpu::Buffer,
}

/// What lists are made of; all adapters share it.
#[derive(Debug)]
struct Pieces {
    /// Of all pieces at all levels.
    indices: Vec<u32>,
    objects: Vec<Piece>,
    ground: Vec<Piece>,
    /// Painted lines, whose cover of a pixel is computed.
    lines: Vec<Piece>,
    walls: Vec<Wall>,
}

/// A scene, sorted for drawing: made once, however many adapters draw it.
#[derive(Debug)]
pub(super) struct Sorted {
    pieces: Arc<Pieces>,
    vertices: Vec<GpuVertex>,
    /// Of everything that throws a shadow.
    shadows: Vec<u32>,
}

/// What of the things that rise from the ground is drawn for itself.
#[derive(Clone, Copy, Debug)]
pub(super) enum Apart {
    /// What is turned away from the sun that is in this direction.
    Averted(Vec3),
    /// Crowns of trees.
    Crowns,
}

impl Apart {
    fn has(self, corners: [&Vertex; 3]) -> bool {
        match self {
            Self::Averted(to_sun) => corners.iter().all(|v| v.normal.dot(to_sun) <= 0.0),
            // Of hedges, whose leaves are the same, faces are flat.
            Self::Crowns => {
                let [a, b, c] = corners;
                let is_round = a.normal.dot(b.normal).min(b.normal.dot(c.normal)) < 0.999;
                a.finish.surface == Surface::Leaves && is_round
            }
        }
    }
}

/// Which things show the patterns of their surfaces.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Patterns {
    All,
    /// Those whose pattern is not too fine to be seen.
    Near,
    None,
}

/// What a view needs of the standing city.
#[derive(Clone, Copy, Debug)]
pub(super) struct Gaze<'a> {
    pub(super) frustum: &'a Frustum,
    pub(super) horizon: &'a Horizon,
    pub(super) sharpness: Sharpness,
    pub(super) eye: Vec3,
    /// Whether rays meet in the eye, and do not run side by side.
    pub(super) has_eye: bool,
    /// See [`super::Quality::coarse_below_px`].
    pub(super) coarse_below_px: f32,
    pub(super) patterns: Patterns,
    /// See [`super::Quality::least_px`].
    pub(super) least_px: f32,
}

/// Where in the lists of a batch those of a view are.
#[derive(Clone, Debug, Default)]
pub(super) struct SeenCells {
    pub(super) raised: Range<u32>,
    /// See [`Apart`].
    pub(super) apart: Range<u32>,
    /// What stands too far away for its pattern to be seen.
    pub(super) plain: Range<u32>,
    pub(super) ground: Range<u32>,
    pub(super) lines: Range<u32>,
}

impl SeenCells {
    /// What rises from the ground, however it is lit.
    pub(super) fn all_raised(&self) -> [&Range<u32>; 3] {
        [&self.plain, &self.apart, &self.raised]
    }

    pub(super) fn triangles(&self) -> u64 {
        [&self.raised, &self.apart, &self.plain, &self.ground, &self.lines]
            .iter()
            .map(|list| list.len() as u64 / 3)
            .sum()
    }
}

impl Sorted {
    /// With something that is drawn for itself.
    pub(super) fn new(scene: &SceneDescription, apart: Option<Apart>) -> Self {
        let pack_objects = || {
            let mut packed = Packed { apart, ..Packed::default() };
            let objects: Vec<Piece> =
                scene.objects.iter().map(|object| packed.piece(&object.levels)).collect();
            (packed, objects)
        };
        let cut = |lines: bool| cells::cut(&scene.ground, &|surface| (surface == Surface::Line) == lines);
        let ((mut packed, objects), (ground, lines)) =
            rayon::join(pack_objects, || rayon::join(|| cut(false), || cut(true)));
        let mut pieces =
            |cells: Vec<Vec<scene::Level>>| cells.iter().map(|levels| packed.piece(levels)).collect();
        let (ground, lines) = (pieces(ground), pieces(lines));
        // The map of shadows ends with the city, and so would shadows of what stands around it.
        let is_near = |(_, object): &(&Piece, &Object)| {
            let finest = object.levels.first();
            finest.is_some_and(|level| level.mesh.vertices.iter().any(|v| is_near_city(scene, v.position)))
        };
        let casting = objects.iter().zip(&scene.objects).filter(is_near);
        let finest = casting.flat_map(|(piece, _)| piece.levels.first());
        let shadows: Vec<u32> =
            finest.flat_map(Level::all).flat_map(|side| packed.of(side)).copied().collect();
        let Packed { vertices, indices, .. } = packed;
        let pieces = Pieces { indices, objects, ground, lines, walls: scene.walls.clone() };
        Self { pieces: Arc::new(pieces), vertices, shadows }
    }
}

impl Standing {
    pub(super) fn new(device: &wgpu::Device, sorted: &Sorted) -> Self {
        let buffer = |label, contents, usage| {
            device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
                label: Some(label),
                contents,
                usage,
            })
        };
        let Sorted { pieces, vertices, shadows } = sorted;
        Self {
            vertices: buffer("city", bytemuck::cast_slice(vertices), wgpu::BufferUsages::VERTEX),
            shadows: (
                buffer("city's shadows", bytemuck::cast_slice(shadows), wgpu::BufferUsages::INDEX),
                shadows.len() as u32,
            ),
            lists: list_buffer(device, 1 << 16),
            pieces: Arc::clone(pieces),
        }
    }

    /// What hides things in a view from an eye; parallel rays have none.
    pub(super) fn horizon(&self, eye: Option<Vec3>, sector: Sector, frustum: &Frustum) -> Horizon {
        // Walls out of sight hide nothing that is in sight.
        let may_see = |wall: &&Wall| {
            let (low, high) = (wall.from.min(wall.to), wall.from.max(wall.to));
            frustum.may_see_box([low.extend(0.0), high.extend(wall.height_m)])
        };
        eye.map_or_else(Horizon::open, |eye| {
            Horizon::new(eye, sector, self.pieces.walls.iter().filter(may_see))
        })
    }

    /// Adds what a view may see to the lists of a batch.
    pub(super) fn see(&self, gaze: &Gaze<'_>, lists: &mut Vec<u32>) -> SeenCells {
        let seen = gaze.all_seen(&self.pieces.objects);
        let (mut plain, raised): (Vec<_>, Vec<_>) = seen.iter().partition(|sight| sight.is_plain);
        let (mut ground, painted) = (gaze.all_seen(&self.pieces.ground), gaze.all_seen(&self.pieces.lines));
        if gaze.patterns == Patterns::None {
            plain.append(&mut ground);
        }
        SeenCells {
            plain: self.list(gaze, &plain, Level::all, lists),
            raised: self.list(gaze, &raised, |level| level.main.iter(), lists),
            apart: self.list(gaze, &raised, |level| level.apart.iter(), lists),
            ground: self.list(gaze, &ground, Level::all, lists),
            lines: self.list(gaze, &painted, Level::all, lists),
        }
    }

    fn list<'p, I: Iterator<Item = &'p Side>>(
        &self,
        gaze: &Gaze<'_>,
        seen: &[Sight<'p>],
        part: impl Fn(&'p Level) -> I,
        lists: &mut Vec<u32>,
    ) -> Range<u32> {
        let start = lists.len() as u32;
        for sight in seen {
            for side in part(sight.level) {
                if gaze.has_eye && side.turns_its_back(gaze.eye, sight.reach_m) {
                    continue;
                }
                let Range { start, end } = side.indices;
                lists.extend_from_slice(&self.pieces.indices[start as usize..end as usize]);
            }
        }
        start..lists.len() as u32
    }

    /// Hands the lists of a batch to the adapter.
    pub(super) fn write(&mut self, device: &wgpu::Device, queue: &wgpu::Queue, lists: &[u32]) {
        let bytes: &[u8] = bytemuck::cast_slice(lists);
        if (bytes.len() as u64) > self.lists.size() {
            self.lists = list_buffer(device, (bytes.len() as u64).next_power_of_two());
        }
        queue.write_buffer(&self.lists, 0, bytes);
    }

    /// Draws a part of the lists of the batch; the pipeline and its groups are set already.
    pub(super) fn draw(&self, pass: &mut wgpu::RenderPass<'_>, list: &Range<u32>) {
        if list.is_empty() {
            return;
        }
        pass.set_vertex_buffer(0, self.vertices.slice(..));
        pass.set_index_buffer(self.lists.slice(..), wgpu::IndexFormat::Uint32);
        pass.draw_indexed(list.clone(), 0, 0..1);
    }

    /// Everything that throws a shadow.
    pub(super) fn draw_shadows(&self, pass: &mut wgpu::RenderPass<'_>) {
        let (indices, count) = &self.shadows;
        if *count == 0 {
            return;
        }
        pass.set_vertex_buffer(0, self.vertices.slice(..));
        pass.set_index_buffer(indices.slice(..), wgpu::IndexFormat::Uint32);
        pass.draw_indexed(0..*count, 0, 0..1);
    }
}

fn list_buffer(device: &wgpu::Device, size: u64) -> wgpu::Buffer {
    device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("what views see"),
        size,
        usage: wgpu::BufferUsages::INDEX | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    })
}

/// A piece that a view may see.
#[derive(Clone, Copy)]
struct Sight<'p> {
    /// The least there may be.
    distance_m: f32,
    /// The most there may be.
    reach_m: f32,
    level: &'p Level,
    /// Whether its pattern is too fine to be seen.
    is_plain: bool,
}

impl Gaze<'_> {
    /// Pieces that may be seen, nearest first.
    fn all_seen<'p>(&self, pieces: &'p [Piece]) -> Vec<Sight<'p>> {
        let mut seen: Vec<Sight<'p>> = pieces.iter().filter_map(|piece| self.sees(piece)).collect();
        seen.sort_by(|a, b| a.distance_m.total_cmp(&b.distance_m));
        seen
    }

    fn sees<'p>(&self, piece: &'p Piece) -> Option<Sight<'p>> {
        let [low, high] = piece.bounds;
        if !self.frustum.may_see_box(piece.bounds) {
            return None;
        }
        let distance_m = self.eye.clamp(low, high).distance(self.eye);
        let pixels = |length_m| self.sharpness.pixels(length_m, distance_m);
        if pixels((high - low).length()) < self.least_px
            || self.horizon.hides_box(piece.bounds)
            || self.horizon.hides_hull(&piece.tops)
        {
            return None;
        }
        let middle = (low + high) / 2.0;
        let reach_m = middle.distance(self.eye) + high.distance(middle);
        let level = piece.levels.iter().rev().find(|level| pixels(level.error_m) < self.coarse_below_px);
        let is_plain = match self.patterns {
            Patterns::All => false,
            Patterns::Near => !piece.is_figured && pixels(PATTERN_M) < PATTERN_FROM_PX,
            Patterns::None => true,
        };
        level.or(piece.levels.first()).map(|level| Sight { distance_m, reach_m, level, is_plain })
    }
}

#[derive(Default)]
struct Packed {
    vertices: Vec<GpuVertex>,
    indices: Vec<u32>,
    apart: Option<Apart>,
    pieces: u32,
}

impl Packed {
    fn piece(&mut self, levels: &[scene::Level]) -> Piece {
        let first = self.vertices.len();
        let mut bounds = [Vec3::INFINITY, Vec3::NEG_INFINITY];
        let mut is_figured = false;
        let levels = levels
            .iter()
            .map(|level| {
                let mut mesh = level.mesh.clone();
                mesh.weld();
                let [low, high] = mesh.bounds();
                bounds = [bounds[0].min(low), bounds[1].max(high)];
                is_figured |= mesh.vertices.iter().any(|v| v.finish.surface.is_figured());
                let base = self.vertices.len() as u32;
                self.vertices.extend(mesh.vertices.iter().map(|v| pack(v, self.pieces)));
                let is_apart = |triangle: &&[u32]| {
                    let corners = [0, 1, 2].map(|k| &mesh.vertices[triangle[k] as usize]);
                    self.apart.is_some_and(|apart| apart.has(corners))
                };
                let (apart, main): (Vec<&[u32]>, Vec<&[u32]>) =
                    mesh.indices.chunks_exact(3).partition(is_apart);
                let at = |k: u32| mesh.vertices[k as usize].position;
                let indices = &mut self.indices;
                let [main, apart] = [main, apart].map(|part| sides::append(indices, base, at, &part));
                Level { error_m: level.error_m, main, apart }
            })
            .collect();
        self.pieces += 1;
        Piece { bounds, tops: tops(&self.vertices[first..]), levels, is_figured }
    }

    fn of(&self, side: &Side) -> &[u32] {
        &self.indices[side.indices.start as usize..side.indices.end as usize]
    }
}

/// Pieces of more corners are taken for the box around them.
const MOST_TOPS: usize = 24;

/// The places of vertices seen from above, and how high the highest is there; none where there are many.
fn tops(vertices: &[GpuVertex]) -> Vec<Vec3> {
    let mut tops: Vec<Vec3> = Vec::new();
    for at in vertices.iter().map(|v| Vec3::from(v.position)) {
        if let Some(top) = tops.iter_mut().find(|top| top.truncate() == at.truncate()) {
            top.z = top.z.max(at.z);
        } else if tops.len() < MOST_TOPS {
            tops.push(at);
        } else {
            return Vec::new();
        }
    }
    tops
}

/// A vertex of a piece as the shaders read it.
fn pack(v: &Vertex, piece: u32) -> GpuVertex {
    let [r, g, b] = v.finish.colour;
    GpuVertex {
        position: v.position.to_array(),
        normal: pack_normal(v.normal),
        colour: [r, g, b, v.openness],
        uv: v.uv.to_array(),
        material: v.finish.surface as u32 | (v.finish.class as u32) << 8 | (piece & 0xff) << 16,
    }
}

pub(super) fn pack_normal(n: Vec3) -> [i8; 4] {
    let [x, y, z] = n.to_array().map(|c| (c * 127.0).round() as i8);
    [x, y, z, 0]
}
