//! Text that leaves for a terminal. Names come from files and from the network: what controls a terminal is shown as an
//! escape. A closed pipe (`city3d run city --out out | head -3`) ends the output, not the command, whose exit code still
//! tells how it went.

use super::Failure;
pub use city3d_outputs::visible;
use std::fmt::Display;
use std::io::{ErrorKind, Write, stderr, stdout};

/// Prints a line.
///
/// # Errors
/// When it cannot be written for another reason than that nobody reads on.
pub fn say(line: impl Display) -> Result<(), Failure> {
    match writeln!(stdout(), "{}", visible(&line.to_string())) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            Err(Failure::failed(format!("standard output: {error}")))
        }
        _ => Ok(()),
    }
}

/// Prints a line to standard error. Where that is closed too there is nobody left to tell.
pub fn complain(line: impl Display) {
    let _ = writeln!(stderr(), "{}", visible(&line.to_string()));
}
