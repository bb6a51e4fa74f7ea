//! Pictures in memory: RGB images and single-channel planes.

/// RGB image: rows from top to bottom, three bytes a pixel, sRGB.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Image {
    /// Pixels in a row.
    pub width: u32,
    /// Number of rows.
    pub height: u32,
    /// Red, green and blue of each pixel: `3 * width * height` bytes.
    pub rgb: Vec<u8>,
}

impl Image {
    /// Red, green and blue in column `x` and row `y`, counted from 0 at the top left.
    ///
    /// # Panics
    /// When the image ends before that pixel.
    pub fn pixel(&self, x: u32, y: u32) -> [u8; 3] {
        let at = (y as usize * self.width as usize + x as usize) * 3;
        [self.rgb[at], self.rgb[at + 1], self.rgb[at + 2]]
    }
}

/// Single-channel image: one value a pixel, rows from top to bottom.
#[derive(Clone, Debug, PartialEq)]
pub struct Plane<T> {
    /// Pixels in a row.
    pub width: u32,
    /// Number of rows.
    pub height: u32,
    /// `width * height` values.
    pub values: Vec<T>,
}

impl<T: Copy> Plane<T> {
    /// Value in column `x` and row `y`, counted from 0 at the top left.
    ///
    /// # Panics
    /// When the image ends before that pixel.
    pub fn at(&self, x: u32, y: u32) -> T {
        self.values[y as usize * self.width as usize + x as usize]
    }
}
