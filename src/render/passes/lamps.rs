//! The map of lamplight: the ground seen from above, with the light of street lamps and of vehicles on it.
//! All views share it. What stands is drawn once; at each tick vehicles are added to a copy.

use super::{common::FrameGroup, vehicle};
use crate::city::scene::SceneDescription;
use crate::render::fleet::Fleet;
use crate::render::shader::Shader;
use wgpu::util::DeviceExt;

const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Float;
/// Around the city, so that what lies outside of it takes no light from the edge.
const MARGIN_M: f32 = 4.0;

#[derive(Debug)]
pub(in crate::render) struct LampPass {
    /// What the passes of a picture read.
    pub(in crate::render) map_view: wgpu::TextureView,
    /// Place in the map from city metres: a factor and an offset.
    pub(in crate::render) place: [f32; 4],
    map: wgpu::Texture,
    standing: wgpu::Texture,
    lamps: wgpu::RenderPipeline,
    beams: wgpu::RenderPipeline,
    positions: wgpu::Buffer,
    count: u32,
}

impl LampPass {
    pub(in crate::render) fn new(
        device: &wgpu::Device,
        frame: &wgpu::BindGroupLayout,
        scene: &SceneDescription,
        texels: u32,
    ) -> Self {
        let texture = |label, usage| {
            device.create_texture(&wgpu::TextureDescriptor {
                label: Some(label),
                size: wgpu::Extent3d { width: texels, height: texels, depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format: FORMAT,
                usage: usage | wgpu::TextureUsages::RENDER_ATTACHMENT,
                view_formats: &[],
            })
        };
        let map = texture("lamplight", wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST);
        let standing = texture("light of street lamps", wgpu::TextureUsages::COPY_SRC);
        let positions: Vec<[f32; 3]> = scene.lamps.iter().map(|lamp| lamp.to_array()).collect();
        let lamp_layout = wgpu::VertexBufferLayout {
            array_stride: size_of::<[f32; 3]>() as u64,
            step_mode: wgpu::VertexStepMode::Instance,
            attributes: &wgpu::vertex_attr_array![0 => Float32x3],
        };
        let beams = ["beam_vertex", "beam_fragment"];
        Self {
            map_view: map.create_view(&wgpu::TextureViewDescriptor::default()),
            place: place(scene),
            map,
            standing,
            lamps: pipeline(device, frame, ["lamp_vertex", "lamp_fragment"], lamp_layout),
            beams: pipeline(device, frame, beams, vehicle::gpu_data::LAYOUT),
            count: positions.len() as u32,
            positions: device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
                label: Some("street lamps"),
                contents: bytemuck::cast_slice(&positions),
                usage: wgpu::BufferUsages::VERTEX,
            }),
        }
    }

    /// Draws the street lamps, once.
    pub(in crate::render) fn draw_standing(&self, encoder: &mut wgpu::CommandEncoder, frame: &FrameGroup) {
        let clear = wgpu::LoadOp::Clear(wgpu::Color::BLACK);
        let mut pass = begin(encoder, &self.standing, clear);
        if self.count > 0 {
            pass.set_pipeline(&self.lamps);
            pass.set_bind_group(0, &frame.group, &[0]);
            pass.set_vertex_buffer(0, self.positions.slice(..));
            pass.draw(0..4, 0..self.count);
        }
    }

    /// Brings the light of vehicles up to date.
    pub(in crate::render) fn draw_vehicles(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        frame: &FrameGroup,
        fleet: &Fleet,
    ) {
        encoder.copy_texture_to_texture(
            self.standing.as_image_copy(),
            self.map.as_image_copy(),
            self.map.size(),
        );
        let mut pass = begin(encoder, &self.map, wgpu::LoadOp::Load);
        pass.set_pipeline(&self.beams);
        pass.set_bind_group(0, &frame.group, &[0]);
        fleet.draw_beams(&mut pass);
    }
}

fn place(scene: &SceneDescription) -> [f32; 4] {
    let [low, high] = scene.bounds.map(|corner| corner.truncate());
    let (low, size) = (low - MARGIN_M, (high - low).max_element().max(1.0) + 2.0 * MARGIN_M);
    [1.0 / size, 1.0 / size, -low.x / size, -low.y / size]
}

fn begin<'a>(
    encoder: &'a mut wgpu::CommandEncoder,
    texture: &wgpu::Texture,
    load: wgpu::LoadOp<wgpu::Color>,
) -> wgpu::RenderPass<'a> {
    let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
    encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: Some("lamplight"),
        color_attachments: &[Some(wgpu::RenderPassColorAttachment {
            view: &view,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations { load, store: wgpu::StoreOp::Store },
        })],
        ..Default::default()
    })
}

fn pipeline(
    device: &wgpu::Device,
    frame: &wgpu::BindGroupLayout,
    [vertex, fragment]: [&str; 2],
    buffer: wgpu::VertexBufferLayout<'_>,
) -> wgpu::RenderPipeline {
    let module = Shader::Lamps.module(device, None);
    let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some(vertex),
        bind_group_layouts: &[Some(frame)],
        immediate_size: 0,
    });
    let one = wgpu::BlendComponent {
        src_factor: wgpu::BlendFactor::One,
        dst_factor: wgpu::BlendFactor::One,
        operation: wgpu::BlendOperation::Add,
    };
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some(vertex),
        layout: Some(&layout),
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: Some(vertex),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            buffers: &[Some(buffer)],
        },
        primitive: wgpu::PrimitiveState {
            topology: wgpu::PrimitiveTopology::TriangleStrip,
            ..Default::default()
        },
        depth_stencil: None,
        multisample: wgpu::MultisampleState::default(),
        fragment: Some(wgpu::FragmentState {
            module: &module,
            entry_point: Some(fragment),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            targets: &[Some(wgpu::ColorTargetState {
                format: FORMAT,
                blend: Some(wgpu::BlendState { color: one, alpha: one }),
                write_mask: wgpu::ColorWrites::ALL,
            })],
        }),
        multiview_mask: None,
        cache: None,
    })
}
