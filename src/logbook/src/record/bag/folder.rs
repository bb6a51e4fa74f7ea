//! Folders of rosbag2: `metadata.yaml`, and the files of the storage in order of time.

use crate::record::{RecordError, input};
use saphyr_parser::{Event, Parser, ScanError};
use std::io::Read;
use std::path::{Path, PathBuf};

/// What rosbag2 writes beside the files of a bag when it closes them.
const METADATA: &str = "metadata.yaml";
/// Largest metadata that is read.
const LARGEST_METADATA: u64 = 4 << 20;
const MOST_FILES: usize = 10_000;

/// Whether a folder is that of a bag rather than of a run.
pub fn is_bag_folder(path: &Path) -> bool {
    path.is_dir() && (path.join(METADATA).is_file() || !storage_files(path).is_empty())
}

/// The files of a bag in order of time: as `metadata.yaml` lists them, or all of the folder by their names where the recording
/// ended without it.
///
/// # Errors
/// [`RecordError::NoBag`] where there are none, one is missing, or they are compressed; [`RecordError::Unreadable`] where the
/// metadata cannot be read.
pub(super) fn files_of(folder: &Path) -> Result<Vec<PathBuf>, RecordError> {
    let wrong = |path: &Path, reason: String| RecordError::NoBag { path: path.to_path_buf(), reason };
    let path = folder.join(METADATA);
    if !path.exists() {
        let files = storage_files(folder);
        if files.is_empty() {
            return Err(wrong(folder, format!("the folder has no {METADATA} and no .db3 or .mcap file")));
        }
        return Ok(files);
    }
    let text = text_of(&path)?;
    let metadata = Metadata::read(&text)
        .map_err(|error| wrong(&path, format!("{error}; write it again with ros2 bag reindex")))?;
    if !metadata.compression.is_empty() {
        return Err(wrong(
            folder,
            format!("{METADATA} says that it is compressed ({}): {DECOMPRESS}", metadata.compression),
        ));
    }
    if metadata.files.is_empty() || metadata.files.len() > MOST_FILES {
        let found = metadata.files.len();
        return Err(wrong(
            &path,
            format!(
                "relative_file_paths lists {found} files, not 1 to {MOST_FILES}; write it again with ros2 bag reindex"
            ),
        ));
    }
    // The first versions wrote the folder's name before that of the file.
    let file = |name: &String| Path::new(name).file_name().map(|name| folder.join(name));
    let files: Vec<PathBuf> = metadata.files.iter().filter_map(file).collect();
    if let Some(missing) = files.iter().find(|file| !file.is_file()) {
        let reason = format!("{METADATA} lists it, and it is not there: copy the whole folder of the bag");
        return Err(wrong(missing, reason));
    }
    Ok(files)
}

/// What to do with a compressed bag.
pub(super) const DECOMPRESS: &str = "decompress it first, with ros2 bag convert, or with rosbags-convert --src BAG --dst NEW (rosbags of PyPI)";

fn text_of(path: &Path) -> Result<String, RecordError> {
    let unreadable = |reason| RecordError::Unreadable { path: path.to_path_buf(), reason };
    let (file, size) = input::open(path).map_err(unreadable)?;
    if size > LARGEST_METADATA {
        let reason = format!("it has {size} bytes; at most {} MiB are read", LARGEST_METADATA >> 20);
        return Err(RecordError::NoBag { path: path.to_path_buf(), reason });
    }
    let mut text = String::new();
    file.take(size).read_to_string(&mut text).map_err(unreadable)?;
    Ok(text)
}

/// Files with the endings of the storages, by name; numbers in names count as numbers.
fn storage_files(folder: &Path) -> Vec<PathBuf> {
    let files = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let is_storage =
        |file: &PathBuf| file.extension().is_some_and(|ending| ending == "db3" || ending == "mcap");
    let mut files: Vec<PathBuf> = files.filter(|file| is_storage(file) && file.is_file()).collect();
    files.sort_by_cached_key(|file| {
        let name = file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let start = name.trim_end_matches(|digit: char| digit.is_ascii_digit()).len();
        (name[..start].to_owned(), name[start..].parse::<u64>().unwrap_or(0), name)
    });
    files
}

