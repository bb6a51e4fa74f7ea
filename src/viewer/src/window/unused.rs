//! Names of new files and folders.

use std::path::{Path, PathBuf};

/// The first of `NAME`, `NAME-2`, `NAME-3` ... in a folder that is not there yet, each with this ending.
pub fn unused(folder: &Path, name: &str, ending: &str) -> PathBuf {
    let first = std::iter::once(folder.join(format!("{name}{ending}")));
    let mut paths = first.chain((2_u64..).map(|k| folder.join(format!("{name}-{k}{ending}"))));
    paths.find(|path| !path.exists()).unwrap_or_else(|| folder.join(format!("{name}{ending}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_numbered_on() {
        let folder = tempfile::tempdir().unwrap();
        for expected in ["mine.toml", "mine-2.toml", "mine-3.toml"] {
            let path = unused(folder.path(), "mine", ".toml");
            assert_eq!(path, folder.path().join(expected));
            std::fs::write(path, "").unwrap();
        }
    }
}
