//! Packs the meshes of a scene into chunks of vertices and indices, with their levels of detail and normal clusters. A
//! chunk fits the buffers of every adapter, however large the scene is.

use super::normal_clusters::{self, NormalCluster};
use super::passes::city::gpu_data::Vertex as GpuVertex;
use city3d_scene::{LodMesh, Mesh, Surface, Vertex};
use glam::Vec3;
use rayon::prelude::*;
use std::ops::Range;

/// Bytes of vertices, and of indices, after which a chunk takes no more meshes. Every adapter takes 256 MiB in a buffer;
/// one mesh is far below that by the limits of model files.
const CHUNK_BYTES: usize = 64 << 20;

/// Object or ground cell of the city: the unit of culling and LOD selection.
#[derive(Clone, Debug)]
pub(super) struct ScenePiece {
    pub(super) bounds: [Vec3; 2],
    /// Corners seen from above, each at its greatest height; empty if they are many. See [`TopOutline`].
    pub(super) top_outline: Vec<Vec3>,
    /// Levels of detail, the finest first.
    pub(super) levels: Vec<PieceLod>,
    /// Whether its texture shows recognisable things: windows, doors, letters.
    pub(super) is_figured: bool,
}

/// Level of detail of a piece.
#[derive(Clone, Debug)]
pub(super) struct PieceLod {
    pub(super) error_m: f32,
    /// Chunk that holds its vertices and indices.
    pub(super) chunk: usize,
    pub(super) main: Vec<NormalCluster>,
    /// See [`DrawBucket`].
    pub(super) bucket: Vec<NormalCluster>,
}

impl PieceLod {
    pub(super) fn all(&self) -> impl Iterator<Item = &NormalCluster> {
        self.main.iter().chain(&self.bucket)
    }
}

/// Range of the indices of clusters that follow one another.
pub(super) fn index_range(clusters: &[NormalCluster]) -> Range<u32> {
    match clusters {
        [first, .., last] => first.indices.start..last.indices.end,
        [one] => one.indices.clone(),
        [] => 0..0,
    }
}

/// Vertices of some meshes, and their indices.
#[derive(Clone, Debug, Default)]
pub(super) struct GeometryChunk {
    pub(super) vertices: Vec<GpuVertex>,
    pub(super) indices: Vec<u32>,
}

impl GeometryChunk {
    fn has_room(&self, vertices: usize, indices: usize) -> bool {
        let fits = |held: usize, more: usize, size: usize| held == 0 || (held + more) * size <= CHUNK_BYTES;
        fits(self.vertices.len(), vertices, size_of::<GpuVertex>())
            && fits(self.indices.len(), indices, size_of::<u32>())
    }

    /// Indices of a cluster.
    pub(super) fn of(&self, cluster: &NormalCluster) -> &[u32] {
        &self.indices[cluster.indices.start as usize..cluster.indices.end as usize]
    }
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

/// Packs pieces into chunks.
#[derive(Debug, Default)]
pub(super) struct GeometryPacker {
    pub(super) chunks: Vec<GeometryChunk>,
    bucket: Option<DrawBucket>,
    pieces: u32,
}

impl GeometryPacker {
    /// A packer that keeps the triangles of a bucket apart.
    pub(super) fn new(bucket: Option<DrawBucket>) -> Self {
        Self { bucket, ..Self::default() }
    }

    /// Packs a piece with all its levels of detail.
    pub(super) fn piece(&mut self, levels: &[LodMesh]) -> ScenePiece {
        let packed = PackedPiece::new(levels, self.pieces, self.bucket);
        self.append(packed)
    }

    /// Packs pieces, on all threads, in their order.
    pub(super) fn pieces(&mut self, pieces: &[&[LodMesh]]) -> Vec<ScenePiece> {
        let mut all = Vec::with_capacity(pieces.len());
        // A part at a time: memory holds its vertices twice until they are appended.
        for part in pieces.chunks(PACKED_AT_ONCE) {
            let (first, bucket) = (self.pieces, self.bucket);
            let number = |k: usize| first.wrapping_add(k as u32);
            let pack = |(k, levels): (usize, &&[LodMesh])| PackedPiece::new(levels, number(k), bucket);
            let packed: Vec<PackedPiece> = part.par_iter().enumerate().map(pack).collect();
            all.extend(packed.into_iter().map(|piece| self.append(piece)));
        }
        all
    }

    fn append(&mut self, PackedPiece { mut piece, geometry }: PackedPiece) -> ScenePiece {
        self.pieces = self.pieces.wrapping_add(1);
        for (level, geometry) in piece.levels.iter_mut().zip(geometry) {
            self.append_level(level, geometry);
        }
        piece
    }

