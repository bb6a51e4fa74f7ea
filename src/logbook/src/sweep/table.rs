//! Table of a sweep, which an interrupted sweep resumes.

use crate::figures::number;
use city3d_outputs::WholeFile;
use city3d_simulation::runner::{CoordinationReport, RunMetrics, TrafficMetrics};
use city3d_simulation::scenario::Overrides;
use city3d_simulation::sweep::{Grid, Job};
use std::fs::{File, OpenOptions};
use std::io::{self, BufWriter, ErrorKind, Write};
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Columns behind those of the axes and of the seed. Laboratory units; fuel is that of a car at full scale.
pub(super) const COLUMNS: [&str; 38] = [
    "merge_order",
    "squeezed_in",
    "all_merged_s",
    "mean_wait_s",
    "collisions",
    "stops",
    "merges",
    "mean_distance_m",
    "mean_speed_mps",
    "longest_stand_s",
    "max_lateral_error_m",
    "entered",
    "left",
    "mean_held_s",
    "passages",
    "mean_travel_s",
    "mean_delay_s",
    "max_delay_s",
    "held_s",
    "throughput_per_h",
    "slow_stops",
    "stood_s",
    "mean_queue",
    "max_queue",
    "order_inversions",
    "fuel_ml",
    "fuel_with_cruise_ml",
    "int_u2_m2ps3",
    "min_ttc_s",
    "max_drac_mps2",
    "min_gap_m",
    "min_pet_s",
    "plans",
    "replans",
    "infeasible",
    "filter_limited",
    "least_barrier_m",
    "state_hash",
];

/// The values of a run, in the order of the columns of the table.
pub use csv::StringRecord as SweepRow;

/// Identity of a sweep: the columns of its table, and all inputs of its rows.
#[derive(Clone, Debug)]
pub struct SweepHeader {
    columns: Vec<String>,
    /// All inputs of the rows, as text.
    text: String,
    /// Number of runs.
    runs: usize,
}

impl SweepHeader {
    /// The identity of the runs of a grid: `scenario` is the text of the scenario, `overrides` what is set otherwise in all
    /// of them.
    pub fn new(overrides: &Overrides, scenario: &str, grid: &Grid) -> Self {
        let columns = columns_of_grid(grid);
        let Overrides { seed, duration_s, model, environment, .. } = overrides;
        let version = env!("CARGO_PKG_VERSION");
        let mut text = format!(
            "# A sweep of City3D {version}: what the rows of sweep.csv depend on.\n# seed {seed:?}, duration \
             {duration_s:?}, model {model:?}, environment {environment:?}\n"
        );
        for job in grid.jobs() {
            let settings: Vec<String> = job.settings.iter().map(ToString::to_string).collect();
            text.push_str(&format!("# {} seed {:?}\n", settings.join(" "), job.seed));
        }
        text.push_str(scenario);
        Self { columns, text, runs: grid.runs() }
    }
}

/// Why the table of a sweep cannot be used.
#[derive(Debug, Error)]
pub enum SweepTableError {
    /// The folder has the table of another sweep.
    #[error("{path} is of another sweep, scenario or version", path = path.display())]
    Other {
        /// Path of the table.
        path: PathBuf,
    },
    /// The table does not belong to its `sweep.toml`.
    #[error("{path} is damaged", path = path.display())]
    Damaged {
        /// Path of the table.
        path: PathBuf,
    },
    /// A file cannot be written or removed.
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
        /// Path of the table.
        path: PathBuf,
        /// What is wrong with the row.
        source: csv::Error,
    },
}

/// The rows so far and their file, with the identity of the sweep beside it in `sweep.toml`. The file is `sweep.csv.part`
/// until it has all rows, then `sweep.csv`.
#[derive(Debug)]
pub struct SweepTable {
    /// The place of the whole table, and that of one with fewer rows.
    path: PathBuf,
    unfinished: PathBuf,
    /// `None` once the table is whole.
    file: Option<BufWriter<File>>,
    rows: Vec<SweepRow>,
    /// Number of rows of the whole table.
    runs: usize,
}

impl SweepTable {
    /// Names of its files: the whole table, one with fewer rows, and the identity.
    pub const FILES: [&str; 3] = ["sweep.csv", "sweep.csv.part", "sweep.toml"];

