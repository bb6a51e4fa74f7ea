// Contact shadow: a dark blended rectangle under a vehicle, where little light of the sky arrives.

struct VertexIn {
    // Corner of the unit square from -1 to 1.
    @builtin(vertex_index) corner: u32,
    @location(5) row_x: vec4<f32>,
    @location(6) row_y: vec4<f32>,
    @location(7) row_z: vec4<f32>,
    // Half length and half width of the body.
    @location(8) half_size: vec4<f32>,
}

struct Fragment {
    @builtin(position) clip: vec4<f32>,
    // Body frame, metres.
    @location(0) at: vec2<f32>,
    @location(1) @interpolate(flat) half_size: vec2<f32>,
    // Share of the road's light that comes through the fog.
    @location(2) clear: f32,
}

const SPREAD: f32 = 0.55;

@vertex
fn vertex_main(in: VertexIn) -> Fragment {
    let corner = vec2<f32>(f32(in.corner & 1u), f32(in.corner >> 1u)) * 2.0 - 1.0;
    let at = corner * (in.half_size.xy + SPREAD);
    let local = vec4<f32>(at, 0.0, 1.0);
    // On the road, whatever the suspension does with the body.
    let world = vec3<f32>(dot(in.row_x, local), dot(in.row_y, local), 0.02);
    var out: Fragment;
    out.clip = view.clip_from_world * vec4<f32>(world, 1.0);
    out.at = at;
    out.half_size = in.half_size.xy;
    out.clear = fog_transmittance(world - view.eye.xyz, view.eye.z, frame.haze.w);
    return out;
}

@fragment
fn fragment_main(in: Fragment) -> @location(0) vec4<f32> {
    let outside = length(max(abs(in.at) - (in.half_size - 0.35), vec2<f32>(0.0)));
    let dark = 1.0 - smoothstep(0.0, SPREAD + 0.35, outside);
    return vec4<f32>(0.0, 0.0, 0.0, 0.72 * dark * in.clear);
}
