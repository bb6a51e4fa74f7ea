//! Run logs: an MCAP file with every snapshot, event and command of a person, and a CSV table of the vehicles.

mod cdr;
mod log;
mod reader;
mod recorder;
mod schema;
mod table;

pub use log::LogWriter;
pub use reader::read_commands;
pub use recorder::{Cadence, RecordError, Recorder};
pub use table::{COLUMNS, VehicleTable};
