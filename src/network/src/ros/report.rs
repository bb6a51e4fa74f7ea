//! Logs when a master or a rosbridge becomes unreachable or reachable.

use super::NodeStatus;
use std::fmt;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// Interval of the reminders that a peer is still unreachable.
const REMINDER_INTERVAL: Duration = Duration::from_secs(60);

/// Reachability of a peer: updates the shared status and logs the changes.
pub(super) struct ReachabilityLog<'a> {
    /// Description of the peer for messages.
    peer: String,
    status: &'a NodeStatus,
    is_reachable: Option<bool>,
    logged_at: Option<Instant>,
}

impl<'a> ReachabilityLog<'a> {
    pub(super) fn new(peer: String, status: &'a NodeStatus) -> Self {
        Self { peer, status, is_reachable: None, logged_at: None }
    }

    pub(super) fn reachable(&mut self) {
        self.status.is_registered.store(true, Ordering::Relaxed);
        match self.is_reachable.replace(true) {
            Some(true) => {}
            Some(false) => {
                self.status.returns.fetch_add(1, Ordering::Relaxed);
                tracing::warn!("{} is back; the topics are registered again", self.peer);
            }
            None => tracing::info!("{}: the topics are registered", self.peer),
        }
    }

    pub(super) fn unreachable(&mut self, trouble: &dyn fmt::Display) {
        self.status.is_registered.store(false, Ordering::Relaxed);
        let is_news = self.is_reachable.replace(false) != Some(false);
        if is_news || self.logged_at.is_none_or(|at| at.elapsed() >= REMINDER_INTERVAL) {
            tracing::warn!("{} cannot be reached; the run goes on without it: {trouble}", self.peer);
            self.logged_at = Some(Instant::now());
        }
    }
}
