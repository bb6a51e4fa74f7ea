//! Depth, class and vehicle of each pixel: the city and the vehicles once more, into numbers.

use super::{DEPTH, city, uniform_entry, vehicle};
use crate::camera::View as CameraView;
use crate::city::scene::Class;
use crate::render::fleet::Fleet;
use crate::render::grid::Tile;
use crate::render::shader::Shader;
use crate::render::stage::Seen;
use crate::render::standing::Standing;

/// Metres along the optical axis; [`NOTHING`] where nothing is seen.
pub(in crate::render) const DEPTH_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::R32Float;
/// Class and vehicle.
pub(in crate::render) const MEANING_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rg16Uint;
/// The depth of the sky: below that of all that can be seen.
pub(in crate::render) const NOTHING: f64 = -1.0;

/// Distance between the slots of two views: the alignment that every adapter accepts.
const SLOT: usize = 256;

pub(in crate::render) mod gpu_data {
    use bytemuck::{Pod, Zeroable};

    #[repr(C)]
    #[derive(Clone, Copy, Debug, Pod, Zeroable)]
    pub(in crate::render) struct View {
        pub(in crate::render) clip_from_world: [[f32; 4]; 4],
        pub(in crate::render) depth_from_world: [f32; 4],
    }
}

/// Pipelines for what stands, for painted lines and for what drives, and a uniform slot for each view.
#[derive(Debug)]
pub(in crate::render) struct KindsPass {
    city: wgpu::RenderPipeline,
    lines: wgpu::RenderPipeline,
    vehicles: wgpu::RenderPipeline,
    layout: wgpu::BindGroupLayout,
    slots: Option<Slots>,
}

#[derive(Debug)]
struct Slots {
    buffer: wgpu::Buffer,
    group: wgpu::BindGroup,
    capacity: usize,
}

impl KindsPass {
    pub(in crate::render) fn new(device: &wgpu::Device) -> Self {
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("view of kinds"),
            entries: &[uniform_entry(0, true, size_of::<gpu_data::View>() as u64)],
        });
        let module = Shader::Kinds.module(device, None);
        let pipeline = |entries, buffers: &[Option<wgpu::VertexBufferLayout<'_>>]| {
            pipeline(device, &layout, &module, entries, buffers)
        };
        Self {
            city: pipeline(["city_main", "fragment_main"], &[Some(city::gpu_data::LAYOUT)]),
            lines: pipeline(["line_main", "line_fragment"], &[Some(city::gpu_data::LAYOUT)]),
            vehicles: pipeline(
                ["vehicle_main", "fragment_main"],
                &[Some(city::gpu_data::LAYOUT), Some(vehicle::gpu_data::LAYOUT)],
            ),
            layout,
            slots: None,
        }
    }

    /// Writes the views of a submission; each is drawn with its place among them.
    pub(in crate::render) fn write(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        views: &[CameraView],
    ) {
        let count = views.len();
        let mut bytes = vec![0_u8; count * SLOT];
        for (slot, view) in bytes.chunks_exact_mut(SLOT).zip(views) {
            slot[..size_of::<gpu_data::View>()].copy_from_slice(bytemuck::bytes_of(&view_data(view)));
        }
        if self.slots.as_ref().is_none_or(|slots| slots.capacity < count) {
            self.slots = Some(Slots::new(device, &self.layout, count.next_power_of_two().max(16)));
        }
        if let Some(slots) = &self.slots {
            queue.write_buffer(&slots.buffer, 0, &bytes);
        }
    }

    /// Draws one of the views that were written. Vehicles first: they hide much and are few.
    pub(in crate::render) fn draw(
        &self,
        pass: &mut wgpu::RenderPass<'_>,
        (tile, view): (Tile, usize),
        (standing, fleet): (&Standing, &Fleet),
        seen: &Seen,
    ) {
        let Some(slots) = &self.slots else { return };
        tile.enter(pass);
        pass.set_bind_group(0, &slots.group, &[(view * SLOT) as u32]);
        pass.set_pipeline(&self.vehicles);
        fleet.draw(pass, &seen.vehicles);
        tile.keep_to(pass, seen.open_rows);
        pass.set_pipeline(&self.city);
        for raised in seen.cells.all_raised() {
            standing.draw(pass, raised);
        }
        standing.draw(pass, &seen.cells.ground);
        pass.set_pipeline(&self.lines);
        standing.draw(pass, &seen.cells.lines);
    }
}

impl Slots {
    fn new(device: &wgpu::Device, layout: &wgpu::BindGroupLayout, capacity: usize) -> Self {
        let buffer = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("views of kinds"),
            size: (capacity * SLOT) as u64,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("view of kinds"),
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
    layout: &wgpu::BindGroupLayout,
    module: &wgpu::ShaderModule,
    [vertex, fragment]: [&str; 2],
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
        label: Some("kinds"),
        layout: Some(&layout),
        vertex: wgpu::VertexState {
            module,
            entry_point: Some(vertex),
            compilation_options: options.clone(),
            buffers,
        },
        primitive: wgpu::PrimitiveState { cull_mode: Some(wgpu::Face::Back), ..Default::default() },
        depth_stencil: Some(wgpu::DepthStencilState {
            format: DEPTH,
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
            targets: &[target(DEPTH_FORMAT), target(MEANING_FORMAT)],
        }),
        multiview_mask: None,
        cache: None,
    })
}

#[cfg(test)]
mod tests {
    use super::gpu_data::View;
    use crate::render::shader::{Shader, tests::layout, tests::validated};
    use std::mem::offset_of;

    #[test]
    fn the_view_lies_as_the_shader_reads_it() {
        let (offsets, size) = layout(&validated(Shader::Kinds), "View");
        let view = [offset_of!(View, clip_from_world), offset_of!(View, depth_from_world)];
        assert_eq!(offsets, view.map(|o| o as u32));
        assert_eq!(size as usize, size_of::<View>());
    }
}
