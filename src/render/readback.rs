//! Pictures on their way back from the adapter. Once they have arrived, any thread can take them out of the
//! buffer they came through; it is used again when nobody needs it any longer.

use super::grid::{padded_row, tile_bytes};
use super::kinds;
use super::png;
use super::request::{Pictures, Places};
use super::{Context, Image, RenderError};
use crate::camera::{Kinds, PictureKind};
use std::path::Path;
use std::sync::mpsc;

/// Buffers that pictures come back through; each is used again once it has been read.
#[derive(Debug)]
pub(super) struct Ring {
    free: Vec<wgpu::Buffer>,
    /// Where buffers come back to.
    returned: mpsc::Receiver<wgpu::Buffer>,
    home: mpsc::Sender<wgpu::Buffer>,
}

/// A batch that has been submitted.
#[derive(Debug)]
pub struct Pending {
    /// One after the other.
    pub(super) parts: Vec<PendingPart>,
}

/// What of a batch one opened adapter draws.
#[derive(Debug)]
pub(super) struct PendingPart {
    device: wgpu::Device,
    buffer: wgpu::Buffer,
    home: mpsc::Sender<wgpu::Buffer>,
    /// Of each view.
    places: Vec<Places>,
    mapped: mpsc::Receiver<Result<(), wgpu::BufferAsyncError>>,
    submission: wgpu::SubmissionIndex,
    bgra: bool,
}

/// A batch whose pictures are there.
#[derive(Debug)]
pub struct Arrived {
    /// One after the other.
    parts: Vec<ArrivedPart>,
}

#[derive(Debug)]
struct ArrivedPart {
    buffer: wgpu::Buffer,
    home: mpsc::Sender<wgpu::Buffer>,
    /// There until the end.
    bytes: Option<wgpu::BufferView>,
    places: Vec<Places>,
    bgra: bool,
}

impl Default for Ring {
    fn default() -> Self {
        let (home, returned) = mpsc::channel();
        Self { free: Vec::new(), returned, home }
    }
}

impl Ring {
    pub(super) fn take(&mut self, device: &wgpu::Device, bytes: u64) -> wgpu::Buffer {
        self.free.extend(self.returned.try_iter());
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

    /// Asks for a buffer that has been submitted to be mapped.
    pub(super) fn send(
        &self,
        device: &wgpu::Device,
        (buffer, submission): (wgpu::Buffer, wgpu::SubmissionIndex),
        (places, format): (Vec<Places>, wgpu::TextureFormat),
    ) -> PendingPart {
        let (sender, mapped) = mpsc::channel();
        buffer.slice(..).map_async(wgpu::MapMode::Read, move |result| {
            // Nobody waits any longer when the batch was dropped.
            let _ = sender.send(result);
        });
        let bgra = matches!(format, wgpu::TextureFormat::Bgra8Unorm | wgpu::TextureFormat::Bgra8UnormSrgb);
        let (device, home) = (device.clone(), self.home.clone());
        PendingPart { device, buffer, home, places, mapped, submission, bgra }
    }
}

impl Pending {
    pub(super) fn wait(self) -> Result<Arrived, RenderError> {
        let parts = self.parts.into_iter().map(PendingPart::wait);
        Ok(Arrived { parts: parts.collect::<Result<_, _>>()? })
    }
}

impl PendingPart {
    fn wait(self) -> Result<ArrivedPart, RenderError> {
        let wait = wgpu::PollType::Wait { submission_index: Some(self.submission), timeout: None };
        let lost = |error: &dyn std::fmt::Display| RenderError::Readback(error.to_string());
        self.device.poll(wait).map_err(|error| lost(&error))?;
        self.mapped.recv().map_err(|error| lost(&error))?.map_err(|error| lost(&error))?;
        let bytes = self.buffer.slice(..).get_mapped_range().map_err(|error| lost(&error))?;
        let Self { buffer, home, places, bgra, .. } = self;
        Ok(ArrivedPart { buffer, home, bytes: Some(bytes), places, bgra })
    }
}

impl Arrived {
    /// How many views it has pictures of.
    pub fn len(&self) -> usize {
        self.parts.iter().map(|part| part.places.len()).sum()
    }

    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The part that has the pictures of a view, and its place there.
    fn part(&self, mut index: usize) -> (&ArrivedPart, usize) {
        for part in &self.parts {
            match index.checked_sub(part.places.len()) {
                Some(rest) => index = rest,
                None => return (part, index),
            }
        }
        panic!("the batch has {} views, and not {} more", self.len(), index + 1)
    }

    /// The pictures of a view, by its place in the batch.
    ///
    /// # Panics
    /// Where the batch has no such view.
    pub fn pictures(&self, index: usize) -> Pictures {
        let (part, index) = self.part(index);
        part.some_pictures(index, part.places[index].kinds)
    }

    /// Those pictures of a view that are of some kinds and were asked for.
    ///
    /// # Panics
    /// Where the batch has no such view.
    pub fn some_pictures(&self, index: usize, wanted: Kinds) -> Pictures {
        let (part, index) = self.part(index);
        part.some_pictures(index, wanted)
    }

