//! Static city on the GPU: vertex buffers, and for each view an index list of its visible triangles, front to back.
//!
//! The CPU makes the lists by frustum culling, small-feature culling, occlusion culling, back-face culling of clusters
//! and selection of a level of detail (LOD), at a few nanoseconds per triangle. On a software adapter each culled
//! triangle saves a hundred times that; on a GPU a view is a few draw calls.

use super::cells;
use super::context::filled_buffer;
use super::frustum::{Frustum, PixelScale};
use super::geometry::{DrawBucket, GeometryChunk, GeometryPacker, PieceLod, ScenePiece};
use super::instances::{InstancedScene, PreparedInstances, VisibleInstance};
use super::normal_clusters::NormalCluster;
use super::occlusion_horizon::{AzimuthSector, OcclusionHorizon};
use city3d_scene::{LodMesh, NEAR_ERROR_M, SceneDescription, SceneObject, Surface, Wall};
use glam::Vec3;
use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;

/// Size of the features of most textures, and the pixels that a feature must cover to be worth a texture.
const PATTERN_M: f32 = 0.25;
const MIN_PATTERN_PX: f32 = 6.0;
/// The same of the ground along the line of sight, seen at a grazing angle: height of the eye over the distance at most.
const MIN_GROUND_PATTERN_PX: f32 = 2.0;
const MOST_GRAZING: f32 = 0.35;

/// Grid of the corners of triangles on every adapter, pixels, and the least height of a step in the ground, metres.
const SUBPIXEL: f32 = 1.0 / 256.0;
const LEAST_STEP_M: f32 = 0.1;

/// Objects farther from the city than this cast no shadow.
const SHADOW_MARGIN_M: f32 = 20.0;

/// Whether a box reaches the city or the ground around it from where its shadow falls on the city.
pub(super) fn casts_on_city(scene: &SceneDescription, [low, high]: [Vec3; 2]) -> bool {
    let city = scene.bounds.map(Vec3::truncate);
    high.truncate().cmpge(city[0] - SHADOW_MARGIN_M).all()
        && low.truncate().cmple(city[1] + SHADOW_MARGIN_M).all()
}

/// Buffers of the static city on one device.
#[derive(Debug)]
pub(super) struct StaticScene {
    pieces: Arc<ScenePieces>,
    /// Vertices of each chunk.
    vertices: Vec<wgpu::Buffer>,
    /// By chunk: index buffer and number of indices.
    shadow_casters: Vec<(usize, wgpu::Buffer, u32)>,
    /// Index buffers with the lists of all views of a batch, one for each segment of [`IndexLists`].
    index_lists: Vec<wgpu::Buffer>,
    /// Models of the map.
    instanced: InstancedScene,
}

/// Pieces of the city and their indices on the CPU; all devices share them.
#[derive(Debug)]
struct ScenePieces {
    /// Vertices and indices of all pieces at all levels of detail.
    chunks: Vec<GeometryChunk>,
    objects: PieceGroups,
    ground: PieceGroups,
    /// Painted lines, drawn with analytic anti-aliasing.
    lines: PieceGroups,
    /// Occluders.
    walls: Vec<Wall>,
}

/// Pieces in groups of neighbours of about one size: most groups are culled as a whole.
#[derive(Debug)]
struct PieceGroups {
    groups: Vec<PieceGroup>,
    /// Group after group.
    pieces: Vec<NumberedPiece>,
}

#[derive(Debug)]
struct PieceGroup {
    bounds: [Vec3; 2],
    members: Range<usize>,
}

/// A piece with its number in the scene.
#[derive(Debug)]
struct NumberedPiece {
    number: u32,
    piece: ScenePiece,
}

/// Edges of the cells of groups for pieces up to these sizes, metres.
const GROUP_CELLS_M: [(f32, f32); 3] = [(30.0, 60.0), (120.0, 240.0), (f32::INFINITY, 960.0)];

