//! A sweep that is over, read back from its folder.

use super::map::SweepResults;
use super::table::{SweepRow, SweepTable, columns_of};
use city3d_simulation::sweep::Axis;
use std::collections::BTreeSet;
use std::io;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// A whole table of a sweep with its axes and its scenario.
#[derive(Debug)]
pub struct RecordedSweep {
    /// Name of its folder.
    pub label: String,
    axes: Vec<Axis>,
    rows: Vec<SweepRow>,
    document: toml::Table,
}

/// Why there is no sweep in a folder.
#[derive(Debug, Error)]
pub enum RecordedSweepError {
    /// A file cannot be read.
    #[error("{path}: {source}", path = path.display())]
    File {
        /// Path of the file.
        path: PathBuf,
        /// Reason of the operating system.
        source: io::Error,
    },
    /// The table has not all rows yet.
    #[error("{path} is not over; the command that began it continues it", path = path.display())]
    Unfinished {
        /// Folder of the sweep.
        path: PathBuf,
    },
    /// The table is none of a sweep, or has lost rows.
    #[error("{path}: {why}; run the sweep again with --force", path = path.display())]
    Table {
        /// Path of the table.
        path: PathBuf,
        /// What is wrong.
        why: String,
    },
    /// The scenario beside the table cannot be read.
    #[error("{path}: {source}", path = path.display())]
    Scenario {
        /// Path of the scenario.
        path: PathBuf,
        /// What is wrong with it, and where.
        source: toml::de::Error,
    },
}

impl RecordedSweep {
    /// Whether a folder has a sweep, whole or not.
    pub fn is_in(folder: &Path) -> bool {
        let [whole, unfinished, _] = SweepTable::FILES;
        [whole, unfinished].iter().any(|name| folder.join(name).is_file())
    }

    /// Reads the sweep in a folder.
    ///
    /// # Errors
    /// When the sweep is not over, or its table or scenario cannot be read.
    pub fn read(folder: &Path) -> Result<Self, RecordedSweepError> {
        let [path, unfinished, scenario] = SweepTable::FILES.map(|name| folder.join(name));
        if !path.exists() && unfinished.exists() {
            return Err(RecordedSweepError::Unfinished { path: folder.to_path_buf() });
        }
        let read = |path: &PathBuf| {
            std::fs::read_to_string(path)
                .map_err(|source| RecordedSweepError::File { path: path.clone(), source })
        };
        let (text, document) = (read(&path)?, read(&scenario)?);
        let document =
            document.parse().map_err(|source| RecordedSweepError::Scenario { path: scenario, source })?;
        let (axes, rows) = parse(&text).map_err(|why| RecordedSweepError::Table { path, why })?;
        let label = folder.canonicalize().unwrap_or_else(|_| folder.to_path_buf());
        let label = label.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
        Ok(Self { label, axes, rows, document })
    }

    /// Its results.
    pub fn results(&self) -> SweepResults<'_> {
        let is_testbed = self.axes.iter().any(|axis| axis.key.starts_with("environment."));
        SweepResults { axes: &self.axes, rows: &self.rows, document: &self.document, is_testbed }
    }
}

/// Axes and rows of a table.
fn parse(text: &str) -> Result<(Vec<Axis>, Vec<SweepRow>), String> {
    let mut reader = csv::Reader::from_reader(text.as_bytes());
    let header: Vec<String> =
        reader.headers().map_err(|error| error.to_string())?.iter().map(str::to_owned).collect();
    let keys = header.iter().position(|column| column == "seed");
    let keys = keys.map(|count| &header[..count]).filter(|keys| columns_of(keys) == header);
    let keys = keys.ok_or("its columns are not those of a sweep of this version")?;
    let rows: Vec<SweepRow> =
        reader.records().collect::<Result<_, _>>().map_err(|error| error.to_string())?;
    let axes: Vec<Axis> =
        keys.iter().enumerate().map(|(k, key)| Axis::of_words(key, words_of(&rows, k))).collect();
    let cells = axes.iter().map(|axis| axis.values.len()).product::<usize>();
    let combinations: BTreeSet<Vec<&str>> =
        rows.iter().map(|row| row.iter().take(keys.len()).collect()).collect();
    if rows.is_empty() || combinations.len() != cells || !rows.len().is_multiple_of(cells) {
        return Err(format!("it has {} rows, which is no whole grid", rows.len()));
    }
    Ok((axes, rows))
}

/// The values of a column, each once, in the order in which they come.
fn words_of(rows: &[SweepRow], column: usize) -> Vec<&str> {
    let mut words: Vec<&str> = Vec::new();
    for row in rows {
        if !words.contains(&&row[column]) {
            words.push(&row[column]);
        }
    }
    words
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(rows: &[[&str; 2]]) -> String {
        let keys = ["coordination.algorithm".to_owned(), "inflow.*.rate_veh_h".to_owned()];
        let columns = columns_of(&keys);
        let line = |row: &[&str; 2]| format!("{},{}{}\n", row[0], row[1], ",".repeat(columns.len() - 2));
        std::iter::once(columns.join(",") + "\n").chain(rows.iter().map(line)).collect()
    }

    #[test]
    fn axes_and_their_values_come_back_from_the_table() {
        let grid = [["fifo", "150"], ["fifo", "225.5"], ["insert", "150"], ["insert", "225.5"]];
        let (axes, rows) = parse(&table(&grid)).unwrap();
        let expected = ["coordination.algorithm=fifo,insert", "inflow.*.rate_veh_h=150,225.5"];
        assert_eq!(axes, expected.map(|axis| axis.parse::<Axis>().unwrap()));
        assert_eq!(rows.len(), 4);
    }

    #[test]
    fn a_table_with_lost_rows_or_other_columns_is_refused() {
        let lost = [["fifo", "150"], ["fifo", "225"], ["insert", "150"]];
        assert!(parse(&table(&lost)).unwrap_err().contains("3 rows"));
        assert!(parse("a,b\n1,2\n").unwrap_err().contains("columns"));
        assert!(parse(&table(&[])).is_err());
    }
}
