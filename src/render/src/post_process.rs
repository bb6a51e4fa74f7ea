//! Post-processing: screen-space ambient occlusion (SSAO) and reflections (SSR), then the display transform (exposure, tone mapping, sRGB
//! encoding, dither). Vertex lighting needs none.

use super::passes::Attachments;
use super::passes::common::FrameBindGroup;
use super::passes::display::{DisplayPass, MEAN_FORMAT};
use super::passes::occlusion::{self, OcclusionPass};
use super::passes::reflection::{self, ReflectionPass};
use super::passes::tiles::Tiles;
use super::settings::Settings;

/// Pipelines of the post-processing passes.
#[derive(Debug)]
pub(super) struct PostProcess {
    occlusion: Option<OcclusionPass>,
    reflection: Option<ReflectionPass>,
    display: DisplayPass,
    occlusion_format: wgpu::TextureFormat,
    /// Whether several pictures are averaged.
    averages: bool,
}

/// Bindings of the HDR target, the depth buffer and the occlusion texture of an atlas.
#[derive(Debug)]
pub(super) struct HdrTarget {
    /// Target of the occlusion pass; one texel without one.
    occlusion: wgpu::TextureView,
    occlusion_group: Option<wgpu::BindGroup>,
    /// Target of the reflections; one texel without them.
    reflection: wgpu::TextureView,
    reflection_group: Option<wgpu::BindGroup>,
    display_group: wgpu::BindGroup,
    /// Mean of several pictures; one texel without.
    mean: wgpu::TextureView,
    mean_group: Option<wgpu::BindGroup>,
}

impl PostProcess {
    pub(super) fn new(
        device: &wgpu::Device,
        attachments: Attachments,
        settings: &Settings,
        frame: &wgpu::BindGroupLayout,
    ) -> Self {
        let Settings { quality, .. } = *settings;
        let occlusion =
            (quality.ssao_samples > 0).then(|| OcclusionPass::new(device, attachments, quality, frame));
        let steps = settings.reflection_steps();
        let reflection = attachments.reflects.then(|| ReflectionPass::new(device, attachments, steps, frame));
        let mut display = DisplayPass::new(device, attachments, quality);
        display.prepare_pipeline(device, frame, attachments.display_format);
        let averages = quality.jitter_samples > 1;
        if averages {
            display.prepare_mean(device, frame, quality.jitter_samples);
        }
        Self { occlusion, reflection, display, occlusion_format: occlusion::format(quality), averages }
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

    /// Bindings for an atlas of a size with this HDR target, depth buffer and what smooth surfaces reflect: one texel where there
    /// are no reflections.
    pub(super) fn hdr_target(
        &self,
        device: &wgpu::Device,
        size: wgpu::Extent3d,
        [radiances, depths, mirrors]: [&wgpu::TextureView; 3],
    ) -> HdrTarget {
        let target = |label, is_used, format| {
            let texture = device.create_texture(&wgpu::TextureDescriptor {
                label: Some(label),
                size: if is_used { size } else { wgpu::Extent3d::default() },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING,
                view_formats: &[],
            });
            texture.create_view(&wgpu::TextureViewDescriptor::default())
        };
        let occlusion = target("occlusion", self.occlusion.is_some(), self.occlusion_format);
        let reflection = target("reflections", self.reflection.is_some(), reflection::FORMAT);
        let mean = target("mean", self.averages, MEAN_FORMAT);
        let reflected = [radiances, depths, mirrors];
        HdrTarget {
            occlusion_group: self.occlusion.as_ref().map(|pass| pass.bind(device, depths)),
            reflection_group: self.reflection.as_ref().map(|pass| pass.bind(device, reflected)),
            display_group: self.display.bind(device, [radiances, &occlusion, mirrors, &reflection]),
            mean_group: self.display.bind_mean(device, &mean),
            mean,
            occlusion,
            reflection,
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
        self.draw_effects(encoder, (frame, hdr_target), tiles);
        self.display.draw(encoder, target, (frame, &hdr_target.display_group), tiles);
    }

    /// Adds tiles of an atlas to their mean; the first picture replaces what is there.
    pub(super) fn accumulate(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        (frame, hdr_target): (&FrameBindGroup, &HdrTarget),
        tiles: Tiles<'_>,
        is_first: bool,
    ) {
        self.draw_effects(encoder, (frame, hdr_target), tiles);
        let mean = (&hdr_target.mean, is_first);
        self.display.accumulate(encoder, mean, (frame, &hdr_target.display_group), tiles);
    }

    /// Draws the mean of tiles to a target.
    pub(super) fn draw_mean(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        (frame, hdr_target): (&FrameBindGroup, &HdrTarget),
        target: &wgpu::TextureView,
        tiles: Tiles<'_>,
    ) {
        if let Some(group) = &hdr_target.mean_group {
            self.display.draw_mean(encoder, target, (frame, group), tiles);
        }
    }

    /// Draws ambient occlusion and reflections.
    fn draw_effects(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        (frame, hdr_target): (&FrameBindGroup, &HdrTarget),
        tiles: Tiles<'_>,
    ) {
        if let Some((pass, group)) = self.occlusion.as_ref().zip(hdr_target.occlusion_group.as_ref()) {
            pass.draw(encoder, &hdr_target.occlusion, (frame, group), tiles);
        }
        if let Some((pass, group)) = self.reflection.as_ref().zip(hdr_target.reflection_group.as_ref()) {
            pass.draw(encoder, &hdr_target.reflection, (frame, group), tiles);
        }
    }
}
