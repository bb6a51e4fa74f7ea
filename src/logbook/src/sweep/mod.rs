//! Results of parameter sweeps: tables, maps of the outcome, and delays by curves.

mod delay;
mod delay_figure;
mod interval;
mod map;
mod recorded;
mod table;

pub use delay::{DelayAxis, DelayCurves, DelayPoint, DifferentAxes};
pub use delay_figure::DELAY_FLOW;
pub use interval::MeanInterval;
pub use map::{MAPS, SweepResults};
pub use recorded::{RecordedSweep, RecordedSweepError};
pub use table::{SweepHeader, SweepTable, SweepTableError, row};
