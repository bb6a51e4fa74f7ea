//! Results of a parameter sweep: its table, maps of the outcome, and delay against flow.

mod delay;
mod interval;
mod map;
mod table;

pub use delay::DELAY_FLOW;
pub use interval::MeanInterval;
pub use map::{MAPS, SweepResults};
pub use table::{SweepHeader, SweepTable, SweepTableError, row};
