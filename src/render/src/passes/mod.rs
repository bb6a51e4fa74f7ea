//! Render passes, the bind groups that they share, and the full-screen pass; shaders are in `shaders/`.

pub(super) mod city;
pub(super) mod common;
pub(super) mod contact;
pub(super) mod display;
pub(super) mod glow;
pub(super) mod ground_truth;
pub(super) mod lamps;
pub(super) mod light;
pub(super) mod occlusion;
pub(super) mod overlay;
pub(super) mod palette;
pub(super) mod reflection;
pub(super) mod shadow;
pub(super) mod signals;
pub(super) mod sky;
pub(super) mod standing;
pub(super) mod tiles;
pub(super) mod vehicle;

use super::daylight::Light;
use super::settings::Settings;
use super::shader::{SampleCount, Shader};

/// Depth buffer with reversed depth: 1 at the near plane, 0 at the far one, where floats are densest.
pub(super) const DEPTH_BUFFER_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

/// HDR target: radiance of a sample; alpha is the share of it that ambient occlusion may take.
pub(super) const HDR_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Float;

/// Pixel formats and MSAA samples of the attachments that colour passes draw to.
#[derive(Clone, Copy, Debug)]
pub(super) struct Attachments {
    /// Format of samples: [`HDR_FORMAT`], or `display_format` with vertex lighting.
    pub(super) format: wgpu::TextureFormat,
    /// Format of displayed pixels, without the suffix sRGB: the shaders encode.
    pub(super) display_format: wgpu::TextureFormat,
    /// MSAA samples per pixel.
    pub(super) samples: u32,
    /// Whether there is a second attachment, of [`HDR_FORMAT`], for what smooth surfaces reflect.
    pub(super) reflects: bool,
    /// See [`super::Quality::vertex_lit`]; samples then hold displayed colours.
    pub(super) vertex_lit: bool,
    /// See [`Settings::flat`].
    pub(super) is_flat: bool,
}

impl Attachments {
    pub(super) fn new(settings: &Settings) -> Self {
        let display_format = settings.format.remove_srgb_suffix();
        let vertex_lit = settings.quality.vertex_lit;
        let format = if vertex_lit { display_format } else { HDR_FORMAT };
        let (samples, is_flat) = (settings.quality.samples, settings.flat.is_some());
        let reflects = !vertex_lit && settings.reflection_steps() > 0;
        Self { format, display_format, samples, reflects, vertex_lit, is_flat }
    }

    /// Whether near vehicles have clear glass, which needs light per pixel.
    pub(super) fn has_clear_glass(self) -> bool {
        !self.vertex_lit && !self.is_flat
    }

    /// How shaders read the samples.
    fn sample_count(self) -> SampleCount {
        if self.samples > 1 { SampleCount::Multi } else { SampleCount::Single }
    }

    /// Layout entry of a texture of samples: multisampled or not.
    fn with_sample_count(self, entry: wgpu::BindGroupLayoutEntry) -> wgpu::BindGroupLayoutEntry {
        let ty = match entry.ty {
            wgpu::BindingType::Texture { sample_type, view_dimension, .. } => {
                wgpu::BindingType::Texture { sample_type, view_dimension, multisampled: self.samples > 1 }
            }
            other => other,
        };
        wgpu::BindGroupLayoutEntry { ty, ..entry }
    }

    /// Format of colour textures: sRGB decoding by the sampler, or none for the square roots of the vertex-lit path.
    pub(super) fn texture_format(self) -> wgpu::TextureFormat {
        if self.vertex_lit { wgpu::TextureFormat::Rgba8Unorm } else { wgpu::TextureFormat::Rgba8UnormSrgb }
    }

    /// Entry points for fully vertex-lit surfaces without texture.
    pub(super) fn untextured_entries(self) -> [&'static str; 2] {
        if self.is_flat {
            ["flat_vertex", "flat_fragment"]
        } else {
            ["untextured_vertex", "untextured_fragment"]
        }
    }

