// Positions and normals of surfaces from the depth buffer, in the camera frame: x right, y down, z forward, metres.

// Homogeneous position in the camera frame of a pixel at a depth.
fn position_of(pixel: vec2<i32>, depth: f32) -> vec4<f32> {
    let at = (vec2<f32>(pixel) + 0.5) / view.extent.xy;
    return view.camera_from_clip * vec4<f32>(at.x * 2.0 - 1.0, 1.0 - at.y * 2.0, depth, 1.0);
}

// Tangents of half the field of view.
fn half_field() -> vec2<f32> {
    return vec2<f32>(length(view.camera_from_clip[0].xyz), length(view.camera_from_clip[1].xyz));
}

// Pixel of a point before the camera.
fn pixel_of(point: vec3<f32>) -> vec2<f32> {
    // The optical axis is not in the middle of a picture that is shifted for the mean of several.
    let middle = view.camera_from_clip[3].xy / view.camera_from_clip[3].z;
    return ((point.xy / point.z - middle) / half_field() * 0.5 + 0.5) * view.extent.xy;
}

struct SurfacePoint {
    depth: f32,
    position: vec3<f32>,
}

fn surface_at(place: TilePixel, pixel: vec2<i32>) -> SurfacePoint {
    let depth = depth_at(texel_of(place, pixel));
    let p = position_of(pixel, depth);
    return SurfacePoint(depth, p.xyz / p.w);
}

// Tangent of the surface at `here` along one axis of the picture, from the neighbour that continues the surface: depths
// of a plane are linear in pixels.
fn along(place: TilePixel, here: SurfacePoint, axis: vec2<i32>) -> vec3<f32> {
    let before = surface_at(place, place.pixel - axis);
    let after = surface_at(place, place.pixel + axis);
    let beyond_before = depth_at(texel_of(place, place.pixel - 2 * axis));
    let beyond_after = depth_at(texel_of(place, place.pixel + 2 * axis));
    let bend_before = abs(2.0 * before.depth - beyond_before - here.depth);
    let bend_after = abs(2.0 * after.depth - beyond_after - here.depth);
    return select(after.position - here.position, here.position - before.position, bend_before < bend_after);
}

// Unit normal of the surface at a pixel, towards the eye.
fn normal_at(place: TilePixel, here: SurfacePoint) -> vec3<f32> {
    let x = along(place, here, vec2<i32>(1, 0));
    let y = along(place, here, vec2<i32>(0, 1));
    return normalize(cross(y, x));
}
