//! What a renderer is built for: quality, time of day, pixel format.

use super::Daylight;
use glam::Vec3;

/// How much work a pixel is worth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quality {
    /// Light is worked out at the vertices instead of at each pixel: without reflections of the sun, dust
    /// and wear of the ground, and without what the other settings promise of them. What is shown is drawn at
    /// once, without ambient occlusion and dither.
    pub light_at_vertices: bool,
    /// Samples a pixel: 1 or 4.
    pub samples: u32,
    /// How many texels along the steeper direction a texture lookup may take; a software adapter
    /// takes one.
    pub anisotropy: u16,
    /// Shadow edges of several lookups instead of one.
    pub soft_shadows: bool,
    /// Ground textures at two scales.
    pub detail: bool,
    /// Looks around each pixel for what keeps the sky's light away from it; 0 for none.
    pub occlusion_looks: u32,
    /// Texels along an edge of the shadow map.
    pub shadow_texels: u32,
    /// Simpler meshes stand in for distant ones where they differ by fewer pixels than this.
    pub coarse_below_px: f32,
}

impl Quality {
    /// The presets, from the quickest to the finest.
    pub const PRESETS: [(&'static str, Self); 4] =
        [("low", Self::LOW), ("medium", Self::MEDIUM), ("high", Self::HIGH), ("ultra", Self::ULTRA)];

    /// The preset for an adapter: one that draws on the CPU gets the quickest.
    pub fn auto(is_software: bool) -> Self {
        if is_software { Self::LOW } else { Self::HIGH }
    }

    /// For a GPU of modest means.
    pub const MEDIUM: Self = Self {
        light_at_vertices: false,
        samples: 4,
        anisotropy: 4,
        soft_shadows: true,
        detail: false,
        occlusion_looks: 6,
        shadow_texels: 2048,
        coarse_below_px: 1.5,
    };
    /// For stills.
    pub const ULTRA: Self =
        Self { anisotropy: 16, occlusion_looks: 20, shadow_texels: 8192, coarse_below_px: 0.3, ..Self::HIGH };
    /// For pictures that people look at.
    pub const HIGH: Self = Self {
        light_at_vertices: false,
        samples: 4,
        anisotropy: 8,
        soft_shadows: true,
        detail: true,
        occlusion_looks: 10,
        shadow_texels: 4096,
        coarse_below_px: 0.8,
    };
    /// For many cameras on a software adapter.
    pub const LOW: Self = Self {
        light_at_vertices: true,
        samples: 1,
        anisotropy: 1,
        soft_shadows: false,
        detail: false,
        occlusion_looks: 0,
        shadow_texels: 2048,
        coarse_below_px: 3.5,
    };
}

/// Faces in their own colours, of which `ambient + sun * cos` is seen: no textures, shadows, sky or display curve.
/// Other engines draw the same, so that pictures and speed can be compared.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlatLight {
    pub to_sun: Vec3,
    pub ambient: f32,
    pub sun: f32,
    /// Behind everything, as displayed.
    pub background: [f32; 3],
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    pub quality: Quality,
    pub daylight: Daylight,
    /// In place of the time of day; for qualities that light at the vertices.
    pub flat: Option<FlatLight>,
    /// Of the targets that [`super::Renderer::draw`] is given, where light is worked out at the vertices (without
    /// the suffix sRGB: the shaders encode); pictures are read back in sRGB whatever it is.
    pub format: wgpu::TextureFormat,
    /// The most memory in bytes that one batch of views may take on the adapter.
    pub batch_bytes: u64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            quality: Quality::HIGH,
            daylight: Daylight::default(),
            flat: None,
            format: wgpu::TextureFormat::Rgba8UnormSrgb,
            batch_bytes: 192 << 20,
        }
    }
}
