//! Bind group 1: shadow map of the sun, light map of lamps and environment map of the sky, with their samplers.

use super::{sampler_entry, texture_entry};
use crate::Context;

/// Bind group 1 of the colour passes.
#[derive(Debug)]
pub(crate) struct LightBindGroup {
    pub(crate) layout: wgpu::BindGroupLayout,
    pub(crate) group: wgpu::BindGroup,
}

impl LightBindGroup {
    pub(crate) fn new(
        Context { device, is_software, .. }: &Context,
        shadow_map: &wgpu::TextureView,
        lamp_map: &wgpu::TextureView,
        sky_map: &wgpu::TextureView,
    ) -> Self {
        let filterable = wgpu::TextureSampleType::Float { filterable: true };
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("light"),
            entries: &[
                texture_entry(0, wgpu::TextureSampleType::Depth, wgpu::TextureViewDimension::D2),
                sampler_entry(1, wgpu::SamplerBindingType::Comparison),
                texture_entry(2, filterable, wgpu::TextureViewDimension::D2),
                sampler_entry(3, wgpu::SamplerBindingType::Filtering),
                texture_entry(4, filterable, wgpu::TextureViewDimension::D2),
                sampler_entry(5, wgpu::SamplerBindingType::Filtering),
            ],
        });
        let sampler = device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("shadow"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            compare: Some(wgpu::CompareFunction::LessEqual),
            ..Default::default()
        });
        let smooth = device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("lamplight"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            ..Default::default()
        });
        let between_levels = device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("mirrored sky"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            mipmap_filter: if *is_software {
                wgpu::MipmapFilterMode::Nearest
            } else {
                wgpu::MipmapFilterMode::Linear
            },
            ..Default::default()
        });
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("light"),
            layout: &layout,
            entries: &[
                wgpu::BindGroupEntry { binding: 0, resource: wgpu::BindingResource::TextureView(shadow_map) },
                wgpu::BindGroupEntry { binding: 1, resource: wgpu::BindingResource::Sampler(&sampler) },
                wgpu::BindGroupEntry { binding: 2, resource: wgpu::BindingResource::TextureView(lamp_map) },
                wgpu::BindGroupEntry { binding: 3, resource: wgpu::BindingResource::Sampler(&smooth) },
                wgpu::BindGroupEntry { binding: 4, resource: wgpu::BindingResource::TextureView(sky_map) },
                wgpu::BindGroupEntry {
                    binding: 5,
                    resource: wgpu::BindingResource::Sampler(&between_levels),
                },
            ],
        });
        Self { layout, group }
    }
}
