//! Static city on the GPU: one vertex buffer, and for each view an index list of its visible triangles, front to back.
//!
//! The CPU makes the lists by frustum culling, small-feature culling, occlusion culling, back-face culling of clusters
//! and selection of a level of detail (LOD), at a few nanoseconds per triangle. On a software adapter each culled
//! triangle saves a hundred times that; on a GPU a view is a few draw calls.

use super::cells;
use super::frustum::{Frustum, PixelScale};
use super::normal_clusters::{self, NormalCluster};
use super::occlusion_horizon::{AzimuthSector, OcclusionHorizon};
use super::passes::city::gpu_data::Vertex as GpuVertex;
use city3d_scene::{SceneDescription, SceneObject, Surface, Vertex, Wall};
use glam::Vec3;
use std::ops::Range;
use std::sync::Arc;
use wgpu::util::DeviceExt;

/// Size of the features of most textures, and the pixels that a feature must cover to be worth a texture.
const PATTERN_M: f32 = 0.25;
const MIN_PATTERN_PX: f32 = 6.0;

/// Objects farther from the city than this cast no shadow.
const SHADOW_MARGIN_M: f32 = 20.0;

fn casts_on_city(scene: &SceneDescription, at: Vec3) -> bool {
    let [low, high] = scene.bounds.map(Vec3::truncate);
    let at = at.truncate();
    at.cmpge(low - SHADOW_MARGIN_M).all() && at.cmple(high + SHADOW_MARGIN_M).all()
}

/// Object or ground cell of the city: the unit of culling and LOD selection.
#[derive(Clone, Debug)]
struct ScenePiece {
    bounds: [Vec3; 2],
    /// Corners seen from above, each at its greatest height; empty if they are many. See [`top_outline`].
    top_outline: Vec<Vec3>,
    /// Levels of detail, the finest first.
    levels: Vec<PieceLod>,
    /// Whether its texture shows recognisable things: windows, doors, letters.
    is_figured: bool,
}

#[derive(Clone, Debug)]
struct PieceLod {
    error_m: f32,
    main: Vec<NormalCluster>,
    /// See [`DrawBucket`].
    bucket: Vec<NormalCluster>,
}

impl PieceLod {
    fn all(&self) -> impl Iterator<Item = &NormalCluster> {
        self.main.iter().chain(&self.bucket)
    }
}

/// Buffers of the static city on one device.
#[derive(Debug)]
pub(super) struct StaticScene {
    pieces: Arc<ScenePieces>,
    vertices: wgpu::Buffer,
    /// Index buffer and number of indices.
    shadow_casters: (wgpu::Buffer, u32),
    /// Index buffer with the lists of all views of a batch.
    index_lists: wgpu::Buffer,
}

/// Pieces of the city and their indices on the CPU; all devices share them.
#[derive(Debug)]
struct ScenePieces {
    /// Indices of all pieces at all levels of detail.
    indices: Vec<u32>,
    objects: Vec<ScenePiece>,
    ground: Vec<ScenePiece>,
    /// Painted lines, drawn with analytic anti-aliasing.
    lines: Vec<ScenePiece>,
    /// Occluders.
    walls: Vec<Wall>,
}

/// Geometry of a scene prepared for drawing, on the CPU: made once for all devices.
#[derive(Debug)]
pub(super) struct PreparedGeometry {
    pieces: Arc<ScenePieces>,
    vertices: Vec<GpuVertex>,
    /// Indices of everything that casts a shadow.
    shadow_casters: Vec<u32>,
}

/// Triangles of objects that a pipeline of their own draws.
#[derive(Clone, Copy, Debug)]
pub(super) enum DrawBucket {
    /// Faces turned away from the sun (unit vector towards it): they need no shadow lookup.
    Unlit(Vec3),
    /// Tree crowns, whose outline is alpha to coverage.
    AlphaToCoverage,
}

impl DrawBucket {
    fn contains(self, corners: [&Vertex; 3]) -> bool {
        match self {
            Self::Unlit(to_sun) => corners.iter().all(|v| v.normal.dot(to_sun) <= 0.0),
            // Hedges have the same leaves, but flat faces.
            Self::AlphaToCoverage => {
                let [a, b, c] = corners;
                let is_round = a.normal.dot(b.normal).min(b.normal.dot(c.normal)) < 0.999;
                a.finish.surface == Surface::Leaves && is_round
            }
        }
    }
}

