//! Procedural textures: texture array of surfaces with mipmaps, panorama of the sky, environment map.

mod facades;
mod glyphs;
mod noise;
mod patterns;
mod sky;

use super::daylight::Light;
use super::passes::Attachments;
use super::{Context, FlatLight, Settings};
use city3d_models::glb::linear_from_srgb;
use city3d_scene::Surface;
use rayon::prelude::*;

pub(super) use sky::{disc, stars, triangles as sky_triangles};

/// Texels along an edge of a layer of the texture array.
const SIZE: u32 = 256;
const SKY: [u32; 2] = [2048, 512];
/// Size of the panorama for vertex lighting: on a software adapter it stays in the processor's cache.
const SMALL_SKY: [u32; 2] = [1024, 256];
/// Texels along an edge of the environment map.
const SKY_MAP: u32 = 64;

/// Baked textures: procedural pictures made once on the CPU and uploaded to every device. They need no scene, so they
/// can be made while it is built: see [`super::Renderer::with_textures`].
#[derive(Debug)]
pub struct BakedTextures {
    /// Settings that they were made for.
    pub(super) settings: Settings,
    pub(super) light: Light,
    /// Mipmap chain of each [`Surface`].
    surfaces: Vec<Vec<Vec<u8>>>,
    /// See [`BakedTextures::panorama`].
    panorama: Vec<u8>,
    /// Mipmap chain; see [`BakedTextures::sky_map`].
    sky_map: Vec<Vec<u8>>,
}

impl BakedTextures {
    /// Makes all textures for these settings.
    pub fn new(settings: Settings) -> Self {
        let light = settings.flat.map_or_else(|| settings.light(), FlatLight::light);
        let vertex_lit = settings.quality.vertex_lit;
        let surfaces = || {
            let levels = |layer| mipmaps(patterns::pattern(layer, SIZE), SIZE);
            let layers = (0..Surface::COUNT as u8).into_par_iter().map(levels);
            if vertex_lit { layers.map(sqrt_encoded).collect() } else { layers.collect() }
        };
        let sky = || {
            let panorama = if vertex_lit {
                sky::panorama_srgb(SMALL_SKY, &light)
            } else {
                sky::panorama_radiance(SKY, &light)
            };
            (panorama, sky::environment_map(SKY_MAP, &light))
        };
        let (surfaces, (panorama, sky_map)) = rayon::join(surfaces, sky);
        Self { settings, light, surfaces, panorama, sky_map }
    }

    /// Texture array with a layer for each [`Surface`] and all mipmaps.
    pub(super) fn surfaces(&self, context: &Context, attachments: Attachments) -> wgpu::TextureView {
        let texture = texture(
            context,
            ("surfaces", attachments.texture_format()),
            [SIZE, SIZE],
            Surface::COUNT as u32,
            SIZE.ilog2() + 1,
        );
        for (layer, levels) in (0..).zip(&self.surfaces) {
            for (level, bytes) in (0..).zip(levels) {
                upload(context, &texture, [SIZE >> level, SIZE >> level], layer, level, bytes);
            }
        }
        texture.create_view(&wgpu::TextureViewDescriptor {
            dimension: Some(wgpu::TextureViewDimension::D2Array),
            ..Default::default()
        })
    }

    /// Panorama of the sky from below the horizon to the zenith, mapped to [`sky_triangles`]: displayed colours with
    /// vertex lighting, otherwise radiance.
    pub(super) fn panorama(&self, context: &Context) -> wgpu::TextureView {
        let (format, size) = if self.settings.quality.vertex_lit {
            (wgpu::TextureFormat::Rgba8Unorm, SMALL_SKY)
        } else {
            (wgpu::TextureFormat::Rgba16Float, SKY)
        };
        let texture = texture(context, ("sky", format), size, 1, 1);
        upload(context, &texture, size, 0, 0, &self.panorama);
        texture.create_view(&wgpu::TextureViewDescriptor::default())
    }

    /// Environment map for reflections: radiance of the sky above the horizon in a hemi-octahedral mapping, with all
    /// mipmaps.
    pub(super) fn sky_map(&self, context: &Context) -> wgpu::TextureView {
        let format = wgpu::TextureFormat::Rgba16Float;
        let texture = texture(context, ("mirrored sky", format), [SKY_MAP; 2], 1, SKY_MAP.ilog2() + 1);
        for (level, bytes) in (0..).zip(&self.sky_map) {
            upload(context, &texture, [SKY_MAP >> level; 2], 0, level, bytes);
        }
        texture.create_view(&wgpu::TextureViewDescriptor::default())
    }
}

/// Texels along an edge of a surface's texture, and its texels; see [`super::SurfaceTexture`].
pub(super) fn surface_texels(surface: u8) -> (u32, Vec<u8>) {
    (SIZE, patterns::pattern(surface, SIZE))
}

/// Encodes reflectance as its square root instead of sRGB: a shader decodes it by one multiplication.
fn sqrt_encoded(mut levels: Vec<Vec<u8>>) -> Vec<Vec<u8>> {
    let table: [u8; 256] =
        std::array::from_fn(|value| (linear_from_srgb(value as u8).sqrt() * 255.0).round() as u8);
    for texel in levels.iter_mut().flat_map(|level| level.chunks_exact_mut(4)) {
        for channel in &mut texel[..3] {
            *channel = table[usize::from(*channel)];
        }
    }
    levels
}

fn texture(
    context: &Context,
    (label, format): (&str, wgpu::TextureFormat),
    [width, height]: [u32; 2],
    layers: u32,
    mips: u32,
) -> wgpu::Texture {
    context.device.create_texture(&wgpu::TextureDescriptor {
        label: Some(label),
        size: wgpu::Extent3d { width, height, depth_or_array_layers: layers },
        mip_level_count: mips,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    })
}

/// Writes one mipmap level of one layer.
fn upload(
    context: &Context,
    texture: &wgpu::Texture,
    [width, height]: [u32; 2],
    layer: u32,
    mip_level: u32,
    bytes: &[u8],
) {
    context.queue.write_texture(
        wgpu::TexelCopyTextureInfo {
            texture,
            mip_level,
            origin: wgpu::Origin3d { x: 0, y: 0, z: layer },
            aspect: wgpu::TextureAspect::All,
        },
        bytes,
        wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(bytes.len() as u32 / height),
            rows_per_image: Some(height),
        },
        wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
    );
}

/// Mipmap chain of a square sRGB picture by a box filter, averaged approximately in linear light.
fn mipmaps(base: Vec<u8>, size: u32) -> Vec<Vec<u8>> {
    let mut levels = vec![base];
    let mut edge = size as usize;
    while edge > 1 {
        let above = &levels[levels.len() - 1];
        let half = edge / 2;
        let mut level = Vec::with_capacity(half * half * 4);
        for y in 0..half {
            for x in 0..half {
                for channel in 0..4 {
                    let at = |dx: usize, dy: usize| {
                        f32::from(above[((2 * y + dy) * edge + 2 * x + dx) * 4 + channel])
                    };
                    let four = [at(0, 0), at(1, 0), at(0, 1), at(1, 1)];
                    let mean = if channel == 3 {
                        four.iter().sum::<f32>() / 4.0
                    } else {
                        // A square is near enough to the sRGB curve.
                        (four.iter().map(|v| v * v).sum::<f32>() / 4.0).sqrt()
                    };
                    level.push((mean + 0.5) as u8);
                }
            }
        }
        levels.push(level);
        edge = half;
    }
    levels
}
