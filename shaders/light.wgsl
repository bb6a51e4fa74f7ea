// Physically based shading: sun with shadow map, hemisphere light, environment map and lamps, for solid surfaces.

@group(1) @binding(0) var shadow_map: texture_depth_2d;
@group(1) @binding(1) var shadow_sampler: sampler_comparison;

// Percentage-closer filtering (PCF) of shadow edges: nine taps, or one.
override soft_shadows: bool = true;

@group(1) @binding(2) var lamp_map: texture_2d<f32>;
@group(1) @binding(3) var lamp_sampler: sampler;

// Whether lamps burn.
override lamplit: bool = false;

// Light of street lamps and headlights on a surface, from the light map of the ground: a wall takes the light of the
// ground in front of it.
fn lamplight(world: vec3<f32>, normal: vec3<f32>) -> vec3<f32> {
    let at = (world.xy + normal.xy * 1.2) * frame.lamp_uv_from_world.xy + frame.lamp_uv_from_world.zw;
    let ground = textureSampleLevel(lamp_map, lamp_sampler, at, 0.0);
    let street = vec3<f32>(1.05, 0.80, 0.48) * ground.a;
    // Headlights shine along the ground: they light what stands, hardly the tops of objects, and little above their cut-off. Each
    // vehicle of a queue adds less, for bodies stand between.
    let beams = max(ground.rgb - street, vec3<f32>(0.0));
    let spread = 1.0 / (1.0 + 0.25 * beams.g);
    let raised = smoothstep(0.15, 0.5, world.z);
    let cut_off = mix(1.0, 0.12, smoothstep(0.7, 1.5, world.z)) * (1.0 - smoothstep(2.6, 4.5, world.z));
    let low = spread * cut_off * (1.0 - raised * clamp(normal.z, 0.0, 1.0));
    let height = 1.0 - smoothstep(3.5, 8.5, world.z);
    return (street * (height * (0.62 + 0.38 * normal.z)) + beams * low) * frame.zenith.w;
}

