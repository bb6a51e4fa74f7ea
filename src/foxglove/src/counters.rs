//! What the server has sent, refused and dropped.

use std::sync::atomic::{AtomicU64, Ordering};

/// Counters that the server, its clients and the session share.
#[derive(Debug, Default)]
pub(crate) struct Counters {
    pub messages: AtomicU64,
    pub skipped: AtomicU64,
    pub lost_moments: AtomicU64,
    pub refused: AtomicU64,
    pub wrong_tokens: AtomicU64,
    pub invalid: AtomicU64,
    pub slow: AtomicU64,
    pub forbidden: AtomicU64,
    pub lost_orders: AtomicU64,
    /// Clients that are connected now.
    pub clients: AtomicU64,
}

impl Counters {
    pub(crate) fn add(counter: &AtomicU64, count: u64) {
        counter.fetch_add(count, Ordering::Relaxed);
    }

    pub(crate) fn counts(&self) -> FoxgloveCounts {
        let of = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        FoxgloveCounts {
            messages: of(&self.messages),
            skipped: of(&self.skipped),
            lost_moments: of(&self.lost_moments),
            refused: of(&self.refused),
            wrong_tokens: of(&self.wrong_tokens),
            invalid: of(&self.invalid),
            slow: of(&self.slow),
            forbidden: of(&self.forbidden),
            lost_orders: of(&self.lost_orders),
            clients: of(&self.clients),
        }
    }
}

/// Counts since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FoxgloveCounts {
    /// Messages that were sent to clients, of all kinds.
    pub messages: u64,
    /// Messages that a slow client did not get: newer ones took their place.
    pub skipped: u64,
    /// Moments of the city that found no room on the way to the server.
    pub lost_moments: u64,
    /// Connections that were refused: wrong origin or subprotocol, no WebSocket, too many.
    pub refused: u64,
    /// Clients with a wrong token, which may only watch.
    pub wrong_tokens: u64,
    /// Clients that were disconnected for messages which are too large, too many or no messages.
    pub invalid: u64,
    /// Clients that were disconnected because they did not read, or were silent.
    pub slow: u64,
    /// Orders of clients without the token.
    pub forbidden: u64,
    /// Orders that found no room.
    pub lost_orders: u64,
    /// Clients that are connected now.
    pub clients: u64,
}

impl FoxgloveCounts {
    /// What was dropped, of any kind.
    pub fn dropped(&self) -> u64 {
        let lost = self.skipped + self.lost_moments + self.lost_orders;
        lost + self.refused + self.wrong_tokens + self.invalid + self.slow + self.forbidden
    }
}
