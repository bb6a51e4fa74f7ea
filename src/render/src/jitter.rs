//! Jitter of temporal anti-aliasing: pictures of one instant, each shifted by a part of a pixel, whose mean has smooth
//! edges of thin things. The shifts are the same in every run.

use glam::DVec3;

/// Shift of one of the pictures that are averaged.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct SubpixelJitter {
    /// Number of the picture, from 0.
    pub(crate) sample: u32,
    /// Right and down, pixels: from -0.5 to 0.5.
    shift_px: [f64; 2],
}

impl SubpixelJitter {
    /// Of picture `sample` of `count`: points of the Halton sequence of bases 2 and 3 (Halton 1960) around their mean. A
    /// single picture is not shifted.
    pub(crate) fn new(sample: u32, count: u32) -> Self {
        if count < 2 {
            return Self::default();
        }
        let shift = |base| {
            let mean = (0..count).map(|k| radical_inverse(k + 1, base)).sum::<f64>() / f64::from(count);
            radical_inverse(sample + 1, base) - mean
        };
        Self { sample, shift_px: [shift(2), shift(3)] }
    }

    /// Translation in clip coordinates of a picture of so many pixels.
    pub(crate) fn in_clip(self, extent: [u32; 2]) -> DVec3 {
        let [right, down] = self.shift_px;
        let [width, height] = extent.map(f64::from);
        DVec3::new(2.0 * right / width, -2.0 * down / height, 0.0)
    }
}

/// The digits of a number after the point, in reverse.
fn radical_inverse(mut number: u32, base: u32) -> f64 {
    let (mut inverse, mut digit) = (0.0, 1.0);
    while number > 0 {
        digit /= f64::from(base);
        inverse += digit * f64::from(number % base);
        number /= base;
    }
    inverse
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shifts_are_points_of_the_halton_sequence_around_no_shift() {
        let points: Vec<f64> = (1..=4).map(|k| radical_inverse(k, 2)).collect();
        assert_eq!(points, [0.5, 0.25, 0.75, 0.125]);
        assert!((radical_inverse(5, 3) - (2.0 / 3.0 + 1.0 / 9.0)).abs() < 1e-12);
        for axis in 0..2 {
            let shifts = [0, 1, 2, 3].map(|sample| SubpixelJitter::new(sample, 4).shift_px[axis]);
            assert!(shifts.iter().sum::<f64>().abs() < 1e-12 && shifts.iter().all(|s| s.abs() < 0.5));
        }
        assert_eq!(SubpixelJitter::new(0, 1), SubpixelJitter::default());
    }
}
