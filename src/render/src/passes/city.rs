//! Colour pass of the static city: pipelines and texture array; objects are drawn before the ground that they hide.

use super::common::gpu_data::Frame;
use super::{Attachments, ScenePipelineState, sampler_entry, scene_pipeline, texture_entry};
use crate::instances::InstancePart;
use crate::settings::Quality;
use crate::shader::Shader;
use crate::static_scene::{StaticScene, VisibleRanges};
use crate::textures::BakedTextures;

pub(crate) mod gpu_data {
    use bytemuck::{Pod, Zeroable};

    /// A vertex of the city or of a vehicle.
    #[repr(C)]
    #[derive(Clone, Copy, Debug, Pod, Zeroable)]
    pub(crate) struct Vertex {
        pub(crate) position: [f32; 3],
        pub(crate) normal: [i8; 4],
        /// sRGB; alpha: baked ambient visibility.
        pub(crate) colour: [u8; 4],
        pub(crate) uv: [f32; 2],
        /// City: layer of the texture array, class, hash seed of the piece. Vehicle: part, roughness, metallic. A byte
        /// each, the lowest first.
        pub(crate) material: u32,
    }

    pub(crate) const ATTRIBUTES: [wgpu::VertexAttribute; 5] = wgpu::vertex_attr_array![
        0 => Float32x3, 1 => Snorm8x4, 2 => Unorm8x4, 3 => Float32x2, 4 => Uint32
    ];

    pub(crate) const LAYOUT: wgpu::VertexBufferLayout<'static> = wgpu::VertexBufferLayout {
        array_stride: size_of::<Vertex>() as u64,
        step_mode: wgpu::VertexStepMode::Vertex,
        attributes: &ATTRIBUTES,
    };

    /// Instance data of a model of the map.
    #[repr(C)]
    #[derive(Clone, Copy, Debug, Pod, Zeroable)]
    pub(crate) struct Placement {
        /// Affine transform to the city from the model, by rows.
        pub(crate) rows: [[f32; 4]; 3],
        /// Hash seed of the piece, a byte.
        pub(crate) seed: u32,
    }

    pub(crate) const PLACEMENT_ATTRIBUTES: [wgpu::VertexAttribute; 4] = wgpu::vertex_attr_array![
        5 => Float32x4, 6 => Float32x4, 7 => Float32x4, 8 => Uint32
    ];

    pub(crate) const PLACEMENT_LAYOUT: wgpu::VertexBufferLayout<'static> = wgpu::VertexBufferLayout {
        array_stride: size_of::<Placement>() as u64,
        step_mode: wgpu::VertexStepMode::Instance,
        attributes: &PLACEMENT_ATTRIBUTES,
    };
}

/// Pipelines of the static city and bind group 2 with the texture array of surfaces.
#[derive(Debug)]
pub(crate) struct CityPass {
    pipeline: wgpu::RenderPipeline,
    /// Pipeline of the [`crate::geometry::DrawBucket`].
    bucket: wgpu::RenderPipeline,
    /// With vertex lighting.
    vertex_lit: Option<VertexLitPipelines>,
    /// Where the map places models.
    instanced: Option<InstancedPipelines>,
    surfaces: wgpu::BindGroup,
}

/// Additional pipelines of the vertex-lit path.
#[derive(Debug)]
struct VertexLitPipelines {
    /// Painted lines, with analytic anti-aliasing.
    lines: wgpu::RenderPipeline,
    /// Pieces too far away to show their texture.
    untextured: wgpu::RenderPipeline,
    /// Ground too far away to show its texture: with shadows.
    plain: wgpu::RenderPipeline,
}

/// Pipelines of the map's models: those of the city, with a [`gpu_data::Placement`].
#[derive(Debug)]
struct InstancedPipelines {
    pipeline: wgpu::RenderPipeline,
    bucket: wgpu::RenderPipeline,
    /// With vertex lighting.
    untextured: Option<wgpu::RenderPipeline>,
}

