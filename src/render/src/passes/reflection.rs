//! Screen-space reflections (SSR): rays through the depth buffer, after McGuire and Mara 2014.

use super::common::FrameBindGroup;
use super::tiles::{self, Tiles};
use super::{Attachments, texture_entry};
use crate::shader::Shader;

/// What is added to the radiance of a pixel, and its reflectance.
pub(crate) const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Float;

/// Pipeline of the reflections.
#[derive(Debug)]
pub(crate) struct ReflectionPass {
    pipeline: wgpu::RenderPipeline,
    layout: wgpu::BindGroupLayout,
}

impl ReflectionPass {
    /// With `steps` per ray.
    pub(crate) fn new(
        device: &wgpu::Device,
        attachments: Attachments,
        steps: u32,
        frame: &wgpu::BindGroupLayout,
    ) -> Self {
        let unfiltered = wgpu::TextureSampleType::Float { filterable: false };
        let texture = |binding, kind| {
            attachments.with_sample_count(texture_entry(binding, kind, wgpu::TextureViewDimension::D2))
        };
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("reflection"),
            entries: &[
                texture(0, unfiltered),
                texture(1, wgpu::TextureSampleType::Depth),
                texture(3, unfiltered),
            ],
        });
        let constants = [("reflection_steps", f64::from(steps))];
        let shader = Shader::Reflection(attachments.sample_count());
        let pipeline = tiles::pipeline(device, shader, [frame, &layout], &constants, FORMAT);
        Self { pipeline, layout }
    }

    /// Bindings of the HDR target, the depth buffer and what smooth surfaces reflect.
    pub(crate) fn bind(
        &self,
        device: &wgpu::Device,
        [radiances, depths, mirrors]: [&wgpu::TextureView; 3],
    ) -> wgpu::BindGroup {
        let entry = |binding, view| wgpu::BindGroupEntry {
            binding,
            resource: wgpu::BindingResource::TextureView(view),
        };
        device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("reflection"),
            layout: &self.layout,
            entries: &[entry(0, radiances), entry(1, depths), entry(3, mirrors)],
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
