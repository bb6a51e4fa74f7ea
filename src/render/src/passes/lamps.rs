//! Light map of lamps: light of street lamps and vehicles on the ground, drawn from above and shared by all views.
//! Street lamps are drawn once; at each tick vehicles are added to a copy.

use super::{common::FrameBindGroup, vehicle};
use crate::Context;
use crate::fleet::FleetRenderer;
use crate::shader::Shader;
use city3d_scene::{SceneDescription, Wall};
use glam::{Vec2, Vec3};
use wgpu::util::DeviceExt;

const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Float;
/// Margin of the map around the city: clamped lookups outside of it read no light.
const MARGIN_M: f32 = 18.0;
/// Reach of the light of street lamps and of vehicles.
pub(crate) const LAMP_REACH_M: f32 = 17.0;
const BEAM_REACH_M: f32 = 44.0;
/// Lower walls block no light.
const LOWEST_WALL_M: f32 = 2.5;

/// Walls of a lamp in the list of walls: first and count.
type WallRange = [u32; 2];

/// Walls that may block the light of lamps, one list per lamp.
#[derive(Debug, Default)]
struct LampOccluders {
    walls: Vec<[f32; 4]>,
    ranges: Vec<WallRange>,
}

impl LampOccluders {
    /// Adds the walls within reach of a lamp that face it; a wall that faces away is behind one that does.
    fn add(&mut self, walls: &[Wall], lamp: Vec2, reach_m: f32) {
        let first = self.walls.len();
        let near = walls.iter().filter(|wall| {
            let along = wall.to - wall.from;
            let is_front = (lamp - wall.from).perp_dot(along) > 0.0;
            let part = ((lamp - wall.from).dot(along) / along.length_squared().max(1e-6)).clamp(0.0, 1.0);
            let distance_m = (wall.from + along * part).distance(lamp);
            is_front && distance_m < reach_m && wall.height_m > LOWEST_WALL_M
        });
        self.walls.extend(near.map(|wall| [wall.from.x, wall.from.y, wall.to.x, wall.to.y]));
        self.ranges.push([first as u32, (self.walls.len() - first) as u32]);
    }
}

/// Pipelines and textures of the light map.
#[derive(Debug)]
pub(crate) struct LampPass {
    /// The map that colour passes read.
    pub(crate) map_view: wgpu::TextureView,
    /// Texture coordinates from city metres: factor (xy) and offset (zw).
    pub(crate) uv_from_world: [f32; 4],
    map: wgpu::Texture,
    static_map: wgpu::Texture,
    lamps: wgpu::RenderPipeline,
    beams: wgpu::RenderPipeline,
    positions: wgpu::Buffer,
    count: u32,
    walls: Vec<Wall>,
    /// Whether walls block the light of vehicles.
    beams_occluded: bool,
    layout: wgpu::BindGroupLayout,
    street: LampOccluderBuffers,
    traffic: LampOccluderBuffers,
}

/// Storage and vertex buffer of [`LampOccluders`].
#[derive(Debug)]
struct LampOccluderBuffers {
    walls: wgpu::Buffer,
    ranges: wgpu::Buffer,
    group: wgpu::BindGroup,
}

impl LampOccluderBuffers {
    fn new(device: &wgpu::Device, layout: &wgpu::BindGroupLayout, [walls, ranges]: [u64; 2]) -> Self {
        let buffer = |label, size, usage| {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size,
                usage: usage | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            })
        };
        let walls = buffer("walls near lamps", walls.max(16), wgpu::BufferUsages::STORAGE);
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("walls near lamps"),
            layout,
            entries: &[wgpu::BindGroupEntry { binding: 0, resource: walls.as_entire_binding() }],
        });
        let ranges = buffer("lists of walls", ranges.max(8), wgpu::BufferUsages::VERTEX);
        Self { walls, ranges, group }
    }

    /// Uploads lists and grows the buffers if necessary.
    fn write(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        layout: &wgpu::BindGroupLayout,
        occluders: &LampOccluders,
    ) {
        let walls: &[u8] = bytemuck::cast_slice(&occluders.walls);
        let ranges: &[u8] = bytemuck::cast_slice(&occluders.ranges);
        let sizes = [walls.len() as u64, ranges.len() as u64];
        if sizes[0] > self.walls.size() || sizes[1] > self.ranges.size() {
            *self = Self::new(device, layout, sizes.map(u64::next_power_of_two));
        }
        queue.write_buffer(&self.walls, 0, walls);
        queue.write_buffer(&self.ranges, 0, ranges);
    }
}

