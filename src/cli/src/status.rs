//! What a command of the laboratory does, while it does it: one line that renews itself on a terminal, plain lines at
//! intervals elsewhere.

use super::say::{complain, visible};
use city3d_session::{EndStatus, LinkStatus, OnReport, RunPhase, SessionReport};
use std::io::{IsTerminal, Write, stderr};
use std::time::{Duration, Instant};

/// Time between two lines where there is no terminal: the first comes soon.
const LINE_EVERY: Duration = Duration::from_secs(10);
const FIRST_LINE: Duration = Duration::from_secs(2);

/// A line of status on standard error.
#[derive(Debug)]
pub struct StatusLine {
    is_terminal: bool,
    /// Without a terminal: when the next line is due.
    due: Instant,
    /// Length of the line that stands on the terminal.
    shown: usize,
}

impl StatusLine {
    pub fn new() -> Self {
        Self { is_terminal: stderr().is_terminal(), due: Instant::now() + FIRST_LINE, shown: 0 }
    }

    /// Shows a line, in place of the one before.
    pub fn show(&mut self, line: &str) {
        if self.is_terminal {
            let line = visible(line).replace('\n', " ");
            let width = self.shown.max(line.chars().count());
            // Where standard error is closed there is nobody left to tell.
            let _ = write!(stderr(), "\r{line:width$}");
            let _ = stderr().flush();
            self.shown = line.chars().count();
        } else if self.is_due(Instant::now()) {
            complain(line);
        }
    }

    fn is_due(&mut self, now: Instant) -> bool {
        let is_due = now >= self.due;
        if is_due {
            self.due = now + LINE_EVERY;
        }
        is_due
    }
}

impl Drop for StatusLine {
    fn drop(&mut self) {
        if self.shown > 0 {
            let _ = writeln!(stderr());
        }
    }
}

/// Shows the reports of a session on a line.
pub fn reporter() -> OnReport {
    let mut line = StatusLine::new();
    Box::new(move |report| line.show(&line_of(report)))
}

/// A report in one line: time, vehicles, link, losses, and what does not work.
fn line_of(report: &SessionReport) -> String {
    let mut parts = vec![match &report.phase {
        RunPhase::Running => {
            format!("{:.1} s, {:.2} times real time", report.time_s, report.real_time_factor)
        }
        phase => format!("{:.1} s, {}", report.time_s, phase.label()),
    }];
    parts.push(match report.vehicles {
        1 => "1 vehicle".to_owned(),
        count => format!("{count} vehicles"),
    });
    parts.extend(report.link.iter().flat_map(link_parts));
    parts.extend(report.ends.iter().filter_map(end_part));
    parts.join(" | ")
}

fn link_parts(link: &LinkStatus) -> Vec<String> {
    if let Some(trouble) = &link.trouble {
        return vec![trouble.clone()];
    }
    let mut parts = vec![format!("{:.0} datagrams/s", link.received_per_s)];
    if !link.is_remote {
        let leader = link.leader.as_deref().unwrap_or("nobody");
        parts.push(format!("{leader} leads, {} subscribed", link.subscribers));
    }
    if link.missing + link.dropped > 0 {
        parts.push(format!("{} missing, {} dropped", link.missing, link.dropped));
    }
    parts
}

fn end_part(end: &EndStatus) -> Option<String> {
    match &end.failure {
        Some(why) => Some(format!("{}: {why}", end.name)),
        None if end.dropped > 0 => Some(format!("{}: {} dropped", end.name, end.dropped)),
        None => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_names_what_goes_on_and_what_does_not() {
        let link = LinkStatus {
            leader: Some("127.0.0.1:4000".to_owned()),
            subscribers: 2,
            received_per_s: 312.4,
            missing: 3,
            ..LinkStatus::default()
        };
        let ros = EndStatus {
            name: "ros".to_owned(),
            failure: Some("its master or server is away".to_owned()),
            ..EndStatus::default()
        };
        let report = SessionReport {
            time_s: 12.34,
            phase: RunPhase::Running,
            vehicles: 6,
            real_time_factor: 1.0,
            link: Some(link),
            ends: vec![ros],
        };
        assert_eq!(
            line_of(&report),
            "12.3 s, 1.00 times real time | 6 vehicles | 312 datagrams/s | 127.0.0.1:4000 leads, 2 subscribed | \
             3 missing, 0 dropped | ros: its master or server is away"
        );
        let remote = LinkStatus { is_remote: true, received_per_s: 100.0, ..LinkStatus::default() };
        let report = SessionReport {
            phase: RunPhase::Paused,
            vehicles: 1,
            link: Some(remote),
            ends: Vec::new(),
            ..report
        };
        assert_eq!(line_of(&report), "12.3 s, paused | 1 vehicle | 100 datagrams/s");
    }

    #[test]
    fn without_a_terminal_lines_are_rare() {
        let start = Instant::now();
        let mut line = StatusLine { is_terminal: false, due: start + FIRST_LINE, shown: 0 };
        let shown = (0..=500).filter(|tenths| line.is_due(start + Duration::from_millis(100 * tenths)));
        assert_eq!(shown.collect::<Vec<_>>(), [20, 120, 220, 320, 420]);
    }
}
