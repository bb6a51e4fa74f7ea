//! Run logs: an MCAP file with every snapshot, event and command of a person, and a CSV table of the vehicles.

mod cdr;
mod log;
mod reader;
mod recorder;
mod schema;
mod table;

pub use log::LogWriter;
pub use reader::{read_commands, read_network};
pub use recorder::{Cadence, RecordError, Recorder};
pub use schema::NetworkCommand;
pub use table::{COLUMNS, VehicleTable};
