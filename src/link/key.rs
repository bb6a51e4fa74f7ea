//! The shared key, from its file.

use crate::wire::{SHORTEST_KEY, Seal};
use std::path::{Path, PathBuf};
use thiserror::Error;

/// A key that cannot be used.
#[derive(Debug, Error)]
pub enum KeyError {
    #[error("{path}: the key cannot be read: {source}", path = path.display())]
    Unreadable { path: PathBuf, source: std::io::Error },
    #[error(
        "{path}: a key of {found} bytes; it needs at least {SHORTEST_KEY}, as from: openssl rand -hex 32",
        path = path.display()
    )]
    Short { path: PathBuf, found: usize },
}

/// The seal of the key in a file, without blanks around it; without a file the one of all who have none.
///
/// # Errors
/// When the file cannot be read, or the key is too short to be one.
pub fn read_key(path: Option<&Path>) -> Result<Seal, KeyError> {
    let Some(path) = path else { return Ok(Seal::Checksum) };
    let bytes =
        std::fs::read(path).map_err(|source| KeyError::Unreadable { path: path.to_path_buf(), source })?;
    let key = bytes.trim_ascii();
    if key.len() < SHORTEST_KEY {
        return Err(KeyError::Short { path: path.to_path_buf(), found: key.len() });
    }
    Ok(Seal::Key(key.to_vec()))
}
