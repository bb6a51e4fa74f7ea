//! Results of commands on a disk: files that appear under their names when they are whole ([`WholeFile`]), folders that
//! have one writer at a time ([`OutputFolder`]), inputs that no command writes over ([`refuse_inputs`]),
//! and text that no terminal obeys ([`visible`]).

#![allow(clippy::disallowed_types, reason = "writes files")]

mod error;
mod folder;
mod inputs;
mod terminal;
mod whole;

pub use error::OutputError;
pub use folder::{LOCK_FILE, OutputFolder};
pub use inputs::refuse_inputs;
pub use terminal::visible;
pub use whole::WholeFile;
