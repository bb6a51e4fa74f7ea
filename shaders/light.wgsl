// Sun with its shadow, and the light of the sky, for every pass that draws solid things.

@group(1) @binding(0) var shadow_map: texture_depth_2d;
@group(1) @binding(1) var shadow_sampler: sampler_comparison;

// 1: nine taps; 0: one.
override soft_shadows: bool = true;

@group(1) @binding(2) var lamp_map: texture_2d<f32>;
@group(1) @binding(3) var lamp_sampler: sampler;

// Whether lamps burn.
override lamplit: bool = false;

// Light of street lamps and headlights on a surface. The map holds what reaches the ground, so that a wall
// takes what lies before it.
fn lamplight(world: vec3<f32>, normal: vec3<f32>) -> vec3<f32> {
    let at = (world.xy + normal.xy * 1.2) * frame.lamp_place.xy + frame.lamp_place.zw;
    let ground = textureSampleLevel(lamp_map, lamp_sampler, at, 0.0);
    let street = vec3<f32>(1.05, 0.80, 0.48) * ground.a;
    // Headlights shine along the ground: not far up, and not on the tops of things.
    let beams = max(ground.rgb - street, vec3<f32>(0.0));
    let raised = smoothstep(0.15, 0.5, world.z);
    let low = (1.0 - smoothstep(0.6, 1.6, world.z)) * (1.0 - raised * clamp(normal.z, 0.0, 1.0));
    let height = 1.0 - smoothstep(3.5, 8.5, world.z);
    return (street * height + beams * low) * (frame.zenith.w * (0.62 + 0.38 * normal.z));
}

fn sunlit(world: vec3<f32>, normal: vec3<f32>) -> f32 {
    // Moved along the normal as far as the taps reach on a surface that the sun grazes, so that it does not shade
    // itself.
    let facing = clamp(dot(normal, frame.to_sun.xyz), 0.0, 1.0);
    let lifted = world + normal * (frame.shadow_texel.y * (0.9 + 2.3 * sqrt(1.0 - facing * facing)));
    let p = frame.shadow_from_world * vec4<f32>(lifted, 1.0);
    let uv = p.xy * vec2<f32>(0.5, -0.5) + 0.5;
    if !soft_shadows {
        return textureSampleCompareLevel(shadow_map, shadow_sampler, uv, p.z);
    }
    // A tent over five texels of nine taps between texels (Castano 2013, Shadow mapping summary): smooth wherever
    // an edge lies, where fewer taps leave combs along slanted ones.
    let d = frame.shadow_texel.x;
    let at = uv / d;
    let base = floor(at + 0.5);
    let s = at + 0.5 - base;
    let corner = (base - 0.5) * d;
    let first = 4.0 - 3.0 * s;
    let last = 1.0 + 3.0 * s;
    var weights = array<vec2<f32>, 3>(first, vec2<f32>(7.0), last);
    var places = array<vec2<f32>, 3>((3.0 - 2.0 * s) / first - 2.0, (3.0 + s) / 7.0, s / last + 2.0);
    var lit = 0.0;
    for (var k = 0; k < 9; k++) {
        let x = k % 3;
        let y = k / 3;
        let tap = corner + vec2<f32>(places[x].x, places[y].y) * d;
        let seen = textureSampleCompareLevel(shadow_map, shadow_sampler, tap, p.z);
        lit += weights[x].x * weights[y].y * seen;
    }
    return lit / 144.0;
}

struct Material {
    albedo: vec3<f32>,
    // 0 dull to 1 mirror-like at grazing angles.
    gloss: f32,
    openness: f32,
}

// What the sky looks like in each direction above the horizon, smoother level by level; see `sky_at`.
@group(1) @binding(4) var sky_map: texture_2d<f32>;
@group(1) @binding(5) var sky_sampler: sampler;

// Roughness of the lacquer over the paint of cars.
const LACQUER: f32 = 0.12;

// A surface as light at a pixel meets it.
struct Physical {
    albedo: vec3<f32>,
    // How much of the light from all sides reaches it.
    openness: f32,
    // 0 mirror-like to 1 dull.
    roughness: f32,
    // 1: bare metal, which mirrors in its own colour.
    metallic: f32,
    // What shines through it from behind: leaves.
    translucent: f32,
}

// Light that leaves a surface towards the eye.
struct Lit {
    radiance: vec3<f32>,
    // The part of it that comes from all sides, which things nearby keep away.
    ambient: vec3<f32>,
}

// Half of an octahedron, unfolded to a square.
fn sky_at(direction: vec3<f32>, roughness: f32) -> vec3<f32> {
    let up = max(direction.z, 0.0);
    let p = direction.xy / (abs(direction.x) + abs(direction.y) + up);
    let uv = vec2<f32>(p.x + p.y, p.x - p.y) * 0.5 + 0.5;
    return textureSampleLevel(sky_map, sky_sampler, uv, roughness * 5.0).rgb;
}

