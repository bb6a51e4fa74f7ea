//! One file a pass, each with its shader of the same name in `shaders/`.

pub(super) mod city;
pub(super) mod common;
pub(super) mod contact;
pub(super) mod display;
pub(super) mod glow;
pub(super) mod kinds;
pub(super) mod lamps;
pub(super) mod light;
pub(super) mod occlusion;
pub(super) mod shadow;
pub(super) mod sky;
pub(super) mod tiles;
pub(super) mod vehicle;

use super::daylight::Light;
use super::settings::Settings;
use super::shader::{Samples, Shader};

/// Depth of the picture: 1 at the near plane, 0 at the far one, where floats are densest.
pub(super) const DEPTH: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

/// Radiance of a sample; alpha is the share of it that ambient occlusion may take.
const RADIANCE: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Float;

/// The attachments that the passes of a picture are built for.
#[derive(Clone, Copy, Debug)]
pub(super) struct Attachments {
    /// Of samples: radiance, or what is shown.
    pub(super) format: wgpu::TextureFormat,
    /// Of pixels that are shown. The shaders encode as sRGB.
    pub(super) shown: wgpu::TextureFormat,
    pub(super) samples: u32,
    /// See [`super::Quality::light_at_vertices`]; samples hold what is shown.
    pub(super) light_at_vertices: bool,
    /// See [`Settings::flat`].
    pub(super) is_flat: bool,
}

impl Attachments {
    pub(super) fn new(settings: &Settings) -> Self {
        let shown = settings.format.remove_srgb_suffix();
        let light_at_vertices = settings.quality.light_at_vertices;
        let format = if light_at_vertices { shown } else { RADIANCE };
        let (samples, is_flat) = (settings.quality.samples, settings.flat.is_some());
        Self { format, shown, samples, light_at_vertices, is_flat }
    }

    /// How shaders read samples.
    fn reading(self) -> Samples {
        if self.samples > 1 { Samples::Many } else { Samples::One }
    }

    /// The entry of a texture of samples in a layout.
    fn sampled(self, entry: wgpu::BindGroupLayoutEntry) -> wgpu::BindGroupLayoutEntry {
        let ty = match entry.ty {
            wgpu::BindingType::Texture { sample_type, view_dimension, .. } => {
                wgpu::BindingType::Texture { sample_type, view_dimension, multisampled: self.samples > 1 }
            }
            other => other,
        };
        wgpu::BindGroupLayoutEntry { ty, ..entry }
    }

    /// What a texture of colours is made as, so that what is sampled suits the shaders.
    pub(super) fn texture_format(self) -> wgpu::TextureFormat {
        if self.light_at_vertices {
            wgpu::TextureFormat::Rgba8Unorm
        } else {
            wgpu::TextureFormat::Rgba8UnormSrgb
        }
    }

    /// Entry points for what is lit at its vertices for good.
    pub(super) fn plain_entries(self) -> [&'static str; 2] {
        if self.is_flat { ["flat_vertex", "flat_fragment"] } else { ["plain_vertex", "plain_fragment"] }
    }

    /// Entry points of a shader that has a pair for either way to light.
    pub(super) fn entries(self) -> [&'static str; 2] {
        if self.light_at_vertices {
            ["swift_vertex", "swift_fragment"]
        } else {
            ["vertex_main", "fragment_main"]
        }
    }
}

/// What the shaders of solid things are told for good: `common.wgsl` and `light.wgsl` have them as overrides.
pub(super) fn light_constants(settings: &Settings, light: &Light) -> [(&'static str, f64); 3] {
    let quality = &settings.quality;
    [
        ("flat_light", f64::from(u8::from(settings.flat.is_some()))),
        ("soft_shadows", f64::from(u8::from(quality.soft_shadows))),
        ("lamplit", f64::from(u8::from(light.is_lamplit()))),
    ]
}

/// What differs between the pipelines of a picture.
pub(super) struct PictureState<'a> {
    pub(super) shader: Shader,
    /// Of the shader: made once where several pipelines need it.
    pub(super) module: &'a wgpu::ShaderModule,
    /// Of vertices and of fragments.
    pub(super) entries: [&'a str; 2],
    pub(super) groups: &'a [Option<&'a wgpu::BindGroupLayout>],
    pub(super) buffers: &'a [Option<wgpu::VertexBufferLayout<'a>>],
    pub(super) constants: &'a [(&'a str, f64)],
    pub(super) topology: wgpu::PrimitiveTopology,
    pub(super) cull: bool,
    pub(super) blend: Option<wgpu::BlendState>,
    pub(super) write_depth: bool,
}

pub(super) fn picture_pipeline(
    device: &wgpu::Device,
    attachments: Attachments,
    state: &PictureState<'_>,
) -> wgpu::RenderPipeline {
    let module = state.module;
    let options = wgpu::PipelineCompilationOptions { constants: state.constants, ..Default::default() };
    let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: None,
        bind_group_layouts: state.groups,
        immediate_size: 0,
    });
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some(&format!("{:?}", state.shader)),
        layout: Some(&layout),
        vertex: wgpu::VertexState {
            module,
            entry_point: Some(state.entries[0]),
            compilation_options: options.clone(),
            buffers: state.buffers,
        },
        primitive: wgpu::PrimitiveState {
            topology: state.topology,
            cull_mode: state.cull.then_some(wgpu::Face::Back),
            ..Default::default()
        },
        depth_stencil: Some(wgpu::DepthStencilState {
            format: DEPTH,
            depth_write_enabled: Some(state.write_depth),
            depth_compare: Some(wgpu::CompareFunction::GreaterEqual),
            stencil: wgpu::StencilState::default(),
            bias: wgpu::DepthBiasState::default(),
        }),
        multisample: wgpu::MultisampleState { count: attachments.samples, ..Default::default() },
        fragment: Some(wgpu::FragmentState {
            module,
            entry_point: Some(state.entries[1]),
            compilation_options: options,
            targets: &[Some(wgpu::ColorTargetState {
                format: attachments.format,
                blend: state.blend,
                write_mask: wgpu::ColorWrites::ALL,
            })],
        }),
        multiview_mask: None,
        cache: None,
    })
}

/// A uniform buffer's entry in a layout.
pub(super) fn uniform_entry(binding: u32, dynamic: bool, size: u64) -> wgpu::BindGroupLayoutEntry {
    wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::VERTEX_FRAGMENT,
        ty: wgpu::BindingType::Buffer {
            ty: wgpu::BufferBindingType::Uniform,
            has_dynamic_offset: dynamic,
            min_binding_size: wgpu::BufferSize::new(size),
        },
        count: None,
    }
}

/// A texture's entry in a layout.
pub(super) fn texture_entry(
    binding: u32,
    sample_type: wgpu::TextureSampleType,
    view_dimension: wgpu::TextureViewDimension,
) -> wgpu::BindGroupLayoutEntry {
    wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::VERTEX_FRAGMENT,
        ty: wgpu::BindingType::Texture { sample_type, view_dimension, multisampled: false },
        count: None,
    }
}

/// A sampler's entry in a layout.
pub(super) fn sampler_entry(binding: u32, ty: wgpu::SamplerBindingType) -> wgpu::BindGroupLayoutEntry {
    wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::VERTEX_FRAGMENT,
        ty: wgpu::BindingType::Sampler(ty),
        count: None,
    }
}
