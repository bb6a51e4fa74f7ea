//! Full-screen passes over tiles of an atlas: one triangle per tile, earlier attachments in bind group 1.

use super::common::FrameBindGroup;
use crate::grid::Tile;
use crate::shader::Shader;

/// Views by index, each with the upper left corner of its tile, and the extent of a tile.
pub(crate) type Tiles<'a> = (&'a [(usize, [u32; 2])], [u32; 2]);

/// What a full-screen pass writes.
#[derive(Clone, Copy)]
pub(super) struct TileOutput<'a> {
    /// Entry point of the fragment stage.
    pub(super) entry: &'a str,
    pub(super) format: wgpu::TextureFormat,
    pub(super) blend: Option<wgpu::BlendState>,
}

/// Pipeline of a full-screen pass.
pub(super) fn pipeline(
    device: &wgpu::Device,
    shader: Shader,
    groups: [&wgpu::BindGroupLayout; 2],
    constants: &[(&str, f64)],
    format: wgpu::TextureFormat,
) -> wgpu::RenderPipeline {
    let output = TileOutput { entry: "fragment_main", format, blend: None };
    pipeline_with(device, shader, groups, constants, output)
}

/// Pipeline of a full-screen pass with an output of its own.
pub(super) fn pipeline_with(
    device: &wgpu::Device,
    shader: Shader,
    groups: [&wgpu::BindGroupLayout; 2],
    constants: &[(&str, f64)],
    output: TileOutput<'_>,
) -> wgpu::RenderPipeline {
    let module = shader.module(device, None);
    let options = wgpu::PipelineCompilationOptions { constants, ..Default::default() };
    let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: None,
        bind_group_layouts: &groups.map(Some),
        immediate_size: 0,
    });
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some(&format!("{shader:?}")),
        layout: Some(&layout),
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: Some("tile_vertex"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            buffers: &[],
        },
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: None,
        multisample: wgpu::MultisampleState::default(),
        fragment: Some(wgpu::FragmentState {
            module: &module,
            entry_point: Some(output.entry),
            compilation_options: options,
            targets: &[Some(wgpu::ColorTargetState {
                format: output.format,
                blend: output.blend,
                write_mask: wgpu::ColorWrites::ALL,
            })],
        }),
        multiview_mask: None,
        cache: None,
    })
}

/// Clears the target and draws the tiles.
pub(super) fn draw(
    encoder: &mut wgpu::CommandEncoder,
    target: &wgpu::TextureView,
    pipeline: &wgpu::RenderPipeline,
    groups: (&FrameBindGroup, &wgpu::BindGroup),
    tiles: Tiles<'_>,
) {
    draw_over(encoder, (target, wgpu::LoadOp::Clear(wgpu::Color::BLACK)), pipeline, groups, tiles);
}

/// Draws the tiles over what the target holds, or over a colour.
pub(super) fn draw_over(
    encoder: &mut wgpu::CommandEncoder,
    (target, load): (&wgpu::TextureView, wgpu::LoadOp<wgpu::Color>),
    pipeline: &wgpu::RenderPipeline,
    (frame, group): (&FrameBindGroup, &wgpu::BindGroup),
    (tiles, extent): Tiles<'_>,
) {
    let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: Some("tiles"),
        color_attachments: &[Some(wgpu::RenderPassColorAttachment {
            view: target,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations { load, store: wgpu::StoreOp::Store },
        })],
        ..Default::default()
    });
    pass.set_pipeline(pipeline);
    pass.set_bind_group(1, group, &[]);
    for &(view, origin) in tiles {
        Tile { origin, extent }.set_viewport(&mut pass);
        pass.set_bind_group(0, &frame.group, &[FrameBindGroup::offset(view)]);
        pass.draw(0..3, 0..1);
    }
}
