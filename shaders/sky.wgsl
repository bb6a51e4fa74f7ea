// Sky box around the eye: panorama texture, disc of sun or moon, stars; drawn at the far plane.

@group(2) @binding(0) var panorama: texture_2d<f32>;
@group(2) @binding(1) var panorama_sampler: sampler;

struct VertexIn {
    // Corner of the box.
    @location(0) direction: vec3<f32>,
    @location(1) uv: vec2<f32>,
}

struct Fragment {
    @builtin(position) clip: vec4<f32>,
    @location(0) uv: vec2<f32>,
}

@vertex
fn vertex_main(in: VertexIn) -> Fragment {
    var out: Fragment;
    let clip = view.clip_from_world * vec4<f32>(view.eye.xyz + in.direction * 100.0, 1.0);
    // Depth 0 is the far plane.
    out.clip = vec4<f32>(clip.xy, 0.0, clip.w);
    out.uv = in.uv;
    return out;
}

struct StarIn {
    // Unit vector.
    @location(0) direction: vec3<f32>,
    // Radiance; displayed colour where the panorama holds displayed colours.
    @location(1) colour: vec3<f32>,
}

struct Star {
    @builtin(position) clip: vec4<f32>,
    @location(0) @interpolate(flat) colour: vec3<f32>,
}

// Stars are points, because texels of the panorama are much larger.
@vertex
fn star_vertex(in: StarIn) -> Star {
    let clip = view.clip_from_world * vec4<f32>(view.eye.xyz + in.direction * 100.0, 1.0);
    return Star(vec4<f32>(clip.xy, 0.0, clip.w), in.colour);
}

@fragment
fn star_fragment(in: Star) -> @location(0) vec4<f32> {
    return vec4<f32>(in.colour, 0.0);
}

@fragment
fn fragment_main(in: Fragment) -> @location(0) vec4<f32> {
    // Alpha 0: no ambient occlusion on the sky.
    return vec4<f32>(textureSample(panorama, panorama_sampler, in.uv).rgb, 0.0);
}

// Preset `low`: panorama and target both hold sRGB values.
@fragment
fn vertex_lit_fragment(in: Fragment) -> @location(0) vec4<f32> {
    return vec4<f32>(textureSample(panorama, panorama_sampler, in.uv).rgb, 1.0);
}
