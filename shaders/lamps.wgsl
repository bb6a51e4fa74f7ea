// The map of lamplight: what reaches the ground, seen from above, of street lamps and of vehicles.

struct Spot {
    @builtin(position) clip: vec4<f32>,
    // Metres, from under the lamp or in the body's plane.
    @location(0) at: vec2<f32>,
    // Height of the lamp; or half length and half width of the body, and how hard it brakes.
    @location(1) @interpolate(flat) size: vec3<f32>,
}

// City metres to the map.
fn on_map(world: vec2<f32>) -> vec4<f32> {
    let uv = world * frame.lamp_place.xy + frame.lamp_place.zw;
    return vec4<f32>(uv.x * 2.0 - 1.0, 1.0 - uv.y * 2.0, 0.0, 1.0);
}

fn corner_of(index: u32) -> vec2<f32> {
    return vec2<f32>(f32(index & 1u), f32(index >> 1u)) * 2.0 - 1.0;
}

const REACH: f32 = 17.0;

@vertex
fn lamp_vertex(@builtin(vertex_index) corner: u32, @location(0) lamp: vec3<f32>) -> Spot {
    let at = corner_of(corner) * REACH;
    return Spot(on_map(lamp.xy + at), at, vec3<f32>(lamp.z, 0.0, 0.0));
}

@fragment
fn lamp_fragment(in: Spot) -> @location(0) vec4<f32> {
    let far = dot(in.at, in.at);
    let height = in.size.x;
    // Optics throw light to the sides: less steep than the cosine law.
    let fall = pow(height * height / (height * height + far), 1.35);
    let edge = clamp(1.0 - far / (REACH * REACH), 0.0, 1.0);
    return vec4<f32>(vec3<f32>(1.05, 0.80, 0.48) * (fall * edge * edge), 1.0);
}

struct Vehicle {
    @builtin(vertex_index) corner: u32,
    @location(5) row_x: vec4<f32>,
    @location(6) row_y: vec4<f32>,
    @location(8) half_size: vec4<f32>,
    @location(9) lamps: vec4<f32>,
}

@vertex
fn beam_vertex(in: Vehicle) -> Spot {
    let c = corner_of(in.corner);
    let at = vec2<f32>(12.0 + c.x * 20.0, c.y * 9.0);
    let local = vec4<f32>(at, 0.0, 1.0);
    let world = vec2<f32>(dot(in.row_x, local), dot(in.row_y, local));
    return Spot(on_map(world), at, vec3<f32>(in.half_size.xy, in.lamps.x));
}

// One lamp of a pair, `at` from its lens: wide nearby, and a bright patch ahead.
fn beam(at: vec2<f32>) -> f32 {
    let x = max(at.x, 0.01);
    let slope = at.y / (x + 0.8);
    let cone = exp(-slope * slope * 7.0);
    let fall = 1.0 / (1.0 + x * x / 110.0);
    return cone * fall * smoothstep(0.2, 3.0, at.x) * (1.0 - smoothstep(13.0, 27.0, at.x));
}

@fragment
fn beam_fragment(in: Spot) -> @location(0) vec4<f32> {
    let side = in.size.y * 0.75;
    let x = in.at.x - in.size.x;
    let ahead = beam(vec2<f32>(x, in.at.y - side)) + beam(vec2<f32>(x, in.at.y + side));
    let behind = -in.at.x - in.size.x;
    let tail = exp(-(behind * behind + in.at.y * in.at.y * 0.6)) * smoothstep(-0.4, 0.3, behind);
    let light = vec3<f32>(0.95, 0.92, 0.84) * ahead * 1.7
        + vec3<f32>(1.0, 0.05, 0.03) * tail * (0.22 + 0.7 * in.size.z);
    return vec4<f32>(light, 1.0);
}
