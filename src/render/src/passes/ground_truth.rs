//! Ground-truth pass: depth, semantic class and vehicle (instance) of each pixel, into two colour attachments.

use super::{DEPTH_BUFFER_FORMAT, city, uniform_entry, vehicle};
use crate::device_renderer::VisibleSet;
use crate::fleet::FleetRenderer;
use crate::grid::Tile;
use crate::instances::InstancePart;
use crate::shader::Shader;
use crate::static_scene::StaticScene;
use city3d_scene::Class;
use city3d_sensors::View as CameraView;

/// Depth map: metres along the optical axis; [`NO_DEPTH`] where nothing is seen.
pub(crate) const DEPTH_MAP_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::R32Float;
/// Labels: class and vehicle.
pub(crate) const LABEL_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rg16Uint;
/// Clear value of the depth map, below any visible depth.
pub(crate) const NO_DEPTH: f64 = -1.0;

/// Offset between the uniforms of two views: WebGPU's default alignment of dynamic offsets.
const UNIFORM_STRIDE: usize = 256;

pub(crate) mod gpu_data {
    use bytemuck::{Pod, Zeroable};

    #[repr(C)]
    #[derive(Clone, Copy, Debug, Pod, Zeroable)]
    pub(crate) struct View {
        pub(crate) clip_from_world: [[f32; 4]; 4],
        pub(crate) depth_from_world: [f32; 4],
    }
}

/// Pipelines for the static city, painted lines, models of the map and vehicles, and uniforms of each view.
#[derive(Debug)]
pub(crate) struct GroundTruthPass {
    city: wgpu::RenderPipeline,
    /// What has gaps between leaves.
    leaves: wgpu::RenderPipeline,
    /// Without culling on the adapter: one may leave out a face of a kerb that is seen edge on, with nothing behind it.
    ground: wgpu::RenderPipeline,
    lines: wgpu::RenderPipeline,
    /// Models of the map.
    instanced: wgpu::RenderPipeline,
    vehicles: wgpu::RenderPipeline,
    layout: wgpu::BindGroupLayout,
    uniforms: Option<ViewUniforms>,
}

/// Uniform buffer with one slot per view, selected by a dynamic offset.
#[derive(Debug)]
struct ViewUniforms {
    buffer: wgpu::Buffer,
    group: wgpu::BindGroup,
    capacity: usize,
}

impl GroundTruthPass {
    pub(crate) fn new(device: &wgpu::Device) -> Self {
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("ground truth view"),
            entries: &[uniform_entry(0, true, size_of::<gpu_data::View>() as u64)],
        });
        let module = Shader::GroundTruth.module(device, None);
        let made = |entries, buffers: &[Option<wgpu::VertexBufferLayout<'_>>], cull_mode| {
            pipeline(device, (&layout, &module), (entries, cull_mode), buffers)
        };
        let pipeline = |entries, buffers: &[_]| made(entries, buffers, Some(wgpu::Face::Back));
        let city = ["city_main", "fragment_main"];
        Self {
            city: pipeline(city, &[Some(city::gpu_data::LAYOUT)]),
            ground: made(city, &[Some(city::gpu_data::LAYOUT)], None),
            leaves: pipeline(["part_main", "leaf_fragment"], &[Some(city::gpu_data::LAYOUT)]),
            lines: pipeline(["part_main", "line_fragment"], &[Some(city::gpu_data::LAYOUT)]),
            instanced: pipeline(
                ["instanced_main", "fragment_main"],
                &[Some(city::gpu_data::LAYOUT), Some(city::gpu_data::PLACEMENT_LAYOUT)],
            ),
            vehicles: pipeline(
                ["vehicle_main", "fragment_main"],
                &[Some(city::gpu_data::LAYOUT), Some(vehicle::gpu_data::LAYOUT)],
            ),
            layout,
            uniforms: None,
        }
    }

    /// Writes the uniforms of all views of a submission.
    pub(crate) fn write(&mut self, device: &wgpu::Device, queue: &wgpu::Queue, views: &[CameraView]) {
        let count = views.len();
        let mut bytes = vec![0_u8; count * UNIFORM_STRIDE];
        for (slot, view) in bytes.chunks_exact_mut(UNIFORM_STRIDE).zip(views) {
            slot[..size_of::<gpu_data::View>()].copy_from_slice(bytemuck::bytes_of(&view_data(view)));
        }
        if self.uniforms.as_ref().is_none_or(|uniforms| uniforms.capacity < count) {
            self.uniforms = Some(ViewUniforms::new(device, &self.layout, count.next_power_of_two().max(16)));
        }
        if let Some(uniforms) = &self.uniforms {
            queue.write_buffer(&uniforms.buffer, 0, &bytes);
        }
    }

    /// Draws view number `view` of the submission. Vehicles come first: they are few and hide much.
    pub(crate) fn draw(
        &self,
        pass: &mut wgpu::RenderPass<'_>,
        (tile, view): (Tile, usize),
        (static_scene, fleet): (&StaticScene, &FleetRenderer),
        visible: &VisibleSet,
    ) {
        let Some(uniforms) = &self.uniforms else { return };
        tile.set_viewport(pass);
        pass.set_bind_group(0, &uniforms.group, &[(view * UNIFORM_STRIDE) as u32]);
        pass.set_pipeline(&self.vehicles);
        fleet.draw(pass, &visible.vehicles, true);
        tile.set_scissor_rows(pass, visible.visible_rows);
        pass.set_pipeline(&self.city);
        let ranges = &visible.ranges;
        for objects in [&ranges.untextured, &ranges.objects] {
            static_scene.draw(pass, objects);
        }
        pass.set_pipeline(&self.leaves);
        static_scene.draw(pass, &ranges.bucket);
        if !ranges.instances.is_empty() {
            pass.set_pipeline(&self.instanced);
            static_scene.instanced().draw(pass, &ranges.instances, InstancePart::All);
        }
        pass.set_pipeline(&self.ground);
        for ground in ranges.all_ground() {
            static_scene.draw(pass, ground);
        }
        pass.set_pipeline(&self.lines);
        static_scene.draw(pass, &ranges.lines);
    }
}

