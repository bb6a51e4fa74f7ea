//! Events of the present run for a window: each once, although a window sees only some of the snapshots.

use super::playback::{DriverChanges, TimelineMark};
use super::{Inputs, Moment, MomentKind};
use city3d_protocol::wire::Body;
use std::sync::{Arc, Mutex, PoisonError};

/// The events of one run so far, in order of time. Copies share them; another run has another feed.
#[derive(Clone, Debug, Default)]
pub struct EventFeed(Arc<Mutex<Vec<TimelineMark>>>);

impl EventFeed {
    fn extend(&self, marks: impl Iterator<Item = TimelineMark>) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).extend(marks);
    }
}

/// What a reader has seen of the events.
#[derive(Debug, Default)]
pub struct EventReader {
    feed: EventFeed,
    marks: Vec<TimelineMark>,
}

impl EventReader {
    /// Takes the events that have come since; those of a run before are dropped. Returns how many were known before.
    pub fn read(&mut self, feed: &EventFeed) -> usize {
        if !Arc::ptr_eq(&self.feed.0, &feed.0) {
            (self.feed, self.marks) = (feed.clone(), Vec::new());
        }
        let known = self.marks.len();
        let marks = self.feed.0.lock().unwrap_or_else(PoisonError::into_inner);
        self.marks.extend_from_slice(&marks[known..]);
        known
    }

    /// The events that it has read.
    pub fn marks(&self) -> &[TimelineMark] {
        &self.marks
    }
}

/// Collects the events of moments into feeds.
#[derive(Debug, Default)]
pub(super) struct EventCollector {
    feed: EventFeed,
    drivers: DriverChanges,
}

impl EventCollector {
    /// The feed of the present run.
    pub(super) fn feed(&self) -> EventFeed {
        self.feed.clone()
    }

    /// Adds the events of a moment; the first one of a run begins another feed.
    pub(super) fn take(&mut self, moment: &Moment<'_>) {
        match moment.kind {
            MomentKind::Still => return,
            MomentKind::First => *self = Self::default(),
            MomentKind::Tick | MomentKind::Applied => {}
        }
        self.feed.extend(moment.snapshot.events.iter().map(TimelineMark::from));
        let (from_s, drivers) = (moment.from.1, &mut self.drivers);
        match moment.inputs {
            Inputs::None => {}
            Inputs::Commands(commands) => {
                self.feed.extend(commands.iter().filter_map(|command| drivers.mark_command(from_s, command)));
            }
            Inputs::Network(applied, _) => {
                self.feed.extend(applied.iter().filter_map(|applied| match applied.body {
                    Body::Drive { vehicle, pedals, .. } => drivers.mark(from_s, vehicle, pedals.is_some()),
                    _ => None,
                }));
            }
        }
    }
}
