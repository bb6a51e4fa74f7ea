//! What weather does to the light of an hour, to the fog and to the ground.

use super::daylight::Light;
use city3d_sensors::Weather;

/// Density of the fog at the ground in clear weather, in rain and in fog: its inverse is the distance in metres at which
/// 37 % of the light is left.
const RAIN_DENSITY: f32 = 1.0 / 420.0;
const FOG_DENSITY: f32 = 1.0 / 85.0;

/// Share of the sky that clouds or fog cover.
const RAIN_COVER: f32 = 0.98;
const FOG_COVER: f32 = 0.96;

/// What the lamps of the town add to clouds at night, as displayed.
const TOWN_GLOW_SRGB: [f32; 3] = [0.046, 0.028, 0.006];
/// Brightness of fog, which is among the lamps, over that; it is nearly grey.
const FOG_GLOW: f32 = 2.6;

/// How wet the ground is, 0 to 1.
pub(super) fn wetness(weather: Weather) -> f32 {
    match weather {
        Weather::Clear => 0.0,
        Weather::Rain => 1.0,
        Weather::Fog => 0.35,
    }
}

/// Density of the fog at the ground, of that in clear weather.
pub(super) fn fog_density(weather: Weather, clear: f32) -> f32 {
    match weather {
        Weather::Clear => clear,
        Weather::Rain => RAIN_DENSITY.max(clear),
        Weather::Fog => FOG_DENSITY.max(clear),
    }
}

/// The light of clear weather below clouds or in fog.
pub(super) fn light_in(weather: Weather, clear: Light) -> Light {
    match weather {
        Weather::Clear => clear,
        Weather::Rain => overcast(clear, RAIN_COVER, 1.0, TOWN_GLOW_SRGB),
        Weather::Fog => {
            let fog_glow = towards_grey(TOWN_GLOW_SRGB, 0.85).map(|channel| channel * FOG_GLOW);
            let light = overcast(clear, FOG_COVER, 0.94, fog_glow);
            // Neither clouds nor hills are seen.
            Light { clouds_seen: 0.0, hills_srgb: light.haze_srgb, ..light }
        }
    }
}

/// Clouds scatter the light of the sun over the sky, which has one grey; `brightness` is that of the horizon, as displayed,
/// over that of clear weather; `town_glow_srgb` is what the lamps of the town add at night.
fn overcast(clear: Light, cover: f32, brightness: f32, town_glow_srgb: [f32; 3]) -> Light {
    let scattered = luminance(clear.sun) * clear.to_sun.z.max(0.0) * cover;
    // At night the lamps of the town light clouds from below.
    let darkness = ((0.30 - luminance(clear.haze_srgb)) / 0.18).clamp(0.0, 1.0);
    let grey = towards_grey(clear.haze_srgb, cover).map(|channel| channel * brightness);
    let horizon: [f32; 3] = std::array::from_fn(|k| grey[k] + town_glow_srgb[k] * darkness * cover);
    let above = horizon.map(|channel| channel * 0.86);
    let sky =
        towards_grey(clear.sky, 0.75 * cover).map(|channel| channel * (1.0 - 0.4 * cover) + 0.35 * scattered);
    let light = Light {
        sun: clear.sun.map(|channel| channel * (1.0 - cover)),
        sky,
        ground: sky.map(|channel| channel * 0.42),
        haze_srgb: horizon,
        zenith_srgb: above,
        cloud_srgb: horizon.map(|channel| channel * 0.95),
        glow_srgb: horizon,
        hills_srgb: std::array::from_fn(|k| {
            clear.hills_srgb[k] + (horizon[k] - clear.hills_srgb[k]) * 0.6 * cover
        }),
        is_overcast: true,
        ..clear
    };
    // What reflections show is what the sky shows.
    Light { zenith: light.radiance_of(above), ..light }
}

/// A colour, with a share of it replaced by grey of the same luminance.
fn towards_grey(colour: [f32; 3], share: f32) -> [f32; 3] {
    let grey = luminance(colour);
    colour.map(|channel| channel + (grey - channel) * share)
}

fn luminance([r, g, b]: [f32; 3]) -> f32 {
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

#[cfg(test)]
mod tests {
    use super::super::Daylight;
    use super::*;

    #[test]
    fn clear_weather_changes_nothing() {
        for daylight in [Daylight::NOON, Daylight::NIGHT] {
            let light = daylight.light();
            assert_eq!(light_in(Weather::Clear, light), light);
        }
        assert_eq!((wetness(Weather::Clear), fog_density(Weather::Clear, 0.001)), (0.0, 0.001));
    }

    #[test]
    fn clouds_take_the_sun_and_its_colour_at_every_hour() {
        let spread = |c: [f32; 3]| c.into_iter().fold(0.0, f32::max) - c.into_iter().fold(1e9, f32::min);
        for minute in (0..24 * 60).step_by(10) {
            let clear = Daylight { hours: minute as f32 / 60.0 }.light();
            for weather in [Weather::Rain, Weather::Fog] {
                let light = light_in(weather, clear);
                assert!(luminance(light.sun) <= 0.2 * luminance(clear.sun), "{minute}");
                assert!(spread(light.zenith_srgb) <= spread(clear.zenith_srgb), "{minute}");
                // Total light on the ground falls, but not to nothing.
                let total = |light: &Light| luminance(light.sun) * light.to_sun.z + luminance(light.sky);
                let share = total(&light) / total(&clear);
                assert!((0.2..1.01).contains(&share), "{minute} {weather:?}: {share}");
                assert!(light.zenith.iter().all(|channel| channel.is_finite() && *channel >= 0.0));
            }
        }
    }

    #[test]
    fn fog_is_never_thinner_than_in_clear_weather() {
        for clear in [1.0 / 2000.0, 1.0 / 520.0, 1.0 / 10.0] {
            assert!(fog_density(Weather::Rain, clear) >= clear);
            assert!(fog_density(Weather::Fog, clear) >= fog_density(Weather::Rain, clear));
        }
    }
}
