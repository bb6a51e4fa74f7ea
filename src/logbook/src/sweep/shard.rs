//! Shards: parts of a sweep that are run by processes anywhere, each with its rows in a file of its own.
//!
//! A file begins with lines `# key = value`, which together are TOML: what the rows depend on, which runs they are of, and
//! which machine has made them. The columns and the rows follow as in the table of the sweep. A file appears under its name
//! when it is whole; a digest of its rows tells one that a copy has cut.

use super::identity::{SweepIdentity, sha256};
use super::table::{SweepRow, columns_of_grid, line_of, rows_of};
use city3d_outputs::WholeFile;
use city3d_simulation::sweep::{Grid, Shard};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Name of the folder with the shards, in that of the sweep.
pub const SHARDS: &str = "shards";
/// Name of the table of all shards, with the machine of each.
pub const SHARD_TABLE: &str = "shards.csv";

/// Where, when and how a shard was run.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ShardOrigin {
    /// Name of the machine.
    pub host: String,
    /// Its system and processor.
    pub machine: String,
    /// When the first run began, seconds since 1970.
    pub started_unix_s: u64,
    /// How long all runs took, seconds.
    pub wall_s: f64,
    /// The command.
    pub command: String,
}

/// Everything that a shard's file says of itself.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ShardHead {
    /// What its rows depend on.
    #[serde(flatten)]
    pub identity: SweepIdentity,
    /// Which shard it is, as `3/16`.
    pub shard: String,
    /// Index of its first run in the sweep, from 0.
    pub first_run: usize,
    /// Number of its runs.
    pub rows: usize,
    /// SHA-256 of the bytes after the head.
    pub rows_sha256: String,
    /// Where it was run.
    #[serde(flatten)]
    pub origin: ShardOrigin,
}

/// Why a shard cannot be used.
#[derive(Debug, Error)]
pub enum ShardError {
    /// It has rows of another study.
    #[error("{path} is of {difference}", path = path.display())]
    Other {
        /// Path of the shard.
        path: PathBuf,
        /// In what it differs.
        difference: String,
    },
    /// Shards of different sizes.
    #[error("{path} has shards of {} and of {} together", counts[0], counts[1])]
    Mixed {
        /// The folder with the shards.
        path: PathBuf,
        /// Two of the numbers that the study was cut into.
        counts: [usize; 2],
    },
    /// It is cut or was changed.
    #[error("{path} is damaged: {why}", path = path.display())]
    Damaged {
        /// Path of the shard.
        path: PathBuf,
        /// What is wrong.
        why: String,
    },
    /// A file cannot be read or written.
    #[error("{path}: {source}", path = path.display())]
    File {
        /// Path of the file.
        path: PathBuf,
        /// Reason of the operating system.
        source: io::Error,
    },
    /// A row cannot be encoded.
    #[error("{path}: {source}", path = path.display())]
    Row {
        /// Path of the shard.
        path: PathBuf,
        /// What is wrong with the row.
        source: csv::Error,
    },
}

/// A study whose shards are in a folder.
#[derive(Clone, Copy, Debug)]
pub struct ShardFolder<'s> {
    /// The folder of the sweep.
    pub folder: &'s Path,
    /// What the rows depend on.
    pub identity: &'s SweepIdentity,
    /// The runs.
    pub grid: &'s Grid,
}

/// Which shards of a study are there.
#[derive(Debug, Default)]
pub struct FoundShards {
    /// How many shards the study was cut into; `None` while there is none.
    pub count: Option<usize>,
    /// The heads of those that are whole, by index.
    pub whole: BTreeMap<usize, ShardHead>,
    /// Those that are damaged, with what is wrong.
    pub damaged: Vec<String>,
}

impl FoundShards {
    /// Indices of the shards that are missing or damaged, of so many.
    pub fn missing(&self, count: usize) -> Vec<usize> {
        (0..count).filter(|index| !self.whole.contains_key(index)).collect()
    }
}

