//! The standing city: front to back, things that rise before the ground that they hide.

use super::common::gpu_data::Frame;
use super::{Attachments, PictureState, picture_pipeline, sampler_entry, texture_entry};
use crate::render::settings::Quality;
use crate::render::shader::Shader;
use crate::render::standing::{SeenCells, Standing};
use crate::render::textures::Paintings;

pub(in crate::render) mod gpu_data {
    use bytemuck::{Pod, Zeroable};

    /// A vertex of the city or of a vehicle.
    #[repr(C)]
    #[derive(Clone, Copy, Debug, Pod, Zeroable)]
    pub(in crate::render) struct Vertex {
        pub(in crate::render) position: [f32; 3],
        pub(in crate::render) normal: [i8; 4],
        /// sRGB; the last is the openness to the sky.
        pub(in crate::render) colour: [u8; 4],
        pub(in crate::render) uv: [f32; 2],
        /// Layer of the texture array in the lowest byte, class in the next, then a number of the piece that
        /// it belongs to; of vehicles part, roughness and metallic.
        pub(in crate::render) material: u32,
    }

    pub(in crate::render) const ATTRIBUTES: [wgpu::VertexAttribute; 5] = wgpu::vertex_attr_array![
        0 => Float32x3, 1 => Snorm8x4, 2 => Unorm8x4, 3 => Float32x2, 4 => Uint32
    ];

    pub(in crate::render) const LAYOUT: wgpu::VertexBufferLayout<'static> = wgpu::VertexBufferLayout {
        array_stride: size_of::<Vertex>() as u64,
        step_mode: wgpu::VertexStepMode::Vertex,
        attributes: &ATTRIBUTES,
    };
}

/// Bind group 2 and the pipeline.
#[derive(Debug)]
pub(in crate::render) struct CityPass {
    pipeline: wgpu::RenderPipeline,
    /// Of what is drawn for itself: see [`crate::render::standing::Apart`].
    apart: wgpu::RenderPipeline,
    /// Where light is worked out at the vertices.
    swift: Option<Swift>,
    surfaces: wgpu::BindGroup,
}

/// Pipelines of their own for parts of the city.
#[derive(Debug)]
struct Swift {
    /// Painted lines.
    lines: wgpu::RenderPipeline,
    /// What shows no pattern.
    plain: wgpu::RenderPipeline,
}

impl CityPass {
    pub(in crate::render) fn new(
        context: &crate::render::Context,
        attachments: Attachments,
        quality: &Quality,
        (fixed, constants): (&Frame, &[(&str, f64)]),
        groups: [&wgpu::BindGroupLayout; 2],
        paintings: &Paintings,
    ) -> Self {
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
        let view = paintings.surfaces(context, attachments);
        // Mesa's software adapter walks an ellipse of texels for anisotropy and does not come back
        // where derivatives are degenerate (seen with 22.3).
        let sampler = device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("surfaces"),
            address_mode_u: wgpu::AddressMode::Repeat,
            address_mode_v: wgpu::AddressMode::Repeat,
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            mipmap_filter: if quality.light_at_vertices {
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
        let module = Shader::City.module(device, Some(fixed));
        let pipeline = |entries| {
            picture_pipeline(
                device,
                attachments,
                &PictureState {
                    shader: Shader::City,
                    module: &module,
                    entries,
                    groups: &[Some(groups[0]), Some(groups[1]), Some(&layout)],
                    buffers: &[Some(gpu_data::LAYOUT)],
                    constants: &constants,
                    topology: wgpu::PrimitiveTopology::TriangleList,
                    cull: true,
                    blend: None,
                    write_depth: true,
                },
            )
        };
        let swift = attachments.light_at_vertices.then(|| Swift {
            lines: pipeline(["swift_line_vertex", "swift_line_fragment"]),
            plain: pipeline(attachments.plain_entries()),
        });
        let apart = pipeline(if attachments.light_at_vertices {
            ["swift_vertex", "swift_averted_fragment"]
        } else {
            ["vertex_main", "crown_fragment"]
        });
        Self { pipeline: pipeline(attachments.entries()), apart, swift, surfaces }
    }

    /// Draws what a view sees; groups 0 and 1 are set already.
    pub(in crate::render) fn draw(
        &self,
        pass: &mut wgpu::RenderPass<'_>,
        standing: &Standing,
        seen: &SeenCells,
    ) {
        pass.set_bind_group(2, &self.surfaces, &[]);
        pass.set_pipeline(&self.pipeline);
        standing.draw(pass, &seen.raised);
        if !seen.apart.is_empty() {
            pass.set_pipeline(&self.apart);
            standing.draw(pass, &seen.apart);
        }
        if let Some(swift) = &self.swift {
            // It is far away, and most of it hidden.
            pass.set_pipeline(&swift.plain);
            standing.draw(pass, &seen.plain);
        }
        // Over the ground, so that the depth test spares the ground under them.
        pass.set_pipeline(self.swift.as_ref().map_or(&self.pipeline, |swift| &swift.lines));
        standing.draw(pass, &seen.lines);
        pass.set_pipeline(&self.pipeline);
        standing.draw(pass, &seen.ground);
    }
}

#[cfg(test)]
mod tests {
    use super::gpu_data::{ATTRIBUTES, Vertex};
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
    }
}
