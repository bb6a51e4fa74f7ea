//! Render-target atlas: views of one size are tiles of shared colour, HDR, MSAA and depth attachments, so that a batch
//! is one render pass.

use super::grid::TileGrid;
use super::passes::{Attachments, DEPTH_BUFFER_FORMAT, HDR_FORMAT};
use super::post_process::{HdrTarget, PostProcess};

/// Attachments for views of one size.
#[derive(Debug)]
pub(super) struct Atlas {
    pub(super) grid: TileGrid,
    pub(super) color: wgpu::Texture,
    pub(super) color_view: wgpu::TextureView,
    /// HDR or multisampled (MSAA) attachment, where passes do not draw to `color` directly.
    pub(super) samples_view: Option<wgpu::TextureView>,
    /// What smooth surfaces reflect, see [`Attachments::reflects`].
    pub(super) mirrors_view: Option<wgpu::TextureView>,
    pub(super) depth_view: wgpu::TextureView,
    /// Whether later passes read the depth buffer.
    pub(super) keeps_depth: bool,
    /// Bindings for post-processing, where the samples are radiance.
    pub(super) hdr_target: Option<HdrTarget>,
}

impl Atlas {
    /// Atlas for `wanted` views, or for as many as `bytes` of memory and the largest texture size allow; at least one.
    pub(super) fn new(
        device: &wgpu::Device,
        (tile, wanted): ([u32; 2], usize),
        attachments: Attachments,
        post_process: Option<&PostProcess>,
        bytes: u64,
    ) -> Self {
        let has_samples = post_process.is_some() || attachments.samples > 1;
        let grid =
            TileGrid::new(device, tile, wanted, pixel_bytes(attachments, post_process.is_some()), bytes);
        let sized = |label, size, format, sample_count, usage| {
            device.create_texture(&wgpu::TextureDescriptor {
                label: Some(label),
                size,
                mip_level_count: 1,
                sample_count,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage,
                view_formats: &[],
            })
        };
        let texture =
            |label, format, sample_count, usage| sized(label, grid.size(), format, sample_count, usage);
        let view = |texture: &wgpu::Texture| texture.create_view(&wgpu::TextureViewDescriptor::default());
        let attachment = wgpu::TextureUsages::RENDER_ATTACHMENT;
        let drawn = if post_process.is_some() {
            attachment | wgpu::TextureUsages::TEXTURE_BINDING
        } else {
            attachment
        };
        let color =
            texture("pictures", attachments.display_format, 1, attachment | wgpu::TextureUsages::COPY_SRC);
        let samples_view =
            has_samples.then(|| view(&texture("samples", attachments.format, attachments.samples, drawn)));
        let read = attachment | wgpu::TextureUsages::TEXTURE_BINDING;
        let depth_view = view(&texture("depth", DEPTH_BUFFER_FORMAT, attachments.samples, read));
        let hdr_target = post_process.zip(samples_view.as_ref()).map(|(post_process, samples)| {
            let size = if attachments.reflects { grid.size() } else { wgpu::Extent3d::default() };
            let mirrors = view(&sized("mirrors", size, HDR_FORMAT, attachments.samples, drawn));
            let target = post_process.hdr_target(device, grid.size(), [samples, &depth_view, &mirrors]);
            (target, mirrors)
        });
        let (hdr_target, mirrors_view) = hdr_target.unzip();
        let mirrors_view = mirrors_view.filter(|_| attachments.reflects);
        let (color_view, keeps_depth) = (view(&color), post_process.is_some());
        Self { grid, color_view, color, samples_view, mirrors_view, depth_view, keeps_depth, hdr_target }
    }
}

/// Bytes per pixel of all attachments together.
fn pixel_bytes(attachments: Attachments, developed: bool) -> u64 {
    let samples = u64::from(attachments.samples);
    let (shown, depth) = (4, 4 * samples);
    let (radiance, occlusion) = (8 * samples, 8);
    // The finest preset has reflections, contact shadows in a wider occlusion map, and the mean of several pictures.
    let reflection = if attachments.reflects { 8 * samples + 24 } else { 0 };
    match (developed, samples) {
        (true, _) => shown + depth + radiance + occlusion + reflection,
        (false, 1) => shown + depth,
        (false, _) => shown + depth + 4 * samples,
    }
}
