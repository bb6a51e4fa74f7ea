// Screen-space ambient occlusion (SSAO): share of the ambient light that reaches a pixel, from the depth buffer alone; and
// contact shadows: of the sun, what is too thin or too near for the texels of the shadow map.
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

// Steps of a ray towards the sun; none without contact shadows.
override contact_steps: u32 = 0u;
// Longest ray, metres.
const CONTACT_M: f32 = 0.45;
// What hides the sun is this thick: metres, and per metre of depth.
const CONTACT_THICKNESS_M: f32 = 0.1;
const CONTACT_THICKNESS_PER_M: f32 = 0.012;
// A ray this far behind a surface has met it, not its own: metres, and per metre of depth.
const CONTACT_BIAS_M: f32 = 0.006;
const CONTACT_BIAS_PER_M: f32 = 0.0015;

// Share of the sun that reaches a point: the nearer what hides it, the darker, as a shadow is sharp where things touch.
// `shift`: from 0 to 1, by which neighbouring pixels take other steps. `scale`: pixels that a metre covers.
fn sun_seen(place: TilePixel, here: SurfacePoint, normal: vec3<f32>, shift: f32, scale: f32) -> f32 {
    // Lamps have no shadows.
    let by_day = 1.0 - clamp(frame.zenith.w, 0.0, 1.0);
    let towards = view.camera_from_clip * (view.clip_from_world * vec4<f32>(frame.to_sun.xyz, 0.0));
    let to_sun = normalize(towards.xyz);
    let facing = smoothstep(0.02, 0.2, dot(normal, to_sun));
    let strength = by_day * facing * smoothstep(3.0, 10.0, CONTACT_M * scale);
    if strength <= 0.0 {
        return 1.0;
    }
    let start = here.position + normal * (CONTACT_BIAS_M + CONTACT_BIAS_PER_M * here.position.z);
    for (var k = 0u; k < contact_steps; k++) {
        let part = (f32(k) + 0.3 + 0.7 * shift) / f32(contact_steps);
        let point = start + to_sun * (CONTACT_M * part);
        let pixel = vec2<i32>(floor(pixel_of(point)));
        if point.z < 0.1 || any(pixel < vec2<i32>(0)) || any(pixel > place.last) {
            break;
        }
        let seen = surface_at(place, pixel);
        let behind = point.z - seen.position.z;
        let bias = CONTACT_BIAS_M + CONTACT_BIAS_PER_M * point.z;
        let thickness = CONTACT_THICKNESS_M + CONTACT_THICKNESS_PER_M * point.z;
        if seen.depth > 0.0 && behind > bias && behind < thickness {
            return 1.0 - strength * (1.0 - part * part);
        }
    }
    return 1.0;
}

// Ambient visibility, depth for the bilateral blur, and the share of the sun.
@fragment
fn fragment_main(in: Tile) -> @location(0) vec4<f32> {
    let place = tile_pixel(in);
    let depth = depth_at(place.origin + place.pixel);
    let clip = position_of(place.pixel, depth);
    let here = SurfacePoint(depth, clip.xyz / clip.w);
    // Pixels that a metre covers.
    let scale = 0.5 * view.extent.y * clip.w / length(view.camera_from_clip[1].xyz);
    let widest = MAX_RADIUS_FRACTION * view.extent.y;
    let reach = min(RADIUS_M * scale, widest);
    if depth <= 0.0 || reach < 2.0 {
        return vec4<f32>(1.0, depth, 1.0, 0.0);
    }
    let normal = normal_at(place, here);

    // Each of 4 by 4 pixels rotates the spiral by its entry of a Bayer matrix; the display pass blurs over all 16.
    let cell = vec2<u32>(place.pixel & vec2<i32>(3));
    let bayer = ((cell.x ^ cell.y) & 1u) * 8u + (cell.y & 1u) * 4u + ((cell.x ^ cell.y) & 2u) + ((cell.y & 2u) >> 1u);
    // Each of the pictures that are averaged turns it further.
    let turn = fract(f32(bayer) / 16.0 + 0.6180340 * view.eye.w);
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
    var sun = 1.0;
    if contact_steps > 0u {
        sun = sun_seen(place, here, normal, turn, scale);
    }
    return vec4<f32>(open, depth, sun, 0.0);
}
