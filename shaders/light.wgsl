// Sun with its shadow, and the light of the sky, for every pass that draws solid things.

@group(1) @binding(0) var shadow_map: texture_depth_2d;
@group(1) @binding(1) var shadow_sampler: sampler_comparison;

// 1: four taps a texel and a half apart; 0: one tap.
override soft_shadows: bool = true;

@group(1) @binding(2) var lamp_map: texture_2d<f32>;
@group(1) @binding(3) var lamp_sampler: sampler;

// Whether lamps burn.
override lamplit: bool = false;

// Light of street lamps and headlights on a surface. The map holds what reaches the ground, so that a wall
// takes what lies before it.
fn lamplight(world: vec3<f32>, normal: vec3<f32>) -> vec3<f32> {
    let at = (world.xy + normal.xy * 1.2) * frame.lamp_place.xy + frame.lamp_place.zw;
    let ground = textureSampleLevel(lamp_map, lamp_sampler, at, 0.0).rgb;
    let height = 1.0 - smoothstep(3.5, 8.5, world.z);
    return ground * (frame.zenith.w * height * (0.62 + 0.38 * normal.z));
}

fn sunlit(world: vec3<f32>, normal: vec3<f32>) -> f32 {
    // Moved along the normal by more than a texel, farther where the sun grazes it, so that a surface
    // does not shade itself.
    let grazing = 1.0 - clamp(dot(normal, frame.to_sun.xyz), 0.0, 1.0);
    let lifted = world + normal * (frame.shadow_texel.y * (1.2 + 2.6 * grazing * grazing));
    let p = frame.shadow_from_world * vec4<f32>(lifted, 1.0);
    let uv = p.xy * vec2<f32>(0.5, -0.5) + 0.5;
    if !soft_shadows {
        return textureSampleCompareLevel(shadow_map, shadow_sampler, uv, p.z);
    }
    let d = frame.shadow_texel.x * 1.1;
    var lit = textureSampleCompareLevel(shadow_map, shadow_sampler, uv + vec2<f32>(-0.4, -1.0) * d, p.z);
    lit += textureSampleCompareLevel(shadow_map, shadow_sampler, uv + vec2<f32>(1.0, -0.4) * d, p.z);
    lit += textureSampleCompareLevel(shadow_map, shadow_sampler, uv + vec2<f32>(0.4, 1.0) * d, p.z);
    lit += textureSampleCompareLevel(shadow_map, shadow_sampler, uv + vec2<f32>(-1.0, 0.4) * d, p.z);
    return lit * 0.25;
}

struct Material {
    albedo: vec3<f32>,
    // 0 dull to 1 mirror-like at grazing angles.
    gloss: f32,
    openness: f32,
}

fn shade(m: Material, world: vec3<f32>, normal: vec3<f32>, to_eye: vec3<f32>) -> vec3<f32> {
    let facing = dot(normal, frame.to_sun.xyz);
    var sun = 0.0;
    if facing > 0.0 {
        sun = facing * sunlit(world, normal);
    }
    let above = mix(frame.ground_light.rgb, frame.sky_light.rgb, normal.z * 0.5 + 0.5);
    var radiance = m.albedo * (frame.sun.rgb * sun + above * m.openness);
    if lamplit {
        radiance += m.albedo * lamplight(world, normal);
    }
    if m.gloss > 0.0 {
        let grazing = 1.0 - clamp(dot(normal, to_eye), 0.0, 1.0);
        let fresnel = m.gloss * (0.06 + 0.94 * pow(grazing, 5.0));
        let mirrored = reflect(-to_eye, normal);
        let glint = pow(clamp(dot(mirrored, frame.to_sun.xyz), 0.0, 1.0), 220.0) * sun * 6.0;
        radiance = mix(radiance, sky_colour(mirrored) * m.openness, fresnel) + frame.sun.rgb * glint * m.gloss;
    }
    return radiance;
}
