//! Pictures in memory: RGB images and single-channel planes.

/// RGB image: rows from top to bottom, three bytes a pixel, sRGB.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Image {
    pub width: u32,
    pub height: u32,
    pub rgb: Vec<u8>,
}

impl Image {
    pub fn pixel(&self, x: u32, y: u32) -> [u8; 3] {
        let at = (y as usize * self.width as usize + x as usize) * 3;
        [self.rgb[at], self.rgb[at + 1], self.rgb[at + 2]]
    }
}

/// Single-channel image: one value a pixel, rows from top to bottom.
#[derive(Clone, Debug, PartialEq)]
pub struct Plane<T> {
    pub width: u32,
    pub height: u32,
    pub values: Vec<T>,
}

impl<T: Copy> Plane<T> {
    pub fn at(&self, x: u32, y: u32) -> T {
        self.values[y as usize * self.width as usize + x as usize]
    }
}
