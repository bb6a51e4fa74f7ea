//! Paints the meshes of the panels. Textures are those of `egui_wgpu`. Its shader also holds a bilinear filter of its own
//! behind a branch; Mesa's software adapter computes both sides of a branch, which took two thirds of a frame.

use egui::epaint::{ClippedPrimitive, Mesh, Primitive};
use egui_wgpu::{RendererOptions, ScreenDescriptor};
use std::num::NonZeroU64;
use std::ops::Range;

/// Position and texture coordinates, each two numbers, and a colour.
const VERTEX_BYTES: u64 = 20;
const ATTRIBUTES: [wgpu::VertexAttribute; 3] =
    wgpu::vertex_attr_array![0 => Float32x2, 1 => Float32x2, 2 => Unorm8x4];
const SCREEN_BYTES: u64 = 8;

/// Premultiplied alpha, as `egui_wgpu` blends.
const BLEND: wgpu::BlendState = wgpu::BlendState {
    color: wgpu::BlendComponent::OVER,
    alpha: wgpu::BlendComponent {
        src_factor: wgpu::BlendFactor::OneMinusDstAlpha,
        dst_factor: wgpu::BlendFactor::One,
        operation: wgpu::BlendOperation::Add,
    },
};

/// Pipeline and buffers of the panels for targets of one format.
pub(super) struct PanelRenderer {
    /// Textures by their ids, with bind groups that fit the pipeline.
    textures: egui_wgpu::Renderer,
    pipeline: wgpu::RenderPipeline,
    screen: wgpu::Buffer,
    screen_group: wgpu::BindGroup,
    vertices: wgpu::Buffer,
    indices: wgpu::Buffer,
}

/// A mesh in the buffers.
struct DrawCall<'a> {
    primitive: &'a ClippedPrimitive,
    mesh: &'a Mesh,
    indices: Range<u32>,
    base_vertex: i32,
}

impl PanelRenderer {
    pub(super) fn new(device: &wgpu::Device, format: wgpu::TextureFormat) -> Self {
        let screen_layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("screen of the panels"),
            entries: &[uniform(0, wgpu::ShaderStages::VERTEX, SCREEN_BYTES)],
        });
        let screen = buffer(device, SCREEN_BYTES, wgpu::BufferUsages::UNIFORM);
        let screen_group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("screen of the panels"),
            layout: &screen_layout,
            entries: &[wgpu::BindGroupEntry { binding: 0, resource: screen.as_entire_binding() }],
        });
        Self {
            textures: egui_wgpu::Renderer::new(device, format, RendererOptions::default()),
            pipeline: pipeline(device, format, &screen_layout),
            screen,
            screen_group,
            vertices: buffer(device, 1 << 16, wgpu::BufferUsages::VERTEX),
            indices: buffer(device, 1 << 16, wgpu::BufferUsages::INDEX),
        }
    }

    /// Where textures are registered, changed and freed.
    pub(super) fn textures(&mut self) -> &mut egui_wgpu::Renderer {
        &mut self.textures
    }

    /// Writes the meshes into the buffers and draws them, each within its clip rectangle. The commands have to be submitted before
    /// the next call.
    pub(super) fn paint(
        &mut self,
        (device, queue): (&wgpu::Device, &wgpu::Queue),
        pass: &mut wgpu::RenderPass<'_>,
        primitives: &[ClippedPrimitive],
        screen: &ScreenDescriptor,
    ) {
        let calls = self.write(device, queue, primitives);
        let points = screen.size_in_pixels.map(|pixels| pixels as f32 / screen.pixels_per_point);
        queue.write_buffer(&self.screen, 0, &bytes_of(&points));
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &self.screen_group, &[]);
        pass.set_vertex_buffer(0, self.vertices.slice(..));
        pass.set_index_buffer(self.indices.slice(..), wgpu::IndexFormat::Uint32);
        for DrawCall { primitive, mesh, indices, base_vertex } in calls {
            let Some(texture) = self.textures.texture(&mesh.texture_id) else { continue };
            let [x, y, width, height] = scissor(primitive.clip_rect, screen);
            if width > 0 && height > 0 {
                pass.set_scissor_rect(x, y, width, height);
                pass.set_bind_group(1, &texture.bind_group, &[]);
                pass.draw_indexed(indices, base_vertex, 0..1);
            }
        }
    }

    fn write<'a>(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        primitives: &'a [ClippedPrimitive],
    ) -> Vec<DrawCall<'a>> {
        let (mut vertices, mut indices, mut calls) = (Vec::new(), Vec::new(), Vec::new());
        let (mut vertex_count, mut index_count) = (0, 0);
        for primitive in primitives {
            let Primitive::Mesh(mesh) = &primitive.primitive else { continue };
            for vertex in &mesh.vertices {
                vertices.extend(bytes_of(&[vertex.pos.x, vertex.pos.y]));
                vertices.extend(bytes_of(&[vertex.uv.x, vertex.uv.y]));
                vertices.extend(vertex.color.to_array());
            }
            indices.extend(mesh.indices.iter().flat_map(|index| index.to_le_bytes()));
            let end = index_count + mesh.indices.len() as u32;
            calls.push(DrawCall { primitive, mesh, indices: index_count..end, base_vertex: vertex_count });
            (vertex_count, index_count) = (vertex_count + mesh.vertices.len() as i32, end);
        }
        for (held, bytes, usage) in [
            (&mut self.vertices, &vertices, wgpu::BufferUsages::VERTEX),
            (&mut self.indices, &indices, wgpu::BufferUsages::INDEX),
        ] {
            let size = bytes.len() as u64;
            if held.size() < size {
                *held = buffer(device, size.next_power_of_two(), usage);
            }
            queue.write_buffer(held, 0, bytes);
        }
        calls
    }
}

