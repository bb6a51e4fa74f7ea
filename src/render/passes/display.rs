//! The display transform: radiance of samples to the colours of pixels.

use super::common::FrameGroup;
use super::tiles::{self, Tiles};
use super::{Attachments, texture_entry};
use crate::render::shader::Shader;

#[derive(Debug)]
pub(in crate::render) struct DisplayPass {
    attachments: Attachments,
    occluded: bool,
    layout: wgpu::BindGroupLayout,
    pipelines: Vec<(wgpu::TextureFormat, wgpu::RenderPipeline)>,
}

impl DisplayPass {
    /// Where nothing is `occluded`, what is bound for it is not looked at.
    pub(in crate::render) fn new(device: &wgpu::Device, attachments: Attachments, occluded: bool) -> Self {
        let unfiltered = wgpu::TextureSampleType::Float { filterable: false };
        let texture = |binding| texture_entry(binding, unfiltered, wgpu::TextureViewDimension::D2);
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("display"),
            entries: &[attachments.sampled(texture(0)), texture(2)],
        });
        Self { attachments, occluded, layout, pipelines: Vec::new() }
    }

    /// Sees to a pipeline for targets of a format.
    pub(in crate::render) fn prepare(
        &mut self,
        device: &wgpu::Device,
        frame: &wgpu::BindGroupLayout,
        format: wgpu::TextureFormat,
    ) {
        if self.pipeline(format).is_none() {
            let constants = [
                ("occluded", f64::from(u8::from(self.occluded))),
                ("target_encodes", f64::from(u8::from(format.is_srgb()))),
            ];
            let shader = Shader::Display(self.attachments.reading());
            let pipeline = tiles::pipeline(device, shader, [frame, &self.layout], &constants, format);
            self.pipelines.push((format, pipeline));
        }
    }

    fn pipeline(&self, format: wgpu::TextureFormat) -> Option<&wgpu::RenderPipeline> {
        self.pipelines.iter().find_map(|(of, pipeline)| (*of == format).then_some(pipeline))
    }

    pub(in crate::render) fn bind(
        &self,
        device: &wgpu::Device,
        radiances: &wgpu::TextureView,
        occlusion: &wgpu::TextureView,
    ) -> wgpu::BindGroup {
        device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("display"),
            layout: &self.layout,
            entries: &[
                wgpu::BindGroupEntry { binding: 0, resource: wgpu::BindingResource::TextureView(radiances) },
                wgpu::BindGroupEntry { binding: 2, resource: wgpu::BindingResource::TextureView(occlusion) },
            ],
        })
    }

    /// Draws to a target of a format that was prepared.
    pub(in crate::render) fn draw(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        (target, format): (&wgpu::TextureView, wgpu::TextureFormat),
        groups: (&FrameGroup, &wgpu::BindGroup),
        tiles: Tiles<'_>,
    ) {
        if let Some(pipeline) = self.pipeline(format) {
            tiles::draw(encoder, target, pipeline, groups, tiles);
        }
    }
}
