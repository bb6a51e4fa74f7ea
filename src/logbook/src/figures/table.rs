//! Tidy tables: one row for each observation, one column for each quantity, units in the columns' names.

use std::io;

/// A table of text and numbers.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TidyTable {
    /// Names of the columns, with their units.
    pub columns: Vec<&'static str>,
    /// Rows with one cell for each column; an empty cell has no value.
    pub rows: Vec<Vec<String>>,
}

impl TidyTable {
    /// A table with these columns and no rows.
    pub fn new(columns: &[&'static str]) -> Self {
        Self { columns: columns.to_vec(), rows: Vec::new() }
    }

    /// The table as CSV.
    ///
    /// # Errors
    /// Where a row has not as many cells as there are columns.
    pub fn to_csv(&self) -> io::Result<Vec<u8>> {
        let mut writer = csv::Writer::from_writer(Vec::new());
        writer.write_record(&self.columns)?;
        for row in &self.rows {
            writer.write_record(row)?;
        }
        writer.into_inner().map_err(|error| io::Error::other(error.to_string()))
    }
}

/// A number with so many decimals; empty for what is not a number.
pub fn number(value: f64, decimals: usize) -> String {
    if value.is_finite() { format!("{value:.decimals$}") } else { String::new() }
}
