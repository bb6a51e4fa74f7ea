// Vehicles: instanced bodies and wheels, with emissive lamps.

struct VertexIn {
    @location(0) position: vec3<f32>,
    @location(1) normal: vec4<f32>,
    @location(2) colour: vec4<f32>,
    // Squares of the lettering on a number plate.
    @location(3) uv: vec2<f32>,
    // Part, roughness, metallic: a byte each.
    @location(4) material: u32,
    // City from body, by rows.
    @location(5) row_x: vec4<f32>,
    @location(6) row_y: vec4<f32>,
    @location(7) row_z: vec4<f32>,
    // w: number of the vehicle.
    @location(8) paint: vec4<f32>,
    // Brake, left indicator, right indicator, reverse.
    @location(9) lamps: vec4<f32>,
}

struct Fragment {
    @builtin(position) clip: vec4<f32>,
    @location(0) world: vec3<f32>,
    @location(1) normal: vec3<f32>,
    @location(2) albedo: vec4<f32>,
    @location(3) glow: vec3<f32>,
    // Roughness, metallic, share of light that clear glass absorbs, 1 for paint.
    @location(4) @interpolate(flat) finish: vec4<f32>,
    @location(5) square: vec2<f32>,
    // Of the number plate, where its digits are; 0 elsewhere.
    @location(6) @interpolate(flat) number: u32,
}

// Albedo of the whitest paint.
const PAINT_REFLECTS: f32 = 0.80;

// Shares of light that covers of lamps, glass and tinted glass absorb, and the roughness from which on glass counts as tinted.
const ABSORBED: vec3<f32> = vec3<f32>(0.05, 0.56, 0.80);
const TINTED_FROM: f32 = 0.09;

// How far a pane may be from that of the coarser body in the shadow map, metres.
const CASTER_APART: f32 = 0.06;

// Brightness of head lamps by day, as a share of that of light at the vertices.
const RUNNING_LIGHT: f32 = 0.5;

// World position, normal, material and emission of a vertex.
struct SurfaceVertex {
    world: vec3<f32>,
    normal: vec3<f32>,
    material: Material,
    glow: vec3<f32>,
}

fn part_of(in: VertexIn) -> u32 {
    return in.material & 0xffu;
}

fn surface_of(in: VertexIn) -> SurfaceVertex {
    var out: SurfaceVertex;
    let local = vec4<f32>(in.position, 1.0);
    out.world = vec3<f32>(dot(in.row_x, local), dot(in.row_y, local), dot(in.row_z, local));
    let n = in.normal.xyz;
    out.normal = vec3<f32>(dot(in.row_x.xyz, n), dot(in.row_y.xyz, n), dot(in.row_z.xyz, n));
    var albedo = vertex_colour(in.colour.rgb);
    var gloss = 0.0;
    out.glow = vec3<f32>(0.0);
    switch part_of(in) {
        case PAINT: { albedo *= in.paint.rgb * select(PAINT_REFLECTS, 1.0, flat_light); gloss = 0.5; }
        case GLASS, LENS: { gloss = 1.0; }
        case HEAD: { gloss = 0.9; out.glow = vec3<f32>(0.9, 0.88, 0.8) * (0.5 + 4.0 * frame.zenith.w); }
        case TAIL: { gloss = 0.6; out.glow = vec3<f32>(1.0, 0.02, 0.01) * (0.12 + 0.9 * frame.zenith.w + in.lamps.x * 4.5); }
        case INDICATOR_LEFT: { gloss = 0.6; out.glow = vec3<f32>(1.0, 0.32, 0.01) * in.lamps.y * 5.0; }
        case INDICATOR_RIGHT: { gloss = 0.6; out.glow = vec3<f32>(1.0, 0.32, 0.01) * in.lamps.z * 5.0; }
        case REVERSE: { gloss = 0.6; out.glow = vec3<f32>(1.0, 1.0, 0.95) * in.lamps.w * 4.0; }
        case BRIGHT: { gloss = 0.7; }
        default: {}
    }
    out.material = Material(albedo, gloss, in.colour.a);
    return out;
}