/// Which pieces are drawn with textures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum TextureDetail {
    All,
    /// Only pieces near enough to show the features of their texture.
    Near,
    None,
}

/// Culling and LOD parameters of a view: frustum, occlusion horizon, screen-space error.
#[derive(Clone, Copy, Debug)]
pub(super) struct CullContext<'a> {
    pub(super) frustum: &'a Frustum,
    pub(super) horizon: &'a OcclusionHorizon,
    pub(super) pixel_scale: PixelScale,
    pub(super) eye: Vec3,
    /// Whether the projection has an eye; parallel rays have none.
    pub(super) is_perspective: bool,
    /// See [`super::Quality::lod_error_px`].
    pub(super) lod_error_px: f32,
    pub(super) texture_detail: TextureDetail,
    /// See [`super::Quality::min_size_px`].
    pub(super) min_size_px: f32,
}

/// Visible triangles of a view, as ranges of the index lists of the batch: one for each draw call.
#[derive(Clone, Debug, Default)]
pub(super) struct VisibleRanges {
    /// Objects with textures, apart from those in `bucket`.
    pub(super) objects: Range<u32>,
    /// See [`DrawBucket`].
    pub(super) bucket: Range<u32>,
    /// Pieces too far away to show their texture.
    pub(super) untextured: Range<u32>,
    pub(super) ground: Range<u32>,
    pub(super) lines: Range<u32>,
}

impl VisibleRanges {
    /// Objects of all pipelines.
    pub(super) fn all_objects(&self) -> [&Range<u32>; 3] {
        [&self.untextured, &self.bucket, &self.objects]
    }

    pub(super) fn triangles(&self) -> u64 {
        [&self.objects, &self.bucket, &self.untextured, &self.ground, &self.lines]
            .iter()
            .map(|list| list.len() as u64 / 3)
            .sum()
    }
}

impl PreparedGeometry {
    /// Packs vertices, clusters triangles and splits the ground into cells; `bucket` gets lists of its own.
    pub(super) fn new(scene: &SceneDescription, bucket: Option<DrawBucket>) -> Self {
        let pack_objects = || {
            let mut packer = GeometryPacker { bucket, ..GeometryPacker::default() };
            let objects: Vec<ScenePiece> =
                scene.objects.iter().map(|object| packer.piece(&object.levels)).collect();
            (packer, objects)
        };
        let split =
            |lines: bool| cells::split_ground(&scene.ground, &|surface| (surface == Surface::Line) == lines);
        let ((mut packer, objects), (ground, lines)) =
            rayon::join(pack_objects, || rayon::join(|| split(false), || split(true)));
        let mut pieces = |cells: Vec<Vec<city3d_scene::LodMesh>>| {
            cells.iter().map(|levels| packer.piece(levels)).collect()
        };
        let (ground, lines) = (pieces(ground), pieces(lines));
        // The shadow map ends with the city: shadows of objects around it would be cut off there.
        let is_caster = |(_, object): &(&ScenePiece, &SceneObject)| {
            let finest = object.levels.first();
            finest.is_some_and(|level| level.mesh.vertices.iter().any(|v| casts_on_city(scene, v.position)))
        };
        let casters = objects.iter().zip(&scene.objects).filter(is_caster);
        let finest = casters.flat_map(|(piece, _)| piece.levels.first());
        let shadow_casters: Vec<u32> =
            finest.flat_map(PieceLod::all).flat_map(|cluster| packer.of(cluster)).copied().collect();
        let GeometryPacker { vertices, indices, .. } = packer;
        let pieces = ScenePieces { indices, objects, ground, lines, walls: scene.walls.clone() };
        Self { pieces: Arc::new(pieces), vertices, shadow_casters }
    }
}

