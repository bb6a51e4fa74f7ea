// Shadow map of the sun: static city once; at every tick vehicles over patches restored from the static map.

struct City {
    @location(0) position: vec3<f32>,
}

@vertex
fn city_vertex(in: City) -> @builtin(position) vec4<f32> {
    return frame.shadow_from_world * vec4<f32>(in.position, 1.0);
}

// A vehicle or a model of the map: city from body, by rows.
struct Instance {
    @location(0) position: vec3<f32>,
    @location(5) row_x: vec4<f32>,
    @location(6) row_y: vec4<f32>,
    @location(7) row_z: vec4<f32>,
}

@vertex
fn instanced_vertex(in: Instance) -> @builtin(position) vec4<f32> {
    let local = vec4<f32>(in.position, 1.0);
    let world = vec3<f32>(dot(in.row_x, local), dot(in.row_y, local), dot(in.row_z, local));
    return frame.shadow_from_world * vec4<f32>(world, 1.0);
}

@group(1) @binding(0) var static_map: texture_depth_2d;

@vertex
fn restore_vertex(@builtin(vertex_index) corner: u32) -> @builtin(position) vec4<f32> {
    return vec4<f32>(f32(corner & 1u) * 4.0 - 1.0, f32(corner >> 1u) * 4.0 - 1.0, 0.0, 1.0);
}

@fragment
fn restore_fragment(@builtin(position) at: vec4<f32>) -> @builtin(frag_depth) f32 {
    return textureLoad(static_map, vec2<i32>(at.xy), 0);
}
