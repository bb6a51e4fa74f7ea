//! Read-back of pictures through staging buffers: asynchronous mapping, reading from any thread, and a pool that reuses
//! the buffers.

use super::grid::{padded_row, tile_bytes};
use super::ground_truth;
use super::png;
use super::request::{Pictures, ReadbackLayout};
use super::{Context, Image, RenderError};
use city3d_sensors::{PictureKind, PictureKinds};
use std::path::Path;
use std::sync::mpsc;

/// Pool of staging buffers (`MAP_READ`); a buffer returns to it once its readers have dropped it.
#[derive(Debug)]
pub(super) struct StagingPool {
    free: Vec<wgpu::Buffer>,
    /// Buffers that were dropped by their readers.
    returned: mpsc::Receiver<wgpu::Buffer>,
    return_to: mpsc::Sender<wgpu::Buffer>,
}

/// Batch that has been submitted, in flight.
#[derive(Debug)]
pub struct PendingReadback {
    /// By device; the views of the batch are numbered through.
    pub(super) parts: Vec<PendingDeviceReadback>,
}

/// Share of a batch that one device draws.
#[derive(Debug)]
pub(super) struct PendingDeviceReadback {
    device: wgpu::Device,
    buffer: wgpu::Buffer,
    return_to: mpsc::Sender<wgpu::Buffer>,
    /// By view.
    layouts: Vec<ReadbackLayout>,
    mapped: mpsc::Receiver<Result<(), wgpu::BufferAsyncError>>,
    submission: wgpu::SubmissionIndex,
    bgra: bool,
}

/// Completed batch, with its staging buffers mapped for reading.
#[derive(Debug)]
pub struct MappedReadback {
    /// By device.
    parts: Vec<MappedDeviceReadback>,
}

#[derive(Debug)]
struct MappedDeviceReadback {
    buffer: wgpu::Buffer,
    return_to: mpsc::Sender<wgpu::Buffer>,
    /// Mapped memory; `None` only while dropping.
    bytes: Option<wgpu::BufferView>,
    layouts: Vec<ReadbackLayout>,
    bgra: bool,
}

impl Default for StagingPool {
    fn default() -> Self {
        let (return_to, returned) = mpsc::channel();
        Self { free: Vec::new(), returned, return_to }
    }
}

impl StagingPool {
    pub(super) fn acquire(&mut self, device: &wgpu::Device, bytes: u64) -> wgpu::Buffer {
        self.free.extend(self.returned.try_iter());
        // Takes the smallest buffer that is large enough; if there is none, frees all of them.
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

    /// Starts the asynchronous mapping of a buffer whose copy has been submitted.
    pub(super) fn map(
        &self,
        device: &wgpu::Device,
        (buffer, submission): (wgpu::Buffer, wgpu::SubmissionIndex),
        (layouts, format): (Vec<ReadbackLayout>, wgpu::TextureFormat),
    ) -> PendingDeviceReadback {
        let (sender, mapped) = mpsc::channel();
        buffer.slice(..).map_async(wgpu::MapMode::Read, move |result| {
            // The receiver is gone if the batch was dropped.
            let _ = sender.send(result);
        });
        let bgra = matches!(format, wgpu::TextureFormat::Bgra8Unorm | wgpu::TextureFormat::Bgra8UnormSrgb);
        let (device, return_to) = (device.clone(), self.return_to.clone());
        PendingDeviceReadback { device, buffer, return_to, layouts, mapped, submission, bgra }
    }
}

impl PendingReadback {
    pub(super) fn wait(self) -> Result<MappedReadback, RenderError> {
        let parts = self.parts.into_iter().map(PendingDeviceReadback::wait);
        Ok(MappedReadback { parts: parts.collect::<Result<_, _>>()? })
    }
}

impl PendingDeviceReadback {
    fn wait(self) -> Result<MappedDeviceReadback, RenderError> {
        let wait = wgpu::PollType::Wait { submission_index: Some(self.submission), timeout: None };
        let lost = |error: &dyn std::fmt::Display| RenderError::Readback(error.to_string());
        self.device.poll(wait).map_err(|error| lost(&error))?;
        self.mapped.recv().map_err(|error| lost(&error))?.map_err(|error| lost(&error))?;
        let bytes = self.buffer.slice(..).get_mapped_range().map_err(|error| lost(&error))?;
        let Self { buffer, return_to, layouts, bgra, .. } = self;
        Ok(MappedDeviceReadback { buffer, return_to, bytes: Some(bytes), layouts, bgra })
    }
}

impl MappedReadback {
    /// Number of views.
    pub fn len(&self) -> usize {
        self.parts.iter().map(|part| part.layouts.len()).sum()
    }

