//! Progress display of long commands: a bar on a terminal, periodic lines where standard error is a file or a pipe.

use super::say::complain;
use city3d_session::{End, EndHealth, Moment};
use indicatif::{ProgressBar, ProgressStyle};
use std::cell::Cell;
use std::io::IsTerminal;
use std::time::{Duration, Instant};

/// Time between two lines where there is no terminal: short commands write none.
const LINE_EVERY: Duration = Duration::from_secs(10);

/// How far a run has come.
#[derive(Debug)]
pub struct Progress {
    duration_s: f64,
    bar: ProgressBar,
    /// Without a terminal: when the next line is due.
    line_due: Option<Cell<Instant>>,
}

/// Progress over simulated seconds.
pub fn simulated_seconds(duration_s: f64) -> Progress {
    let bar = ProgressBar::new((duration_s * 10.0).round() as u64);
    let style = ProgressStyle::with_template("{bar:40} {percent:>3} %  {msg}  {eta} left");
    // The template is ours and valid; the default style would do as well.
    if let Ok(style) = style {
        bar.set_style(style);
    }
    let is_terminal = std::io::stderr().is_terminal();
    let line_due = (!is_terminal).then(|| Cell::new(Instant::now() + LINE_EVERY));
    Progress { duration_s, bar, line_due }
}

/// Shows a simulated time.
pub fn show(progress: &Progress, time_s: f64) {
    match progress.line(time_s, Instant::now()) {
        Some(line) => complain(line),
        None => {
            progress.bar.set_position((time_s * 10.0) as u64);
            progress.bar.set_message(format!("{time_s:.1} s simulated"));
        }
    }
}

impl End for Progress {
    fn name(&self) -> &'static str {
        "progress"
    }

    fn take(&mut self, moment: &Moment<'_>) {
        if moment.snapshot.tick.is_multiple_of(100) {
            show(self, moment.snapshot.time_s);
        }
    }

    fn close(&mut self) {
        self.finish_and_clear();
    }

    fn health(&self) -> EndHealth {
        EndHealth::default()
    }
}

impl Progress {
    /// Removes the bar.
    pub fn finish_and_clear(&self) {
        self.bar.finish_and_clear();
    }

    /// The line that is due now, where there is no terminal.
    fn line(&self, time_s: f64, now: Instant) -> Option<String> {
        let due = self.line_due.as_ref()?;
        if now < due.get() {
            return None;
        }
        due.set(now + LINE_EVERY);
        let percent = (100.0 * time_s / self.duration_s).clamp(0.0, 100.0);
        Some(format!("{percent:.0} %: {time_s:.1} of {:.1} s simulated", self.duration_s))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_a_terminal_a_line_comes_every_ten_seconds() {
        let start = Instant::now();
        let line_due = Some(Cell::new(start + LINE_EVERY));
        let progress = Progress { duration_s: 40.0, bar: ProgressBar::hidden(), line_due };
        let lines = (0..=250).filter_map(|k| {
            let passed_s = f64::from(k) / 10.0;
            progress.line(passed_s, start + Duration::from_secs_f64(passed_s))
        });
        let expected = ["25 %: 10.0 of 40.0 s simulated", "50 %: 20.0 of 40.0 s simulated"];
        assert_eq!(lines.collect::<Vec<_>>(), expected);
    }
}
