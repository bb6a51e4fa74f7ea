// Light worked out at the vertices, for adapters on which a fragment is dear: what is left for fragments is
// the texture, the shadow and the display curve.

struct Swift {
    @builtin(position) clip: vec4<f32>,
    // Light of the sky and of lamps that reaches the eye.
    @location(0) ambient: vec3<f32>,
    // Light of the sun where nothing stands in its way.
    @location(1) sunlight: vec3<f32>,
    // Place in the shadow map, and the haze in front.
    @location(2) shadow: vec4<f32>,
    @location(3) uv: vec2<f32>,
    @location(4) @interpolate(flat) layer: u32,
}

// Light at a vertex; the albedo goes into it, so that a texture only has to be multiplied.
fn swift_light(m: Material, world: vec3<f32>, normal: vec3<f32>, glow: vec3<f32>) -> Swift {
    var out: Swift;
    out.clip = view.clip_from_world * vec4<f32>(world, 1.0);
    let from_eye = world - view.eye.xyz;
    let distance = length(from_eye);
    let to_eye = -from_eye / max(distance, 1e-4);
    let depth = distance * frame.haze.w;
    let clear = exp(-depth * sqrt(depth));

    let facing = max(dot(normal, frame.to_sun.xyz), 0.0);
    let above = mix(frame.ground_light.rgb, frame.sky_light.rgb, normal.z * 0.5 + 0.5);
    var ambient = m.albedo * above * m.openness;
    var sunlight = m.albedo * frame.sun.rgb * facing;
    if m.gloss > 0.0 {
        let grazing = 1.0 - clamp(dot(normal, to_eye), 0.0, 1.0);
        let squared = grazing * grazing;
        let fresnel = m.gloss * (0.06 + 0.94 * squared * squared * grazing);
        let mirrored = reflect(-to_eye, normal);
        ambient = mix(ambient, sky_colour(mirrored) * m.openness, fresnel);
        sunlight *= 1.0 - fresnel;
    }
    if lamplit {
        // The moon's shadows are too faint to be worth a lookup; the ground takes the light of lamps at
        // each pixel instead, what rises from it at its vertices.
        let is_ground = normal.z > 0.9 && world.z < 0.4;
        let lamps = select(m.albedo * lamplight(world, normal), vec3<f32>(0.0), is_ground);
        out.ambient = (ambient + sunlight * 0.6 + lamps + glow) * clear;
        out.sunlight = select(vec3<f32>(0.0), m.albedo * frame.zenith.w, is_ground) * clear;
        out.shadow = vec4<f32>(world.xy * frame.lamp_place.xy + frame.lamp_place.zw, 0.0, 1.0 - clear);
        return out;
    }
    out.ambient = (ambient + glow) * clear;
    out.sunlight = sunlight * clear;
    let grazing_sun = 1.0 - facing;
    let lifted = world + normal * (frame.shadow_texel.y * (1.2 + 2.6 * grazing_sun * grazing_sun));
    let p = frame.shadow_from_world * vec4<f32>(lifted, 1.0);
    out.shadow = vec4<f32>(p.xy * vec2<f32>(0.5, -0.5) + 0.5, p.z, 1.0 - clear);
    return out;
}

// The display curve of `display` and the encoding as sRGB in one: a fit that stays within 1.1 of 255 steps.
fn swift_display(radiance: vec3<f32>) -> vec4<f32> {
    let x = radiance * frame.sun.w;
    return vec4<f32>((x * (39.6325 * x + 5.47721) - 0.0041037) / (x * (38.79629 * x + 10.05597) + 1.0), 1.0);
}

fn swift_shade(in: Swift, pattern: vec3<f32>) -> vec4<f32> {
    if lamplit {
        let lamps = textureSampleLevel(lamp_map, lamp_sampler, in.shadow.xy, 0.0).rgb;
        return swift_display(pattern * (in.ambient + in.sunlight * lamps) + frame.haze.rgb * in.shadow.w);
    }
    let lit = textureSampleCompareLevel(shadow_map, shadow_sampler, in.shadow.xy, in.shadow.z);
    return swift_display(pattern * (in.ambient + in.sunlight * lit) + frame.haze.rgb * in.shadow.w);
}
