//! Run logs: an MCAP file with snapshots, events, the digest of every tick and every command, and a CSV table of
//! the vehicles.

mod bag;
mod budget;
mod chunks;
mod decisions;
#[cfg(test)]
mod golden;
mod input;
mod log;
mod mcap_writer;
mod plans;
mod poses;
mod reader;
mod recorder;
mod records;
mod schema;
mod table;
mod topic;
mod transforms;

/// Messages of logs, for those who pass them on as they are.
pub mod message {
    pub use super::decisions::encode_decisions;
    pub use super::log::nanoseconds;
    pub use super::plans::encode_plans;
    pub use super::schema::{encode_event, encode_network, encode_snapshot, encode_tick};
    pub use super::transforms::{TRANSFORM_SCHEMA, TRANSFORM_TYPE, encode_transform};
}

pub use bag::{is_bag_folder, read_bag};
pub use chunks::{ChunkInfo, ChunkedLog, EntryFilter};
pub use decisions::LoggedDecisions;
pub use input::{FileKind, file_kind, is_log};
pub use log::{LogOrigin, LogWriter};
pub use plans::LoggedPlans;
pub use poses::{POSE_COLUMNS, RecordedPose, read_poses};
pub use reader::{LogEntry, LogReader, last_tick, read_commands, read_network};
pub use recorder::{
    AroundError, Backpressure, Cadence, ClosingFiles, FileWork, FolderWork, RecordError, Recorder,
};
pub use records::Truncation;
pub use schema::{LoggedSnapshot, LoggedVehicle, NetworkCommand};
pub use table::{COLUMNS, VehicleTable};
pub use topic::LogTopic;