impl ViewUniforms {
    fn new(device: &wgpu::Device, layout: &wgpu::BindGroupLayout, capacity: usize) -> Self {
        let buffer = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("ground truth views"),
            size: (capacity * UNIFORM_STRIDE) as u64,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("ground truth view"),
            layout,
            entries: &[wgpu::BindGroupEntry {
                binding: 0,
                resource: wgpu::BindingResource::Buffer(wgpu::BufferBinding {
                    buffer: &buffer,
                    offset: 0,
                    size: wgpu::BufferSize::new(size_of::<gpu_data::View>() as u64),
                }),
            }],
        });
        Self { buffer, group, capacity }
    }
}

fn view_data(view: &CameraView) -> gpu_data::View {
    let forward = view.extrinsics.forward();
    let depth_from_world = forward.extend(-forward.dot(view.extrinsics.position));
    gpu_data::View {
        clip_from_world: view.clip_from_world().as_mat4().to_cols_array_2d(),
        depth_from_world: depth_from_world.as_vec4().to_array(),
    }
}

fn pipeline(
    device: &wgpu::Device,
    (layout, module): (&wgpu::BindGroupLayout, &wgpu::ShaderModule),
    ([vertex, fragment], cull_mode): ([&str; 2], Option<wgpu::Face>),
    buffers: &[Option<wgpu::VertexBufferLayout<'_>>],
) -> wgpu::RenderPipeline {
    let constants = [("vehicle_class", f64::from(Class::Vehicle as u8))];
    let options = wgpu::PipelineCompilationOptions { constants: &constants, ..Default::default() };
    let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: None,
        bind_group_layouts: &[Some(layout)],
        immediate_size: 0,
    });
    let target =
        |format| Some(wgpu::ColorTargetState { format, blend: None, write_mask: wgpu::ColorWrites::ALL });
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("ground truth"),
        layout: Some(&layout),
        vertex: wgpu::VertexState {
            module,
            entry_point: Some(vertex),
            compilation_options: options.clone(),
            buffers,
        },
        primitive: wgpu::PrimitiveState { cull_mode, ..Default::default() },
        depth_stencil: Some(wgpu::DepthStencilState {
            format: DEPTH_BUFFER_FORMAT,
            depth_write_enabled: Some(true),
            depth_compare: Some(wgpu::CompareFunction::GreaterEqual),
            stencil: wgpu::StencilState::default(),
            bias: wgpu::DepthBiasState::default(),
        }),
        multisample: wgpu::MultisampleState::default(),
        fragment: Some(wgpu::FragmentState {
            module,
            entry_point: Some(fragment),
            compilation_options: options,
            targets: &[target(DEPTH_MAP_FORMAT), target(LABEL_FORMAT)],
        }),
        multiview_mask: None,
        cache: None,
    })
}

#[cfg(test)]
mod tests {
    use super::gpu_data::View;
    use crate::shader::{Shader, tests::layout, tests::validated};
    use std::mem::offset_of;

    #[test]
    fn the_view_lies_as_the_shader_reads_it() {
        let (offsets, size) = layout(&validated(Shader::GroundTruth), "View");
        let view = [offset_of!(View, clip_from_world), offset_of!(View, depth_from_world)];
        assert_eq!(offsets, view.map(|o| o as u32));
        assert_eq!(size as usize, size_of::<View>());
    }
}
