//! Reports at intervals how many datagrams the link of a served city has lost or dropped.

use city3d_network::link::LinkCounters;
use std::time::{Duration, Instant};

/// Shortest interval between two reports.
const INTERVAL: Duration = Duration::from_secs(5);

/// Compares the counters of a link with those of the last report.
#[derive(Debug)]
pub(super) struct LossReporter {
    reported_at: Instant,
    before: LinkCounters,
}

impl LossReporter {
    pub(super) fn new(now: Instant) -> Self {
        Self { reported_at: now, before: LinkCounters::default() }
    }

    pub(super) fn is_due(&self, now: Instant) -> bool {
        now.saturating_duration_since(self.reported_at) >= INTERVAL
    }

    /// The message about the time since the last report, where anything was lost.
    pub(super) fn since(&mut self, now: Instant, counts: LinkCounters) -> Option<String> {
        let lasting_s = now.saturating_duration_since(self.reported_at).as_secs_f64();
        let before = std::mem::replace(&mut self.before, counts);
        self.reported_at = now;
        let LinkCounters { received, missing, dropped, .. } = &self.before;
        // A late datagram is no longer missing.
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
            "link, last {lasting_s:.0} s: {received} datagrams received, {missing} missing, dropped: {reasons}"
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use city3d_protocol::wire::{DropCounts, DropReason};

    #[test]
    fn each_loss_is_reported_once() {
        let begun = Instant::now();
        let mut reporter = LossReporter::new(begun);
        assert!(!reporter.is_due(begun + Duration::from_secs(4)) && reporter.is_due(begun + INTERVAL));
        let mut counts =
            LinkCounters { received: 900, used: 900, missing: 0, dropped: DropCounts::default() };
        assert_eq!(reporter.since(begun + INTERVAL, counts.clone()), None);
        counts.dropped.count(DropReason::Stale);
        counts.dropped.count(DropReason::Stale);
        (counts.received, counts.missing) = (1900, 50);
        let message = reporter.since(begun + INTERVAL * 2, counts.clone()).unwrap();
        assert_eq!(message, "link, last 5 s: 1000 datagrams received, 50 missing, dropped: 2 stale");
        counts.received = 2000;
        assert_eq!(reporter.since(begun + INTERVAL * 3, counts.clone()), None);
        counts.dropped.count(DropReason::Reordered);
        let message = reporter.since(begun + INTERVAL * 4, counts).unwrap();
        assert!(message.ends_with("0 missing, dropped: 1 reordered"), "{message}");
    }
}
