//! Procedural sky: panorama on a sky box, environment map, disc of sun or moon, stars.

use super::super::daylight::Light;
use super::noise::{hash, octaves};
use glam::Vec3;
use rayon::prelude::*;

/// Bands of the panorama on the sky box: v where a band begins, and its height on the box. The box surrounds the eye at
/// unit distance, without a floor; its walls face east, north, west and south and are equally wide in the panorama. The
/// last band is the lid, from its edge to the zenith. Few large faces cost little to draw.
const BANDS: [(f32, f32); 3] = [(0.0, -0.13), (0.5, 0.25), (0.82, 1.0)];

/// Radius of the disc of sun or moon.
const DISC_RAD: f32 = 0.0115;

/// Triangles of the sky box: corners as directions (not of unit length) and texture coordinates in the panorama.
pub(crate) fn triangles() -> Vec<[(Vec3, [f32; 2]); 3]> {
    let mut triangles = Vec::new();
    for wall in 0..4 {
        let corner = |side: f32, v: f32| {
            let u = (wall as f32 + side) / 4.0;
            (direction(wall, 2.0 * side - 1.0, v), [u, v])
        };
        let [(bottom, _), (middle, _), (top, _)] = BANDS;
        for (low, high) in [(bottom, middle), (middle, top)] {
            let [a, b, c, d] = [corner(0.0, low), corner(1.0, low), corner(1.0, high), corner(0.0, high)];
            triangles.extend([[a, b, c], [a, c, d]]);
        }
        triangles.push([corner(0.0, top), corner(1.0, top), corner(0.5, 1.0)]);
    }
    triangles
}

/// Direction that a point of the panorama shows: on a wall, `across` from -1 to 1.
fn direction(wall: i32, across: f32, v: f32) -> Vec3 {
    let [(_, foot), (low_end, sill), (top, edge)] = BANDS;
    let part = |from: f32, to: f32| (v - from) / (to - from);
    let (out, up) = if v < low_end {
        (1.0, foot + (sill - foot) * part(0.0, low_end))
    } else if v < top {
        (1.0, sill + (edge - sill) * part(low_end, top))
    } else {
        (1.0 - part(top, 1.0), edge)
    };
    let ahead = [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)][wall as usize];
    Vec3::new(ahead.0 * out - ahead.1 * across, ahead.1 * out + ahead.0 * across, up)
}

/// Panorama as sRGB texels, row by row with v growing.
pub(super) fn panorama_srgb(size: [u32; 2], light: &Light) -> Vec<u8> {
    texels(size, |direction| {
        let [r, g, b] = colour(direction, light).map(|c| (c.clamp(0.0, 1.0) * 255.0 + 0.5) as u8);
        [r, g, b, 255]
    })
}

/// Panorama as radiance in half floats, row by row with v growing.
pub(super) fn panorama_radiance(size: [u32; 2], light: &Light) -> Vec<u8> {
    texels(size, |direction| halves(light.radiance_of(colour(direction, light))))
}

/// Environment map: radiance above the horizon in half floats, hemi-octahedral as `sky_radiance` of
/// `shaders/light.wgsl` reads it, by mipmap level.
pub(super) fn environment_map(size: u32, light: &Light) -> Vec<Vec<u8>> {
    let at = |k: u32| (k as f32 + 0.5) / size as f32 * 2.0 - 1.0;
    let texel = |index: u32| {
        let (a, b) = (at(index % size), at(index / size));
        let (x, y) = ((a + b) / 2.0, (a - b) / 2.0);
        let direction = Vec3::new(x, y, 1.0 - x.abs() - y.abs()).normalize_or(Vec3::Z);
        // Only the panorama shows the hills at the horizon.
        let above =
            Vec3::new(direction.x, direction.y, direction.z.max(0.07 * direction.truncate().length()));
        light.radiance_of(colour(above.normalize_or(Vec3::Z), light))
    };
    let mut level: Vec<[f32; 3]> = (0..size * size).into_par_iter().map(texel).collect();
    let mut edge = size as usize;
    let mut levels = Vec::new();
    loop {
        levels.push(level.iter().flat_map(|&radiance| halves(radiance)).collect());
        if edge == 1 {
            return levels;
        }
        edge /= 2;
        let mean = |index: usize| {
            let corner = index / edge * 4 * edge + index % edge * 2;
            let four = [corner, corner + 1, corner + 2 * edge, corner + 2 * edge + 1].map(|k| level[k]);
            [0, 1, 2].map(|channel| four.iter().map(|texel| texel[channel]).sum::<f32>() / 4.0)
        };
        level = (0..edge * edge).map(mean).collect();
    }
}

