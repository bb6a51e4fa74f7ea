//! Palette pass: depth, classes or instances of a view in colours for people.

use super::texture_entry;
use crate::shader::Shader;
use city3d_protocol::snapshot::VehicleId;
use city3d_sensors::PictureKind;

/// Colour of a vehicle (instance) in pictures of instances, as `shaders/palette.wgsl` has it.
pub fn instance_colour(VehicleId(number): VehicleId) -> [u8; 3] {
    let hue = (number as f32 * 0.618_034).fract();
    let saturation = 0.45 + 0.55 * (number as f32 * 0.569_840_3).fract();
    let value = 0.6 + 0.4 * (number as f32 * 0.754_877_7).fract();
    [1.0, 2.0 / 3.0, 1.0 / 3.0].map(|offset: f32| {
        let ramp = ((hue + offset).fract() * 6.0 - 3.0).abs() - 1.0;
        (value * (1.0 - saturation + saturation * ramp.clamp(0.0, 1.0)) * 255.0).round() as u8
    })
}

/// Pipelines for targets, made as they are needed.
#[derive(Debug)]
pub(crate) struct PalettePass {
    layout: wgpu::BindGroupLayout,
    module: wgpu::ShaderModule,
    pipelines: Vec<(PaletteTarget, wgpu::RenderPipeline)>,
}

/// What a picture shows, and its pixel format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct PaletteTarget {
    pub(crate) kind: PictureKind,
    pub(crate) format: wgpu::TextureFormat,
}

impl PalettePass {
    pub(crate) fn new(device: &wgpu::Device) -> Self {
        let unfiltered = wgpu::TextureSampleType::Float { filterable: false };
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("palette"),
            entries: &[
                texture_entry(0, unfiltered, wgpu::TextureViewDimension::D2),
                texture_entry(1, wgpu::TextureSampleType::Uint, wgpu::TextureViewDimension::D2),
            ],
        });
        Self { layout, module: Shader::Palette.module(device, None), pipelines: Vec::new() }
    }

    /// Draws the maps of one view to a picture of their size.
    pub(crate) fn draw(
        &mut self,
        device: &wgpu::Device,
        encoder: &mut wgpu::CommandEncoder,
        [depth_map, labels]: [&wgpu::TextureView; 2],
        (color, target): (&wgpu::TextureView, PaletteTarget),
    ) {
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("palette"),
            layout: &self.layout,
            entries: &[
                wgpu::BindGroupEntry { binding: 0, resource: wgpu::BindingResource::TextureView(depth_map) },
                wgpu::BindGroupEntry { binding: 1, resource: wgpu::BindingResource::TextureView(labels) },
            ],
        });
        let pipeline = self.pipeline(device, target);
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("palette"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: color,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Clear(wgpu::Color::BLACK),
                    store: wgpu::StoreOp::Store,
                },
            })],
            ..Default::default()
        });
        pass.set_pipeline(pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.draw(0..3, 0..1);
    }

    fn pipeline(&mut self, device: &wgpu::Device, target: PaletteTarget) -> &wgpu::RenderPipeline {
        let found = self.pipelines.iter().position(|(of, _)| *of == target);
        let index = found.unwrap_or_else(|| {
            self.pipelines.push((target, self.new_pipeline(device, target)));
            self.pipelines.len() - 1
        });
        &self.pipelines[index].1
    }

    fn new_pipeline(&self, device: &wgpu::Device, target: PaletteTarget) -> wgpu::RenderPipeline {
        let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: None,
            bind_group_layouts: &[Some(&self.layout)],
            immediate_size: 0,
        });
        let constants = [
            ("kind", f64::from(target.kind as u8)),
            ("target_is_srgb", f64::from(u8::from(target.format.is_srgb()))),
        ];
        device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("palette"),
            layout: Some(&layout),
            vertex: wgpu::VertexState {
                module: &self.module,
                entry_point: Some("vertex_main"),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                buffers: &[],
            },
            primitive: wgpu::PrimitiveState::default(),
            depth_stencil: None,
            multisample: wgpu::MultisampleState::default(),
            fragment: Some(wgpu::FragmentState {
                module: &self.module,
                entry_point: Some("fragment_main"),
                compilation_options: wgpu::PipelineCompilationOptions {
                    constants: &constants,
                    ..Default::default()
                },
                targets: &[Some(wgpu::ColorTargetState {
                    format: target.format,
                    blend: None,
                    write_mask: wgpu::ColorWrites::ALL,
                })],
            }),
            multiview_mask: None,
            cache: None,
        })
    }
}
