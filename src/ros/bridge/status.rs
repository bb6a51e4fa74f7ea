//! Status messages of a rosbridge server (protocol 2.0, section 3.2.1), told to the user: each text once, and only so
//! many a minute.

use serde::Deserialize;
use serde_json::Value;
use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// Texts that are remembered; of more, the oldest is forgotten and may be told again.
const MOST_KNOWN: usize = 256;
/// New texts that are told within a minute.
const MOST_A_MINUTE: usize = 10;
const MINUTE: Duration = Duration::from_secs(60);
/// Characters of a text that are told.
const LONGEST_TEXT: usize = 400;

/// What a server says about an operation of its client.
#[derive(Debug, Deserialize)]
pub(super) struct Status {
    #[serde(default)]
    level: String,
    #[serde(default)]
    msg: Value,
}

/// How grave a status is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Level {
    Error,
    Warning,
    Other,
}

impl Status {
    pub(super) fn level(&self) -> Level {
        match self.level.as_str() {
            "error" => Level::Error,
            // rosbridge_suite writes both.
            "warning" | "warn" => Level::Warning,
            _ => Level::Other,
        }
    }

    /// The server's words, without what could steer a terminal.
    pub(super) fn text(&self) -> String {
        let text = self.msg.as_str().map_or_else(|| self.msg.to_string(), str::to_owned);
        text.chars().map(|c| if c.is_control() { ' ' } else { c }).take(LONGEST_TEXT).collect()
    }
}

/// Which texts have been told: a rate limit over a set of texts.
#[derive(Debug, Default)]
pub(super) struct StatusLog {
    /// The oldest first.
    known: VecDeque<String>,
    /// When the last texts were told, at most as many as are told within a minute.
    recent: VecDeque<Instant>,
    withheld: u64,
}

impl StatusLog {
    /// What to tell of a text that has come now: nothing of one that is known, and nothing while too many are new.
    pub(super) fn admit(&mut self, text: &str, now: Instant) -> Option<String> {
        if self.known.iter().any(|known| known == text) {
            return None;
        }
        self.recent.retain(|told| now.duration_since(*told) < MINUTE);
        if self.recent.len() >= MOST_A_MINUTE {
            self.withheld += 1;
            return None;
        }
        self.recent.push_back(now);
        if self.known.len() >= MOST_KNOWN {
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
        assert!(log.known.len() <= MOST_KNOWN);
    }

    #[test]
    fn words_are_those_of_the_server_and_steer_no_terminal() {
        let status: Status =
            serde_json::from_str(r#"{"level": "error", "msg": "advertise: \u001b[2Jno type"}"#).unwrap();
        assert_eq!((status.level(), status.text().as_str()), (Level::Error, "advertise:  [2Jno type"));
        let odd: Status = serde_json::from_str(r#"{"level": "warn", "msg": {"why": 3}}"#).unwrap();
        assert_eq!((odd.level(), odd.text().as_str()), (Level::Warning, r#"{"why":3}"#));
    }
}
