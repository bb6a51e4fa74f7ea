// Static city: ground, roads, markings, buildings, trees; per pixel (PBR) and vertex-lit entry points.

@group(2) @binding(0) var surfaces: texture_2d_array<f32>;
@group(2) @binding(1) var surface_sampler: sampler;

// Detail texturing: a second, larger-scale lookup breaks up the repetition of ground textures.
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
    // Hash seed of the building or other piece.
    @location(5) @interpolate(flat) seed: u32,
}

// A model of the map: its transform to the city, by rows, and its seed.
struct Placement {
    @location(5) row_x: vec4<f32>,
    @location(6) row_y: vec4<f32>,
    @location(7) row_z: vec4<f32>,
    @location(8) seed: u32,
}

// Vertex of a model, in the city.
fn placed(in: VertexIn, at: Placement) -> VertexIn {
    var out = in;
    let local = vec4<f32>(in.position, 1.0);
    out.position = vec3<f32>(dot(at.row_x, local), dot(at.row_y, local), dot(at.row_z, local));
    let n = in.normal.xyz;
    let normal = vec3<f32>(dot(at.row_x.xyz, n), dot(at.row_y.xyz, n), dot(at.row_z.xyz, n));
    out.normal = vec4<f32>(normalize(normal), 0.0);
    out.material = (in.material & 0xff00ffffu) | (at.seed << 16u);
    return out;
}

@vertex
fn vertex_main(in: VertexIn) -> Fragment {
    return pixel_lit(in);
}

@vertex
fn instanced_vertex_main(in: VertexIn, at: Placement) -> Fragment {
    return pixel_lit(placed(in, at));
}

fn pixel_lit(in: VertexIn) -> Fragment {
    var out: Fragment;
    out.clip = view.clip_from_world * vec4<f32>(in.position, 1.0);
    out.world = in.position;
    out.normal = in.normal.xyz;
    out.colour = vec4<f32>(linear_from_srgb(in.colour.rgb), in.colour.a);
    out.uv = in.uv;
    out.layer = in.material & 0xffu;
    out.seed = (in.material >> 16u) & 0xffu;
    return out;
}

// Analytic anti-aliasing: share of a pixel that a line covers. `at.x` is the distance from the line's centre, `at.y`
// half its width, `across` the size of a pixel, all in metres. Exact for a box filter, also below one pixel.
fn line_coverage(at: vec2<f32>, across: f32) -> f32 {
    let w = max(across, 1e-4);
    return clamp((at.y - at.x) / w + 0.5, 0.0, 1.0) - clamp((-at.y - at.x) / w + 0.5, 0.0, 1.0);
}

// How wet a surface is: rain stays on what is paved and level.
fn wetness(layer: u32, up: f32) -> f32 {
    let is_road = layer == ASPHALT || layer == LANE || layer == LINE || layer == PATCH || layer == MANHOLE;
    let is_pavement = layer == SLABS || layer == SETTS || layer == CONCRETE;
    return select(0.0, SHADOW_TEXEL.z * smoothstep(0.80, 0.97, up), is_road || is_pavement);
}

// Water in the pores darkens a surface, vertex-lit: colour and gloss.
fn wet_material(m: Material, wet: f32) -> Material {
    return Material(m.albedo * (1.0 - 0.45 * wet), max(m.gloss, 0.8 * wet), m.openness);
}

// Water fills the pores, and stands in puddles where the road is low.
fn wet_pbr(m: PbrMaterial, world: vec3<f32>, wet: f32) -> PbrMaterial {
    let broad = textureSampleLevel(surfaces, surface_sampler, world.xy * 0.017 + 0.11, ASPHALT, 1.0).g;
    let puddle = smoothstep(PUDDLES.x, PUDDLES.y, broad);
    var out = m;
    out.albedo *= 1.0 - wet * (0.52 + 0.08 * puddle);
    out.roughness = mix(m.roughness, 0.20 - 0.13 * puddle, wet);
    return out;
}

// Contrast of the stones and stains of asphalt: at eye height more of it is noise.
const ASPHALT_CONTRAST: f32 = 0.62;

// Brightness of the broad pattern of asphalt between which puddles begin.
const PUDDLES: vec2<f32> = vec2<f32>(0.575, 0.665);