impl ShardFolder<'_> {
    /// Path of a shard's file.
    pub fn path(&self, shard: Shard) -> PathBuf {
        self.folder.join(SHARDS).join(format!("{}-of-{}.csv", shard.index, shard.count))
    }

    /// Writes a shard, whose rows are those of its runs in their order. Two processes may write the same one.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn write(&self, shard: Shard, rows: &[SweepRow], origin: ShardOrigin) -> Result<(), ShardError> {
        let path = self.path(shard);
        let unencoded = |source| ShardError::Row { path: path.clone(), source };
        let mut table = line_of(&columns_of_grid(self.grid).iter().collect()).map_err(unencoded)?;
        for row in rows {
            table.extend(line_of(row).map_err(unencoded)?);
        }
        let head = ShardHead {
            identity: self.identity.clone(),
            shard: shard.to_string(),
            first_run: shard.runs(self.grid.runs()).start,
            rows: rows.len(),
            rows_sha256: sha256(&table),
            origin,
        };
        let mut text = String::new();
        for line in toml::to_string(&head).unwrap_or_default().lines() {
            text.push_str(&format!("# {line}\n"));
        }
        let mut bytes = text.into_bytes();
        bytes.extend(table);
        let failed = |source| ShardError::File { path: path.clone(), source };
        std::fs::create_dir_all(self.folder.join(SHARDS)).map_err(failed)?;
        WholeFile::write(&path, &bytes).map_err(failed)
    }

    /// Reads a shard: its head and its rows.
    ///
    /// # Errors
    /// When it is of another study, or damaged, or cannot be read.
    pub fn read(&self, shard: Shard) -> Result<(ShardHead, Vec<SweepRow>), ShardError> {
        let path = self.path(shard);
        let text = std::fs::read_to_string(&path).map_err(|source| match source.kind() {
            ErrorKind::InvalidData => damaged(&path, "it is no text"),
            _ => ShardError::File { path: path.clone(), source },
        })?;
        let (head, table) = parted(&text).ok_or_else(|| damaged(&path, "its head is cut"))?;
        if let Some(difference) = self.identity.difference(&head.identity) {
            return Err(ShardError::Other { path, difference });
        }
        let runs = shard.runs(self.grid.runs());
        if sha256(table.as_bytes()) != head.rows_sha256 {
            return Err(damaged(&path, "its rows are not those that were written"));
        }
        let rows = rows_of(table, &columns_of_grid(self.grid), runs.len());
        let is_its_own = (head.first_run, &head.shard) == (runs.start, &shard.to_string());
        match rows.filter(|rows| rows.len() == runs.len() && is_its_own) {
            Some(rows) => Ok((head, rows)),
            None => Err(damaged(&path, "its rows are those of another shard")),
        }
    }

    /// Which shards are there, each read and verified.
    ///
    /// # Errors
    /// When one is of another study, when the study was cut into different numbers of shards, or the folder cannot be read.
    pub fn find(&self) -> Result<FoundShards, ShardError> {
        let folder = self.folder.join(SHARDS);
        let mut names = BTreeSet::new();
        match std::fs::read_dir(&folder) {
            Err(error) if error.kind() == ErrorKind::NotFound => {}
            Err(source) => return Err(ShardError::File { path: folder, source }),
            Ok(entries) => names.extend(entries.flatten().filter_map(|entry| shard_of(&entry.path()))),
        }
        let mut found = FoundShards::default();
        for shard in names {
            match self.read(shard) {
                Ok((head, _)) => drop(found.whole.insert(shard.index, head)),
                Err(ShardError::Damaged { path, why }) => {
                    found.damaged.push(format!("{} is damaged: {why}", path.display()));
                }
                Err(error) => return Err(error),
            }
            match found.count.replace(shard.count) {
                Some(before) if before != shard.count => {
                    return Err(ShardError::Mixed { path: folder, counts: [before, shard.count] });
                }
                _ => {}
            }
        }
        Ok(found)
    }

    /// Writes the table of all shards, with the machine of each.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn write_table(&self, found: &FoundShards) -> Result<PathBuf, ShardError> {
        const COLUMNS: [&str; 12] = [
            "shard",
            "first_run",
            "runs",
            "host",
            "machine",
            "started_unix_s",
            "wall_s",
            "version",
            "revision",
            "scenario_sha256",
            "runs_sha256",
            "command",
        ];
        let path = self.folder.join(SHARD_TABLE);
        let unencoded = |source| ShardError::Row { path: path.clone(), source };
        let mut table = line_of(&COLUMNS.iter().collect()).map_err(unencoded)?;
        for ShardHead { identity, shard, first_run, rows, origin, .. } in found.whole.values() {
            let row = [
                shard.clone(),
                first_run.to_string(),
                rows.to_string(),
                origin.host.clone(),
                origin.machine.clone(),
                origin.started_unix_s.to_string(),
                origin.wall_s.to_string(),
                identity.version.clone(),
                identity.revision.to_string(),
                identity.scenario.clone(),
                identity.runs.clone(),
                origin.command.clone(),
            ];
            table.extend(line_of(&row.iter().collect()).map_err(unencoded)?);
        }
        WholeFile::write(&path, &table)
            .map_err(|source| ShardError::File { path: path.clone(), source })
            .map(|()| path)
    }
}

