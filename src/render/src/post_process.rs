//! Post-processing: screen-space ambient occlusion (SSAO), then the display transform (exposure, tone mapping, sRGB
//! encoding, dither). Vertex lighting needs none.

use super::passes::Attachments;
use super::passes::common::FrameBindGroup;
use super::passes::display::DisplayPass;
use super::passes::occlusion::{self, OcclusionPass};
use super::passes::tiles::Tiles;
use super::settings::Quality;

/// Pipelines of the post-processing passes.
#[derive(Debug)]
pub(super) struct PostProcess {
    occlusion: Option<OcclusionPass>,
    display: DisplayPass,
}

/// Bindings of the HDR target, the depth buffer and the occlusion texture of an atlas.
#[derive(Debug)]
pub(super) struct HdrTarget {
    /// Target of the occlusion pass; one texel without one.
    occlusion: wgpu::TextureView,
    occlusion_group: Option<wgpu::BindGroup>,
    display_group: wgpu::BindGroup,
}

impl PostProcess {
    pub(super) fn new(
        device: &wgpu::Device,
        attachments: Attachments,
        quality: Quality,
        frame: &wgpu::BindGroupLayout,
    ) -> Self {
        let samples = quality.ssao_samples;
        let occlusion = (samples > 0).then(|| OcclusionPass::new(device, attachments, samples, frame));
        let mut display = DisplayPass::new(device, attachments, occlusion.is_some());
        display.prepare_pipeline(device, frame, attachments.display_format);
        Self { occlusion, display }
    }

    /// Makes the pipeline for targets of a pixel format, if it is missing.
    pub(super) fn prepare_pipeline(
        &mut self,
        device: &wgpu::Device,
        frame: &wgpu::BindGroupLayout,
        format: wgpu::TextureFormat,
    ) {
        self.display.prepare_pipeline(device, frame, format);
    }

    /// Bindings for an atlas of a size with this HDR target and depth buffer.
    pub(super) fn hdr_target(
        &self,
        device: &wgpu::Device,
        size: wgpu::Extent3d,
        [radiances, depths]: [&wgpu::TextureView; 2],
    ) -> HdrTarget {
        let size = if self.occlusion.is_some() { size } else { wgpu::Extent3d::default() };
        let texture = device.create_texture(&wgpu::TextureDescriptor {
            label: Some("occlusion"),
            size,
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: occlusion::FORMAT,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING,
            view_formats: &[],
        });
        let occlusion = texture.create_view(&wgpu::TextureViewDescriptor::default());
        HdrTarget {
            occlusion_group: self.occlusion.as_ref().map(|pass| pass.bind(device, depths)),
            display_group: self.display.bind(device, radiances, &occlusion),
            occlusion,
        }
    }

    /// Draws tiles of an atlas to a target. [`Self::prepare_pipeline`] has seen its format.
    pub(super) fn draw(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        (frame, hdr_target): (&FrameBindGroup, &HdrTarget),
        target: (&wgpu::TextureView, wgpu::TextureFormat),
        tiles: Tiles<'_>,
    ) {
        if let Some((pass, group)) = self.occlusion.as_ref().zip(hdr_target.occlusion_group.as_ref()) {
            pass.draw(encoder, &hdr_target.occlusion, (frame, group), tiles);
        }
        self.display.draw(encoder, target, (frame, &hdr_target.display_group), tiles);
    }
}
