//! `frames.csv` beside the pictures: its warning and its errors.

use super::super::Failure;
use city3d_outputs::OutputFolder;
use city3d_render::{PictureTable, PictureTableError};

/// Begins the table of the pictures in a folder, which may have others; the one that is there goes.
pub(super) fn create(folder: &OutputFolder) -> Result<PictureTable, Failure> {
    if folder.path().join(PictureTable::FILE).exists() {
        tracing::warn!(
            "{}: pictures of the same names are replaced, others stay, and {} lists only the new ones",
            folder.path().display(),
            PictureTable::FILE
        );
    }
    folder.remove(&[PictureTable::FILE])?;
    Ok(PictureTable::create(folder.path())?)
}

impl From<PictureTableError> for Failure {
    fn from(error: PictureTableError) -> Self {
        Self::failed(error)
    }
}
