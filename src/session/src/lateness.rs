//! How late the ticks of a city begin that is paced by a clock.

use city3d_simulation::runner::TickLateness;
use std::time::Duration;

/// Width of the first classes, and that of the others.
const FINE_US: usize = 10;
const COARSE_US: usize = 1000;
/// Latenesses below this are in the first classes, 20 ms; the last class has all from a second on.
const FINE: usize = 2000;
const COARSE: usize = 1000;

/// Counts latenesses in classes, so that a city may run for weeks.
#[derive(Clone, Debug)]
pub(crate) struct LatenessHistogram {
    counts: Box<[u64]>,
    most: Duration,
}

impl Default for LatenessHistogram {
    fn default() -> Self {
        Self { counts: vec![0; FINE + COARSE].into(), most: Duration::ZERO }
    }
}

impl LatenessHistogram {
    /// A tick has begun so late.
    pub(crate) fn take(&mut self, late: Duration) {
        let late_us = late.as_micros() as usize;
        let class = match late_us / FINE_US {
            fine if fine < FINE => fine,
            _ => (FINE + late_us / COARSE_US - FINE * FINE_US / COARSE_US).min(FINE + COARSE - 1),
        };
        self.counts[class] += 1;
        self.most = self.most.max(late);
    }

    /// What it comes to; `None` before the first tick.
    pub(crate) fn summary(&self) -> Option<TickLateness> {
        let ticks: u64 = self.counts.iter().sum();
        let quantile_ms = |part: f64| {
            let wanted = ((ticks as f64 * part).ceil() as u64).max(1);
            let mut sum = 0;
            let class = self.counts.iter().position(|count| {
                sum += count;
                sum >= wanted
            })?;
            // The upper end of the class, and no more than there was.
            let end_us = match class {
                fine if fine < FINE => (fine + 1) * FINE_US,
                coarse => FINE * FINE_US + (coarse - FINE + 1) * COARSE_US,
            };
            Some((end_us as f64 / 1e3).min(self.most.as_secs_f64() * 1e3))
        };
        Some(TickLateness {
            ticks,
            p50_ms: quantile_ms(0.5).filter(|_| ticks > 0)?,
            p99_ms: quantile_ms(0.99)?,
            max_ms: self.most.as_secs_f64() * 1e3,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_the_latenesses_within_a_class() {
        let mut histogram = LatenessHistogram::default();
        assert_eq!(histogram.summary(), None);
        (1..=1000).for_each(|k| histogram.take(Duration::from_micros(k * 30)));
        let found = histogram.summary().unwrap();
        assert_eq!((found.ticks, found.max_ms), (1000, 30.0));
        assert!((found.p50_ms - 15.0).abs() <= 0.011, "{found:?}");
        assert!((found.p99_ms - 29.7).abs() <= 1.0, "{found:?}");
        histogram.take(Duration::from_secs(9));
        assert_eq!(histogram.summary().unwrap().max_ms, 9000.0);
    }
}