impl StaticScene {
    pub(super) fn new(device: &wgpu::Device, geometry: &PreparedGeometry) -> Self {
        let buffer = |label, contents, usage| {
            device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
                label: Some(label),
                contents,
                usage,
            })
        };
        let PreparedGeometry { pieces, vertices, shadow_casters } = geometry;
        Self {
            vertices: buffer("city", bytemuck::cast_slice(vertices), wgpu::BufferUsages::VERTEX),
            shadow_casters: (
                buffer(
                    "shadow casters of the city",
                    bytemuck::cast_slice(shadow_casters),
                    wgpu::BufferUsages::INDEX,
                ),
                shadow_casters.len() as u32,
            ),
            index_lists: index_buffer(device, 1 << 16),
            pieces: Arc::clone(pieces),
        }
    }

    /// Occlusion horizon of the walls in the frustum; it hides nothing without an eye.
    pub(super) fn horizon(
        &self,
        eye: Option<Vec3>,
        sector: AzimuthSector,
        frustum: &Frustum,
    ) -> OcclusionHorizon {
        // A wall outside the frustum hides nothing inside it.
        let in_frustum = |wall: &&Wall| {
            let (low, high) = (wall.from.min(wall.to), wall.from.max(wall.to));
            frustum.intersects_box([low.extend(0.0), high.extend(wall.height_m)])
        };
        eye.map_or_else(OcclusionHorizon::empty, |eye| {
            OcclusionHorizon::new(eye, sector, self.pieces.walls.iter().filter(in_frustum))
        })
    }

    /// Culls the city for a view and appends the indices of its visible triangles to the lists of the batch.
    pub(super) fn cull(&self, cull: &CullContext<'_>, index_lists: &mut Vec<u32>) -> VisibleRanges {
        let visible = cull.visible_pieces(&self.pieces.objects);
        let (mut untextured, objects): (Vec<_>, Vec<_>) =
            visible.iter().partition(|piece| piece.is_untextured);
        let (mut ground, lines) =
            (cull.visible_pieces(&self.pieces.ground), cull.visible_pieces(&self.pieces.lines));
        if cull.texture_detail == TextureDetail::None {
            untextured.append(&mut ground);
        }
        VisibleRanges {
            untextured: self.append_indices(cull, &untextured, PieceLod::all, index_lists),
            objects: self.append_indices(cull, &objects, |level| level.main.iter(), index_lists),
            bucket: self.append_indices(cull, &objects, |level| level.bucket.iter(), index_lists),
            ground: self.append_indices(cull, &ground, PieceLod::all, index_lists),
            lines: self.append_indices(cull, &lines, PieceLod::all, index_lists),
        }
    }

    fn append_indices<'p, I: Iterator<Item = &'p NormalCluster>>(
        &self,
        cull: &CullContext<'_>,
        visible: &[VisiblePiece<'p>],
        part: impl Fn(&'p PieceLod) -> I,
        index_lists: &mut Vec<u32>,
    ) -> Range<u32> {
        let start = index_lists.len() as u32;
        for piece in visible {
            for cluster in part(piece.level) {
                if cull.is_perspective && cluster.is_backfacing(cull.eye, piece.reach_m) {
                    continue;
                }
                let Range { start, end } = cluster.indices;
                index_lists.extend_from_slice(&self.pieces.indices[start as usize..end as usize]);
            }
        }
        start..index_lists.len() as u32
    }

    /// Uploads the index lists of a batch.
    pub(super) fn upload(&mut self, device: &wgpu::Device, queue: &wgpu::Queue, index_lists: &[u32]) {
        let bytes: &[u8] = bytemuck::cast_slice(index_lists);
        if (bytes.len() as u64) > self.index_lists.size() {
            self.index_lists = index_buffer(device, (bytes.len() as u64).next_power_of_two());
        }
        queue.write_buffer(&self.index_lists, 0, bytes);
    }

    /// Draws a range of the index lists. The caller has set the pipeline and the bind groups.
    pub(super) fn draw(&self, pass: &mut wgpu::RenderPass<'_>, list: &Range<u32>) {
        if list.is_empty() {
            return;
        }
        pass.set_vertex_buffer(0, self.vertices.slice(..));
        pass.set_index_buffer(self.index_lists.slice(..), wgpu::IndexFormat::Uint32);
        pass.draw_indexed(list.clone(), 0, 0..1);
    }

    /// Draws all shadow casters.
    pub(super) fn draw_shadows(&self, pass: &mut wgpu::RenderPass<'_>) {
        let (indices, count) = &self.shadow_casters;
        if *count == 0 {
            return;
        }
        pass.set_vertex_buffer(0, self.vertices.slice(..));
        pass.set_index_buffer(indices.slice(..), wgpu::IndexFormat::Uint32);
        pass.draw_indexed(0..*count, 0, 0..1);
    }
}

fn index_buffer(device: &wgpu::Device, size: u64) -> wgpu::Buffer {
    device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("visible indices"),
        size,
        usage: wgpu::BufferUsages::INDEX | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    })
}

