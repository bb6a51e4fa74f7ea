// Light worked out at the vertices, for adapters on which a fragment is dear: what is left for fragments is
// the texture, the shadow and the display curve.

// What is in capitals are members of `Frame` as constants that stand before this text: Mesa's software adapter
// reads a uniform lane by lane.

// All light is exposed at the vertices.
struct Swift {
    @builtin(position) clip: vec4<f32>,
    // Light of the sky and of lamps that reaches the eye; w: the haze in front.
    @location(0) ambient: vec4<f32>,
    // Light of the sun where nothing stands in its way, or of lamps where the map has them; w: depth in the
    // shadow map.
    @location(1) direct: vec4<f32>,
    // Place in the shadow map or that of lamps, and on the texture.
    @location(2) places: vec4<f32>,
    // Of the texture; by night what its walls are told apart by is above the lowest eight bits.
    @location(3) @interpolate(flat) layer: u32,
}

// Light at a vertex; the albedo goes into it, so that a texture only has to be multiplied.
fn swift_light(m: Material, world: vec3<f32>, normal: vec3<f32>, glow: vec3<f32>) -> Swift {
    var out: Swift;
    out.clip = view.clip_from_world * vec4<f32>(world, 1.0);
    let from_eye = world - view.eye.xyz;
    let distance = length(from_eye);
    let to_eye = -from_eye / max(distance, 1e-4);
    let clear = clearness(from_eye, view.eye.z, HAZE.w);
    let reaching = clear * SUN.w;

    let facing = max(dot(normal, TO_SUN), 0.0);
    let above = mix(GROUND_LIGHT.rgb, SKY_LIGHT.rgb, normal.z * 0.5 + 0.5);
    var ambient = m.albedo * above * m.openness;
    var sunlight = m.albedo * SUN.rgb * facing;
    if m.gloss > 0.0 {
        let grazing = 1.0 - clamp(dot(normal, to_eye), 0.0, 1.0);
        let squared = grazing * grazing;
        // Of a whole face, where a pixel has it on a narrow edge.
        let fresnel = m.gloss * (0.06 + 0.5 * squared * squared * grazing);
        let mirrored = reflect(-to_eye, normal);
        // Over the roofs of the streets the sky, below it what stands and lies there.
        let open = smoothstep(0.02, 0.36, mirrored.z);
        let sky = sky_between(mirrored, HAZE.rgb, ZENITH.rgb, GROUND_LIGHT.rgb);
        ambient = mix(ambient, mix(GROUND_LIGHT.rgb * 0.7, sky, open) * m.openness, fresnel);
        sunlight *= 1.0 - fresnel;
    }
    if lamplit {
        // The moon's shadows are too faint to be worth a lookup; the ground takes the light of lamps at
        // each pixel instead, what rises from it at its vertices.
        let is_ground = normal.z > 0.9 && world.z < 0.4;
        let lamps = select(m.albedo * lamplight(world, normal), vec3<f32>(0.0), is_ground);
        out.ambient = vec4<f32>((ambient + sunlight * 0.6 + lamps + glow) * reaching, 1.0 - clear);
        let burning = select(vec3<f32>(0.0), m.albedo * ZENITH.w, is_ground);
        out.direct = vec4<f32>(burning * reaching, 0.0);
        out.places = vec4<f32>(world.xy * LAMP_PLACE.xy + LAMP_PLACE.zw, 0.0, 0.0);
        return out;
    }
    let grazing_sun = 1.0 - facing;
    let lifted = world + normal * (SHADOW_TEXEL.y * (1.2 + 2.6 * grazing_sun * grazing_sun));
    let p = SHADOW_FROM_WORLD * vec4<f32>(lifted, 1.0);
    out.ambient = vec4<f32>((ambient + glow) * reaching, 1.0 - clear);
    out.direct = vec4<f32>(sunlight * reaching, p.z);
    out.places = vec4<f32>(p.xy * vec2<f32>(0.5, -0.5) + 0.5, 0.0, 0.0);
    return out;
}

// The display curve of `display` and the encoding as sRGB in one: a fit that stays within 1.1 of 255 steps.
fn swift_display(x: vec3<f32>) -> vec4<f32> {
    return vec4<f32>((x * (39.6325 * x + 5.47721) - 0.0041037) / (x * (38.79629 * x + 10.05597) + 1.0), 1.0);
}

// The colour of a surface with a pattern and that much of the direct light.
fn swift_seen(in: Swift, pattern: vec3<f32>, lit: vec3<f32>, glow: vec3<f32>) -> vec4<f32> {
    let haze = HAZE.rgb * (SUN.w * in.ambient.w);
    return swift_display(pattern * (in.ambient.rgb + in.direct.rgb * lit) + glow + haze);
}

// With light of the surface's own, exposed as it reaches the eye.
fn swift_shade(in: Swift, pattern: vec3<f32>, glow: vec3<f32>) -> vec4<f32> {
    if lamplit {
        return swift_seen(in, pattern, textureSampleLevel(lamp_map, lamp_sampler, in.places.xy, 0.0).rgb, glow);
    }
    let lit = textureSampleCompareLevel(shadow_map, shadow_sampler, in.places.xy, in.direct.w);
    return swift_seen(in, pattern, vec3<f32>(lit), glow);
}

// What is lit at its vertices for good: without texture, its shadow looked up at the vertices.
struct Plain {
    @builtin(position) clip: vec4<f32>,
    // As it is shown.
    @location(0) colour: vec3<f32>,
}

// In flat light the corners of a face are alike: nothing to interpolate.
struct Flat {
    @builtin(position) clip: vec4<f32>,
    @location(0) @interpolate(flat) colour: vec3<f32>,
}

fn plain_light(m: Material, world: vec3<f32>, normal: vec3<f32>, glow: vec3<f32>) -> Plain {
    if flat_light {
        let light = SKY_LIGHT.rgb + SUN.rgb * max(dot(normal, TO_SUN), 0.0);
        return Plain(view.clip_from_world * vec4<f32>(world, 1.0), m.albedo * light);
    }
    let light = swift_light(m, world, normal, glow);
    return Plain(light.clip, swift_shade(light, vec3<f32>(1.0), vec3<f32>(0.0)).rgb);
}

@fragment
fn plain_fragment(in: Plain) -> @location(0) vec4<f32> {
    return vec4<f32>(in.colour, 1.0);
}

@fragment
fn flat_fragment(in: Flat) -> @location(0) vec4<f32> {
    return vec4<f32>(in.colour, 1.0);
}
