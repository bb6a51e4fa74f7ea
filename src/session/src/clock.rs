//! Simulated time against the clock: speeds, the pacing clock, and the real-time factor as measured.

use serde::{Deserialize, Serialize};
use std::time::{Duration, Instant};

/// Target speed: simulated seconds per second.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Speed {
    /// Multiple of real time; [`Speed::sane`] clamps it to the permitted range.
    Times(f64),
    /// As fast as the machine can.
    Unlimited,
}

impl Default for Speed {
    fn default() -> Self {
        Self::Times(1.0)
    }
}

impl Speed {
    /// Smallest permitted multiple of real time.
    pub const SLOWEST: f64 = 0.1;
    /// Largest permitted multiple of real time.
    pub const FASTEST: f64 = 100.0;

    /// The speed clamped to the permitted range.
    pub fn sane(self) -> Self {
        match self {
            Self::Times(factor) => Self::times(factor),
            Self::Unlimited => self,
        }
    }

    /// A factor clamped to the permitted range.
    pub fn times(factor: f64) -> Self {
        Self::Times(if factor.is_finite() { factor.clamp(Self::SLOWEST, Self::FASTEST) } else { 1.0 })
    }
}

/// A pacing clock: maps the monotonic wall clock to simulated time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PacingClock {
    since: Instant,
    from_s: f64,
    factor: f64,
}

/// A run this far behind its clock lets the lost time go instead of hurrying after it.
const MOST_BEHIND: Duration = Duration::from_millis(100);

impl PacingClock {
    /// Shows `from_s` now and goes on `factor` times as fast as the machine's.
    pub fn new(now: Instant, from_s: f64, factor: f64) -> Self {
        Self { since: now, from_s, factor }
    }

    /// Simulated time that the clock shows at an instant, seconds.
    pub fn simulated_s(&self, now: Instant) -> f64 {
        self.from_s + now.saturating_duration_since(self.since).as_secs_f64() * self.factor
    }

    /// When it shows a time.
    pub fn at(&self, time_s: f64) -> Instant {
        let left_s = (time_s - self.from_s) / self.factor;
        self.since + Duration::try_from_secs_f64(left_s.max(0.0)).unwrap_or_default()
    }

    /// From now until it shows a time; nothing when it does already.
    pub fn until(&self, now: Instant, time_s: f64) -> Duration {
        let left_s = (time_s - self.simulated_s(now)) / self.factor;
        Duration::try_from_secs_f64(left_s.max(0.0)).unwrap_or_default()
    }

    /// Goes back to where the run is when that is too far behind.
    pub fn resync(&mut self, now: Instant, time_s: f64) {
        let behind_s = (self.simulated_s(now) - time_s) / self.factor;
        if behind_s > MOST_BEHIND.as_secs_f64() {
            *self = Self::new(now, time_s, self.factor);
        }
    }
}

/// Measures the real-time factor: simulated seconds per wall-clock second.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RealTimeFactorMeter {
    since: Instant,
    from_s: f64,
    factor: f64,
}

const METER_WINDOW: Duration = Duration::from_millis(500);

impl RealTimeFactorMeter {
    pub(crate) fn new(now: Instant, time_s: f64) -> Self {
        Self { since: now, from_s: time_s, factor: 0.0 }
    }

    /// Records the simulated time that the run has reached.
    pub(crate) fn record(&mut self, now: Instant, time_s: f64) {
        let passed = now.saturating_duration_since(self.since);
        if passed >= METER_WINDOW {
            let factor = (time_s - self.from_s) / passed.as_secs_f64();
            *self = Self { since: now, from_s: time_s, factor };
        }
    }

    pub(crate) fn factor(&self) -> f64 {
        self.factor
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_clock_goes_by_its_factor() {
        let now = Instant::now();
        let clock = PacingClock::new(now, 10.0, 0.5);
        assert_eq!(clock.simulated_s(now + Duration::from_secs(4)), 12.0);
        assert_eq!(clock.until(now, 11.0), Duration::from_secs(2));
        assert_eq!(clock.until(now + Duration::from_secs(9), 11.0), Duration::ZERO);
    }

    #[test]
    fn a_run_far_behind_lets_the_lost_time_go_and_a_little_one_is_made_good() {
        let now = Instant::now();
        let mut clock = PacingClock::new(now, 0.0, 2.0);
        let later = now + Duration::from_secs(1);
        clock.resync(later, 1.9);
        assert_eq!(clock.simulated_s(later), 2.0);
        clock.resync(later, 0.5);
        assert_eq!(clock.simulated_s(later), 0.5);
    }

    #[test]
    fn speeds_stay_within_what_is_offered() {
        assert_eq!(Speed::times(0.0), Speed::Times(0.1));
        assert_eq!(Speed::times(f64::NAN), Speed::Times(1.0));
        assert_eq!(Speed::times(3.0), Speed::Times(3.0));
    }
}
