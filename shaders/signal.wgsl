// Lit lenses of traffic signals: discs that shine by day and night, drawn over the dark lenses of the scene.

struct VertexIn {
    // Corner of a square from -1 to 1.
    @builtin(vertex_index) corner: u32,
    // Middle of the lens in the city; w: its radius, metres.
    @location(0) at: vec4<f32>,
    // Radiance.
    @location(1) colour: vec4<f32>,
    // Unit vector out of the lens.
    @location(2) facing: vec4<f32>,
}

struct Fragment {
    @builtin(position) clip: vec4<f32>,
    // From the middle, 1 at the rim.
    @location(0) at: vec2<f32>,
    @location(1) @interpolate(flat) colour: vec3<f32>,
}

// In front of the dark lens: nearby less than the visor, from afar more than what simplified meshes move, metres.
const NEAR: f32 = 0.012;
const FAR: f32 = 0.35;
const SHARE: f32 = 0.003;
// From afar a lens keeps this radius in pixels, so that it covers one: an eye sees a point of light.
const LEAST_PIXELS: f32 = 0.8;

@vertex
fn vertex_main(in: VertexIn) -> Fragment {
    let corner = vec2<f32>(f32(in.corner & 1u), f32(in.corner >> 1u)) * 2.0 - 1.0;
    let to_eye = view.eye.xyz - in.at.xyz;
    let distance = max(length(to_eye), 1e-3);
    let m = view.clip_from_world;
    let upright = length(vec3<f32>(m[0].y, m[1].y, m[2].y)) / max((m * vec4<f32>(in.at.xyz, 1.0)).w, 1e-3);
    let radius = max(in.at.w, 2.0 * LEAST_PIXELS / view.extent.y / max(upright, 1e-6));
    let right = cross(vec3<f32>(0.0, 0.0, 1.0), in.facing.xyz);
    let on_lens = in.at.xyz + right * (corner.x * radius) + vec3<f32>(0.0, 0.0, corner.y * radius);
    let before = clamp(SHARE * distance, NEAR, FAR);
    // Towards the eye, so that the place in the picture stays.
    let place = on_lens + (view.eye.xyz - on_lens) * (min(before, 0.5 * distance) / distance);
    var out: Fragment;
    out.at = corner;
    let clear = fog_transmittance(-to_eye, view.eye.z, frame.haze.w);
    out.colour = in.colour.rgb * clear;
    out.clip = m * vec4<f32>(place, 1.0);
    // From behind nothing is seen.
    if dot(to_eye, in.facing.xyz) <= 0.0 {
        out.clip = vec4<f32>(0.0, 0.0, -1.0, 1.0);
    }
    return out;
}

// Brighter in the middle, as a lens spreads its lamp's light.
fn radiance(in: Fragment) -> vec3<f32> {
    let far = dot(in.at, in.at);
    if far > 1.0 {
        discard;
    }
    return in.colour * (1.25 - 0.5 * far);
}

@fragment
fn fragment_main(in: Fragment) -> @location(0) vec4<f32> {
    // Ambient occlusion takes nothing of it.
    return vec4<f32>(radiance(in), 0.0);
}

@fragment
fn reflecting_fragment(in: Fragment) -> HdrPixel {
    // Nothing takes light from it.
    return HdrPixel(vec4<f32>(radiance(in), -1.0), vec4<f32>(0.0));
}

// The target holds tone-mapped colours.
@fragment
fn vertex_lit_fragment(in: Fragment) -> @location(0) vec4<f32> {
    let x = radiance(in) * frame.sun.w;
    let shown = (x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14);
    return vec4<f32>(sqrt(clamp(shown, vec3<f32>(0.0), vec3<f32>(1.0))), 1.0);
}