fn halves(radiance: [f32; 3]) -> [u8; 8] {
    let [r, g, b] = radiance.map(|c| half(c).to_le_bytes());
    [r[0], r[1], g[0], g[1], b[0], b[1], 0, 0]
}

fn texels<const N: usize>([width, height]: [u32; 2], texel: impl Fn(Vec3) -> [u8; N] + Sync) -> Vec<u8> {
    let texel = &texel;
    (0..height)
        .into_par_iter()
        .flat_map_iter(|y| {
            let v = (y as f32 + 0.5) / height as f32;
            (0..width).flat_map(move |x| {
                let u = (x as f32 + 0.5) / width as f32 * 4.0;
                texel(direction(u as i32, 2.0 * u.fract() - 1.0, v).normalize_or(Vec3::Z))
            })
        })
        .collect()
}

/// Bits of the nearest half float (IEEE 754 binary16), clamped to 0 to 60000.
fn half(value: f32) -> u16 {
    // The factor 2^-112 shifts the exponent bias from single to half precision; small numbers become subnormal, then 0.
    let scaled = (value.clamp(0.0, 6e4) * f32::from_bits(0x0780_0000)).to_bits();
    (scaled.wrapping_add(0x1000) >> 13) as u16
}

fn mix(a: [f32; 3], b: [f32; 3], part: f32) -> [f32; 3] {
    [0, 1, 2].map(|k| a[k] + (b[k] - a[k]) * part)
}

/// Displayed colour of the sky in a unit direction: sRGB in [0, 1].
fn colour(direction: Vec3, light: &Light) -> [f32; 3] {
    let up = direction.z;
    let horizon = light.haze_srgb;
    let night = night_of(light);
    // By day the light of the horizon reaches higher, as in the model of Hosek and Wilkie (2012).
    let height = up.max(0.0);
    let [by_day, by_night] = [4.0 * height * height.sqrt(), 4.2 * height].map(|depth| 1.0 - (-depth).exp());
    let rise = by_day + (by_night - by_day) * night;
    let mut sky = mix(horizon, light.zenith_srgb, rise);
    let fade = ((up - 0.02) * 7.0).clamp(0.0, 1.0);
    let towards = direction.dot(light.to_sun);
    let cover = if fade > 0.0 { light.clouds_seen * cloud_cover(direction) } else { 0.0 };
    if cover > 0.0 {
        let lit = 0.90 + 0.10 * octaves(cloud_plane(direction), [24, 24], 3, 207);
        sky = mix(sky, light.cloud_srgb.map(|c| c * lit), cover * fade * (0.78 - 0.2 * night));
    }
    let glow = (towards.max(0.0).powi(24) * 0.30 + towards.max(0.0).powi(400) * 0.5) * (1.0 - 0.7 * night);
    // A low sun lights the haze far around it.
    let low = (1.0 - 2.5 * light.to_sun.z).clamp(0.0, 1.0) * (1.0 - night);
    let wide = low * towards.max(0.0).powi(5) * 0.55 * (-5.0 * up.max(0.0)).exp();
    sky = mix(sky, light.glow_srgb, (glow + wide).min(1.0));
    if !light.is_overcast {
        sky = mix(sky, disc_colour(light), aureole(towards, night));
    }
    // Two chains of hills in the haze.
    let elevation = up.asin();
    for (seed, height, base, part) in [(221, 0.040, 0.004, 0.24), (231, 0.024, 0.0, 0.40)] {
        // Early out: most of the sky is above the hills.
        if elevation > base + height * 0.70 {
            continue;
        }
        let crest = base + height * (octaves([turn_of(direction), 0.3], [9, 2], 5, seed) - 0.30).max(0.0);
        let edge = ((crest - elevation) / 0.0015).clamp(0.0, 1.0);
        // Mist lies at their feet, where the plain ends in haze.
        let mist = (-(elevation.max(0.0)) / 0.018).exp();
        sky = mix(sky, mix(horizon, light.hills_srgb, part * (1.0 - mist)), edge);
    }
    sky
}

