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
    // A terminal that closes may send several signals: only a person who repeats Ctrl-C is in a hurry.
    let is_interrupted = Arc::new(AtomicBool::new(false));
    let register = || -> std::io::Result<()> {
        flag::register_conditional_shutdown(SIGINT, EXIT_INTERRUPTED, Arc::clone(&is_interrupted))?;
        flag::register(SIGINT, Arc::clone(&is_interrupted))?;
        for signal in [SIGINT, SIGTERM] {
            flag::register(signal, Arc::clone(&ends))?;
        }
        #[cfg(unix)]
        if !survives_hangup() {
            flag::register(signal_hook::consts::SIGHUP, Arc::clone(&ends))?;
        }
        Ok(())
    };
    register().map_err(Failure::failed)?;
    Ok(ends)
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
