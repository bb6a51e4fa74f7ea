//! Light of a time of day: position and radiance of sun or moon, sky, fog, exposure, brightness of lamps.

use super::FlatLight;
use glam::Vec3;
use std::f32::consts::PI;

/// Time of day, from which the position of the sun follows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Daylight {
    /// Local time from midnight.
    pub hours: f32,
}

impl Daylight {
    /// High sun.
    pub const NOON: Self = Self { hours: 12.0 };
    /// Half past four in the afternoon: the sun is low in the west.
    pub const LOW_SUN: Self = Self { hours: 16.5 };
    /// Ten in the evening: moon and lamps.
    pub const NIGHT: Self = Self { hours: 22.0 };

    /// Unit vector towards the sun from latitude, declination and hour angle: 44 degrees north in autumn, solar noon at
    /// 11.
    fn to_sun(self) -> Vec3 {
        let turn = (self.hours - 11.0) / 12.0 * PI;
        let (latitude, declination) = (44_f32.to_radians(), 4_f32.to_radians());
        let ((sin_l, cos_l), (sin_d, cos_d)) = (latitude.sin_cos(), declination.sin_cos());
        Vec3::new(
            -cos_d * turn.sin(),
            sin_d * cos_l - cos_d * sin_l * turn.cos(),
            sin_l * sin_d + cos_l * cos_d * turn.cos(),
        )
    }

    pub(super) fn light(self) -> Light {
        let to_sun = self.to_sun();
        let elevation_deg = to_sun.z.clamp(-1.0, 1.0).asin().to_degrees();
        let to_moon = Vec3::new(-0.50, -0.49, 0.71).normalize_or(Vec3::Z);
        let is_moonlit = elevation_deg < DUSK_ELEVATION_DEG;
        Light {
            to_sun: if is_moonlit {
                to_moon
            } else {
                Vec3::new(to_sun.x, to_sun.y, to_sun.z.max(0.03)).normalize_or(Vec3::Z)
            },
            ..interpolated(elevation_deg)
        }
    }
}

impl Default for Daylight {
    fn default() -> Self {
        Self::NOON
    }
}

/// Light of one moment, for shaders and the panorama of the sky: radiance unless stated otherwise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Light {
    /// Unit vector towards the sun, or towards the moon at night.
    pub(super) to_sun: Vec3,
    pub(super) sun: [f32; 3],
    pub(super) sky: [f32; 3],
    pub(super) ground: [f32; 3],
    /// Sky at the zenith, for reflections.
    pub(super) zenith: [f32; 3],
    /// Displayed colour of the fog, sRGB.
    pub(super) haze_srgb: [f32; 3],
    pub(super) zenith_srgb: [f32; 3],
    pub(super) cloud_srgb: [f32; 3],
    /// Share of the clouds that is seen: none in fog.
    pub(super) clouds_seen: f32,
    /// Around the sun.
    pub(super) glow_srgb: [f32; 3],
    pub(super) hills_srgb: [f32; 3],
    /// Factor on radiance before tone mapping.
    pub(super) exposure: f32,
    /// Brightness of the lamps of streets, windows and cars: 0 off to 1.
    pub(super) lamps: f32,
    /// Whether clouds or fog hide sun, moon and stars.
    pub(super) is_overcast: bool,
}

/// Below this elevation of the sun the moon replaces it; at it neither gives light.
const DUSK_ELEVATION_DEG: f32 = -3.0;

