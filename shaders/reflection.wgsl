// Reflections in screen space: what a smooth surface mirrors of the picture itself replaces what the environment map has
// there. A ray is marched through the depth buffer; see McGuire and Mara 2014, Efficient GPU Screen-Space Ray Tracing.

// Steps of a ray across the picture, and halvings of the step that has found a surface.
override reflection_steps: u32 = 64u;
const HALVINGS: u32 = 6u;
// Longest ray, metres.
const REACH_M: f32 = 90.0;
// Nearest depth that a ray may come to, metres.
const NEAREST_M: f32 = 0.3;
// A ray that passes farther behind a surface than this goes on behind it: metres, and per metre of depth.
const THICKNESS_M: f32 = 0.35;
const THICKNESS_PER_M: f32 = 0.02;
// Rays fade out towards the edges of the picture, beyond which nothing is known, as a share of its extent.
const EDGE: f32 = 0.12;
// Share of the longest ray over which reflections fade out, and of the thickness of what a ray has passed behind.
const END: f32 = 0.35;
const PASSED: f32 = 0.4;
// A ray that passes behind something within so many metres of its start, and at most so far behind it, is under it or inside of
// it: it meets what the picture does not show, which is dark, for no sky is seen there.
const UNDER_M: f32 = 1.6;
const UNDER_BEHIND_M: f32 = 5.0;
const UNDER_DARK: f32 = 0.85;
// Pavements and roads are no higher, metres; what mirrors there lies flat.
const GROUND_M: f32 = 0.3;
// Weaker reflections are not seen.
const LEAST: f32 = 0.004;

// A ray between two points on the picture: distances along it are in shares of its length there.
struct Ray {
    pixels: array<vec2<f32>, 2>,
    // Inverse depths, which are linear on the picture.
    inverse: vec2<f32>,
}

fn pixel_on(ray: Ray, share: f32) -> vec2<i32> {
    return vec2<i32>(mix(ray.pixels[0], ray.pixels[1], share));
}

fn depth_on(ray: Ray, share: f32) -> f32 {
    return 1.0 / mix(ray.inverse.x, ray.inverse.y, share);
}

// How far a ray is behind the surface that the picture shows there, metres; negative before it.
fn behind(place: TilePixel, ray: Ray, share: f32) -> f32 {
    let seen = surface_at(place, pixel_on(ray, share));
    if seen.depth <= 0.0 {
        return -1e6;
    }
    return depth_on(ray, share) - seen.position.z;
}

fn is_surface(excess_m: f32, depth_m: f32) -> bool {
    return excess_m > 0.0 && excess_m < THICKNESS_M + THICKNESS_PER_M * depth_m;
}

// Part of a step by which a ray is shifted, 0 to 1: neighbouring pixels, and the pictures that are averaged, find what
// lies between the steps of others (interleaved gradient noise, Jimenez 2014).
fn step_shift(pixel: vec2<i32>) -> f32 {
    let at = vec2<f32>(pixel) + 5.588238 * view.eye.w;
    return fract(52.9829189 * fract(dot(at, vec2<f32>(0.06711056, 0.00583715))));
}

// How far along a ray in the camera frame a share of it is, metres.
fn metres_on(ray: Ray, share: f32, climb: f32) -> f32 {
    return abs(depth_on(ray, share) - 1.0 / ray.inverse.x) / climb;
}

// Where a ray ends.
struct Meeting {
    // Share of it at which it meets a surface; negative where it meets none.
    share: f32,
    // Whether it is soon under or inside of something.
    is_under: bool,
    // Whether it met the surface where something before it hides both, as the leaves of a crown: the first of it that is seen again.
    is_hidden: bool,
}

// `climb` is the depth that a metre of the ray covers.
fn meets(place: TilePixel, ray: Ray, climb: f32) -> Meeting {
    let shift = step_shift(place.pixel);
    var before = 0.0;
    // Last share of it at which nothing hid it.
    var free = 0.0;
    var is_under = false;
    for (var k = 1u; k <= reflection_steps; k++) {
        // Short steps at first: what is near is mirrored in detail.
        let part = (f32(k) - shift) / f32(reflection_steps);
        let share = part * mix(part, 1.0, 0.4);
        let excess = behind(place, ray, share);
        // A long step may end far behind a surface that it has crossed.
        let stride = abs(depth_on(ray, share) - depth_on(ray, before));
        if excess > 0.0 && excess < THICKNESS_M + THICKNESS_PER_M * depth_on(ray, share) + stride {
            var low = before;
            var high = share;
            for (var j = 0u; j < HALVINGS; j++) {
                let middle = 0.5 * (low + high);
                if behind(place, ray, middle) > 0.0 {
                    high = middle;
                } else {
                    low = middle;
                }
            }
            if is_surface(behind(place, ray, high), depth_on(ray, high)) {
                return Meeting(high, is_under, false);
            }
        }
        // What it was before of when it was hidden, and is behind of now, it has met meanwhile.
        let hidden = depth_on(ray, share) - depth_on(ray, free);
        if free < before && excess > 0.0 && excess < hidden {
            return Meeting(share, is_under, true);
        }
        if excess <= 0.0 {
            free = share;
        }
        is_under = is_under
            || (excess > 0.0 && excess < UNDER_BEHIND_M && metres_on(ray, share, climb) < UNDER_M);
        before = share;
    }
    return Meeting(-1.0, is_under, false);
}

