// A triangle over the whole tile of a view, and where in it a fragment is. Passes over tiles look at their own
// tile alone, and what they draw from positions they draw from those in the tile: a view looks the same
// wherever it lies in the atlas.

struct Tile {
    @builtin(position) clip: vec4<f32>,
    // From the upper left corner of the tile, 0 to 1.
    @location(0) part: vec2<f32>,
}

@vertex
fn tile_vertex(@builtin(vertex_index) corner: u32) -> Tile {
    let part = vec2<f32>(f32(corner & 1u), f32(corner >> 1u)) * 2.0;
    return Tile(vec4<f32>(part.x * 2.0 - 1.0, 1.0 - part.y * 2.0, 0.0, 1.0), part);
}

struct Place {
    // Pixels from the corner of the tile.
    pixel: vec2<i32>,
    // The tile's corner in the atlas.
    origin: vec2<i32>,
    // The last pixel of the tile.
    last: vec2<i32>,
}

fn place_of(in: Tile) -> Place {
    let pixel = vec2<i32>(in.part * view.extent.xy);
    return Place(pixel, vec2<i32>(in.clip.xy) - pixel, vec2<i32>(view.extent.xy) - 1);
}

// The texel of the atlas for a pixel of the tile, the nearest one in it for those beyond its edges.
fn texel_of(place: Place, pixel: vec2<i32>) -> vec2<i32> {
    return place.origin + clamp(pixel, vec2<i32>(0), place.last);
}