/// Key frames of the light by elevation of the sun, degrees, ascending. Sun, sky and zenith of the day are those of the
/// model of Hosek and Wilkie (2012, 2013) for a clear sky, the sky less what a street does not see of it
/// (`docs/reference.md`). Sun and sky of a low sun, and the sky of dusk, are moved halfway to grey of the same luminance, as by
/// the white balance of a camera: the tone mapping curve deepens colours of the dark. The sky of the day is moved a third of the
/// way, and has a twelfth more for what sunlit streets throw back into the shade.
const KEY_FRAMES: [(f32, Light); 4] = [
    (
        -12.0,
        Light {
            to_sun: Vec3::Z,
            sun: [0.10, 0.12, 0.17],
            sky: [0.10, 0.13, 0.21],
            ground: [0.06, 0.06, 0.075],
            zenith: [0.010, 0.014, 0.035],
            haze_srgb: [0.105, 0.12, 0.165],
            zenith_srgb: [0.020, 0.028, 0.065],
            cloud_srgb: [0.13, 0.14, 0.18],
            clouds_seen: 1.0,
            glow_srgb: [0.55, 0.60, 0.70],
            hills_srgb: [0.03, 0.04, 0.06],
            exposure: 0.82,
            lamps: 1.0,
            is_overcast: false,
        },
    ),
    (
        DUSK_ELEVATION_DEG,
        Light {
            to_sun: Vec3::Z,
            sun: [0.0, 0.0, 0.0],
            sky: [0.235, 0.25, 0.315],
            ground: [0.12, 0.12, 0.13],
            zenith: [0.05, 0.08, 0.20],
            haze_srgb: [0.56, 0.45, 0.45],
            zenith_srgb: [0.12, 0.18, 0.36],
            cloud_srgb: [0.45, 0.36, 0.42],
            clouds_seen: 1.0,
            glow_srgb: [0.95, 0.55, 0.35],
            hills_srgb: [0.12, 0.13, 0.18],
            exposure: 1.0,
            lamps: 1.0,
            is_overcast: false,
        },
    ),
    (
        8.0,
        Light {
            to_sun: Vec3::Z,
            sun: [1.55, 1.18, 0.66],
            sky: [0.195, 0.206, 0.215],
            ground: [0.135, 0.12, 0.10],
            zenith: [0.06, 0.12, 0.20],
            haze_srgb: [0.89, 0.88, 0.83],
            zenith_srgb: [0.36, 0.55, 0.68],
            cloud_srgb: [0.98, 0.84, 0.72],
            clouds_seen: 1.0,
            glow_srgb: [1.0, 0.85, 0.58],
            hills_srgb: [0.40, 0.42, 0.42],
            exposure: 1.50,
            lamps: 0.0,
            is_overcast: false,
        },
    ),
    (
        30.0,
        Light {
            to_sun: Vec3::Z,
            sun: [3.13, 2.78, 2.18],
            sky: [0.295, 0.36, 0.495],
            ground: [0.37, 0.35, 0.29],
            zenith: [0.14, 0.27, 0.56],
            haze_srgb: [0.81, 0.87, 0.90],
            zenith_srgb: [0.33, 0.53, 0.735],
            cloud_srgb: [1.0, 1.0, 1.01],
            clouds_seen: 1.0,
            glow_srgb: [1.0, 0.97, 0.88],
            hills_srgb: [0.38, 0.50, 0.46],
            exposure: 0.64,
            lamps: 0.0,
            is_overcast: false,
        },
    ),
];

/// Linear interpolation between key frames.
fn interpolated(elevation_deg: f32) -> Light {
    let above = KEY_FRAMES.iter().position(|(from, _)| elevation_deg < *from);
    let (below, next) = match above {
        Some(0) => return KEY_FRAMES[0].1,
        Some(k) => (&KEY_FRAMES[k - 1], &KEY_FRAMES[k]),
        None => return KEY_FRAMES[KEY_FRAMES.len() - 1].1,
    };
    let part = (elevation_deg - below.0) / (next.0 - below.0);
    let (a, b) = (&below.1, &next.1);
    let one = |a: f32, b: f32| a + (b - a) * part;
    let all = |a: [f32; 3], b: [f32; 3]| [0, 1, 2].map(|k| one(a[k], b[k]));
    Light {
        to_sun: Vec3::Z,
        sun: all(a.sun, b.sun),
        sky: all(a.sky, b.sky),
        ground: all(a.ground, b.ground),
        zenith: all(a.zenith, b.zenith),
        haze_srgb: all(a.haze_srgb, b.haze_srgb),
        zenith_srgb: all(a.zenith_srgb, b.zenith_srgb),
        cloud_srgb: all(a.cloud_srgb, b.cloud_srgb),
        clouds_seen: 1.0,
        glow_srgb: all(a.glow_srgb, b.glow_srgb),
        hills_srgb: all(a.hills_srgb, b.hills_srgb),
        exposure: one(a.exposure, b.exposure),
        lamps: one(a.lamps, b.lamps),
        is_overcast: false,
    }
}

