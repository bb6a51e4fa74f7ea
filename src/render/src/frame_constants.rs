//! Uniforms of the frame that follow from the settings.

use super::daylight::Light;
use super::passes::common::gpu_data;
use super::passes::shadow::SunView;
use super::{Settings, weather};
use city3d_sensors::Weather;

/// Density of the fog at the ground in clear weather.
const CLEAR_FOG_DENSITY: f32 = 1.0 / 2000.0;

/// Uniforms of the frame that do not change: all but the time.
pub(super) fn constant_frame(
    light: &Light,
    sun_view: &SunView,
    settings: &Settings,
    lamp_uv_from_world: [f32; 4],
) -> gpu_data::Frame {
    let shadow_texels = settings.quality.shadow_texels;
    // Flat light is that of a neutral scene.
    let weather = if settings.flat.is_some() { Weather::Clear } else { settings.weather };
    let with = |[r, g, b]: [f32; 3], w: f32| [r, g, b, w];
    gpu_data::Frame {
        to_sun: light.to_sun.extend(0.0).to_array(),
        sun: with(light.sun, light.exposure),
        sky_light: with(light.sky, 0.0),
        ground_light: with(light.ground, 0.0),
        haze: with(light.radiance_of(light.haze_srgb), weather::fog_density(weather, CLEAR_FOG_DENSITY)),
        shadow_from_world: sun_view.shadow_from_world.to_cols_array_2d(),
        shadow_texel: [1.0 / shadow_texels as f32, sun_view.texel_m, weather::wetness(weather), 0.0],
        zenith: with(light.zenith, light.lamps),
        lamp_uv_from_world,
    }
}
