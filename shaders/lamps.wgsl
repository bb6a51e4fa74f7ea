// Light map of lamps: light of street lamps and vehicles on the ground, drawn from above.

// Walls near lamps, one list per lamp: segments from xy to zw, metres.
@group(1) @binding(0) var<storage, read> walls: array<vec4<f32>>;

struct Spot {
    @builtin(position) clip: vec4<f32>,
    // Metres, from the foot of the lamp or in the body frame.
    @location(0) at: vec2<f32>,
    // Street lamp: height. Vehicle: half length, half width, brake light.
    @location(1) @interpolate(flat) size: vec3<f32>,
    // Lens and lit point, city metres.
    @location(2) @interpolate(flat) lens: vec2<f32>,
    @location(3) place: vec2<f32>,
    // First wall and number of walls of this lamp.
    @location(4) @interpolate(flat) list: vec2<u32>,
}

// Shadow test: whether no wall intersects the segment from the lens to the lit point, in 2D.
fn is_unoccluded(spot: Spot) -> bool {
    let ray = spot.place - spot.lens;
    for (var k = 0u; k < spot.list.y; k++) {
        let wall = walls[spot.list.x + k];
        let along = wall.zw - wall.xy;
        let off = wall.xy - spot.lens;
        let across = ray.x * along.y - ray.y * along.x;
        let t = (off.x * along.y - off.y * along.x) / across;
        let u = (off.x * ray.y - off.y * ray.x) / across;
        if t > 0.0 && t < 1.0 && u >= 0.0 && u <= 1.0 {
            return false;
        }
    }
    return true;
}

// Clip coordinates in the light map from city metres.
fn on_map(world: vec2<f32>) -> vec4<f32> {
    let uv = world * frame.lamp_uv_from_world.xy + frame.lamp_uv_from_world.zw;
    return vec4<f32>(uv.x * 2.0 - 1.0, 1.0 - uv.y * 2.0, 0.0, 1.0);
}

fn corner_of(index: u32) -> vec2<f32> {
    return vec2<f32>(f32(index & 1u), f32(index >> 1u)) * 2.0 - 1.0;
}

@vertex
fn lamp_vertex(
    @builtin(vertex_index) corner: u32,
    @location(0) lamp: vec3<f32>,
    @location(10) list: vec2<u32>,
) -> Spot {
    let at = corner_of(corner) * LAMP_REACH_M;
    let place = lamp.xy + at;
    return Spot(on_map(place), at, vec3<f32>(lamp.z, 0.0, 0.0), lamp.xy, place, list);
}

@fragment
fn lamp_fragment(in: Spot) -> @location(0) vec4<f32> {
    let far = dot(in.at, in.at);
    let height = in.size.x;
    // Falloff of street lamps: their optics spread light to the sides, so it is less steep than the cosine law.
    let fall = pow(height * height / (height * height + far), 1.9);
    let edge = select(0.0, clamp(1.0 - far / (LAMP_REACH_M * LAMP_REACH_M), 0.0, 1.0), is_unoccluded(in));
    // Alpha holds the light of street lamps alone.
    let light = 0.64 * fall * edge * edge;
    return vec4<f32>(vec3<f32>(1.05, 0.80, 0.48) * light, light);
}

struct Vehicle {
    @builtin(vertex_index) corner: u32,
    @location(5) row_x: vec4<f32>,
    @location(6) row_y: vec4<f32>,
    @location(8) half_size: vec4<f32>,
    @location(9) lamps: vec4<f32>,
    @location(10) list: vec2<u32>,
}

// Ends of the area that a vehicle lights, body frame, and half its width there, metres.
const LIT_BEHIND: vec2<f32> = vec2<f32>(-8.0, 4.5);
const LIT_AHEAD: vec2<f32> = vec2<f32>(42.0, 10.0);

@vertex
fn beam_vertex(in: Vehicle) -> Spot {
    let c = corner_of(in.corner);
    let end = select(LIT_BEHIND, LIT_AHEAD, c.x > 0.0);
    let at = vec2<f32>(end.x, c.y * end.y);
    let local = vec4<f32>(at, 0.0, 1.0);
    let place = vec2<f32>(dot(in.row_x, local), dot(in.row_y, local));
    let nose = vec4<f32>(in.half_size.x, 0.0, 0.0, 1.0);
    let lens = vec2<f32>(dot(in.row_x, nose), dot(in.row_y, nose));
    return Spot(on_map(place), at, vec3<f32>(in.half_size.xy, in.lamps.x), lens, place, in.list);
}

// Dipped headlight of right-hand traffic, `at` metres from its lens: a wide pool nearby and a narrow one ahead. The cut-off
// meets the road farther away on the kerb's side.
fn beam(at: vec2<f32>) -> f32 {
    let slope = at.y / (max(at.x, 0.01) + 1.5);
    let aside = slope * slope;
    let cone = 0.26 * exp(-aside * 6.0) + 0.74 * exp(-aside * 30.0);
    // The pattern of the lens makes up for distance: it sends little to the road close by.
    let fall = 0.22 / (1.0 + at.x * at.x / 900.0);
    let cut_off_m = mix(25.0, 39.0, smoothstep(-0.05, 0.14, -slope));
    return cone * fall * smoothstep(0.2, 3.2, at.x) * (1.0 - smoothstep(0.6 * cut_off_m, cut_off_m, at.x));
}

@fragment
fn beam_fragment(in: Spot) -> @location(0) vec4<f32> {
    let side = in.size.y * 0.75;
    let x = in.at.x - in.size.x;
    let part = (in.at.x - LIT_BEHIND.x) / (LIT_AHEAD.x - LIT_BEHIND.x);
    let inside = 1.0 - smoothstep(0.45, 1.0, abs(in.at.y) / mix(LIT_BEHIND.y, LIT_AHEAD.y, part));
    let ahead = (beam(vec2<f32>(x, in.at.y - side)) + beam(vec2<f32>(x, in.at.y + side))) * inside;
    let behind = -in.at.x - in.size.x;
    let tail = exp(-(behind * behind + in.at.y * in.at.y * 0.6)) * smoothstep(-0.4, 0.3, behind);
    let light = vec3<f32>(1.0, 0.90, 0.74) * ahead * HEADLIGHT
        + vec3<f32>(1.0, 0.05, 0.03) * tail * (0.22 + 0.7 * in.size.z);
    return vec4<f32>(select(vec3<f32>(0.0), light, is_unoccluded(in)), 0.0);
}

// Light of one headlight on the road, before what its distance takes; a street lamp has 0.64 at its foot.
const HEADLIGHT: f32 = 2.6;
