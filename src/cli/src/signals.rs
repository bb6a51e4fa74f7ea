//! Signals: those that end a command in order, and the one of the limit on file sizes.

use super::Failure;
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Exit code of a command that a second Ctrl-C ends, as shells count it: 128 and the number of the signal.
const EXIT_INTERRUPTED: i32 = 128 + SIGINT;

/// A flag that SIGINT, SIGTERM and SIGHUP set; the command then completes its files and ends. A second SIGINT ends the
/// program at once.
///
/// # Errors
/// When the operating system refuses a handler.
pub fn on_end() -> Result<Arc<AtomicBool>, Failure> {
    let ends = Arc::new(AtomicBool::new(false));
    end_at_second_interrupt().map_err(Failure::failed)?;
    for signal in ending() {
        flag::register(signal, Arc::clone(&ends)).map_err(Failure::failed)?;
    }
    Ok(ends)
}

/// Calls this at each signal that [`on_end`] knows, on a thread of its own, for what waits for something else.
///
/// # Errors
/// When the operating system refuses a handler or the thread.
#[cfg(any(feature = "web", feature = "window"))]
pub fn at_end(told: impl Fn() + Send + 'static) -> Result<(), Failure> {
    end_at_second_interrupt().map_err(Failure::failed)?;
    let mut signals = signal_hook::iterator::Signals::new(ending()).map_err(Failure::failed)?;
    let wait = move || signals.forever().for_each(|_| told());
    let thread = std::thread::Builder::new().name("signals".to_owned()).spawn(wait);
    thread.map(drop).map_err(Failure::failed)
}

/// The signals that end a command in order.
fn ending() -> Vec<i32> {
    let mut signals = vec![SIGINT, SIGTERM];
    #[cfg(unix)]
    if !survives_hangup() {
        signals.push(signal_hook::consts::SIGHUP);
    }
    signals
}

/// Ends the program at once when SIGINT comes again.
fn end_at_second_interrupt() -> std::io::Result<()> {
    // A terminal that closes may send several signals: only a person who repeats Ctrl-C is in a hurry.
    let is_interrupted = Arc::new(AtomicBool::new(false));
    flag::register_conditional_shutdown(SIGINT, EXIT_INTERRUPTED, Arc::clone(&is_interrupted))?;
    flag::register(SIGINT, is_interrupted).map(drop)
}

/// Whether the command was started to outlive its terminal, as by `nohup`, which ignores SIGHUP.
#[cfg(unix)]
fn survives_hangup() -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let mask = ignored.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or(0);
    mask & (1 << (signal_hook::consts::SIGHUP - 1)) != 0
}

/// Lets writing beyond the limit on file sizes (`ulimit -f`) fail with its error, which names the file, instead of
/// ending the program without a word.
///
/// # Errors
/// When the operating system refuses a handler.
pub fn survive_file_limit() -> Result<(), Failure> {
    #[cfg(unix)]
    flag::register(signal_hook::consts::SIGXFSZ, Arc::default()).map_err(Failure::failed)?;
    Ok(())
}