fn bytes_of([a, b]: &[f32; 2]) -> [u8; 8] {
    let ([a, b, c, d], [e, f, g, h]) = (a.to_le_bytes(), b.to_le_bytes());
    [a, b, c, d, e, f, g, h]
}

fn buffer(device: &wgpu::Device, size: u64, usage: wgpu::BufferUsages) -> wgpu::Buffer {
    device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("panels"),
        size,
        usage: usage | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    })
}

fn uniform(binding: u32, visibility: wgpu::ShaderStages, bytes: u64) -> wgpu::BindGroupLayoutEntry {
    wgpu::BindGroupLayoutEntry {
        binding,
        visibility,
        ty: wgpu::BindingType::Buffer {
            ty: wgpu::BufferBindingType::Uniform,
            has_dynamic_offset: false,
            min_binding_size: NonZeroU64::new(bytes),
        },
        count: None,
    }
}

/// Layout of the bind groups that `egui_wgpu` makes for textures: texture, sampler and flags, which the pipeline ignores.
fn texture_layout(device: &wgpu::Device) -> wgpu::BindGroupLayout {
    let visibility = wgpu::ShaderStages::FRAGMENT;
    let entry = |binding, ty| wgpu::BindGroupLayoutEntry { binding, visibility, ty, count: None };
    let texture = wgpu::BindingType::Texture {
        sample_type: wgpu::TextureSampleType::Float { filterable: true },
        view_dimension: wgpu::TextureViewDimension::D2,
        multisampled: false,
    };
    let sampler = wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering);
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("texture of the panels"),
        entries: &[entry(0, texture), entry(1, sampler), uniform(2, visibility, 16)],
    })
}

fn pipeline(
    device: &wgpu::Device,
    format: wgpu::TextureFormat,
    screen: &wgpu::BindGroupLayout,
) -> wgpu::RenderPipeline {
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some("panels"),
        source: wgpu::ShaderSource::Wgsl(include_str!("panels.wgsl").into()),
    });
    let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some("panels"),
        bind_group_layouts: &[Some(screen), Some(&texture_layout(device))],
        immediate_size: 0,
    });
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("panels"),
        layout: Some(&layout),
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: Some("corner"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            buffers: &[Some(wgpu::VertexBufferLayout {
                array_stride: VERTEX_BYTES,
                step_mode: wgpu::VertexStepMode::Vertex,
                attributes: &ATTRIBUTES,
            })],
        },
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: None,
        multisample: wgpu::MultisampleState::default(),
        fragment: Some(wgpu::FragmentState {
            module: &module,
            entry_point: Some(if format.is_srgb() { "linear" } else { "displayed" }),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            targets: &[Some(wgpu::ColorTargetState {
                format,
                blend: Some(BLEND),
                write_mask: wgpu::ColorWrites::ALL,
            })],
        }),
        multiview_mask: None,
        cache: None,
    })
}