/// What the pipelines of the city are made of.
pub(crate) struct CityPassInput<'a> {
    pub(crate) quality: &'a Quality,
    /// Uniforms of the frame that never change.
    pub(crate) frame_constants: &'a Frame,
    /// Pipeline-overridable constants of the light.
    pub(crate) constants: &'a [(&'a str, f64)],
    /// Layouts of the bind groups 0 and 1.
    pub(crate) groups: [&'a wgpu::BindGroupLayout; 2],
    pub(crate) textures: &'a BakedTextures,
    /// Whether the map places models.
    pub(crate) has_instances: bool,
}

/// Share of the light of leaves that ambient occlusion may take, as stored in alpha.
const CROWN_AMBIENT: f64 = 0.4;

/// Colours replace what was there; alpha is [`CROWN_AMBIENT`], the blend constant, of what the leaves cover.
const CROWN_BLEND: wgpu::BlendState = wgpu::BlendState {
    color: wgpu::BlendComponent::REPLACE,
    alpha: wgpu::BlendComponent {
        src_factor: wgpu::BlendFactor::Constant,
        dst_factor: wgpu::BlendFactor::Zero,
        operation: wgpu::BlendOperation::Add,
    },
};

/// Whether a fragment stage is that of crowns near the camera, whose leaves leave gaps.
fn is_crown(fragment: &str) -> bool {
    fragment.ends_with("crown_fragment")
}

