//! Playback of recorded runs at any speed, forwards and backwards, with random access to any time. It shows the
//! snapshots of the log, interpolated; nothing is simulated.
//!
//! A prefetch thread decodes the MCAP chunks around the playhead into a bounded cache. While no chunk is requested,
//! it scans the whole log for events. The window never waits for it.

mod benchmark;
mod chunk_cache;
mod marks;
mod player;
mod playhead;
mod plot_cache;
mod prefetch;
mod registry;

pub use benchmark::{PlaybackReport, benchmark};
pub(crate) use marks::DriverChanges;
pub use marks::{MarkKind, Occurrence, TimelineMark};
pub use player::{LogInfo, PlaybackStats, Player};
pub use playhead::{PlaybackCommand, Playhead, SPEEDS};
pub use plot_cache::PlotSample;

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
