//! Run logs: an MCAP file with every snapshot and event, and a CSV table of the vehicles.

mod cdr;
mod log;
mod recorder;
mod schema;
mod table;

pub use log::LogWriter;
pub use recorder::{Cadence, RecordError, Recorder};
pub use table::{COLUMNS, VehicleTable};