// Parked cars have numbers from this one on, other than those of the vehicles that move.
const PARKED_FROM: u32 = 300u;

// Emissive strength of name boards at night, times their colour.
const BOARD_EMISSION: f32 = 0.22;

fn is_shop(layer: u32) -> bool {
    return layer == SHOPFRONT || layer == BOUTIQUE || layer == TEAROOM;
}

// Whether there are rooms behind the panes of a wall.
fn has_rooms(layer: u32) -> bool {
    return layer == WINDOWS || layer == GLAZING || is_shop(layer) || (layer >= SASH && layer <= BALCONY);
}

// Seed of one wall of a building: its normal tells the walls apart.
fn wall_seed(seed: u32, normal: vec3<f32>) -> u32 {
    let side = vec2<u32>(normal.xy * 3.0 + 3.5);
    return (seed * 73u + side.x * 22u + side.y * 59u) & 0xffu;
}

// Blinds and curtains behind panes: colour, and whether they cover this place. A draw for each window decides.
fn behind_pane(layer: u32, seed: u32, uv: vec2<f32>) -> vec4<f32> {
    let at = fract(uv);
    let dice = fract(sin(dot(floor(uv), vec2<f32>(39.3468, 11.135)) + f32(seed) * 1.173) * 2357.817);
    let tint = fract(dice * 61.0);
    if dice < 0.28 {
        let foot = mix(0.40, 0.74, fract(dice * 23.0));
        let slat = 0.90 + 0.10 * cos(at.y * 240.0);
        return vec4<f32>(mix(vec3<f32>(0.46, 0.43, 0.36), vec3<f32>(0.34, 0.36, 0.38), tint) * slat, step(foot, at.y));
    }
    if dice < 0.60 {
        let open = select(0.075, 0.16, layer == BALCONY) * (0.7 + 0.6 * fract(dice * 37.0));
        let fold = 0.82 + 0.18 * cos(at.x * 190.0);
        var cloth = vec3<f32>(0.46, 0.44, 0.40);
        if tint > 0.75 {
            cloth = vec3<f32>(0.32, 0.13, 0.10);
        } else if tint > 0.55 {
            cloth = vec3<f32>(0.15, 0.22, 0.28);
        }
        return vec4<f32>(cloth * fold, step(open, abs(at.x - 0.5)));
    }
    return vec4<f32>(0.0);
}

// What is behind a pane of an office, of which a bay has two: a roller blind, slats, lamps under the ceiling, or a room more
// or less dark. Colour, and how much of it shows.
fn behind_glazing(seed: u32, uv: vec2<f32>) -> vec4<f32> {
    let panes = vec2<f32>(2.0 * uv.x, uv.y);
    let at = fract(panes);
    let dice = fract(sin(dot(floor(panes), vec2<f32>(27.619, 57.583)) + f32(seed) * 1.317) * 1931.417);
    let tint = fract(dice * 61.0);
    if dice < 0.36 {
        let foot = mix(0.30, 0.88, fract(dice * 23.0));
        return vec4<f32>(mix(vec3<f32>(0.27, 0.265, 0.24), vec3<f32>(0.13, 0.15, 0.17), tint), step(foot, at.y));
    }
    if dice < 0.50 {
        let slat = 0.80 + 0.20 * cos(at.x * 82.0);
        return vec4<f32>(vec3<f32>(0.21, 0.21, 0.195) * slat, step(0.75 * fract(dice * 37.0), at.x));
    }
    if dice < 0.66 {
        let is_lamp = step(0.80, at.y) * step(at.y, 0.86) * step(abs(at.x - 0.5), 0.34);
        return vec4<f32>(mix(vec3<f32>(0.10, 0.095, 0.08), vec3<f32>(0.55, 0.54, 0.49), is_lamp), 0.6 + 0.4 * is_lamp);
    }
    return vec4<f32>(vec3<f32>(0.020, 0.026, 0.032) * (0.4 + 2.2 * tint), 0.7);
}

// No two panes stand quite alike in their frames: a normal tilted by a draw for each.
fn pane_normal(normal: vec3<f32>, seed: u32, pane: vec2<f32>) -> vec3<f32> {
    let dice = fract(sin(dot(pane, vec2<f32>(17.137, 63.719)) + f32(seed) * 0.917) * vec2<f32>(1543.31, 2971.77)) - 0.5;
    return normalize(normal + PANE_TILT * (dice.x * vec3<f32>(-normal.y, normal.x, 0.0) + dice.y * vec3<f32>(0.0, 0.0, 1.0)));
}

