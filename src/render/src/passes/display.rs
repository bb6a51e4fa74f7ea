//! Display transform: exposure, tone mapping, MSAA resolve, sRGB encoding and dither of the HDR target.

use super::common::FrameBindGroup;
use super::tiles::{self, Tiles};
use super::{Attachments, texture_entry};
use crate::settings::Quality;
use crate::shader::Shader;

/// Pipelines of the display transform, one for each pixel format of targets.
#[derive(Debug)]
pub(crate) struct DisplayPass {
    attachments: Attachments,
    ambient_occlusion: bool,
    contact_shadows: bool,
    reflections: bool,
    layout: wgpu::BindGroupLayout,
    pipelines: Vec<(wgpu::TextureFormat, wgpu::RenderPipeline)>,
}

impl DisplayPass {
    /// Without ambient occlusion the shader does not read the occlusion texture; without [`Attachments::reflects`] neither what
    /// smooth surfaces reflect nor the reflections.
    pub(crate) fn new(device: &wgpu::Device, attachments: Attachments, quality: Quality) -> Self {
        let unfiltered = wgpu::TextureSampleType::Float { filterable: false };
        let texture = |binding| texture_entry(binding, unfiltered, wgpu::TextureViewDimension::D2);
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("display"),
            entries: &[
                attachments.with_sample_count(texture(0)),
                texture(2),
                attachments.with_sample_count(texture(3)),
                texture(4),
            ],
        });
        let reflections = attachments.reflects;
        let ambient_occlusion = quality.ssao_samples > 0;
        let contact_shadows = ambient_occlusion && quality.contact_steps > 0;
        Self { attachments, ambient_occlusion, contact_shadows, reflections, layout, pipelines: Vec::new() }
    }

    /// Makes the pipeline for targets of a pixel format, if it is missing.
    pub(crate) fn prepare_pipeline(
        &mut self,
        device: &wgpu::Device,
        frame: &wgpu::BindGroupLayout,
        format: wgpu::TextureFormat,
    ) {
        if self.pipeline(format).is_none() {
            let constants = [
                ("ambient_occlusion", f64::from(u8::from(self.ambient_occlusion))),
                ("contact_shadows", f64::from(u8::from(self.contact_shadows))),
                ("reflections", f64::from(u8::from(self.reflections))),
                ("target_is_srgb", f64::from(u8::from(format.is_srgb()))),
            ];
            let shader = Shader::Display(self.attachments.sample_count());
            let pipeline = tiles::pipeline(device, shader, [frame, &self.layout], &constants, format);
            self.pipelines.push((format, pipeline));
        }
    }

    fn pipeline(&self, format: wgpu::TextureFormat) -> Option<&wgpu::RenderPipeline> {
        self.pipelines.iter().find_map(|(of, pipeline)| (*of == format).then_some(pipeline))
    }

    pub(crate) fn bind(
        &self,
        device: &wgpu::Device,
        [radiances, occlusion, mirrors, reflections]: [&wgpu::TextureView; 4],
    ) -> wgpu::BindGroup {
        let entry = |binding, view| wgpu::BindGroupEntry {
            binding,
            resource: wgpu::BindingResource::TextureView(view),
        };
        device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("display"),
            layout: &self.layout,
            entries: &[entry(0, radiances), entry(2, occlusion), entry(3, mirrors), entry(4, reflections)],
        })
    }

    /// Draws to a target. [`Self::prepare_pipeline`] has seen its format.
    pub(crate) fn draw(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        (target, format): (&wgpu::TextureView, wgpu::TextureFormat),
        groups: (&FrameBindGroup, &wgpu::BindGroup),
        tiles: Tiles<'_>,
    ) {
        if let Some(pipeline) = self.pipeline(format) {
            tiles::draw(encoder, target, pipeline, groups, tiles);
        }
    }
}