impl LampPass {
    pub(crate) fn new(
        device: &wgpu::Device,
        frame: &wgpu::BindGroupLayout,
        scene: &SceneDescription,
        (texels, beams_occluded): (u32, bool),
    ) -> Self {
        let texture = |label, usage| {
            device.create_texture(&wgpu::TextureDescriptor {
                label: Some(label),
                size: wgpu::Extent3d { width: texels, height: texels, depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format: FORMAT,
                usage: usage | wgpu::TextureUsages::RENDER_ATTACHMENT,
                view_formats: &[],
            })
        };
        let map = texture("lamplight", wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST);
        let static_map = texture("light of street lamps", wgpu::TextureUsages::COPY_SRC);
        let positions: Vec<[f32; 3]> = scene.lamps.iter().map(|lamp| lamp.to_array()).collect();
        let lamp_layout = wgpu::VertexBufferLayout {
            array_stride: size_of::<[f32; 3]>() as u64,
            step_mode: wgpu::VertexStepMode::Instance,
            attributes: &wgpu::vertex_attr_array![0 => Float32x3],
        };
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("walls near lamps"),
            entries: &[wgpu::BindGroupLayoutEntry {
                binding: 0,
                visibility: wgpu::ShaderStages::FRAGMENT,
                ty: wgpu::BindingType::Buffer {
                    ty: wgpu::BufferBindingType::Storage { read_only: true },
                    has_dynamic_offset: false,
                    min_binding_size: None,
                },
                count: None,
            }],
        });
        let empty = || LampOccluderBuffers::new(device, &layout, [0, 0]);
        let lists = wgpu::VertexBufferLayout {
            array_stride: size_of::<WallRange>() as u64,
            step_mode: wgpu::VertexStepMode::Instance,
            attributes: &wgpu::vertex_attr_array![10 => Uint32x2],
        };
        let groups = [frame, &layout];
        let lamps = [lamp_layout, lists.clone()].map(Some);
        let beams = [vehicle::gpu_data::LAYOUT, lists].map(Some);
        Self {
            map_view: map.create_view(&wgpu::TextureViewDescriptor::default()),
            uv_from_world: uv_from_world(scene),
            map,
            static_map,
            lamps: pipeline(device, groups, ["lamp_vertex", "lamp_fragment"], &lamps),
            beams: pipeline(device, groups, ["beam_vertex", "beam_fragment"], &beams),
            walls: scene.walls.clone(),
            beams_occluded,
            street: empty(),
            traffic: empty(),
            count: positions.len() as u32,
            positions: device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
                label: Some("street lamps"),
                contents: bytemuck::cast_slice(&positions),
                usage: wgpu::BufferUsages::VERTEX,
            }),
            layout,
        }
    }

    /// Draws the street lamps into the static map.
    pub(crate) fn draw_static(
        &mut self,
        Context { device, queue, .. }: &Context,
        encoder: &mut wgpu::CommandEncoder,
        frame: &FrameBindGroup,
        lamps: &[Vec3],
    ) {
        let mut occluders = LampOccluders::default();
        for lamp in lamps {
            occluders.add(&self.walls, lamp.truncate(), LAMP_REACH_M);
        }
        self.street.write(device, queue, &self.layout, &occluders);
        let clear = wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT);
        let mut pass = begin_pass(encoder, &self.static_map, clear);
        if self.count > 0 {
            pass.set_pipeline(&self.lamps);
            pass.set_bind_group(0, &frame.group, &[0]);
            pass.set_bind_group(1, &self.street.group, &[]);
            pass.set_vertex_buffer(0, self.positions.slice(..));
            pass.set_vertex_buffer(1, self.street.ranges.slice(..));
            pass.draw(0..4, 0..self.count);
        }
    }

    /// Copies the static map and adds the light of vehicles.
    pub(crate) fn draw_vehicles(
        &mut self,
        Context { device, queue, .. }: &Context,
        encoder: &mut wgpu::CommandEncoder,
        frame: &FrameBindGroup,
        fleet: &FleetRenderer,
    ) {
        let walls: &[Wall] = if self.beams_occluded { &self.walls } else { &[] };
        let mut occluders = LampOccluders::default();
        for (centre, _) in fleet.bounding_spheres() {
            occluders.add(walls, centre.truncate(), BEAM_REACH_M);
        }
        self.traffic.write(device, queue, &self.layout, &occluders);
        encoder.copy_texture_to_texture(
            self.static_map.as_image_copy(),
            self.map.as_image_copy(),
            self.map.size(),
        );
        let mut pass = begin_pass(encoder, &self.map, wgpu::LoadOp::Load);
        pass.set_pipeline(&self.beams);
        pass.set_bind_group(0, &frame.group, &[0]);
        pass.set_bind_group(1, &self.traffic.group, &[]);
        pass.set_vertex_buffer(1, self.traffic.ranges.slice(..));
        fleet.draw_beams(&mut pass);
    }
}