const PANE_TILT: f32 = 0.045;

// Reflectance of those faces of a double pane that are behind the first one. A pane without a room behind it shows nothing else.
const INNER_FACES: f32 = 0.09;

// Atlas cells of letters along and up their layer, as in `lettering`; cells a pixel between which letters fade; and what the
// texture of a board with letters has as its mean.
const LETTER_CELLS: vec2<f32> = vec2<f32>(8.0, 5.0);
const LETTERS_FADE: vec2<f32> = vec2<f32>(0.17, 0.34);
const LETTERS_MEAN: f32 = 0.78;

// Letters whose strokes are finer than a pixel become the mean of their board.
fn faded_letters(uv: vec2<f32>, uv_dx: vec4<f32>) -> vec3<f32> {
    let sharp = textureSampleGrad(surfaces, surface_sampler, uv, LETTERS, uv_dx.xy, uv_dx.zw).rgb;
    let cells = max(length(uv_dx.xz) * LETTER_CELLS.x, length(uv_dx.yw) * LETTER_CELLS.y);
    return mix(sharp, vec3<f32>(LETTERS_MEAN), smoothstep(LETTERS_FADE.x, LETTERS_FADE.y, cells));
}

// Emission at night: lamps, and lit rooms behind some of the windows.
fn emission(layer: u32, seed: u32, uv: vec2<f32>, texel: vec4<f32>) -> vec3<f32> {
    if !lamplit {
        return vec3<f32>(0.0);
    }
    if layer == LANTERN {
        return vec3<f32>(5.0, 4.2, 2.9) * frame.zenith.w;
    }
    if !has_rooms(layer) {
        return vec3<f32>(0.0);
    }
    let bay = floor(uv);
    let dice = fract(sin(dot(bay, vec2<f32>(12.9898, 78.233)) + f32(layer) * 3.7 + f32(seed) * 0.731) * 437.5453);
    let is_lit = select(0.0, 1.0, dice < 0.38);
    if is_shop(layer) {
        // Goods in their own colours under the lamps of the room.
        let tint = mix(vec3<f32>(1.0, 0.86, 0.66), vec3<f32>(0.95, 0.95, 0.88), fract(dice * 17.0));
        let pane = 1.0 - smoothstep(0.42, 0.7, texel.a);
        return texel.rgb * tint * ((2.6 + 1.2 * dice) * pane * frame.zenith.w);
    }
    let warm = mix(vec3<f32>(0.85, 0.58, 0.28), vec3<f32>(0.70, 0.68, 0.60), fract(dice * 17.0));
    // A texel at the edge of a pane mixes pane and frame: the frame's share, at most white, does not emit.
    let frame_part = clamp((texel.a - 0.13) / 0.87, 0.0, 1.0);
    let room = 0.3 * (1.0 - frame_part) + 2.0 * max(texel.g - frame_part, 0.0);
    return warm * (room * (0.6 + dice) * is_lit * frame.zenith.w);
}

// Sizes of a pixel in metres between which leaves at the outline fade to a solid crown.
const LEAVES_FADE: vec2<f32> = vec2<f32>(0.025, 0.055);

// Height of lobes below which they leave gaps at the outline, and cosine of the angle at which a crown faces the eye from which
// on they leave none.
const OUTLINE_LOBES: f32 = 0.68;
const OUTLINE_FACING: f32 = 0.42;

// Share of the sun's light from behind that a crown lets through. A leaf lets half as much through as it reflects (see the table of
// docs/reference.md), and most of those that are seen from the shady side have other leaves between them and the sun.
const LEAF_TRANSLUCENCE: f32 = 0.2;
const NEEDLE_TRANSLUCENCE: f32 = 0.08;
// Roughness of single leaves.
const LEAF_ROUGHNESS: f32 = 0.97;

// Alpha to coverage: the density of leaves sets how many samples they cover, so that the outline of a crown is ragged.
@fragment
fn crown_fragment(in: Fragment) -> @location(0) vec4<f32> {
    return crown_pixel(in);
}

@fragment
fn reflecting_crown_fragment(in: Fragment) -> HdrPixel {
    return HdrPixel(crown_pixel(in), vec4<f32>(0.0));
}