    /// Creates a table in an existing folder, or resumes that of the same sweep, whose last row may be incomplete.
    ///
    /// # Errors
    /// When the folder has another or a damaged sweep, or a file cannot be written.
    pub fn open(folder: &Path, head: &SweepHeader) -> Result<Self, SweepTableError> {
        let [path, unfinished, beside] = Self::FILES.map(|name| folder.join(name));
        let there = [&path, &unfinished].into_iter().find(|path| path.exists()).cloned();
        match &there {
            Some(there) => {
                let before = std::fs::read_to_string(&beside).unwrap_or_default();
                if before != head.text {
                    return Err(SweepTableError::Other { path: there.clone() });
                }
            }
            None => WholeFile::write(&beside, head.text.as_bytes()).map_err(failed(&beside))?,
        }
        let text = there.as_ref().and_then(|there| std::fs::read_to_string(there).ok()).unwrap_or_default();
        let whole = text.rfind('\n').map_or("", |end| &text[..=end]);
        let Some(rows) = rows_of(whole, &head.columns, head.runs) else {
            return Err(SweepTableError::Damaged { path: there.unwrap_or(path) });
        };
        let mut table = Self { path, unfinished, file: None, rows, runs: head.runs };
        if table.rows.len() < table.runs {
            if there.is_some_and(|there| there == table.path) {
                // Rows were taken out of it.
                std::fs::rename(&table.path, &table.unfinished).map_err(failed(&table.path))?;
            }
            table.append(whole.len() as u64, &head.columns)?;
        } else if there.is_some_and(|there| there == table.unfinished) {
            table.complete()?;
        }
        Ok(table)
    }

    /// Opens the unfinished table behind its whole rows.
    fn append(&mut self, whole: u64, columns: &[String]) -> Result<(), SweepTableError> {
        let path = &self.unfinished;
        let file = OpenOptions::new().create(true).append(true).open(path).map_err(failed(path))?;
        file.set_len(whole).map_err(failed(path))?;
        self.file = Some(BufWriter::new(file));
        if whole == 0 {
            self.write(&columns.iter().collect())?;
        }
        self.flush()
    }

    /// Gives the table its name once it has all rows.
    fn complete(&mut self) -> Result<(), SweepTableError> {
        if self.rows.len() < self.runs {
            return Ok(());
        }
        self.file = None;
        std::fs::rename(&self.unfinished, &self.path).map_err(failed(&self.path))
    }

    /// Removes the table in a folder and creates an empty one.
    ///
    /// # Errors
    /// When a file cannot be removed or written.
    pub fn replace(folder: &Path, head: &SweepHeader) -> Result<Self, SweepTableError> {
        for path in Self::FILES.map(|name| folder.join(name)) {
            match std::fs::remove_file(&path) {
                Err(error) if error.kind() != ErrorKind::NotFound => return Err(failed(&path)(error)),
                _ => {}
            }
        }
        Self::open(folder, head)
    }

    /// The number of rows.
    pub fn rows(&self) -> usize {
        self.rows.len()
    }

    /// Appends a row and flushes the file; the last row completes it.
    ///
    /// # Errors
    /// When the row cannot be written.
    pub fn add(&mut self, row: SweepRow) -> Result<(), SweepTableError> {
        self.add_all([row])
    }

    /// Appends rows and flushes the file once; the last row of the sweep completes it.
    ///
    /// # Errors
    /// When they cannot be written.
    pub fn add_all(&mut self, rows: impl IntoIterator<Item = SweepRow>) -> Result<(), SweepTableError> {
        for row in rows {
            self.write(&row)?;
            self.rows.push(row);
        }
        self.flush()?;
        // Without a file it is whole already.
        if self.file.is_some() { self.complete() } else { Ok(()) }
    }

    fn write(&mut self, row: &SweepRow) -> Result<(), SweepTableError> {
        let line = line_of(row).map_err(|source| SweepTableError::Row { path: self.path.clone(), source })?;
        let Some(file) = &mut self.file else { return Ok(()) };
        file.write_all(&line).map_err(failed(&self.unfinished))
    }

    fn flush(&mut self) -> Result<(), SweepTableError> {
        self.file.as_mut().map_or(Ok(()), |file| file.flush()).map_err(failed(&self.unfinished))
    }

    /// All rows, in the order of the jobs.
    pub fn into_rows(self) -> Vec<SweepRow> {
        self.rows
    }
}

/// A row as a line of the table.
pub(super) fn line_of(row: &SweepRow) -> Result<Vec<u8>, csv::Error> {
    let mut line = csv::Writer::from_writer(Vec::new());
    line.write_record(row)?;
    line.into_inner().map_err(|error| error.into_error().into())
}

