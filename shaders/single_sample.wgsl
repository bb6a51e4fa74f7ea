// Access to the HDR target and the depth buffer without MSAA; see `multisample.wgsl`.

@group(1) @binding(0) var radiances: texture_2d<f32>;
@group(1) @binding(1) var depths: texture_depth_2d;

@group(1) @binding(3) var mirrors: texture_2d<f32>;

fn sample_count() -> u32 {
    return 1u;
}

fn radiance_at(texel: vec2<i32>, sample: u32) -> vec4<f32> {
    return textureLoad(radiances, texel, 0);
}

fn mirror_at(texel: vec2<i32>, sample: u32) -> vec4<f32> {
    return textureLoad(mirrors, texel, 0);
}

fn depth_at(texel: vec2<i32>) -> f32 {
    return textureLoad(depths, texel, 0);
}
