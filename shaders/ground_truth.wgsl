// Ground truth of each pixel: depth, semantic class and vehicle (instance), without light.

struct View {
    clip_from_world: mat4x4<f32>,
    // Dot product with (x, y, z, 1): metres along the optical axis.
    depth_from_world: vec4<f32>,
}

@group(0) @binding(0) var<uniform> view: View;

// Semantic class of vehicles.
override vehicle_class: u32 = 0u;

struct Fragment {
    @builtin(position) clip: vec4<f32>,
    @location(0) depth: f32,
    // Semantic class, vehicle number.
    @location(1) @interpolate(flat) labels: vec2<u32>,
}

struct Pixel {
    @location(0) depth: f32,
    @location(1) labels: vec2<u32>,
}

fn project(world: vec3<f32>, labels: vec2<u32>) -> Fragment {
    var out: Fragment;
    out.clip = view.clip_from_world * vec4<f32>(world, 1.0);
    out.depth = dot(view.depth_from_world, vec4<f32>(world, 1.0));
    out.labels = labels;
    return out;
}

// Labels of a vertex of the static city; vehicle 0 stands for none.
fn labels_of(material: u32) -> vec2<u32> {
    return vec2<u32>((material >> 8u) & 0xffu, 0u);
}

@vertex
fn city_main(@location(0) position: vec3<f32>, @location(4) material: u32) -> Fragment {
    return project(position, labels_of(material));
}

@vertex
fn instanced_main(
    @location(0) position: vec3<f32>,
    @location(4) material: u32,
    // City from model, by rows.
    @location(5) row_x: vec4<f32>,
    @location(6) row_y: vec4<f32>,
    @location(7) row_z: vec4<f32>,
) -> Fragment {
    let local = vec4<f32>(position, 1.0);
    let world = vec3<f32>(dot(row_x, local), dot(row_y, local), dot(row_z, local));
    return project(world, labels_of(material));
}

// A surface of which a part is left out, by its texture coordinates.
struct PartFragment {
    @builtin(position) clip: vec4<f32>,
    @location(0) depth: f32,
    @location(1) @interpolate(flat) labels: vec2<u32>,
    @location(2) uv: vec2<f32>,
}

@vertex
fn part_main(@location(0) position: vec3<f32>, @location(3) uv: vec2<f32>, @location(4) material: u32) -> PartFragment {
    let whole = project(position, labels_of(material));
    return PartFragment(whole.clip, whole.depth, whole.labels, uv);
}

// What is between the leaves of a spray is not there, nor what is inside of a crown that the camera is in.
@fragment
fn leaf_fragment(in: PartFragment) -> Pixel {
    let pixel = pixel_in_sprays(dpdx(in.uv), dpdy(in.uv));
    let is_gap = is_spray(in.uv) && spray_leaf(in.uv, pixel).cover < 0.5;
    if is_gap || inside_cover(in.uv, in.depth) < 0.5 {
        discard;
    }
    return Pixel(in.depth, in.labels);
}

// The mesh of a line is wider than its paint, for anti-aliasing; outside the paint the road below counts. Its coordinates are
// the distance from the centre line and half the width, metres.
@fragment
fn line_fragment(in: PartFragment) -> Pixel {
    if abs(in.uv.x) > in.uv.y {
        discard;
    }
    return Pixel(in.depth, in.labels);
}

struct VehicleIn {
    @location(0) position: vec3<f32>,
    // City from body, by rows.
    @location(5) row_x: vec4<f32>,
    @location(6) row_y: vec4<f32>,
    @location(7) row_z: vec4<f32>,
    // w: number of the vehicle.
    @location(8) paint: vec4<f32>,
}

@vertex
fn vehicle_main(in: VehicleIn) -> Fragment {
    let local = vec4<f32>(in.position, 1.0);
    let world = vec3<f32>(dot(in.row_x, local), dot(in.row_y, local), dot(in.row_z, local));
    return project(world, vec2<u32>(vehicle_class, u32(in.paint.w)));
}

@fragment
fn fragment_main(in: Fragment) -> Pixel {
    return Pixel(in.depth, in.labels);
}
