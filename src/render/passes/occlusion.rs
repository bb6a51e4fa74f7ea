//! Ambient occlusion, from the depths of a picture.

use super::common::FrameGroup;
use super::tiles::{self, Tiles};
use super::{Attachments, texture_entry};
use crate::render::shader::Shader;

/// How much of the light from all sides a pixel gets, and its depth.
pub(in crate::render) const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rg32Float;

#[derive(Debug)]
pub(in crate::render) struct OcclusionPass {
    pipeline: wgpu::RenderPipeline,
    layout: wgpu::BindGroupLayout,
}

impl OcclusionPass {
    /// With so many looks around each pixel.
    pub(in crate::render) fn new(
        device: &wgpu::Device,
        attachments: Attachments,
        looks: u32,
        frame: &wgpu::BindGroupLayout,
    ) -> Self {
        let depths = texture_entry(1, wgpu::TextureSampleType::Depth, wgpu::TextureViewDimension::D2);
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("occlusion"),
            entries: &[attachments.sampled(depths)],
        });
        let constants = [("looks", f64::from(looks))];
        let shader = Shader::Occlusion(attachments.reading());
        let pipeline = tiles::pipeline(device, shader, [frame, &layout], &constants, FORMAT);
        Self { pipeline, layout }
    }

    pub(in crate::render) fn bind(
        &self,
        device: &wgpu::Device,
        depths: &wgpu::TextureView,
    ) -> wgpu::BindGroup {
        device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("occlusion"),
            layout: &self.layout,
            entries: &[wgpu::BindGroupEntry {
                binding: 1,
                resource: wgpu::BindingResource::TextureView(depths),
            }],
        })
    }

    pub(in crate::render) fn draw(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        target: &wgpu::TextureView,
        groups: (&FrameGroup, &wgpu::BindGroup),
        tiles: Tiles<'_>,
    ) {
        tiles::draw(encoder, target, &self.pipeline, groups, tiles);
    }
}