fn crown_pixel(in: Fragment) -> vec4<f32> {
    let texel = textureSampleBias(surfaces, surface_sampler, in.uv, LEAVES, -0.5);
    let from_eye = in.world - view.eye.xyz;
    let distance = length(from_eye);
    let to_eye = -from_eye / distance;
    let smooth_normal = normalize(in.normal);
    let uv_dx = vec4<f32>(dpdx(in.uv), dpdy(in.uv));
    let dx = array<vec3<f32>, 2>(dpdx(in.world), dpdy(in.world));
    let sprays = textureSample(surfaces, surface_sampler, in.uv * 0.20, LEAVES).g;
    if is_spray(in.uv) {
        return spray_pixel(in, dx, uv_dx);
    }
    let leafy = near_foliage(Foliage(texel.rgb, smooth_normal, texel.g), LEAVES, in.uv, dx, uv_dx);
    let pixel_m = pixel_on_ground(dx[0], dx[1]);
    let pixel = 2.0 * distance * abs(view.camera_from_clip[1][1]) / view.extent.y;
    let lobes = lobed(leafy, in.world, pixel_m, pixel);
    let crown = far_wood(lobes.leafy, in.world, pixel_m);
    // Near the outline only the brightest leaves cover the background.
    let near = 1.0 - smoothstep(LEAVES_FADE.x, LEAVES_FADE.y, pixel);
    // In dark parts of the crown other leaves lie behind those of the outline.
    let bare = smoothstep(0.50, 0.78, in.colour.a);
    let least = 0.80 * near * bare * (1.0 - smoothstep(0.0, 0.65, dot(smooth_normal, to_eye)));
    let ragged = clamp((0.35 * crown.height + 0.65 * sprays - least) * 12.0 + 0.5, 0.0, 1.0);
    // From farther away its lobes make the outline.
    let brink = OUTLINE_LOBES * bare * (1.0 - smoothstep(0.0, OUTLINE_FACING, dot(smooth_normal, to_eye)));
    let cover = min(ragged, mix(1.0, clamp((lobes.height - brink) * 5.0 + 0.5, 0.0, 1.0), lobes.seen));
    let leaf = PbrMaterial(crown.albedo * in.colour.rgb, in.colour.a, texel.a, 0.0, LEAF_TRANSLUCENCE, 0.0);
    let seen = hdr_pixel(shade(leaf, in.world, crown.normal, to_eye), vec3<f32>(0.0), from_eye);
    return vec4<f32>(seen.radiance.rgb, cover * inside_cover(in.uv, distance));
}

