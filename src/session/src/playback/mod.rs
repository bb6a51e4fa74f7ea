//! Playback of recorded runs at any speed, forwards and backwards, with random access to any time. It shows the
//! snapshots of the log, interpolated; nothing is simulated. [`PastPlayer`] does the same with the past of a run that goes
//! on.
//!
//! A prefetch thread decodes the MCAP chunks around the playhead into a bounded cache. While no chunk is requested,
//! it scans the whole log for events. The window never waits for it.

mod benchmark;
mod chunk_cache;
mod log_traffic;
mod marks;
mod past;
mod past_cache;
mod player;
mod playhead;
mod prefetch;
mod registry;
mod shared;

pub use benchmark::{PlaybackReport, benchmark};
pub(crate) use marks::{DriverChanges, with_priority};
pub use marks::{MarkKind, Occurrence, TimelineMark};
pub use past::PastPlayer;
pub use player::{LogInfo, PlaybackStats, Player};
pub use playhead::{PlaybackCommand, Playhead, SPEEDS};
pub use shared::{PlayerRemote, SharedPlayer};

/// Why a log cannot be played.
#[derive(Debug, thiserror::Error)]
pub enum PlaybackError {
    /// The file cannot be read, or is not a log.
    #[error(transparent)]
    Log(#[from] city3d_logbook::record::RecordError),
    /// The log has no snapshots.
    #[error("{0}: the log has no snapshots to show; record the run again")]
    Empty(std::path::PathBuf),
    /// The operating system refuses the prefetch thread.
    #[error("the thread that reads the log cannot be started: {0}")]
    Thread(std::io::Error),
}
