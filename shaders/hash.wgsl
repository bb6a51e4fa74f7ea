// Three numbers from 0 to 1 for a cell: pcg3d (Jarzynski and Olano 2020, Hash Functions for GPU Rendering).
fn cell_dice(cell: vec2<i32>, salt: u32) -> vec3<f32> {
    var v = vec3<u32>(bitcast<vec2<u32>>(cell), salt) * 1664525u + 1013904223u;
    v += v.yzx * v.zxy;
    v = v ^ (v >> vec3<u32>(16u));
    v += v.yzx * v.zxy;
    return vec3<f32>(v >> vec3<u32>(8u)) / 16777216.0;
}
