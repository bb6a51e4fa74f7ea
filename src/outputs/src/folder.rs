//! A folder that one command writes into: an advisory lock keeps others out.

use super::OutputError;
use std::fs::{File, TryLockError};
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use std::sync::Once;

/// Name of the lock file in a folder that is being written.
pub const LOCK_FILE: &str = ".city3d.lock";

/// A folder that only this value writes into; dropping it lets others.
///
/// The lock is that of the operating system on [`LOCK_FILE`], which ends with the process however that ends. The file is
/// removed at the end; one that a killed process has left is harmless.
#[derive(Debug)]
pub struct OutputFolder {
    path: PathBuf,
    /// Holds the lock while it is open.
    lock: Option<File>,
    /// It was created for this.
    is_new: bool,
}

impl OutputFolder {
    /// Creates the folder where there is none, and locks it.
    ///
    /// # Errors
    /// When it cannot be created or takes no files, or when another command writes into it.
    pub fn open(path: &Path) -> Result<Self, OutputError> {
        let is_new = !path.exists();
        std::fs::create_dir_all(path)
            .map_err(|source| OutputError::Folder { path: path.to_path_buf(), source })?;
        let lock = lock(&path.join(LOCK_FILE))
            .map_err(|source| OutputError::Unwritable { path: path.to_path_buf(), source })?;
        match lock {
            Some(lock) => Ok(Self { path: path.to_path_buf(), lock: Some(lock), is_new }),
            None => Err(OutputError::Busy { path: path.to_path_buf() }),
        }
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Removes files of an earlier command, in this order. Pipes, devices and folders of these names stay.
    ///
    /// # Errors
    /// Names the file that cannot be removed.
    pub fn remove<N: AsRef<Path>>(&self, names: &[N]) -> Result<(), OutputError> {
        for path in names.iter().map(|name| self.path.join(name)) {
            if !path.is_file() && path.exists() {
                continue;
            }
            match std::fs::remove_file(&path) {
                Err(source) if source.kind() != ErrorKind::NotFound => {
                    return Err(OutputError::File { path, source });
                }
                _ => {}
            }
        }
        Ok(())
    }
}

impl Drop for OutputFolder {
    fn drop(&mut self) {
        // Removed while it is locked: who has opened it before does not take it for the file of the folder.
        let _ = std::fs::remove_file(self.path.join(LOCK_FILE));
        self.lock = None;
        if self.is_new {
            // Only an empty one goes.
            let _ = std::fs::remove_dir(&self.path);
        }
    }
}

/// Opens and locks a file; `None` where another process holds its lock.
fn lock(path: &Path) -> io::Result<Option<File>> {
    loop {
        let file = File::options().create(true).truncate(false).write(true).open(path)?;
        match file.try_lock() {
            Err(TryLockError::WouldBlock) => return Ok(None),
            Err(TryLockError::Error(error)) => {
                warn_of_no_locks(path, &error);
                return Ok(Some(file));
            }
            // Its last holder may have removed it in the meantime.
            Ok(()) if is_at(&file, path) => return Ok(Some(file)),
            Ok(()) => {}
        }
    }
}

/// Whether a path still leads to an open file.
fn is_at(file: &File, path: &Path) -> bool {
    let open = file.try_clone().and_then(same_file::Handle::from_file);
    matches!((open, same_file::Handle::from_path(path)), (Ok(open), Ok(found)) if open == found)
}

/// Says once that nothing keeps a second writer out.
fn warn_of_no_locks(path: &Path, error: &io::Error) {
    static SAID: Once = Once::new();
    SAID.call_once(|| {
        tracing::warn!(
            "{}: this file system has no locks ({error}); let no other command write into this folder",
            path.display()
        );
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_has_one_writer_at_a_time() {
        let root = tempfile::tempdir().unwrap();
        let path = root.path().join("new/folder");
        let first = OutputFolder::open(&path).unwrap();
        let refused = OutputFolder::open(&path).unwrap_err();
        assert!(matches!(refused, OutputError::Busy { .. }) && !refused.is_bad_input(), "{refused}");
        assert!(path.join(LOCK_FILE).exists());
        std::fs::write(path.join("result"), "").unwrap();
        drop(first);
        assert!(!path.join(LOCK_FILE).exists() && path.join("result").exists());
        // That of a process that was killed.
        std::fs::write(path.join(LOCK_FILE), "").unwrap();
        drop(OutputFolder::open(&path).unwrap());
        assert!(!path.join(LOCK_FILE).exists());
    }

    #[test]
    fn a_new_folder_that_nothing_was_written_into_goes_and_an_old_one_stays() {
        let root = tempfile::tempdir().unwrap();
        let path = root.path().join("folder");
        drop(OutputFolder::open(&path).unwrap());
        assert!(!path.exists());
        std::fs::create_dir(&path).unwrap();
        drop(OutputFolder::open(&path).unwrap());
        assert!(path.exists());
    }

    #[test]
    fn a_lock_on_a_file_that_was_removed_is_not_that_of_the_folder() {
        let root = tempfile::tempdir().unwrap();
        let path = root.path().join(LOCK_FILE);
        let removed = lock(&path).unwrap().unwrap();
        std::fs::remove_file(&path).unwrap();
        assert!(!is_at(&removed, &path));
        let found = lock(&path).unwrap().unwrap();
        assert!(is_at(&found, &path) && !is_at(&removed, &path));
    }

    #[test]
    #[cfg(unix)]
    fn regular_files_are_removed_and_what_links_share_stays() {
        let root = tempfile::tempdir().unwrap();
        let folder = OutputFolder::open(root.path()).unwrap();
        let at = |name: &str| root.path().join(name);
        for name in ["summary.json", "kept"] {
            std::fs::write(at(name), name).unwrap();
        }
        std::fs::hard_link(at("kept"), at("hard")).unwrap();
        std::os::unix::fs::symlink("kept", at("soft")).unwrap();
        std::os::unix::fs::symlink("nowhere", at("dangling")).unwrap();
        std::os::unix::fs::symlink("/dev/full", at("device")).unwrap();
        std::fs::create_dir(at("folder")).unwrap();
        folder.remove(&["summary.json", "hard", "soft", "dangling", "device", "folder", "missing"]).unwrap();
        assert!(["summary.json", "hard", "soft", "dangling"].iter().all(|name| !at(name).is_symlink()));
        assert!(!at("summary.json").exists() && !at("hard").exists());
        assert!(at("device").is_symlink() && at("folder").is_dir());
        assert_eq!(std::fs::read(at("kept")).unwrap(), b"kept");
    }
}
