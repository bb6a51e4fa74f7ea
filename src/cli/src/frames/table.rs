//! `frames.csv` beside the pictures: its warning and its errors.

use super::super::Failure;
use city3d_render::{PictureTable, PictureTableError};
use std::path::Path;

/// The table of the pictures in a folder, which may have others.
pub(super) fn create(folder: &Path) -> Result<PictureTable, Failure> {
    if folder.join(PictureTable::FILE).exists() {
        tracing::warn!(
            "{}: pictures of the same names are replaced, others stay, and {} lists only the new ones",
            folder.display(),
            PictureTable::FILE
        );
    }
    Ok(PictureTable::create(folder)?)
}

impl From<PictureTableError> for Failure {
    fn from(error: PictureTableError) -> Self {
        match error {
            // Nothing has been done yet.
            PictureTableError::Folder { .. } => Self::bad_input(error),
            PictureTableError::Row { .. } | PictureTableError::File { .. } => Self::failed(error),
        }
    }
}