// A spray of leaves near the camera: its leaves cover, what is between them does not.
fn spray_pixel(in: Fragment, dx: array<vec3<f32>, 2>, uv_dx: vec4<f32>) -> vec4<f32> {
    let leaf = spray_leaf(in.uv, pixel_in_sprays(uv_dx.xy, uv_dx.zw));
    let from_eye = in.world - view.eye.xyz;
    let smooth_normal = normalize(in.normal);
    let normal = normalize(smooth_normal + surface_axes(smooth_normal, dx, uv_dx) * (leaf.tilt * 0.75));
    let is_conifer = is_bough(in.uv);
    let mean = select(mean_texel(LEAVES).rgb, mean_texel(NEEDLES).rgb, is_conifer);
    let translucence = select(LEAF_TRANSLUCENCE, NEEDLE_TRANSLUCENCE, is_conifer);
    let material = PbrMaterial(mean * leaf.tone * in.colour.rgb, in.colour.a, LEAF_ROUGHNESS, 0.0, translucence, 0.0);
    let seen = hdr_pixel(shade(material, in.world, normal, -normalize(from_eye)), vec3<f32>(0.0), from_eye);
    return vec4<f32>(seen.radiance.rgb, leaf.cover);
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
    let is_line = in.layer == LINE;
    let layer = select(in.layer, ASPHALT, is_line);
    let uv = select(in.uv, in.world.xy * 0.2, is_line);
    var texel = textureSampleBias(surfaces, surface_sampler, uv, layer, -0.5);
    let across = length(vec2<f32>(dpdx(in.uv.x), dpdy(in.uv.x)));
    var room = vec4<f32>(1.0, 1.0, 1.0, 0.0);
    let room_near = 1.0 - smoothstep(ROOM_FADE.x, ROOM_FADE.y, across);
    let edges = array<vec3<f32>, 2>(dpdx(in.world), dpdy(in.world));
    let uv_dx = vec4<f32>(dpdx(in.uv), dpdy(in.uv));
    if has_rooms(layer) && room_near > 0.0 && texel.a < 0.45 {
        let ray = ray_behind(in.normal, normalize(in.world - view.eye.xyz), edges, uv_dx);
        if is_shop(layer) {
            texel = mix(texel, goods_behind(texel, layer, in.uv, ray, uv_dx), room_near);
        } else {
            room = room_seen(in.uv, wall_seed(in.seed, in.normal), ray);
        }
    }
    var pattern = texel.rgb;
    if layer == LETTERS {
        pattern = faded_letters(uv, uv_dx);
    }
    if detail {
        let ground = select(ASPHALT, GRASS, layer == GRASS);
        let broad = textureSample(surfaces, surface_sampler, in.world.xy * 0.021 + 0.37, ground).g;
        if layer == GRASS || layer == ASPHALT || layer == LANE {
            // Keeps the mean brightness: the mean of the pattern is 0.6.
            pattern *= 0.5 + 0.5 * broad / 0.6;
        }
    }
    var normal = normalize(in.normal);
    // Derivatives of all pixels, also of those that are far.
    let dx = vec4<f32>(edges[0].xy, uv_dx.xy);
    let dy = vec4<f32>(edges[1].xy, uv_dx.zw);
    let pixel = pixel_on_ground(edges[0], edges[1]);
    let wet = wetness(in.layer, in.normal.z);
    var tone = vec3<f32>(1.0);
    if normal.z > 0.7 && pixel.x < DETAIL_PIXEL_M && has_ground_detail(in.layer) {
        let near = ground_detail(in.layer, in.world.xy, in.uv, dx, dy, pixel);
        tone = near.tone;
        // Water fills the relief.
        normal = normalize(normal - vec3<f32>(near.slope * (1.0 - 0.8 * wet), 0.0));
    }
    if layer == LEAVES || layer == NEEDLES {
        let leafy = near_foliage(Foliage(pattern, normal, 0.0), layer, in.uv, edges, uv_dx);
        let near = far_wood(lobed(leafy, in.world, pixel, pixel.x).leafy, in.world, pixel);
        pattern = near.albedo;
        normal = near.normal;
    }
    pattern *= tone;
    if layer == ASPHALT || layer == LANE {
        pattern = mix(mean_texel(layer).rgb, pattern, ASPHALT_CONTRAST);
    }
    var m: PbrMaterial;
    m.albedo = pattern * in.colour.rgb;
    if layer == NUMBER {
        m.albedo = number_on_plate(in.uv, uv_dx, registration_number(PARKED_FROM + in.seed));
    }
    var daylit = vec3<f32>(0.0);
    let is_glazing = layer == GLAZING;
    if is_glazing || layer == WINDOWS || (layer >= SASH && layer <= BALCONY) {
        let seed = wall_seed(in.seed, in.normal);
        let pane = 1.0 - smoothstep(0.16, 0.45, texel.a);
        // Farther away than folds and slats, or blinds, can be told, a window is as the texture has it.
        let fade = select(vec2<f32>(0.02, 0.06), vec2<f32>(0.12, 0.30), is_glazing);
        let near = 1.0 - smoothstep(fade.x, fade.y, across);
        var behind: vec4<f32>;
        if is_glazing {
            behind = behind_glazing(seed, in.uv);
        } else {
            behind = behind_pane(layer, seed, in.uv);
        }
        m.albedo = mix(m.albedo, behind.rgb, behind.a * pane * near);
        // Little daylight reaches the back of a room, and hardly any of the sun.
        let is_room = select(0.0, room_near * pane, room.a > 0.0) * (1.0 - behind.a * near);
        daylit = room.rgb * frame.sky_light.rgb * (is_room * ROOM_ALBEDO / (1.0 + 0.4 * room.a));
        if pane > 0.5 {
            normal = pane_normal(normal, seed, floor(in.uv * select(vec2<f32>(1.0), vec2<f32>(2.0, 1.0), is_glazing)));
        }
    }
    // Asphalt is never fully rough.
    m.roughness = select(texel.a, LACQUER, layer == CAR_PAINT);
    let is_iron = layer == MANHOLE && texel.a < 0.95;
    if layer == ASPHALT || layer == LANE || layer == PATCH || (layer == MANHOLE && !is_iron) {
        m.roughness = 0.93 - 0.16 * texel.g;
    }
    if is_line {
        // Paint wears off raised stones.
        let paint = in.colour.rgb * (0.62 + 0.5 * texel.g) * (0.55 + 0.45 * tone);
        let cover = line_coverage(in.uv, across);
        m.albedo = mix(pattern * ASPHALT_TINT, paint, cover);
        m.roughness = mix(m.roughness, 0.7, cover);
    }
    m.openness = in.colour.a;
    m.metallic = 0.0;
    m.translucent = select(0.0, select(LEAF_TRANSLUCENCE, NEEDLE_TRANSLUCENCE, layer == NEEDLES), layer == LEAVES || layer == NEEDLES);
    if wet > 0.0 {
        m = wet_pbr(m, in.world, wet);
    }
    let from_eye = in.world - view.eye.xyz;
    if layer == GLASS {
        let mirrored = reflected_radiance(in.world, reflect(normalize(from_eye), normal), m.roughness);
        daylit = mirrored * (INNER_FACES * in.colour.a);
    }
    let lit = shade(m, in.world, normal, -normalize(from_eye));
    var glow = emission(in.layer, wall_seed(in.seed, in.normal), in.uv, texel);
    if room.a > 0.0 {
        // The lamp of a lit room hangs in its middle.
        glow *= mix(vec3<f32>(1.0), 1.5 * room.rgb, room_near);
    }
    if lamplit && layer == LETTERS {
        glow = m.albedo * (BOARD_EMISSION * frame.zenith.w);
    }
    return hdr_pixel(lit, glow + daylit, from_eye);
}

