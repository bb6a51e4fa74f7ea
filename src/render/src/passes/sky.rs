//! Sky box: panorama texture, disc of sun or moon, stars; drawn last, at the far plane.

use super::{Attachments, ScenePipelineState, sampler_entry, scene_pipeline, texture_entry};
use crate::Context;
use crate::shader::Shader;
use crate::textures::{self, BakedTextures};
use wgpu::util::DeviceExt;

pub(crate) mod gpu_data {
    use bytemuck::{Pod, Zeroable};

    #[repr(C)]
    #[derive(Clone, Copy, Debug, Pod, Zeroable)]
    pub(crate) struct Vertex {
        pub(crate) direction: [f32; 3],
        pub(crate) uv: [f32; 2],
    }

    pub(crate) const LAYOUT: wgpu::VertexBufferLayout<'static> = wgpu::VertexBufferLayout {
        array_stride: size_of::<Vertex>() as u64,
        step_mode: wgpu::VertexStepMode::Vertex,
        attributes: &wgpu::vertex_attr_array![0 => Float32x3, 1 => Float32x2],
    };

    #[repr(C)]
    #[derive(Clone, Copy, Debug, Pod, Zeroable)]
    pub(crate) struct Star {
        pub(crate) direction: [f32; 3],
        pub(crate) colour: [f32; 3],
    }

    pub(crate) const STAR_LAYOUT: wgpu::VertexBufferLayout<'static> = wgpu::VertexBufferLayout {
        array_stride: size_of::<Star>() as u64,
        step_mode: wgpu::VertexStepMode::Vertex,
        attributes: &wgpu::vertex_attr_array![0 => Float32x3, 1 => Float32x3],
    };
}

/// Pipelines and vertices of the sky.
#[derive(Debug)]
pub(crate) struct SkyPass {
    pipeline: wgpu::RenderPipeline,
    panorama: wgpu::BindGroup,
    vertices: wgpu::Buffer,
    count: u32,
    /// Disc of sun or moon, and stars at night: pipeline, vertices, number of vertices.
    lights: Vec<(wgpu::RenderPipeline, wgpu::Buffer, u32)>,
}

impl SkyPass {
    pub(crate) fn new(
        context: &Context,
        attachments: Attachments,
        baked: &BakedTextures,
        groups: [&wgpu::BindGroupLayout; 2],
    ) -> Self {
        let (device, light) = (&context.device, &baked.light);
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("sky"),
            entries: &[
                texture_entry(
                    0,
                    wgpu::TextureSampleType::Float { filterable: true },
                    wgpu::TextureViewDimension::D2,
                ),
                sampler_entry(1, wgpu::SamplerBindingType::Filtering),
            ],
        });
        let view = baked.panorama(context);
        let sampler = device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("sky"),
            address_mode_u: wgpu::AddressMode::Repeat,
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            ..Default::default()
        });
        let panorama = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("sky"),
            layout: &layout,
            entries: &[
                wgpu::BindGroupEntry { binding: 0, resource: wgpu::BindingResource::TextureView(&view) },
                wgpu::BindGroupEntry { binding: 1, resource: wgpu::BindingResource::Sampler(&sampler) },
            ],
        });
        let module = Shader::Sky.module(device, None);
        let state = ScenePipelineState {
            shader: Shader::Sky,
            module: &module,
            entries: [
                "vertex_main",
                if attachments.vertex_lit { "vertex_lit_fragment" } else { "fragment_main" },
            ],
            groups: &[Some(groups[0]), Some(groups[1]), Some(&layout)],
            buffers: &[Some(gpu_data::LAYOUT)],
            constants: &[],
            topology: wgpu::PrimitiveTopology::TriangleList,
            cull_back_faces: false,
            blend: None,
            alpha_to_coverage: false,
            write_depth: false,
        };
        let pipeline = scene_pipeline(device, attachments, &state);
        let vertices: Vec<gpu_data::Vertex> = textures::sky_triangles()
            .into_iter()
            .flatten()
            .map(|(direction, uv)| gpu_data::Vertex { direction: direction.to_array(), uv })
            .collect();
        let buffer = |contents: &[u8]| {
            device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
                label: Some("sky"),
                contents,
                usage: wgpu::BufferUsages::VERTEX,
            })
        };
        let shown = |colour| if attachments.vertex_lit { colour } else { light.radiance_of(colour) };
        let lights = [
            (textures::disc(light), wgpu::PrimitiveTopology::TriangleList),
            (textures::stars(light), wgpu::PrimitiveTopology::PointList),
        ];
        let lights =
            lights.into_iter().filter(|(corners, _)| !corners.is_empty()).map(|(corners, topology)| {
                let star = |(direction, colour): (glam::Vec3, _)| gpu_data::Star {
                    direction: direction.to_array(),
                    colour: shown(colour),
                };
                let vertices: Vec<gpu_data::Star> = corners.into_iter().map(star).collect();
                let state = ScenePipelineState {
                    entries: ["star_vertex", "star_fragment"],
                    buffers: &[Some(gpu_data::STAR_LAYOUT)],
                    topology,
                    ..state
                };
                let pipeline = scene_pipeline(device, attachments, &state);
                (pipeline, buffer(bytemuck::cast_slice(&vertices)), vertices.len() as u32)
            });
        let lights = lights.collect();
        Self {
            pipeline,
            panorama,
            lights,
            count: vertices.len() as u32,
            vertices: buffer(bytemuck::cast_slice(&vertices)),
        }
    }

    /// Draws the sky. The caller has set bind groups 0 and 1.
    pub(crate) fn draw(&self, pass: &mut wgpu::RenderPass<'_>) {
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(2, &self.panorama, &[]);
        pass.set_vertex_buffer(0, self.vertices.slice(..));
        pass.draw(0..self.count, 0..1);
        for (pipeline, vertices, count) in &self.lights {
            pass.set_pipeline(pipeline);
            pass.set_vertex_buffer(0, vertices.slice(..));
            pass.draw(0..*count, 0..1);
        }
    }
}
