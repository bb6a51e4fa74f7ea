//! Files that are written beside their place and renamed when they are whole (atomic replacement).

use std::ffi::OsStr;
use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use tempfile::NamedTempFile;

/// Ending of the name that a file has until it is whole.
const UNFINISHED: &str = ".part";
/// Longest name of a file on most file systems, bytes.
const LONGEST_NAME: usize = 255;
/// Bytes that a temporary name adds: a dot, six random letters and [`UNFINISHED`].
const ADDED_NAME: usize = 1 + 6 + UNFINISHED.len();

/// A file that appears under its name when it is whole.
///
/// Until then it is a file `NAME.xxxxxx.part` in the same folder, which is removed where it is not committed; a killed
/// process leaves it. Pipes and devices are written to directly.
#[derive(Debug)]
pub struct WholeFile {
    sink: Sink,
}

#[derive(Debug)]
enum Sink {
    /// The temporary file, and its place.
    Beside(NamedTempFile, PathBuf),
    /// What is no regular file cannot be replaced.
    Direct(File, PathBuf),
}

impl WholeFile {
    /// Begins a file. What is under its name stays until the commit; a symbolic link is followed.
    ///
    /// # Errors
    /// When the folder takes no file.
    pub fn create(path: &Path) -> io::Result<Self> {
        if std::fs::metadata(path).is_ok_and(|found| !found.is_file()) {
            let file = File::options().write(true).truncate(true).open(path)?;
            return Ok(Self { sink: Sink::Direct(file, path.to_path_buf()) });
        }
        let place = std::fs::canonicalize(path).unwrap_or_else(|_| path.to_path_buf());
        let folder = place.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let name = place.file_name().unwrap_or_default();
        let is_short = name.len() + ADDED_NAME <= LONGEST_NAME;
        let mut prefix = if is_short { name } else { OsStr::new("city3d") }.to_os_string();
        prefix.push(".");
        let mut builder = tempfile::Builder::new();
        builder.prefix(&prefix).suffix(UNFINISHED);
        let open = |path: &Path| File::options().write(true).create_new(true).open(path);
        let file = builder.make_in(folder, open)?;
        Ok(Self { sink: Sink::Beside(file, place) })
    }

    /// Writes a whole file.
    ///
    /// # Errors
    /// When it cannot be written; then nothing has changed under its name.
    pub fn write(path: &Path, bytes: &[u8]) -> io::Result<()> {
        let mut file = Self::create(path)?;
        file.write_all(bytes)?;
        file.commit()
    }

    /// Where the bytes are until the commit, for another program that writes them.
    pub fn unfinished_path(&self) -> &Path {
        match &self.sink {
            Sink::Beside(file, _) => file.path(),
            Sink::Direct(_, path) => path,
        }
    }

    /// Cuts the file to this length in bytes, after which nothing more is written.
    ///
    /// # Errors
    /// When it cannot be cut.
    pub fn cut(&self, length: u64) -> io::Result<()> {
        match &self.sink {
            Sink::Beside(file, _) => file.as_file().set_len(length),
            // A pipe has passed it on already.
            Sink::Direct(..) => Ok(()),
        }
    }

    /// Puts the file under its name, in place of what is there.
    ///
    /// # Errors
    /// When it cannot be renamed; then it is removed.
    pub fn commit(self) -> io::Result<()> {
        match self.sink {
            Sink::Beside(file, place) => file.persist(place).map(drop).map_err(|error| error.error),
            Sink::Direct(..) => Ok(()),
        }
    }
}

impl Write for WholeFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match &mut self.sink {
            Sink::Beside(file, _) => file.as_file_mut().write(bytes),
            Sink::Direct(file, _) => file.write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let entries = std::fs::read_dir(folder).unwrap();
        let mut names: Vec<String> =
            entries.map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }

    #[test]
    fn a_file_appears_when_it_is_whole_and_not_before() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("table.csv");
        std::fs::write(&path, "old").unwrap();
        let mut file = WholeFile::create(&path).unwrap();
        file.write_all(b"new").unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
        let there = names(folder.path());
        assert!(there.len() == 2 && there[1].starts_with("table.csv.") && there[1].ends_with(".part"));
        assert_eq!(std::fs::read(file.unfinished_path()).unwrap(), b"new");
        file.commit().unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"new");
        drop(WholeFile::create(&path).unwrap());
        assert_eq!(names(folder.path()), ["table.csv"], "one that is given up leaves nothing");
    }

    #[test]
    fn the_error_is_that_of_the_system() {
        let error = WholeFile::create(Path::new("no/such/folder/file")).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::NotFound);
        assert!(!error.to_string().contains("no/such"), "{error}");
    }

    #[test]
    fn names_may_be_as_long_as_the_file_system_takes_them() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("n".repeat(LONGEST_NAME));
        WholeFile::write(&path, b"whole").unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"whole");
    }

    #[test]
    #[cfg(unix)]
    fn links_are_followed_and_devices_are_written_to() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        std::fs::write(folder.join("there"), "old").unwrap();
        std::os::unix::fs::symlink("there", folder.join("link")).unwrap();
        WholeFile::write(&folder.join("link"), b"new").unwrap();
        assert_eq!(std::fs::read(folder.join("there")).unwrap(), b"new");
        std::os::unix::fs::symlink("/dev/full", folder.join("full")).unwrap();
        let error = WholeFile::write(&folder.join("full"), b"bytes").unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::StorageFull);
        assert_eq!(names(folder), ["full", "link", "there"]);
    }

    #[test]
    #[cfg(unix)]
    fn a_file_may_be_read_by_those_that_the_mask_of_the_user_lets() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let mode = |name: &str| std::fs::metadata(folder.path().join(name)).unwrap().permissions().mode();
        std::fs::write(folder.path().join("usual"), "").unwrap();
        WholeFile::write(&folder.path().join("whole"), b"").unwrap();
        assert_eq!(mode("whole"), mode("usual"));
    }
}
