//! Send-on-delta sampling of decisions: what logs and the link tell of them.

use super::send_on_delta::{SampleStep, SampleTimer, SendOnDelta};
use super::{Moment, decisions};
use city3d_protocol::snapshot::{ControlDecision, DecisionReason, VehicleId};

/// A decision is told again after this time although nothing has changed, simulated seconds.
const REFRESH_INTERVAL_S: f64 = 0.5;

/// Picks the decisions that are due: those of vehicles whose reason or other vehicle has changed, at once, and the others
/// twice a second.
#[derive(Debug)]
pub(crate) struct DecisionSampler {
    timer: SampleTimer,
    vehicles: SendOnDelta<VehicleId, (DecisionReason, Option<VehicleId>)>,
}

impl Default for DecisionSampler {
    fn default() -> Self {
        Self { timer: SampleTimer::default(), vehicles: SendOnDelta::refreshed_after(REFRESH_INTERVAL_S) }
    }
}

impl DecisionSampler {
    /// The decisions that are due at a time, each without what does not last; `now` gives all of them where they are
    /// looked at.
    pub fn sample(
        &mut self,
        time_s: f64,
        now: impl FnOnce() -> Option<Vec<ControlDecision>>,
    ) -> Vec<ControlDecision> {
        match self.timer.step(time_s) {
            SampleStep::Wait => return Vec::new(),
            SampleStep::Look => {}
            SampleStep::Restart => self.vehicles.restart(),
        }
        let mut due = now().unwrap_or_default();
        self.vehicles
            .pick(time_s, &mut due, |decision| (decision.vehicle, (decision.reason, decision.other)));
        due.into_iter().map(ControlDecision::lasting).collect()
    }

    /// The decisions that are due at a moment: of the control framework in this process, or as one elsewhere has told them.
    pub fn of_moment(&mut self, moment: &Moment<'_>) -> Vec<ControlDecision> {
        let time_s = moment.snapshot.time_s;
        self.sample(time_s, || match moment.mainframe {
            Some(mainframe) => Some(decisions(mainframe, moment.experiment)),
            None => moment.heard?.decisions.at(time_s),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(reason: DecisionReason, other: Option<u32>) -> ControlDecision {
        let other = other.map(VehicleId);
        ControlDecision { vehicle: VehicleId(1), reason, other, ..ControlDecision::default() }
    }

    /// What is due of a vehicle at each tick of 0.01 s, with the times.
    fn due(
        sampler: &mut DecisionSampler,
        ticks: std::ops::Range<u32>,
        decision: ControlDecision,
    ) -> Vec<f64> {
        let time_s = |tick: u32| f64::from(tick) / 100.0;
        ticks
            .filter(|tick| !sampler.sample(time_s(*tick), || Some(vec![decision])).is_empty())
            .map(time_s)
            .collect()
    }

    #[test]
    fn what_stays_is_told_twice_a_second_and_what_changes_at_once() {
        let mut sampler = DecisionSampler::default();
        let (free, yields) = (of(DecisionReason::FreeRoad, None), of(DecisionReason::YieldLine, Some(2)));
        assert_eq!(due(&mut sampler, 0..121, free), [0.0, 0.5, 1.0]);
        assert_eq!(due(&mut sampler, 121..150, yields), [1.3]);
        let to_another = of(DecisionReason::YieldLine, Some(3));
        assert_eq!(due(&mut sampler, 150..191, to_another), [1.5]);
    }

    #[test]
    fn after_a_reset_all_is_told_again() {
        let mut sampler = DecisionSampler::default();
        let free = of(DecisionReason::FreeRoad, None);
        assert_eq!(due(&mut sampler, 900..920, free), [9.0]);
        assert_eq!(due(&mut sampler, 0..20, free), [0.0]);
    }

    #[test]
    fn who_comes_back_is_told_at_once_and_nothing_is_kept_of_who_has_left() {
        let mut sampler = DecisionSampler::default();
        let free = of(DecisionReason::FreeRoad, None);
        due(&mut sampler, 0..10, free);
        (10..100).for_each(|tick| assert!(sampler.sample(f64::from(tick) / 100.0, || None).is_empty()));
        assert!(sampler.vehicles.is_empty());
        assert_eq!(due(&mut sampler, 100..110, free), [1.0]);
    }
}
