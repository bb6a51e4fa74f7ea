//! Files from outside: opened only where they are regular files, and known by their first bytes.

use super::RecordError;
use std::fs::File;
use std::io::{Error, ErrorKind, Read, Result};
use std::path::Path;

/// First bytes of a bag of ROS 1, format 2.0.
pub(super) const ROS1_MAGIC: &[u8] = b"#ROSBAG V2.0\n";
/// First bytes of an SQLite database.
const SQLITE_MAGIC: &[u8] = b"SQLite format 3\0";
/// First bytes of what Zstandard compressed.
pub(super) const ZSTANDARD_MAGIC: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];

/// Kind of a file by its first bytes, whatever its name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FileKind {
    /// MCAP: a log of City3D, or a bag of ROS 2.
    Mcap,
    /// A bag of ROS 1, format 2.0.
    Ros1Bag,
    /// An SQLite database: a bag of ROS 2.
    Sqlite,
    /// A file compressed with Zstandard, such as one of a bag of ROS 2.
    Zstandard,
    /// Text, such as a table.
    Text,
    /// Anything else.
    Other,
}

/// The kind of a file.
///
/// # Errors
/// [`RecordError::Unreadable`] where it is no regular file, is empty or cannot be read.
pub fn file_kind(path: &Path) -> std::result::Result<FileKind, RecordError> {
    let start =
        first_bytes(path).map_err(|reason| RecordError::Unreadable { path: path.to_path_buf(), reason })?;
    let is_text = || start.iter().all(|byte| !byte.is_ascii_control() || byte.is_ascii_whitespace());
    Ok(if start.starts_with(mcap::MAGIC) {
        FileKind::Mcap
    } else if start.starts_with(ROS1_MAGIC) {
        FileKind::Ros1Bag
    } else if start.starts_with(SQLITE_MAGIC) {
        FileKind::Sqlite
    } else if start.starts_with(&ZSTANDARD_MAGIC) {
        FileKind::Zstandard
    } else if is_text() {
        FileKind::Text
    } else {
        FileKind::Other
    })
}

/// Whether a file is an MCAP file, as logs are.
pub fn is_log(path: &Path) -> bool {
    matches!(file_kind(path), Ok(FileKind::Mcap))
}

fn first_bytes(path: &Path) -> Result<Vec<u8>> {
    const COUNT: u64 = 1024;
    let mut start = Vec::new();
    open(path)?.0.take(COUNT).read_to_end(&mut start)?;
    Ok(start)
}

/// Opens a regular file; returns its size in bytes too. Pipes and devices may never end, and neither may files of `/proc`,
/// which state no size: they are refused before a byte is read.
pub(super) fn open(path: &Path) -> Result<(File, u64)> {
    let metadata = std::fs::metadata(path)?;
    let refused = |why: &str| Err(Error::new(ErrorKind::InvalidInput, why));
    if metadata.is_dir() {
        return refused("it is a folder, not a file");
    }
    if !metadata.is_file() {
        return refused("it is a pipe or a device; save its content as a file first");
    }
    if metadata.len() == 0 {
        return refused("it is empty");
    }
    Ok((File::open(path)?, metadata.len()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_known_by_their_first_bytes() {
        for (bytes, kind) in [
            (&b"\x89MCAP0\r\nxyz"[..], FileKind::Mcap),
            (b"#ROSBAG V2.0\nxyz", FileKind::Ros1Bag),
            (b"time,id,x,y,yaw\r\n1,2,3,4,5\n", FileKind::Text),
            ("\u{feff}time;caf\u{e9}".as_bytes(), FileKind::Text),
            (b"SQLite format 3\0", FileKind::Sqlite),
            (b"\x28\xb5\x2f\xfdxyz", FileKind::Zstandard),
            (b"\x89PNG\r\n\x1a\n", FileKind::Other),
        ] {
            let file = tempfile::NamedTempFile::new().unwrap();
            std::fs::write(file.path(), bytes).unwrap();
            assert_eq!(file_kind(file.path()).unwrap(), kind, "{}", String::from_utf8_lossy(bytes));
        }
    }

    #[test]
    fn what_may_never_end_is_refused_unread() {
        let folder = tempfile::tempdir().unwrap();
        let empty = folder.path().join("empty");
        std::fs::write(&empty, "").unwrap();
        for (path, why) in [
            (folder.path(), "it is a folder"),
            (&empty, "it is empty"),
            (Path::new("/dev/zero"), "it is a pipe or a device"),
            // A regular file without a size, which blocks whoever reads it.
            (Path::new("/proc/kmsg"), "it is empty"),
        ] {
            let said = file_kind(path).unwrap_err().to_string();
            assert!(said.contains(why) && said.contains(&path.display().to_string()), "{said}");
        }
    }
}
