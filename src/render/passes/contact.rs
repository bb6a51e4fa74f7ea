//! The dark patch under each vehicle, blended over the road.

use super::{Attachments, PictureState, picture_pipeline, vehicle};
use crate::render::fleet::{Fleet, Sight};
use crate::render::shader::Shader;

#[derive(Debug)]
pub(in crate::render) struct ContactPass {
    pipeline: wgpu::RenderPipeline,
}

impl ContactPass {
    pub(in crate::render) fn new(
        device: &wgpu::Device,
        attachments: Attachments,
        frame: &wgpu::BindGroupLayout,
    ) -> Self {
        let pipeline = picture_pipeline(
            device,
            attachments,
            &PictureState {
                shader: Shader::Contact,
                module: &Shader::Contact.module(device, None),
                entries: ["vertex_main", "fragment_main"],
                groups: &[Some(frame)],
                buffers: &[Some(vehicle::gpu_data::LAYOUT)],
                constants: &[],
                topology: wgpu::PrimitiveTopology::TriangleStrip,
                cull: false,
                // Alpha says how much of a sample's light is ambient, which a patch does not change.
                blend: Some(wgpu::BlendState {
                    alpha: wgpu::BlendComponent {
                        src_factor: wgpu::BlendFactor::Zero,
                        dst_factor: wgpu::BlendFactor::One,
                        operation: wgpu::BlendOperation::Add,
                    },
                    ..wgpu::BlendState::ALPHA_BLENDING
                }),
                write_depth: false,
            },
        );
        Self { pipeline }
    }

    /// Group 0 is set already.
    pub(in crate::render) fn draw(&self, pass: &mut wgpu::RenderPass<'_>, fleet: &Fleet, seen: &[Sight]) {
        if seen.is_empty() {
            return;
        }
        pass.set_pipeline(&self.pipeline);
        fleet.draw_contacts(pass, seen);
    }
}
