//! Reads the shared key of the message authentication code from its file.

use city3d_protocol::wire::{Authenticator, MIN_KEY_BYTES};
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Error of a key file.
#[derive(Debug, Error)]
pub enum KeyError {
    /// The file cannot be read.
    #[error("{path}: the key cannot be read: {source}", path = path.display())]
    Unreadable {
        /// Path of the key file.
        path: PathBuf,
        /// Reason that the system gives.
        source: std::io::Error,
    },
    /// The key has fewer than [`MIN_KEY_BYTES`] bytes.
    #[error(
        "{path}: the key has {found} bytes; it needs at least {MIN_KEY_BYTES}, such as from: openssl rand -hex 32",
        path = path.display()
    )]
    Short {
        /// Path of the key file.
        path: PathBuf,
        /// Length of the key without the white space around it, bytes.
        found: usize,
    },
}

/// The authenticator for the key in a file, trimmed of white space; without a file, the one that only has a checksum.
///
/// # Errors
/// When the file cannot be read, or the key is too short.
pub fn read_key(path: Option<&Path>) -> Result<Authenticator, KeyError> {
    let Some(path) = path else { return Ok(Authenticator::Checksum) };
    let bytes =
        std::fs::read(path).map_err(|source| KeyError::Unreadable { path: path.to_path_buf(), source })?;
    let key = bytes.trim_ascii();
    if key.len() < MIN_KEY_BYTES {
        return Err(KeyError::Short { path: path.to_path_buf(), found: key.len() });
    }
    Ok(Authenticator::Key(key.to_vec()))
}