    /// Whether the batch has no views.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Share that holds a view, and the view's index in it.
    fn part(&self, mut index: usize) -> (&MappedDeviceReadback, usize) {
        for part in &self.parts {
            match index.checked_sub(part.layouts.len()) {
                Some(rest) => index = rest,
                None => return (part, index),
            }
        }
        panic!("the batch has {} views, and not {} more", self.len(), index + 1)
    }

    /// All requested pictures of a view, by its index in the batch.
    ///
    /// # Panics
    /// Where the batch has no such view.
    pub fn pictures(&self, index: usize) -> Pictures {
        let (part, index) = self.part(index);
        part.some_pictures(index, part.layouts[index].kinds)
    }

    /// Pictures of a view, of those kinds that are both wanted and requested.
    ///
    /// # Panics
    /// Where the batch has no such view.
    pub fn some_pictures(&self, index: usize, wanted: PictureKinds) -> Pictures {
        let (part, index) = self.part(index);
        part.some_pictures(index, wanted)
    }

    /// Reads the colour picture of a view, if requested, into an image whose memory is reused: fresh memory costs as
    /// much as the reading.
    ///
    /// # Panics
    /// Where the batch has no such view.
    pub fn read_rgb(&self, index: usize, image: &mut Image) {
        let (part, index) = self.part(index);
        if let Some(bytes) = part.rgba(index) {
            read_rgb_rows(bytes, part.layouts[index].extent, part.bgra, image);
        }
    }

    /// Writes the colour picture of a view, if requested, as PNG straight from the mapped memory.
    ///
    /// # Errors
    /// As [`super::write_png`].
    ///
    /// # Panics
    /// Where the batch has no such view.
    pub fn write_png(&self, index: usize, path: &Path) -> Result<(), RenderError> {
        let (part, index) = self.part(index);
        let Some(bytes) = part.rgba(index) else { return Ok(()) };
        let extent = part.layouts[index].extent;
        let padded = padded_row(extent[0]) as usize;
        png::write_rows(path, extent, |y, row| rgb_row(row, &bytes[y * padded..], part.bgra))
    }
}

impl MappedDeviceReadback {
    fn some_pictures(&self, index: usize, wanted: PictureKinds) -> Pictures {
        let ReadbackLayout { extent, kinds: there, color, depth, labels } = self.layouts[index];
        let bytes: &[u8] = self.bytes.as_deref().unwrap_or_default();
        let of = |kind, at: Option<u64>| {
            let is_there = wanted.contains(kind) && there.contains(kind);
            at.filter(|_| is_there).map(|at| &bytes[at as usize..])
        };
        Pictures {
            rgb: of(PictureKind::Rgb, color).map(|bytes| rgb_image(bytes, extent, self.bgra)),
            depth: of(PictureKind::Depth, depth).map(|bytes| ground_truth::depths(bytes, extent)),
            semantic: of(PictureKind::Semantic, labels).map(|bytes| ground_truth::classes(bytes, extent)),
            instance: of(PictureKind::Instance, labels).map(|bytes| ground_truth::vehicles(bytes, extent)),
        }
    }

