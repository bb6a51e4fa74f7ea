//! Instanced drawing of the map's models: each model is in the buffers once, with a transform for each of its places.

use super::context::filled_buffer;
use super::geometry::{DrawBucket, GeometryChunk, GeometryPacker, ScenePiece, index_range};
use super::passes::city::gpu_data::Placement;
use super::static_scene::{CullContext, casts_on_city};
use city3d_scene::{InstancedObject, SceneDescription};
use glam::{Affine3A, Vec3};
use std::ops::Range;
use std::sync::Arc;

/// Models and their places on the CPU; all devices share them.
#[derive(Debug)]
pub(super) struct PreparedInstances {
    chunks: Vec<GeometryChunk>,
    models: Vec<ScenePiece>,
    places: Vec<Place>,
    placements: Vec<Placement>,
}

/// A place of a model.
#[derive(Debug)]
struct Place {
    /// Index of the model.
    model: usize,
    bounds: [Vec3; 2],
    scale: f32,
    casts_on_city: bool,
}

/// Place that passed the culling tests of a view, at its selected level of detail.
#[derive(Clone, Copy, Debug)]
pub(super) struct VisibleInstance {
    /// Index of the place.
    place: usize,
    level: usize,
    distance_m: f32,
    /// Whether its texture is too fine to be seen.
    is_untextured: bool,
}

/// Pipelines that draw the triangles of instances.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum InstancePart {
    /// Everything.
    All,
    /// What shows its texture, apart from the [`DrawBucket`].
    Textured,
    /// The [`DrawBucket`] of what shows its texture.
    Bucket,
    /// What is too far away to show its texture.
    Untextured,
}

/// Buffers of the models on one device.
#[derive(Debug)]
pub(super) struct InstancedScene {
    prepared: Arc<PreparedInstances>,
    /// Vertices and indices of each chunk.
    chunks: Vec<(wgpu::Buffer, wgpu::Buffer)>,
    placements: wgpu::Buffer,
}

impl PreparedInstances {
    pub(super) fn new(scene: &SceneDescription, bucket: Option<DrawBucket>) -> Self {
        // Faces away from the sun are told apart in the city, not in the frame of a model.
        let bucket = bucket.filter(|bucket| matches!(bucket, DrawBucket::AlphaToCoverage));
        let mut packer = GeometryPacker::new(bucket);
        let (mut models, mut places, mut placements) = (Vec::new(), Vec::new(), Vec::new());
        for InstancedObject { object, instances } in &scene.instanced {
            let model = models.len();
            let piece = packer.piece(&object.levels);
            for city_from_object in instances {
                let bounds = city3d_scene::moved_box(piece.bounds, city_from_object);
                places.push(Place {
                    model,
                    bounds,
                    scale: city_from_object.matrix3.x_axis.length(),
                    casts_on_city: casts_on_city(scene, bounds),
                });
                // Objects have the numbers before.
                let seed = (scene.objects.len() + placements.len()) as u32 & 0xff;
                placements.push(Placement { rows: rows(city_from_object), seed });
            }
            models.push(piece);
        }
        Self { chunks: packer.chunks, models, places, placements }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.places.is_empty()
    }

    /// Range of the indices of a level of detail that a pipeline draws, and their chunk.
    fn indices(&self, model: usize, level: usize, part: InstancePart) -> Option<(usize, Range<u32>)> {
        let level = self.models[model].levels.get(level)?;
        let (main, bucket) = (index_range(&level.main), index_range(&level.bucket));
        let indices = match part {
            InstancePart::Textured => main,
            InstancePart::Bucket => bucket,
            InstancePart::All | InstancePart::Untextured if bucket.is_empty() => main,
            InstancePart::All | InstancePart::Untextured if main.is_empty() => bucket,
            // The bucket follows the others.
            InstancePart::All | InstancePart::Untextured => main.start..bucket.end,
        };
        (!indices.is_empty()).then_some((level.chunk, indices))
    }
}

impl VisibleInstance {
    fn is_in(&self, part: InstancePart) -> bool {
        match part {
            InstancePart::All => true,
            InstancePart::Textured | InstancePart::Bucket => !self.is_untextured,
            InstancePart::Untextured => self.is_untextured,
        }
    }
}

