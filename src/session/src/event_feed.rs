//! Events, past states, past plans and traffic of the present run for a window, which itself sees only some of the
//! snapshots: each event once, states at a steady rate, and measures of every step.

use super::decision_feed::DecisionCollector;
use super::plan_sampler::PlanSampler;
use super::playback::{DriverChanges, Occurrence, TimelineMark, with_priority};
use super::{
    DecisionFeed, HistoryFeed, Inputs, Moment, MomentKind, PoseWatch, RoadWatch, RunTraffic, TrafficRecorder,
    decisions,
};
use city3d_logbook::record::LoggedPlans;
use city3d_protocol::snapshot::{EventKind, FrameSnapshot, Status};
use city3d_protocol::wire::Body;
use std::sync::{Arc, Mutex, PoisonError};

/// The events of one run so far, in order of time. Copies share them; another run has another feed.
#[derive(Clone, Debug, Default)]
pub struct EventFeed(Arc<Mutex<Vec<TimelineMark>>>);

impl EventFeed {
    /// A feed of these events.
    pub(crate) fn of(marks: &[TimelineMark]) -> Self {
        Self(Arc::new(Mutex::new(marks.to_vec())))
    }

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
    decisions: DecisionCollector,
    traffic: Option<TrafficRecorder>,
    drivers: DriverChanges,
    watch: PoseWatch,
    road: Option<RoadWatch>,
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
            decisions: DecisionCollector::default(),
            traffic: None,
            drivers: DriverChanges::default(),
            watch: PoseWatch::default(),
            road: None,
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

    /// The past decisions of the present run.
    pub(super) fn decisions(&self) -> DecisionFeed {
        self.decisions.feed()
    }

    /// What has been measured of the present run.
    pub(super) fn traffic(&self) -> Option<RunTraffic> {
        self.traffic.as_ref().map(TrafficRecorder::traffic)
    }

    /// Adds the events of a moment, and returns them; the first moment of a run begins other feeds.
    pub(super) fn take(&mut self, moment: &Moment<'_>) -> Vec<TimelineMark> {
        match moment.kind {
            MomentKind::Still => return Vec::new(),
            MomentKind::First => self.restart(),
            MomentKind::Tick | MomentKind::Applied => {}
        }
        let has_collided =
            |id| moment.snapshot.vehicle(id).is_some_and(|vehicle| vehicle.status == Status::Collided);
        let events = moment.snapshot.events.iter();
        let mut marks: Vec<TimelineMark> =
            events.map(|event| TimelineMark::of_event(event, has_collided(event.vehicle))).collect();
        let traffic = self.traffic.get_or_insert_with(|| TrafficRecorder::new(moment.experiment));
        let merges = traffic.observe(moment.mainframe, moment.snapshot);
        marks.extend(merges.iter().map(TimelineMark::from));
        self.decisions.take(moment);
        tell_priority(&mut marks, moment);
        marks.extend(self.watch.observe(moment.snapshot, self.tells_collisions));
        let road = self.road.get_or_insert_with(|| RoadWatch::new(moment.experiment));
        marks.extend(road.observe(moment.snapshot));
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
        let is_last = moment.snapshot.tick == moment.experiment.ticks();
        self.history.take(moment.snapshot, is_grave || is_last);
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

/// Names whom vehicles yield to, where the control framework tells.
fn tell_priority(marks: &mut [TimelineMark], moment: &Moment<'_>) {
    let yields = |mark: &TimelineMark| mark.what == Occurrence::Event(EventKind::Yield);
    if !marks.iter().any(yields) {
        return;
    }
    let told = match moment.mainframe {
        Some(mainframe) => Some(decisions(mainframe, moment.experiment)),
        None => moment.heard.and_then(|heard| heard.decisions.at(moment.snapshot.time_s)),
    };
    let told = told.unwrap_or_default();
    for mark in marks.iter_mut().filter(|mark| yields(mark)) {
        let vehicle = mark.vehicle;
        let of_vehicle = told.iter().filter(|decision| decision.vehicle == vehicle);
        with_priority(mark, of_vehicle);
    }
}
