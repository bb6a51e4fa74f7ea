// Display transform: ambient occlusion, exposure, tone mapping (ACES fit), sRGB encoding, and dither against banding.

@group(1) @binding(2) var occlusion_map: texture_2d<f32>;

override ambient_occlusion: bool = true;
// Whether the occlusion map has contact shadows.
override contact_shadows: bool = false;
// Whether smooth surfaces mirror the picture.
override reflections: bool = false;

@group(1) @binding(4) var reflection_map: texture_2d<f32>;
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

// Reflections around a pixel: a ray hits or misses, so that their outlines have steps.
fn smoothed_reflection(place: TilePixel) -> vec4<f32> {
    let here = textureLoad(reflection_map, place.origin + place.pixel, 0);
    var sum = vec4<f32>(0.0);
    for (var k = 0; k < 9; k++) {
        let off = vec2<i32>(k % 3, k / 3) - 1;
        let near = textureLoad(reflection_map, texel_of(place, place.pixel + off), 0);
        // Of the same surface: 4, 2 and 1 for this pixel, its sides and its corners.
        let weight = f32(4 >> u32(abs(off.x) + abs(off.y))) * select(0.0, 1.0, near.a > 0.0);
        sum += weight * vec4<f32>(near.rgb, 1.0);
    }
    return vec4<f32>(sum.rgb / max(sum.a, 1.0), here.a);
}

// Dither by interleaved gradient noise (Jimenez 2014), from -0.5 to 0.5.
fn dither(pixel: vec2<i32>) -> f32 {
    return fract(52.9829189 * fract(dot(vec2<f32>(pixel), vec2<f32>(0.06711056, 0.00583715)))) - 0.5;
}

@fragment
fn fragment_main(in: Tile) -> @location(0) vec4<f32> {
    let place = tile_pixel(in);
    var occlusion = 0.0;
    var contact = 0.0;
    if ambient_occlusion {
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
    let count = sample_count();
    var sum = vec3<f32>(0.0);
    for (var k = 0u; k < count; k++) {
        var sample = radiance_at(texel, k);
        if reflections && reflection.a > 0.0 {
            // At an edge the other samples may be of another surface.
            let part = clamp(mirror_at(texel, k).a / reflection.a, 0.0, 1.0);
            sample = vec4<f32>(max(sample.rgb + part * reflection.rgb, vec3<f32>(0.0)), sample.a);
        }
        var dark = occlusion * sample.a;
        if contact_shadows {
            // What shines by itself has a negative share: nothing takes light from it.
            dark = select(dark + contact * (1.0 - clamp(sample.a, 0.0, 1.0)), 0.0, sample.a < 0.0);
        }
        sum += aces_filmic(sample.rgb * (frame.sun.w * (1.0 - dark)));
    }
    let shown = srgb_from_linear_exactly(sum / f32(count)) + dither(place.pixel) / 255.0;
    if target_is_srgb {
        return vec4<f32>(linear_from_srgb_exactly(clamp(shown, vec3<f32>(0.0), vec3<f32>(1.0))), 1.0);
    }
    return vec4<f32>(shown, 1.0);
}