    /// Mapped memory from the colour picture of a view on, rows padded to the row pitch; `None` if not requested.
    fn rgba(&self, index: usize) -> Option<&[u8]> {
        let ReadbackLayout { kinds, color, .. } = self.layouts[index];
        let at = color.filter(|_| kinds.contains(PictureKind::Rgb))?;
        Some(&self.bytes.as_deref().unwrap_or_default()[at as usize..])
    }
}

impl Drop for MappedDeviceReadback {
    fn drop(&mut self) {
        // Unmapping needs the view of the mapped memory dropped first.
        self.bytes = None;
        self.buffer.unmap();
        // The pool may be gone.
        let _ = self.return_to.send(self.buffer.clone());
    }
}

/// Reads back an 8-bit RGBA or BGRA texture with the usage `COPY_SRC`.
///
/// # Errors
/// [`RenderError::Readback`] where the adapter was lost.
pub fn read_texture(context: &Context, texture: &wgpu::Texture) -> Result<Image, RenderError> {
    let extent = [texture.width(), texture.height()];
    let mut staging = StagingPool::default();
    let buffer = staging.acquire(&context.device, tile_bytes(extent));
    let mut encoder = context.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    let buffer_layout = wgpu::TexelCopyBufferLayout {
        offset: 0,
        bytes_per_row: Some(padded_row(extent[0])),
        rows_per_image: None,
    };
    encoder.copy_texture_to_buffer(
        texture.as_image_copy(),
        wgpu::TexelCopyBufferInfo { buffer: &buffer, layout: buffer_layout },
        texture.size(),
    );
    let submission = context.queue.submit([encoder.finish()]);
    let layout =
        ReadbackLayout { extent, kinds: PictureKinds::RGB, color: Some(0), depth: None, labels: None };
    let pending = staging.map(&context.device, (buffer, submission), (vec![layout], texture.format()));
    pending
        .wait()?
        .some_pictures(0, PictureKinds::RGB)
        .rgb
        .ok_or_else(|| RenderError::Readback("no colours".to_owned()))
}

/// RGB from padded rows of RGBA or BGRA, into an image whose memory is reused.
fn read_rgb_rows(bytes: &[u8], [width, height]: [u32; 2], bgra: bool, image: &mut Image) {
    let padded = padded_row(width) as usize;
    (image.width, image.height) = (width, height);
    image.rgb.resize(width as usize * height as usize * 3, 0);
    for (to, from) in image.rgb.chunks_exact_mut(width as usize * 3).zip(bytes.chunks(padded)) {
        rgb_row(to, from, bgra);
    }
}

fn rgb_image(bytes: &[u8], extent: [u32; 2], bgra: bool) -> Image {
    let mut image = Image::default();
    read_rgb_rows(bytes, extent, bgra, &mut image);
    image
}

/// Converts a row of RGBA or BGRA to RGB; `from` may be longer.
fn rgb_row(to: &mut [u8], from: &[u8], bgra: bool) {
    let from = &from[..to.len() / 3 * 4];
    let convert = if bgra { garb::bytes::bgra_to_rgb } else { garb::bytes::rgba_to_rgb };
    // The conversion fails only if a row is no whole number of pixels.
    let converted = convert(from, to);
    debug_assert!(converted.is_ok(), "{converted:?}");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_lose_their_alpha_and_padding() {
        for (width, bgra) in [(1, false), (4, true), (7, false), (13, true)] {
            let texel = |k: usize| [k as u8, k as u8 + 50, k as u8 + 100, 255];
            let mut bytes = vec![9; 2 * padded_row(width) as usize];
            for y in 0..2 {
                for x in 0..width as usize {
                    let at = y * padded_row(width) as usize + 4 * x;
                    bytes[at..at + 4].copy_from_slice(&texel(20 * y + x));
                }
            }
            let image = rgb_image(&bytes, [width, 2], bgra);
            for (x, y) in [(0, 0), (width - 1, 0), (width / 2, 1), (width - 1, 1)] {
                let [r, g, b, _] = texel(20 * y as usize + x as usize);
                assert_eq!(image.pixel(x, y), if bgra { [b, g, r] } else { [r, g, b] }, "{width} {x} {y}");
            }
        }
    }
}
