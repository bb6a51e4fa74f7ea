//! Table of a sweep, which an interrupted sweep resumes.

use super::grid::{Axis, Job};
use crate::overwrite::OverwriteArgs;
use crate::{Failure, ScenarioArgs};
use city3d_logbook::figures::number;
use city3d_simulation::runner::RunMetrics;
use std::fs::{File, OpenOptions};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

/// Columns behind those of the axes and of the seed. Laboratory units.
const COLUMNS: [&str; 12] = [
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
    "state_hash",
];

/// Identity of a sweep: the columns of its table, and all inputs of its rows.
pub struct SweepHeader {
    columns: Vec<String>,
    /// All inputs of the rows, as text.
    text: String,
}

impl SweepHeader {
    pub fn new(args: &ScenarioArgs, scenario: &str, axes: &[Axis], jobs: &[Job]) -> Self {
        let keys = axes.iter().map(|axis| axis.key.clone());
        let columns =
            keys.chain(std::iter::once("seed".to_owned())).chain(COLUMNS.map(str::to_owned)).collect();
        let ScenarioArgs { seed, duration, model, environment, .. } = args;
        let version = env!("CARGO_PKG_VERSION");
        let mut text = format!(
            "# A sweep of City3D {version}: what the rows of sweep.csv depend on.\n# seed {seed:?}, duration \
             {duration:?}, model {model:?}, environment {environment:?}\n"
        );
        for job in jobs {
            let settings: Vec<String> =
                job.settings.iter().map(|(key, value)| format!("{key}={value}")).collect();
            text.push_str(&format!("# {} seed {:?}\n", settings.join(" "), job.seed));
        }
        text.push_str(scenario);
        Self { columns, text }
    }
}

/// The rows so far, and their file.
pub struct SweepTable {
    path: PathBuf,
    file: BufWriter<File>,
    rows: Vec<Vec<String>>,
}

impl SweepTable {
    /// Creates a table, or resumes that of the same sweep, whose last row may be incomplete. `--force` overwrites
    /// another one.
    ///
    /// # Errors
    /// When the folder has another or a damaged sweep, or a file cannot be read or written.
    pub fn open(
        folder: &Path,
        head: &SweepHeader,
        jobs: &[Job],
        overwrite: OverwriteArgs,
    ) -> Result<Self, Failure> {
        match Self::resume(folder, head, jobs) {
            Err(_) if overwrite.force => {
                let path = folder.join("sweep.csv");
                std::fs::remove_file(&path)
                    .map_err(|error| Failure::failed(format!("{}: {error}", path.display())))?;
                Self::resume(folder, head, jobs)
            }
            result => result,
        }
    }

    fn resume(folder: &Path, head: &SweepHeader, jobs: &[Job]) -> Result<Self, Failure> {
        let (path, beside) = (folder.join("sweep.csv"), folder.join("sweep.toml"));
        let failed = |path: &Path| {
            let path = path.display().to_string();
            move |error: std::io::Error| Failure::failed(format!("{path}: {error}"))
        };
        if path.exists() {
            let before = std::fs::read_to_string(&beside).unwrap_or_default();
            if before != head.text {
                return Err(Failure::bad_input(format!(
                    "{} is of another sweep, scenario or version; choose another --out, or --force writes over it",
                    path.display()
                )));
            }
        } else {
            std::fs::write(&beside, &head.text).map_err(failed(&beside))?;
        }
        let text = std::fs::read_to_string(&path).unwrap_or_default();
        let whole = text.rfind('\n').map_or("", |end| &text[..=end]);
        let rows = rows_of(whole, &head.columns, jobs.len()).ok_or_else(|| {
            Failure::bad_input(format!("{} is damaged; --force starts the sweep again", path.display()))
        })?;
        let file =
            OpenOptions::new().create(true).truncate(false).write(true).open(&path).map_err(failed(&path))?;
        file.set_len(whole.len() as u64).map_err(failed(&path))?;
        let file = OpenOptions::new().append(true).open(&path).map_err(failed(&path))?;
        let mut table = Self { path, file: BufWriter::new(file), rows };
        if whole.is_empty() {
            table.write(&head.columns)?;
        }
        Ok(table)
    }

    pub fn rows(&self) -> usize {
        self.rows.len()
    }

    /// Appends a row and flushes the file.
    pub fn add(&mut self, row: &[String]) -> Result<(), Failure> {
        self.write(row)?;
        self.rows.push(row.to_vec());
        Ok(())
    }

    fn write(&mut self, row: &[String]) -> Result<(), Failure> {
        let failed =
            |error: &dyn std::fmt::Display| Failure::failed(format!("{}: {error}", self.path.display()));
        let mut line = csv::Writer::from_writer(Vec::new());
        line.write_record(row).map_err(|error| failed(&error))?;
        let line = line.into_inner().map_err(|error| failed(&error))?;
        self.file.write_all(&line).and_then(|()| self.file.flush()).map_err(|error| failed(&error))
    }

    pub fn finish(self) -> Result<Vec<Vec<String>>, Failure> {
        Ok(self.rows)
    }
}

/// Parses the rows of a table; `None` when it belongs to another sweep.
fn rows_of(text: &str, columns: &[String], most: usize) -> Option<Vec<Vec<String>>> {
    if text.is_empty() {
        return Some(Vec::new());
    }
    let mut reader = csv::Reader::from_reader(text.as_bytes());
    if reader.headers().ok()?.iter().ne(columns.iter().map(String::as_str)) {
        return None;
    }
    let rows: Option<Vec<Vec<String>>> =
        reader.records().map(|record| Some(record.ok()?.iter().map(str::to_owned).collect())).collect();
    rows.filter(|rows| rows.len() <= most)
}

/// The row of a run, in the order of the columns.
pub fn row(job: &Job, seed: u64, outcome: &RunMetrics) -> Vec<String> {
    let settings = job.settings.iter().map(|(_, value)| match value {
        toml::Value::String(word) => word.clone(),
        other => other.to_string(),
    });
    let order: Vec<String> = outcome.merge_order.iter().map(ToString::to_string).collect();
    let some = |value: Option<f64>| value.map_or_else(String::new, |value| number(value, 3));
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
        format!("{:016x}", outcome.state_hash),
    ];
    settings.chain(rest).collect()
}

/// Index of a column of [`row`] after the axes.
pub fn column(axes: usize, name: &str) -> Option<usize> {
    COLUMNS.iter().position(|column| *column == name).map(|index| axes + 1 + index)
}
