//! Lit lenses of traffic signals: emissive discs, by day and night, at the heads of the scene.

use super::glow::gpu_data::{Glow, LAYOUT};
use super::{Attachments, ScenePipelineState, scene_pipeline};
use crate::shader::Shader;
use city3d_protocol::snapshot::Aspect;
use city3d_scene::{LENS_RADIUS_M, SignalLenses};

/// Radiance of the red, the yellow and the green lens.
const RADIANCE: [[f32; 3]; 3] = [[5.0, 0.06, 0.03], [4.4, 1.9, 0.04], [0.05, 3.6, 1.3]];
/// Radius of the glow at night, its share of the radiance, and the exponent of its beam.
const GLOW_RADIUS_M: f32 = 1.1;
const GLOW_SHARE: f32 = 0.45;
const GLOW_BEAM: f32 = 2.0;

/// Pipeline and instances of lit lenses.
#[derive(Debug)]
pub(crate) struct SignalPass {
    pipeline: wgpu::RenderPipeline,
    heads: Vec<SignalLenses>,
    lit: wgpu::Buffer,
    count: u32,
}

impl SignalPass {
    /// For the heads of a scene, none of which is lit.
    pub(crate) fn new(
        device: &wgpu::Device,
        attachments: Attachments,
        frame: &wgpu::BindGroupLayout,
        heads: &[SignalLenses],
    ) -> Self {
        let pipeline = scene_pipeline(
            device,
            attachments,
            &ScenePipelineState {
                shader: Shader::Signal,
                module: &Shader::Signal.module(device, None),
                entries: ["vertex_main", attachments.entries()[1]],
                groups: &[Some(frame)],
                buffers: &[Some(LAYOUT)],
                constants: &[],
                topology: wgpu::PrimitiveTopology::TriangleStrip,
                cull_back_faces: false,
                blend: None,
                alpha_to_coverage: false,
                write_depth: true,
            },
        );
        let lit = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("lit lenses of signals"),
            size: (heads.len() * size_of::<Glow>()) as u64,
            usage: wgpu::BufferUsages::VERTEX | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        Self { pipeline, heads: heads.to_vec(), lit, count: 0 }
    }

    /// Writes the lenses that the aspects of a snapshot light, by head.
    pub(crate) fn write(&mut self, queue: &wgpu::Queue, aspects: &[Aspect]) {
        let lit: Vec<Glow> = self.lit(aspects, LENS_RADIUS_M, 1.0, 0.0).collect();
        self.count = lit.len() as u32;
        queue.write_buffer(&self.lit, 0, bytemuck::cast_slice(&lit));
    }

    /// The glow of these lenses at night.
    pub(crate) fn glows(&self, aspects: &[Aspect]) -> impl Iterator<Item = Glow> {
        self.lit(aspects, GLOW_RADIUS_M, GLOW_SHARE, GLOW_BEAM)
    }

    fn lit(&self, aspects: &[Aspect], radius_m: f32, share: f32, beam: f32) -> impl Iterator<Item = Glow> {
        self.heads.iter().zip(aspects).filter_map(move |(head, aspect)| {
            let lens = match aspect {
                Aspect::Dark => return None,
                Aspect::Red => 0,
                Aspect::Yellow => 1,
                Aspect::Green => 2,
            };
            let [r, g, b] = RADIANCE[lens].map(|radiance| radiance * share);
            Some(Glow {
                at: head.middles[lens].extend(radius_m).to_array(),
                colour: [r, g, b, beam],
                ahead: head.facing.extend(0.0).to_array(),
            })
        })
    }

    /// Draws the lit lenses. The caller has set bind group 0.
    pub(crate) fn draw(&self, pass: &mut wgpu::RenderPass<'_>) {
        if self.count > 0 {
            pass.set_pipeline(&self.pipeline);
            pass.set_vertex_buffer(0, self.lit.slice(..));
            pass.draw(0..4, 0..self.count);
        }
    }
}
