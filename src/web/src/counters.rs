//! What the page's server has sent, refused and dropped.

use city3d_network::listener::{PeerCounters, PeerCounts};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Counters that the server, its clients and the session share.
#[derive(Debug, Default)]
pub(crate) struct Counters {
    pub peers: Arc<PeerCounters>,
    pub pictures: AtomicU64,
    pub skipped_pictures: AtomicU64,
    pub skipped_states: AtomicU64,
}

impl Counters {
    pub(crate) fn counts(&self) -> WebCounts {
        let of = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        WebCounts {
            peers: self.peers.counts(),
            pictures: of(&self.pictures),
            skipped_pictures: of(&self.skipped_pictures),
            skipped_states: of(&self.skipped_states),
        }
    }
}

/// Counts since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WebCounts {
    /// Of pages and of what else has connected.
    pub peers: PeerCounts,
    /// Pictures that were sent.
    pub pictures: u64,
    /// Pictures that a slow page did not get: it got a later one.
    pub skipped_pictures: u64,
    /// States that a slow page was not told: it was told a later one.
    pub skipped_states: u64,
}
