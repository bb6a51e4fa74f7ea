//! Errors of files and folders that are written.

use std::io;
use std::path::PathBuf;
use thiserror::Error;

/// Why results cannot be written.
#[derive(Debug, Error)]
pub enum OutputError {
    /// The folder cannot be created.
    #[error("{path}: the folder cannot be created: {source}", path = path.display())]
    Folder {
        /// The folder.
        path: PathBuf,
        /// Reason of the operating system.
        source: io::Error,
    },
    /// The folder takes no files.
    #[error("{path}: the folder cannot be written: {source}", path = path.display())]
    Unwritable {
        /// The folder.
        path: PathBuf,
        /// Reason of the operating system.
        source: io::Error,
    },
    /// Another command writes into the folder.
    #[error(
        "{path}: another command is writing into this folder; wait until it has ended, or choose another --out",
        path = path.display()
    )]
    Busy {
        /// The folder.
        path: PathBuf,
    },
    /// An output is a file that the command reads.
    #[error(
        "{path}: this is the file {input} that the command reads, and would be written over; choose another --out",
        path = path.display(), input = input.display()
    )]
    Input {
        /// Path of the output.
        path: PathBuf,
        /// The input, as it was given.
        input: PathBuf,
    },
    /// A file cannot be written, or one of an earlier command cannot be removed.
    #[error("{path}: {source}", path = path.display())]
    File {
        /// Path of the file.
        path: PathBuf,
        /// Reason of the operating system.
        source: io::Error,
    },
}

impl OutputError {
    /// Whether what was asked for is wrong, rather than something having failed.
    pub fn is_bad_input(&self) -> bool {
        matches!(self, Self::Input { .. })
    }
}
