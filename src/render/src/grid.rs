//! Tile grid of a texture atlas: views of one size side by side, so that a batch is one render pass.

/// Rectangle of a render target that a view is drawn to, pixels.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tile {
    pub(super) origin: [u32; 2],
    pub(super) extent: [u32; 2],
}

impl Tile {
    /// Sets viewport and scissor rectangle to the tile.
    pub(super) fn set_viewport(self, pass: &mut wgpu::RenderPass<'_>) {
        let ([x, y], [width, height]) = (self.origin, self.extent);
        pass.set_viewport(x as f32, y as f32, width as f32, height as f32, 0.0, 1.0);
        self.set_scissor_rows(pass, height);
    }

    /// Limits the scissor rectangle to the first `rows` rows of the tile.
    pub(super) fn set_scissor_rows(self, pass: &mut wgpu::RenderPass<'_>, rows: u32) {
        let ([x, y], [width, height]) = (self.origin, self.extent);
        pass.set_scissor_rect(x, y, width, rows.min(height));
    }
}

/// Row pitch of a texture-to-buffer copy is a multiple of this many bytes.
const ROW_ALIGNMENT: u32 = wgpu::COPY_BYTES_PER_ROW_ALIGNMENT;

/// Layout of tiles in a texture.
#[derive(Clone, Copy, Debug)]
pub(super) struct TileGrid {
    pub(super) tile: [u32; 2],
    columns: u32,
    rows: u32,
    /// Width of the texture, pixels.
    width: u32,
    /// Number of tiles.
    pub(super) capacity: usize,
    /// Whether memory or texture size allows no more tiles.
    is_full_size: bool,
}

impl TileGrid {
    /// Grid of `wanted` tiles, or of as many as `bytes` of memory and the largest texture size allow; at least one.
    pub(super) fn new(
        device: &wgpu::Device,
        tile: [u32; 2],
        wanted: usize,
        pixel_bytes: u64,
        bytes: u64,
    ) -> Self {
        let most = device.limits().max_texture_dimension_2d;
        let per_view = u64::from(tile[0]) * u64::from(tile[1]) * pixel_bytes;
        let affordable = (bytes / per_view.max(1)).max(1).min(wanted as u64) as u32;
        let (most_columns, most_rows) = (most / tile[0], most / tile[1]);
        let columns = (f64::from(affordable).sqrt().ceil() as u32).clamp(1, most_columns.max(1));
        let rows = affordable.div_ceil(columns).clamp(1, most_rows.max(1));
        let capacity = (columns * rows).min(affordable) as usize;
        let width = if columns > 1 { cache_friendly_width(columns * tile[0]).min(most) } else { tile[0] };
        Self { tile, columns, rows, width, capacity, is_full_size: capacity < wanted }
    }

    /// Whether the grid serves a batch of this many views: it has a tile for each, or cannot grow.
    pub(super) fn fits(&self, views: usize) -> bool {
        self.capacity >= views || self.is_full_size
    }

    /// Size of the texture.
    pub(super) fn size(&self) -> wgpu::Extent3d {
        wgpu::Extent3d { width: self.width, height: self.rows * self.tile[1], depth_or_array_layers: 1 }
    }

    /// Upper left corner of a tile.
    pub(super) fn origin(&self, tile: usize) -> [u32; 2] {
        let k = tile as u32;
        [k % self.columns * self.tile[0], k / self.columns * self.tile[1]]
    }

    pub(super) fn tile_rect(&self, tile: usize) -> Tile {
        Tile { origin: self.origin(tile), extent: self.tile }
    }

    /// Records the copy of a tile of a texture, four bytes a texel, into a staging buffer.
    pub(super) fn copy_tile(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        (texture, tile): (&wgpu::Texture, usize),
        (buffer, offset): (&wgpu::Buffer, u64),
    ) {
        let [x, y] = self.origin(tile);
        let [width, height] = self.tile;
        encoder.copy_texture_to_buffer(
            wgpu::TexelCopyTextureInfo {
                texture,
                mip_level: 0,
                origin: wgpu::Origin3d { x, y, z: 0 },
                aspect: wgpu::TextureAspect::All,
            },
            wgpu::TexelCopyBufferInfo {
                buffer,
                layout: wgpu::TexelCopyBufferLayout {
                    offset,
                    bytes_per_row: Some(padded_row(width)),
                    rows_per_image: Some(height),
                },
            },
            wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        );
    }
}

/// Pads the width of a texture against conflict misses in the cache. Rows that begin at multiples of a memory page map
/// to the same cache sets, and a software adapter works on several rows at once. Odd multiples of 256 bytes are best
/// (50 pictures of 640x480 of large faces in one texture: 1.30 ms each instead of 1.52 ms).
fn cache_friendly_width(width: u32) -> u32 {
    const TEXELS: u32 = 64;
    (width.div_ceil(TEXELS) | 1) * TEXELS
}

/// Row pitch in a staging buffer, bytes, at four bytes a texel.
pub(super) fn padded_row(width: u32) -> u32 {
    (width * 4).next_multiple_of(ROW_ALIGNMENT)
}

/// Bytes of a picture in a staging buffer.
pub(super) fn tile_bytes([width, height]: [u32; 2]) -> u64 {
    u64::from(padded_row(width)) * u64::from(height)
}
