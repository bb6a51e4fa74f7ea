//! What a renderer is built for: quality, time of day, pixel format.

use glam::Vec3;

/// How much work a pixel is worth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quality {
    /// Light is worked out at the vertices instead of at each pixel: without reflections of the sun, dust
    /// and wear of the ground, and without what the other settings promise of them.
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
        shadow_texels: 2048,
        coarse_below_px: 1.5,
    };
    /// For stills.
    pub const ULTRA: Self = Self { anisotropy: 16, shadow_texels: 8192, coarse_below_px: 0.3, ..Self::HIGH };
    /// For pictures that people look at.
    pub const HIGH: Self = Self {
        light_at_vertices: false,
        samples: 4,
        anisotropy: 8,
        soft_shadows: true,
        detail: true,
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
        shadow_texels: 2048,
        coarse_below_px: 3.5,
    };
}

/// Where the sun stands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sun {
    /// Counter-clockwise from east.
    pub azimuth_rad: f32,
    pub elevation_rad: f32,
}

impl Sun {
    /// The unit vector towards it, city frame.
    pub fn direction(self) -> Vec3 {
        let (sin, cos) = self.azimuth_rad.sin_cos();
        let (up, out) = self.elevation_rad.sin_cos();
        Vec3::new(cos * out, sin * out, up)
    }
}

impl Default for Sun {
    /// A clear afternoon: in the south-west.
    fn default() -> Self {
        Self { azimuth_rad: -2.35, elevation_rad: 0.66 }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    pub quality: Quality,
    pub sun: Sun,
    /// Of the targets that [`super::Renderer::draw`] is given; pictures are read back in sRGB whatever it is.
    pub format: wgpu::TextureFormat,
    /// The most memory in bytes that one batch of views may take on the adapter.
    pub batch_bytes: u64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            quality: Quality::HIGH,
            sun: Sun::default(),
            format: wgpu::TextureFormat::Rgba8UnormSrgb,
            batch_bytes: 192 << 20,
        }
    }
}

/// The horizon as displayed, sRGB: the panorama ends in it and far things fade into it.
pub(super) const HAZE_SRGB: [f32; 3] = [0.80, 0.855, 0.90];
/// Multiplies radiance before the display curve.
pub(super) const EXPOSURE: f32 = 0.82;

/// Radiance that the shaders' display curve shows as a linear value in [0, 1): its inverse.
pub(super) fn radiance_of(displayed: f32) -> f32 {
    let curve = |x: f32| (x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14);
    let (mut low, mut high) = (0.0_f32, 16.0_f32);
    for _ in 0..40 {
        let middle = (low + high) / 2.0;
        if curve(middle) < displayed { low = middle } else { high = middle }
    }
    low / EXPOSURE
}
