//! State digest of a world: FNV-1a over 64-bit words.
//!
//! Two runs of an experiment that get the same vehicles are equal when their digests are equal at every tick. The digest
//! covers the state that determines the future, not only the visible part. It excludes how vehicles are built, whether
//! the clock runs, and the contact caches of the physics, which follow from the states of earlier ticks. Control and the emulated network are outside the world; they
//! affect the digest as soon as their commands arrive.

use crate::{Frame, Pose2};
use glam::{DQuat, DVec2, DVec3};

/// Incremented when the same experiment and commands lead to other states, or the same states to other
/// digests. Logs of another revision cannot be replayed bit by bit.
pub const REVISION: u32 = 3;

/// State that determines the future of a run.
pub trait Digest {
    /// Adds all of its state to a digest.
    fn digest(&self, hash: &mut StateHash);
}

/// FNV-1a hash over 64-bit words: the same on every machine.
#[derive(Clone, Copy, Debug)]
pub struct StateHash(u64);

const OFFSET: u64 = 0xcbf2_9ce4_8422_2325;
const PRIME: u64 = 0x0000_0100_0000_01b3;

impl Default for StateHash {
    fn default() -> Self {
        Self(OFFSET)
    }
}

impl StateHash {
    /// The digest of all that was added.
    pub fn finish(self) -> u64 {
        self.0
    }

    /// Adds a word; the order of the calls counts.
    pub fn word(&mut self, word: u64) {
        // Multiplication alone never moves high bits down; the shift does.
        self.0 = (self.0 ^ word ^ (self.0 >> 29)).wrapping_mul(PRIME);
    }

    /// Adds a number by its bits, so that 0.0 and -0.0 differ.
    pub fn number(&mut self, number: f64) {
        self.word(number.to_bits());
    }

    /// Adds numbers in their order, without their count.
    pub fn numbers(&mut self, numbers: impl IntoIterator<Item = f64>) {
        numbers.into_iter().for_each(|number| self.number(number));
    }

    /// Hashes presence and value.
    pub fn optional(&mut self, number: Option<f64>) {
        self.flags([number.is_some()]);
        self.numbers(number);
    }

    /// Up to 64 flags in one word.
    pub fn flags<const N: usize>(&mut self, flags: [bool; N]) {
        const { assert!(N <= 64) };
        self.word(flags.into_iter().fold(0, |word, flag| word << 1 | u64::from(flag)));
    }

    /// Adds each part in its order, without their count.
    pub fn all<'a, D: Digest + 'a>(&mut self, parts: impl IntoIterator<Item = &'a D>) {
        parts.into_iter().for_each(|part| part.digest(self));
    }
}

impl Digest for DVec2 {
    fn digest(&self, hash: &mut StateHash) {
        hash.numbers(self.to_array());
    }
}

impl Digest for DVec3 {
    fn digest(&self, hash: &mut StateHash) {
        hash.numbers(self.to_array());
    }
}

impl Digest for DQuat {
    fn digest(&self, hash: &mut StateHash) {
        hash.numbers(self.to_array());
    }
}

impl<F: Frame> Digest for Pose2<F> {
    fn digest(&self, hash: &mut StateHash) {
        self.position.digest(hash);
        hash.number(self.yaw_rad);
    }
}

impl<D: Digest> Digest for Option<D> {
    fn digest(&self, hash: &mut StateHash) {
        hash.flags([self.is_some()]);
        hash.all(self);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(add: impl Fn(&mut StateHash)) -> u64 {
        let mut hash = StateHash::default();
        add(&mut hash);
        hash.finish()
    }

    /// Fixed for ever: logs hold digests.
    #[test]
    fn digests_are_those_of_all_versions() {
        assert_eq!(of(|_| {}), 0xcbf2_9ce4_8422_2325);
        assert_eq!(of(|hash| hash.numbers([1.0, -0.0, 1e-300])), 0xe300_c7dc_e5dc_303d);
    }

    #[test]
    fn any_bit_and_the_order_count() {
        let base = of(|hash| hash.numbers([0.1, 0.2]));
        assert_ne!(base, of(|hash| hash.numbers([0.2, 0.1])));
        assert_ne!(base, of(|hash| hash.numbers([0.1, f64::from_bits(0.2_f64.to_bits() ^ 1)])));
        assert_ne!(of(|hash| hash.optional(None)), of(|hash| hash.optional(Some(0.0))));
        assert_ne!(of(|hash| hash.flags([true, false])), of(|hash| hash.flags([false, true])));
    }
}