/// Share of the disc's own light around sun or moon: haze scatters it forward, brightest at the rim of the disc.
fn aureole(towards: f32, night: f32) -> f32 {
    // Farther away nothing of it is left.
    if towards < 0.9 {
        return 0.0;
    }
    let off_rad = (towards.clamp(-1.0, 1.0).acos() - DISC_RAD).max(0.0);
    let near = 0.62 * (-off_rad / 0.012).exp() + 0.34 * (-off_rad / 0.05).exp();
    near * (1.0 - 0.75 * night)
}

/// Displayed colour of sun or moon.
fn disc_colour(light: &Light) -> [f32; 3] {
    if night_of(light) > 0.5 { [0.93, 0.94, 0.90] } else { [1.0, 1.0, 0.97] }
}

/// 0 by day, 1 at night.
fn night_of(light: &Light) -> f32 {
    ((0.16 - light.zenith_srgb[2]) / 0.08).clamp(0.0, 1.0)
}

/// Disc of sun or moon as triangles: directions of corners, displayed colour; none behind clouds. Geometry is sharper than
/// the texels of the panorama.
pub(crate) fn disc(light: &Light) -> Vec<(Vec3, [f32; 3])> {
    const SIDES: u32 = 40;
    if light.is_overcast {
        return Vec::new();
    }
    let shown = disc_colour(light);
    let (right, up) = light.to_sun.any_orthonormal_pair();
    let rim = |k: u32| {
        let (sin, cos) = (std::f32::consts::TAU * k as f32 / SIDES as f32).sin_cos();
        light.to_sun + DISC_RAD * (cos * right + sin * up)
    };
    (0..SIDES).flat_map(|k| [light.to_sun, rim(k), rim(k + 1)]).map(|corner| (corner, shown)).collect()
}

/// Stars where no cloud is: unit directions and displayed colours; empty by day.
pub(crate) fn stars(light: &Light) -> Vec<(Vec3, [f32; 3])> {
    const COUNT: i32 = 1400;
    let night = night_of(light);
    if night == 0.0 || light.is_overcast {
        return Vec::new();
    }
    let star = |k: i32| {
        // Uniform over the dome, except for the haze at the horizon.
        let up = 0.10 + 0.90 * hash(k, 0, 301);
        let (sin, cos) = (std::f32::consts::TAU * hash(k, 1, 301)).sin_cos();
        let out = (1.0 - up * up).sqrt();
        let direction = Vec3::new(cos * out, sin * out, up);
        // Faint ones are many; some are warm, some cold.
        let bright = (0.20 + 0.60 * hash(k, 2, 301).powi(5)) * ((up - 0.08) * 5.0).min(1.0);
        let warm = hash(k, 3, 301) - 0.5;
        let behind = colour(direction, light);
        let tint = [1.0 + 0.25 * warm, 1.0, 1.0 - 0.35 * warm];
        let shown = [0, 1, 2].map(|k| behind[k] + night * bright * tint[k]);
        (cloud_cover(direction) < 0.2).then_some((direction, shown))
    };
    (0..COUNT).filter_map(star).collect()
}

