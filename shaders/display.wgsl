// Display transform: ambient occlusion, exposure, tone mapping (ACES fit), sRGB encoding, and dither against banding.

@group(1) @binding(2) var occlusion_map: texture_2d<f32>;

override ambient_occlusion: bool = true;
// Whether the occlusion map has contact shadows.
override contact_shadows: bool = false;
// Whether smooth surfaces mirror the picture.
override reflections: bool = false;

@group(1) @binding(4) var reflection_map: texture_2d<f32>;
// Mean of several pictures.
@group(1) @binding(5) var mean_map: texture_2d<f32>;
// Share of a picture in the mean.
override share: f32 = 1.0;
// Whether the target is of an sRGB format, which encodes once more.
override target_is_srgb: bool = false;

// Tone mapping curve: ACES filmic fit (Narkowicz 2015).
fn aces_filmic(x: vec3<f32>) -> vec3<f32> {
    let curve = (x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14);
    return clamp(curve, vec3<f32>(0.0), vec3<f32>(1.0));
}

fn srgb_from_linear_exactly(c: vec3<f32>) -> vec3<f32> {
    return select(1.055 * pow(c, vec3<f32>(1.0 / 2.4)) - 0.055, c * 12.92, c < vec3<f32>(0.0031308));
}

fn linear_from_srgb_exactly(c: vec3<f32>) -> vec3<f32> {
    return select(pow((c + 0.055) / 1.055, vec3<f32>(2.4)), c / 12.92, c < vec3<f32>(0.04045));
}

// Bilateral blur of the ambient visibility, and of the share of the sun, over 4 by 4 pixels, weighted by depth: depths of a
// plane are linear in pixels.
fn blurred_visibility(place: TilePixel) -> vec2<f32> {
    var near: array<vec3<f32>, 16>;
    for (var k = 0; k < 16; k++) {
        let pixel = place.pixel + vec2<i32>((k & 3) - 1, (k >> 2u) - 1);
        near[k] = textureLoad(occlusion_map, texel_of(place, pixel), 0).xyz;
    }
    // This pixel and its neighbours.
    let here = near[5];
    let left = here.y - near[4].y;
    let right = near[6].y - here.y;
    let up = here.y - near[1].y;
    let down = near[9].y - here.y;
    let slope = vec2<f32>(select(right, left, abs(left) < abs(right)), select(down, up, abs(up) < abs(down)));
    let slack = here.y * view.extent.z + view.extent.w + 0.5 * (abs(slope.x) + abs(slope.y));
    var sum = vec2<f32>(0.0);
    var sun = 0.0;
    for (var k = 0; k < 16; k++) {
        let expected = here.y + slope.x * f32((k & 3) - 1) + slope.y * f32((k >> 2u) - 1);
        let weight = max(1.0 - abs(near[k].y - expected) / max(slack, 1e-9), 0.0);
        sum += weight * vec2<f32>(near[k].x, 1.0);
        if contact_shadows {
            sun += weight * near[k].z;
        }
    }
    return vec2<f32>(sum.x, sun) / max(sum.y, 1e-4);
}

// Largest reflectance of the samples of a pixel.
fn largest_reflectance(texel: vec2<i32>) -> f32 {
    var largest = 0.0;
    for (var k = 0u; k < sample_count(); k++) {
        largest = max(largest, mirror_at(texel, k).a);
    }
    return largest;
}

// Reflections around a pixel: a ray hits or misses, so that their outlines have steps. Where the first sample of it mirrors
// nothing, as that of a leaf before a wet road, its other samples have what their surface mirrors beside it.
fn smoothed_reflection(place: TilePixel) -> vec4<f32> {
    let texel = place.origin + place.pixel;
    var here = textureLoad(reflection_map, texel, 0);
    if here.a <= 0.0 {
        here.a = largest_reflectance(texel);
        if here.a <= 0.0 {
            return here;
        }
    }
    var sum = vec4<f32>(0.0);
    for (var k = 0; k < 25; k++) {
        let off = vec2<i32>(k % 5, k / 5) - 2;
        let near = textureLoad(reflection_map, texel_of(place, place.pixel + off), 0);
        // Binomial weights of 6, 4 and 1 along both axes, for pixels of the same surface: its reflectance is much the same.
        let weights = vec2<f32>(6.0) - vec2<f32>(abs(off)) * (1.5 + 0.5 * vec2<f32>(abs(off)));
        let alike = max(1.0 - 2.0 * abs(near.a - here.a) / max(here.a, 1e-3), 0.0);
        sum += weights.x * weights.y * alike * vec4<f32>(near.rgb, 1.0);
    }
    return vec4<f32>(sum.rgb / max(sum.a, 1.0), here.a);
}

