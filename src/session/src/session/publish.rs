//! The state that a session publishes to its window.

use super::{MEASURE_INTERVAL, PUBLISH_INTERVAL, Session};
use crate::source::{Pace, Source};
use crate::{PacingClock, RunPhase, RunState, coordination};
use std::sync::{Arc, PoisonError};

impl<S: Source> Session<S> {
    /// Publishes the present state to the window; while the speed is unlimited not each tick, unless it has to be.
    pub(super) fn publish(&mut self, must: bool) {
        let Some(view) = &mut self.view else { return };
        let now = self.host.clock.now();
        let (snapshot, phase) = (self.source.snapshot(), self.source.phase());
        self.rate.record(now, snapshot.time_s);
        let is_running = phase == RunPhase::Running;
        let is_paced = self.clock.is_some() || !is_running || self.source.pace() == Pace::Arrivals;
        if !must && !is_paced && now.saturating_duration_since(view.published_at) < PUBLISH_INTERVAL {
            return;
        }
        let is_new = std::mem::take(&mut view.is_stale);
        let before = if is_new {
            std::mem::replace(&mut view.latest, Arc::new(snapshot.clone()))
        } else {
            Arc::clone(&view.latest_state.get().before)
        };
        // After a reset there is nothing to interpolate between.
        let before = if before.tick < view.latest.tick { before } else { Arc::clone(&view.latest) };
        let is_running = phase == RunPhase::Running;
        if is_running && self.source.pace() == Pace::Arrivals && is_new {
            // What arrives is shown as it was paced where it comes from.
            let factor = if self.rate.factor() > 0.0 { self.rate.factor() } else { 1.0 };
            view.arrival_clock = Some(PacingClock::new(now, before.time_s, factor));
        }
        let clock = self.clock.or(view.arrival_clock.filter(|_| is_running));
        let coordination = match (self.tells_plans, self.source.mainframe()) {
            (false, _) => None,
            (true, Some(mainframe)) => coordination(mainframe, self.source.experiment(), snapshot.time_s),
            (true, None) => self.source.heard().and_then(|held| held.plans.at(snapshot.time_s)),
        };
        let (folder, next_folder, outcome) = match &view.files {
            Some(files) => {
                let files = files.lock().unwrap_or_else(PoisonError::into_inner);
                (files.folder.clone(), files.next_folder.clone(), files.outcome.clone())
            }
            None => (None, None, None),
        };
        // A copy of the measures at every tick would cost more than the measures.
        let is_due = now.saturating_duration_since(view.measured_at) >= MEASURE_INTERVAL;
        let traffic = if must || !is_running || is_due {
            view.measured_at = now;
            view.events.traffic().map(Arc::new)
        } else {
            view.latest_state.get().traffic.clone()
        };
        let insight = self.decisions.insight(&self.source).map(Arc::new);
        view.latest_state.put(RunState {
            before,
            now: Arc::clone(&view.latest),
            phase,
            speed: self.speed,
            clock,
            real_time_factor: if is_running { self.rate.factor() } else { 0.0 },
            run: self.run,
            folder,
            next_folder,
            outcome,
            link: view.link.clone(),
            ends: Arc::clone(&view.ends),
            coordination: coordination.map(Arc::new),
            insight,
            events: view.events.feed(),
            history: view.events.history(),
            decisions: view.events.decisions(),
            traffic,
            goal: self.goal,
            refusal: self.refusal.clone(),
            has_ended: false,
        });
        view.published_at = now;
        view.updates.give();
    }
}
