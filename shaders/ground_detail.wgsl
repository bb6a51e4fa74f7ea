// Ground near the camera: stones, blades of grass and joints that are finer than the texels of its textures.

// Size of a pixel on the ground, as a share of the size of what is drawn, between which it fades out.
const DETAIL_FADE: vec2<f32> = vec2<f32>(0.12, 0.80);

// What near ground adds to its texture.
struct GroundDetail {
    // Factor on the albedo; its mean is 1.
    tone: vec3<f32>,
    // Slope of the relief along x and y of the city.
    slope: vec2<f32>,
}

// Cellular noise (Worley 1996): stones in a bed. xy: slope of the stone, at most about 1; z: tone of the stone, w: 0 in
// the gap between stones to 1 on them.
fn stones(at: vec2<f32>, salt: u32) -> vec4<f32> {
    let cell = vec2<i32>(floor(at));
    let part = at - floor(at);
    var nearest = vec2<f32>(9.0);
    var off = vec2<f32>(0.0);
    var tone = 0.5;
    for (var k = 0; k < 9; k++) {
        let near = vec2<i32>(k % 3, k / 3) - 1;
        let dice = cell_dice(cell + near, salt);
        let away = part - vec2<f32>(near) - dice.xy;
        let far = dot(away, away);
        if far < nearest.x {
            nearest = vec2<f32>(far, nearest.x);
            off = away;
            tone = dice.z;
        } else if far < nearest.y {
            nearest.y = far;
        }
    }
    let gap = sqrt(nearest.y) - sqrt(nearest.x);
    return vec4<f32>(off, tone, smoothstep(0.02, 0.26, gap));
}

// Blades of grass that lie across one another: slope of the topmost one, its tone, and how high it lies, 0 for none.
fn blades(at: vec2<f32>, salt: u32) -> vec4<f32> {
    let cell = vec2<i32>(floor(at));
    let part = at - floor(at);
    var top = vec4<f32>(0.0, 0.0, 0.5, 0.0);
    for (var k = 0; k < 9; k++) {
        let near = vec2<i32>(k % 3, k / 3) - 1;
        let dice = cell_dice(cell + near, salt);
        let more = cell_dice(cell + near, salt + 1u);
        let away = part - vec2<f32>(near) - dice.xy;
        let turn = 6.2831853 * dice.z;
        let ahead = vec2<f32>(cos(turn), sin(turn));
        let along = dot(away, ahead);
        // Bent, and narrower towards the tip.
        let across = dot(away, vec2<f32>(-ahead.y, ahead.x)) + (more.y - 0.5) * 0.8 * along * along;
        let width = 0.17 * (1.0 - 0.8 * smoothstep(-0.2, 0.85, along));
        let is_on = abs(along) < 0.85 && abs(across) < width;
        let height = 0.15 + 0.85 * more.x;
        if is_on && height > top.w {
            let side = across / width;
            top = vec4<f32>(vec2<f32>(-ahead.y, ahead.x) * side + 0.4 * ahead, more.z, height);
        }
    }
    return top;
}

// Distance from the nearest joint of a masonry bond, in sizes of a piece, and the side it is on: see `bond` in
// patterns.rs.
fn joint_distance(uv: vec2<f32>, pieces: vec2<f32>) -> vec4<f32> {
    let row = floor(uv.y * pieces.y);
    let shift = 0.5 * abs(row - 2.0 * floor(row * 0.5));
    let at = fract(vec2<f32>(fract(uv.x) * pieces.x + shift, uv.y * pieces.y));
    return vec4<f32>(min(at, 1.0 - at), sign(at - 0.5));
}

// Sizes of a pixel on the ground, metres: its shorter and its longer edge.
fn pixel_on_ground(dx: vec3<f32>, dy: vec3<f32>) -> vec2<f32> {
    let edges = vec2<f32>(length(dx), length(dy));
    return vec2<f32>(min(edges.x, edges.y), max(edges.x, edges.y));
}

// How much is seen of what has a size in metres.
fn detail_seen(pixel: vec2<f32>, size: f32) -> f32 {
    // At a grazing angle the longer edge counts half, as with anisotropic filtering.
    return 1.0 - smoothstep(DETAIL_FADE.x * size, DETAIL_FADE.y * size, sqrt(pixel.x * pixel.y));
}

// Larger pixels show nothing of the detail, metres.
const DETAIL_PIXEL_M: f32 = 0.025;

fn has_ground_detail(layer: u32) -> bool {
    let is_road = layer == ASPHALT || layer == LANE || layer == LINE || layer == PATCH || layer == MANHOLE;
    let is_paved = layer == SLABS || layer == SETTS || layer == CONCRETE;
    return is_road || is_paved || layer == GRASS || layer == SAND || layer == GRAVEL;
}

