//! Decisions of the present run for a window that looks back: sampled as those of a log are, and kept within a limit of
//! memory.

use super::Moment;
use super::decision_sampler::DecisionSampler;
use city3d_protocol::snapshot::ControlDecision;
use city3d_simulation::runner::HeldDecisions;
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Most decisions that are kept of one run; of more, the oldest are forgotten.
const MOST: usize = 400_000;

/// The decisions of one run so far. Copies share them; another run has another feed.
#[derive(Clone, Debug, Default)]
pub struct DecisionFeed(Arc<Mutex<KeptDecisions>>);

#[derive(Debug, Default)]
struct KeptDecisions {
    /// In order of time, each with the simulated time at which it was sampled.
    told: VecDeque<(f64, ControlDecision)>,
}

impl DecisionFeed {
    fn lock(&self) -> MutexGuard<'_, KeptDecisions> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn extend(&self, time_s: f64, decisions: Vec<ControlDecision>) {
        let told = &mut self.lock().told;
        told.extend(decisions.into_iter().map(|decision| (time_s, decision)));
        let surplus = told.len().saturating_sub(MOST);
        told.drain(..surplus);
    }

    /// The decisions that held at a time, in id order; `None` where none are known.
    pub fn at(&self, time_s: f64) -> Option<Vec<ControlDecision>> {
        let told = &self.lock().told;
        let first = told.partition_point(|(told_s, _)| *told_s < time_s - HeldDecisions::HOLD_S);
        let end = told.partition_point(|(told_s, _)| *told_s <= time_s);
        let mut held = HeldDecisions::default();
        told.range(first..end.max(first)).for_each(|(told_s, decision)| _ = held.take(*told_s, *decision));
        held.at(time_s)
    }
}

/// Samples the decisions of moments into a feed.
#[derive(Debug, Default)]
pub(super) struct DecisionCollector {
    feed: DecisionFeed,
    sampler: DecisionSampler,
}

impl DecisionCollector {
    /// The decisions of the present run.
    pub(super) fn feed(&self) -> DecisionFeed {
        self.feed.clone()
    }

    /// Takes the decisions of a moment that are due.
    pub(super) fn take(&mut self, moment: &Moment<'_>) {
        let due = self.sampler.of_moment(moment);
        if !due.is_empty() {
            self.feed.extend(moment.snapshot.time_s, due);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use city3d_protocol::snapshot::VehicleId;

    #[test]
    fn what_held_at_a_time_is_known_later_and_nothing_that_came_after() {
        let feed = DecisionFeed::default();
        let of = |vehicle, target_mps| ControlDecision {
            vehicle: VehicleId(vehicle),
            target_mps,
            ..ControlDecision::default()
        };
        feed.extend(1.0, vec![of(1, 1.0), of(2, 2.0)]);
        feed.extend(1.5, vec![of(1, 3.0)]);
        let targets = |time_s| {
            feed.at(time_s).map(|held| held.iter().map(|d| (d.vehicle.0, d.target_mps)).collect::<Vec<_>>())
        };
        assert_eq!(targets(0.9), None);
        assert_eq!(targets(1.2), Some(vec![(1, 1.0), (2, 2.0)]));
        assert_eq!(targets(2.0), Some(vec![(1, 3.0), (2, 2.0)]));
        assert_eq!(targets(2.3), Some(vec![(1, 3.0)]), "that of vehicle 2 is too old");
        assert_eq!(targets(9.0), None);
    }
}
