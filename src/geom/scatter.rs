//! Numbers that look drawn and are the same every time: variety of what is only looked at.

/// A well-mixed number in [0, 1) for a number whose bits are mixed badly or not at all.
pub fn unit(mut h: u32) -> f32 {
    h ^= h >> 15;
    h = h.wrapping_mul(0x2C1B_3C6D);
    h ^= h >> 12;
    h = h.wrapping_mul(0x297A_2D39);
    h ^= h >> 15;
    (h >> 8) as f32 / (1 << 24) as f32
}