fn damaged(path: &Path, why: &str) -> ShardError {
    ShardError::Damaged { path: path.to_path_buf(), why: why.to_owned() }
}

/// The shard whose file has this path.
fn shard_of(path: &Path) -> Option<Shard> {
    let name = path.file_name()?.to_str()?.strip_suffix(".csv")?;
    let (index, count) = name.split_once("-of-")?;
    format!("{index}/{count}").parse().ok()
}

/// The head of a shard's text, and the table behind it.
fn parted(text: &str) -> Option<(ShardHead, &str)> {
    let (mut head, mut rest) = (String::new(), text);
    while let Some(line) = rest.strip_prefix("# ") {
        let (line, after) = line.split_once('\n')?;
        head.push_str(line);
        head.push('\n');
        rest = after;
    }
    Some((toml::from_str(&head).ok()?, rest))
}

#[cfg(test)]
mod tests {
    use super::super::table::COLUMNS;
    use super::*;

    fn identity() -> SweepIdentity {
        let word = |text: &str| text.to_owned();
        SweepIdentity { version: word("0.1.0"), revision: 2, scenario: word("aa"), runs: word("bb") }
    }

    fn row(seed: u64) -> SweepRow {
        let rest = COLUMNS.iter().map(|_| "1, 2".to_owned());
        std::iter::once(seed.to_string()).chain(rest).collect::<Vec<String>>().into()
    }

    #[test]
    fn a_shard_comes_back_and_no_byte_of_it_may_be_missing_or_others() {
        let folder = tempfile::tempdir().unwrap();
        let grid = Grid::new(Vec::new(), Some("1..5".parse().unwrap())).unwrap();
        let identity = identity();
        let study = ShardFolder { folder: folder.path(), identity: &identity, grid: &grid };
        let shard = Shard { index: 1, count: 2 };
        let rows: Vec<SweepRow> = [3, 4, 5].map(row).into();
        let origin = ShardOrigin { host: "node \"7\"\n".to_owned(), wall_s: 1.5, ..ShardOrigin::default() };
        study.write(shard, &rows, origin.clone()).unwrap();
        let (head, back) = study.read(shard).unwrap();
        assert_eq!((head.first_run, head.rows, head.origin, back), (2, 3, origin, rows));

        let whole = std::fs::read(study.path(shard)).unwrap();
        for length in 0..whole.len() {
            std::fs::write(study.path(shard), &whole[..length]).unwrap();
            let error = study.read(shard).unwrap_err();
            assert!(matches!(error, ShardError::Damaged { .. }), "{length} bytes: {error}");
        }
        let text = String::from_utf8(whole.clone()).unwrap();
        std::fs::write(study.path(shard), text.replacen("\n3,", "\n8,", 1)).unwrap();
        assert!(study.read(shard).unwrap_err().to_string().contains("not those that were written"));
        // The file of another shard under this name.
        let first = Shard { index: 0, count: 2 };
        std::fs::write(study.path(first), &whole).unwrap();
        assert!(study.read(first).unwrap_err().to_string().contains("those of another shard"));

        std::fs::write(study.path(shard), &whole).unwrap();
        let found = study.find().unwrap();
        assert_eq!((found.count, found.missing(2), found.damaged.len()), (Some(2), vec![0], 1));
        let other = SweepIdentity { scenario: "cc".to_owned(), ..identity.clone() };
        let error = ShardFolder { identity: &other, ..study }.find().unwrap_err().to_string();
        assert!(error.contains("0-of-2.csv is of another scenario"), "{error}");
    }
}
