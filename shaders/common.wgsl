// Uniforms of frame and view, the sky gradient, height fog and sRGB decoding, for all passes.

struct Frame {
    // Unit vector towards the sun; w: simulated time in seconds.
    to_sun: vec4<f32>,
    // Radiance of the sun on a surface that faces it; w: exposure.
    sun: vec4<f32>,
    // Hemisphere light: ambient light from the sky and from the ground.
    sky_light: vec4<f32>,
    ground_light: vec4<f32>,
    // Colour of the fog; w: density per metre.
    haze: vec4<f32>,
    shadow_from_world: mat4x4<f32>,
    // Size of a texel of the shadow map; x: in texture coordinates, y: in metres. z: how wet the ground is, 0 to 1.
    shadow_texel: vec4<f32>,
    // Radiance of the sky at the zenith; w: brightness of lamps, 0 by day.
    zenith: vec4<f32>,
    // Texture coordinates in the light map of lamps from city metres: times xy plus zw.
    lamp_uv_from_world: vec4<f32>,
}

struct View {
    clip_from_world: mat4x4<f32>,
    // City, metres; w: number of the picture among those that are averaged.
    eye: vec4<f32>,
    // From clip coordinates: x right, y down, z forward, metres.
    camera_from_clip: mat4x4<f32>,
    // Width and height in pixels; depth tolerance of the blur of the ambient occlusion: relative (z) and absolute (w).
    extent: vec4<f32>,
}

// Pixel of the HDR target, and where reflections in screen space are on, what they may replace.
struct HdrPixel {
    // Radiance; alpha: share that ambient occlusion may take; negative for what shines by itself.
    @location(0) radiance: vec4<f32>,
    // Radiance that the environment map reflects; alpha: reflectance. Nothing of surfaces that are not smooth.
    @location(1) mirror: vec4<f32>,
}

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<uniform> view: View;

// Sky gradient without sun and clouds, for reflections and fog.
fn sky_colour(direction: vec3<f32>) -> vec3<f32> {
    return sky_gradient(direction, frame.haze.rgb, frame.zenith.rgb, frame.ground_light.rgb);
}

fn sky_gradient(direction: vec3<f32>, haze: vec3<f32>, zenith: vec3<f32>, ground: vec3<f32>) -> vec3<f32> {
    let up = clamp(direction.z, 0.0, 1.0);
    let sky = mix(haze, zenith, 1.0 - exp(-3.2 * up));
    let below = clamp(-direction.z * 4.0, 0.0, 1.0);
    return mix(sky, ground * 0.6, below);
}

// Scale height of the exponential height fog, metres.
const HAZE_HEIGHT: f32 = 45.0;
// Distance at which fog hides the end of the land around the city, metres.
const HAZE_END: f32 = 8600.0;

// Transmittance of exponential height fog: 1 nearby, 0 at the horizon; rays down from high up stay clear. `density` is
// that at the ground.
fn fog_transmittance(from_eye: vec3<f32>, eye_height: f32, density: f32) -> f32 {
    let low = max(min(eye_height, eye_height + from_eye.z), 0.0) / HAZE_HEIGHT;
    let climb = max(abs(from_eye.z) / HAZE_HEIGHT, 0.01);
    let mean = exp(-low) * (1.0 - exp(-climb)) / climb;
    let depth = length(from_eye) * density * mean;
    let end = smoothstep(0.3 * HAZE_END, HAZE_END, length(from_eye.xy));
    return exp(-depth * sqrt(depth)) * (1.0 - end);
}

// Constant colours under one directional light, for comparison with other engines: no textures, no shadows, no tone
// mapping.
override flat_light: bool = false;

// Vertex colour in linear light; flat light takes it as it is.
fn vertex_colour(c: vec3<f32>) -> vec3<f32> {
    if flat_light {
        return c;
    }
    return linear_from_srgb(c);
}

fn luminance(c: vec3<f32>) -> f32 {
    return dot(c, vec3<f32>(0.2126, 0.7152, 0.0722));
}

// sRGB to linear, by a cubic polynomial.
fn linear_from_srgb(c: vec3<f32>) -> vec3<f32> {
    return c * (c * (c * 0.305306011 + 0.682171111) + 0.012522878);
}
