//! What the page's server has sent, refused and dropped.

use std::sync::atomic::{AtomicU64, Ordering};

/// Counters that the server, its clients and the session share.
#[derive(Debug, Default)]
pub(crate) struct Counters {
    pub messages: AtomicU64,
    pub pictures: AtomicU64,
    pub skipped_pictures: AtomicU64,
    pub refused: AtomicU64,
    pub wrong_tokens: AtomicU64,
    pub invalid: AtomicU64,
    pub slow: AtomicU64,
    pub forbidden: AtomicU64,
    pub lost_orders: AtomicU64,
    /// Pages that are connected now.
    pub pages: AtomicU64,
}

impl Counters {
    pub(crate) fn add(counter: &AtomicU64, count: u64) {
        counter.fetch_add(count, Ordering::Relaxed);
    }

    pub(crate) fn counts(&self) -> WebCounts {
        let of = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        WebCounts {
            messages: of(&self.messages),
            pictures: of(&self.pictures),
            skipped_pictures: of(&self.skipped_pictures),
            refused: of(&self.refused),
            wrong_tokens: of(&self.wrong_tokens),
            invalid: of(&self.invalid),
            slow: of(&self.slow),
            forbidden: of(&self.forbidden),
            lost_orders: of(&self.lost_orders),
            pages: of(&self.pages),
        }
    }
}

/// Counts since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WebCounts {
    /// Messages that were sent to pages, pictures included.
    pub messages: u64,
    /// Pictures that were sent.
    pub pictures: u64,
    /// Pictures that a slow page did not get: it got a later one.
    pub skipped_pictures: u64,
    /// Connections and requests that were refused: wrong host or origin, no HTTP, too many.
    pub refused: u64,
    /// Pages with a wrong token, which were disconnected.
    pub wrong_tokens: u64,
    /// Pages that were disconnected for messages which are too large, too many or no messages.
    pub invalid: u64,
    /// Pages that were disconnected because they did not read.
    pub slow: u64,
    /// Orders of pages without the token.
    pub forbidden: u64,
    /// Orders that found no room.
    pub lost_orders: u64,
    /// Pages that are connected now.
    pub pages: u64,
}

impl WebCounts {
    /// What was dropped, of any kind.
    pub fn dropped(&self) -> u64 {
        self.refused + self.wrong_tokens + self.invalid + self.slow + self.forbidden + self.lost_orders
    }
}
