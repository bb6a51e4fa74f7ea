// Glow of lamps at night: additive billboards, for light that eye and damp air scatter. They write neither depth nor
// class.

struct VertexIn {
    // Corner of a square from -1 to 1.
    @builtin(vertex_index) corner: u32,
    // Centre in the city; w: radius of the glow, metres.
    @location(0) at: vec4<f32>,
    // Radiance at the centre; w: exponent of the beam, 0 for light to all sides.
    @location(1) colour: vec4<f32>,
    // Unit vector along the beam.
    @location(2) ahead: vec4<f32>,
}

struct Fragment {
    @builtin(position) clip: vec4<f32>,
    // From the centre, 1 at the rim.
    @location(0) at: vec2<f32>,
    @location(1) @interpolate(flat) colour: vec3<f32>,
}

// Limits of the radius, as shares of half the picture's height: smaller glows become fainter instead, larger ones would
// veil the picture.
const MIN_RADIUS: f32 = 0.012;
const MAX_RADIUS: f32 = 0.20;
// Whether glow near the eye stays close to its lamp, so that housing and body are seen around it.
override bounded: bool = false;
// Share of the radius of a vehicle's lamp that is near, its limit, and its brightness; and distances between which it
// becomes that of a far one, metres.
const NEAR_SHARE: f32 = 0.45;
const NEAR_MAX_RADIUS: f32 = 0.085;
const NEAR_BRIGHTNESS: f32 = 0.55;
const NEAR_M: vec2<f32> = vec2<f32>(18.0, 70.0);
// In fog the radius of a glow is this many times as large, with a limit of its own, and its centre less bright.
const FOG_WIDER: f32 = 2.8;
const FOG_MAX_RADIUS: f32 = 0.42;
const FOG_BRIGHTNESS: f32 = 0.5;
// Depth offset towards the eye: housing, pole or body lie less than this in front of the lens, metres.
const HOUSING: f32 = 0.45;
// Below a lamp the body of its vehicle is nearer to the eye by less than this, metres.
const BODY: f32 = 0.9;

@vertex
fn vertex_main(in: VertexIn) -> Fragment {
    let corner = vec2<f32>(f32(in.corner & 1u), f32(in.corner >> 1u)) * 2.0 - 1.0;
    let to_eye = view.eye.xyz - in.at.xyz;
    let distance = max(length(to_eye), 1e-3);
    let direction = to_eye / distance;
    let towards = max(dot(direction, in.ahead.xyz), 0.0);
    // Shades keep the light of street lamps down.
    var beam = clamp(1.0 - 1.6 * direction.z, 0.3, 1.0);
    if in.colour.w > 0.0 {
        beam = 0.12 * towards + 0.88 * pow(towards, in.colour.w);
    }
    let m = view.clip_from_world;
    let lens = m * vec4<f32>(in.at.xyz + direction * min(HOUSING, 0.5 * distance), 1.0);
    // Shares of half the picture's width and height that a metre covers at the lens.
    let across = length(vec3<f32>(m[0].x, m[1].x, m[2].x)) / max(lens.w, 1e-3);
    let upright = length(vec3<f32>(m[0].y, m[1].y, m[2].y)) / max(lens.w, 1e-3);
    var wanted = in.at.w * upright;
    var largest = MAX_RADIUS;
    var bright = 1.0;
    if bounded && in.colour.w > 0.0 {
        let far = smoothstep(NEAR_M.x, NEAR_M.y, distance);
        wanted *= mix(NEAR_SHARE, 1.0, far);
        largest = NEAR_MAX_RADIUS;
        bright = mix(NEAR_BRIGHTNESS, 1.0, far);
    }
    // Fog, which wets the ground a little, scatters light far around a lamp.
    if frame.shadow_texel.z > 0.0 && frame.shadow_texel.z < 0.9 {
        wanted *= FOG_WIDER;
        largest = min(largest * FOG_WIDER, FOG_MAX_RADIUS);
        bright *= FOG_BRIGHTNESS;
    }
    let radius = clamp(wanted, MIN_RADIUS, largest);
    let fainter = min(wanted / MIN_RADIUS, 1.0);
    let clear = fog_transmittance(-to_eye, view.eye.z, frame.haze.w);
    var out: Fragment;
    out.at = corner;
    out.colour = in.colour.rgb * (bright * beam * fainter * fainter * clear * frame.zenith.w);
    let is_seen = lens.w > 0.0 && max(out.colour.r, max(out.colour.g, out.colour.b)) * frame.sun.w > 0.004;
    let reach = select(0.0, radius, is_seen);
    out.clip = lens + vec4<f32>(corner * vec2<f32>(across / upright, 1.0) * (reach * lens.w), 0.0, 0.0);
    // The lower edge of a vehicle's billboard leans towards the eye, in front of the body and the ground below the
    // lamp.
    if corner.y < 0.0 && in.colour.w > 0.0 {
        let drop = max(radius / max(upright, 1e-6) - in.at.z, 0.0);
        let on_ground = 0.97 * max(view.eye.z, 0.0) / max(view.eye.z + drop, 1e-3);
        let part = max(min(on_ground, 1.0 - BODY / distance), 0.3);
        let before = m * vec4<f32>(mix(view.eye.xyz, in.at.xyz, part), 1.0);
        out.clip.z = before.z / before.w * out.clip.w;
    }
    return out;
}

