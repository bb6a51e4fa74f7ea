// What every pass knows: the frame, the view, and how light reaches the eye.

struct Frame {
    // Unit vector towards the sun; w: simulated time in seconds.
    to_sun: vec4<f32>,
    // Radiance of the sun on a surface that faces it; w: exposure.
    sun: vec4<f32>,
    // Light from above and from the ground.
    sky_light: vec4<f32>,
    ground_light: vec4<f32>,
    // Colour of the haze; w: density per metre.
    haze: vec4<f32>,
    shadow_from_world: mat4x4<f32>,
    // x: size of a texel of the shadow map in its coordinates, y: in metres.
    shadow_texel: vec4<f32>,
    // Radiance of the sky overhead; w: how bright lamps burn, 0 by day.
    zenith: vec4<f32>,
    // Place in the map of lamplight from city metres: times xy plus zw.
    lamp_place: vec4<f32>,
}

struct View {
    clip_from_world: mat4x4<f32>,
    eye: vec4<f32>,
    // From clip coordinates: x right, y down, z forward, metres.
    camera_from_clip: mat4x4<f32>,
    // Width and height in pixels, and how far depths of one surface may differ: a part of them plus so much.
    extent: vec4<f32>,
}

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<uniform> view: View;

// The sky without sun and clouds, as reflections and the haze at the horizon see it.
fn sky_colour(direction: vec3<f32>) -> vec3<f32> {
    return sky_between(direction, frame.haze.rgb, frame.zenith.rgb, frame.ground_light.rgb);
}

fn sky_between(direction: vec3<f32>, haze: vec3<f32>, zenith: vec3<f32>, ground: vec3<f32>) -> vec3<f32> {
    let up = clamp(direction.z, 0.0, 1.0);
    let sky = mix(haze, zenith, 1.0 - exp(-3.2 * up));
    let below = clamp(-direction.z * 4.0, 0.0, 1.0);
    return mix(sky, ground * 0.6, below);
}

// The haze lies on the ground: the height at which it is a third of what it is there, metres.
const HAZE_HEIGHT: f32 = 45.0;
// Where the plain around the city ends, all is haze: metres from the eye.
const HAZE_END: f32 = 1300.0;

// How much light comes through the haze: clear nearby, closed at the horizon; looks down from high up are clear.
// The density is that on the ground.
fn clearness(from_eye: vec3<f32>, eye_height: f32, density: f32) -> f32 {
    let low = max(min(eye_height, eye_height + from_eye.z), 0.0) / HAZE_HEIGHT;
    let climb = max(abs(from_eye.z) / HAZE_HEIGHT, 0.01);
    let mean = exp(-low) * (1.0 - exp(-climb)) / climb;
    let depth = length(from_eye) * density * mean;
    let end = smoothstep(0.3 * HAZE_END, HAZE_END, length(from_eye.xy));
    return exp(-depth * sqrt(depth)) * (1.0 - end);
}

// Faces in their own colours under one light, as other engines draw a scene that is compared with them: no
// textures, no shadows, no display curve.
override flat_light: bool = false;

// Colours of vertices: linear, of a flat light as they are.
fn vertex_colour(c: vec3<f32>) -> vec3<f32> {
    if flat_light {
        return c;
    }
    return linear_from_srgb(c);
}

// sRGB to linear.
fn linear_from_srgb(c: vec3<f32>) -> vec3<f32> {
    return c * (c * (c * 0.305306011 + 0.682171111) + 0.012522878);
}