// A layer of falling drops.
struct RainLayer {
    // Columns of drops per height of the picture, and drops below one another in a column.
    columns: f32,
    rows: f32,
    // Heights of the picture that they fall a second, and width of a streak as a share of it.
    fall: f32,
    width: f32,
    // Longest streak as a share of the room of a drop, and brightness.
    longest: f32,
    bright: f32,
}

// Near ones first: few, wide and out of focus.
const RAIN_LAYERS: array<RainLayer, 4> = array<RainLayer, 4>(
    RainLayer(17.0, 2.1, 2.4, 0.0024, 0.36, 0.42),
    RainLayer(44.0, 4.3, 1.7, 0.0013, 0.34, 0.55),
    RainLayer(92.0, 8.0, 1.2, 0.0008, 0.32, 0.62),
    RainLayer(170.0, 14.0, 0.8, 0.0006, 0.32, 0.55),
);
// What a drop adds, of the light of the horizon.
const RAIN_LIGHT: f32 = 0.30;
// How far drops are blown aside as they fall.
const RAIN_SLANT: f32 = 0.06;

// A number from 0 to 1 for a cell of a layer.
fn rain_hash(cell: vec2<f32>, layer: f32) -> f32 {
    // Of whole numbers, so that every adapter has the same drops.
    let at = vec2<u32>(vec2<i32>(cell));
    var n = (at.x * 1597334677u) ^ (at.y * 3812015801u) ^ (u32(layer) * 2798796415u);
    n = (n ^ (n >> 15u)) * 2246822519u;
    n = (n ^ (n >> 13u)) * 3266489917u;
    return f32((n ^ (n >> 16u)) & 0xffffffu) / 16777215.0;
}

// Streaks of rain across a pixel at the simulated time, 0 to 1: each column has drops at times of its own. Who looks down sees
// them from above, and shorter.
fn rain_streaks(pixel: vec2<i32>) -> f32 {
    let at = (vec2<f32>(pixel) + 0.5) / view.extent.y;
    // A line is at least a pixel wide, and fainter where it would be thinner.
    let pixel_size = 1.0 / view.extent.y;
    let upright = clamp(abs(view.clip_from_world[2].y * view.camera_from_clip[1][1]), 0.25, 1.0);
    var streaks = 0.0;
    for (var k = 0; k < 4; k++) {
        let layer = f32(k);
        let drops = RAIN_LAYERS[k];
        let across = (at.x + RAIN_SLANT * at.y) * drops.columns;
        let column = floor(across);
        let shift = rain_hash(vec2<f32>(column, 3.0), layer);
        let rows = drops.rows / upright;
        let down = at.y * rows - frame.to_sun.w * drops.fall * drops.rows * (0.85 + 0.3 * shift) + 9.0 * shift;
        let cell = vec2<f32>(column, floor(down));
        let place = 0.12 + 0.76 * rain_hash(cell, layer + 4.0);
        let drop = rain_hash(cell, layer + 8.0);
        let length = drops.longest * (0.35 + 0.65 * rain_hash(cell, layer + 12.0));
        let part = fract(down + 0.9 * place) / length;
        let width = max(drops.width, pixel_size);
        let off = abs(fract(across) - place) / (drops.columns * width);
        let line = max(1.0 - off, 0.0) * min(drops.width / pixel_size, 1.0);
        let ends = smoothstep(0.0, 0.5, part) * (1.0 - smoothstep(0.6, 1.0, part));
        streaks += step(drop, 0.62) * (0.3 + 1.1 * drop) * drops.bright * line * ends;
    }
    return min(streaks, 1.0);
}

// Dither by interleaved gradient noise (Jimenez 2014), from -0.5 to 0.5.
fn dither(pixel: vec2<i32>) -> f32 {
    return fract(52.9829189 * fract(dot(vec2<f32>(pixel), vec2<f32>(0.06711056, 0.00583715)))) - 0.5;
}