/// Azimuth counter-clockwise from east, in turns from 0 to 1.
fn turn_of(direction: Vec3) -> f32 {
    direction.y.atan2(direction.x).rem_euclid(std::f32::consts::TAU) / std::f32::consts::TAU
}

/// Cloud cover on a plane above: clouds get closer together towards the horizon.
fn cloud_cover(direction: Vec3) -> f32 {
    ((octaves(cloud_plane(direction), [9, 9], 6, 201) - 0.53) * 4.6).clamp(0.0, 1.0)
}

fn cloud_plane(direction: Vec3) -> [f32; 2] {
    let height = direction.z.max(0.015) + 0.10;
    [direction.x / height * 0.045 + 0.5, direction.y / height * 0.075 + 0.5]
}

#[cfg(test)]
mod tests {
    use super::{DISC_RAD, Vec3, colour, direction, half, triangles};
    use crate::{Daylight, daylight::Light};

    #[test]
    fn faces_show_what_the_panorama_has_there_and_close_the_sky() {
        for [a, b, c] in triangles() {
            for [x, y] in [[0.2, 0.3], [0.6, 0.1], [0.34, 0.33], [0.05, 0.9]] {
                let z = 1.0 - x - y;
                let seen = a.0 * x + b.0 * y + c.0 * z;
                let [u, v] = [0, 1].map(|k| a.1[k] * x + b.1[k] * y + c.1[k] * z);
                let wall = (u * 4.0) as i32;
                let expected = direction(wall, 2.0 * (4.0 * u - wall as f32) - 1.0, v);
                assert!(seen.distance(expected) < 1e-4, "{seen} shows {expected}");
            }
        }
        // What is looked for lies in one face at least.
        let inside = |[a, b, c]: [Vec3; 3], look: Vec3| {
            [(a, b), (b, c), (c, a)].iter().all(|(p, q)| p.cross(*q).dot(look) >= -1e-6)
                || [(a, b), (b, c), (c, a)].iter().all(|(p, q)| p.cross(*q).dot(look) <= 1e-6)
        };
        for k in 0..400 {
            let (sin, cos) = (0.37 * k as f32).sin_cos();
            let look = Vec3::new(cos, sin, -0.08 + 0.005 * k as f32);
            let found = triangles().into_iter().any(|t| {
                let corners = t.map(|(at, _)| at);
                inside(corners, look) && corners.iter().sum::<Vec3>().dot(look) > 0.0
            });
            assert!(found, "nothing at {look}");
        }
    }

    /// Haze scatters light around the sun, so that its disc has no hard edge.
    #[test]
    fn the_sun_is_in_an_aureole_that_fades_outwards() {
        for light in [Daylight::NOON, Daylight::LOW_SUN].map(Daylight::light) {
            let light = Light { clouds_seen: 0.0, ..light };
            let aside = light.to_sun.any_orthonormal_vector();
            let seen = |off_rad: f32| {
                let [r, g, b] = colour((light.to_sun + aside * off_rad.tan()).normalize_or(Vec3::Z), &light);
                (r + g + b) / 3.0
            };
            let steps = [1.05, 2.0, 4.0, 8.0].map(|radii| seen(radii * DISC_RAD));
            assert!(steps[0] > 0.94 && steps.is_sorted_by(|near, far| *near > *far + 0.01), "{steps:?}");
        }
    }

    #[test]
    fn half_floats_are_those_next_to_a_number() {
        for (value, bits) in [
            (0.0, 0x0000),
            (1.0, 0x3c00),
            (0.5, 0x3800),
            (0.1, 0x2e66),
            (1.9995, 0x3fff),
            (300.0, 0x5cb0),
            (6.0e-5, 0x03ef),
            (-1.0, 0x0000),
        ] {
            assert_eq!(half(value), bits, "{value}");
        }
    }
}
