//! Contact shadows: a dark patch under each vehicle, alpha-blended over the road.

use super::{Attachments, ScenePipelineState, scene_pipeline, vehicle};
use crate::fleet::{FleetRenderer, VisibleVehicle};
use crate::shader::Shader;

/// Takes light. Alpha of the HDR target is the ambient share of the radiance, which a patch does not change.
pub(super) const DARKENING: wgpu::BlendState = wgpu::BlendState {
    alpha: wgpu::BlendComponent {
        src_factor: wgpu::BlendFactor::Zero,
        dst_factor: wgpu::BlendFactor::One,
        operation: wgpu::BlendOperation::Add,
    },
    ..wgpu::BlendState::ALPHA_BLENDING
};

/// Pipeline of contact shadows.
#[derive(Debug)]
pub(crate) struct ContactPass {
    pipeline: wgpu::RenderPipeline,
}

impl ContactPass {
    pub(crate) fn new(
        device: &wgpu::Device,
        attachments: Attachments,
        frame: &wgpu::BindGroupLayout,
    ) -> Self {
        let pipeline = scene_pipeline(
            device,
            attachments,
            &ScenePipelineState {
                shader: Shader::Contact,
                module: &Shader::Contact.module(device, None),
                entries: ["vertex_main", "fragment_main"],
                groups: &[Some(frame)],
                buffers: &[Some(vehicle::gpu_data::LAYOUT)],
                constants: &[],
                topology: wgpu::PrimitiveTopology::TriangleStrip,
                cull_back_faces: false,
                blend: Some(DARKENING),
                alpha_to_coverage: false,
                write_depth: false,
            },
        );
        Self { pipeline }
    }

    /// Draws the patches of visible vehicles. The caller has set bind group 0.
    pub(crate) fn draw(
        &self,
        pass: &mut wgpu::RenderPass<'_>,
        fleet: &FleetRenderer,
        visible: &[VisibleVehicle],
    ) {
        if visible.is_empty() {
            return;
        }
        pass.set_pipeline(&self.pipeline);
        fleet.draw_contacts(pass, visible);
    }
}
