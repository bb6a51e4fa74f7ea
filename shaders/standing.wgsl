// Shadows of what stands on the ground: dark blended ellipses.

struct VertexIn {
    // Corner of the unit square from -1 to 1.
    @builtin(vertex_index) corner: u32,
    // Middle in the city, metres; w: share of the light that it takes.
    @location(0) at: vec4<f32>,
    // Unit vector along the first axis, and half the axes in metres.
    @location(1) axes: vec4<f32>,
    // How much weaker it is at the far end of the first axis.
    @location(2) fades: f32,
}

struct Fragment {
    @builtin(position) clip: vec4<f32>,
    // In half axes from the middle.
    @location(0) at: vec2<f32>,
    // Share of the light that is taken, with the fog in front; and how much weaker it is at the far end.
    @location(1) @interpolate(flat) dark: vec2<f32>,
}

// Uneven ground, in which feet stand, is lower than this above them, metres.
const LIFT_M: f32 = 0.11;
// Smaller patches are not seen: half their longer axis, pixels.
const SMALLEST_PX: f32 = 1.5;

@vertex
fn vertex_main(in: VertexIn) -> Fragment {
    let corner = vec2<f32>(f32(in.corner & 1u), f32(in.corner >> 1u)) * 2.0 - 1.0;
    let off = in.axes.xy * (corner.x * in.axes.z) + vec2<f32>(-in.axes.y, in.axes.x) * (corner.y * in.axes.w);
    let world = in.at.xyz + vec3<f32>(off, 0.0);
    let from_eye = in.at.xyz - view.eye.xyz;
    let pixels = in.axes.z * view.extent.y / max(2.0 * length(from_eye) * abs(view.camera_from_clip[1][1]), 1e-3);
    var out: Fragment;
    out.clip = view.clip_from_world * vec4<f32>(world, 1.0);
    // The depth test is that of the place above on the ray to the eye.
    // A larger one lies on ground that is less even.
    let lift = LIFT_M + 0.12 * max(in.axes.z - 1.0, 0.0);
    let raised = clamp(lift / max(view.eye.z - world.z, lift), 0.0, 0.5);
    let above = view.clip_from_world * vec4<f32>(mix(world, view.eye.xyz, raised), 1.0);
    out.clip.z = above.z / above.w * out.clip.w;
    if pixels < SMALLEST_PX {
        // No area.
        out.clip = vec4<f32>(0.0, 0.0, 0.0, 1.0);
    }
    out.at = corner;
    out.dark = vec2<f32>(in.at.w * fog_transmittance(from_eye, view.eye.z, frame.haze.w), in.fades);
    return out;
}

@fragment
fn fragment_main(in: Fragment) -> @location(0) vec4<f32> {
    // A shadow in the light of a lamp begins at the foot at its full width.
    let straight = select(0.0, 0.65, in.dark.y > 0.0);
    let off = vec2<f32>(max(abs(in.at.x) - straight, 0.0) / (1.0 - straight), in.at.y);
    let inside = 1.0 - smoothstep(0.35, 1.0, length(off));
    return vec4<f32>(0.0, 0.0, 0.0, in.dark.x * inside * (1.0 - in.dark.y * smoothstep(-0.6, 1.0, in.at.x)));
}
