// Access to the HDR target and the depth buffer with MSAA; see `single_sample.wgsl`.

@group(1) @binding(0) var radiances: texture_multisampled_2d<f32>;
@group(1) @binding(1) var depths: texture_depth_multisampled_2d;

@group(1) @binding(3) var mirrors: texture_multisampled_2d<f32>;

fn sample_count() -> u32 {
    return textureNumSamples(radiances);
}

fn radiance_at(texel: vec2<i32>, sample: u32) -> vec4<f32> {
    return textureLoad(radiances, texel, sample);
}

fn mirror_at(texel: vec2<i32>, sample: u32) -> vec4<f32> {
    return textureLoad(mirrors, texel, sample);
}

// Depth of the first sample.
fn depth_at(texel: vec2<i32>) -> f32 {
    return textureLoad(depths, texel, 0);
}