fn mean_radiance(place: TilePixel, pixel: vec2<i32>) -> vec3<f32> {
    let texel = texel_of(place, pixel);
    let count = sample_count();
    var sum = vec3<f32>(0.0);
    for (var k = 0u; k < count; k++) {
        sum += min(radiance_at(texel, k).rgb, vec3<f32>(40.0));
    }
    return sum / f32(count);
}

// Unit normal of what mirrors. That of the ground is known: through the leaves of a crown too little of it is seen to tell.
fn mirroring_normal(place: TilePixel, here: SurfacePoint) -> vec3<f32> {
    let up = normalize((view.camera_from_clip * view.clip_from_world[2]).xyz);
    if view.eye.z + dot(up, here.position) < GROUND_M {
        return up;
    }
    return normal_at(place, here);
}

// What is added to the radiance of a pixel; alpha: reflectance of its first sample.
@fragment
fn fragment_main(in: Tile) -> @location(0) vec4<f32> {
    let place = tile_pixel(in);
    let mirror = mirror_at(place.origin + place.pixel, 0u);
    let here = surface_at(place, place.pixel);
    // The depth of glass is that of what is behind it: no ray starts there.
    let is_behind_glass = radiance_at(place.origin + place.pixel, 0u).a < 0.0;
    if mirror.a < LEAST || here.depth <= 0.0 || is_behind_glass {
        return vec4<f32>(0.0);
    }
    let normal = mirroring_normal(place, here);
    let direction = reflect(normalize(here.position), normal);
    // Off the surface, by more where a pixel spans more.
    let start = here.position + normal * (0.02 + 0.002 * here.position.z);
    // The ray ends before the camera.
    var reach = REACH_M;
    if direction.z < 0.0 {
        reach = min(reach, (NEAREST_M - start.z) / direction.z);
    }
    let end = start + direction * reach;
    let ray = Ray(array<vec2<f32>, 2>(pixel_of(start), pixel_of(end)), 1.0 / vec2<f32>(start.z, end.z));
    // Only as far as the picture goes.
    let run = ray.pixels[1] - ray.pixels[0];
    let room = select(-ray.pixels[0], view.extent.xy - ray.pixels[0], run > vec2<f32>(0.0));
    let shares = room / select(run, vec2<f32>(1e-3), abs(run) < vec2<f32>(1e-3));
    let part = clamp(min(shares.x, shares.y), 0.0, 1.0);
    let cut = Ray(
        array<vec2<f32>, 2>(ray.pixels[0], mix(ray.pixels[0], ray.pixels[1], part)),
        vec2<f32>(ray.inverse.x, mix(ray.inverse.x, ray.inverse.y, part)),
    );
    let climb = max(abs(direction.z), 0.02);
    let met = meets(place, cut, climb);
    let share = met.share;
    if share < 0.0 {
        let dark = select(0.0, UNDER_DARK, met.is_under);
        return vec4<f32>(-dark * mirror.rgb, mirror.a);
    }
    let found = pixel_on(cut, share);
    let at = vec2<f32>(found) / view.extent.xy;
    let inside = smoothstep(vec2<f32>(0.0), vec2<f32>(EDGE), min(at, 1.0 - at));
    // Of what faces the camera's back nothing is seen: such rays would mirror the front of things instead.
    let forward = smoothstep(-0.35, 0.0, direction.z);
    // A ray that ends, or that passes behind an edge, fades out before it does.
    let depth = depth_on(cut, share);
    let metres = abs(depth - start.z) / climb;
    let ending = 1.0 - smoothstep(1.0 - END, 1.0, metres / REACH_M);
    let excess = behind(place, cut, share) / (THICKNESS_M + THICKNESS_PER_M * depth);
    let passed = select(1.0 - smoothstep(1.0 - PASSED, 1.0, excess), 1.0, met.is_hidden);
    let fade = inside.x * inside.y * forward * ending * passed;
    let seen = mean_radiance(place, found);
    return vec4<f32>(fade * (mirror.a * seen - mirror.rgb), mirror.a);
}
