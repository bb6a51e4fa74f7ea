//! Locates scenarios, maps and models: files on disk take precedence over embedded ones.

use super::fields::did_you_mean;
use city3d_control::coordination::Coordinators;
use city3d_control::{Algorithms, Drivers};
use city3d_roadmap::{LabMap, MapErrors, load_map};
use std::collections::{BTreeMap, VecDeque};
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use thiserror::Error;

/// Largest map or model that is read.
const LARGEST_FILE_BYTES: u64 = 64 << 20;
/// Largest scenario that is read: parsed, it takes many times the memory.
pub const LARGEST_SCENARIO_BYTES: u64 = 8 << 20;

const SCENARIOS: [(&str, &str); 11] = [
    ("roundabout", include_str!("../../../../scenarios/roundabout.toml")),
    ("roundabout-coordinated", include_str!("../../../../scenarios/roundabout-coordinated.toml")),
    ("mixed", include_str!("../../../../scenarios/mixed.toml")),
    ("city", include_str!("../../../../scenarios/city.toml")),
    ("straight", include_str!("../../../../scenarios/straight.toml")),
    ("student", include_str!("../../../../scenarios/student.toml")),
    ("intersection", include_str!("../../../../scenarios/intersection.toml")),
    ("intersection-signals", include_str!("../../../../scenarios/intersection-signals.toml")),
    ("corridor", include_str!("../../../../scenarios/corridor.toml")),
    ("merge", include_str!("../../../../scenarios/merge.toml")),
    ("platoon", include_str!("../../../../scenarios/platoon.toml")),
];
const MAPS: [(&str, &[u8]); 5] = [
    ("ids3c", include_bytes!("../../../../assets/maps/ids3c.dxf")),
    ("crossing", include_bytes!("../../../../assets/maps/crossing.dxf")),
    ("corridor", include_bytes!("../../../../assets/maps/corridor.dxf")),
    ("merge", include_bytes!("../../../../assets/maps/merge.dxf")),
    ("road", include_bytes!("../../../../assets/maps/road.dxf")),
];

/// A file that cannot be loaded.
#[derive(Debug, Error)]
pub enum SourceError {
    /// The operating system cannot read the file.
    #[error("{path}: {reason}")]
    Unreadable {
        /// Path of the file.
        path: PathBuf,
        /// Reason of the operating system.
        reason: std::io::Error,
    },
    /// The file exceeds the size limit.
    #[error("{path}: {bytes} bytes; {kind} of more than {} MiB are not read", most >> 20)]
    TooLarge {
        /// Path of the file.
        path: PathBuf,
        /// What it was read as, in the plural: `scenarios`, `models` or `maps`.
        kind: &'static str,
        /// Size of the file, bytes.
        bytes: u64,
        /// Largest size that is read, bytes.
        most: u64,
    },
    /// The scenario is not UTF-8; line and column, from 1, of the first wrong byte.
    #[error("{path}: line {line}, column {column}: not UTF-8 text; save the file as UTF-8")]
    NotText {
        /// Path of the scenario.
        path: PathBuf,
        /// Line of the first wrong byte, from 1.
        line: usize,
        /// Column of the first wrong byte, from 1, in characters.
        column: usize,
    },
    /// The file is of another kind, such as a log or a picture.
    #[error("{path}: this is {what}")]
    Other {
        /// Path of the file.
        path: PathBuf,
        /// What the file is and what to do with it, to follow "this is".
        what: &'static str,
    },
    /// No file and no embedded scenario, map or model has this name.
    #[error(
        "\"{}\" is neither a file nor one of the shipped {kind}: {names}; {}",
        shortened(name),
        remedy(name, names)
    )]
    Unknown {
        /// The name that was asked for.
        name: String,
        /// What was looked for, in the plural: `scenarios`, `models` or `maps`.
        kind: &'static str,
        /// Embedded names of this kind, separated by commas.
        names: String,
    },
}

/// What to do about a name that is unknown: the nearest one where it is near.
fn remedy(name: &str, names: &str) -> String {
    let question = did_you_mean(name, names.split(", "));
    question.unwrap_or_else(|| "give the path of a file or one of these names".to_owned())
}

