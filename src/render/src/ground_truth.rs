//! Ground truth of camera pictures: depth maps, semantic and instance segmentation, from the same culled lists as the
//! colour pass.

use super::device_renderer::VisibleSet;
use super::fleet::FleetRenderer;
use super::grid::{TileGrid, padded_row};
use super::image::Plane;
use super::passes::DEPTH_BUFFER_FORMAT;
use super::passes::ground_truth::{DEPTH_MAP_FORMAT, GroundTruthPass, LABEL_FORMAT, NO_DEPTH};
use super::passes::palette::{PalettePass, PaletteTarget};
use super::static_scene::StaticScene;
use super::{RenderError, TargetView};
use city3d_protocol::snapshot::{FrameSnapshot, VehicleId};
use std::collections::BTreeMap;

/// Bytes per pixel of the three attachments together.
const PIXEL_BYTES: u64 = 12;

/// Draws depth and labels of views into atlases.
#[derive(Debug)]
pub(super) struct GroundTruthRenderer {
    pub(super) pass: GroundTruthPass,
    atlases: BTreeMap<[u32; 2], GroundTruthAtlas>,
    /// Maps of one view each, for pictures in colours.
    single: BTreeMap<[u32; 2], GroundTruthAtlas>,
    palette: PalettePass,
}

/// Attachments for views of one size.
#[derive(Debug)]
struct GroundTruthAtlas {
    grid: TileGrid,
    depth: wgpu::Texture,
    labels: wgpu::Texture,
    /// Views of `depth`, `labels` and the depth buffer.
    targets: [wgpu::TextureView; 3],
}

/// View to draw.
#[derive(Clone, Copy, Debug)]
pub(super) struct GroundTruthTile {
    /// Index of the view in the submission.
    pub(super) view: usize,
    /// Offset of its depth map in the staging buffer.
    pub(super) depth_at: Option<u64>,
    /// Offset of its labels (class and vehicle) in the staging buffer.
    pub(super) labels_at: Option<u64>,
}

/// Static city and vehicles, with what each view sees of them.
#[derive(Clone, Copy, Debug)]
pub(super) struct VisibleScene<'a> {
    pub(super) static_scene: &'a StaticScene,
    pub(super) fleet: &'a FleetRenderer,
    /// By index of the view in the submission.
    pub(super) visible: &'a [VisibleSet],
}

impl GroundTruthRenderer {
    pub(super) fn new(device: &wgpu::Device) -> Self {
        Self {
            pass: GroundTruthPass::new(device),
            atlases: BTreeMap::new(),
            single: BTreeMap::new(),
            palette: PalettePass::new(device),
        }
    }

    /// Draws a view of a submission in colours to a target.
    pub(super) fn draw_in_colours(
        &mut self,
        device: &wgpu::Device,
        encoder: &mut wgpu::CommandEncoder,
        scene: VisibleScene<'_>,
        (view, target): (usize, &TargetView<'_>),
    ) {
        let new = || GroundTruthAtlas::new(device, target.extent, 1, u64::MAX);
        self.single.entry(target.extent).or_insert_with(new);
        let atlas = &self.single[&target.extent];
        let tile = GroundTruthTile { view, depth_at: None, labels_at: None };
        self.draw_batch(encoder, scene, atlas, &[tile]);
        let [depth_map, labels, _] = &atlas.targets;
        let kind = PaletteTarget { kind: target.kind, format: target.format };
        self.palette.draw(device, encoder, [depth_map, labels], (target.color, kind));
    }

    /// Frees the maps of pictures that are of none of these extents.
    pub(super) fn keep_extents(&mut self, is_kept: impl Fn([u32; 2]) -> bool) {
        self.single.retain(|extent, _| is_kept(*extent));
    }

    /// Draws views of one extent, at most `views_per_pass` in one render pass, and copies the requested planes into the
    /// staging `buffer`. An atlas takes at most `bytes`.
    pub(super) fn draw(
        &mut self,
        device: &wgpu::Device,
        encoder: &mut wgpu::CommandEncoder,
        scene: VisibleScene<'_>,
        (extent, tiles): ([u32; 2], &[GroundTruthTile]),
        (buffer, bytes, views_per_pass): (&wgpu::Buffer, u64, usize),
    ) {
        if tiles.is_empty() {
            return;
        }
        let wanted = tiles.len().min(views_per_pass);
        if !self.atlases.get(&extent).is_some_and(|atlas| atlas.grid.fits(wanted)) {
            self.atlases.insert(extent, GroundTruthAtlas::new(device, extent, wanted, bytes));
        }
        let atlas = &self.atlases[&extent];
        for batch in tiles.chunks(atlas.grid.capacity) {
            self.draw_batch(encoder, scene, atlas, batch);
            for (k, tile) in batch.iter().enumerate() {
                if let Some(at) = tile.depth_at {
                    atlas.grid.copy_tile(encoder, (&atlas.depth, k), (buffer, at));
                }
                if let Some(at) = tile.labels_at {
                    atlas.grid.copy_tile(encoder, (&atlas.labels, k), (buffer, at));
                }
            }
        }
    }

    fn draw_batch(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        scene: VisibleScene<'_>,
        atlas: &GroundTruthAtlas,
        batch: &[GroundTruthTile],
    ) {
        let attachment = |target, value| {
            Some(wgpu::RenderPassColorAttachment {
                view: target,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Clear(wgpu::Color { r: value, g: 0.0, b: 0.0, a: 0.0 }),
                    store: wgpu::StoreOp::Store,
                },
            })
        };
        let [depth, labels, test] = &atlas.targets;
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("ground truth"),
            // Class 0 is the sky.
            color_attachments: &[attachment(depth, NO_DEPTH), attachment(labels, 0.0)],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: test,
                depth_ops: Some(wgpu::Operations {
                    load: wgpu::LoadOp::Clear(0.0),
                    store: wgpu::StoreOp::Discard,
                }),
                stencil_ops: None,
            }),
            ..Default::default()
        });
        for (k, tile) in batch.iter().enumerate() {
            let target = (atlas.grid.tile_rect(k), tile.view);
            let visible = &scene.visible[tile.view];
            self.pass.draw(&mut pass, target, (scene.static_scene, scene.fleet), visible);
        }
    }
}