/// Left, top, width and height of a clip rectangle on the screen, pixels.
fn scissor(clip: egui::Rect, screen: &ScreenDescriptor) -> [u32; 4] {
    let [width, height] = screen.size_in_pixels;
    let on_screen = |at: f32, most: u32| ((at * screen.pixels_per_point).round() as u32).min(most);
    let [left, right] = [clip.min.x, clip.max.x].map(|x| on_screen(x, width));
    let [top, bottom] = [clip.min.y, clip.max.y].map(|y| on_screen(y, height));
    [left, top, right.saturating_sub(left), bottom.saturating_sub(top)]
}

#[cfg(test)]
mod tests {
    use super::super::loading::software_context;
    use super::*;
    use city3d_render::read_texture;

    const EXTENT: [u32; 2] = [200, 120];

    /// Text, rounded and clipped rectangles, half transparent: the same pixels as by the renderer of `egui_wgpu`.
    #[test]
    fn panels_look_as_egui_wgpu_draws_them() {
        let Some(context) = software_context() else { return };
        let (device, queue) = (&context.device, &context.queue);
        for format in [wgpu::TextureFormat::Rgba8Unorm, wgpu::TextureFormat::Rgba8UnormSrgb] {
            let egui = egui::Context::default();
            let size = egui::vec2(EXTENT[0] as f32, EXTENT[1] as f32);
            let input = || egui::RawInput {
                screen_rect: Some(egui::Rect::from_min_size(egui::Pos2::ZERO, size)),
                ..Default::default()
            };
            let show = |ui: &mut egui::Ui| {
                ui.heading("Vehicles 50");
                let _ = ui.button("Start");
                let rect = egui::Rect::from_min_size(egui::pos2(60.3, 40.6), egui::vec2(90.0, 60.0));
                let colour = egui::Color32::from_rgba_unmultiplied(200, 40, 90, 120);
                ui.painter_at(rect.shrink(8.0)).circle_filled(rect.center(), 40.0, colour);
                ui.painter().rect_filled(rect, 9.0, colour);
            };
            let mut output = egui.run_ui(input(), show);
            let primitives = egui.tessellate(output.shapes, 1.0);
            let screen = ScreenDescriptor { size_in_pixels: EXTENT, pixels_per_point: 1.0 };
            let options = RendererOptions { dithering: false, ..RendererOptions::default() };
            let mut usual = egui_wgpu::Renderer::new(device, format, options);
            let mut panels = PanelRenderer::new(device, format);
            for (id, deltas) in &output.textures_delta.set {
                for delta in deltas {
                    usual.update_texture(device, queue, *id, delta);
                    panels.textures().update_texture(device, queue, *id, delta);
                }
            }
            output.textures_delta.clear();
            let draw = |draw: &mut dyn FnMut(&mut wgpu::CommandEncoder, &wgpu::TextureView)| {
                let texture = device.create_texture(&wgpu::TextureDescriptor {
                    label: None,
                    size: wgpu::Extent3d { width: EXTENT[0], height: EXTENT[1], depth_or_array_layers: 1 },
                    mip_level_count: 1,
                    sample_count: 1,
                    dimension: wgpu::TextureDimension::D2,
                    format,
                    usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
                    view_formats: &[],
                });
                let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
                let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
                draw(&mut encoder, &view);
                queue.submit([encoder.finish()]);
                read_texture(&context, &texture).unwrap().rgb
            };
            let expected = draw(&mut |encoder, view| {
                usual.update_buffers(device, queue, encoder, &primitives, &screen);
                let pass = begin(encoder, view);
                usual.render(&mut pass.forget_lifetime(), &primitives, &screen);
            });
            let found = draw(&mut |encoder, view| {
                panels.paint((device, queue), &mut begin(encoder, view), &primitives, &screen);
            });
            let colours: std::collections::BTreeSet<&[u8]> = found.chunks_exact(3).collect();
            assert!(colours.len() > 20, "{format:?}: {} colours", colours.len());
            let most = expected.iter().zip(&found).map(|(a, b)| a.abs_diff(*b)).max();
            assert!(most <= Some(1), "{format:?}: {most:?} of 255 apart");
        }
    }

    fn begin<'a>(encoder: &'a mut wgpu::CommandEncoder, view: &wgpu::TextureView) -> wgpu::RenderPass<'a> {
        encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: None,
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Clear(wgpu::Color { r: 0.1, g: 0.2, b: 0.3, a: 1.0 }),
                    store: wgpu::StoreOp::Store,
                },
            })],
            ..Default::default()
        })
    }
}