/// A name of some length for a message.
fn shortened(name: &str) -> String {
    const LONGEST: usize = 100;
    let count = name.chars().count();
    if count <= LONGEST {
        return name.to_owned();
    }
    let start: String = name.chars().take(LONGEST).collect();
    format!("{start}... ({count} characters)")
}

/// Names of the embedded scenarios.
pub fn shipped_scenarios() -> impl Iterator<Item = &'static str> {
    SCENARIOS.iter().map(|(name, _)| *name)
}

/// Finds maps and models of a scenario: beside it, in the working directory, or embedded; for a scenario from
/// a log, only among those stored with it. It has the drivers that the scenario may name, too.
#[derive(Clone, Debug, Default)]
pub struct Library {
    folder: PathBuf,
    algorithms: Algorithms,
    kept: Option<Arc<Kept>>,
    maps: MapCache,
}

/// A cache of maps, for programs that read many scenarios: finding the conflict zones of a map takes longer than the rest of a
/// scenario. The least recently loaded one makes room.
#[derive(Clone, Debug, Default)]
pub struct MapCache(Arc<Mutex<VecDeque<LoadedMap>>>);

#[derive(Debug)]
struct LoadedMap {
    drawing: Vec<u8>,
    map: Arc<LabMap>,
}

/// Most maps that are kept.
const MOST_LOADED: usize = 4;

impl MapCache {
    /// The map of a drawing's bytes: one that has been loaded from the same bytes, or a new one.
    fn load(&self, bytes: &[u8]) -> Result<Arc<LabMap>, MapErrors> {
        // Whoever comes while it is being loaded waits for it.
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = all.iter().find(|loaded| loaded.drawing == bytes) {
            return Ok(Arc::clone(&known.map));
        }
        let map = Arc::new(load_map(bytes)?.map);
        all.truncate(MOST_LOADED - 1);
        all.push_front(LoadedMap { drawing: bytes.to_vec(), map: Arc::clone(&map) });
        Ok(map)
    }
}

#[derive(Debug)]
struct Kept {
    map: Vec<u8>,
    models: BTreeMap<String, Vec<u8>>,
}

impl Library {
    /// A library that looks for relative paths in `folder` first.
    pub fn beside(scenario: &Path) -> Self {
        Self { folder: scenario.parent().map(Path::to_path_buf).unwrap_or_default(), ..Self::default() }
    }

    /// A library of stored files: map, whatever its name, and models by name. No file is read; embedded ones
    /// remain available.
    pub fn kept(map: Vec<u8>, models: BTreeMap<String, Vec<u8>>) -> Self {
        Self { kept: Some(Arc::new(Kept { map, models })), ..Self::default() }
    }

    /// The library with these drivers in place of the standard ones.
    #[must_use]
    pub fn with_drivers(mut self, drivers: Drivers) -> Self {
        self.algorithms.drivers = drivers;
        self
    }

    /// The library with these coordination algorithms in place of the standard ones.
    #[must_use]
    pub fn with_coordinators(mut self, coordinators: Coordinators) -> Self {
        self.algorithms.coordinators = coordinators;
        self
    }

    /// The library with a cache of maps, which several libraries may share.
    #[must_use]
    pub fn with_map_cache(mut self, cache: MapCache) -> Self {
        self.maps = cache;
        self
    }

    /// The map of a drawing's bytes. Those of its scenarios are kept: the runs of a study have one map.
    pub(super) fn load_map(&self, bytes: &[u8]) -> Result<Arc<LabMap>, MapErrors> {
        self.maps.load(bytes)
    }

    /// The algorithms that a scenario may name.
    pub fn algorithms(&self) -> &Algorithms {
        &self.algorithms
    }

    /// Whether the scenario is from a log. A log may name a driver that this program lacks: motion is shown and simulated
    /// again without it.
    pub(super) fn is_of_log(&self) -> bool {
        self.kept.is_some()
    }