impl CityPass {
    pub(crate) fn new(context: &crate::Context, attachments: Attachments, input: &CityPassInput<'_>) -> Self {
        let &CityPassInput { quality, frame_constants, constants, groups, textures, has_instances } = input;
        let device = &context.device;
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("surfaces"),
            entries: &[
                texture_entry(
                    0,
                    wgpu::TextureSampleType::Float { filterable: true },
                    wgpu::TextureViewDimension::D2Array,
                ),
                sampler_entry(1, wgpu::SamplerBindingType::Filtering),
            ],
        });
        let view = textures.surfaces(context, attachments);
        // Anisotropic filtering of Mesa's software adapter does not terminate for degenerate derivatives (seen with
        // 22.3).
        let sampler = device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("surfaces"),
            address_mode_u: wgpu::AddressMode::Repeat,
            address_mode_v: wgpu::AddressMode::Repeat,
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            mipmap_filter: if quality.vertex_lit {
                wgpu::MipmapFilterMode::Nearest
            } else {
                wgpu::MipmapFilterMode::Linear
            },
            anisotropy_clamp: if context.is_software { 1 } else { quality.anisotropy },
            ..Default::default()
        });
        let surfaces = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("surfaces"),
            layout: &layout,
            entries: &[
                wgpu::BindGroupEntry { binding: 0, resource: wgpu::BindingResource::TextureView(&view) },
                wgpu::BindGroupEntry { binding: 1, resource: wgpu::BindingResource::Sampler(&sampler) },
            ],
        });
        let mut constants = constants.to_vec();
        constants.push(("detail", f64::from(u8::from(quality.detail))));
        let module = Shader::City.module(device, Some(frame_constants));
        let placed = |entries: [&str; 2], buffers: &[Option<wgpu::VertexBufferLayout<'static>>]| {
            scene_pipeline(
                device,
                attachments,
                &ScenePipelineState {
                    shader: Shader::City,
                    module: &module,
                    entries,
                    groups: &[Some(groups[0]), Some(groups[1]), Some(&layout)],
                    buffers,
                    constants: &constants,
                    topology: wgpu::PrimitiveTopology::TriangleList,
                    cull_back_faces: true,
                    // Alpha of leaves is what they cover; what is stored is their share of ambient light.
                    blend: is_crown(entries[1]).then_some(CROWN_BLEND),
                    alpha_to_coverage: is_crown(entries[1]),
                    write_depth: true,
                },
            )
        };
        let pipeline = |entries| placed(entries, &[Some(gpu_data::LAYOUT)]);
        let vertex_lit = attachments.vertex_lit.then(|| VertexLitPipelines {
            lines: pipeline(["vertex_lit_line_vertex", "vertex_lit_line_fragment"]),
            untextured: pipeline(attachments.untextured_entries()),
            plain: pipeline(["plain_vertex", "plain_fragment"]),
        });
        let bucket = match (attachments.vertex_lit, attachments.reflects) {
            (true, _) => ["vertex_lit_vertex", "unlit_fragment"],
            (false, true) => ["vertex_main", "reflecting_crown_fragment"],
            (false, false) => ["vertex_main", "crown_fragment"],
        };
        let instanced = |[vertex, fragment]: [&str; 2]| {
            let vertex = format!("instanced_{vertex}");
            placed([&vertex, fragment], &[Some(gpu_data::LAYOUT), Some(gpu_data::PLACEMENT_LAYOUT)])
        };
        let instanced = has_instances.then(|| InstancedPipelines {
            pipeline: instanced(attachments.entries()),
            bucket: instanced(bucket),
            untextured: attachments.vertex_lit.then(|| instanced(attachments.untextured_entries())),
        });
        let (pipeline, bucket) = (pipeline(attachments.entries()), pipeline(bucket));
        Self { pipeline, bucket, vertex_lit, instanced, surfaces }
    }

    /// Draws the visible triangles of a view. The caller has set bind groups 0 and 1.
    pub(crate) fn draw(
        &self,
        pass: &mut wgpu::RenderPass<'_>,
        static_scene: &StaticScene,
        visible: &VisibleRanges,
    ) {
        pass.set_bind_group(2, &self.surfaces, &[]);
        pass.set_blend_constant(wgpu::Color { r: 0.0, g: 0.0, b: 0.0, a: CROWN_AMBIENT });
        pass.set_pipeline(&self.pipeline);
        static_scene.draw(pass, &visible.objects);
        if !visible.bucket.is_empty() {
            pass.set_pipeline(&self.bucket);
            static_scene.draw(pass, &visible.bucket);
        }
        if let Some(vertex_lit) = &self.vertex_lit {
            // These pieces are far away and mostly hidden by the others.
            pass.set_pipeline(&vertex_lit.untextured);
            static_scene.draw(pass, &visible.untextured);
        }
        self.draw_instances(pass, static_scene, visible);
        // Before the ground, so that the depth test rejects the ground under them.
        pass.set_pipeline(self.vertex_lit.as_ref().map_or(&self.pipeline, |vertex_lit| &vertex_lit.lines));
        static_scene.draw(pass, &visible.lines);
        pass.set_pipeline(&self.pipeline);
        static_scene.draw(pass, &visible.ground);
        if let Some(vertex_lit) = &self.vertex_lit {
            pass.set_pipeline(&vertex_lit.plain);
            static_scene.draw(pass, &visible.plain_ground);
        }
    }

    fn draw_instances(
        &self,
        pass: &mut wgpu::RenderPass<'_>,
        static_scene: &StaticScene,
        visible: &VisibleRanges,
    ) {
        let Some(pipelines) = &self.instanced else { return };
        let parts = [
            (Some(&pipelines.pipeline), InstancePart::Textured),
            (Some(&pipelines.bucket), InstancePart::Bucket),
            (pipelines.untextured.as_ref(), InstancePart::Untextured),
        ];
        for (pipeline, part) in parts.into_iter().filter_map(|(pipeline, part)| Some((pipeline?, part))) {
            pass.set_pipeline(pipeline);
            static_scene.instanced().draw(pass, &visible.instances, part);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::gpu_data::{ATTRIBUTES, PLACEMENT_ATTRIBUTES, Placement, Vertex};
    use std::mem::offset_of;

    #[test]
    fn attributes_lie_where_the_vertex_has_them() {
        let offsets = [
            offset_of!(Vertex, position),
            offset_of!(Vertex, normal),
            offset_of!(Vertex, colour),
            offset_of!(Vertex, uv),
            offset_of!(Vertex, material),
        ];
        assert_eq!(ATTRIBUTES.map(|a| a.offset as usize), offsets);
        let last = ATTRIBUTES[4];
        assert_eq!((last.offset + last.format.size()) as usize, size_of::<Vertex>());
        let rows = offset_of!(Placement, rows);
        let offsets = [rows, rows + 16, rows + 32, offset_of!(Placement, seed)];
        assert_eq!(PLACEMENT_ATTRIBUTES.map(|a| a.offset as usize), offsets);
        assert_eq!(size_of::<Placement>(), offset_of!(Placement, seed) + 4);
    }
}
