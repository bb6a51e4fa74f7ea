// Overlays over a finished picture: lines of constant width on the screen, and surfaces. What the depth buffer of the
// picture has in front of them hides them.

// Whether the target is of an sRGB format, which encodes once more.
override target_is_srgb: bool = false;

// Tolerance of the depth test: relative, as reversed depth is nearly the inverse of the distance. Lines a hand above the
// road stay before coarser meshes of it.
const TOLERANCE: f32 = 0.004;
// Pixels over which the edge of a line fades.
const EDGE: f32 = 1.0;

struct Line {
    @location(0) start: vec3<f32>,
    // Pixels.
    @location(1) width: f32,
    @location(2) end: vec3<f32>,
    // Share of the opacity where something is in front.
    @location(3) behind: f32,
    @location(4) colour: vec4<f32>,
}

struct LineFragment {
    @builtin(position) clip: vec4<f32>,
    @location(0) colour: vec4<f32>,
    @location(1) behind: f32,
    // Of the same value at all corners: interpolation without perspective is not to be had everywhere.
    @location(2) @interpolate(flat) half_width: f32,
    // A point of the line and its normal, pixels.
    @location(3) @interpolate(flat) middle: vec4<f32>,
}

struct Corner {
    @location(0) position: vec3<f32>,
    @location(1) behind: f32,
    @location(2) colour: vec4<f32>,
}

struct SurfaceFragment {
    @builtin(position) clip: vec4<f32>,
    @location(0) colour: vec4<f32>,
    @location(1) behind: f32,
}

// How far a point in clip coordinates is beyond the near plane; negative before it.
fn beyond_near(clip: vec4<f32>) -> f32 {
    return clip.w - clip.z;
}

@vertex
fn line_vertex(@builtin(vertex_index) corner: u32, line: Line) -> LineFragment {
    var from_clip = view.clip_from_world * vec4<f32>(line.start, 1.0);
    var to_clip = view.clip_from_world * vec4<f32>(line.end, 1.0);
    let half_width = 0.5 * line.width;
    let near = vec2<f32>(beyond_near(from_clip), beyond_near(to_clip));
    if near.x <= 0.0 && near.y <= 0.0 {
        return LineFragment(vec4<f32>(0.0, 0.0, 2.0, 1.0), line.colour, line.behind, half_width, vec4<f32>(0.0));
    }
    // Clipped here, because a point behind the eye has no place on the screen.
    if near.x < 0.0 {
        from_clip = mix(from_clip, to_clip, near.x / (near.x - near.y));
    } else if near.y < 0.0 {
        to_clip = mix(to_clip, from_clip, near.y / (near.y - near.x));
    }
    let half_extent = 0.5 * view.extent.xy;
    let up_right = vec2<f32>(1.0, -1.0) * half_extent;
    let from_px = half_extent + from_clip.xy / from_clip.w * up_right;
    let along = half_extent + to_clip.xy / to_clip.w * up_right - from_px;
    let length_px = length(along);
    let direction = select(vec2<f32>(1.0, 0.0), along / max(length_px, 1e-6), length_px > 1e-6);
    let normal = vec2<f32>(-direction.y, direction.x);
    let side = select(-1.0, 1.0, (corner & 1u) == 1u);
    var clip = select(from_clip, to_clip, corner > 1u);
    let offset = normal * (side * (half_width + EDGE)) / up_right;
    clip = vec4<f32>(clip.xy + offset * clip.w, clip.zw);
    return LineFragment(clip, line.colour, line.behind, half_width, vec4<f32>(from_px, normal));
}

@vertex
fn surface_vertex(corner: Corner) -> SurfaceFragment {
    let clip = view.clip_from_world * vec4<f32>(corner.position, 1.0);
    return SurfaceFragment(clip, corner.colour, corner.behind);
}

// Share of the opacity that the depth buffer leaves at a fragment.
fn seen(clip: vec4<f32>, behind: f32) -> f32 {
    let in_front = depth_at(vec2<i32>(clip.xy));
    return select(1.0, behind, clip.z * (1.0 + TOLERANCE) < in_front);
}

fn shown(colour: vec3<f32>, alpha: f32) -> vec4<f32> {
    if target_is_srgb {
        let linear = select(
            pow((colour + 0.055) / 1.055, vec3<f32>(2.4)),
            colour / 12.92,
            colour < vec3<f32>(0.04045)
        );
        return vec4<f32>(linear, alpha);
    }
    return vec4<f32>(colour, alpha);
}

@fragment
fn line_fragment(in: LineFragment) -> @location(0) vec4<f32> {
    let across = abs(dot(in.clip.xy - in.middle.xy, in.middle.zw));
    let coverage = clamp((in.half_width + 0.5 * EDGE - across) / EDGE, 0.0, 1.0);
    return shown(in.colour.rgb, in.colour.a * coverage * seen(in.clip, in.behind));
}

@fragment
fn surface_fragment(in: SurfaceFragment) -> @location(0) vec4<f32> {
    return shown(in.colour.rgb, in.colour.a * seen(in.clip, in.behind));
}
