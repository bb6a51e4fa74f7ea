//! Send-on-delta sampling (report by exception, with a refresh): what logs and the link tell of what the control framework
//! decides and plans.

use std::collections::BTreeMap;

/// Interval at which things are looked at, simulated seconds: they may change with every control step and back.
const SAMPLE_INTERVAL_S: f64 = 0.1;
/// Rounding error of times.
const ROUNDING_S: f64 = 1e-6;

/// Says when to look, ten times a second.
#[derive(Debug, Default)]
pub(crate) struct SampleTimer {
    sampled_s: Option<f64>,
}

/// What is to be done at a time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum SampleStep {
    /// Nothing.
    Wait,
    /// To look again.
    Look,
    /// To look, and to tell everything: the clock was reset.
    Restart,
}

impl SampleTimer {
    pub fn step(&mut self, time_s: f64) -> SampleStep {
        let step = match self.sampled_s {
            Some(before_s) if time_s < before_s => SampleStep::Restart,
            Some(before_s) if time_s - before_s < SAMPLE_INTERVAL_S - ROUNDING_S => return SampleStep::Wait,
            _ => SampleStep::Look,
        };
        self.sampled_s = Some(time_s);
        step
    }
}

/// Picks the things that are due: those that have changed, at once, and the others at intervals, so that numbers stay up to
/// date, and who comes later hears of them.
#[derive(Debug)]
pub(crate) struct SendOnDelta<K, W> {
    /// A thing is told again after this time although nothing has changed, simulated seconds.
    refresh_s: f64,
    /// What was told last of each thing, and when.
    told: BTreeMap<K, (f64, W)>,
}

impl<K: Ord + Copy, W: PartialEq> SendOnDelta<K, W> {
    pub fn refreshed_after(refresh_s: f64) -> Self {
        Self { refresh_s, told: BTreeMap::new() }
    }

    /// Tells everything anew.
    pub fn restart(&mut self) {
        self.told.clear();
    }

    /// Leaves in a list what is due at a time; `mark` gives the key of a thing and what counts as a change of it. Returns the
    /// keys of things that are gone since the last time.
    pub fn pick<T>(&mut self, time_s: f64, things: &mut Vec<T>, mark: impl Fn(&T) -> (K, W)) -> Vec<K> {
        let mut before = std::mem::take(&mut self.told);
        let limit_s = self.refresh_s - ROUNDING_S;
        things.retain(|thing| {
            let (key, what) = mark(thing);
            let known = before.remove(&key).filter(|(at_s, told)| *told == what && time_s - at_s <= limit_s);
            let is_due = known.is_none();
            self.told.insert(key, known.unwrap_or((time_s, what)));
            is_due
        });
        before.into_keys().collect()
    }

    #[cfg(test)]
    pub fn is_empty(&self) -> bool {
        self.told.is_empty()
    }
}