// Half the length of a mirrored lamp along the road, as a share of the distance of the mirror image's place, and half its width.
const STREAK_LENGTH: f32 = 0.45;
const STREAK_WIDTH: f32 = 0.014;
const STREAK_MIN_WIDTH_M: f32 = 0.22;
// Height over the road, above its slope and wear, metres.
const STREAK_HEIGHT_M: f32 = 0.04;

// A wet road mirrors a lamp: around the place where the ray from the eye to the mirror image meets the road, drawn out
// towards the eye by the roughness of the road (Fresnel term of water by Schlick 1994).
@vertex
fn mirrored_vertex(in: VertexIn) -> Fragment {
    let corner = vec2<f32>(f32(in.corner & 1u), f32(in.corner >> 1u)) * 2.0 - 1.0;
    let eye = view.eye.xyz;
    let to_image = vec3<f32>(in.at.xy, -in.at.z) - eye;
    let distance = max(length(to_image), 1e-3);
    let road = eye + to_image * (eye.z / max(eye.z + in.at.z, 1e-3));
    let from_lamp = normalize(road - in.at.xyz);
    var beam = 1.0;
    if in.colour.w > 0.0 {
        let towards = max(dot(from_lamp, in.ahead.xyz), 0.0);
        beam = 0.12 * towards + 0.88 * pow(towards, in.colour.w);
    }
    let grazing = 1.0 - clamp(-to_image.z / distance, 0.0, 1.0);
    let squared = grazing * grazing;
    let fresnel = 0.02 + 0.98 * squared * squared * grazing;
    let clear = fog_transmittance(to_image, eye.z, frame.haze.w);
    let reach = length(road.xy - eye.xy);
    let ahead = (road.xy - eye.xy) / max(reach, 1e-3);
    let along = ahead * (STREAK_LENGTH * reach * corner.y);
    let across = vec2<f32>(-ahead.y, ahead.x) * (max(STREAK_WIDTH * reach, STREAK_MIN_WIDTH_M) * corner.x);
    let is_mirrored = eye.z > STREAK_HEIGHT_M && in.at.z > 0.0;
    var out: Fragment;
    out.at = corner;
    out.colour = in.colour.rgb * select(0.0, fresnel * beam * clear * frame.zenith.w * frame.shadow_texel.z, is_mirrored);
    out.clip = view.clip_from_world * vec4<f32>(road.xy + along + across, STREAK_HEIGHT_M, 1.0);
    return out;
}

// Radial falloff: steep at the centre, then slow, 0 at the rim.
fn glow_of(in: Fragment) -> vec3<f32> {
    let far = min(dot(in.at, in.at), 1.0);
    let rim = 1.0 - far;
    return in.colour * (rim * rim * (0.035 / (0.035 + far)));
}

// A streak: bright along its middle, and fading towards its ends.
fn streak_of(in: Fragment) -> vec3<f32> {
    let ends = max(1.0 - in.at.y * in.at.y, 0.0);
    let side = min(in.at.x * in.at.x, 1.0);
    let rim = 1.0 - side;
    return in.colour * (0.45 * ends * ends * rim * rim * (0.05 / (0.05 + side)));
}

@fragment
fn mirrored_fragment(in: Fragment) -> @location(0) vec4<f32> {
    return vec4<f32>(streak_of(in), 0.0);
}

@fragment
fn mirrored_vertex_lit_fragment(in: Fragment) -> @location(0) vec4<f32> {
    return screen_blended(streak_of(in));
}

@fragment
fn fragment_main(in: Fragment) -> @location(0) vec4<f32> {
    let glow = glow_of(in);
    // Ambient occlusion must not darken glow: alpha reduces the ambient share of the sample.
    return vec4<f32>(glow, min(2.0 * max(glow.r, max(glow.g, glow.b)), 1.0));
}

@fragment
fn vertex_lit_fragment(in: Fragment) -> @location(0) vec4<f32> {
    return screen_blended(glow_of(in));
}

// Screen blending: the target holds tone-mapped colours.
fn screen_blended(radiance: vec3<f32>) -> vec4<f32> {
    let x = radiance * frame.sun.w;
    let shown = (x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14);
    return vec4<f32>(sqrt(clamp(shown, vec3<f32>(0.0), vec3<f32>(1.0))), 0.0);
}
