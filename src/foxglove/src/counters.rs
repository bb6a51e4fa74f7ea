//! What the server has sent, refused and dropped.

use city3d_network::listener::{PeerCounters, PeerCounts};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Counters that the server, its clients and the session share.
#[derive(Debug, Default)]
pub(crate) struct Counters {
    pub peers: Arc<PeerCounters>,
    pub skipped: AtomicU64,
    pub lost_moments: AtomicU64,
}

impl Counters {
    pub(crate) fn counts(&self) -> FoxgloveCounts {
        let of = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        FoxgloveCounts {
            peers: self.peers.counts(),
            skipped: of(&self.skipped),
            lost_moments: of(&self.lost_moments),
        }
    }
}

/// Counts since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FoxgloveCounts {
    /// Of all clients; one with a wrong token may watch.
    pub peers: PeerCounts,
    /// Messages that a slow client did not get: newer ones took their place.
    pub skipped: u64,
    /// Moments of the city that found no room on the way to the server.
    pub lost_moments: u64,
}

impl FoxgloveCounts {
    /// What was dropped, of any kind.
    pub fn dropped(&self) -> u64 {
        self.peers.dropped() + self.skipped + self.lost_moments
    }
}
