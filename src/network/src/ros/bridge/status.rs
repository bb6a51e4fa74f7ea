//! Status messages of a rosbridge server (protocol 2.0, section 3.2.1): rate-limits their log, and logs each text once.

use serde::Deserialize;
use serde_json::Value;
use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// Texts that are remembered; the oldest is forgotten for another and may be logged again.
const MAX_KNOWN: usize = 256;
/// Rate limit: new texts per minute.
const MAX_PER_MINUTE: usize = 10;
const MINUTE: Duration = Duration::from_secs(60);
/// Characters of a text that are logged.
const MAX_TEXT_CHARS: usize = 400;

/// Status message of a server about an operation of its client.
#[derive(Debug, Deserialize)]
pub(super) struct BridgeStatus {
    #[serde(default)]
    level: String,
    #[serde(default)]
    msg: Value,
}

/// Severity of a status message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Severity {
    Error,
    Warning,
    Other,
}

impl BridgeStatus {
    pub(super) fn level(&self) -> Severity {
        match self.level.as_str() {
            "error" => Severity::Error,
            // rosbridge_suite writes both.
            "warning" | "warn" => Severity::Warning,
            _ => Severity::Other,
        }
    }

    /// The text without control characters, which could control a terminal.
    pub(super) fn text(&self) -> String {
        let text = self.msg.as_str().map_or_else(|| self.msg.to_string(), str::to_owned);
        text.chars().map(|c| if c.is_control() { ' ' } else { c }).take(MAX_TEXT_CHARS).collect()
    }
}

/// Rate limiter over a set of texts (sliding window log).
#[derive(Debug, Default)]
pub(super) struct StatusLog {
    /// The oldest first.
    known: VecDeque<String>,
    /// Times of the texts of the last minute.
    recent: VecDeque<Instant>,
    withheld: u64,
}

impl StatusLog {
    /// The text to log now; `None` for a known text, or above the rate limit.
    pub(super) fn admit(&mut self, text: &str, now: Instant) -> Option<String> {
        if self.known.iter().any(|known| known == text) {
            return None;
        }
        self.recent.retain(|told| now.duration_since(*told) < MINUTE);
        if self.recent.len() >= MAX_PER_MINUTE {
            self.withheld += 1;
            return None;
        }
        self.recent.push_back(now);
        if self.known.len() >= MAX_KNOWN {
            self.known.pop_front();
        }
        self.known.push_back(text.to_owned());
        Some(match std::mem::take(&mut self.withheld) {
            0 => text.to_owned(),
            count => format!("{text} ({count} other messages were not shown)"),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_text_is_told_once() {
        let (mut log, now) = (StatusLog::default(), Instant::now());
        assert_eq!(log.admit("no such type", now), Some("no such type".to_owned()));
        for second in 0..600 {
            assert_eq!(log.admit("no such type", now + Duration::from_secs(second)), None);
        }
        assert_eq!(log.admit("not advertised", now), Some("not advertised".to_owned()));
    }

    #[test]
    fn texts_that_differ_each_time_are_told_ten_times_a_minute() {
        let (mut log, now) = (StatusLog::default(), Instant::now());
        let told =
            |log: &mut StatusLog, k: u64| log.admit(&format!("message {k}"), now + MINUTE * k as u32 / 100);
        assert_eq!((0..100).filter_map(|k| told(&mut log, k)).count(), 10);
        let next = told(&mut log, 101).unwrap();
        assert_eq!(next, "message 101 (90 other messages were not shown)");
        assert!((102..2000).filter_map(|k| told(&mut log, k)).count() <= 190);
        assert!(log.known.len() <= MAX_KNOWN);
    }

    #[test]
    fn words_are_those_of_the_server_and_steer_no_terminal() {
        let status: BridgeStatus =
            serde_json::from_str(r#"{"level": "error", "msg": "advertise: \u001b[2Jno type"}"#).unwrap();
        assert_eq!((status.level(), status.text().as_str()), (Severity::Error, "advertise:  [2Jno type"));
        let odd: BridgeStatus = serde_json::from_str(r#"{"level": "warn", "msg": {"why": 3}}"#).unwrap();
        assert_eq!((odd.level(), odd.text().as_str()), (Severity::Warning, r#"{"why":3}"#));
    }
}