// Ratio of a texture to its mean, on the ground at a scale of its own.
fn ground_pattern(layer: u32, world: vec2<f32>, scale: f32, dx: vec2<f32>, dy: vec2<f32>) -> f32 {
    // Turned, so that the grids of the two scales do not meet.
    let turn = mat2x2<f32>(0.8, 0.6, -0.6, 0.8) * scale;
    let seen = textureSampleGrad(surfaces, surface_sampler, turn * world, layer, turn * dx, turn * dy).g;
    return seen / max(mean_texel(layer).g, 0.05);
}

fn lawn_detail(world: vec2<f32>, pixel: vec2<f32>) -> GroundDetail {
    let low = blades(world / 0.030, 31u);
    let high = blades(world / 0.019, 37u);
    var tone = vec3<f32>(0.52, 0.54, 0.56);
    var slope = vec2<f32>(0.0);
    for (var k = 0; k < 2; k++) {
        let blade = select(low, high, k == 1);
        if blade.w > 0.0 {
            let light = 0.62 + 0.62 * blade.w + 0.24 * (blade.z - 0.5);
            // A few are dry.
            let dry = smoothstep(0.93, 0.98, blade.z);
            tone = light * mix(vec3<f32>(0.98, 1.0, 0.86), vec3<f32>(1.4, 1.08, 0.95), dry);
            slope = 0.32 * blade.xy;
        }
    }
    let seen = detail_seen(pixel, 0.024);
    return GroundDetail(mix(vec3<f32>(1.0), tone, seen), slope * seen);
}

fn stone_detail(world: vec2<f32>, pixel: vec2<f32>, size: f32, contrast: f32) -> GroundDetail {
    let stone = stones(world / size, 11u);
    let seen = detail_seen(pixel, size);
    // Some stones are lighter than the binder between them.
    let light = 0.70 + 0.50 * stone.z * stone.z + 0.30 * stone.w;
    let tone = 1.0 + contrast * (light - 1.08);
    return GroundDetail(vec3<f32>(mix(1.0, tone, seen)), stone.xy * (stone.w * contrast * 0.75 * seen));
}

// Edges of slabs and setts: dark joints, sharp however near, and rounded shoulders.
fn joint_detail(layer: u32, uv: vec2<f32>, axes: mat2x2<f32>, per_pixel: f32) -> GroundDetail {
    let is_setts = layer == SETTS;
    let pieces = select(vec2<f32>(4.0, 6.0), vec2<f32>(12.0, 12.0), is_setts);
    let near = joint_distance(uv, pieces);
    let width = select(vec2<f32>(0.010, 0.015), vec2<f32>(0.055), is_setts);
    let blur = max(per_pixel * pieces, vec2<f32>(0.002));
    let core = vec2<f32>(1.0) - smoothstep(width - blur, width + blur, near.xy);
    let shoulder = (1.0 - smoothstep(width, width * 2.4, near.xy)) * near.zw;
    let tone = 1.0 - 0.42 * max(core.x, core.y);
    return GroundDetail(vec3<f32>(tone), axes * shoulder * 0.5);
}

// Detail of a layer at a place. `dx` and `dy` are derivatives of place (xy) and texture coordinates (zw) across and down
// the picture, `pixel` the size of a pixel there.
fn ground_detail(
    layer: u32,
    world: vec2<f32>,
    uv: vec2<f32>,
    dx: vec4<f32>,
    dy: vec4<f32>,
    pixel: vec2<f32>,
) -> GroundDetail {
    let middle = detail_seen(pixel, 0.03);
    if layer == GRASS {
        var lawn = lawn_detail(world, pixel);
        lawn.tone *= mix(1.0, ground_pattern(GRASS, world, 0.9, dx.xy, dy.xy), 0.7);
        return lawn;
    }
    let is_paving = layer == SLABS || layer == SETTS;
    let is_stone = is_paving || layer == CONCRETE;
    let grain = select(ASPHALT, CONCRETE, is_stone);
    let size = select(0.011, select(0.005, 0.016, layer == GRAVEL), is_stone || layer == SAND || layer == GRAVEL);
    var found = stone_detail(world, pixel, size, select(0.5, 0.35, is_stone || layer == SAND));
    found.tone *= mix(1.0, ground_pattern(grain, world, 0.83, dx.xy, dy.xy), select(1.4, 1.0, is_stone));
    if is_paving {
        // Axes of the texture in the city, from the derivatives of both.
        let inverse = dx.z * dy.w - dx.w * dy.z;
        let across = (dx.xy * dy.w - dy.xy * dx.w) / select(inverse, 1e-9, abs(inverse) < 1e-9);
        let up = (dy.xy * dx.z - dx.xy * dy.z) / select(inverse, 1e-9, abs(inverse) < 1e-9);
        let axes = mat2x2<f32>(across / max(length(across), 1e-6), up / max(length(up), 1e-6));
        let joint = joint_detail(layer, uv, axes, 0.5 * max(length(dx.zw), length(dy.zw)));
        found.tone *= mix(vec3<f32>(1.0), joint.tone, middle);
        found.slope += joint.slope * middle;
    }
    return found;
}
