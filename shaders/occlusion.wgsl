// Screen-space ambient occlusion (SSAO): share of the ambient light that reaches a pixel, from the depth buffer alone.
// Estimator: McGuire, Mara and Luebke 2012, Scalable Ambient Obscurance, section 2.4.

// Taps per pixel.
override ssao_samples: u32 = 12u;

// Radius of the sampling sphere, metres.
const RADIUS_M: f32 = 1.6;
// Largest radius on the screen, as a share of the picture's height.
const MAX_RADIUS_FRACTION: f32 = 0.11;
// Factor on the occlusion.
const STRENGTH: f32 = 4.5;
// Turns of the spiral of taps.
const SPIRAL_TURNS: f32 = 7.0;

@fragment
fn fragment_main(in: Tile) -> @location(0) vec2<f32> {
    let place = tile_pixel(in);
    let depth = depth_at(place.origin + place.pixel);
    let clip = position_of(place.pixel, depth);
    let here = SurfacePoint(depth, clip.xyz / clip.w);
    // Pixels that a metre covers.
    let scale = 0.5 * view.extent.y * clip.w / length(view.camera_from_clip[1].xyz);
    let widest = MAX_RADIUS_FRACTION * view.extent.y;
    let reach = min(RADIUS_M * scale, widest);
    if depth <= 0.0 || reach < 2.0 {
        return vec2<f32>(1.0, depth);
    }
    let normal = normal_at(place, here);

    // Each of 4 by 4 pixels rotates the spiral by its entry of a Bayer matrix; the display pass blurs over all 16.
    let cell = vec2<u32>(place.pixel & vec2<i32>(3));
    let bayer = ((cell.x ^ cell.y) & 1u) * 8u + (cell.y & 1u) * 4u + ((cell.x ^ cell.y) & 2u) + ((cell.y & 2u) >> 1u);
    let turn = f32(bayer) / 16.0;
    let step_in = fract(f32(bayer) * 0.3125 + 0.03125);

    let radius = reach / scale;
    let far = radius * radius;
    // Bias against self-occlusion by depth rounding and by facets of round meshes.
    let flat_enough = 0.02 + 0.004 * here.position.z;
    // Rotation from tap to tap.
    let part = 6.2831853 * SPIRAL_TURNS / f32(ssao_samples);
    let next = mat2x2<f32>(cos(part), sin(part), -sin(part), cos(part));
    let first = 6.2831853 * turn;
    var direction = vec2<f32>(cos(first), sin(first));
    var occlusion = 0.0;
    for (var k = 0u; k < ssao_samples; k++) {
        let out = (f32(k) + step_in) / f32(ssao_samples);
        let pixel = place.pixel + vec2<i32>(round(direction * (out * reach)));
        direction = next * direction;
        let v = surface_at(place, pixel).position - here.position;
        let vv = dot(v, v);
        let near = max(1.0 - vv / far, 0.0);
        occlusion += near * near * max(dot(v, normal) - flat_enough, 0.0) / (vv + 0.01);
    }
    // Fades out where the taps fall on few pixels.
    let strength = STRENGTH * radius * smoothstep(2.0, 6.0, reach);
    let open = max(1.0 - strength * occlusion / f32(ssao_samples), 0.0);
    return vec2<f32>(open, depth);
}
