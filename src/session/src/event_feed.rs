//! Events, past states and past plans of the present run for a window, which itself sees only some of the snapshots: each
//! event once, and states at a steady rate.

use super::plan_sampler::PlanSampler;
use super::playback::{DriverChanges, TimelineMark};
use super::{HistoryFeed, Inputs, Moment, MomentKind, PoseWatch};
use city3d_logbook::record::LoggedPlans;
use city3d_protocol::snapshot::FrameSnapshot;
use city3d_protocol::wire::Body;
use std::sync::{Arc, Mutex, PoisonError};

/// The events of one run so far, in order of time. Copies share them; another run has another feed.
#[derive(Clone, Debug, Default)]
pub struct EventFeed(Arc<Mutex<Vec<TimelineMark>>>);

impl EventFeed {
    fn extend(&self, marks: &[TimelineMark]) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).extend_from_slice(marks);
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

/// Collects the events and the states of moments into feeds.
#[derive(Debug)]
pub(super) struct EventCollector {
    feed: EventFeed,
    history: HistoryFeed,
    plans: PlanSampler,
    drivers: DriverChanges,
    watch: PoseWatch,
    /// The events of the source have its collisions.
    tells_collisions: bool,
}

impl EventCollector {
    /// A collector for a new run.
    pub(super) fn new(tells_collisions: bool) -> Self {
        Self {
            feed: EventFeed::default(),
            history: HistoryFeed::default(),
            plans: PlanSampler::default(),
            drivers: DriverChanges::default(),
            watch: PoseWatch::default(),
            tells_collisions,
        }
    }

    /// Forgets the run: another one begins.
    pub(super) fn restart(&mut self) {
        *self = Self::new(self.tells_collisions);
    }

    /// The events of the present run.
    pub(super) fn feed(&self) -> EventFeed {
        self.feed.clone()
    }

    /// The past states of the present run.
    pub(super) fn history(&self) -> HistoryFeed {
        self.history.clone()
    }

    /// Adds the events of a moment, and returns them; the first moment of a run begins other feeds.
    pub(super) fn take(&mut self, moment: &Moment<'_>) -> Vec<TimelineMark> {
        match moment.kind {
            MomentKind::Still => return Vec::new(),
            MomentKind::First => self.restart(),
            MomentKind::Tick | MomentKind::Applied => {}
        }
        let mut marks: Vec<TimelineMark> = moment.snapshot.events.iter().map(TimelineMark::from).collect();
        marks.extend(self.watch.observe(moment.snapshot, self.tells_collisions));
        let (from_s, drivers) = (moment.from.1, &mut self.drivers);
        match moment.inputs {
            Inputs::None => {}
            Inputs::Commands(commands) => {
                marks.extend(commands.iter().filter_map(|command| drivers.mark_command(from_s, command)));
            }
            Inputs::Network(applied, _) => {
                marks.extend(applied.iter().filter_map(|applied| match applied.body {
                    Body::Drive { vehicle, pedals, .. } => drivers.mark(from_s, vehicle, pedals.is_some()),
                    _ => None,
                }));
            }
        }
        let is_grave = marks.iter().any(|mark| mark.what.is_grave());
        self.history.take(moment.snapshot, is_grave);
        self.keep_plans(moment);
        if !marks.is_empty() {
            self.feed.extend(&marks);
        }
        marks
    }

    fn keep_plans(&mut self, moment: &Moment<'_>) {
        let update = self.plans.of_moment(moment);
        if !update.is_empty() {
            let FrameSnapshot { tick, time_s, .. } = *moment.snapshot;
            self.history.take_plans(LoggedPlans { tick, time_s, update });
        }
    }
}
