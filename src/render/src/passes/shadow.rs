//! Shadow map of the sun, shared by all views: orthographic, over the whole city, aligned to whole texels, so that
//! shadow edges do not flicker. The static city is drawn into it once; each tick restores and redraws the patches of
//! vehicles.

use super::{city, common::FrameBindGroup, texture_entry, vehicle};
use crate::fleet::FleetRenderer;
use crate::shader::Shader;
use crate::static_scene::StaticScene;
use glam::{Mat4, Vec2, Vec3};

const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Depth16Unorm;

/// Orthographic projection of the shadow map.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SunView {
    pub(crate) shadow_from_world: Mat4,
    pub(crate) texel_m: f32,
    texels: u32,
}

impl SunView {
    /// Square projection along the sunlight that contains a box of the city, aligned to whole texels.
    pub(crate) fn around([low, high]: [Vec3; 2], to_sun: Vec3, texels: u32) -> Self {
        let right = Vec3::Z.cross(to_sun).normalize_or(Vec3::X);
        let up = to_sun.cross(right);
        let corners = (0..8).map(|k| {
            let pick = |bit: u32, a: f32, b: f32| if k >> bit & 1 == 0 { a } else { b };
            Vec3::new(pick(0, low.x, high.x), pick(1, low.y, high.y), pick(2, low.z, high.z))
        });
        let (mut least, mut most) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for corner in corners {
            let seen = Vec3::new(corner.dot(right), corner.dot(up), -corner.dot(to_sun));
            (least, most) = (least.min(seen), most.max(seen));
        }
        let size = (most - least).truncate().max_element() + 2.0;
        let texel_m = size / texels as f32;
        let middle = ((least + most).truncate() / 2.0 / texel_m).floor() * texel_m;
        let (near, far) = (least.z - 1.0, most.z + 1.0);
        let scale = 2.0 / size;
        let depth = 1.0 / (far - near);
        let (r, u, f) = (right * scale, up * scale, -to_sun * depth);
        let shadow_from_world = Mat4::from_cols(
            Vec3::new(r.x, u.x, f.x).extend(0.0),
            Vec3::new(r.y, u.y, f.y).extend(0.0),
            Vec3::new(r.z, u.z, f.z).extend(0.0),
            Vec3::new(-middle.x * scale, -middle.y * scale, -near * depth).extend(1.0),
        );
        Self { shadow_from_world, texel_m, texels }
    }

    /// Texels that the shadow of a box with these corners can touch: left, top, width, height.
    fn patch(&self, corners: [Vec3; 8]) -> [u32; 4] {
        const MARGIN: f32 = 2.0;
        let most = self.texels as f32;
        let at = corners.map(|corner| {
            let seen = self.shadow_from_world.project_point3(corner).truncate();
            (seen * Vec2::new(0.5, -0.5) + 0.5) * most
        });
        let low = at.into_iter().fold(Vec2::INFINITY, Vec2::min) - MARGIN;
        let high = at.into_iter().fold(Vec2::NEG_INFINITY, Vec2::max) + MARGIN;
        let low = low.floor().clamp(Vec2::ZERO, Vec2::splat(most));
        let high = high.ceil().clamp(Vec2::ZERO, Vec2::splat(most));
        [low.x, low.y, high.x - low.x, high.y - low.y].map(|x| x as u32)
    }
}

/// Pipelines and textures of the shadow map.
#[derive(Debug)]
pub(crate) struct ShadowPass {
    /// The map that colour passes read.
    pub(crate) map: wgpu::TextureView,
    static_map: wgpu::TextureView,
    restore_group: wgpu::BindGroup,
    city: wgpu::RenderPipeline,
    /// Models of the map.
    instanced: wgpu::RenderPipeline,
    vehicles: wgpu::RenderPipeline,
    restore: wgpu::RenderPipeline,
    sun: SunView,
    /// Patches that hold shadows of vehicles since the last tick.
    vehicle_patches: Vec<[u32; 4]>,
}

