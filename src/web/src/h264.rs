//! Pictures as H.264, by openh264: constrained baseline, one reference, no reordering, so that each frame is shown at once.

use crate::picture::{Picture, PictureKind};
use city3d_render::Image;
use openh264::encoder::{
    ColorPrimaries, Complexity, Encoder, EncoderConfig, FrameRate, FrameType, Profile, QpRange,
    RateControlMode, TransferCharacteristics, VuiConfig,
};
use openh264::formats::{RgbSliceU8, YUVBuffer};
use openh264::{Error, OpenH264API};

/// This program makes H.264.
pub(crate) const IS_BUILT: bool = true;

/// Quantisation of all frames: about what JPEG of quality 80 shows. Frames come when pages want them, not at a rate that a
/// control of the bit rate could work with.
const QUANTISATION: u8 = 26;
/// Frames a second at most.
const MOST_HZ: f32 = 30.0;

/// Encodes the frames of one view, each after the one before.
#[allow(missing_debug_implementations, reason = "that of openh264 has none")]
pub struct ViewEncoder(Encoder);

impl ViewEncoder {
    /// An encoder that has no frame before.
    ///
    /// # Errors
    /// When openh264 cannot be set up.
    pub fn new() -> Result<Self, String> {
        // The conversion to luma and chroma is that of BT.601, the colours are those of sRGB.
        let colours = VuiConfig::bt601()
            .color_primaries(ColorPrimaries::Bt709)
            .transfer_characteristics(TransferCharacteristics::Bt709);
        let config = EncoderConfig::new()
            .profile(Profile::Baseline)
            .complexity(Complexity::Low)
            .max_frame_rate(FrameRate::from_hz(MOST_HZ))
            .rate_control_mode(RateControlMode::Off)
            .qp(QpRange::new(QUANTISATION, QUANTISATION))
            .skip_frames(false)
            .scene_change_detect(false)
            .num_threads(1)
            .vui(colours);
        Encoder::with_api_config(OpenH264API::from_source(), config).map(Self).map_err(told)
    }

    /// Encodes the next frame, by itself where a page lacks the one before.
    ///
    /// # Errors
    /// When openh264 makes no frame.
    pub fn encode(&mut self, image: &Image, is_key: bool) -> Result<Picture, String> {
        let size = (image.width as usize, image.height as usize);
        let planes = YUVBuffer::from_rgb8_source(RgbSliceU8::new(&image.rgb, size));
        if is_key {
            self.0.force_intra_frame();
        }
        let encoded = self.0.encode(&planes).map_err(told)?;
        let kind = match encoded.frame_type() {
            FrameType::IDR => PictureKind::KeyFrame,
            FrameType::P | FrameType::I => PictureKind::DeltaFrame,
            other => return Err(format!("openh264 makes no frame, but {other:?}")),
        };
        Ok(Picture { kind, bytes: encoded.to_vec().into() })
    }
}

#[allow(clippy::needless_pass_by_value, reason = "maps errors")]
fn told(error: Error) -> String {
    format!("openh264: {error}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use city3d_session::pictures::jpeg;
    use openh264::decoder::Decoder;
    use openh264::formats::YUVSource;

    const SIZE: [u32; 2] = [192, 128];
    /// Colours of the fields of a picture.
    const COLOURS: [[u8; 3]; 4] = [[200, 40, 40], [40, 160, 60], [50, 80, 190], [220, 220, 210]];

    /// Four fields of one colour each, moved to the right.
    fn image(moved: u32) -> Image {
        let [width, height] = SIZE;
        let colour = |k: u32| COLOURS[((k % width + moved) / 48 % 4) as usize];
        Image { width, height, rgb: (0..width * height).flat_map(colour).collect() }
    }

    fn decoded(decoder: &mut Decoder, picture: &Picture) -> Option<Image> {
        let frame = decoder.decode(&picture.bytes).ok().flatten()?;
        let (width, height) = frame.dimensions();
        let mut rgb = vec![0; width * height * 3];
        frame.write_rgb8(&mut rgb);
        Some(Image { width: width as u32, height: height as u32, rgb })
    }

    /// Mean difference of a channel.
    fn difference(a: &Image, b: &Image) -> f64 {
        assert_eq!((a.width, a.height), (b.width, b.height));
        let sum: f64 = a.rgb.iter().zip(&b.rgb).map(|(a, b)| f64::from(a.abs_diff(*b))).sum();
        sum / a.rgb.len() as f64
    }

    #[test]
    fn frames_show_the_pictures_and_those_between_key_frames_are_small() {
        let (mut encoder, mut decoder) = (ViewEncoder::new().unwrap(), Decoder::new().unwrap());
        let mut sizes = Vec::new();
        for number in 0..12 {
            let picture = encoder.encode(&image(number), number == 8).unwrap();
            let is_key = number == 0 || number == 8;
            let kind = if is_key { PictureKind::KeyFrame } else { PictureKind::DeltaFrame };
            assert_eq!(picture.kind, kind, "frame {number}");
            let seen = decoded(&mut decoder, &picture).expect("each frame is shown at once");
            let difference = difference(&seen, &image(number));
            assert!(difference < 6.0, "frame {number} differs by {difference} of 255");
            sizes.push((is_key, picture.bytes.len()));
        }
        let jpeg = jpeg(&image(0), 80).unwrap().len();
        let largest = sizes.iter().filter(|(is_key, _)| !is_key).map(|(_, size)| *size).max().unwrap();
        assert!(largest < jpeg / 2, "{largest} bytes, {jpeg} of a JPEG");
    }

    #[test]
    fn a_decoder_that_begins_later_needs_a_key_frame() {
        let mut encoder = ViewEncoder::new().unwrap();
        encoder.encode(&image(0), false).unwrap();
        let mut decoder = Decoder::new().unwrap();
        assert!(decoded(&mut decoder, &encoder.encode(&image(1), false).unwrap()).is_none());
        let key = encoder.encode(&image(2), true).unwrap();
        assert!(difference(&decoded(&mut decoder, &key).unwrap(), &image(2)) < 6.0);
    }
}