    /// Reads the picture of a view in colour into an image whose memory is used again, if it was taken: fresh
    /// memory costs as much as the reading.
    ///
    /// # Panics
    /// Where the batch has no such view.
    pub fn read_rgb(&self, index: usize, image: &mut Image) {
        let (part, index) = self.part(index);
        if let Some(bytes) = part.rgba(index) {
            read_colors(bytes, part.places[index].extent, part.bgra, image);
        }
    }

    /// Writes the picture of a view in colour as PNG, if it was taken, without a copy of it in between.
    ///
    /// # Errors
    /// As [`super::write_png`].
    ///
    /// # Panics
    /// Where the batch has no such view.
    pub fn write_png(&self, index: usize, path: &Path) -> Result<(), RenderError> {
        let (part, index) = self.part(index);
        let Some(bytes) = part.rgba(index) else { return Ok(()) };
        let extent = part.places[index].extent;
        let padded = padded_row(extent[0]) as usize;
        png::write_rows(path, extent, |y, row| row_of_colors(row, &bytes[y * padded..], part.bgra))
    }
}

impl ArrivedPart {
    fn some_pictures(&self, index: usize, wanted: Kinds) -> Pictures {
        let Places { extent, kinds: there, color, depth, meaning } = self.places[index];
        let bytes: &[u8] = self.bytes.as_deref().unwrap_or_default();
        let of = |kind, at: Option<u64>| {
            let is_there = wanted.contains(kind) && there.contains(kind);
            at.filter(|_| is_there).map(|at| &bytes[at as usize..])
        };
        Pictures {
            rgb: of(PictureKind::Rgb, color).map(|bytes| colors(bytes, extent, self.bgra)),
            depth: of(PictureKind::Depth, depth).map(|bytes| kinds::depths(bytes, extent)),
            semantic: of(PictureKind::Semantic, meaning).map(|bytes| kinds::classes(bytes, extent)),
            instance: of(PictureKind::Instance, meaning).map(|bytes| kinds::vehicles(bytes, extent)),
        }
    }

    /// Padded rows of the picture of a view in colour, and what comes after it, if it was taken.
    fn rgba(&self, index: usize) -> Option<&[u8]> {
        let Places { kinds, color, .. } = self.places[index];
        let at = color.filter(|_| kinds.contains(PictureKind::Rgb))?;
        Some(&self.bytes.as_deref().unwrap_or_default()[at as usize..])
    }
}

impl Drop for ArrivedPart {
    fn drop(&mut self) {
        // A buffer is unmapped once nobody looks at it.
        self.bytes = None;
        self.buffer.unmap();
        // The renderer may be gone.
        let _ = self.home.send(self.buffer.clone());
    }
}

/// The colours of a texture of four bytes a pixel that can be copied from, whatever its order of channels.
///
/// # Errors
/// [`RenderError::Readback`] where the adapter was lost.
pub fn read_texture(context: &Context, texture: &wgpu::Texture) -> Result<Image, RenderError> {
    let extent = [texture.width(), texture.height()];
    let mut ring = Ring::default();
    let buffer = ring.take(&context.device, tile_bytes(extent));
    let mut encoder = context.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    let layout = wgpu::TexelCopyBufferLayout {
        offset: 0,
        bytes_per_row: Some(padded_row(extent[0])),
        rows_per_image: None,
    };
    encoder.copy_texture_to_buffer(
        texture.as_image_copy(),
        wgpu::TexelCopyBufferInfo { buffer: &buffer, layout },
        texture.size(),
    );
    let submission = context.queue.submit([encoder.finish()]);
    let place = Places { extent, kinds: Kinds::RGB, color: Some(0), depth: None, meaning: None };
    let pending = ring.send(&context.device, (buffer, submission), (vec![place], texture.format()));
    pending
        .wait()?
        .some_pictures(0, Kinds::RGB)
        .rgb
        .ok_or_else(|| RenderError::Readback("no colours".to_owned()))
}

/// RGB out of padded rows of RGBA, into an image whose memory is used again.
fn read_colors(bytes: &[u8], [width, height]: [u32; 2], bgra: bool, image: &mut Image) {
    let padded = padded_row(width) as usize;
    (image.width, image.height) = (width, height);
    image.rgb.resize(width as usize * height as usize * 3, 0);
    for (to, from) in image.rgb.chunks_exact_mut(width as usize * 3).zip(bytes.chunks(padded)) {
        row_of_colors(to, from, bgra);
    }
}

fn colors(bytes: &[u8], extent: [u32; 2], bgra: bool) -> Image {
    let mut image = Image::default();
    read_colors(bytes, extent, bgra, &mut image);
    image
}

/// A row of RGB out of one of RGBA, which may go on after it.
fn row_of_colors(to: &mut [u8], from: &[u8], bgra: bool) {
    let from = &from[..to.len() / 3 * 4];
    let convert = if bgra { garb::bytes::bgra_to_rgb } else { garb::bytes::rgba_to_rgb };
    // A row is whole pixels on both sides.
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
            let image = colors(&bytes, [width, 2], bgra);
            for (x, y) in [(0, 0), (width - 1, 0), (width / 2, 1), (width - 1, 1)] {
                let [r, g, b, _] = texel(20 * y as usize + x as usize);
                assert_eq!(image.pixel(x, y), if bgra { [b, g, r] } else { [r, g, b] }, "{width} {x} {y}");
            }
        }
    }
}