/// Piece that passed the culling tests of a view, at its selected level of detail.
#[derive(Clone, Copy)]
struct VisiblePiece<'p> {
    /// Distance from the eye to the nearest point of its box.
    distance_m: f32,
    /// Distance from the eye that no point of its box exceeds.
    reach_m: f32,
    level: &'p PieceLod,
    /// Whether its texture is too fine to be seen.
    is_untextured: bool,
}

impl CullContext<'_> {
    /// Pieces that pass all culling tests, front to back.
    fn visible_pieces<'p>(&self, pieces: &'p [ScenePiece]) -> Vec<VisiblePiece<'p>> {
        let mut visible: Vec<VisiblePiece<'p>> =
            pieces.iter().filter_map(|piece| self.test_piece(piece)).collect();
        visible.sort_by(|a, b| a.distance_m.total_cmp(&b.distance_m));
        visible
    }

    /// Frustum, small-feature and occlusion culling; then the coarsest LOD within the screen-space error.
    fn test_piece<'p>(&self, piece: &'p ScenePiece) -> Option<VisiblePiece<'p>> {
        let [low, high] = piece.bounds;
        if !self.frustum.intersects_box(piece.bounds) {
            return None;
        }
        let distance_m = self.eye.clamp(low, high).distance(self.eye);
        let projected_px = |length_m| self.pixel_scale.projected_px(length_m, distance_m);
        if projected_px((high - low).length()) < self.min_size_px
            || self.horizon.hides_box(piece.bounds)
            || self.horizon.hides_hull(&piece.top_outline)
        {
            return None;
        }
        let middle = (low + high) / 2.0;
        let reach_m = middle.distance(self.eye) + high.distance(middle);
        let level = piece.levels.iter().rev().find(|level| projected_px(level.error_m) < self.lod_error_px);
        let is_untextured = match self.texture_detail {
            TextureDetail::All => false,
            TextureDetail::Near => !piece.is_figured && projected_px(PATTERN_M) < MIN_PATTERN_PX,
            TextureDetail::None => true,
        };
        level.or(piece.levels.first()).map(|level| VisiblePiece { distance_m, reach_m, level, is_untextured })
    }
}

/// Packs pieces into one vertex buffer and one index list.
#[derive(Default)]
struct GeometryPacker {
    vertices: Vec<GpuVertex>,
    indices: Vec<u32>,
    bucket: Option<DrawBucket>,
    pieces: u32,
}

impl GeometryPacker {
    fn piece(&mut self, levels: &[city3d_scene::LodMesh]) -> ScenePiece {
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
                let in_bucket = |triangle: &&[u32]| {
                    let corners = [0, 1, 2].map(|k| &mesh.vertices[triangle[k] as usize]);
                    self.bucket.is_some_and(|bucket| bucket.contains(corners))
                };
                let (bucket, main): (Vec<&[u32]>, Vec<&[u32]>) =
                    mesh.indices.chunks_exact(3).partition(in_bucket);
                let at = |k: u32| mesh.vertices[k as usize].position;
                let indices = &mut self.indices;
                let [main, bucket] =
                    [main, bucket].map(|part| normal_clusters::append(indices, base, at, &part));
                PieceLod { error_m: level.error_m, main, bucket }
            })
            .collect();
        self.pieces += 1;
        ScenePiece { bounds, top_outline: top_outline(&self.vertices[first..]), levels, is_figured }
    }

    fn of(&self, cluster: &NormalCluster) -> &[u32] {
        &self.indices[cluster.indices.start as usize..cluster.indices.end as usize]
    }
}

/// A piece with more corners is tested by its bounding box alone.
const MAX_OUTLINE: usize = 24;

/// Distinct positions of vertices seen from above, each at its greatest height; empty if there are many.
fn top_outline(vertices: &[GpuVertex]) -> Vec<Vec3> {
    let mut top_outline: Vec<Vec3> = Vec::new();
    for at in vertices.iter().map(|v| Vec3::from(v.position)) {
        if let Some(top) = top_outline.iter_mut().find(|top| top.truncate() == at.truncate()) {
            top.z = top.z.max(at.z);
        } else if top_outline.len() < MAX_OUTLINE {
            top_outline.push(at);
        } else {
            return Vec::new();
        }
    }
    top_outline
}

/// Vertex in the layout of the vertex buffer.
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

/// Normal as three signed normalised bytes.
pub(super) fn pack_normal(n: Vec3) -> [i8; 4] {
    let [x, y, z] = n.to_array().map(|c| (c * 127.0).round() as i8);
    [x, y, z, 0]
}
