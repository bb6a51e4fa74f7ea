// Panels: triangles of egui, premultiplied colours as displayed.

struct Screen {
    // Width and height, points.
    size: vec2<f32>,
}

@group(0) @binding(0) var<uniform> screen: Screen;
@group(1) @binding(0) var texels: texture_2d<f32>;
@group(1) @binding(1) var texel_sampler: sampler;

struct Corner {
    @builtin(position) clip: vec4<f32>,
    @location(0) uv: vec2<f32>,
    @location(1) colour: vec4<f32>,
}

@vertex
fn corner(@location(0) at: vec2<f32>, @location(1) uv: vec2<f32>, @location(2) colour: vec4<f32>) -> Corner {
    let clip = vec2<f32>(2.0 * at.x / screen.size.x - 1.0, 1.0 - 2.0 * at.y / screen.size.y);
    return Corner(vec4<f32>(clip, 0.0, 1.0), uv, colour);
}

fn textured(in: Corner) -> vec4<f32> {
    return in.colour * textureSample(texels, texel_sampler, in.uv);
}

@fragment
fn displayed(in: Corner) -> @location(0) vec4<f32> {
    return textured(in);
}

// For a target that encodes sRGB.
@fragment
fn linear(in: Corner) -> @location(0) vec4<f32> {
    let colour = textured(in);
    let low = colour.rgb / 12.92;
    let high = pow((colour.rgb + 0.055) / 1.055, vec3<f32>(2.4));
    return vec4<f32>(select(high, low, colour.rgb < vec3<f32>(0.04045)), colour.a);
}
