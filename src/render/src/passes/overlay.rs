//! Overlay pass: lines and surfaces over a finished picture, tested in the fragment against the depth buffer of its colour
//! pass, which may be multisampled while the picture is not.

use super::common::FrameBindGroup;
use super::{Attachments, texture_entry};
use crate::overlay::{Overlay, OverlayPaint};
use crate::shader::Shader;
use wgpu::util::DeviceExt as _;

pub(crate) mod gpu_data {
    use bytemuck::{Pod, Zeroable};

    /// A line, an instance of four corners.
    #[repr(C)]
    #[derive(Clone, Copy, Debug, Pod, Zeroable)]
    pub(crate) struct Line {
        pub(crate) from: [f32; 3],
        /// Pixels.
        pub(crate) width: f32,
        pub(crate) to: [f32; 3],
        pub(crate) behind: f32,
        pub(crate) colour: [u8; 4],
    }

    pub(crate) const LINE: wgpu::VertexBufferLayout<'static> = wgpu::VertexBufferLayout {
        array_stride: size_of::<Line>() as u64,
        step_mode: wgpu::VertexStepMode::Instance,
        attributes: &wgpu::vertex_attr_array![
            0 => Float32x3, 1 => Float32, 2 => Float32x3, 3 => Float32, 4 => Unorm8x4
        ],
    };

    /// A corner of a triangle.
    #[repr(C)]
    #[derive(Clone, Copy, Debug, Pod, Zeroable)]
    pub(crate) struct Corner {
        pub(crate) position: [f32; 3],
        pub(crate) behind: f32,
        pub(crate) colour: [u8; 4],
    }

    pub(crate) const CORNER: wgpu::VertexBufferLayout<'static> = wgpu::VertexBufferLayout {
        array_stride: size_of::<Corner>() as u64,
        step_mode: wgpu::VertexStepMode::Vertex,
        attributes: &wgpu::vertex_attr_array![0 => Float32x3, 1 => Float32, 2 => Unorm8x4],
    };
}

/// Pipelines of overlays for targets of one pixel format.
#[derive(Debug)]
pub(crate) struct OverlayPass {
    format: wgpu::TextureFormat,
    layout: wgpu::BindGroupLayout,
    lines: wgpu::RenderPipeline,
    triangles: wgpu::RenderPipeline,
}

/// Picture that an overlay is drawn over.
#[derive(Clone, Copy, Debug)]
pub(crate) struct OverlayTarget<'a> {
    /// The picture.
    pub(crate) color: &'a wgpu::TextureView,
    /// Depth buffer of its colour pass.
    pub(crate) depth: &'a wgpu::TextureView,
    /// Index of its view in the frame.
    pub(crate) view: usize,
}

impl OverlayPass {
    pub(crate) fn new(
        device: &wgpu::Device,
        attachments: Attachments,
        frame: &wgpu::BindGroupLayout,
        format: wgpu::TextureFormat,
    ) -> Self {
        let depths = texture_entry(1, wgpu::TextureSampleType::Depth, wgpu::TextureViewDimension::D2);
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("overlay"),
            entries: &[attachments.with_sample_count(depths)],
        });
        let module = Shader::Overlay(attachments.sample_count()).module(device, None);
        let pipeline = |entries, buffer, topology| {
            let input = PipelineInput { module: &module, entries, buffer, topology, format };
            pipeline(device, [frame, &layout], &input)
        };
        Self {
            format,
            lines: pipeline(
                ["line_vertex", "line_fragment"],
                gpu_data::LINE,
                wgpu::PrimitiveTopology::TriangleStrip,
            ),
            triangles: pipeline(
                ["surface_vertex", "surface_fragment"],
                gpu_data::CORNER,
                wgpu::PrimitiveTopology::TriangleList,
            ),
            layout,
        }
    }

    /// Pixel format of its targets.
    pub(crate) fn format(&self) -> wgpu::TextureFormat {
        self.format
    }

    /// Draws an overlay over a picture. The views of `frame` have been written.
    pub(crate) fn draw(
        &self,
        device: &wgpu::Device,
        encoder: &mut wgpu::CommandEncoder,
        frame: &FrameBindGroup,
        (target, overlay): (OverlayTarget<'_>, &Overlay),
    ) {
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("overlay"),
            layout: &self.layout,
            entries: &[wgpu::BindGroupEntry {
                binding: 1,
                resource: wgpu::BindingResource::TextureView(target.depth),
            }],
        });
        let buffer = |label, contents: &[u8]| {
            let usage = wgpu::BufferUsages::VERTEX;
            device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
                label: Some(label),
                contents,
                usage,
            })
        };
        let (lines, corners) = (lines(overlay), corners(overlay));
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("overlay"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: target.color,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations { load: wgpu::LoadOp::Load, store: wgpu::StoreOp::Store },
            })],
            ..Default::default()
        });
        pass.set_bind_group(0, &frame.group, &[FrameBindGroup::offset(target.view)]);
        pass.set_bind_group(1, &group, &[]);
        if !corners.is_empty() {
            pass.set_pipeline(&self.triangles);
            pass.set_vertex_buffer(0, buffer("surfaces", bytemuck::cast_slice(&corners)).slice(..));
            pass.draw(0..corners.len() as u32, 0..1);
        }
        if !lines.is_empty() {
            pass.set_pipeline(&self.lines);
            pass.set_vertex_buffer(0, buffer("lines", bytemuck::cast_slice(&lines)).slice(..));
            pass.draw(0..4, 0..lines.len() as u32);
        }
    }
}