/// What `metadata.yaml` says of the files.
#[derive(Debug, Default, PartialEq)]
struct Metadata {
    files: Vec<String>,
    /// Empty for none.
    compression: String,
}

impl Metadata {
    /// Follows the events of the parser, which does not recurse and expands no alias.
    fn read(text: &str) -> Result<Self, ScanError> {
        let mut metadata = Self::default();
        let mut open: Vec<Collection> = Vec::new();
        for event in Parser::new_from_str(text) {
            let text = match event?.0 {
                Event::MappingStart(..) => {
                    open.push(Collection::Mapping { key: None });
                    continue;
                }
                Event::SequenceStart(..) => {
                    open.push(Collection::Sequence);
                    continue;
                }
                Event::MappingEnd | Event::SequenceEnd => {
                    open.pop();
                    String::new()
                }
                Event::Scalar(text, ..) => text.into_owned(),
                Event::Alias(_) => String::new(),
                _ => continue,
            };
            metadata.take(&mut open, text);
        }
        Ok(metadata)
    }

    /// Takes a node that has ended: a scalar, or an empty text for another one.
    fn take(&mut self, open: &mut [Collection], text: String) {
        let depth = open.len();
        let key = |at: usize| match open.get(at) {
            Some(Collection::Mapping { key: Some(key) }) => key.as_str(),
            _ => "",
        };
        if key(0) == "rosbag2_bagfile_information" {
            match (depth, key(1), open.get(2)) {
                (2, "compression_format", _) => self.compression.clone_from(&text),
                (3, "relative_file_paths", Some(Collection::Sequence)) => self.files.push(text.clone()),
                _ => {}
            }
        }
        if let Some(Collection::Mapping { key }) = open.last_mut() {
            *key = if key.is_some() { None } else { Some(text) };
        }
    }
}

/// A mapping with the key whose value comes next, or a sequence.
enum Collection {
    Mapping { key: Option<String> },
    Sequence,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn metadata_names_files_and_compression() {
        let text = "rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: sqlite3\n  duration:\n    nanoseconds: 1\n  \
             topics_with_message_count:\n    - topic_metadata:\n        name: /a\n        offered_qos_profiles: \"- history: 3\\n  depth: 0\"\n      \
             message_count: 2\n  compression_format: \"\"\n  compression_mode: ''\n  relative_file_paths:\n    - bag/a_0.db3\n    - \"a_1.db3\"\n";
        let files = vec!["bag/a_0.db3".to_owned(), "a_1.db3".to_owned()];
        assert_eq!(Metadata::read(text).unwrap(), Metadata { files, compression: String::new() });
        let flow = "{rosbag2_bagfile_information: {compression_format: zstd, relative_file_paths: [x, y]}}";
        let files = vec!["x".to_owned(), "y".to_owned()];
        assert_eq!(Metadata::read(flow).unwrap(), Metadata { files, compression: "zstd".to_owned() });
        assert_eq!(
            Metadata::read("relative_file_paths: [x]\ncompression_format: zstd").unwrap(),
            Metadata::default()
        );
    }

    #[test]
    fn hostile_metadata_ends() {
        for text in ["[".repeat(1 << 20), "a: {".repeat(1 << 18), "? ".repeat(1 << 16), "- ".repeat(1 << 16)]
        {
            let _ = Metadata::read(&text);
        }
        let laughs =
            "a: &a [x, x]\nb: &b [*a, *a]\nrosbag2_bagfile_information: {relative_file_paths: [*b, c]}";
        assert_eq!(Metadata::read(laughs).unwrap().files, ["", "c"]);
    }

    #[test]
    fn files_without_metadata_go_by_their_numbers() {
        let folder = tempfile::tempdir().unwrap();
        assert!(!is_bag_folder(folder.path()));
        for name in ["a_10.db3", "a_9.db3", "a_0.db3", "a_9.db3-wal", "notes.txt"] {
            std::fs::write(folder.path().join(name), "x").unwrap();
        }
        let names = ["a_0.db3", "a_9.db3", "a_10.db3"].map(|name| folder.path().join(name));
        assert!(is_bag_folder(folder.path()));
        assert_eq!(files_of(folder.path()).unwrap(), names);
    }
}
