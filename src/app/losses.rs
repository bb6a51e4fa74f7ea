//! What the link of a served city has lost lately, said while it runs.

use crate::wire::Drops;
use std::time::{Duration, Instant};

/// No more often than this.
const EVERY: Duration = Duration::from_secs(5);

/// What has come over a link, and what has not.
#[derive(Clone, Debug, Default)]
pub(super) struct Counts {
    pub(super) received: u64,
    pub(super) missing: u64,
    pub(super) dropped: Drops,
}

#[derive(Debug)]
pub(super) struct Losses {
    told: Instant,
    before: Counts,
}

impl Losses {
    pub(super) fn new(now: Instant) -> Self {
        Self { told: now, before: Counts::default() }
    }

    pub(super) fn is_due(&self, now: Instant) -> bool {
        now.saturating_duration_since(self.told) >= EVERY
    }

    /// What there is to say since the last time, if anything has been lost.
    pub(super) fn since(&mut self, now: Instant, counts: Counts) -> Option<String> {
        let lasting_s = now.saturating_duration_since(self.told).as_secs_f64();
        let before = std::mem::replace(&mut self.before, counts);
        self.told = now;
        let Counts { received, missing, dropped } = &self.before;
        // One that was late is missing no more.
        let (received, missing) = (received - before.received, missing.saturating_sub(before.missing));
        let reasons: Vec<String> = dropped
            .iter()
            .map(|(reason, count)| (reason, count - before.dropped.of(reason)))
            .filter(|(_, count)| *count > 0)
            .map(|(reason, count)| format!("{count} {}", reason.label()))
            .collect();
        if reasons.is_empty() && missing == 0 {
            return None;
        }
        let reasons = if reasons.is_empty() { "none".to_owned() } else { reasons.join(", ") };
        Some(format!(
            "link, last {lasting_s:.0} s: {received} datagrams have come, {missing} are missing, dropped: {reasons}"
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::DropReason;

    #[test]
    fn what_is_new_is_said_once() {
        let begun = Instant::now();
        let mut losses = Losses::new(begun);
        assert!(!losses.is_due(begun + Duration::from_secs(4)) && losses.is_due(begun + EVERY));
        let mut counts = Counts { received: 900, missing: 0, dropped: Drops::default() };
        assert_eq!(losses.since(begun + EVERY, counts.clone()), None);
        counts.dropped.count(DropReason::Stale);
        counts.dropped.count(DropReason::Stale);
        (counts.received, counts.missing) = (1900, 50);
        let told = losses.since(begun + EVERY * 2, counts.clone()).unwrap();
        assert_eq!(told, "link, last 5 s: 1000 datagrams have come, 50 are missing, dropped: 2 stale");
        counts.received = 2000;
        assert_eq!(losses.since(begun + EVERY * 3, counts.clone()), None);
        counts.dropped.count(DropReason::Reordered);
        let told = losses.since(begun + EVERY * 4, counts).unwrap();
        assert!(told.ends_with("0 are missing, dropped: 1 reordered"), "{told}");
    }
}
