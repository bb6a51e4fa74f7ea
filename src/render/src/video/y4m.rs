//! YUV4MPEG2 (Y4M): uncompressed video stream.
//!
//! 4:2:0 chroma subsampling with centred siting, limited range, ITU-R BT.601 matrix: the defaults of readers, as the
//! format cannot state them.

use crate::Image;
use rayon::prelude::*;

/// Pictures per second as a fraction of whole numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameRate {
    /// Pictures in [`Self::denominator`] seconds.
    pub numerator: u64,
    /// Seconds, which share no factor with the numerator.
    pub denominator: u64,
}

impl FrameRate {
    /// The rate of a period in seconds: exact where it is a whole number of pictures per second, else to a microsecond.
    pub fn of_period(period_s: f64) -> Self {
        let fps = 1.0 / period_s;
        let (numerator, denominator) = if (fps - fps.round()).abs() < 1e-6 {
            (fps.round() as u64, 1)
        } else {
            (1_000_000, (period_s * 1e6).round() as u64)
        };
        let (mut a, mut b) = (numerator, denominator);
        while b > 0 {
            (a, b) = (b, a % b);
        }
        let divisor = a.max(1);
        Self { numerator: numerator / divisor, denominator: denominator / divisor }
    }
}

/// The stream header.
pub(super) fn header([width, height]: [u32; 2], rate: FrameRate) -> String {
    let FrameRate { numerator, denominator } = rate;
    format!("YUV4MPEG2 W{width} H{height} F{numerator}:{denominator} Ip A1:1 C420jpeg XCOLORRANGE=LIMITED\n")
}

/// Writes a frame with its header into a buffer; width and height are even.
pub(super) fn frame(image: &Image, into: &mut Vec<u8>) {
    const BEGIN: &[u8] = b"FRAME\n";
    let (width, height) = (image.width as usize, image.height as usize);
    into.clear();
    into.extend_from_slice(BEGIN);
    into.resize(BEGIN.len() + width * height * 3 / 2, 0);
    let (luma, chroma) = into[BEGIN.len()..].split_at_mut(width * height);
    let (blue, red) = chroma.split_at_mut(width * height / 4);
    let rows = luma.par_chunks_exact_mut(2 * width).zip(image.rgb.par_chunks_exact(6 * width));
    let chroma = blue.par_chunks_exact_mut(width / 2).zip(red.par_chunks_exact_mut(width / 2));
    rows.zip(chroma).for_each(|((luma, rgb), (blue, red))| two_rows(luma, (blue, red), rgb));
}

/// Two rows of pixels and the one of chroma that they share.
fn two_rows(luma: &mut [u8], (blue, red): (&mut [u8], &mut [u8]), rgb: &[u8]) {
    let pixels = rgb.as_chunks::<3>().0;
    for (y, pixel) in luma.iter_mut().zip(pixels) {
        let [r, g, b] = pixel.map(i32::from);
        *y = ((16_829 * r + 33_039 * g + 6416 * b + (16 << 16) + HALF) >> 16) as u8;
    }
    let width = pixels.len() / 2;
    for (column, (blue, red)) in blue.iter_mut().zip(red).enumerate() {
        let at = [2 * column, 2 * column + 1, width + 2 * column, width + 2 * column + 1];
        let [r, g, b] = [0, 1, 2].map(|c| at.iter().map(|&k| i32::from(pixels[k][c])).sum::<i32>());
        // Sum of four pixels: two more bits.
        *blue = ((-9714 * r - 19_071 * g + 28_784 * b + (128 << 18) + 4 * HALF) >> 18) as u8;
        *red = ((28_784 * r - 24_103 * g - 4681 * b + (128 << 18) + 4 * HALF) >> 18) as u8;
    }
}

/// One half in 16-bit fixed point.
const HALF: i32 = 1 << 15;

#[cfg(test)]
mod tests {
    use super::*;

    fn plain(rgb: [u8; 3]) -> Vec<u8> {
        let image = Image { width: 4, height: 2, rgb: rgb.repeat(8) };
        let mut bytes = Vec::new();
        frame(&image, &mut bytes);
        assert_eq!((&bytes[..6], bytes.len()), (b"FRAME\n".as_slice(), 6 + 12));
        bytes[6..].to_vec()
    }

    #[test]
    fn colours_are_those_of_bt_601_in_the_limited_range() {
        // Rec. ITU-R BT.601-7, the bars of 100 %.
        for (rgb, [y, cb, cr]) in [
            ([0, 0, 0], [16, 128, 128]),
            ([255, 255, 255], [235, 128, 128]),
            ([255, 0, 0], [81, 90, 240]),
            ([0, 255, 0], [145, 54, 34]),
            ([0, 0, 255], [41, 240, 110]),
        ] {
            let planes = plain(rgb);
            assert_eq!(planes, [vec![y; 8], vec![cb; 2], vec![cr; 2]].concat(), "{rgb:?}");
        }
    }

    #[test]
    fn chroma_is_the_mean_of_four_pixels() {
        let mut rgb = vec![0; 4 * 2 * 3];
        // One of the left four pixels is red.
        rgb[12] = 255;
        let mut bytes = Vec::new();
        frame(&Image { width: 4, height: 2, rgb }, &mut bytes);
        assert_eq!(&bytes[6 + 8..], [119, 128, 156, 128]);
        assert_eq!(&bytes[6..14], [16, 16, 16, 16, 81, 16, 16, 16]);
    }

    #[test]
    fn rates_are_fractions() {
        let rate = |period_s| {
            let FrameRate { numerator, denominator } = FrameRate::of_period(period_s);
            (numerator, denominator)
        };
        assert_eq!(rate(1.0 / 30.0), (30, 1));
        assert_eq!(rate(2.0), (1, 2));
        assert_eq!(rate(0.03), (100, 3));
        assert_eq!(
            header([640, 480], FrameRate::of_period(0.04)),
            "YUV4MPEG2 W640 H480 F25:1 Ip A1:1 C420jpeg XCOLORRANGE=LIMITED\n"
        );
    }
}
