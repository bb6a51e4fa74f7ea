// Depth and labels of a view in colours for people: near is bright, classes and vehicles have colours of their own.

// 1 depth, 2 semantic classes, 3 instances: the kinds of `PictureKind`.
override kind: u32 = 1u;
// Whether the target is of an sRGB format, which encodes once more.
override target_is_srgb: bool = false;

@group(0) @binding(0) var depth_map: texture_2d<f32>;
@group(0) @binding(1) var labels: texture_2d<u32>;

// Depth of the darkest and the brightest grey, metres; between them the scale is logarithmic.
const FAR_M: f32 = 200.0;
const NEAR_M: f32 = 1.0;
// The sky has no depth: a colour that is none of the greys, that of its class.
const SKY: vec3<f32> = vec3<f32>(70.0, 130.0, 180.0) / 255.0;

@vertex
fn vertex_main(@builtin(vertex_index) corner: u32) -> @builtin(position) vec4<f32> {
    let part = vec2<f32>(f32(corner & 1u), f32(corner >> 1u)) * 2.0;
    return vec4<f32>(part.x * 2.0 - 1.0, 1.0 - part.y * 2.0, 0.0, 1.0);
}

fn depth_colour(depth_m: f32) -> vec3<f32> {
    if depth_m < 0.0 {
        return SKY;
    }
    let far = log(clamp(depth_m, NEAR_M, FAR_M) / NEAR_M) / log(FAR_M / NEAR_M);
    return vec3<f32>(1.0 - 0.92 * far);
}

fn class_colour(number: u32) -> vec3<f32> {
    var colours = CLASS_COLOURS;
    return colours[min(number, CLASS_COUNT - 1u)];
}

// Colours of consecutive numbers lie a golden angle apart on the circle of hues. Numbers a Fibonacci number apart have nearly one hue:
// saturation and value differ there.
fn instance_colour(number: u32) -> vec3<f32> {
    if number == 0u {
        return vec3<f32>(0.0);
    }
    let hue = fract(f32(number) * 0.618034);
    let saturation = 0.45 + 0.55 * fract(f32(number) * 0.5698403);
    let value = 0.6 + 0.4 * fract(f32(number) * 0.7548777);
    let ramp = abs(fract(hue + vec3<f32>(1.0, 2.0 / 3.0, 1.0 / 3.0)) * 6.0 - 3.0) - 1.0;
    return value * mix(vec3<f32>(1.0), clamp(ramp, vec3<f32>(0.0), vec3<f32>(1.0)), saturation);
}

@fragment
fn fragment_main(@builtin(position) clip: vec4<f32>) -> @location(0) vec4<f32> {
    let pixel = vec2<i32>(clip.xy);
    var colour: vec3<f32>;
    if kind == 1u {
        colour = depth_colour(textureLoad(depth_map, pixel, 0).x);
    } else if kind == 2u {
        colour = class_colour(textureLoad(labels, pixel, 0).x);
    } else {
        colour = instance_colour(textureLoad(labels, pixel, 0).y);
    }
    if target_is_srgb {
        colour = pow(colour, vec3<f32>(2.2));
    }
    return vec4<f32>(colour, 1.0);
}
