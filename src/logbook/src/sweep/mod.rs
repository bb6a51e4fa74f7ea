//! Results of a parameter sweep: its table, and maps of the outcome.

mod map;
mod table;

pub use map::{MAPS, SweepResults};
pub use table::{SweepHeader, SweepTable, SweepTableError, row};
