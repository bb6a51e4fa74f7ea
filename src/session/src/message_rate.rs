//! How many messages a peer may send.

use std::time::{Duration, Instant};

/// Messages are counted in windows of this length.
const WINDOW: Duration = Duration::from_secs(1);

/// Limits the messages of one peer to so many a second.
#[derive(Clone, Copy, Debug)]
pub struct MessageRate {
    most: u32,
    /// When the present window began.
    since: Instant,
    count: u32,
}

impl MessageRate {
    /// At most so many messages in a second.
    pub fn new(most: u32, now: Instant) -> Self {
        Self { most, since: now, count: 0 }
    }

    /// Counts a message; `false` where it is one too many.
    pub fn admits(&mut self, now: Instant) -> bool {
        if now.saturating_duration_since(self.since) > WINDOW {
            (self.since, self.count) = (now, 0);
        }
        self.count += 1;
        self.count <= self.most
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn as_many_as_are_allowed_come_in_each_second() {
        let begin = Instant::now();
        let mut rate = MessageRate::new(3, begin);
        let at = |ms| begin + Duration::from_millis(ms);
        let admitted = [0, 10, 20, 30, 1000, 1001, 1002, 1003, 1004].map(|ms| rate.admits(at(ms)));
        assert_eq!(admitted, [true, true, true, false, false, true, true, true, false]);
    }
}
