//! Display transform: exposure, tone mapping, MSAA resolve, sRGB encoding and dither of the HDR target.

use super::common::FrameBindGroup;
use super::tiles::{self, TileOutput, Tiles};
use super::{Attachments, texture_entry};
use crate::settings::Quality;
use crate::shader::Shader;

/// Mean of pictures, in displayed light.
pub(crate) const MEAN_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Float;

/// Pipelines of the display transform, one for each pixel format of targets.
#[derive(Debug)]
pub(crate) struct DisplayPass {
    attachments: Attachments,
    ambient_occlusion: bool,
    contact_shadows: bool,
    reflections: bool,
    layout: wgpu::BindGroupLayout,
    mean: Option<MeanPipelines>,
    pipelines: Vec<(wgpu::TextureFormat, wgpu::RenderPipeline)>,
}

/// Pipelines for the mean of several pictures, where there are several.
#[derive(Debug)]
struct MeanPipelines {
    /// Adds a picture to the mean, before the sRGB encoding.
    accumulate: wgpu::RenderPipeline,
    /// Encodes the mean.
    encode: wgpu::RenderPipeline,
    layout: wgpu::BindGroupLayout,
}

const ADDING: wgpu::BlendComponent = wgpu::BlendComponent {
    src_factor: wgpu::BlendFactor::One,
    dst_factor: wgpu::BlendFactor::One,
    operation: wgpu::BlendOperation::Add,
};

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
        let (mean, pipelines) = (None, Vec::new());
        Self { attachments, ambient_occlusion, contact_shadows, reflections, layout, mean, pipelines }
    }

    /// Makes the pipelines for the mean of `count` pictures.
    pub(crate) fn prepare_mean(&mut self, device: &wgpu::Device, frame: &wgpu::BindGroupLayout, count: u32) {
        let unfiltered = wgpu::TextureSampleType::Float { filterable: false };
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("mean"),
            entries: &[texture_entry(5, unfiltered, wgpu::TextureViewDimension::D2)],
        });
        let shader = Shader::Display(self.attachments.sample_count());
        let mut constants = self.constants(self.attachments.display_format).to_vec();
        constants.push(("share", 1.0 / f64::from(count)));
        let blend = Some(wgpu::BlendState { color: ADDING, alpha: ADDING });
        let sum = TileOutput { entry: "accumulate_fragment", format: MEAN_FORMAT, blend };
        let format = self.attachments.display_format;
        let shown = TileOutput { entry: "encode_fragment", format, blend: None };
        self.mean = Some(MeanPipelines {
            accumulate: tiles::pipeline_with(device, shader, [frame, &self.layout], &constants, sum),
            encode: tiles::pipeline_with(device, shader, [frame, &layout], &[], shown),
            layout,
        });
    }

    /// Bindings of the mean; `None` unless [`Self::prepare_mean`] was called.
    pub(crate) fn bind_mean(
        &self,
        device: &wgpu::Device,
        mean: &wgpu::TextureView,
    ) -> Option<wgpu::BindGroup> {
        let pipelines = self.mean.as_ref()?;
        Some(device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("mean"),
            layout: &pipelines.layout,
            entries: &[wgpu::BindGroupEntry {
                binding: 5,
                resource: wgpu::BindingResource::TextureView(mean),
            }],
        }))
    }

    /// Adds a picture to the mean; the first one replaces what is there.
    pub(crate) fn accumulate(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        (mean, is_first): (&wgpu::TextureView, bool),
        groups: (&FrameBindGroup, &wgpu::BindGroup),
        tiles: Tiles<'_>,
    ) {
        let nothing = wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT);
        let load = if is_first { nothing } else { wgpu::LoadOp::Load };
        if let Some(pipelines) = &self.mean {
            tiles::draw_over(encoder, (mean, load), &pipelines.accumulate, groups, tiles);
        }
    }

    /// Draws the mean to a target of the format of pictures that are read back.
    pub(crate) fn draw_mean(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        target: &wgpu::TextureView,
        groups: (&FrameBindGroup, &wgpu::BindGroup),
        tiles: Tiles<'_>,
    ) {
        if let Some(pipelines) = &self.mean {
            tiles::draw(encoder, target, &pipelines.encode, groups, tiles);
        }
    }

    /// Pipeline-overridable constants for targets of a pixel format.
    fn constants(&self, format: wgpu::TextureFormat) -> [(&'static str, f64); 4] {
        [
            ("ambient_occlusion", f64::from(u8::from(self.ambient_occlusion))),
            ("contact_shadows", f64::from(u8::from(self.contact_shadows))),
            ("reflections", f64::from(u8::from(self.reflections))),
            ("target_is_srgb", f64::from(u8::from(format.is_srgb()))),
        ]
    }

    /// Makes the pipeline for targets of a pixel format, if it is missing.
    pub(crate) fn prepare_pipeline(
        &mut self,
        device: &wgpu::Device,
        frame: &wgpu::BindGroupLayout,
        format: wgpu::TextureFormat,
    ) {
        if self.pipeline(format).is_none() {
            let constants = self.constants(format);
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