    /// Gives a level of geometry of its own its place in a chunk.
    fn append_level(&mut self, level: &mut PieceLod, own: GeometryChunk) {
        let has_room = |chunk: &GeometryChunk| chunk.has_room(own.vertices.len(), own.indices.len());
        if !self.chunks.last().is_some_and(has_room) {
            self.chunks.push(GeometryChunk::default());
        }
        level.chunk = self.chunks.len() - 1;
        let GeometryChunk { vertices, indices } = &mut self.chunks[level.chunk];
        let (base, start) = (vertices.len() as u32, indices.len() as u32);
        vertices.extend(own.vertices);
        indices.extend(own.indices.iter().map(|k| k + base));
        level.main.iter_mut().chain(&mut level.bucket).for_each(|cluster| cluster.move_by(start));
    }
}

/// Pieces that are packed in turn on all threads.
const PACKED_AT_ONCE: usize = 1024;

/// A piece before it has its place in a chunk: each of its levels has geometry of its own.
struct PackedPiece {
    piece: ScenePiece,
    geometry: Vec<GeometryChunk>,
}

impl PackedPiece {
    fn new(levels: &[LodMesh], number: u32, bucket: Option<DrawBucket>) -> Self {
        let mut bounds = [Vec3::INFINITY, Vec3::NEG_INFINITY];
        let mut is_figured = false;
        let mut top_outline = TopOutline::default();
        let (levels, geometry) = levels
            .iter()
            .map(|level| {
                let mut mesh = level.mesh.clone();
                mesh.weld();
                let [low, high] = mesh.bounds();
                bounds = [bounds[0].min(low), bounds[1].max(high)];
                is_figured |= mesh.vertices.iter().any(|v| v.finish.surface.is_figured());
                mesh.vertices.iter().for_each(|v| top_outline.add(v.position));
                packed_level(&mesh, level.error_m, number, bucket)
            })
            .unzip();
        let piece = ScenePiece { bounds, top_outline: top_outline.corners, levels, is_figured };
        Self { piece, geometry }
    }
}

/// A level of detail with geometry of its own.
fn packed_level(
    mesh: &Mesh,
    error_m: f32,
    number: u32,
    bucket: Option<DrawBucket>,
) -> (PieceLod, GeometryChunk) {
    let in_bucket = |triangle: &&[u32]| {
        let corners = [0, 1, 2].map(|k| &mesh.vertices[triangle[k] as usize]);
        bucket.is_some_and(|bucket| bucket.contains(corners))
    };
    let (bucket, main): (Vec<&[u32]>, Vec<&[u32]>) = mesh.indices.chunks_exact(3).partition(in_bucket);
    let at = |k: u32| mesh.vertices[k as usize].position;
    let mut indices = Vec::with_capacity(mesh.indices.len());
    let [main, bucket] = [main, bucket].map(|part| normal_clusters::append(&mut indices, at, &part));
    let vertices = mesh.vertices.iter().map(|v| pack(v, number)).collect();
    (PieceLod { error_m, chunk: 0, main, bucket }, GeometryChunk { vertices, indices })
}

/// A piece with more corners is tested by its bounding box alone.
const MAX_OUTLINE: usize = 24;

/// Distinct positions of vertices seen from above, each at its greatest height; none if there are many.
#[derive(Debug, Default)]
struct TopOutline {
    corners: Vec<Vec3>,
    has_too_many: bool,
}

impl TopOutline {
    fn add(&mut self, at: Vec3) {
        if self.has_too_many {
            return;
        }
        if let Some(top) = self.corners.iter_mut().find(|top| top.truncate() == at.truncate()) {
            top.z = top.z.max(at.z);
        } else if self.corners.len() < MAX_OUTLINE {
            self.corners.push(at);
        } else {
            self.has_too_many = true;
            self.corners.clear();
        }
    }
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

#[cfg(test)]
mod tests {
    use super::*;
    use city3d_scene::{Class, Finish};

    #[test]
    fn chunks_stay_below_the_buffers_of_every_adapter() {
        let finish = Finish::new(Surface::Plain, [200; 3], Class::Building);
        let corner = |k: u32| Vertex {
            position: Vec3::new((k / 3) as f32, (k % 3 % 2) as f32, (k % 3 / 2) as f32),
            normal: Vec3::Z,
            uv: glam::Vec2::ZERO,
            finish,
            openness: 255,
        };
        // A level of 300,000 vertices is 10 MB.
        let mesh = Mesh { vertices: (0..300_000).map(corner).collect(), indices: (0..300_000).collect() };
        let levels = [LodMesh { mesh, error_m: 0.0 }];
        let mut packer = GeometryPacker::new(None);
        let mut pieces = vec![packer.piece(&levels)];
        pieces.extend(packer.pieces(&[&levels[..]; 7]));
        assert_eq!(packer.chunks.len(), 2);
        for chunk in &packer.chunks {
            assert!(chunk.vertices.len() * size_of::<GpuVertex>() <= CHUNK_BYTES);
        }
        for (number, level) in (0..).zip(pieces.iter().flat_map(|piece| &piece.levels)) {
            let chunk = &packer.chunks[level.chunk];
            let indices: usize = level.all().map(|cluster| chunk.of(cluster).len()).sum();
            assert_eq!(indices, 300_000);
            assert_eq!(index_range(&level.main).len(), 300_000);
            let mut corners = level.all().flat_map(|c| chunk.of(c)).map(|&k| chunk.vertices[k as usize]);
            assert!(
                corners.all(|vertex| vertex.material >> 16 == number),
                "not the vertices of piece {number}"
            );
        }
    }
}
