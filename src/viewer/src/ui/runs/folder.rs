//! A folder as the file panel lists it.

use city3d_simulation::scenario::shipped_scenarios;
use std::path::{Path, PathBuf};

/// Entries that are listed at most: more cannot be looked through.
const MOST_ENTRIES: usize = 5000;
/// The log in the folder of a run.
const LOG: &str = "run.mcap";

/// What an entry of a folder is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum EntryKind {
    /// A folder to go into.
    Folder,
    /// The folder of a recorded run.
    Run,
    /// A scenario (.toml).
    Scenario,
    /// A map (.dxf).
    Map,
    /// A log (.mcap).
    Log,
    /// A scenario that is in the program.
    Shipped,
    /// Anything else; it is not listed.
    Other,
}

impl EntryKind {
    /// The kind in a word.
    pub fn label(self) -> &'static str {
        match self {
            Self::Folder => "folder",
            Self::Run => "recorded run",
            Self::Scenario => "scenario",
            Self::Map => "map",
            Self::Log => "log",
            Self::Shipped => "shipped scenario",
            Self::Other => "",
        }
    }
}

/// What the panel lists besides folders.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum FileFilter {
    /// Scenarios, maps, logs and runs.
    #[default]
    All,
    /// Scenarios alone.
    Scenarios,
    /// Maps alone.
    Maps,
    /// Logs, and folders of runs.
    Logs,
}

impl FileFilter {
    /// All filters with their names.
    pub const ALL: [(Self, &'static str); 4] =
        [(Self::All, "All"), (Self::Scenarios, "Scenarios"), (Self::Maps, "Maps"), (Self::Logs, "Logs")];

    /// What it lists, with the endings of the files.
    pub fn endings(self) -> &'static str {
        match self {
            Self::All => READABLE,
            Self::Scenarios => "scenario (.toml)",
            Self::Maps => "map (.dxf)",
            Self::Logs => "log (.mcap) or recorded run",
        }
    }

    fn shows(self, kind: EntryKind) -> bool {
        match kind {
            EntryKind::Folder => true,
            EntryKind::Other => false,
            EntryKind::Scenario | EntryKind::Shipped => matches!(self, Self::All | Self::Scenarios),
            EntryKind::Map => matches!(self, Self::All | Self::Maps),
            EntryKind::Run | EntryKind::Log => matches!(self, Self::All | Self::Logs),
        }
    }
}

/// What can be opened, with the endings of its files.
pub const READABLE: &str = "scenario (.toml), map (.dxf) or log (.mcap)";

/// Whether a folder is that of a recorded run.
pub fn has_run(folder: &Path) -> bool {
    folder.join(LOG).is_file()
}

/// The kind of a file or folder, by its name and what is in it.
pub fn kind_of(path: &Path) -> EntryKind {
    if path.is_dir() {
        return if has_run(path) { EntryKind::Run } else { EntryKind::Folder };
    }
    let extension = path.extension().map(|extension| extension.to_string_lossy().to_lowercase());
    match extension.as_deref() {
        Some("toml") => EntryKind::Scenario,
        Some("dxf") => EntryKind::Map,
        Some("mcap") => EntryKind::Log,
        _ => EntryKind::Other,
    }
}

/// An entry of a folder.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct FolderEntry {
    pub name: String,
    pub path: PathBuf,
    pub kind: EntryKind,
}

/// The entries of a folder: folders first, then files by name.
#[derive(Clone, Debug, Default)]
pub(super) struct Folder {
    pub path: PathBuf,
    pub entries: Vec<FolderEntry>,
    /// Why it cannot be read.
    pub trouble: Option<String>,
}

impl Folder {
    /// The scenarios that are in the program, in no folder of the disk.
    pub fn shipped() -> Vec<FolderEntry> {
        let entry = |name: &'static str| FolderEntry {
            name: name.to_owned(),
            path: PathBuf::from(name),
            kind: EntryKind::Shipped,
        };
        shipped_scenarios().map(entry).collect()
    }

    pub fn read(path: &Path) -> Self {
        let path = std::path::absolute(path).unwrap_or_else(|_| path.to_path_buf());
        let read = match std::fs::read_dir(&path) {
            Ok(read) => read,
            Err(error) => {
                let trouble = Some(format!("{}: this folder cannot be read: {error}", path.display()));
                return Self { path, entries: Vec::new(), trouble };
            }
        };
        let entry = |path: PathBuf| {
            let name = path.file_name()?.to_string_lossy().into_owned();
            let kind = kind_of(&path);
            Some(FolderEntry { name, path, kind }).filter(|entry| entry.kind != EntryKind::Other)
        };
        let mut entries: Vec<FolderEntry> =
            read.flatten().filter_map(|found| entry(found.path())).take(MOST_ENTRIES).collect();
        entries.sort_by_cached_key(|entry| (entry.kind != EntryKind::Folder, entry.name.to_lowercase()));
        Self { path, entries, trouble: None }
    }

    /// The entries that a filter shows and whose names begin like what was typed; hidden ones only if a dot was typed.
    pub fn matching(&self, filter: FileFilter, typed: &str) -> Vec<&FolderEntry> {
        matching(&self.entries, filter, typed)
    }
}

/// The same of any entries.
pub(super) fn matching<'a>(
    entries: &'a [FolderEntry],
    filter: FileFilter,
    typed: &str,
) -> Vec<&'a FolderEntry> {
    let typed = typed.to_lowercase();
    let is_shown = |entry: &&FolderEntry| {
        let is_hidden = entry.name.starts_with('.') && !typed.starts_with('.');
        filter.shows(entry.kind) && !is_hidden && entry.name.to_lowercase().starts_with(&typed)
    };
    entries.iter().filter(is_shown).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_lists_what_can_be_opened_and_no_more() {
        let folder = tempfile::tempdir().unwrap();
        for (name, is_folder) in
            [("b", true), ("A.toml", false), ("map.DXF", false), ("x.txt", false), (".h", true)]
        {
            let path = folder.path().join(name);
            if is_folder { std::fs::create_dir(path) } else { std::fs::write(path, "") }.unwrap();
        }
        std::fs::create_dir(folder.path().join("run-1")).unwrap();
        std::fs::write(folder.path().join("run-1/run.mcap"), "").unwrap();
        let listed = Folder::read(folder.path());
        let names = |filter, typed| {
            listed.matching(filter, typed).iter().map(|entry| entry.name.as_str()).collect::<Vec<_>>()
        };
        assert_eq!(names(FileFilter::All, ""), ["b", "A.toml", "map.DXF", "run-1"]);
        assert_eq!(names(FileFilter::Logs, ""), ["b", "run-1"]);
        assert_eq!(names(FileFilter::All, "a"), ["A.toml"]);
        assert_eq!(names(FileFilter::All, "."), [".h"]);
        let missing = Folder::read(&folder.path().join("nowhere"));
        assert!(missing.trouble.is_some_and(|said| said.contains("nowhere: this folder cannot be read")));
    }
}
