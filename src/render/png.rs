//! PNG files.

use super::{Image, RenderError};
use ::image::codecs::png::{CompressionType, FilterType, PngEncoder};
use ::image::{ExtendedColorType, ImageEncoder};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

/// Writes a picture as PNG, compressed for speed rather than size. Its bytes are sRGB, which is
/// what readers take a PNG without a colour profile for.
///
/// # Errors
/// [`RenderError::File`] where the file cannot be made or the disk is full, [`RenderError::Png`]
/// where the encoder refuses; both name the path.
pub fn write_png(path: &Path, image: &Image) -> Result<(), RenderError> {
    let at = |source| RenderError::File { path: path.to_owned(), source };
    let mut file = BufWriter::new(File::create(path).map_err(at)?);
    PngEncoder::new_with_quality(&mut file, CompressionType::Fast, FilterType::Up)
        .write_image(&image.rgb, image.width, image.height, ExtendedColorType::Rgb8)
        .map_err(|source| RenderError::Png { path: path.to_owned(), source })?;
    file.flush().map_err(at)
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
