//! Screen-space ambient occlusion (SSAO) from the depth buffer, after McGuire, Mara and Luebke 2012, and contact shadows.

use super::common::FrameBindGroup;
use super::tiles::{self, Tiles};
use super::{Attachments, texture_entry};
use crate::settings::Quality;
use crate::shader::Shader;

/// Ambient visibility of a pixel, its depth for the bilateral blur, and with contact shadows the share of the sun.
pub(crate) fn format(quality: Quality) -> wgpu::TextureFormat {
    if quality.contact_steps > 0 { wgpu::TextureFormat::Rgba32Float } else { wgpu::TextureFormat::Rg32Float }
}

/// Pipeline of the SSAO pass.
#[derive(Debug)]
pub(crate) struct OcclusionPass {
    pipeline: wgpu::RenderPipeline,
    layout: wgpu::BindGroupLayout,
}

impl OcclusionPass {
    /// With the taps and steps of a quality.
    pub(crate) fn new(
        device: &wgpu::Device,
        attachments: Attachments,
        quality: Quality,
        frame: &wgpu::BindGroupLayout,
    ) -> Self {
        let depths = texture_entry(1, wgpu::TextureSampleType::Depth, wgpu::TextureViewDimension::D2);
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("occlusion"),
            entries: &[attachments.with_sample_count(depths)],
        });
        let constants = [
            ("ssao_samples", f64::from(quality.ssao_samples)),
            ("contact_steps", f64::from(quality.contact_steps)),
        ];
        let shader = Shader::Occlusion(attachments.sample_count());
        let pipeline = tiles::pipeline(device, shader, [frame, &layout], &constants, format(quality));
        Self { pipeline, layout }
    }

    pub(crate) fn bind(&self, device: &wgpu::Device, depths: &wgpu::TextureView) -> wgpu::BindGroup {
        device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("occlusion"),
            layout: &self.layout,
            entries: &[wgpu::BindGroupEntry {
                binding: 1,
                resource: wgpu::BindingResource::TextureView(depths),
            }],
        })
    }

    pub(crate) fn draw(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        target: &wgpu::TextureView,
        groups: (&FrameBindGroup, &wgpu::BindGroup),
        tiles: Tiles<'_>,
    ) {
        tiles::draw(encoder, target, &self.pipeline, groups, tiles);
    }
}
