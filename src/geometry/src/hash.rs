//! Hash-based pseudo-random numbers, for deterministic variety of appearance.

/// Hashes an integer to [0, 1): two rounds of xor-shift and multiply.
pub fn unit_f32(mut h: u32) -> f32 {
    h ^= h >> 15;
    h = h.wrapping_mul(0x2C1B_3C6D);
    h ^= h >> 12;
    h = h.wrapping_mul(0x297A_2D39);
    h ^= h >> 15;
    (h >> 8) as f32 / (1 << 24) as f32
}
