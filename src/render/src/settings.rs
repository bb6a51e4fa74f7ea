//! Renderer settings: quality presets, time of day, pixel format of targets.

use super::daylight::Light;
use super::{Daylight, weather};
use city3d_sensors::Weather;
use glam::Vec3;

/// Quality settings: shading, MSAA, texture filtering, shadow map, SSAO, level of detail.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quality {
    /// Gouraud shading: light is computed at the vertices instead of per pixel, without specular highlights of the sun
    /// and without wear of the ground. There is no HDR target, so neither ambient occlusion nor dither.
    pub vertex_lit: bool,
    /// MSAA samples per pixel: 1 or 4.
    pub samples: u32,
    /// Anisotropic filtering: most texels that a lookup takes along the steep direction; a software adapter takes one.
    pub anisotropy: u16,
    /// Percentage-closer filtering (PCF) of shadow edges with nine taps instead of one.
    pub soft_shadows: bool,
    /// Detail texturing: ground textures at two scales.
    pub detail: bool,
    /// SSAO (screen-space ambient occlusion) taps per pixel; 0 switches it off.
    pub ssao_samples: u32,
    /// Reflections in screen space (SSR): steps of a ray; 0 switches them off. They need light per pixel.
    pub reflection_steps: u32,
    /// The same where rain has made the ground wet, if that is more.
    pub wet_reflection_steps: u32,
    /// Contact shadows of the sun in screen space: steps of a ray; 0 switches them off. They need [`Self::ssao_samples`].
    pub contact_steps: u32,
    /// Temporal anti-aliasing of pictures that are read back: so many pictures, shifted by parts of a pixel, are
    /// averaged. 0 and 1 switch it off. It needs light per pixel; depth and labels, and what is drawn to a window, stay as
    /// they are.
    pub jitter_samples: u32,
    /// Resolution of the shadow map: texels along an edge.
    pub shadow_texels: u32,
    /// Level of detail: largest screen-space error of a coarser mesh of the city, pixels.
    pub lod_error_px: f32,
    /// The same of a vehicle, on which people look.
    pub vehicle_lod_error_px: f32,
    /// Small-feature culling: objects of a smaller diameter are not drawn, pixels.
    pub min_size_px: f32,
}

impl Quality {
    /// The presets, from the quickest to the finest.
    pub const PRESETS: [(&'static str, Self); 4] =
        [("low", Self::LOW), ("medium", Self::MEDIUM), ("high", Self::HIGH), ("ultra", Self::ULTRA)];

    /// Preset for an adapter: the quickest for a software adapter.
    pub fn auto(is_software: bool) -> Self {
        if is_software { Self::LOW } else { Self::HIGH }
    }

    /// For an integrated or older GPU.
    pub const MEDIUM: Self = Self {
        vertex_lit: false,
        samples: 4,
        anisotropy: 4,
        soft_shadows: true,
        detail: false,
        ssao_samples: 6,
        reflection_steps: 0,
        wet_reflection_steps: 0,
        contact_steps: 0,
        jitter_samples: 0,
        shadow_texels: 2048,
        lod_error_px: 1.5,
        vehicle_lod_error_px: 1.125,
        min_size_px: 1.0,
    };
    /// For stills.
    pub const ULTRA: Self = Self {
        anisotropy: 16,
        ssao_samples: 20,
        reflection_steps: 64,
        contact_steps: 16,
        jitter_samples: 4,
        shadow_texels: 8192,
        lod_error_px: 0.3,
        vehicle_lod_error_px: 0.225,
        ..Self::HIGH
    };
    /// For pictures that people look at.
    pub const HIGH: Self = Self {
        vertex_lit: false,
        samples: 4,
        anisotropy: 8,
        soft_shadows: true,
        detail: true,
        ssao_samples: 10,
        reflection_steps: 0,
        wet_reflection_steps: 40,
        contact_steps: 0,
        jitter_samples: 0,
        shadow_texels: 4096,
        lod_error_px: 0.8,
        vehicle_lod_error_px: 0.6,
        min_size_px: 1.0,
    };
    /// For many cameras on a software adapter.
    pub const LOW: Self = Self {
        vertex_lit: true,
        samples: 1,
        anisotropy: 1,
        soft_shadows: false,
        detail: false,
        ssao_samples: 0,
        reflection_steps: 0,
        wet_reflection_steps: 0,
        contact_steps: 0,
        jitter_samples: 0,
        shadow_texels: 2048,
        lod_error_px: 7.6,
        vehicle_lod_error_px: 3.8,
        min_size_px: 2.0,
    };
}

/// Flat Lambert shading, `ambient + sun * cos` times the colour of the face: no textures, shadows, sky or tone mapping.
/// Other engines draw the same, so that pictures and speed can be compared.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlatLight {
    /// Direction towards the sun, city frame; of any length.
    pub to_sun: Vec3,
    /// Factor on the colour of every face.
    pub ambient: f32,
    /// Additional factor on a face that is turned to the sun, times the cosine of the angle.
    pub sun: f32,
    /// Background colour, as displayed.
    pub background: [f32; 3],
}

/// Settings of a [`super::Renderer`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Preset or own choice of shading, filtering and level of detail.
    pub quality: Quality,
    /// Time of day: sun, moon, sky and lamps.
    pub daylight: Daylight,
    /// Clouds, fog, and wet ground.
    pub weather: Weather,
    /// Replaces the light of the time of day; needs [`Quality::vertex_lit`].
    pub flat: Option<FlatLight>,
    /// Pixel format of the targets of [`super::Renderer::draw`] with [`Quality::vertex_lit`] (without the suffix sRGB:
    /// the shaders encode). Pictures are read back in sRGB in any case.
    pub format: wgpu::TextureFormat,
    /// Limit of the memory that a batch of views takes on the adapter, bytes.
    pub batch_bytes: u64,
}

impl Settings {
    /// Steps of a ray of a reflection in the weather; 0 without reflections.
    pub(super) fn reflection_steps(&self) -> u32 {
        let Quality { reflection_steps, wet_reflection_steps, .. } = self.quality;
        let is_wet = weather::wetness(self.weather) >= 1.0;
        if is_wet { reflection_steps.max(wet_reflection_steps) } else { reflection_steps }
    }

    /// Light of the time of day in the weather.
    pub(super) fn light(&self) -> Light {
        weather::light_in(self.weather, self.daylight.light())
    }
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            quality: Quality::HIGH,
            daylight: Daylight::default(),
            weather: Weather::Clear,
            flat: None,
            format: wgpu::TextureFormat::Rgba8UnormSrgb,
            batch_bytes: 192 << 20,
        }
    }
}
