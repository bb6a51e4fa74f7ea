//! Glow of lamps at night: additive billboards with depth test.

use super::{Attachments, ScenePipelineState, scene_pipeline};
use crate::Context;
use crate::fleet::{FleetRenderer, VisibleVehicle};
use crate::shader::Shader;
use glam::Vec3;
use std::ops::Range;
use wgpu::util::DeviceExt;

pub(crate) mod gpu_data {
    use bytemuck::{Pod, Zeroable};

    #[repr(C)]
    #[derive(Clone, Copy, Debug, Pod, Zeroable)]
    pub(crate) struct Glow {
        /// Centre in the city; w: radius of the glow, metres.
        pub(crate) at: [f32; 4],
        /// Radiance at the centre; w: exponent of the beam, 0 for light to all sides.
        pub(crate) colour: [f32; 4],
        /// Unit vector along the beam.
        pub(crate) ahead: [f32; 4],
    }

    pub(crate) const LAYOUT: wgpu::VertexBufferLayout<'static> = wgpu::VertexBufferLayout {
        array_stride: size_of::<Glow>() as u64,
        step_mode: wgpu::VertexStepMode::Instance,
        attributes: &wgpu::vertex_attr_array![0 => Float32x4, 1 => Float32x4, 2 => Float32x4],
    };
}

use gpu_data::Glow;

/// Glow of a street lamp: radius and radiance.
const STREET_LAMP_RADIUS_M: f32 = 1.5;
const STREET_LAMP_COLOUR: [f32; 4] = [1.30, 0.98, 0.58, 0.0];

/// Pipeline and instances of glows.
#[derive(Debug)]
pub(crate) struct GlowPass {
    pipeline: wgpu::RenderPipeline,
    /// Of the mirror images on wet roads.
    mirrored: Option<wgpu::RenderPipeline>,
    lamps: wgpu::Buffer,
    lamp_count: u32,
    vehicles: wgpu::Buffer,
    /// Instances of each vehicle, in the order of the snapshot.
    of_vehicles: Vec<Range<u32>>,
    /// Instances of traffic signals, in the same buffer.
    of_signals: Range<u32>,
}

impl GlowPass {
    /// With street lamps at these positions, mirrored where the roads are wet.
    pub(crate) fn new(
        device: &wgpu::Device,
        attachments: Attachments,
        frame: &wgpu::BindGroupLayout,
        (lamps, is_wet): (&[Vec3], bool),
    ) -> Self {
        let add = |dst_factor| wgpu::BlendComponent {
            src_factor: wgpu::BlendFactor::One,
            dst_factor,
            operation: wgpu::BlendOperation::Add,
        };
        let keep = wgpu::BlendComponent {
            src_factor: wgpu::BlendFactor::Zero,
            dst_factor: wgpu::BlendFactor::OneMinusSrcAlpha,
            operation: wgpu::BlendOperation::Add,
        };
        // Radiance adds up; displayed colours are screen-blended, which stays below white.
        let (entries, dst_factor) = if attachments.vertex_lit {
            (["vertex_lit_fragment", "mirrored_vertex_lit_fragment"], wgpu::BlendFactor::OneMinusSrc)
        } else {
            (["fragment_main", "mirrored_fragment"], wgpu::BlendFactor::One)
        };
        let module = Shader::Glow.module(device, None);
        let pipeline = |vertex, fragment| {
            scene_pipeline(
                device,
                attachments,
                &ScenePipelineState {
                    shader: Shader::Glow,
                    module: &module,
                    entries: [vertex, fragment],
                    groups: &[Some(frame)],
                    buffers: &[Some(gpu_data::LAYOUT)],
                    constants: &[("bounded", f64::from(u8::from(!attachments.vertex_lit)))],
                    topology: wgpu::PrimitiveTopology::TriangleStrip,
                    cull_back_faces: false,
                    blend: Some(wgpu::BlendState { color: add(dst_factor), alpha: keep }),
                    alpha_to_coverage: false,
                    write_depth: false,
                },
            )
        };
        let street = |lamp: &Vec3| Glow {
            at: lamp.extend(STREET_LAMP_RADIUS_M).to_array(),
            colour: STREET_LAMP_COLOUR,
            ahead: [0.0; 4],
        };
        let street: Vec<Glow> = lamps.iter().map(street).collect();
        Self {
            pipeline: pipeline("vertex_main", entries[0]),
            mirrored: is_wet.then(|| pipeline("mirrored_vertex", entries[1])),
            lamp_count: street.len() as u32,
            lamps: device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
                label: Some("glow of street lamps"),
                contents: bytemuck::cast_slice(&street),
                usage: wgpu::BufferUsages::VERTEX,
            }),
            vehicles: buffer(device, 64 * size_of::<Glow>() as u64),
            of_vehicles: Vec::new(),
            of_signals: 0..0,
        }
    }

    /// Writes the glows of vehicle lamps and of traffic signals of the current snapshot.
    pub(crate) fn write(
        &mut self,
        Context { device, queue, .. }: &Context,
        fleet: &FleetRenderer,
        signals: impl Iterator<Item = Glow>,
    ) {
        let mut glows: Vec<Glow> = signals.collect();
        self.of_signals = 0..glows.len() as u32;
        self.of_vehicles.clear();
        for of_vehicle in fleet.glows() {
            let first = glows.len() as u32;
            glows.extend(of_vehicle);
            self.of_vehicles.push(first..glows.len() as u32);
        }
        let bytes: &[u8] = bytemuck::cast_slice(&glows);
        if bytes.len() as u64 > self.vehicles.size() {
            self.vehicles = buffer(device, (bytes.len() as u64).next_power_of_two());
        }
        queue.write_buffer(&self.vehicles, 0, bytes);
    }

    /// Draws glows over everything else of a view. The caller has set bind group 0.
    pub(crate) fn draw(&self, pass: &mut wgpu::RenderPass<'_>, visible: &[VisibleVehicle]) {
        for pipeline in self.mirrored.iter().chain([&self.pipeline]) {
            pass.set_pipeline(pipeline);
            self.draw_all(pass, visible);
        }
    }

    fn draw_all(&self, pass: &mut wgpu::RenderPass<'_>, visible: &[VisibleVehicle]) {
        if self.lamp_count > 0 {
            pass.set_vertex_buffer(0, self.lamps.slice(..));
            pass.draw(0..4, 0..self.lamp_count);
        }
        pass.set_vertex_buffer(0, self.vehicles.slice(..));
        if !self.of_signals.is_empty() {
            pass.draw(0..4, self.of_signals.clone());
        }
        for glows in visible.iter().filter_map(|vehicle| self.of_vehicles.get(vehicle.index())) {
            pass.draw(0..4, glows.clone());
        }
    }
}

fn buffer(device: &wgpu::Device, size: u64) -> wgpu::Buffer {
    device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("glow of vehicles"),
        size,
        usage: wgpu::BufferUsages::VERTEX | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    })
}
