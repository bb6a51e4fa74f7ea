//! Where batches of equally large views are drawn: tiles of one texture, so that a batch is one
//! render pass, and the buffers through which they come back.

use super::grid::Grid;
use super::passes::{Attachments, DEPTH};

#[derive(Debug)]
pub(super) struct Atlas {
    pub(super) grid: Grid,
    pub(super) color: wgpu::Texture,
    pub(super) color_view: wgpu::TextureView,
    /// What is drawn to where several samples make a pixel.
    pub(super) samples_view: Option<wgpu::TextureView>,
    pub(super) depth_view: wgpu::TextureView,
}

impl Atlas {
    /// Room for `wanted` views, or for as many as the limits on memory and texture size allow, but
    /// for one at least.
    pub(super) fn new(
        device: &wgpu::Device,
        tile: [u32; 2],
        wanted: usize,
        attachments: Attachments,
        bytes: u64,
    ) -> Self {
        let samples = u64::from(attachments.samples);
        let per_pixel = 4 + 4 * samples + if samples > 1 { 4 * samples } else { 0 };
        let grid = Grid::new(device, tile, wanted, per_pixel, bytes);
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
        let attachment = wgpu::TextureUsages::RENDER_ATTACHMENT;
        let color = texture("pictures", attachments.format, 1, attachment | wgpu::TextureUsages::COPY_SRC);
        let view = |texture: &wgpu::Texture| texture.create_view(&wgpu::TextureViewDescriptor::default());
        let samples_view = (attachments.samples > 1)
            .then(|| view(&texture("samples", attachments.format, attachments.samples, attachment)));
        let depth_view = view(&texture("depth", DEPTH, attachments.samples, attachment));
        Self { grid, color_view: view(&color), color, samples_view, depth_view }
    }
}