fn uv_from_world(scene: &SceneDescription) -> [f32; 4] {
    let [low, high] = scene.bounds.map(|corner| corner.truncate());
    let (low, size) = (low - MARGIN_M, (high - low).max_element().max(1.0) + 2.0 * MARGIN_M);
    [1.0 / size, 1.0 / size, -low.x / size, -low.y / size]
}

fn begin_pass<'a>(
    encoder: &'a mut wgpu::CommandEncoder,
    texture: &wgpu::Texture,
    load: wgpu::LoadOp<wgpu::Color>,
) -> wgpu::RenderPass<'a> {
    let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
    encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: Some("lamplight"),
        color_attachments: &[Some(wgpu::RenderPassColorAttachment {
            view: &view,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations { load, store: wgpu::StoreOp::Store },
        })],
        ..Default::default()
    })
}

fn pipeline(
    device: &wgpu::Device,
    groups: [&wgpu::BindGroupLayout; 2],
    [vertex, fragment]: [&str; 2],
    buffers: &[Option<wgpu::VertexBufferLayout<'_>>],
) -> wgpu::RenderPipeline {
    let module = Shader::Lamps.module(device, None);
    let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some(vertex),
        bind_group_layouts: &groups.map(Some),
        immediate_size: 0,
    });
    let one = wgpu::BlendComponent {
        src_factor: wgpu::BlendFactor::One,
        dst_factor: wgpu::BlendFactor::One,
        operation: wgpu::BlendOperation::Add,
    };
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some(vertex),
        layout: Some(&layout),
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: Some(vertex),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            buffers,
        },
        primitive: wgpu::PrimitiveState {
            topology: wgpu::PrimitiveTopology::TriangleStrip,
            ..Default::default()
        },
        depth_stencil: None,
        multisample: wgpu::MultisampleState::default(),
        fragment: Some(wgpu::FragmentState {
            module: &module,
            entry_point: Some(fragment),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            targets: &[Some(wgpu::ColorTargetState {
                format: FORMAT,
                blend: Some(wgpu::BlendState { color: one, alpha: one }),
                write_mask: wgpu::ColorWrites::ALL,
            })],
        }),
        multiview_mask: None,
        cache: None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn walls_that_show_a_lamp_their_front_are_listed_and_no_others() {
        // Counter-clockwise around a building, as the scene has them.
        let corners = [[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]].map(Vec2::from);
        let wall = |k: usize| Wall { from: corners[k], to: corners[(k + 1) % 4], height_m: 6.0 };
        let walls: Vec<Wall> = (0..4).map(wall).collect();
        let mut occluders = LampOccluders::default();
        occluders.add(&walls, Vec2::new(5.0, -3.0), 17.0);
        occluders.add(&walls, Vec2::new(-40.0, 5.0), 17.0);
        occluders.add(&walls, Vec2::new(14.0, 14.0), 17.0);
        assert_eq!(occluders.ranges, [[0, 1], [1, 0], [1, 2]]);
        assert_eq!(occluders.walls[0], [0.0, 0.0, 10.0, 0.0]);
        let low = Wall { height_m: 1.0, ..walls[0] };
        occluders.add(&[low], Vec2::new(5.0, -3.0), 17.0);
        assert_eq!(occluders.ranges[3], [3, 0]);
    }
}