/// The error of a file.
fn failed(path: &Path) -> impl FnOnce(io::Error) -> SweepTableError + use<> {
    let path = path.to_path_buf();
    move |source| SweepTableError::File { path, source }
}

/// Parses the rows of a table; `None` when it belongs to another sweep.
pub(super) fn rows_of(text: &str, columns: &[String], most: usize) -> Option<Vec<SweepRow>> {
    if text.is_empty() {
        return Some(Vec::new());
    }
    let mut reader = csv::Reader::from_reader(text.as_bytes());
    if reader.headers().ok()?.iter().ne(columns.iter().map(String::as_str)) {
        return None;
    }
    let rows: Option<Vec<SweepRow>> = reader.records().map(Result::ok).collect();
    rows.filter(|rows| rows.len() <= most)
}

/// The row of a run with its seed, in the order of the columns.
pub fn row(job: &Job, seed: u64, outcome: &RunMetrics) -> SweepRow {
    let settings = job.settings.iter().map(|change| match &change.value {
        toml::Value::String(word) => word.clone(),
        other => other.to_string(),
    });
    let order: Vec<String> = outcome.merge_order.iter().map(ToString::to_string).collect();
    let some = |value: Option<f64>| value.map_or_else(String::new, |value| number(value, 3));
    let come = outcome.all_inflows();
    let rest = [
        seed.to_string(),
        order.join(" "),
        outcome.squeezed_in.map_or_else(String::new, |count| count.to_string()),
        some(outcome.all_merged_s),
        some(outcome.mean_wait_s),
        outcome.collisions.to_string(),
        outcome.stops.to_string(),
        outcome.merges.to_string(),
        number(outcome.mean_distance_m, 3),
        number(outcome.mean_speed_mps, 5),
        number(outcome.longest_stand_s, 2),
        number(outcome.max_lateral_error_m, 6),
        come.map_or_else(String::new, |come| come.entered.to_string()),
        come.map_or_else(String::new, |come| come.left.to_string()),
        some(come.map(|come| come.mean_held_s)),
    ];
    let hash = format!("{:016x}", outcome.state_hash);
    let coordination = coordination(outcome.coordination.as_ref());
    settings.chain(rest).chain(traffic(&outcome.traffic)).chain(coordination).chain([hash]).collect()
}

/// The columns of coordination; empty where there is none.
fn coordination(report: Option<&CoordinationReport>) -> [String; 5] {
    let Some(report) = report else { return Default::default() };
    let (zones, filter) = (report.totals(), report.safety_filter);
    [
        zones.plans.to_string(),
        zones.replans.to_string(),
        zones.infeasible.to_string(),
        filter.limited.to_string(),
        filter.least_barrier_m.map_or_else(String::new, |barrier_m| number(barrier_m, 6)),
    ]
}

/// The columns of the traffic.
fn traffic(of: &TrafficMetrics) -> [String; 18] {
    let some = |value: Option<f64>, decimals| value.map_or_else(String::new, |value| number(value, decimals));
    let TrafficMetrics { passages, queue, safety, .. } = of;
    [
        passages.count.to_string(),
        some(passages.mean_travel_s, 4),
        some(passages.mean_delay_s, 4),
        some(passages.max_delay_s, 4),
        number(passages.held_s, 3),
        some(passages.throughput_per_h, 2),
        passages.stops.to_string(),
        number(passages.stood_s, 3),
        number(queue.mean(), 4),
        queue.max.to_string(),
        of.order_inversions.to_string(),
        number(of.fuel_ml, 3),
        number(of.fuel_with_cruise_ml, 3),
        number(of.int_u2_m2ps3, 7),
        some(safety.min_ttc_s, 3),
        some(Some(safety.max_drac_mps2).filter(|drac| drac.is_finite()), 5),
        some(safety.min_gap_m, 5),
        some(safety.min_pet_s, 3),
    ]
}

/// The columns of the table of a grid.
pub(super) fn columns_of_grid(grid: &Grid) -> Vec<String> {
    let keys: Vec<String> = grid.axes.iter().map(|axis| axis.key.clone()).collect();
    columns_of(&keys)
}

/// The columns of a table over axes with these keys.
pub(super) fn columns_of(keys: &[String]) -> Vec<String> {
    let seed = std::iter::once("seed".to_owned());
    keys.iter().cloned().chain(seed).chain(COLUMNS.map(str::to_owned)).collect()
}

/// Index of a column of [`row`] after the axes.
pub fn column(axes: usize, name: &str) -> Option<usize> {
    COLUMNS.iter().position(|column| *column == name).map(|index| axes + 1 + index)
}