@vertex
fn vertex_main(in: VertexIn) -> Fragment {
    let surface = surface_of(in);
    var out: Fragment;
    out.clip = view.clip_from_world * vec4<f32>(surface.world, 1.0);
    out.world = surface.world;
    out.normal = surface.normal;
    let part = part_of(in);
    // A little of the cabin shows through the windows.
    let behind = select(0.0, 0.02, part == GLASS);
    out.albedo = vec4<f32>(surface.material.albedo + behind, surface.material.openness);
    let rough = f32((in.material >> 8u) & 0xffu) / 255.0;
    out.finish = vec4<f32>(
        select(rough, LACQUER, part == PAINT || (part >= HEAD && part <= REVERSE)),
        f32((in.material >> 16u) & 0xffu) / 255.0,
        select(ABSORBED.x, select(ABSORBED.y, ABSORBED.z, rough > TINTED_FROM), part == GLASS),
        select(0.0, 1.0, part == PAINT),
    );
    out.square = in.uv;
    out.number = select(0u, registration_number(u32(in.paint.w)), part == NUMBER);
    // Running lights by day leave the lamp behind its glass to be seen.
    let is_by_day = frame.zenith.w <= 0.0;
    out.glow = surface.glow * select(1.0, RUNNING_LIGHT, part == HEAD && is_by_day);
    return out;
}

@fragment
fn fragment_main(in: Fragment) -> @location(0) vec4<f32> {
    return lit_pixel(in).radiance;
}

@fragment
fn reflecting_fragment(in: Fragment) -> HdrPixel {
    return lit_pixel(in);
}

fn lit_pixel(in: Fragment) -> HdrPixel {
    var m: PbrMaterial;
    m.albedo = in.albedo.rgb;
    let square_dx = vec4<f32>(dpdx(in.square), dpdy(in.square));
    if in.number > 0u {
        m.albedo = number_on_plate(in.square, square_dx, in.number);
    }
    m.openness = in.albedo.a;
    m.roughness = in.finish.x;
    m.metallic = in.finish.y;
    m.translucent = 0.0;
    m.coated = in.finish.w;
    let from_eye = in.world - view.eye.xyz;
    let lit = shade(m, in.world, normalize(in.normal), -normalize(from_eye));
    return hdr_pixel(lit, in.glow, from_eye);
}

// Clear glass: the reflection of the sky by Fresnel over what is behind it, premultiplied.
@fragment
fn glass_fragment(in: Fragment) -> @location(0) vec4<f32> {
    let from_eye = in.world - view.eye.xyz;
    let to_eye = -normalize(from_eye);
    let normal = normalize(in.normal);
    let n_v = max(dot(normal, to_eye), 1e-3);
    // Less than of a perfect plane: seen along a flank, proud panes would be a bright fringe.
    let fresnel = 0.05 + 0.60 * pow5(1.0 - n_v);
    var radiance = reflected_radiance(in.world, reflect(-to_eye, normal), 0.02) * fresnel;
    let n_l = dot(normal, frame.to_sun.xyz);
    if n_l > 0.0 {
        let halfway = normalize(frame.to_sun.xyz + to_eye);
        let glint = ggx_specular(max(dot(normal, halfway), 0.0), n_l, n_v, 0.1) * n_l * fresnel;
        // The pane casts a shadow itself, a little beside this one.
        let before = in.world + normal * CASTER_APART;
        radiance += frame.sun.rgb * min(glint * sun_visibility(before, normal), 12.0);
    }
    let covers = 1.0 - (1.0 - fresnel) * (1.0 - in.finish.z);
    let clear = fog_transmittance(from_eye, view.eye.z, frame.haze.w);
    let seen = radiance * clear + frame.haze.rgb * (covers * (1.0 - clear));
    return vec4<f32>(min(seen, vec3<f32>(3e4)), covers);
}

fn untextured_of(in: VertexIn) -> Untextured {
    let surface = surface_of(in);
    return light_untextured(surface.material, surface.world, normalize(surface.normal), surface.glow);
}

@vertex
fn untextured_vertex(in: VertexIn) -> Untextured {
    return untextured_of(in);
}

@vertex
fn flat_vertex(in: VertexIn) -> Flat {
    let lit = untextured_of(in);
    return Flat(lit.clip, lit.colour);
}
