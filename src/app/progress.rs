//! The progress bar of long commands.

use indicatif::{ProgressBar, ProgressStyle};

/// A bar over simulated seconds, on the terminal alone: nothing is drawn where output is not one.
pub fn simulated_seconds(duration_s: f64) -> ProgressBar {
    let bar = ProgressBar::new((duration_s * 10.0).round() as u64);
    let style = ProgressStyle::with_template("{bar:40} {percent:>3} %  {msg}  {eta} left");
    // The template is ours and valid; the default style would do as well.
    if let Ok(style) = style {
        bar.set_style(style);
    }
    bar
}

/// Moves the bar to a simulated time.
pub fn show(bar: &ProgressBar, time_s: f64) {
    bar.set_position((time_s * 10.0) as u64);
    bar.set_message(format!("{time_s:.1} s simulated"));
}