impl InstancedScene {
    pub(super) fn new(device: &wgpu::Device, prepared: &Arc<PreparedInstances>) -> Self {
        let buffer = |contents: &[u8], usage| filled_buffer(device, "models of the map", contents, usage);
        let chunk = |chunk: &GeometryChunk| {
            (
                buffer(bytemuck::cast_slice(&chunk.vertices), wgpu::BufferUsages::VERTEX),
                buffer(bytemuck::cast_slice(&chunk.indices), wgpu::BufferUsages::INDEX),
            )
        };
        Self {
            chunks: prepared.chunks.iter().map(chunk).collect(),
            placements: buffer(bytemuck::cast_slice(&prepared.placements), wgpu::BufferUsages::VERTEX),
            prepared: Arc::clone(prepared),
        }
    }

    /// Places that pass all culling tests, front to back.
    pub(super) fn visible(&self, cull: &CullContext<'_>) -> Vec<VisibleInstance> {
        let test = |(index, place): (usize, &Place)| {
            let distance_m = cull.visible_distance_m(place.bounds)?;
            let model = &self.prepared.models[place.model];
            Some(VisibleInstance {
                place: index,
                level: cull.lod(&model.levels, place.scale, distance_m),
                distance_m,
                is_untextured: cull.is_untextured(model, distance_m),
            })
        };
        let mut visible: Vec<VisibleInstance> =
            self.prepared.places.iter().enumerate().filter_map(test).collect();
        visible.sort_by(|a, b| a.distance_m.total_cmp(&b.distance_m));
        visible
    }

    /// Triangles of visible instances.
    pub(super) fn triangles(&self, visible: &[VisibleInstance]) -> u64 {
        let indices = |instance: &VisibleInstance| {
            let model = self.prepared.places[instance.place].model;
            let (_, indices) = self.prepared.indices(model, instance.level, InstancePart::All)?;
            Some(indices.len() as u64)
        };
        visible.iter().filter_map(indices).sum::<u64>() / 3
    }

    /// Draws those visible instances that belong to a pipeline, which the caller has set with its bind groups.
    pub(super) fn draw(
        &self,
        pass: &mut wgpu::RenderPass<'_>,
        visible: &[VisibleInstance],
        part: InstancePart,
    ) {
        let wanted = visible.iter().filter(|instance| instance.is_in(part));
        self.draw_places(pass, wanted.map(|instance| (instance.place, instance.level)), part);
    }

    /// Draws shadow casters, at a coarser level where its error is below a texel of the shadow map. The caller has set
    /// bind groups and pipeline.
    pub(super) fn draw_shadows(&self, pass: &mut wgpu::RenderPass<'_>, texel_m: f32) {
        let PreparedInstances { places, models, .. } = &*self.prepared;
        let casters = places.iter().enumerate().filter(|(_, place)| place.casts_on_city);
        let with_level = casters.map(|(index, place)| {
            let levels = &models[place.model].levels;
            let level = levels.iter().rposition(|level| level.error_m * place.scale < texel_m);
            (index, level.unwrap_or(0))
        });
        self.draw_places(pass, with_level, InstancePart::All);
    }

    /// Draws a level of detail of each of some places.
    fn draw_places(
        &self,
        pass: &mut wgpu::RenderPass<'_>,
        places: impl Iterator<Item = (usize, usize)>,
        part: InstancePart,
    ) {
        let mut bound = None;
        for (place, level) in places {
            let model = self.prepared.places[place].model;
            let Some((chunk, indices)) = self.prepared.indices(model, level, part) else { continue };
            if bound.is_none() {
                pass.set_vertex_buffer(1, self.placements.slice(..));
            }
            if bound != Some(chunk) {
                let (vertices, indices) = &self.chunks[chunk];
                pass.set_vertex_buffer(0, vertices.slice(..));
                pass.set_index_buffer(indices.slice(..), wgpu::IndexFormat::Uint32);
                bound = Some(chunk);
            }
            let instance = place as u32;
            pass.draw_indexed(indices, 0, instance..instance + 1);
        }
    }
}

fn rows(city_from_object: &Affine3A) -> [[f32; 4]; 3] {
    let (turn, at) = (city_from_object.matrix3, city_from_object.translation);
    [0, 1, 2].map(|k| turn.row(k).extend(at[k]).to_array())
}