    /// The file of this name next to the scenario or in the working directory.
    fn file(&self, name: &str) -> Option<PathBuf> {
        let paths = [self.folder.join(name), PathBuf::from(name)];
        paths.into_iter().find(|path| self.kept.is_none() && path.is_file())
    }

    /// Loads a scenario by path or embedded name, with the library of its maps.
    ///
    /// # Errors
    /// If there is no such file or name, or it is too large or no text.
    pub fn scenario(name: &str) -> Result<(String, Self), SourceError> {
        let path = Path::new(name);
        if path.is_file() {
            let bytes = read(path, "scenarios", LARGEST_SCENARIO_BYTES)
                .map_err(|error| other_kind(path, &first_bytes(path)).unwrap_or(error))?;
            let text = String::from_utf8(bytes).map_err(|error| not_text(path, &error))?;
            return Ok((text, Self::beside(path)));
        }
        let stem = name.strip_prefix("scenarios/").unwrap_or(name);
        let stem = stem.strip_suffix(".toml").unwrap_or(stem);
        let embedded = SCENARIOS.iter().find(|(shipped, _)| *shipped == stem);
        embedded.map(|(_, text)| ((*text).to_owned(), Self::default())).ok_or_else(|| SourceError::Unknown {
            name: name.to_owned(),
            kind: "scenarios",
            names: shipped_scenarios().collect::<Vec<_>>().join(", "),
        })
    }

    /// Loads a model by path or embedded name.
    ///
    /// # Errors
    /// When there is no such file or name, or it is too large.
    pub fn model(&self, name: &str) -> Result<Vec<u8>, SourceError> {
        if let Some(bytes) = self.kept.as_ref().and_then(|kept| kept.models.get(name)) {
            return Ok(bytes.clone());
        }
        if let Some(path) = self.file(name) {
            return read(&path, "models", LARGEST_FILE_BYTES);
        }
        let embedded = city3d_models::shipped(name);
        embedded.map(<[u8]>::to_vec).ok_or_else(|| SourceError::Unknown {
            name: name.to_owned(),
            kind: "models",
            names: city3d_models::SHIPPED.join(", "),
        })
    }

    /// Whether a model file lies beside the scenario or in the working directory.
    pub fn has_own_model(&self, name: &str) -> bool {
        self.kept.as_ref().is_some_and(|kept| kept.models.contains_key(name)) || self.file(name).is_some()
    }

    /// Bytes of a file of this name beside the scenario or in the working directory; `None` where there is none that can be
    /// read.
    pub fn own_file(&self, name: &str) -> Option<Vec<u8>> {
        self.file(name).and_then(|path| read(&path, "files", LARGEST_FILE_BYTES).ok())
    }

    /// Loads a map by path or embedded name.
    ///
    /// # Errors
    /// When there is no such file or name, or it is too large.
    pub fn map(&self, name: &str) -> Result<Vec<u8>, SourceError> {
        if let Some(kept) = &self.kept {
            return Ok(kept.map.clone());
        }
        if let Some(path) = self.file(name) {
            return read(&path, "maps", LARGEST_FILE_BYTES);
        }
        let embedded = MAPS.iter().find(|(shipped, _)| *shipped == name);
        embedded.map(|(_, bytes)| bytes.to_vec()).ok_or_else(|| SourceError::Unknown {
            name: name.to_owned(),
            kind: "maps",
            names: MAPS.map(|(name, _)| name).join(", "),
        })
    }
}

/// The error for a file of another kind than scenarios, where its first bytes tell it.
fn other_kind(path: &Path, start: &[u8]) -> Option<SourceError> {
    const KINDS: [(&[u8], &str); 4] = [
        (
            b"\x89MCAP0",
            "the log of a run, not a scenario: give it to `city3d replay LOG --verify`, `city3d frames LOG`, `city3d \
             plot LOG` or `city3d compare LOG LOG`",
        ),
        (b"\x89PNG", "a picture (PNG), not a scenario: scenarios are text, see docs/scenarios.md"),
        (b"glTF", "a model (glTF), not a scenario: scenarios are text, see docs/scenarios.md"),
        (b"\xff\xd8\xff", "a picture (JPEG), not a scenario: scenarios are text, see docs/scenarios.md"),
    ];
    let (_, what) = KINDS.iter().find(|(magic, _)| start.starts_with(magic))?;
    Some(SourceError::Other { path: path.to_path_buf(), what })
}

