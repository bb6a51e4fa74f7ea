// Vertex lighting (Gouraud shading), for adapters on which a fragment is expensive: a fragment only applies texture,
// shadow and tone mapping.

// Names in capitals are members of `Frame`, injected as constants in front of this text: Mesa's software adapter
// reads a uniform lane by lane.

// Interpolated light, times the exposure.
struct VertexLit {
    @builtin(position) clip: vec4<f32>,
    // Ambient light and light of lamps that reach the eye; w: fog in front.
    @location(0) ambient: vec4<f32>,
    // Unshadowed light of the sun, or at night the factor on the light map of lamps; w: depth in the shadow map.
    @location(1) direct: vec4<f32>,
    // Texture coordinates: xy in the shadow map or the light map of lamps, zw in the material's texture.
    @location(2) uv: vec4<f32>,
    // Layer of the texture array in the lowest byte; at night the seed of the wall above it.
    @location(3) @interpolate(flat) layer: u32,
}

// Light at a vertex times the albedo, so that the fragment only multiplies by the texture.
fn light_vertex(m: Material, world: vec3<f32>, normal: vec3<f32>, glow: vec3<f32>) -> VertexLit {
    var out: VertexLit;
    out.clip = view.clip_from_world * vec4<f32>(world, 1.0);
    let from_eye = world - view.eye.xyz;
    let distance = length(from_eye);
    let to_eye = -from_eye / max(distance, 1e-4);
    let clear = fog_transmittance(from_eye, view.eye.z, HAZE.w);
    let reaching = clear * SUN.w;

    let facing = max(dot(normal, TO_SUN), 0.0);
    let above = mix(GROUND_LIGHT.rgb, SKY_LIGHT.rgb, normal.z * 0.5 + 0.5);
    var ambient = m.albedo * above * m.openness;
    var sunlight = m.albedo * SUN.rgb * facing;
    if m.gloss > 0.0 {
        let grazing = 1.0 - clamp(dot(normal, to_eye), 0.0, 1.0);
        let squared = grazing * grazing;
        // Weaker than per pixel: a vertex spreads over a face what a pixel shows on a narrow edge.
        let fresnel = m.gloss * (0.06 + 0.5 * squared * squared * grazing);
        let reflected = reflect(-to_eye, normal);
        // Sky above the roofs, colour of the street below them.
        let open = smoothstep(0.02, 0.36, reflected.z);
        let sky = sky_gradient(reflected, HAZE.rgb, ZENITH.rgb, GROUND_LIGHT.rgb);
        ambient = mix(ambient, mix(GROUND_LIGHT.rgb * 0.7, sky, open) * m.openness, fresnel);
        sunlight *= 1.0 - fresnel;
    }
    if lamplit {
        // Shadows of the moon are too faint for a lookup. The ground reads the light map at each pixel instead, objects
        // at their vertices.
        let is_ground = normal.z > 0.9 && world.z < 0.4;
        let lamps = select(m.albedo * lamplight(world, normal), vec3<f32>(0.0), is_ground);
        out.ambient = vec4<f32>((ambient + sunlight * 0.6 + lamps + glow) * reaching, 1.0 - clear);
        let burning = select(vec3<f32>(0.0), m.albedo * ZENITH.w, is_ground);
        out.direct = vec4<f32>(burning * reaching, 0.0);
        out.uv = vec4<f32>(world.xy * LAMP_UV_FROM_WORLD.xy + LAMP_UV_FROM_WORLD.zw, 0.0, 0.0);
        return out;
    }
    let grazing_sun = 1.0 - facing;
    let lifted = world + normal * (SHADOW_TEXEL.y * (1.2 + 2.6 * grazing_sun * grazing_sun));
    let p = SHADOW_FROM_WORLD * vec4<f32>(lifted, 1.0);
    out.ambient = vec4<f32>((ambient + glow) * reaching, 1.0 - clear);
    out.direct = vec4<f32>(sunlight * reaching, p.z);
    out.uv = vec4<f32>(p.xy * vec2<f32>(0.5, -0.5) + 0.5, 0.0, 0.0);
    return out;
}

// Tone mapping and sRGB encoding of `display.wgsl` in one rational fit, within 1.1 of 255 steps.
fn tone_map_and_encode(x: vec3<f32>) -> vec4<f32> {
    return vec4<f32>((x * (39.6325 * x + 5.47721) - 0.0041037) / (x * (38.79629 * x + 10.05597) + 1.0), 1.0);
}

// Displayed colour of a surface: texture, share `lit` of the direct light, emission, fog.
fn vertex_lit_color(in: VertexLit, pattern: vec3<f32>, lit: vec3<f32>, glow: vec3<f32>) -> vec4<f32> {
    let haze = HAZE.rgb * (SUN.w * in.ambient.w);
    return tone_map_and_encode(pattern * (in.ambient.rgb + in.direct.rgb * lit) + glow + haze);
}

// Displayed colour with the lookup of shadow map or light map; `glow` is emission times exposure and transmittance.
fn vertex_lit_shade(in: VertexLit, pattern: vec3<f32>, glow: vec3<f32>) -> vec4<f32> {
    if lamplit {
        return vertex_lit_color(in, pattern, textureSampleLevel(lamp_map, lamp_sampler, in.uv.xy, 0.0).rgb, glow);
    }
    let lit = textureSampleCompareLevel(shadow_map, shadow_sampler, in.uv.xy, in.direct.w);
    return vertex_lit_color(in, pattern, vec3<f32>(lit), glow);
}

// Fully vertex-lit surface: no texture, shadow looked up at the vertices.
struct Untextured {
    @builtin(position) clip: vec4<f32>,
    // Displayed colour.
    @location(0) colour: vec3<f32>,
}

// Flat shading: the corners of a face have the same colour, so nothing is interpolated.
struct Flat {
    @builtin(position) clip: vec4<f32>,
    @location(0) @interpolate(flat) colour: vec3<f32>,
}

// Shadow map lookup at a vertex: the nearest texel alone, for what is interpolated over a face.
fn vertex_visibility(light: VertexLit) -> f32 {
    let texels = vec2<i32>(textureDimensions(shadow_map));
    let at = clamp(vec2<i32>(light.uv.xy * vec2<f32>(texels)), vec2<i32>(0), texels - 1);
    return select(0.0, 1.0, light.direct.w <= textureLoad(shadow_map, at, 0));
}

fn light_untextured(m: Material, world: vec3<f32>, normal: vec3<f32>, glow: vec3<f32>) -> Untextured {
    if flat_light {
        let light = SKY_LIGHT.rgb + SUN.rgb * max(dot(normal, TO_SUN), 0.0);
        return Untextured(view.clip_from_world * vec4<f32>(world, 1.0), m.albedo * light);
    }
    let light = light_vertex(m, world, normal, glow);
    var colour: vec3<f32>;
    if lamplit {
        colour = vertex_lit_shade(light, vec3<f32>(1.0), vec3<f32>(0.0)).rgb;
    } else {
        let lit = vec3<f32>(vertex_visibility(light));
        colour = vertex_lit_color(light, vec3<f32>(1.0), lit, vec3<f32>(0.0)).rgb;
    }
    return Untextured(light.clip, colour);
}

@fragment
fn untextured_fragment(in: Untextured) -> @location(0) vec4<f32> {
    return vec4<f32>(in.colour, 1.0);
}

@fragment
fn flat_fragment(in: Flat) -> @location(0) vec4<f32> {
    return vec4<f32>(in.colour, 1.0);
}
