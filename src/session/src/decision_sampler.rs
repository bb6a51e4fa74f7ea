//! Send-on-delta sampling of decisions (report by exception, with a refresh): what logs and the link tell of them.

use super::{Moment, decisions};
use city3d_protocol::snapshot::{ControlDecision, DecisionReason, VehicleId};
use std::collections::BTreeMap;

/// Interval at which decisions are looked at, simulated seconds: reasons may change with every control step and back.
const SAMPLE_INTERVAL_S: f64 = 0.1;
/// A decision is told again after this time although nothing has changed, simulated seconds: numbers stay up to date, and
/// who comes later hears of it.
const REFRESH_INTERVAL_S: f64 = 0.5;
/// Rounding error of times.
const ROUNDING_S: f64 = 1e-6;

/// Picks the decisions that are due: those of vehicles whose reason or other vehicle has changed, at once, and the others
/// twice a second.
#[derive(Debug, Default)]
pub(crate) struct DecisionSampler {
    /// When decisions were looked at last.
    sampled_s: Option<f64>,
    /// What was told last of each vehicle.
    told: BTreeMap<VehicleId, Told>,
}

#[derive(Clone, Copy, Debug)]
struct Told {
    at_s: f64,
    what: (DecisionReason, Option<VehicleId>),
}

impl DecisionSampler {
    /// The decisions that are due at a time, each without what does not last; `now` gives all of them where they are
    /// looked at.
    pub fn sample(
        &mut self,
        time_s: f64,
        now: impl FnOnce() -> Option<Vec<ControlDecision>>,
    ) -> Vec<ControlDecision> {
        match self.sampled_s {
            // The clock was reset.
            Some(before_s) if time_s < before_s => self.told.clear(),
            Some(before_s) if time_s - before_s < SAMPLE_INTERVAL_S - ROUNDING_S => return Vec::new(),
            _ => {}
        }
        self.sampled_s = Some(time_s);
        let is_old = |told: &Told| time_s - told.at_s > REFRESH_INTERVAL_S - ROUNDING_S;
        let mut due = now().unwrap_or_default();
        due.retain(|decision| {
            let what = (decision.reason, decision.other);
            let is_told = |told: &Told| told.what == what && !is_old(told);
            let is_due = !self.told.get(&decision.vehicle).is_some_and(is_told);
            if is_due {
                self.told.insert(decision.vehicle, Told { at_s: time_s, what });
            }
            is_due
        });
        // Those that are old still are of vehicles that have left.
        self.told.retain(|_, told| !is_old(told));
        due.into_iter().map(ControlDecision::lasting).collect()
    }

    /// The decisions that are due at a moment: of the control framework in this process, or as one elsewhere has told them.
    pub fn of_moment(&mut self, moment: &Moment<'_>) -> Vec<ControlDecision> {
        let time_s = moment.snapshot.time_s;
        self.sample(time_s, || match moment.mainframe {
            Some(mainframe) => Some(decisions(mainframe, moment.experiment)),
            None => moment.told_decisions?.at(time_s),
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
        assert!(sampler.told.is_empty());
        assert_eq!(due(&mut sampler, 100..110, free), [1.0]);
    }
}
