// The city that stands: ground, roads, markings, buildings, trees.

@group(2) @binding(0) var surfaces: texture_2d_array<f32>;
@group(2) @binding(1) var surface_sampler: sampler;

// Breaks up the repetition of ground textures by a second, larger look at them.
override detail: bool = true;

struct VertexIn {
    @location(0) position: vec3<f32>,
    @location(1) normal: vec4<f32>,
    @location(2) colour: vec4<f32>,
    @location(3) uv: vec2<f32>,
    @location(4) material: u32,
}

struct Fragment {
    @builtin(position) clip: vec4<f32>,
    @location(0) world: vec3<f32>,
    @location(1) normal: vec3<f32>,
    @location(2) colour: vec4<f32>,
    @location(3) uv: vec2<f32>,
    @location(4) @interpolate(flat) layer: u32,
}

@vertex
fn vertex_main(in: VertexIn) -> Fragment {
    var out: Fragment;
    out.clip = view.clip_from_world * vec4<f32>(in.position, 1.0);
    out.world = in.position;
    out.normal = in.normal.xyz;
    out.colour = vec4<f32>(linear_from_srgb(in.colour.rgb), in.colour.a);
    out.uv = in.uv;
    out.layer = in.material & 0xffu;
    return out;
}

@fragment
fn fragment_main(in: Fragment) -> @location(0) vec4<f32> {
    let texel = textureSampleBias(surfaces, surface_sampler, in.uv, in.layer, -0.5);
    var pattern = texel.rgb;
    if detail {
        let broad = textureSample(surfaces, surface_sampler, in.uv * 0.113 + 0.37, in.layer).rgb;
        if in.layer >= 1u && in.layer <= 2u {
            pattern = pattern * (0.45 + 1.1 * broad / max(vec3<f32>(0.05), vec3<f32>(dot(broad, vec3<f32>(0.1)) + 0.45)));
        }
    }
    var m: Material;
    m.albedo = pattern * in.colour.rgb;
    m.gloss = 1.0 - texel.a;
    m.openness = in.colour.a;
    let from_eye = in.world - view.eye.xyz;
    let distance = length(from_eye);
    let radiance = shade(m, in.world, normalize(in.normal), -from_eye / distance);
    return display(hazed(radiance, distance));
}

@vertex
fn swift_vertex(in: VertexIn) -> Swift {
    let colour = vec4<f32>(linear_from_srgb(in.colour.rgb), in.colour.a);
    var out = swift_light(Material(colour.rgb, 0.0, colour.a), in.position, in.normal.xyz, vec3<f32>(0.0));
    out.uv = in.uv;
    out.layer = in.material & 0xffu;
    return out;
}

@fragment
fn swift_fragment(in: Swift) -> @location(0) vec4<f32> {
    let texel = textureSample(surfaces, surface_sampler, in.uv, in.layer).rgb;
    return swift_shade(in, linear_from_srgb(texel));
}
