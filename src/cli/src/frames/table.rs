//! `frames.csv` and `boxes.csv` beside the pictures: their warning and their errors.

use super::super::Failure;
use city3d_outputs::OutputFolder;
use city3d_render::{BoxTable, BoxTableError, PictureTable, PictureTableError};

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

/// Begins the table of the boxes in a folder, where it is wanted; the one that is there goes.
pub(super) fn create_boxes(folder: &OutputFolder, is_wanted: bool) -> Result<Option<BoxTable>, Failure> {
    folder.remove(&[BoxTable::FILE])?;
    Ok(is_wanted.then(|| BoxTable::create(folder.path())).transpose()?)
}

impl From<PictureTableError> for Failure {
    fn from(error: PictureTableError) -> Self {
        Self::failed(error)
    }
}

impl From<BoxTableError> for Failure {
    fn from(error: BoxTableError) -> Self {
        Self::failed(error)
    }
}