impl PieceGroups {
    fn new(pieces: Vec<ScenePiece>) -> Self {
        let mut cells: BTreeMap<(usize, [i32; 2]), Vec<NumberedPiece>> = BTreeMap::new();
        for (number, piece) in (0..).zip(pieces) {
            let [low, high] = piece.bounds.map(Vec3::truncate);
            let size_m = (high - low).max_element();
            let rank = GROUP_CELLS_M.iter().position(|(most_m, _)| size_m <= *most_m).unwrap_or(0);
            let cell = ((low + high) / 2.0 / GROUP_CELLS_M[rank].1).floor().as_ivec2().to_array();
            cells.entry((rank, cell)).or_default().push(NumberedPiece { number, piece });
        }
        let mut grouped = Self { groups: Vec::new(), pieces: Vec::new() };
        for members in cells.into_values() {
            let bounds = members.iter().map(|member| member.piece.bounds);
            let bounds = bounds.reduce(|[low, high], [from, to]| [low.min(from), high.max(to)]);
            let start = grouped.pieces.len();
            grouped.pieces.extend(members);
            let members = start..grouped.pieces.len();
            grouped.groups.extend(bounds.map(|bounds| PieceGroup { bounds, members }));
        }
        grouped
    }

    fn of(&self, group: &PieceGroup) -> std::slice::Iter<'_, NumberedPiece> {
        self.pieces[group.members.clone()].iter()
    }
}

/// Geometry of a scene prepared for drawing, on the CPU: made once for all devices.
#[derive(Debug)]
pub(super) struct PreparedGeometry {
    pieces: Arc<ScenePieces>,
    /// Indices of everything that casts a shadow, by chunk.
    shadow_casters: BTreeMap<usize, Vec<u32>>,
    instanced: Arc<PreparedInstances>,
}

/// Indices of the visible triangles of a batch of views, cut into segments that fit the buffers of every adapter.
#[derive(Debug, Default)]
pub(super) struct IndexLists {
    segments: Vec<Vec<u32>>,
}

/// Indices after which a new segment begins: 64 MiB.
const SEGMENT_LEN: usize = 16 << 20;

/// Draw call: a range of a segment of the index lists, for the vertices of a chunk.
#[derive(Clone, Debug)]
struct DrawCall {
    chunk: usize,
    segment: usize,
    indices: Range<u32>,
}

/// Draw calls of one pipeline for a view: one, unless the scene or the batch is very large.
#[derive(Clone, Debug, Default)]
pub(super) struct DrawList {
    calls: Vec<DrawCall>,
}

impl DrawList {
    pub(super) fn is_empty(&self) -> bool {
        self.calls.is_empty()
    }

    fn triangles(&self) -> u64 {
        self.calls.iter().map(|call| call.indices.len() as u64 / 3).sum()
    }
}

impl IndexLists {
    /// Empties the lists and keeps their memory for the next batch.
    pub(super) fn clear(&mut self) {
        self.segments.truncate(1);
        self.segments.iter_mut().for_each(Vec::clear);
    }

