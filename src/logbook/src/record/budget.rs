//! A bound on what compressed data may grow to: a small file must not keep the program busy for long.

use thiserror::Error;

/// Decompressed bytes that any file may have.
const FREE_BYTES: u64 = 64 << 20;
/// Decompressed bytes for each byte of the file. Logs of City3D have 2 to 11.
const LARGEST_RATIO: u64 = 50;

/// The compressed data of a file grow beyond the bound.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error(
    "its compressed data grow to more than {} MiB and {LARGEST_RATIO} times the size of the file; if they are \
     right, decompress the file first",
    FREE_BYTES >> 20
)]
pub(super) struct TooCompressed;

/// What is left of the bound of one file.
#[derive(Clone, Copy, Debug)]
pub(super) struct DecompressionBudget {
    left: u64,
}

impl DecompressionBudget {
    /// The bound of a file of so many bytes.
    pub(super) fn of_file(size: u64) -> Self {
        Self { left: FREE_BYTES.saturating_add(size.saturating_mul(LARGEST_RATIO)) }
    }

    /// Decompressed bytes that may follow.
    pub(super) fn left(&self) -> u64 {
        self.left
    }

    /// Takes decompressed bytes off the bound.
    ///
    /// # Errors
    /// When they exceed it.
    pub(super) fn take(&mut self, bytes: u64) -> Result<(), TooCompressed> {
        self.left = self.left.checked_sub(bytes).ok_or(TooCompressed)?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bound_grows_with_the_file_and_is_used_up() {
        let mut budget = DecompressionBudget::of_file(1 << 20);
        assert_eq!(budget.left(), 114 << 20);
        assert_eq!((budget.take(100 << 20), budget.take(14 << 20), budget.left()), (Ok(()), Ok(()), 0));
        assert_eq!(budget.take(1), Err(TooCompressed));
        assert_eq!(DecompressionBudget::of_file(u64::MAX).left(), u64::MAX);
    }
}
