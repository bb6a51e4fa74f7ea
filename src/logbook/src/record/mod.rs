//! Run logs: an MCAP file with snapshots, events, the digest of every tick and every command, and a CSV table of
//! the vehicles.

mod bag;
mod cdr;
mod chunks;
#[cfg(test)]
mod golden;
mod log;
mod poses;
mod reader;
mod recorder;
mod schema;
mod table;
mod transforms;

pub use bag::{is_ros1_bag, read_bag};
pub use chunks::{ChunkInfo, ChunkedLog, EntryFilter};
pub use log::{LogOrigin, LogWriter};
pub use poses::{POSE_COLUMNS, RecordedPose, read_poses};
pub use reader::{LogEntry, LogReader, is_log, last_tick, read_commands, read_network};
pub use recorder::{Backpressure, Cadence, ClosingFiles, FileWork, RecordError, Recorder};
pub use schema::{LoggedSnapshot, LoggedVehicle, NetworkCommand};
pub use table::{COLUMNS, VehicleTable};
