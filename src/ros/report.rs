//! What is said of a master or a rosbridge as it goes and comes.

use super::NodeStatus;
use std::fmt;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// That it is still away is said no more often than this.
const TELL_EVERY: Duration = Duration::from_secs(60);

/// What has been said of it.
pub(super) struct Report<'a> {
    /// What it is, and where.
    peer: String,
    status: &'a NodeStatus,
    is_there: Option<bool>,
    told: Option<Instant>,
}

impl<'a> Report<'a> {
    pub(super) fn new(peer: String, status: &'a NodeStatus) -> Self {
        Self { peer, status, is_there: None, told: None }
    }

    pub(super) fn is_there(&mut self) {
        self.status.is_registered.store(true, Ordering::Relaxed);
        match self.is_there.replace(true) {
            Some(true) => {}
            Some(false) => {
                self.status.returns.fetch_add(1, Ordering::Relaxed);
                tracing::warn!("{} is there again, and knows the topics", self.peer);
            }
            None => tracing::info!("{} knows the topics", self.peer),
        }
    }

    pub(super) fn is_away(&mut self, trouble: &dyn fmt::Display) {
        self.status.is_registered.store(false, Ordering::Relaxed);
        let is_news = self.is_there.replace(false) != Some(false);
        if is_news || self.told.is_none_or(|told| told.elapsed() >= TELL_EVERY) {
            tracing::warn!("{} is away; nothing waits for it, it is tried again: {trouble}", self.peer);
            self.told = Some(Instant::now());
        }
    }
}
