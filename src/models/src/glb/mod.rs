//! glTF 2.0 binary files (GLB): reads any with triangles.
//!
//! Files have y up and z forward (Khronos, glTF 2.0, section 3.4); models have z up and x forward.

mod accessor;
mod read;

pub use read::{ModelError, read};

use glam::Vec3;

/// Most triangles of a file, and of all its nodes: a mesh counts once for each node that shows it.
pub const MOST_TRIANGLES: usize = 500_000;
/// Most vertices of a file, and of all its nodes. Without normals each triangle has vertices of its own.
pub const MOST_VERTICES: usize = 3 * MOST_TRIANGLES;

fn from_file([x, y, z]: [f32; 3]) -> Vec3 {
    Vec3::new(z, x, y)
}

fn srgb_from_linear(value: f32) -> u8 {
    let c = value.clamp(0.0, 1.0);
    let s = if c <= 0.003_130_8 { c * 12.92 } else { 1.055 * c.powf(1.0 / 2.4) - 0.055 };
    (s * 255.0).round() as u8
}

/// A linear colour component of an sRGB one.
pub fn linear_from_srgb(value: u8) -> f32 {
    let c = f32::from(value) / 255.0;
    if c <= 0.040_45 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shipped;

    #[test]
    fn no_cut_and_no_flipped_byte_brings_the_reader_down() {
        let good = shipped("sedan.glb").expect("it is shipped").to_vec();
        for cut in (0..good.len()).step_by(37).chain(0..64) {
            assert!(read(&good[..cut]).is_err(), "cut off after {cut} bytes");
        }
        // Bytes of the header, of the text and of the numbers behind it.
        let text = u32::from_le_bytes([good[12], good[13], good[14], good[15]]) as usize;
        for at in (0..24).chain((24..text).step_by(7)).chain((text..good.len()).step_by(997)) {
            for flip in [0x01, 0x10, 0x80] {
                let mut bytes = good.clone();
                bytes[at] ^= flip;
                let _ = read(&bytes);
            }
        }
    }
}
