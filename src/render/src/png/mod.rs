//! PNG encoder for RGB images, tuned for speed.

mod deflate;

use super::{Image, RenderError};
use ::png::EncodingError;
use city3d_outputs::WholeFile;
use deflate::{DeflateEncoder, SymbolCounts};
use std::cell::RefCell;
use std::io::Write;
use std::path::Path;

/// Writes a picture as PNG, compressed for speed rather than size. The colours are sRGB, the default of readers for a
/// PNG without a colour profile.
///
/// # Errors [`RenderError::File`] if the file cannot be written, [`RenderError::Encoding`] if the encoder refuses the
/// picture; both name the path.
pub fn write_png(path: &Path, image: &Image) -> Result<(), RenderError> {
    write_rows(path, [image.width, image.height], |y, row| row_of(image, y, row))
}

/// Encodes a picture as [`write_png`] does, in memory.
///
/// # Errors
/// Where the encoder refuses the picture.
pub fn encode_png(image: &Image) -> Result<Vec<u8>, EncodingError> {
    let mut bytes = Vec::new();
    encode_rows(&mut bytes, [image.width, image.height], |y, row| row_of(image, y, row))?;
    Ok(bytes)
}

fn row_of(image: &Image, y: usize, row: &mut [u8]) {
    row.copy_from_slice(&image.rgb[y * row.len()..][..row.len()]);
}

/// [`write_png`] from a callback: `fill` writes the pixels of row `y`. It may be called for a row more than once.
pub(super) fn write_rows(
    path: &Path,
    extent: [u32; 2],
    fill: impl FnMut(usize, &mut [u8]),
) -> Result<(), RenderError> {
    let at = |source| RenderError::File { path: path.to_owned(), source };
    let mut file = WholeFile::create(path).map_err(at)?;
    encode_rows(&mut file, extent, fill).map_err(|error| match error {
        EncodingError::IoError(source) => at(source),
        source => RenderError::Encoding { path: path.to_owned(), source },
    })?;
    file.commit().map_err(at)
}

thread_local! {
    /// Reused output buffer: fresh memory costs a tenth of the compression.
    static MEMORY: RefCell<Vec<u8>> = const { RefCell::new(Vec::new()) };
}

/// Filters rows by "up" and compresses them in small groups, so that they stay in the processor's cache; the encoder of
/// `png` takes the whole image.
fn encode_rows(
    to: impl Write,
    [width, height]: [u32; 2],
    mut fill: impl FnMut(usize, &mut [u8]),
) -> Result<(), EncodingError> {
    let bytes = width as usize * 3;
    let (mut above, mut row) = (vec![0; bytes], vec![0; bytes]);
    let mut filtered = Vec::with_capacity(GROUP_ROWS * (bytes + 1));
    let mut counts = SymbolCounts::default();
    for y in (height as usize / 2 % SAMPLE_STEP..height as usize).step_by(SAMPLE_STEP) {
        above.fill(0);
        if y > 0 {
            fill(y - 1, &mut above);
        }
        fill(y, &mut row);
        filter_up(&row, &above, &mut filtered);
        counts.add(&filtered);
        filtered.clear();
    }
    above.fill(0);
    let mut data = DeflateEncoder::new(MEMORY.take(), counts);
    for y in 0..height as usize {
        fill(y, &mut row);
        filter_up(&row, &above, &mut filtered);
        std::mem::swap(&mut row, &mut above);
        if y % GROUP_ROWS == GROUP_ROWS - 1 {
            data.write(&filtered);
            filtered.clear();
        }
    }
    data.write(&filtered);
    let (memory, count) = data.finish();
    let mut encoder = ::png::Encoder::new(to, width, height);
    encoder.set_color(::png::ColorType::Rgb);
    let mut writer = encoder.write_header()?;
    let written = writer.write_chunk(::png::chunk::IDAT, &memory[..count]);
    if memory.len() <= MAX_KEPT_BYTES {
        MEMORY.set(memory);
    }
    written?;
    writer.finish()
}

/// Largest output buffer that a thread keeps for its next picture, bytes.
const MAX_KEPT_BYTES: usize = 8 << 20;
/// Rows per group.
const GROUP_ROWS: usize = 16;
/// Every 32nd row is sampled for the byte frequencies of the Huffman code.
const SAMPLE_STEP: usize = 32;

fn filter_up(row: &[u8], above: &[u8], to: &mut Vec<u8>) {
    to.push(::png::Filter::Up as u8);
    to.extend(row.iter().zip(above).map(|(here, above)| here.wrapping_sub(*above)));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_reads_back_the_same() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        let rgb: Vec<u8> = (0..7 * 5 * 3).map(|k| (k * 37 % 251) as u8).collect();
        write_png(&path, &Image { width: 7, height: 5, rgb: rgb.clone() }).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        let back = ::image::load_from_memory(&bytes).unwrap().into_rgb8();
        assert_eq!((back.dimensions(), back.into_raw()), ((7, 5), rgb));
    }

    #[test]
    fn an_error_names_the_path() {
        let image = Image { width: 1, height: 1, rgb: vec![0; 3] };
        let error = write_png(Path::new("no/such/folder/a.png"), &image).unwrap_err();
        assert!(error.to_string().contains("no/such/folder/a.png"), "{error}");
    }
}