    /// Appends indices into the vertices of a chunk, to the last draw call where it goes on.
    fn append<'i>(&mut self, list: &mut DrawList, chunk: usize, clusters: impl Iterator<Item = &'i [u32]>) {
        if self.segments.last().is_none_or(|segment| segment.len() > SEGMENT_LEN) {
            self.segments.push(Vec::new());
        }
        let last = self.segments.len() - 1;
        let segment = &mut self.segments[last];
        let start = segment.len() as u32;
        clusters.for_each(|indices| segment.extend_from_slice(indices));
        let end = segment.len() as u32;
        match list.calls.last_mut() {
            _ if start == end => {}
            Some(call) if (call.chunk, call.segment, call.indices.end) == (chunk, last, start) => {
                call.indices.end = end;
            }
            _ => list.calls.push(DrawCall { chunk, segment: last, indices: start..end }),
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
    /// See [`super::Quality::vehicle_lod_error_px`].
    pub(super) vehicle_lod_error_px: f32,
    pub(super) texture_detail: TextureDetail,
    /// See [`super::Quality::min_size_px`].
    pub(super) min_size_px: f32,
}

/// Visible triangles of a view, by pipeline.
#[derive(Clone, Debug, Default)]
pub(super) struct VisibleRanges {
    /// Objects with textures, apart from those in `bucket`.
    pub(super) objects: DrawList,
    /// See [`DrawBucket`].
    pub(super) bucket: DrawList,
    /// Pieces too far away to show their texture.
    pub(super) untextured: DrawList,
    pub(super) ground: DrawList,
    /// Ground too far away to show its texture; empty unless [`TextureDetail::Near`].
    pub(super) plain_ground: DrawList,
    pub(super) lines: DrawList,
    /// Models of the map, front to back.
    pub(super) instances: Vec<VisibleInstance>,
}

impl VisibleRanges {
    /// Ground of all pipelines.
    pub(super) fn all_ground(&self) -> [&DrawList; 2] {
        [&self.ground, &self.plain_ground]
    }

    fn triangles(&self) -> u64 {
        let objects = [&self.untextured, &self.bucket, &self.objects];
        let lists = objects.into_iter().chain(self.all_ground()).chain([&self.lines]);
        lists.map(DrawList::triangles).sum()
    }
}

impl PreparedGeometry {
    /// Packs vertices, clusters triangles and splits the ground into cells; `bucket` gets lists of its own.
    pub(super) fn new(scene: &SceneDescription, bucket: Option<DrawBucket>) -> Self {
        let pack_objects = || {
            let mut packer = GeometryPacker::new(bucket);
            let levels: Vec<&[LodMesh]> = scene.objects.iter().map(|object| &object.levels[..]).collect();
            let objects = packer.pieces(&levels);
            (packer, objects)
        };
        let split =
            |lines: bool| cells::split_ground(&scene.ground, &|surface| (surface == Surface::Line) == lines);
        let ((mut packer, objects), (ground, lines)) =
            rayon::join(pack_objects, || rayon::join(|| split(false), || split(true)));
        let mut pieces = |cells: Vec<Vec<LodMesh>>| {
            packer.pieces(&cells.iter().map(|levels| &levels[..]).collect::<Vec<_>>())
        };
        let (ground, lines) = (pieces(ground), pieces(lines));
        // The shadow map ends with the city: shadows of objects around it would be cut off there.
        let is_caster = |(_, object): &(&ScenePiece, &SceneObject)| {
            let finest = object.levels.first();
            finest.is_some_and(|level| {
                level.mesh.vertices.iter().any(|v| casts_on_city(scene, [v.position; 2]))
            })
        };
        let casters = objects.iter().zip(&scene.objects).filter(is_caster);
        let mut shadow_casters: BTreeMap<usize, Vec<u32>> = BTreeMap::new();
        // What only near levels have is finer than a texel of the shadow map.
        let is_fine = |level: &&PieceLod| level.error_m <= NEAR_ERROR_M;
        for fine in casters.filter_map(|(piece, _)| piece.levels.iter().rfind(is_fine)) {
            let indices = shadow_casters.entry(fine.chunk).or_default();
            let chunk = &packer.chunks[fine.chunk];
            fine.all().for_each(|cluster| indices.extend_from_slice(chunk.of(cluster)));
        }
        let chunks = packer.chunks;
        let [objects, ground, lines] = [objects, ground, lines].map(PieceGroups::new);
        let pieces = ScenePieces { chunks, objects, ground, lines, walls: scene.walls.clone() };
        let instanced = Arc::new(PreparedInstances::new(scene, bucket));
        Self { pieces: Arc::new(pieces), shadow_casters, instanced }
    }

    /// Whether the scene has models of the map.
    pub(super) fn has_instances(&self) -> bool {
        !self.instanced.is_empty()
    }
}

impl StaticScene {
    pub(super) fn new(device: &wgpu::Device, geometry: &PreparedGeometry) -> Self {
        let PreparedGeometry { pieces, shadow_casters, instanced } = geometry;
        let vertices = |chunk: &GeometryChunk| {
            filled_buffer(device, "city", bytemuck::cast_slice(&chunk.vertices), wgpu::BufferUsages::VERTEX)
        };
        let casters = |(&chunk, indices): (&usize, &Vec<u32>)| {
            let bytes = bytemuck::cast_slice(indices);
            let label = "shadow casters of the city";
            let buffer = filled_buffer(device, label, bytes, wgpu::BufferUsages::INDEX);
            (chunk, buffer, indices.len() as u32)
        };
        Self {
            vertices: pieces.chunks.iter().map(vertices).collect(),
            shadow_casters: shadow_casters.iter().map(casters).collect(),
            index_lists: vec![index_buffer(device, 1 << 16)],
            pieces: Arc::clone(pieces),
            instanced: InstancedScene::new(device, instanced),
        }
    }

    /// Models of the map.
    pub(super) fn instanced(&self) -> &InstancedScene {
        &self.instanced
    }

    /// Triangles that a view draws.
    pub(super) fn triangles(&self, visible: &VisibleRanges) -> u64 {
        visible.triangles() + self.instanced.triangles(&visible.instances)
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
    pub(super) fn cull(&self, cull: &CullContext<'_>, index_lists: &mut IndexLists) -> VisibleRanges {
        let visible = cull.visible_pieces(&self.pieces.objects);
        let (mut untextured, objects): (Vec<_>, Vec<_>) =
            visible.iter().partition(|piece| piece.is_untextured);
        let (mut ground, lines) =
            (cull.visible_ground(&self.pieces.ground), cull.visible_pieces(&self.pieces.lines));
        let mut plain_ground = Vec::new();
        match cull.texture_detail {
            TextureDetail::All => {}
            TextureDetail::Near => {
                (plain_ground, ground) = ground.into_iter().partition(|piece| piece.is_untextured);
            }
            TextureDetail::None => untextured.append(&mut ground),
        }
        VisibleRanges {
            untextured: self.append_indices(cull, &untextured, PieceLod::all, index_lists),
            objects: self.append_indices(cull, &objects, |level| level.main.iter(), index_lists),
            bucket: self.append_indices(cull, &objects, |level| level.bucket.iter(), index_lists),
            ground: self.append_indices(cull, &ground, PieceLod::all, index_lists),
            plain_ground: self.append_indices(cull, &plain_ground, PieceLod::all, index_lists),
            lines: self.append_indices(cull, &lines, PieceLod::all, index_lists),
            instances: self.instanced.visible(cull),
        }
    }

    fn append_indices<'p, I: Iterator<Item = &'p NormalCluster>>(
        &self,
        cull: &CullContext<'_>,
        visible: &[VisiblePiece<'p>],
        part: impl Fn(&'p PieceLod) -> I,
        index_lists: &mut IndexLists,
    ) -> DrawList {
        let mut list = DrawList::default();
        for piece in visible {
            let chunk = &self.pieces.chunks[piece.level.chunk];
            let faces_eye = |cluster: &&NormalCluster| {
                !(cull.is_perspective && cluster.is_backfacing(cull.eye, piece.reach_m, piece.slack_m))
            };
            let clusters = part(piece.level).filter(faces_eye).map(|cluster| chunk.of(cluster));
            index_lists.append(&mut list, piece.level.chunk, clusters);
        }
        list
    }

    /// Uploads the index lists of a batch.
    pub(super) fn upload(&mut self, device: &wgpu::Device, queue: &wgpu::Queue, index_lists: &IndexLists) {
        for (k, indices) in index_lists.segments.iter().enumerate() {
            let bytes: &[u8] = bytemuck::cast_slice(indices);
            let size = bytes.len() as u64;
            match self.index_lists.get_mut(k) {
                Some(buffer) if buffer.size() >= size => {}
                Some(buffer) => *buffer = index_buffer(device, size.next_power_of_two()),
                None => self.index_lists.push(index_buffer(device, size.next_power_of_two())),
            }
            queue.write_buffer(&self.index_lists[k], 0, bytes);
        }
    }

    /// Draws a list of triangles. The caller has set the pipeline and the bind groups.
    pub(super) fn draw(&self, pass: &mut wgpu::RenderPass<'_>, list: &DrawList) {
        for DrawCall { chunk, segment, indices } in &list.calls {
            pass.set_vertex_buffer(0, self.vertices[*chunk].slice(..));
            pass.set_index_buffer(self.index_lists[*segment].slice(..), wgpu::IndexFormat::Uint32);
            pass.draw_indexed(indices.clone(), 0, 0..1);
        }
    }

    /// Draws all shadow casters but the models of the map.
    pub(super) fn draw_shadows(&self, pass: &mut wgpu::RenderPass<'_>) {
        for (chunk, indices, count) in self.shadow_casters.iter().filter(|(.., count)| *count > 0) {
            pass.set_vertex_buffer(0, self.vertices[*chunk].slice(..));
            pass.set_index_buffer(indices.slice(..), wgpu::IndexFormat::Uint32);
            pass.draw_indexed(0..*count, 0, 0..1);
        }
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
    /// Decides about the order at equal distances.
    number: u32,
    /// Distance from the eye to the nearest point of its box.
    distance_m: f32,
    /// Distance from the eye that no point of its box exceeds.
    reach_m: f32,
    /// See [`NormalCluster::is_backfacing`].
    slack_m: f32,
    level: &'p PieceLod,
    /// Whether its texture is too fine to be seen.
    is_untextured: bool,
}

fn front_to_back<'p>(pieces: impl Iterator<Item = VisiblePiece<'p>>) -> Vec<VisiblePiece<'p>> {
    let mut visible: Vec<VisiblePiece<'p>> = pieces.collect();
    visible.sort_unstable_by(|a, b| a.distance_m.total_cmp(&b.distance_m).then(a.number.cmp(&b.number)));
    visible
}

impl CullContext<'_> {
    /// Pieces that pass all culling tests, front to back.
    fn visible_pieces<'p>(&self, pieces: &'p PieceGroups) -> Vec<VisiblePiece<'p>> {
        let near = |group: &&PieceGroup| {
            self.frustum.intersects_box(group.bounds) && !self.horizon.hides_box(group.bounds)
        };
        let groups = pieces.groups.iter().filter(near);
        front_to_back(groups.flat_map(|group| pieces.of(group)).filter_map(|piece| self.test_piece(piece)))
    }

    /// Pieces of the ground in the frustum, front to back. None is too small to be drawn, and what is hidden is drawn as
    /// coarsely as it goes: a crown or a coarse wall covers a little less than what stands for it as an occluder, and
    /// beside it one would look into nothing.
    fn visible_ground<'p>(&self, pieces: &'p PieceGroups) -> Vec<VisiblePiece<'p>> {
        let in_frustum = |group: &&PieceGroup| self.frustum.intersects_box(group.bounds);
        let groups = pieces.groups.iter().filter(in_frustum);
        front_to_back(groups.flat_map(|group| {
            let are_hidden = self.horizon.hides_box(group.bounds);
            pieces.of(group).filter_map(move |piece| self.test_ground(piece, are_hidden))
        }))
    }

    fn test_ground<'p>(&self, piece: &'p NumberedPiece, is_in_hidden: bool) -> Option<VisiblePiece<'p>> {
        let ScenePiece { bounds, levels, .. } = &piece.piece;
        if !self.frustum.intersects_box(*bounds) {
            return None;
        }
        let distance_m = self.distance_m(*bounds);
        let is_hidden = is_in_hidden || self.hides(&piece.piece);
        let level = if is_hidden { levels.last() } else { levels.get(self.lod(levels, 1.0, distance_m)) };
        let visible = self.visible_piece(piece, distance_m, level?);
        let slack_m = self.edge_on_slack_m(visible.reach_m);
        let is_untextured = is_hidden || self.is_plain_ground(*bounds, distance_m);
        Some(VisiblePiece { slack_m, is_untextured, ..visible })
    }

    /// Whether the texture of a piece of the ground is too fine to be seen, foreshortened as it is.
    fn is_plain_ground(&self, [_, high]: [Vec3; 2], distance_m: f32) -> bool {
        let slope = (self.eye.z - high.z).abs() / distance_m;
        let pattern_px = slope * self.pixel_scale.projected_px(PATTERN_M, distance_m);
        self.is_perspective && slope < MOST_GRAZING && pattern_px < MIN_GROUND_PATTERN_PX
    }

    /// How far behind the plane of a face of the ground an eye may be that still has to draw it. The adapter moves corners to
    /// a grid in each pixel; so the edges of the road and of the pavement above it may change places where the face of the
    /// kerb between them is narrower than that, and without it there is nothing between them.
    fn edge_on_slack_m(&self, reach_m: f32) -> f32 {
        reach_m * SUBPIXEL / self.pixel_scale.projected_px(LEAST_STEP_M, reach_m)
    }

    /// Frustum, small-feature and occlusion culling; then the coarsest LOD within the screen-space error.
    fn test_piece<'p>(&self, piece: &'p NumberedPiece) -> Option<VisiblePiece<'p>> {
        let ScenePiece { bounds, levels, .. } = &piece.piece;
        let distance_m = self.large_distance_m(*bounds)?;
        if self.hides(&piece.piece) {
            return None;
        }
        let level = levels.get(self.lod(levels, 1.0, distance_m))?;
        Some(self.visible_piece(piece, distance_m, level))
    }

    /// Whether a piece is certainly hidden: its outline, which is tighter than its box, or its box where it has none.
    fn hides(&self, piece: &ScenePiece) -> bool {
        if piece.top_outline.is_empty() {
            self.horizon.hides_box(piece.bounds)
        } else {
            self.horizon.hides_hull(&piece.top_outline)
        }
    }

    fn visible_piece<'p>(
        &self,
        NumberedPiece { number, piece }: &'p NumberedPiece,
        distance_m: f32,
        level: &'p PieceLod,
    ) -> VisiblePiece<'p> {
        let [low, high] = piece.bounds;
        let middle = (low + high) / 2.0;
        let reach_m = middle.distance(self.eye) + high.distance(middle);
        let is_untextured = self.is_untextured(piece, distance_m);
        VisiblePiece { number: *number, distance_m, reach_m, slack_m: 0.0, level, is_untextured }
    }

    /// Distance from the eye to the nearest point of a box.
    fn distance_m(&self, [low, high]: [Vec3; 2]) -> f32 {
        self.eye.clamp(low, high).distance(self.eye)
    }

    /// The same of a box that passes frustum and small-feature culling.
    fn large_distance_m(&self, bounds: [Vec3; 2]) -> Option<f32> {
        if !self.frustum.intersects_box(bounds) {
            return None;
        }
        let distance_m = self.distance_m(bounds);
        let size_px = self.pixel_scale.projected_px((bounds[1] - bounds[0]).length(), distance_m);
        (size_px >= self.min_size_px).then_some(distance_m)
    }

    /// Distance from the eye to the nearest point of a box that passes frustum, small-feature and occlusion culling.
    pub(super) fn visible_distance_m(&self, bounds: [Vec3; 2]) -> Option<f32> {
        self.large_distance_m(bounds).filter(|_| !self.horizon.hides_box(bounds))
    }

    /// Index of the coarsest LOD within the screen-space error, of an object drawn at a scale; 0 if none is.
    pub(super) fn lod(&self, levels: &[PieceLod], scale: f32, distance_m: f32) -> usize {
        let error_px = |level: &PieceLod| self.pixel_scale.projected_px(level.error_m * scale, distance_m);
        levels.iter().rposition(|level| error_px(level) < self.lod_error_px).unwrap_or(0)
    }

    /// Whether the texture of a piece is too fine to be seen.
    pub(super) fn is_untextured(&self, piece: &ScenePiece, distance_m: f32) -> bool {
        match self.texture_detail {
            TextureDetail::All => false,
            TextureDetail::Near => {
                !piece.is_figured && self.pixel_scale.projected_px(PATTERN_M, distance_m) < MIN_PATTERN_PX
            }
            TextureDetail::None => true,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn index_lists_go_on_in_one_draw_call_and_are_cut_where_a_buffer_would_be_too_large() {
        let piece = vec![7; SEGMENT_LEN / 2];
        let mut lists = IndexLists::default();
        let (mut near, mut far) = (DrawList::default(), DrawList::default());
        for chunk in [0, 0, 1, 1] {
            lists.append(&mut near, chunk, [&piece[..]].into_iter());
        }
        lists.append(&mut far, 1, std::iter::empty());
        lists.append(&mut far, 1, [&piece[..3]].into_iter());
        let calls = |list: &DrawList| -> Vec<(usize, usize, Range<u32>)> {
            list.calls.iter().map(|call| (call.chunk, call.segment, call.indices.clone())).collect()
        };
        let half = piece.len() as u32;
        assert_eq!(calls(&near), [(0, 0, 0..2 * half), (1, 0, 2 * half..3 * half), (1, 1, 0..half)]);
        assert_eq!(calls(&far), [(1, 1, half..half + 3)]);
        let lengths: Vec<usize> = lists.segments.iter().map(Vec::len).collect();
        assert_eq!(lengths, [3 * piece.len(), piece.len() + 3]);
    }
}
