//! Screen-space ambient occlusion (SSAO) from the depth buffer, after McGuire, Mara and Luebke 2012.

use super::common::FrameBindGroup;
use super::tiles::{self, Tiles};
use super::{Attachments, texture_entry};
use crate::shader::Shader;

/// Ambient visibility of a pixel, and its depth for the bilateral blur.
pub(crate) const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rg32Float;

/// Pipeline of the SSAO pass.
#[derive(Debug)]
pub(crate) struct OcclusionPass {
    pipeline: wgpu::RenderPipeline,
    layout: wgpu::BindGroupLayout,
}

impl OcclusionPass {
    /// With `samples` taps per pixel.
    pub(crate) fn new(
        device: &wgpu::Device,
        attachments: Attachments,
        samples: u32,
        frame: &wgpu::BindGroupLayout,
    ) -> Self {
        let depths = texture_entry(1, wgpu::TextureSampleType::Depth, wgpu::TextureViewDimension::D2);
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("occlusion"),
            entries: &[attachments.with_sample_count(depths)],
        });
        let constants = [("ssao_samples", f64::from(samples))];
        let shader = Shader::Occlusion(attachments.sample_count());
        let pipeline = tiles::pipeline(device, shader, [frame, &layout], &constants, FORMAT);
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