impl FlatLight {
    pub(super) fn light(self) -> Light {
        Light {
            to_sun: self.to_sun.normalize_or(Vec3::Z),
            sun: [self.sun; 3],
            sky: [self.ambient; 3],
            ground: [self.ambient; 3],
            haze_srgb: self.background,
            ..Daylight::NOON.light()
        }
    }
}

impl Light {
    /// Direction of the sun or the moon, where neither clouds nor fog hide it.
    pub(super) fn sun_seen(&self) -> Option<Vec3> {
        (!self.is_overcast).then_some(self.to_sun)
    }

    /// Whether lamps are on.
    pub(super) fn is_lamplit(&self) -> bool {
        self.lamps > 0.0
    }

    /// Inverse tone mapping: the radiance that `shaders/display.wgsl` displays as an sRGB value below 1.
    pub(super) fn radiance_of(&self, displayed: [f32; 3]) -> [f32; 3] {
        displayed.map(|c| {
            let y = linear_from_srgb(c).min(0.995);
            // The positive root of x (2.51 x + 0.03) = y (x (2.43 x + 0.59) + 0.14).
            let (a, b) = (2.51 - 2.43 * y, 0.03 - 0.59 * y);
            (((b * b + 4.0 * a * 0.14 * y).sqrt() - b) / (2.0 * a)).max(0.0) / self.exposure
        })
    }
}

/// Linear light of an sRGB channel from 0 to 1 (IEC 61966-2-1).
fn linear_from_srgb(c: f32) -> f32 {
    let c = c.clamp(0.0, 1.0);
    if c <= 0.040_45 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sun_is_high_at_noon_low_in_the_west_later_and_gives_way_to_lamps_and_moon() {
        let [noon, low, night] = [Daylight::NOON, Daylight::LOW_SUN, Daylight::NIGHT].map(Daylight::light);
        assert!(noon.to_sun.z > 0.7 && noon.to_sun.y < 0.0, "{}", noon.to_sun);
        assert!((0.08..0.25).contains(&low.to_sun.z) && low.to_sun.x < -0.9, "{}", low.to_sun);
        assert!(night.to_sun.z > 0.3 && night.sun[0] < noon.sun[0] / 10.0);
        assert_eq!([noon.lamps, low.lamps, night.lamps], [0.0, 0.0, 1.0]);
    }

    #[test]
    fn radiance_is_what_the_display_curve_shows_as_it_was() {
        let light = Daylight::NOON.light();
        for srgb in [0.0, 0.02, 0.2, 0.5, 0.9, 0.99] {
            let [radiance, ..] = light.radiance_of([srgb; 3]);
            let x = radiance * light.exposure;
            let shown = (x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14);
            assert!((shown - linear_from_srgb(srgb)).abs() < 1e-5, "{srgb}: {shown}");
        }
    }

    /// A low sun and the sky of its shadows have colours that the display does not deepen to brown and navy.
    #[test]
    fn shadows_of_a_low_sun_are_grey_with_a_hint_of_blue() {
        let Light { sun, sky, .. } = Daylight::LOW_SUN.light();
        let [warm, cold] = [sun[0] / sun[2], sky[2] / sky[0]];
        assert!((1.5..2.8).contains(&warm) && (1.02..1.25).contains(&cold), "{sun:?} {sky:?}");
    }

    #[test]
    fn no_minute_of_the_day_jumps() {
        let light = |minute: u16| Daylight { hours: f32::from(minute) / 60.0 }.light();
        for minute in 0..24 * 60 - 1 {
            let (a, b) = (light(minute), light(minute + 1));
            let step = (0..3).map(|k| (a.sky[k] - b.sky[k]).abs().max((a.sun[k] - b.sun[k]).abs()));
            assert!(step.fold(0.0, f32::max) < 0.06, "minute {minute}");
        }
    }
}
