//! Results of commands on a disk: files that appear under their names when they are whole ([`WholeFile`]), folders that
//! have one writer at a time ([`OutputFolder`]), and inputs that no command writes over ([`refuse_inputs`]).

#![allow(clippy::disallowed_types, reason = "writes files")]

mod error;
mod folder;
mod inputs;
mod whole;

pub use error::OutputError;
pub use folder::{LOCK_FILE, OutputFolder};
pub use inputs::refuse_inputs;
pub use whole::WholeFile;