fn lines(overlay: &Overlay) -> Vec<gpu_data::Line> {
    let lines = overlay.lines.iter().map(|line| {
        let ([from, to], OverlayPaint { colour, behind }) = (line.ends.map(|end| end.to_array()), line.paint);
        gpu_data::Line { from, width: line.width * overlay.scale, to, behind, colour }
    });
    lines.collect()
}

fn corners(overlay: &Overlay) -> Vec<gpu_data::Corner> {
    let corners = overlay.triangles.iter().flat_map(|triangle| {
        let OverlayPaint { colour, behind } = triangle.paint;
        triangle.corners.map(|at| gpu_data::Corner { position: at.to_array(), behind, colour })
    });
    corners.collect()
}

struct PipelineInput<'a> {
    module: &'a wgpu::ShaderModule,
    entries: [&'static str; 2],
    buffer: wgpu::VertexBufferLayout<'static>,
    topology: wgpu::PrimitiveTopology,
    format: wgpu::TextureFormat,
}

fn pipeline(
    device: &wgpu::Device,
    groups: [&wgpu::BindGroupLayout; 2],
    input: &PipelineInput<'_>,
) -> wgpu::RenderPipeline {
    let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: None,
        bind_group_layouts: &groups.map(Some),
        immediate_size: 0,
    });
    let constants = [("target_is_srgb", f64::from(u8::from(input.format.is_srgb())))];
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("overlay"),
        layout: Some(&layout),
        vertex: wgpu::VertexState {
            module: input.module,
            entry_point: Some(input.entries[0]),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            buffers: &[Some(input.buffer.clone())],
        },
        primitive: wgpu::PrimitiveState { topology: input.topology, ..Default::default() },
        depth_stencil: None,
        multisample: wgpu::MultisampleState::default(),
        fragment: Some(wgpu::FragmentState {
            module: input.module,
            entry_point: Some(input.entries[1]),
            compilation_options: wgpu::PipelineCompilationOptions {
                constants: &constants,
                ..Default::default()
            },
            targets: &[Some(wgpu::ColorTargetState {
                format: input.format,
                blend: Some(wgpu::BlendState::ALPHA_BLENDING),
                write_mask: wgpu::ColorWrites::COLOR,
            })],
        }),
        multiview_mask: None,
        cache: None,
    })
}

#[cfg(test)]
mod tests {
    use super::gpu_data::{CORNER, Corner, LINE, Line};
    use std::mem::offset_of;

    #[test]
    fn attributes_lie_where_lines_and_corners_have_them() {
        let offsets = |layout: &wgpu::VertexBufferLayout<'_>| {
            layout.attributes.iter().map(|a| a.offset as usize).collect::<Vec<_>>()
        };
        let line = [
            offset_of!(Line, from),
            offset_of!(Line, width),
            offset_of!(Line, to),
            offset_of!(Line, behind),
            offset_of!(Line, colour),
        ];
        assert_eq!(offsets(&LINE), line);
        let corner = [offset_of!(Corner, position), offset_of!(Corner, behind), offset_of!(Corner, colour)];
        assert_eq!(offsets(&CORNER), corner);
    }
}
