// Full-screen triangle over the tile of a view, and the pixel of a fragment in it. Post-processing reads its own tile
// alone and computes from positions in the tile, so that a view looks the same wherever it lies in the atlas.

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

struct TilePixel {
    // Pixel, from the upper left corner of the tile.
    pixel: vec2<i32>,
    // The tile's corner in the atlas.
    origin: vec2<i32>,
    // The last pixel of the tile.
    last: vec2<i32>,
}

fn tile_pixel(in: Tile) -> TilePixel {
    let pixel = vec2<i32>(in.part * view.extent.xy);
    return TilePixel(pixel, vec2<i32>(in.clip.xy) - pixel, vec2<i32>(view.extent.xy) - 1);
}

// Texel of the atlas for a pixel of the tile, clamped to the edges of the tile.
fn texel_of(place: TilePixel, pixel: vec2<i32>) -> vec2<i32> {
    return place.origin + clamp(pixel, vec2<i32>(0), place.last);
}
