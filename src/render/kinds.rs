//! Pictures of depth, class and vehicle: of the same instant and from the same lists as the colours.

use super::RenderError;
use super::fleet::Fleet;
use super::grid::{Grid, padded_row};
use super::image::Plane;
use super::passes::DEPTH;
use super::passes::kinds::{DEPTH_FORMAT, KindsPass, MEANING_FORMAT, NOTHING};
use super::stage::Seen;
use super::standing::Standing;
use crate::snapshot::{FrameSnapshot, VehicleId};
use std::collections::BTreeMap;

/// Bytes of a pixel in the three targets together.
const PIXEL_BYTES: u64 = 12;

/// Draws the kinds other than colour.
#[derive(Debug)]
pub(super) struct KindsDrawing {
    pub(super) pass: KindsPass,
    atlases: BTreeMap<[u32; 2], KindsAtlas>,
}

/// Where views of one extent are drawn.
#[derive(Debug)]
struct KindsAtlas {
    grid: Grid,
    depth: wgpu::Texture,
    meaning: wgpu::Texture,
    /// Of `depth`, of `meaning` and for the depth test.
    targets: [wgpu::TextureView; 3],
}

/// One view to draw.
#[derive(Clone, Copy, Debug)]
pub(super) struct KindsTile {
    /// Its place in the submission.
    pub(super) view: usize,
    /// Where its depths go to in the read-back buffer.
    pub(super) depth_at: Option<u64>,
    /// Where its classes and vehicles go to.
    pub(super) meaning_at: Option<u64>,
}

/// What is drawn.
#[derive(Clone, Copy, Debug)]
pub(super) struct Scene<'a> {
    pub(super) standing: &'a Standing,
    pub(super) fleet: &'a Fleet,
    /// By view of the submission.
    pub(super) seen: &'a [Seen],
}

impl KindsDrawing {
    pub(super) fn new(device: &wgpu::Device) -> Self {
        Self { pass: KindsPass::new(device), atlases: BTreeMap::new() }
    }

    /// Draws views of one extent, so many at once at most, and copies what was asked for into `buffer`; an atlas may
    /// take so many `bytes`.
    pub(super) fn draw(
        &mut self,
        device: &wgpu::Device,
        encoder: &mut wgpu::CommandEncoder,
        scene: Scene<'_>,
        (extent, tiles): ([u32; 2], &[KindsTile]),
        (buffer, bytes, at_once): (&wgpu::Buffer, u64, usize),
    ) {
        if tiles.is_empty() {
            return;
        }
        let wanted = tiles.len().min(at_once);
        if !self.atlases.get(&extent).is_some_and(|atlas| atlas.grid.suits(wanted)) {
            self.atlases.insert(extent, KindsAtlas::new(device, extent, wanted, bytes));
        }
        let atlas = &self.atlases[&extent];
        for batch in tiles.chunks(atlas.grid.capacity) {
            self.draw_batch(encoder, scene, atlas, batch);
            for (k, tile) in batch.iter().enumerate() {
                if let Some(at) = tile.depth_at {
                    atlas.grid.copy_tile(encoder, (&atlas.depth, k), (buffer, at));
                }
                if let Some(at) = tile.meaning_at {
                    atlas.grid.copy_tile(encoder, (&atlas.meaning, k), (buffer, at));
                }
            }
        }
    }

    fn draw_batch(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        scene: Scene<'_>,
        atlas: &KindsAtlas,
        batch: &[KindsTile],
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
        let [depth, meaning, test] = &atlas.targets;
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("kinds"),
            // The class of the sky is 0.
            color_attachments: &[attachment(depth, NOTHING), attachment(meaning, 0.0)],
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
            let target = (atlas.grid.place(k), tile.view);
            let seen = &scene.seen[tile.view];
            self.pass.draw(&mut pass, target, (scene.standing, scene.fleet), seen);
        }
    }
}

impl KindsAtlas {
    fn new(device: &wgpu::Device, extent: [u32; 2], wanted: usize, bytes: u64) -> Self {
        let grid = Grid::new(device, extent, wanted, PIXEL_BYTES, bytes);
        let texture = |label, format, usage| {
            device.create_texture(&wgpu::TextureDescriptor {
                label: Some(label),
                size: grid.size(),
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage: usage | wgpu::TextureUsages::RENDER_ATTACHMENT,
                view_formats: &[],
            })
        };
        let depth = texture("depths", DEPTH_FORMAT, wgpu::TextureUsages::COPY_SRC);
        let meaning = texture("meanings", MEANING_FORMAT, wgpu::TextureUsages::COPY_SRC);
        let test = texture("depth test of kinds", DEPTH, wgpu::TextureUsages::empty());
        let targets =
            [&depth, &meaning, &test].map(|t| t.create_view(&wgpu::TextureViewDescriptor::default()));
        Self { grid, depth, meaning, targets }
    }
}

/// Whether a pixel can hold the number of each vehicle, and none is that of no vehicle.
///
/// # Errors
/// [`RenderError::Number`] for one that cannot be told.
pub(super) fn check_numbers(snapshot: &FrameSnapshot) -> Result<(), RenderError> {
    let is_told = |id: VehicleId| (1..=u32::from(u16::MAX)).contains(&id.0);
    match snapshot.vehicles.iter().find(|state| !is_told(state.id)) {
        Some(state) => Err(RenderError::Number { vehicle: state.id }),
        None => Ok(()),
    }
}

/// Metres out of padded rows; infinite where nothing is seen.
pub(super) fn depths(bytes: &[u8], extent: [u32; 2]) -> Plane<f32> {
    plane(bytes, extent, |[a, b, c, d]| {
        let depth_m = f32::from_le_bytes([a, b, c, d]);
        if f64::from(depth_m) > NOTHING { depth_m } else { f32::INFINITY }
    })
}

/// Classes out of padded rows.
pub(super) fn classes(bytes: &[u8], extent: [u32; 2]) -> Plane<u8> {
    plane(bytes, extent, |[class, ..]| class)
}

/// Vehicles out of padded rows.
pub(super) fn vehicles(bytes: &[u8], extent: [u32; 2]) -> Plane<u16> {
    plane(bytes, extent, |[_, _, low, high]| u16::from_le_bytes([low, high]))
}

fn plane<T>(bytes: &[u8], [width, height]: [u32; 2], value: impl Fn([u8; 4]) -> T) -> Plane<T> {
    let rows = bytes.chunks(padded_row(width) as usize).take(height as usize);
    let values = rows.flat_map(|row| &row.as_chunks::<4>().0[..width as usize]).map(|&texel| value(texel));
    Plane { width, height, values: values.collect() }
}
