//! Equally large views side by side in one texture, so that a batch of them is one render pass.

/// A rectangle of a target that a view is drawn to.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tile {
    pub(super) origin: [u32; 2],
    pub(super) extent: [u32; 2],
}

impl Tile {
    /// Has what is drawn from now on fill it.
    pub(super) fn enter(self, pass: &mut wgpu::RenderPass<'_>) {
        let ([x, y], [width, height]) = (self.origin, self.extent);
        pass.set_viewport(x as f32, y as f32, width as f32, height as f32, 0.0, 1.0);
        self.keep_to(pass, height);
    }

    /// Has what is drawn from now on change no more than that many of its rows from the top.
    pub(super) fn keep_to(self, pass: &mut wgpu::RenderPass<'_>, rows: u32) {
        let ([x, y], [width, height]) = (self.origin, self.extent);
        pass.set_scissor_rect(x, y, width, rows.min(height));
    }
}

/// Rows of a copy into a buffer are multiples of this.
const ROW_ALIGNMENT: u32 = wgpu::COPY_BYTES_PER_ROW_ALIGNMENT;

#[derive(Clone, Copy, Debug)]
pub(super) struct Grid {
    pub(super) tile: [u32; 2],
    columns: u32,
    rows: u32,
    /// Of the texture.
    width: u32,
    /// How many views fit.
    pub(super) capacity: usize,
    /// Whether more views would not fit either.
    is_full_size: bool,
}

impl Grid {
    /// Room for `wanted` views, or for as many as the limits on memory and texture size allow, but
    /// for one at least.
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
        let width = if columns > 1 { spread(columns * tile[0]).min(most) } else { tile[0] };
        Self { tile, columns, rows, width, capacity, is_full_size: capacity < wanted }
    }

    /// Whether so many views need no other one.
    pub(super) fn suits(&self, views: usize) -> bool {
        self.capacity >= views || self.is_full_size
    }

    /// Of the texture.
    pub(super) fn size(&self) -> wgpu::Extent3d {
        wgpu::Extent3d { width: self.width, height: self.rows * self.tile[1], depth_or_array_layers: 1 }
    }

    /// Upper left corner of a tile.
    pub(super) fn origin(&self, tile: usize) -> [u32; 2] {
        let k = tile as u32;
        [k % self.columns * self.tile[0], k / self.columns * self.tile[1]]
    }

    pub(super) fn place(&self, tile: usize) -> Tile {
        Tile { origin: self.origin(tile), extent: self.tile }
    }

    /// Copies a tile of a texture of four bytes a texel into a buffer.
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

/// A little wider: where rows begin at multiples of a page of memory, the rows of a block that a software adapter
/// works at fall on the same few lines of the processor's cache. Odd multiples of 256 bytes spread them best
/// (50 pictures of 640x480 of large faces in one texture: 1.52 ms each, so 1.30 ms).
fn spread(width: u32) -> u32 {
    const TEXELS: u32 = 64;
    (width.div_ceil(TEXELS) | 1) * TEXELS
}

/// Bytes of a row of texels of four bytes in a read-back buffer.
pub(super) fn padded_row(width: u32) -> u32 {
    (width * 4).next_multiple_of(ROW_ALIGNMENT)
}

/// Bytes of a picture in a read-back buffer.
pub(super) fn tile_bytes([width, height]: [u32; 2]) -> u64 {
    u64::from(padded_row(width)) * u64::from(height)
}