// Albedo of the texture, which stores the square root of reflectance: decoding is one multiplication.
fn vertex_lit_albedo(uv: vec2<f32>, layer: u32) -> vec4<f32> {
    let texel = textureSample(surfaces, surface_sampler, uv, layer);
    return vec4<f32>(texel.rgb * texel.rgb, texel.a);
}

@vertex
fn vertex_lit_vertex(in: VertexIn) -> VertexLit {
    return vertex_lit(in);
}

@vertex
fn instanced_vertex_lit_vertex(in: VertexIn, at: Placement) -> VertexLit {
    return vertex_lit(placed(in, at));
}

fn vertex_lit(in: VertexIn) -> VertexLit {
    let colour = vec4<f32>(linear_from_srgb(in.colour.rgb), in.colour.a);
    let layer = in.material & 0xffu;
    let is_emissive = lamplit && layer == LETTERS;
    let glow = select(vec3<f32>(0.0), colour.rgb * (BOARD_EMISSION * frame.zenith.w), is_emissive);
    let material = wet_material(Material(colour.rgb, 0.0, colour.a), wetness(layer, in.normal.z));
    var out = light_vertex(material, in.position, in.normal.xyz, glow);
    out.uv = vec4<f32>(out.uv.xy, in.uv);
    out.layer = layer;
    if lamplit {
        out.layer |= wall_seed((in.material >> 16u) & 0xffu, in.normal.xyz) << 8u;
    }
    return out;
}

@fragment
fn vertex_lit_fragment(in: VertexLit) -> @location(0) vec4<f32> {
    if lamplit {
        let layer = in.layer & 0xffu;
        let pattern = vertex_lit_albedo(in.uv.zw, layer);
        let glow = emission(layer, in.layer >> 8u, in.uv.zw, pattern) * (SUN.w * (1.0 - in.ambient.w));
        return vertex_lit_shade(in, pattern.rgb, glow);
    }
    return vertex_lit_shade(in, vertex_lit_albedo(in.uv.zw, in.layer).rgb, vec3<f32>(0.0));
}

// Faces turned away from the sun: no direct light, so no shadow lookup.
@fragment
fn unlit_fragment(in: VertexLit) -> @location(0) vec4<f32> {
    return vertex_lit_color(in, vertex_lit_albedo(in.uv.zw, in.layer).rgb, vec3<f32>(0.0), vec3<f32>(0.0));
}