// Whether a pixel shows what is under the same roof as the camera: the dashboard.
fn is_inside(place: TilePixel) -> bool {
    const INSIDE_M: f32 = 1.1;
    if !ambient_occlusion {
        return false;
    }
    let depth = textureLoad(occlusion_map, texel_of(place, place.pixel), 0).y;
    let point = view.camera_from_clip * vec4<f32>(0.0, 0.0, depth, 1.0);
    return depth > 0.0 && point.z < INSIDE_M * point.w;
}

// Luminance of the fog in front of a pixel, of which no occlusion takes: crowns have one share of ambient light in fog and without.
fn fog_luminance(place: TilePixel) -> f32 {
    let depth = textureLoad(occlusion_map, texel_of(place, place.pixel), 0).y;
    if depth <= 0.0 {
        return 0.0;
    }
    let point = position_of(place.pixel, depth);
    let from_eye = point.xyz / point.w;
    let climb = dot((view.camera_from_clip * view.clip_from_world[2]).xyz, from_eye);
    let along = sqrt(max(dot(from_eye, from_eye) - climb * climb, 0.0));
    let clear = fog_transmittance(vec3<f32>(along, 0.0, climb), view.eye.z, frame.haze.w);
    return (1.0 - clear) * luminance(frame.haze.rgb);
}

// Displayed light of a pixel, before the sRGB encoding.
fn displayed(place: TilePixel) -> vec3<f32> {
    var occlusion = 0.0;
    var contact = 0.0;
    var fog = 0.0;
    if ambient_occlusion {
        fog = fog_luminance(place);
        let visible = blurred_visibility(place);
        occlusion = 1.0 - visible.x;
        if contact_shadows {
            contact = 1.0 - visible.y;
        }
    }
    // MSAA resolve after tone mapping: edges against bright surfaces stay smooth.
    let texel = place.origin + place.pixel;
    var reflection = vec4<f32>(0.0);
    if reflections {
        reflection = smoothed_reflection(place);
    }
    // In rain, which makes the ground wet through, drops scatter the light of the sky.
    var drops = vec3<f32>(0.0);
    if frame.shadow_texel.z > 0.9 && !is_inside(place) {
        drops = (RAIN_LIGHT * rain_streaks(place.pixel) * frame.sun.w) * (frame.haze.rgb + vec3<f32>(0.05));
    }
    let count = sample_count();
    var sum = vec3<f32>(0.0);
    for (var k = 0u; k < count; k++) {
        var sample = radiance_at(texel, k);
        if reflections && reflection.a > 0.0 {
            // At an edge the other samples may be of another surface.
            let part = clamp(mirror_at(texel, k).a / reflection.a, 0.0, 1.0);
            sample = vec4<f32>(max(sample.rgb + part * reflection.rgb, vec3<f32>(0.0)), sample.a);
        }
        // What shines by itself, and glass, whose depth is that of what is behind it, have a negative share: nothing takes light
        // from them.
        let solid = max(1.0 - fog / max(luminance(sample.rgb), 1e-5), 0.0);
        let ambient = clamp(sample.a, 0.0, solid);
        var dark = occlusion * ambient;
        if contact_shadows && sample.a >= 0.0 {
            dark += contact * (solid - ambient);
        }
        sum += aces_filmic(sample.rgb * (frame.sun.w * (1.0 - dark)) + drops);
    }
    return sum / f32(count);
}

fn encoded(light: vec3<f32>, pixel: vec2<i32>) -> vec3<f32> {
    return srgb_from_linear_exactly(light) + dither(pixel) / 255.0;
}

// Adds to the mean of several pictures.
@fragment
fn accumulate_fragment(in: Tile) -> @location(0) vec4<f32> {
    return vec4<f32>(displayed(tile_pixel(in)) * share, share);
}

@fragment
fn encode_fragment(in: Tile) -> @location(0) vec4<f32> {
    let place = tile_pixel(in);
    return vec4<f32>(encoded(textureLoad(mean_map, place.origin + place.pixel, 0).rgb, place.pixel), 1.0);
}

@fragment
fn fragment_main(in: Tile) -> @location(0) vec4<f32> {
    let place = tile_pixel(in);
    let shown = encoded(displayed(place), place.pixel);
    if target_is_srgb {
        return vec4<f32>(linear_from_srgb_exactly(clamp(shown, vec3<f32>(0.0), vec3<f32>(1.0))), 1.0);
    }
    return vec4<f32>(shown, 1.0);
}
