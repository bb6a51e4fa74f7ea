//! Recorded runs that are watched: played at any speed, forwards and backwards, and shown at any time of theirs.
//! What is shown are the snapshots of the log; nothing is simulated.
//!
//! A thread reads and decodes the chunks of the log around the place that is wanted, and looks through the whole log
//! for what has happened while nothing is wanted. Who watches never waits for it.

mod cast;
mod film;
mod head;
mod marks;
mod past;
mod player;
mod reader;

pub use head::{Cue, Playhead, SPEEDS};
pub use marks::{Kind, Mark, What};
pub use past::Glimpse;
pub use player::{Effort, Player, Told};

/// Why a log cannot be played.
#[derive(Debug, thiserror::Error)]
pub enum PlaybackError {
    #[error(transparent)]
    Log(#[from] crate::record::RecordError),
    #[error("{0}: there are no snapshots in it, nothing to show; record the run again")]
    Empty(std::path::PathBuf),
    #[error("the thread that reads the log cannot be started: {0}")]
    Thread(std::io::Error),
}