impl GroundTruthAtlas {
    fn new(device: &wgpu::Device, extent: [u32; 2], wanted: usize, bytes: u64) -> Self {
        let grid = TileGrid::new(device, extent, wanted, PIXEL_BYTES, bytes);
        let texture = |label, format, usage| {
            device.create_texture(&wgpu::TextureDescriptor {
                label: Some(label),
                size: grid.size(),
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage,
                view_formats: &[],
            })
        };
        let attachment = wgpu::TextureUsages::RENDER_ATTACHMENT;
        let read = attachment | wgpu::TextureUsages::COPY_SRC | wgpu::TextureUsages::TEXTURE_BINDING;
        let depth = texture("depth map", DEPTH_MAP_FORMAT, read);
        let labels = texture("labels", LABEL_FORMAT, read);
        let test = texture("depth buffer of ground truth", DEPTH_BUFFER_FORMAT, attachment);
        let targets =
            [&depth, &labels, &test].map(|t| t.create_view(&wgpu::TextureViewDescriptor::default()));
        Self { grid, depth, labels, targets }
    }
}

/// Checks that a 16-bit pixel can hold the number of each vehicle; 0 stands for no vehicle.
///
/// # Errors
/// [`RenderError::Number`] for the first number outside 1 to 65535.
pub(super) fn check_instance_ids(snapshot: &FrameSnapshot) -> Result<(), RenderError> {
    let fits_pixel = |id: VehicleId| (1..=u32::from(u16::MAX)).contains(&id.0);
    match snapshot.vehicles.iter().find(|state| !fits_pixel(state.id)) {
        Some(state) => Err(RenderError::Number { vehicle: state.id }),
        None => Ok(()),
    }
}

/// Depth map in metres from padded rows; infinite where nothing is seen.
pub(super) fn depths(bytes: &[u8], extent: [u32; 2]) -> Plane<f32> {
    plane(bytes, extent, |[a, b, c, d]| {
        let depth_m = f32::from_le_bytes([a, b, c, d]);
        if f64::from(depth_m) > NO_DEPTH { depth_m } else { f32::INFINITY }
    })
}

/// Semantic classes from padded rows.
pub(super) fn classes(bytes: &[u8], extent: [u32; 2]) -> Plane<u8> {
    plane(bytes, extent, |[class, ..]| class)
}

/// Vehicle numbers (instances) from padded rows.
pub(super) fn vehicles(bytes: &[u8], extent: [u32; 2]) -> Plane<u16> {
    plane(bytes, extent, |[_, _, low, high]| u16::from_le_bytes([low, high]))
}

fn plane<T>(bytes: &[u8], [width, height]: [u32; 2], value: impl Fn([u8; 4]) -> T) -> Plane<T> {
    let rows = bytes.chunks(padded_row(width) as usize).take(height as usize);
    let values = rows.flat_map(|row| &row.as_chunks::<4>().0[..width as usize]).map(|&texel| value(texel));
    Plane { width, height, values: values.collect() }
}