/// The first bytes of a file; none where it cannot be read.
#[allow(clippy::disallowed_types, reason = "files that are too large are not read whole")]
fn first_bytes(path: &Path) -> Vec<u8> {
    let mut start = Vec::new();
    // What cannot be read is of no known kind.
    let _ = std::fs::File::open(path).and_then(|file| file.take(16).read_to_end(&mut start));
    start
}

fn not_text(path: &Path, error: &std::string::FromUtf8Error) -> SourceError {
    if let Some(other) = other_kind(path, error.as_bytes()) {
        return other;
    }
    let good = String::from_utf8_lossy(&error.as_bytes()[..error.utf8_error().valid_up_to()]);
    let last_line = good.rsplit('\n').next().unwrap_or_default();
    SourceError::NotText {
        path: path.to_path_buf(),
        line: good.matches('\n').count() + 1,
        column: last_line.chars().count() + 1,
    }
}

/// Reads a file of at most so many bytes.
fn read(path: &Path, kind: &'static str, most: u64) -> Result<Vec<u8>, SourceError> {
    let unreadable = |reason| SourceError::Unreadable { path: path.to_path_buf(), reason };
    let bytes = std::fs::metadata(path).map_err(unreadable)?.len();
    if bytes > most {
        return Err(SourceError::TooLarge { path: path.to_path_buf(), kind, bytes, most });
    }
    // Files of /proc state no size, and some of them never end.
    if bytes == 0 {
        return Ok(Vec::new());
    }
    std::fs::read(path).map_err(unreadable)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_map_of_the_cache_is_the_one_that_is_loaded() {
        let cache = MapCache::default();
        let (plain, cached) = (Library::default(), Library::default().with_map_cache(cache.clone()));
        for name in ["merge", "crossing", "merge"] {
            let bytes = plain.map(name).unwrap();
            assert_eq!(cached.load_map(&bytes).unwrap(), plain.load_map(&bytes).unwrap(), "{name}");
        }
        let count = || cache.0.lock().unwrap().len();
        assert_eq!(count(), 2, "each is loaded once");
        assert!(cached.load_map(b"no drawing").is_err());
        for name in ["road", "corridor", "ids3c"] {
            cached.load_map(&plain.map(name).unwrap()).unwrap();
        }
        assert_eq!(count(), MOST_LOADED);
    }

    #[test]
    #[allow(clippy::disallowed_types, reason = "a file of which only the size matters")]
    fn files_beyond_their_limit_are_refused_unread() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("sparse");
        let refused = |size: u64, start: &[u8]| {
            std::fs::write(&path, start).unwrap();
            std::fs::File::options().write(true).open(&path).unwrap().set_len(size).unwrap();
            Library::scenario(path.to_str().unwrap()).unwrap_err().to_string()
        };
        let said = refused(LARGEST_SCENARIO_BYTES + 1, b"");
        assert!(said.contains("8388609 bytes; scenarios of more than 8 MiB are not read"), "{said}");
        let text = "x = 1\n".repeat(1_500_000);
        let read = crate::scenario::read_experiment("log", &text, &Library::default(), Default::default());
        assert!(read.unwrap_err().to_string().contains("log: 9000000 bytes; scenarios of more than 8 MiB"));
        assert!(refused(20 << 30, b"\x89MCAP0\r\n").contains("the log of a run, not a scenario"));
        let library = Library::beside(&path);
        let said = library.map("sparse").unwrap_err().to_string();
        assert!(said.contains("21474836480 bytes; maps of more than 64 MiB are not read"), "{said}");
        assert!(library.model("sparse").unwrap_err().to_string().contains("models of more than 64 MiB"));
        // A file without a size, which would block its reader.
        assert_eq!(Library::beside(Path::new("/proc/x")).map("kmsg").unwrap(), b"");
    }
}