struct VertexLitLine {
    @builtin(position) clip: vec4<f32>,
    @location(0) ambient: vec4<f32>,
    @location(1) direct: vec4<f32>,
    @location(2) uv: vec4<f32>,
    // Colour; w: half the width. `place`: distance from the centre line. Metres.
    @location(3) paint: vec4<f32>,
    @location(4) place: f32,
}

@vertex
fn vertex_lit_line_vertex(in: VertexIn) -> VertexLitLine {
    let white = wet_material(Material(vec3<f32>(1.0), 0.0, in.colour.a), wetness(LINE, in.normal.z));
    let light = light_vertex(white, in.position, in.normal.xyz, vec3<f32>(0.0));
    return VertexLitLine(
        light.clip, light.ambient, light.direct, vec4<f32>(light.uv.xy, in.position.xy * 0.2),
        vec4<f32>(linear_from_srgb(in.colour.rgb), in.uv.y), in.uv.x,
    );
}

@fragment
fn vertex_lit_line_fragment(in: VertexLitLine) -> @location(0) vec4<f32> {
    let texel = vertex_lit_albedo(in.uv.zw, ASPHALT);
    let across = length(vec2<f32>(dpdx(in.place), dpdy(in.place)));
    let paint = in.paint.rgb * (0.62 + 0.5 * texel.g);
    let albedo = mix(texel.rgb * ASPHALT_TINT, paint, line_coverage(vec2<f32>(in.place, in.paint.w), across));
    return vertex_lit_shade(VertexLit(in.clip, in.ambient, in.direct, in.uv, 0u), albedo, vec3<f32>(0.0));
}

// Far away a texture shows only its mean, the last mipmap: the root of its albedo.
fn mean_texel(layer: u32) -> vec4<f32> {
    return textureLoad(surfaces, vec2<i32>(0), layer, textureNumLevels(surfaces) - 1u);
}

fn untextured_of(in: VertexIn) -> Untextured {
    let layer = in.material & 0xffu;
    var albedo = vertex_colour(in.colour.rgb);
    var glow = vec3<f32>(0.0);
    if !flat_light {
        let mean = mean_texel(layer);
        albedo *= mean.rgb * mean.rgb;
        glow = select(vec3<f32>(0.0), emission(layer, 0u, in.uv, mean), layer == LANTERN);
    }
    let material = wet_material(Material(albedo, 0.0, in.colour.a), wetness(layer, in.normal.z));
    return light_untextured(material, in.position, in.normal.xyz, glow);
}

@vertex
fn untextured_vertex(in: VertexIn) -> Untextured {
    return untextured_of(in);
}

@vertex
fn instanced_untextured_vertex(in: VertexIn, at: Placement) -> Untextured {
    return untextured_of(placed(in, at));
}

@vertex
fn flat_vertex(in: VertexIn) -> Flat {
    let lit = untextured_of(in);
    return Flat(lit.clip, lit.colour);
}

@vertex
fn instanced_flat_vertex(in: VertexIn, at: Placement) -> Flat {
    let lit = untextured_of(placed(in, at));
    return Flat(lit.clip, lit.colour);
}

// Ground too far away to show its texture, but not its shadows.
struct Plain {
    @builtin(position) clip: vec4<f32>,
    @location(0) ambient: vec4<f32>,
    @location(1) direct: vec4<f32>,
    // In the shadow map or the light map of lamps.
    @location(2) uv: vec2<f32>,
}

@vertex
fn plain_vertex(in: VertexIn) -> Plain {
    let layer = in.material & 0xffu;
    let mean = mean_texel(layer);
    let albedo = linear_from_srgb(in.colour.rgb) * mean.rgb * mean.rgb;
    let material = wet_material(Material(albedo, 0.0, in.colour.a), wetness(layer, in.normal.z));
    let light = light_vertex(material, in.position, in.normal.xyz, vec3<f32>(0.0));
    return Plain(light.clip, light.ambient, light.direct, light.uv.xy);
}

@fragment
fn plain_fragment(in: Plain) -> @location(0) vec4<f32> {
    let light = VertexLit(in.clip, in.ambient, in.direct, vec4<f32>(in.uv, 0.0, 0.0), 0u);
    return vertex_lit_shade(light, vec3<f32>(1.0), vec3<f32>(0.0));
}
