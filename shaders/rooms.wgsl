// Rooms behind windows: interior mapping (van Dongen 2008, Interior mapping: a new technique for rendering realistic
// buildings). A ray from the eye goes on behind the pane until it meets a wall, the floor or the ceiling of a room that
// is as high as a storey.

// Width of rooms, in bays: the window is in their middle.
const ROOM_BAYS: f32 = 2.0;
// Depth of rooms, and of shop windows up to their goods, metres.
const ROOM_M: f32 = 3.4;
const DISPLAY_M: f32 = 0.55;
// Size of a pixel in bays between which rooms fade to the texture.
const ROOM_FADE: vec2<f32> = vec2<f32>(0.015, 0.05);
// Albedo of a wall at the pane: what daylight there is in a room leaves little of it.
const ROOM_ALBEDO: f32 = 0.20;

// Colours of walls, relative to one another.
const ROOM_WALLS: array<vec3<f32>, 4> = array<vec3<f32>, 4>(
    vec3<f32>(1.0, 0.94, 0.82), vec3<f32>(0.86, 0.95, 0.92), vec3<f32>(1.0, 0.84, 0.72), vec3<f32>(0.92, 0.92, 0.96),
);

// The ray behind a pane: bays, storeys and metres a metre, the last into the room; zero where the wall gives none.
fn ray_behind(normal: vec3<f32>, ahead: vec3<f32>, edges: array<vec3<f32>, 2>, uv_dx: vec4<f32>) -> vec3<f32> {
    let along = normalize(vec3<f32>(-normal.y, normal.x, 1e-6));
    let right = vec2<f32>(dot(edges[0], along), edges[0].z);
    let down = vec2<f32>(dot(edges[1], along), edges[1].z);
    let det = right.x * down.y - right.y * down.x;
    if abs(det) < 1e-10 {
        return vec3<f32>(0.0);
    }
    let bays = (uv_dx.x * down.y - uv_dx.z * right.y) / det;
    let storeys = (uv_dx.w * right.x - uv_dx.y * down.x) / det;
    return vec3<f32>(bays * dot(ahead, along), storeys * ahead.z, -dot(ahead, normal));
}

// What is seen of a room, relative to its walls; alpha: how far into the room, metres.
fn room_seen(uv: vec2<f32>, seed: u32, ray: vec3<f32>) -> vec4<f32> {
    let dice = cell_dice(vec2<i32>(floor(uv)), seed + 71u);
    let more = cell_dice(vec2<i32>(floor(uv)), seed + 331u);
    let place = vec2<f32>((fract(uv.x) - 0.5) / ROOM_BAYS + 0.5, fract(uv.y));
    let along = ray / vec3<f32>(ROOM_BAYS, 1.0, 1.0);
    let way = select(vec3<f32>(1e-4), along, abs(along) > vec3<f32>(1e-4));
    // Distances to the side wall, to floor or ceiling, and to the back wall.
    let sides = (select(vec2<f32>(0.0), vec2<f32>(1.0), way.xy > vec2<f32>(0.0)) - place) / way.xy;
    let depth = ROOM_M * (0.75 + 0.5 * dice.y);
    let back = depth / max(way.z, 1e-3);
    let far = min(min(sides.x, sides.y), back);
    let hit = vec3<f32>(place + way.xy * far, way.z * far);
    let wall = ROOM_WALLS[u32(dice.x * 3.99)];
    // A side wall, with a door or a cupboard on it.
    let part = hit.z / depth - 0.30 - 0.3 * more.y;
    let is_door = part > 0.0 && part < 0.30 && hit.y < 0.72;
    var colour = select(wall * 0.72, vec3<f32>(0.30, 0.20, 0.12) * (0.7 + 1.6 * more.x), is_door);
    if far == sides.y {
        // A ceiling with a lamp, or a floor with a rug.
        let off = abs(hit.xz - vec2<f32>(0.5, 0.5 * depth));
        if way.y > 0.0 {
            colour = select(vec3<f32>(1.15, 1.12, 1.05), vec3<f32>(2.2, 2.0, 1.6), off.x < 0.07 && off.y < 0.30);
        } else {
            let is_rug = off.x < 0.25 && off.y < 0.28 * depth;
            let rug = mix(vec3<f32>(0.5, 0.16, 0.12), vec3<f32>(0.2, 0.26, 0.4), more.z);
            colour = select(vec3<f32>(0.50, 0.36, 0.24), rug, is_rug);
        }
    } else if far == back {
        colour = wall;
        // A shelf or a wardrobe, and a picture.
        let at = hit.xy - vec2<f32>(0.12 + 0.5 * more.x, 0.0);
        let is_shelf = at.x > 0.0 && at.x < 0.20 + 0.2 * more.y && at.y < 0.30 + 0.35 * dice.z;
        let framed = abs(hit.xy - vec2<f32>(0.25 + 0.5 * more.z, 0.60));
        let is_picture = framed.x < 0.06 && framed.y < 0.08;
        if is_shelf {
            let board = step(0.82, fract(at.y * 11.0));
            let books = fract(floor(at.x * 70.0) * 0.618 + floor(at.y * 11.0) * 0.37);
            let row = mix(vec3<f32>(0.42, 0.20, 0.14), vec3<f32>(0.20, 0.28, 0.36), books);
            colour = mix(row, vec3<f32>(0.34, 0.24, 0.15), board);
        } else if is_picture {
            colour = mix(vec3<f32>(0.30, 0.42, 0.50), vec3<f32>(0.62, 0.48, 0.26), dice.z);
        }
    }
    // Corners are darker: of three walls that meet the ray is on one, and near the second nearest.
    let near = vec3<f32>(min(hit.xy, 1.0 - hit.xy) * vec2<f32>(6.0, 3.0), depth - hit.z);
    let corner = max(min(near.x, near.y), min(max(near.x, near.y), near.z));
    return vec4<f32>(colour * (0.62 + 0.38 * smoothstep(0.0, 0.7, corner)), hit.z);
}

// Texture of a shop window as if its goods stood behind the pane; beyond the window's edges the shop is dark.
fn goods_behind(texel: vec4<f32>, layer: u32, uv: vec2<f32>, ray: vec3<f32>, uv_dx: vec4<f32>) -> vec4<f32> {
    let bay = floor(uv);
    let at = fract(uv) + ray.xy * (DISPLAY_M / max(ray.z, 0.12));
    let inside = clamp(at, vec2<f32>(0.07, 0.155), vec2<f32>(0.93, 0.79));
    // Where the texture has bars, what is beside them goes on.
    let bars = abs(inside - vec2<f32>(0.5, 0.66));
    let moved = inside + select(vec2<f32>(0.0), vec2<f32>(0.022, 0.018), bars < vec2<f32>(0.016, 0.013));
    let goods = textureSampleGrad(surfaces, surface_sampler, bay + moved, layer, uv_dx.xy, uv_dx.zw);
    let beyond = length((at - inside) * vec2<f32>(3.0, 2.0));
    return vec4<f32>(goods.rgb * (1.0 - 0.75 * smoothstep(0.0, 0.35, beyond)), texel.a);
}
