//! PNG files.

mod deflate;

use super::{Image, RenderError};
use ::png::EncodingError;
use deflate::{Deflate, Sample};
use std::cell::RefCell;
use std::fs::File;
use std::io::Write;
use std::path::Path;

/// Writes a picture as PNG, compressed for speed rather than size. Its bytes are sRGB, which is
/// what readers take a PNG without a colour profile for.
///
/// # Errors
/// [`RenderError::File`] where the file cannot be made or the disk is full, [`RenderError::Encoding`]
/// where the encoder refuses; both name the path.
pub fn write_png(path: &Path, image: &Image) -> Result<(), RenderError> {
    write_rows(path, [image.width, image.height], |y, row| row_of(image, y, row))
}

/// The bytes of such a file.
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

/// [`write_png`] of a picture whose rows come one by one: `fill` writes the pixels of a row, from the top on.
pub(super) fn write_rows(
    path: &Path,
    extent: [u32; 2],
    fill: impl FnMut(usize, &mut [u8]),
) -> Result<(), RenderError> {
    let at = |source| RenderError::File { path: path.to_owned(), source };
    encode_rows(File::create(path).map_err(at)?, extent, fill).map_err(|error| match error {
        EncodingError::IoError(source) => at(source),
        source => RenderError::Encoding { path: path.to_owned(), source },
    })
}

thread_local! {
    /// Fresh memory costs as much as a tenth of the compression.
    static MEMORY: RefCell<Vec<u8>> = const { RefCell::new(Vec::new()) };
}

/// Rows go through the filter "up" to the compressor some at a time, so that they stay in the processor's cache;
/// the encoder of `png` would want them all at once.
fn encode_rows(
    to: impl Write,
    [width, height]: [u32; 2],
    mut fill: impl FnMut(usize, &mut [u8]),
) -> Result<(), EncodingError> {
    let bytes = width as usize * 3;
    let (mut above, mut row) = (vec![0; bytes], vec![0; bytes]);
    let mut filtered = Vec::with_capacity(ROWS * (bytes + 1));
    let mut sample = Sample::default();
    for y in (height as usize / 2 % SAMPLED..height as usize).step_by(SAMPLED) {
        above.fill(0);
        if y > 0 {
            fill(y - 1, &mut above);
        }
        fill(y, &mut row);
        filter_up(&row, &above, &mut filtered);
        sample.add(&filtered);
        filtered.clear();
    }
    above.fill(0);
    let mut data = Deflate::new(MEMORY.take(), sample);
    for y in 0..height as usize {
        fill(y, &mut row);
        filter_up(&row, &above, &mut filtered);
        std::mem::swap(&mut row, &mut above);
        if y % ROWS == ROWS - 1 {
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
    if memory.len() <= MOST_KEPT {
        MEMORY.set(memory);
    }
    written?;
    writer.finish()
}

/// Bytes of memory that a thread keeps for its next picture.
const MOST_KEPT: usize = 8 << 20;
/// How many rows go to the compressor at a time.
const ROWS: usize = 16;
/// One row of so many tells the compressor which bytes are frequent.
const SAMPLED: usize = 32;

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
