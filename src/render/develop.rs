//! From radiance to what is shown: ambient occlusion, then the display transform. Where light is worked out at
//! the vertices there is nothing to do.

use super::passes::Attachments;
use super::passes::common::FrameGroup;
use super::passes::display::DisplayPass;
use super::passes::occlusion::{self, OcclusionPass};
use super::passes::tiles::Tiles;
use super::settings::Quality;

#[derive(Debug)]
pub(super) struct Develop {
    occlusion: Option<OcclusionPass>,
    display: DisplayPass,
}

/// What an atlas has for it.
#[derive(Debug)]
pub(super) struct Negative {
    /// Drawn to by the occlusion pass, one texel where there is none.
    occlusion: wgpu::TextureView,
    occlusion_group: Option<wgpu::BindGroup>,
    display_group: wgpu::BindGroup,
}

impl Develop {
    pub(super) fn new(
        device: &wgpu::Device,
        attachments: Attachments,
        quality: Quality,
        frame: &wgpu::BindGroupLayout,
    ) -> Self {
        let looks = quality.occlusion_looks;
        let occlusion = (looks > 0).then(|| OcclusionPass::new(device, attachments, looks, frame));
        let mut display = DisplayPass::new(device, attachments, occlusion.is_some());
        display.prepare(device, frame, attachments.shown);
        Self { occlusion, display }
    }

    /// Sees to targets of another format than that of pictures.
    pub(super) fn prepare(
        &mut self,
        device: &wgpu::Device,
        frame: &wgpu::BindGroupLayout,
        format: wgpu::TextureFormat,
    ) {
        self.display.prepare(device, frame, format);
    }

    /// For an atlas of a size with these radiances and depths.
    pub(super) fn negative(
        &self,
        device: &wgpu::Device,
        size: wgpu::Extent3d,
        [radiances, depths]: [&wgpu::TextureView; 2],
    ) -> Negative {
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
        Negative {
            occlusion_group: self.occlusion.as_ref().map(|pass| pass.bind(device, depths)),
            display_group: self.display.bind(device, radiances, &occlusion),
            occlusion,
        }
    }

    /// Draws some tiles of an atlas to a target of a format that was prepared.
    pub(super) fn draw(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        (frame, negative): (&FrameGroup, &Negative),
        target: (&wgpu::TextureView, wgpu::TextureFormat),
        tiles: Tiles<'_>,
    ) {
        if let Some((pass, group)) = self.occlusion.as_ref().zip(negative.occlusion_group.as_ref()) {
            pass.draw(encoder, &negative.occlusion, (frame, group), tiles);
        }
        self.display.draw(encoder, target, (frame, &negative.display_group), tiles);
    }
}