impl ShadowPass {
    pub(crate) fn new(device: &wgpu::Device, frame: &wgpu::BindGroupLayout, sun: SunView) -> Self {
        let texture = |label| {
            device
                .create_texture(&wgpu::TextureDescriptor {
                    label: Some(label),
                    size: wgpu::Extent3d { width: sun.texels, height: sun.texels, depth_or_array_layers: 1 },
                    mip_level_count: 1,
                    sample_count: 1,
                    dimension: wgpu::TextureDimension::D2,
                    format: FORMAT,
                    usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING,
                    view_formats: &[],
                })
                .create_view(&wgpu::TextureViewDescriptor::default())
        };
        let (map, static_map) = (texture("shadow map"), texture("static shadow map"));
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("static shadow map"),
            entries: &[texture_entry(0, wgpu::TextureSampleType::Depth, wgpu::TextureViewDimension::D2)],
        });
        let restore_group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("static shadow map"),
            layout: &layout,
            entries: &[wgpu::BindGroupEntry {
                binding: 0,
                resource: wgpu::BindingResource::TextureView(&static_map),
            }],
        });
        let module = Shader::Shadow.module(device, None);
        let pipeline = |entry: &str,
                        groups: &[Option<&wgpu::BindGroupLayout>],
                        buffers: &[Option<wgpu::VertexBufferLayout<'_>>]| {
            let restore = buffers.is_empty();
            let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: Some(entry),
                bind_group_layouts: groups,
                immediate_size: 0,
            });
            let slope = if restore { 0.0 } else { 1.5 };
            device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
                label: Some(entry),
                layout: Some(&layout),
                vertex: wgpu::VertexState {
                    module: &module,
                    entry_point: Some(entry),
                    compilation_options: wgpu::PipelineCompilationOptions::default(),
                    buffers,
                },
                primitive: wgpu::PrimitiveState {
                    topology: if restore {
                        wgpu::PrimitiveTopology::TriangleStrip
                    } else {
                        wgpu::PrimitiveTopology::TriangleList
                    },
                    ..Default::default()
                },
                depth_stencil: Some(wgpu::DepthStencilState {
                    format: FORMAT,
                    depth_write_enabled: Some(true),
                    depth_compare: Some(if restore {
                        wgpu::CompareFunction::Always
                    } else {
                        wgpu::CompareFunction::LessEqual
                    }),
                    stencil: wgpu::StencilState::default(),
                    bias: wgpu::DepthBiasState { constant: 0, slope_scale: slope, clamp: 0.0 },
                }),
                multisample: wgpu::MultisampleState::default(),
                fragment: restore.then_some(wgpu::FragmentState {
                    module: &module,
                    entry_point: Some("restore_fragment"),
                    compilation_options: wgpu::PipelineCompilationOptions::default(),
                    targets: &[],
                }),
                multiview_mask: None,
                cache: None,
            })
        };
        let mesh = Some(city::gpu_data::LAYOUT);
        Self {
            city: pipeline("city_vertex", &[Some(frame)], std::slice::from_ref(&mesh)),
            instanced: pipeline(
                "instanced_vertex",
                &[Some(frame)],
                &[mesh.clone(), Some(city::gpu_data::PLACEMENT_LAYOUT)],
            ),
            vehicles: pipeline("instanced_vertex", &[Some(frame)], &[mesh, Some(vehicle::gpu_data::LAYOUT)]),
            restore: pipeline("restore_vertex", &[Some(frame), Some(&layout)], &[]),
            vehicle_patches: vec![[0, 0, sun.texels, sun.texels]],
            map,
            static_map,
            restore_group,
            sun,
        }
    }

    /// Draws the static city, once.
    pub(crate) fn draw_static(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        frame: &FrameBindGroup,
        static_scene: &StaticScene,
    ) {
        let mut pass = begin_pass(encoder, &self.static_map, wgpu::LoadOp::Clear(1.0));
        pass.set_pipeline(&self.city);
        pass.set_bind_group(0, &frame.group, &[0]);
        self.scissor_rim(&mut pass);
        static_scene.draw_shadows(&mut pass);
        pass.set_pipeline(&self.instanced);
        static_scene.instanced().draw_shadows(&mut pass, self.sun.texel_m);
    }

    /// Leaves the outermost texels clear: clamped lookups beyond the map read them as lit.
    fn scissor_rim(&self, pass: &mut wgpu::RenderPass<'_>) {
        let inside = self.sun.texels.saturating_sub(2).max(1);
        pass.set_scissor_rect(1, 1, inside, inside);
    }

    /// Restores the patches of the last tick and draws the vehicles of this one.
    pub(crate) fn draw_vehicles(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        frame: &FrameBindGroup,
        fleet: &FleetRenderer,
    ) {
        let mut pass = begin_pass(encoder, &self.map, wgpu::LoadOp::Load);
        pass.set_bind_group(0, &frame.group, &[0]);
        pass.set_pipeline(&self.restore);
        pass.set_bind_group(1, &self.restore_group, &[]);
        for &[x, y, width, height] in self.vehicle_patches.iter().filter(|p| p[2] > 0 && p[3] > 0) {
            pass.set_scissor_rect(x, y, width, height);
            pass.draw(0..4, 0..1);
        }
        self.scissor_rim(&mut pass);
        self.vehicle_patches.clear();
        self.vehicle_patches.extend(fleet.shadow_boxes().map(|corners| self.sun.patch(corners)));
        pass.set_pipeline(&self.vehicles);
        fleet.draw_shadows(&mut pass, self.sun.texel_m);
    }
}

fn begin_pass<'a>(
    encoder: &'a mut wgpu::CommandEncoder,
    view: &wgpu::TextureView,
    load: wgpu::LoadOp<f32>,
) -> wgpu::RenderPass<'a> {
    encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: Some("shadow"),
        depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
            view,
            depth_ops: Some(wgpu::Operations { load, store: wgpu::StoreOp::Store }),
            stencil_ops: None,
        }),
        ..Default::default()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_suns_view_holds_the_box_and_nearer_to_the_sun_is_less() {
        let to_sun = Vec3::new(-0.5, -0.5, 0.7).normalize_or(Vec3::Z);
        let (low, high) = (Vec3::new(-76.0, -70.0, 0.0), Vec3::new(76.0, 80.0, 20.0));
        let sun = SunView::around([low, high], to_sun, 4096);
        for corner in [low, high, Vec3::new(low.x, high.y, 0.0), Vec3::new(high.x, low.y, 20.0)] {
            let p = sun.shadow_from_world.project_point3(corner);
            assert!(p.truncate().abs().max_element() <= 1.0 && (0.0..=1.0).contains(&p.z), "{corner} {p}");
        }
        let near = sun.shadow_from_world.project_point3(to_sun * 10.0).z;
        assert!(near < sun.shadow_from_world.project_point3(Vec3::ZERO).z);
        // Texel and metre agree.
        let right = Vec3::Z.cross(to_sun).normalize_or(Vec3::X);
        let step = sun.shadow_from_world.transform_vector3(right * sun.texel_m).x;
        assert!((step * 2048.0 - 1.0).abs() < 1e-3, "{step}");
    }
}
