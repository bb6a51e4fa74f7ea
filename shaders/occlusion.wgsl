// Ambient occlusion: how much of the light from all sides reaches what a pixel shows past what is near it.
// The estimator of McGuire, Mara and Luebke 2012, Scalable Ambient Obscurance, section 2.4, from the depths alone.

// Looks around a pixel.
override looks: u32 = 12u;

// Things farther than this keep no light away, metres.
const RADIUS: f32 = 1.6;
// Most of the picture's height that the looks may spread over to either side.
const WIDEST: f32 = 0.11;
// How dark a corner gets.
const STRENGTH: f32 = 4.5;
// Looks of one pixel are this many turns apart in all.
const TURNS: f32 = 7.0;

// In the camera's frame.
fn position_of(pixel: vec2<i32>, depth: f32) -> vec4<f32> {
    let at = (vec2<f32>(pixel) + 0.5) / view.extent.xy;
    return view.camera_from_clip * vec4<f32>(at.x * 2.0 - 1.0, 1.0 - at.y * 2.0, depth, 1.0);
}

struct Seen {
    depth: f32,
    position: vec3<f32>,
}

fn seen_at(place: Place, pixel: vec2<i32>) -> Seen {
    let depth = depth_at(texel_of(place, pixel));
    let p = position_of(pixel, depth);
    return Seen(depth, p.xyz / p.w);
}

// Along one axis of the picture on the surface at `here`: towards the side that goes on as the surface does, for
// depths of a plane are linear in pixels.
fn along(place: Place, here: Seen, axis: vec2<i32>) -> vec3<f32> {
    let before = seen_at(place, place.pixel - axis);
    let after = seen_at(place, place.pixel + axis);
    let beyond_before = depth_at(texel_of(place, place.pixel - 2 * axis));
    let beyond_after = depth_at(texel_of(place, place.pixel + 2 * axis));
    let bend_before = abs(2.0 * before.depth - beyond_before - here.depth);
    let bend_after = abs(2.0 * after.depth - beyond_after - here.depth);
    return select(after.position - here.position, here.position - before.position, bend_before < bend_after);
}

@fragment
fn fragment_main(in: Tile) -> @location(0) vec2<f32> {
    let place = place_of(in);
    let depth = depth_at(place.origin + place.pixel);
    let clip = position_of(place.pixel, depth);
    let here = Seen(depth, clip.xyz / clip.w);
    // Pixels that a metre covers.
    let scale = 0.5 * view.extent.y * clip.w / length(view.camera_from_clip[1].xyz);
    let widest = WIDEST * view.extent.y;
    let reach = min(RADIUS * scale, widest);
    if depth <= 0.0 || reach < 2.0 {
        return vec2<f32>(1.0, depth);
    }
    let x = along(place, here, vec2<i32>(1, 0));
    let y = along(place, here, vec2<i32>(0, 1));
    let normal = normalize(cross(y, x));

    // Each of 4 by 4 pixels looks in directions of its own; the display pass takes the mean over all 16.
    let cell = vec2<u32>(place.pixel & vec2<i32>(3));
    let bayer = ((cell.x ^ cell.y) & 1u) * 8u + (cell.y & 1u) * 4u + ((cell.x ^ cell.y) & 2u) + ((cell.y & 2u) >> 1u);
    let turn = f32(bayer) / 16.0;
    let step_in = fract(f32(bayer) * 0.3125 + 0.03125);

    let radius = reach / scale;
    let far = radius * radius;
    // Rounding of depths and facets of round things shade nothing.
    let flat_enough = 0.02 + 0.004 * here.position.z;
    // From look to look by a turn of the direction.
    let part = 6.2831853 * TURNS / f32(looks);
    let next = mat2x2<f32>(cos(part), sin(part), -sin(part), cos(part));
    let first = 6.2831853 * turn;
    var direction = vec2<f32>(cos(first), sin(first));
    var kept = 0.0;
    for (var k = 0u; k < looks; k++) {
        let out = (f32(k) + step_in) / f32(looks);
        let pixel = place.pixel + vec2<i32>(round(direction * (out * reach)));
        direction = next * direction;
        let v = seen_at(place, pixel).position - here.position;
        let vv = dot(v, v);
        let near = max(1.0 - vv / far, 0.0);
        kept += near * near * max(dot(v, normal) - flat_enough, 0.0) / (vv + 0.01);
    }
    // Fades out where the looks come to lie on a few pixels.
    let strength = STRENGTH * radius * smoothstep(2.0, 6.0, reach);
    let open = max(1.0 - strength * kept / f32(looks), 0.0);
    return vec2<f32>(open, depth);
}