// Shadow map lookup with PCF: 1 in sunlight, 0 in shadow.
fn sun_visibility(world: vec3<f32>, normal: vec3<f32>) -> f32 {
    // Normal offset against shadow acne: as far as the taps reach on a surface at a grazing angle to the sun.
    let facing = clamp(dot(normal, frame.to_sun.xyz), 0.0, 1.0);
    let lifted = world + normal * (frame.shadow_texel.y * (0.9 + 2.3 * sqrt(1.0 - facing * facing)));
    let p = frame.shadow_from_world * vec4<f32>(lifted, 1.0);
    let uv = p.xy * vec2<f32>(0.5, -0.5) + 0.5;
    if !soft_shadows {
        return textureSampleCompareLevel(shadow_map, shadow_sampler, uv, p.z);
    }
    // PCF by a tent over five texels in nine bilinear taps (Castano 2013, Shadow mapping summary). Fewer taps leave
    // combs along slanted edges.
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

// Material of vertex-lit surfaces.
struct Material {
    albedo: vec3<f32>,
    // 0 matt to 1 mirror-like at grazing angles.
    gloss: f32,
    openness: f32,
}

// Environment map: radiance of the sky above the horizon, blurrier in each mipmap; see `sky_radiance`.
@group(1) @binding(4) var sky_map: texture_2d<f32>;
@group(1) @binding(5) var sky_sampler: sampler;

// Roughness of the clear coat over car paint.
const LACQUER: f32 = 0.08;

// Metallic-roughness material of a pixel.
struct PbrMaterial {
    albedo: vec3<f32>,
    // Baked ambient visibility: share of the ambient light that arrives.
    openness: f32,
    // 0 mirror-like to 1 matt.
    roughness: f32,
    // 1: bare metal, whose reflections take its own colour.
    metallic: f32,
    // Share of light from behind that passes through, for leaves.
    translucent: f32,
    // Car paint: flakes of metal under the clear coat, 0 without.
    coated: f32,
}

// Light that leaves a surface towards the eye.
struct Lit {
    radiance: vec3<f32>,
    // The ambient part, which ambient occlusion may reduce.
    ambient: vec3<f32>,
    // The part of a smooth surface that the environment map reflects; alpha: its reflectance.
    mirror: vec4<f32>,
}

// Roughness from which and to which reflections in screen space fade out.
const SMOOTH: vec2<f32> = vec2<f32>(0.12, 0.42);

// Roughness between which surfaces become matt at grazing angles.
const MATT: vec2<f32> = vec2<f32>(0.80, 0.92);

// Lookup in the environment map: hemi-octahedral mapping, mipmap level by roughness.
fn sky_radiance(direction: vec3<f32>, roughness: f32) -> vec3<f32> {
    let up = max(direction.z, 0.0);
    let p = direction.xy / (abs(direction.x) + abs(direction.y) + up);
    let uv = vec2<f32>(p.x + p.y, p.x - p.y) * 0.5 + 0.5;
    return textureSampleLevel(sky_map, sky_sampler, uv, roughness * 5.0).rgb;
}

// Environment reflection: sky above the roofs, colour of the street below them.
fn reflected_radiance(world: vec3<f32>, direction: vec3<f32>, roughness: f32) -> vec3<f32> {
    // Walls and cars are greyer than the ground.
    let ground = mix(frame.ground_light.rgb, vec3<f32>(luminance(frame.ground_light.rgb)), 0.6);
    var street = ground * (1.0 - 0.35 * smoothstep(-0.3, 0.1, direction.z));
    // In rain what stands around is bright with haze, and open between the houses.
    street = mix(street, frame.haze.rgb, 0.20 * frame.shadow_texel.z * smoothstep(0.0, 0.06, direction.z));
    if lamplit {
        let at = (world.xy + direction.xy * 7.0) * frame.lamp_uv_from_world.xy + frame.lamp_uv_from_world.zw;
        street += min(textureSampleLevel(lamp_map, lamp_sampler, at, 0.0).rgb, vec3<f32>(0.9)) * (0.3 * frame.zenith.w);
    }
    let blur = 0.03 + 0.5 * roughness;
    let open = smoothstep(0.17 - blur, 0.17 + blur, direction.z);
    var above = sky_radiance(direction, roughness);
    if lamplit {
        // Reflections of street lamps: bright where the light map is brightest below the reflected ray.
        let over = world.xy + direction.xy * (5.0 / max(direction.z, 0.2));
        let at = over * frame.lamp_uv_from_world.xy + frame.lamp_uv_from_world.zw;
        let near = min(textureSampleLevel(lamp_map, lamp_sampler, at, 0.0).a, 1.0);
        let lens = 0.06 * near + near * near * near * (1.0 - roughness) * (1.0 - roughness);
        above += vec3<f32>(1.05, 0.80, 0.48) * (lens * frame.zenith.w);
    }
    return mix(street, above, open);
}

// Specular highlight of the sun: GGX (Trowbridge-Reitz) distribution (Walter et al. 2007) times Hammon's fit of the
// Smith visibility term (2017).
fn ggx_specular(n_h: f32, n_l: f32, n_v: f32, roughness: f32) -> f32 {
    // Least roughness: the sun is a disc in haze.
    let alpha = max(roughness * roughness, 0.02);
    let a2 = alpha * alpha;
    let d = n_h * n_h * (a2 - 1.0) + 1.0;
    return a2 / (d * d) * 0.5 / max(mix(2.0 * n_l * n_v, n_l + n_v, alpha), 1e-3);
}

// Fifth power, for Schlick's approximation of the Fresnel term.
fn pow5(x: f32) -> f32 {
    let c = clamp(x, 0.0, 1.0);
    return c * c * c * c * c;
}

// Environment BRDF: analytic fit of scale and bias to f0 (Karis 2014).
fn environment_brdf(roughness: f32, n_v: f32) -> vec2<f32> {
    let r = roughness * vec4<f32>(-1.0, -0.0275, -0.572, 0.022) + vec4<f32>(1.0, 0.0425, 1.04, -0.04);
    let a = min(r.x * r.x, exp2(-9.28 * n_v)) * r.x + r.y;
    return vec2<f32>(-1.04, 1.04) * a + r.zw;
}

fn shade(m: PbrMaterial, world: vec3<f32>, normal: vec3<f32>, to_eye: vec3<f32>) -> Lit {
    let facing = dot(normal, frame.to_sun.xyz);
    let n_l = max(facing, 0.0);
    var sun_seen = 0.0;
    if facing > 0.0 {
        sun_seen = sun_visibility(world, normal);
    }
    let sun = frame.sun.rgb * (n_l * sun_seen);
    let above = mix(frame.ground_light.rgb, frame.sky_light.rgb, normal.z * 0.5 + 0.5) * m.openness;
    // Translucency of back-lit leaves, without shadow: the light passes through several layers of leaves.
    var light = sun + frame.sun.rgb * (m.translucent * max(-facing, 0.0));
    var around = above;
    if lamplit {
        let lamps = lamplight(world, normal);
        // Part of the light of lamps counts as ambient: ambient occlusion stands in for their shadows.
        light += lamps * 0.6;
        around += lamps * 0.4;
    }
    let matt = m.albedo * (1.0 - m.metallic);
    var direct = matt * light;
    var ambient = matt * around;
    if m.roughness > 0.96 {
        return Lit(direct + ambient, ambient, vec4<f32>(0.0));
    }
    let n_v = max(dot(normal, to_eye), 1e-3);
    let halfway = normalize(frame.to_sun.xyz + to_eye);
    let n_h = max(dot(normal, halfway), 0.0);
    let f0 = mix(vec3<f32>(0.04), m.albedo, m.metallic);
    // Below 1: real surfaces ripple and reflect less at grazing angles than a perfect plane. Matt ones, of grained plastic or
    // cloth, hide their grazing facets from one another.
    let grain = smoothstep(MATT.x, MATT.y, m.roughness);
    let f90 = mix(0.75 + 0.25 * m.metallic, 0.10, grain);
    let share = environment_brdf(m.roughness, n_v);
    let image = reflected_radiance(world, reflect(-to_eye, normal), m.roughness) * m.openness;
    let reflectance = f0 * share.x + f90 * share.y;
    let mirror = image * reflectance;
    let fresnel = f0 + (f90 - f0) * pow5(1.0 - dot(to_eye, halfway));
    let glint = fresnel * (ggx_specular(n_h, n_l, n_v, m.roughness) * n_l * sun_seen * (1.0 - 0.7 * grain));
    // Behind the clouds of rain the sun has no disc that wet ground or glass could mirror, and hardly one in fog.
    let disc_seen = 1.0 - min(2.0 * frame.shadow_texel.z, 1.0);
    direct += frame.sun.rgb * min(glint, vec3<f32>(12.0)) * disc_seen;
    if m.coated > 0.0 {
        // The base layer under the clear coat: a broad highlight in the colour of the paint.
        let flakes = ggx_specular(n_h, n_l, n_v, 0.45) * n_l * sun_seen;
        direct += frame.sun.rgb * m.albedo * (0.35 * m.coated * flakes);
    }
    // Sharp reflections show distant things, which nearby occluders do not hide.
    ambient += mirror * m.roughness;
    direct += mirror * (1.0 - m.roughness);
    let sharp = 1.0 - smoothstep(SMOOTH.x, SMOOTH.y, m.roughness);
    return Lit(direct + ambient, ambient, vec4<f32>(mirror, luminance(reflectance)) * sharp);
}

// Pixel of the HDR target: light through the fog.
fn hdr_pixel(lit: Lit, glow: vec3<f32>, from_eye: vec3<f32>) -> HdrPixel {
    let clear = fog_transmittance(from_eye, view.eye.z, frame.haze.w);
    let radiance = mix(frame.haze.rgb, lit.radiance + glow, clear);
    let share = luminance(lit.ambient) * clear / max(luminance(radiance), 1e-5);
    let seen = vec4<f32>(min(radiance, vec3<f32>(3e4)), clamp(share, 0.0, 1.0));
    return HdrPixel(seen, lit.mirror * clear);
}