// What a surface mirrors: the sky over the roofs of the streets, below it what stands and lies there.
fn mirrored(world: vec3<f32>, direction: vec3<f32>, roughness: f32) -> vec3<f32> {
    var street = frame.ground_light.rgb * (1.0 - 0.35 * smoothstep(-0.3, 0.1, direction.z));
    if lamplit {
        let at = (world.xy + direction.xy * 7.0) * frame.lamp_place.xy + frame.lamp_place.zw;
        street += textureSampleLevel(lamp_map, lamp_sampler, at, 0.0).rgb * (0.3 * frame.zenith.w);
    }
    let blur = 0.03 + 0.5 * roughness;
    let open = smoothstep(0.17 - blur, 0.17 + blur, direction.z);
    var above = sky_at(direction, roughness);
    if lamplit {
        // Lenses of street lamps, over where they light the ground the most.
        let over = world.xy + direction.xy * (5.0 / max(direction.z, 0.2));
        let at = over * frame.lamp_place.xy + frame.lamp_place.zw;
        let near = min(textureSampleLevel(lamp_map, lamp_sampler, at, 0.0).a, 1.0);
        let lens = 0.06 * near + near * near * near * (1.0 - roughness) * (1.0 - roughness);
        above += vec3<f32>(1.05, 0.80, 0.48) * (lens * frame.zenith.w);
    }
    return mix(street, above, open);
}

// Sunlight that a rough surface throws towards the eye, over its cosine: Trowbridge and Reitz's distribution
// (Walter et al. 2007), Hammon's fit of its visibility (2017).
fn highlight(n_h: f32, n_l: f32, n_v: f32, roughness: f32) -> f32 {
    // The sun is a disc in haze.
    let alpha = max(roughness * roughness, 0.02);
    let a2 = alpha * alpha;
    let d = n_h * n_h * (a2 - 1.0) + 1.0;
    return a2 / (d * d) * 0.5 / max(mix(2.0 * n_l * n_v, n_l + n_v, alpha), 1e-3);
}

fn fifth(x: f32) -> f32 {
    let c = clamp(x, 0.0, 1.0);
    return c * c * c * c * c;
}

// How much of the light from all sides is mirrored: a factor and a part (Karis 2014).
fn mirror_share(roughness: f32, n_v: f32) -> vec2<f32> {
    let r = roughness * vec4<f32>(-1.0, -0.0275, -0.572, 0.022) + vec4<f32>(1.0, 0.0425, 1.04, -0.04);
    let a = min(r.x * r.x, exp2(-9.28 * n_v)) * r.x + r.y;
    return vec2<f32>(-1.04, 1.04) * a + r.zw;
}

fn shade(m: Physical, world: vec3<f32>, normal: vec3<f32>, to_eye: vec3<f32>) -> Lit {
    let facing = dot(normal, frame.to_sun.xyz);
    let n_l = max(facing, 0.0);
    var seen_sun = 0.0;
    if facing > 0.0 {
        seen_sun = sunlit(world, normal);
    }
    let sun = frame.sun.rgb * (n_l * seen_sun);
    let above = mix(frame.ground_light.rgb, frame.sky_light.rgb, normal.z * 0.5 + 0.5) * m.openness;
    // Leaves that the sun is behind are in the shadow of other leaves, and light comes through those too.
    var light = sun + frame.sun.rgb * (m.translucent * max(-facing, 0.0));
    var around = above;
    if lamplit {
        let lamps = lamplight(world, normal);
        // Street lamps are many, and things nearby keep some of them away.
        light += lamps * 0.6;
        around += lamps * 0.4;
    }
    let matt = m.albedo * (1.0 - m.metallic);
    var direct = matt * light;
    var ambient = matt * around;
    if m.roughness > 0.96 {
        return Lit(direct + ambient, ambient);
    }
    let n_v = max(dot(normal, to_eye), 1e-3);
    let halfway = normalize(frame.to_sun.xyz + to_eye);
    let n_h = max(dot(normal, halfway), 0.0);
    let f0 = mix(vec3<f32>(0.04), m.albedo, m.metallic);
    // Real surfaces ripple, so that at a grazing angle they mirror less than a perfect plane.
    let f90 = 0.75 + 0.25 * m.metallic;
    let share = mirror_share(m.roughness, n_v);
    let image = mirrored(world, reflect(-to_eye, normal), m.roughness) * m.openness;
    let mirror = image * (f0 * share.x + f90 * share.y);
    let fresnel = f0 + (f90 - f0) * fifth(1.0 - dot(to_eye, halfway));
    let glint = fresnel * (highlight(n_h, n_l, n_v, m.roughness) * n_l * seen_sun);
    direct += frame.sun.rgb * min(glint, vec3<f32>(12.0));
    // Sharp images are of things farther away than what occludes.
    ambient += mirror * m.roughness;
    direct += mirror * (1.0 - m.roughness);
    return Lit(direct + ambient, ambient);
}

fn luminance(c: vec3<f32>) -> f32 {
    return dot(c, vec3<f32>(0.2126, 0.7152, 0.0722));
}

// What a sample holds: radiance behind the haze, and which share of it ambient occlusion may take.
fn sampled(lit: Lit, glow: vec3<f32>, from_eye: vec3<f32>) -> vec4<f32> {
    let clear = clearness(from_eye, view.eye.z, frame.haze.w);
    let radiance = mix(frame.haze.rgb, lit.radiance + glow, clear);
    let share = luminance(lit.ambient) * clear / max(luminance(radiance), 1e-5);
    return vec4<f32>(min(radiance, vec3<f32>(3e4)), clamp(share, 0.0, 1.0));
}
