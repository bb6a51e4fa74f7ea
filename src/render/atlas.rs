//! Where batches of equally large views are drawn: tiles of one texture, so that a batch is one
//! render pass, and the buffers through which they come back.

use super::passes::{Attachments, DEPTH};

/// Rows of a copy into a buffer are multiples of this.
const ROW_ALIGNMENT: u32 = wgpu::COPY_BYTES_PER_ROW_ALIGNMENT;

#[derive(Debug)]
pub(super) struct Atlas {
    pub(super) tile: [u32; 2],
    columns: u32,
    /// How many views fit.
    pub(super) capacity: usize,
    /// Whether more views would not fit either.
    pub(super) is_full_size: bool,
    pub(super) color: wgpu::Texture,
    pub(super) color_view: wgpu::TextureView,
    /// What is drawn to where several samples make a pixel.
    pub(super) samples_view: Option<wgpu::TextureView>,
    pub(super) depth_view: wgpu::TextureView,
}

impl Atlas {
    /// Room for `wanted` views, or for as many as the limits on memory and texture size allow, but
    /// for one at least.
    pub(super) fn new(
        device: &wgpu::Device,
        tile: [u32; 2],
        wanted: usize,
        attachments: Attachments,
        bytes: u64,
    ) -> Self {
        let most = device.limits().max_texture_dimension_2d;
        let samples = u64::from(attachments.samples);
        let per_pixel = 4 + 4 * samples + if samples > 1 { 4 * samples } else { 0 };
        let per_view = u64::from(tile[0]) * u64::from(tile[1]) * per_pixel;
        let affordable = (bytes / per_view.max(1)).max(1).min(wanted as u64) as u32;
        let (most_columns, most_rows) = (most / tile[0], most / tile[1]);
        let columns = (f64::from(affordable).sqrt().ceil() as u32).clamp(1, most_columns.max(1));
        let rows = affordable.div_ceil(columns).clamp(1, most_rows.max(1));
        let size =
            wgpu::Extent3d { width: columns * tile[0], height: rows * tile[1], depth_or_array_layers: 1 };
        let texture = |label, format, sample_count, usage| {
            device.create_texture(&wgpu::TextureDescriptor {
                label: Some(label),
                size,
                mip_level_count: 1,
                sample_count,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage,
                view_formats: &[],
            })
        };
        let attachment = wgpu::TextureUsages::RENDER_ATTACHMENT;
        let color = texture("pictures", attachments.format, 1, attachment | wgpu::TextureUsages::COPY_SRC);
        let view = |texture: &wgpu::Texture| texture.create_view(&wgpu::TextureViewDescriptor::default());
        let samples_view = (attachments.samples > 1)
            .then(|| view(&texture("samples", attachments.format, attachments.samples, attachment)));
        let depth_view = view(&texture("depth", DEPTH, attachments.samples, attachment));
        Self {
            tile,
            columns,
            capacity: (columns * rows).min(affordable) as usize,
            is_full_size: ((columns * rows).min(affordable) as usize) < wanted,
            color_view: view(&color),
            color,
            samples_view,
            depth_view,
        }
    }

    /// Upper left corner of a tile.
    pub(super) fn origin(&self, tile: usize) -> [u32; 2] {
        let k = tile as u32;
        [k % self.columns * self.tile[0], k / self.columns * self.tile[1]]
    }

    /// Copies tiles into a buffer, one after the other from `offset` on.
    pub(super) fn copy_to(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        tiles: usize,
        buffer: &wgpu::Buffer,
        offset: u64,
    ) {
        for tile in 0..tiles {
            let [x, y] = self.origin(tile);
            encoder.copy_texture_to_buffer(
                wgpu::TexelCopyTextureInfo {
                    texture: &self.color,
                    mip_level: 0,
                    origin: wgpu::Origin3d { x, y, z: 0 },
                    aspect: wgpu::TextureAspect::All,
                },
                wgpu::TexelCopyBufferInfo {
                    buffer,
                    layout: wgpu::TexelCopyBufferLayout {
                        offset: offset + tile as u64 * tile_bytes(self.tile),
                        bytes_per_row: Some(padded_row(self.tile[0])),
                        rows_per_image: Some(self.tile[1]),
                    },
                },
                wgpu::Extent3d { width: self.tile[0], height: self.tile[1], depth_or_array_layers: 1 },
            );
        }
    }
}

/// Bytes of a row of RGBA texels in a read-back buffer.
pub(super) fn padded_row(width: u32) -> u32 {
    (width * 4).next_multiple_of(ROW_ALIGNMENT)
}

/// Bytes of a picture in a read-back buffer.
pub(super) fn tile_bytes([width, height]: [u32; 2]) -> u64 {
    u64::from(padded_row(width)) * u64::from(height)
}

/// Buffers that pictures come back through; each is used again once it has been read.
#[derive(Debug, Default)]
pub(super) struct Ring {
    free: Vec<wgpu::Buffer>,
}

impl Ring {
    pub(super) fn take(&mut self, device: &wgpu::Device, bytes: u64) -> wgpu::Buffer {
        // The smallest that is large enough; those too small for the work at hand are let go.
        self.free.sort_by_key(wgpu::Buffer::size);
        if let Some(k) = self.free.iter().position(|b| b.size() >= bytes) {
            return self.free.remove(k);
        }
        self.free.clear();
        device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("read-back"),
            size: bytes,
            usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
            mapped_at_creation: false,
        })
    }

    pub(super) fn put_back(&mut self, buffer: wgpu::Buffer) {
        self.free.push(buffer);
    }
}
