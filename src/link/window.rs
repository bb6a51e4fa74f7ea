//! Which sequences of a session have come.

use crate::wire::DropReason;

/// So many sequences behind the newest one are remembered.
pub const WIDTH: u64 = 1024;
const WORDS: usize = (WIDTH / 64) as usize;

/// A sliding window over the sequences of a session.
#[derive(Clone, Debug)]
pub struct Window {
    newest: u64,
    /// A bit for each sequence, by its remainder.
    seen: [u64; WORDS],
    missing: u64,
}

impl Default for Window {
    fn default() -> Self {
        Self { newest: 0, seen: [0; WORDS], missing: 0 }
    }
}

fn place(sequence: u64) -> (usize, u64) {
    ((sequence % WIDTH / 64) as usize, 1 << (sequence % 64))
}

impl Window {
    /// Whether a sequence has not come yet.
    ///
    /// # Errors
    /// Why it must not be used.
    pub fn check(&self, sequence: u64) -> Result<(), DropReason> {
        if sequence == 0 {
            return Err(DropReason::Malformed);
        }
        if sequence > self.newest {
            return Ok(());
        }
        if sequence + WIDTH <= self.newest {
            return Err(DropReason::Stale);
        }
        if self.has(sequence) { Err(DropReason::Duplicate) } else { Ok(()) }
    }

    fn has(&self, sequence: u64) -> bool {
        let (word, bit) = place(sequence);
        self.seen[word] & bit != 0
    }

    /// Notes one that [`Window::check`] has let pass.
    pub fn note(&mut self, sequence: u64) {
        if sequence <= self.newest {
            self.missing = self.missing.saturating_sub(1);
        } else {
            if sequence - self.newest >= WIDTH {
                // No loss of so many: the sender has left them out.
                self.seen = [0; WORDS];
            } else {
                self.missing += sequence - self.newest - 1;
                for gone in self.newest + 1..=sequence {
                    let (word, bit) = place(gone);
                    self.seen[word] &= !bit;
                }
            }
            self.newest = sequence;
        }
        let (word, bit) = place(sequence);
        self.seen[word] |= bit;
    }

    /// Whether all of so many sequences from one on have come.
    pub fn has_all(&self, first: u64, count: u32) -> bool {
        let Some(end) = first.checked_add(count.into()) else { return false };
        count == 0
            || (first > 0
                && end - 1 <= self.newest
                && first + WIDTH > self.newest
                && (first..end).all(|sequence| self.has(sequence)))
    }

    /// How many of those up to the newest one have not come.
    pub fn missing(&self) -> u64 {
        self.missing
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_sequence_passes_once_within_the_window() {
        let mut window = Window::default();
        assert_eq!(window.check(0), Err(DropReason::Malformed));
        for sequence in [5, 3, 2000, 1500] {
            assert_eq!(window.check(sequence), Ok(()), "{sequence}");
            window.note(sequence);
            assert_eq!(window.check(sequence), Err(window.refusal(sequence)), "{sequence}");
        }
        assert_eq!(window.check(976), Err(DropReason::Stale));
        assert_eq!(window.check(977), Ok(()));
        assert_eq!(window.check(u64::MAX), Ok(()));
        window.note(u64::MAX);
        assert_eq!(window.check(2001), Err(DropReason::Stale));
    }

    impl Window {
        fn refusal(&self, sequence: u64) -> DropReason {
            if sequence + WIDTH <= self.newest { DropReason::Stale } else { DropReason::Duplicate }
        }
    }

    #[test]
    fn a_slot_is_free_again_when_the_window_has_gone_round() {
        let mut window = Window::default();
        for sequence in 1..=3000 {
            assert_eq!(window.check(sequence), Ok(()));
            if sequence % 3 != 0 {
                window.note(sequence);
            }
        }
        assert_eq!(window.check(2997), Ok(()), "left out, and not far behind");
        assert_eq!(window.check(2998), Err(DropReason::Duplicate));
        assert_eq!(window.missing(), 999);
    }

    #[test]
    fn a_range_is_whole_or_not() {
        let mut window = Window::default();
        (10..20).for_each(|sequence| window.note(sequence));
        assert!(window.has_all(10, 10) && window.has_all(0, 0) && window.has_all(99, 0));
        assert!(!window.has_all(9, 2) && !window.has_all(19, 2) && !window.has_all(0, 1));
        assert!(!window.has_all(10, u32::MAX) && !window.has_all(u64::MAX, 2));
    }
}
