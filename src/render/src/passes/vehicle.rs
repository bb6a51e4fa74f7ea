//! Colour pass of vehicles: instanced bodies and wheels, front to back.

use super::common::gpu_data::Frame;
use super::{Attachments, ScenePipelineState, city, scene_pipeline};
use crate::fleet::{FleetRenderer, VisibleVehicle};
use crate::shader::Shader;

pub(crate) mod gpu_data {
    use bytemuck::{Pod, Zeroable};

    /// Instance data of a body, a wheel or a contact shadow.
    #[repr(C)]
    #[derive(Clone, Copy, Debug, Pod, Zeroable)]
    pub(crate) struct Instance {
        /// Affine transform to the city from the body or wheel, by rows.
        pub(crate) rows: [[f32; 4]; 3],
        /// Paint colour; w: number of the vehicle. Contact shadow: half length and half width of the body.
        pub(crate) paint: [f32; 4],
        /// Brake, left indicator, right indicator, reverse light: 0 off to 1 on.
        pub(crate) lamps: [f32; 4],
    }

    pub(crate) const ATTRIBUTES: [wgpu::VertexAttribute; 5] = wgpu::vertex_attr_array![
        5 => Float32x4, 6 => Float32x4, 7 => Float32x4, 8 => Float32x4, 9 => Float32x4
    ];

    pub(crate) const LAYOUT: wgpu::VertexBufferLayout<'static> = wgpu::VertexBufferLayout {
        array_stride: size_of::<Instance>() as u64,
        step_mode: wgpu::VertexStepMode::Instance,
        attributes: &ATTRIBUTES,
    };
}

/// Pipeline of vehicles.
#[derive(Debug)]
pub(crate) struct VehiclePass {
    pipeline: wgpu::RenderPipeline,
    /// Of clear glass, blended over what is behind it.
    glass: Option<wgpu::RenderPipeline>,
}

impl VehiclePass {
    pub(crate) fn new(
        device: &wgpu::Device,
        attachments: Attachments,
        (frame_constants, constants): (&Frame, &[(&str, f64)]),
        groups: [&wgpu::BindGroupLayout; 2],
    ) -> Self {
        let module = Shader::Vehicle.module(device, Some(frame_constants));
        let pipeline = |entries, blend: Option<wgpu::BlendState>| {
            let state = ScenePipelineState {
                shader: Shader::Vehicle,
                module: &module,
                entries,
                groups: &[Some(groups[0]), Some(groups[1])],
                buffers: &[Some(city::gpu_data::LAYOUT), Some(gpu_data::LAYOUT)],
                constants,
                topology: wgpu::PrimitiveTopology::TriangleList,
                cull_back_faces: true,
                blend,
                alpha_to_coverage: false,
                write_depth: blend.is_none(),
            };
            scene_pipeline(device, attachments, &state)
        };
        let entries =
            if attachments.vertex_lit { attachments.untextured_entries() } else { attachments.entries() };
        let blended = || {
            // Premultiplied; the ambient share of what is behind stays.
            let colour = wgpu::BlendState::PREMULTIPLIED_ALPHA_BLENDING.color;
            // Nothing takes light from glass, whose depth is that of what is behind it: its share is negative, see `displayed` in
            // `display.wgsl`.
            let alpha = wgpu::BlendComponent {
                src_factor: wgpu::BlendFactor::One,
                dst_factor: wgpu::BlendFactor::Zero,
                operation: wgpu::BlendOperation::ReverseSubtract,
            };
            pipeline(["vertex_main", "glass_fragment"], Some(wgpu::BlendState { color: colour, alpha }))
        };
        let glass = attachments.has_clear_glass().then(blended);
        Self { pipeline: pipeline(entries, None), glass }
    }

    /// Draws the clear glass of visible vehicles, over everything opaque. The caller has set bind groups 0 and 1.
    pub(crate) fn draw_glass(
        &self,
        pass: &mut wgpu::RenderPass<'_>,
        fleet: &FleetRenderer,
        visible: &[VisibleVehicle],
    ) {
        if let Some(glass) = self.glass.as_ref().filter(|_| !visible.is_empty()) {
            pass.set_pipeline(glass);
            fleet.draw_glass(pass, visible);
        }
    }

    /// Draws visible vehicles. The caller has set bind groups 0 and 1.
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
        fleet.draw(pass, visible, false);
    }
}

#[cfg(test)]
mod tests {
    use super::gpu_data::{ATTRIBUTES, Instance};
    use std::mem::offset_of;

    #[test]
    fn attributes_lie_where_the_instance_has_them() {
        let rows = offset_of!(Instance, rows);
        let offsets = [rows, rows + 16, rows + 32, offset_of!(Instance, paint), offset_of!(Instance, lamps)];
        assert_eq!(ATTRIBUTES.map(|a| a.offset as usize), offsets);
        assert_eq!(size_of::<Instance>(), offset_of!(Instance, lamps) + 16);
    }
}
