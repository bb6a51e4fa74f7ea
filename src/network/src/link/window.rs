//! Replay protection of a session: an anti-replay window over sequence numbers.

use city3d_protocol::wire::DropReason;

/// Sequence numbers behind the newest one that the window covers.
pub const WIDTH: u64 = 1024;
const WORDS: usize = (WIDTH / 64) as usize;

/// Sliding anti-replay window (RFC 4303, section 3.4.3) kept as a ring of words (RFC 6479).
///
/// ```
/// use city3d_network::link::AntiReplayWindow;
/// use city3d_protocol::wire::DropReason;
///
/// let mut window = AntiReplayWindow::default();
/// for sequence in [1, 3, 2] {
///     assert!(window.check(sequence).is_ok());
///     window.mark_received(sequence);
/// }
/// assert_eq!(window.check(2), Err(DropReason::Duplicate));
/// assert_eq!(window.missing(), 0);
/// ```
#[derive(Clone, Debug)]
pub struct AntiReplayWindow {
    newest: u64,
    /// One bit per sequence number, at its remainder by [`WIDTH`].
    seen: [u64; WORDS],
    missing: u64,
}

impl Default for AntiReplayWindow {
    fn default() -> Self {
        Self { newest: 0, seen: [0; WORDS], missing: 0 }
    }
}

fn slot(sequence: u64) -> (usize, u64) {
    ((sequence % WIDTH / 64) as usize, 1 << (sequence % 64))
}

impl AntiReplayWindow {
    /// Whether a sequence number is new.
    ///
    /// # Errors
    /// The reason to drop its datagram.
    pub fn check(&self, sequence: u64) -> Result<(), DropReason> {
        if sequence == 0 {
            return Err(DropReason::Malformed);
        }
        if sequence > self.newest {
            return Ok(());
        }
        if self.newest - sequence >= WIDTH {
            return Err(DropReason::Stale);
        }
        if self.has(sequence) { Err(DropReason::Duplicate) } else { Ok(()) }
    }

    fn has(&self, sequence: u64) -> bool {
        let (word, bit) = slot(sequence);
        self.seen[word] & bit != 0
    }

    /// Marks a number that [`AntiReplayWindow::check`] has accepted as received.
    pub fn mark_received(&mut self, sequence: u64) {
        if sequence <= self.newest {
            self.missing = self.missing.saturating_sub(1);
        } else {
            if sequence - self.newest >= WIDTH {
                // A gap this wide is no loss: the sender has skipped the numbers.
                self.seen = [0; WORDS];
            } else {
                self.missing += sequence - self.newest - 1;
                for skipped in self.newest + 1..=sequence {
                    let (word, bit) = slot(skipped);
                    self.seen[word] &= !bit;
                }
            }
            self.newest = sequence;
        }
        let (word, bit) = slot(sequence);
        self.seen[word] |= bit;
    }

    /// Whether `count` sequence numbers from `first` on have all come.
    pub fn has_all(&self, first: u64, count: u32) -> bool {
        let Some(end) = first.checked_add(count.into()) else { return false };
        count == 0
            || (first > 0
                && end - 1 <= self.newest
                && self.newest - first < WIDTH
                && (first..end).all(|sequence| self.has(sequence)))
    }

    /// The largest sequence number that has come; 0 before the first.
    pub fn newest(&self) -> u64 {
        self.newest
    }

    /// Sequence numbers up to the newest one that have not come.
    pub fn missing(&self) -> u64 {
        self.missing
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_sequence_passes_once_within_the_window() {
        let mut window = AntiReplayWindow::default();
        assert_eq!(window.check(0), Err(DropReason::Malformed));
        for sequence in [5, 3, 2000, 1500] {
            assert_eq!(window.check(sequence), Ok(()), "{sequence}");
            window.mark_received(sequence);
            assert_eq!(window.check(sequence), Err(window.refusal(sequence)), "{sequence}");
        }
        assert_eq!(window.check(976), Err(DropReason::Stale));
        assert_eq!(window.check(977), Ok(()));
        assert_eq!(window.check(u64::MAX), Ok(()));
        window.mark_received(u64::MAX);
        assert_eq!(window.check(2001), Err(DropReason::Stale));
    }

    impl AntiReplayWindow {
        fn refusal(&self, sequence: u64) -> DropReason {
            if sequence + WIDTH <= self.newest { DropReason::Stale } else { DropReason::Duplicate }
        }
    }

    #[test]
    fn a_slot_is_free_again_when_the_window_has_gone_round() {
        let mut window = AntiReplayWindow::default();
        for sequence in 1..=3000 {
            assert_eq!(window.check(sequence), Ok(()));
            if sequence % 3 != 0 {
                window.mark_received(sequence);
            }
        }
        assert_eq!(window.check(2997), Ok(()), "left out, and not far behind");
        assert_eq!(window.check(2998), Err(DropReason::Duplicate));
        assert_eq!(window.missing(), 999);
    }

    #[test]
    fn the_largest_numbers_do_not_overflow() {
        let mut window = AntiReplayWindow::default();
        window.mark_received(u64::MAX - 1);
        assert_eq!(window.check(u64::MAX - 1), Err(DropReason::Duplicate));
        assert_eq!(window.check(u64::MAX - 2), Ok(()));
        assert_eq!(window.check(1), Err(DropReason::Stale));
        assert!(window.has_all(u64::MAX - 1, 1) && !window.has_all(u64::MAX - 1, 2));
    }

    #[test]
    fn a_range_is_whole_or_not() {
        let mut window = AntiReplayWindow::default();
        (10..20).for_each(|sequence| window.mark_received(sequence));
        assert!(window.has_all(10, 10) && window.has_all(0, 0) && window.has_all(99, 0));
        assert!(!window.has_all(9, 2) && !window.has_all(19, 2) && !window.has_all(0, 1));
        assert!(!window.has_all(10, u32::MAX) && !window.has_all(u64::MAX, 2));
    }
}