    /// Entry points for per-pixel or vertex lighting.
    pub(super) fn entries(self) -> [&'static str; 2] {
        match (self.vertex_lit, self.reflects) {
            (true, _) => ["vertex_lit_vertex", "vertex_lit_fragment"],
            (false, true) => ["vertex_main", "reflecting_fragment"],
            (false, false) => ["vertex_main", "fragment_main"],
        }
    }
}

/// Pipeline-overridable constants of `common.wgsl` and `light.wgsl`.
pub(super) fn light_constants(settings: &Settings, light: &Light) -> [(&'static str, f64); 3] {
    let quality = &settings.quality;
    [
        ("flat_light", f64::from(u8::from(settings.flat.is_some()))),
        ("soft_shadows", f64::from(u8::from(quality.soft_shadows))),
        ("lamplit", f64::from(u8::from(light.is_lamplit()))),
    ]
}

/// Varying state of the pipelines of the colour pass.
pub(super) struct ScenePipelineState<'a> {
    pub(super) shader: Shader,
    /// Module of `shader`, shared by several pipelines.
    pub(super) module: &'a wgpu::ShaderModule,
    /// Entry points of vertex and fragment stage.
    pub(super) entries: [&'a str; 2],
    pub(super) groups: &'a [Option<&'a wgpu::BindGroupLayout>],
    pub(super) buffers: &'a [Option<wgpu::VertexBufferLayout<'a>>],
    pub(super) constants: &'a [(&'a str, f64)],
    pub(super) topology: wgpu::PrimitiveTopology,
    pub(super) cull_back_faces: bool,
    pub(super) blend: Option<wgpu::BlendState>,
    /// Alpha says how many samples of a pixel are covered.
    pub(super) alpha_to_coverage: bool,
    pub(super) write_depth: bool,
}

/// Pipeline of the colour pass: reversed depth test, MSAA, optional back-face culling and blending.
pub(super) fn scene_pipeline(
    device: &wgpu::Device,
    attachments: Attachments,
    state: &ScenePipelineState<'_>,
) -> wgpu::RenderPipeline {
    let module = state.module;
    let options = wgpu::PipelineCompilationOptions { constants: state.constants, ..Default::default() };
    let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: None,
        bind_group_layouts: state.groups,
        immediate_size: 0,
    });
    let mut targets = vec![Some(wgpu::ColorTargetState {
        format: attachments.format,
        blend: state.blend,
        write_mask: wgpu::ColorWrites::ALL,
    })];
    if attachments.reflects {
        // What hides a smooth surface hides its reflection.
        let writes = state.entries[1].starts_with("reflecting_");
        let write_mask = if writes { wgpu::ColorWrites::ALL } else { wgpu::ColorWrites::empty() };
        targets.push(Some(wgpu::ColorTargetState { format: HDR_FORMAT, blend: None, write_mask }));
    }
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
            cull_mode: state.cull_back_faces.then_some(wgpu::Face::Back),
            ..Default::default()
        },
        depth_stencil: Some(wgpu::DepthStencilState {
            format: DEPTH_BUFFER_FORMAT,
            depth_write_enabled: Some(state.write_depth),
            depth_compare: Some(wgpu::CompareFunction::GreaterEqual),
            stencil: wgpu::StencilState::default(),
            bias: wgpu::DepthBiasState::default(),
        }),
        multisample: wgpu::MultisampleState {
            count: attachments.samples,
            alpha_to_coverage_enabled: state.alpha_to_coverage,
            ..Default::default()
        },
        fragment: Some(wgpu::FragmentState {
            module,
            entry_point: Some(state.entries[1]),
            compilation_options: options,
            targets: &targets,
        }),
        multiview_mask: None,
        cache: None,
    })
}

/// Bind group layout entry of a uniform buffer.
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

/// Bind group layout entry of a texture.
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

/// Bind group layout entry of a sampler.
pub(super) fn sampler_entry(binding: u32, ty: wgpu::SamplerBindingType) -> wgpu::BindGroupLayoutEntry {
    wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::VERTEX_FRAGMENT,
        ty: wgpu::BindingType::Sampler(ty),
        count: None,
    }
}
