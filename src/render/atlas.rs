//! Where batches of equally large views are drawn: tiles of one texture, so that a batch is one
//! render pass, and the buffers through which they come back.

use super::develop::{Develop, Negative};
use super::grid::Grid;
use super::passes::{Attachments, DEPTH};

#[derive(Debug)]
pub(super) struct Atlas {
    pub(super) grid: Grid,
    pub(super) color: wgpu::Texture,
    pub(super) color_view: wgpu::TextureView,
    /// What is drawn to where that is not what is shown: radiance, or several samples of a pixel.
    pub(super) samples_view: Option<wgpu::TextureView>,
    pub(super) depth_view: wgpu::TextureView,
    /// Where radiance is developed.
    pub(super) negative: Option<Negative>,
}

impl Atlas {
    /// Room for `wanted` views, or for as many as the limits on memory and texture size allow, but
    /// for one at least.
    pub(super) fn new(
        device: &wgpu::Device,
        (tile, wanted): ([u32; 2], usize),
        attachments: Attachments,
        develop: Option<&Develop>,
        bytes: u64,
    ) -> Self {
        let has_samples = develop.is_some() || attachments.samples > 1;
        let grid = Grid::new(device, tile, wanted, pixel_bytes(attachments, develop.is_some()), bytes);
        let texture = |label, format, sample_count, usage| {
            device.create_texture(&wgpu::TextureDescriptor {
                label: Some(label),
                size: grid.size(),
                mip_level_count: 1,
                sample_count,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage,
                view_formats: &[],
            })
        };
        let view = |texture: &wgpu::Texture| texture.create_view(&wgpu::TextureViewDescriptor::default());
        let attachment = wgpu::TextureUsages::RENDER_ATTACHMENT;
        let drawn =
            if develop.is_some() { attachment | wgpu::TextureUsages::TEXTURE_BINDING } else { attachment };
        let color = texture("pictures", attachments.shown, 1, attachment | wgpu::TextureUsages::COPY_SRC);
        let samples_view =
            has_samples.then(|| view(&texture("samples", attachments.format, attachments.samples, drawn)));
        let depth_view = view(&texture("depth", DEPTH, attachments.samples, drawn));
        let negative = develop
            .zip(samples_view.as_ref())
            .map(|(develop, samples)| develop.negative(device, grid.size(), [samples, &depth_view]));
        Self { grid, color_view: view(&color), color, samples_view, depth_view, negative }
    }
}

/// What a pixel takes of all textures of an atlas.
fn pixel_bytes(attachments: Attachments, developed: bool) -> u64 {
    let samples = u64::from(attachments.samples);
    let (shown, depth) = (4, 4 * samples);
    let (radiance, occlusion) = (8 * samples, 8);
    match (developed, samples) {
        (true, _) => shown + depth + radiance + occlusion,
        (false, 1) => shown + depth,
        (false, _) => shown + depth + 4 * samples,
    }
}
