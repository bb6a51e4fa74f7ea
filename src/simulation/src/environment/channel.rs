//! Delay queue: delivers each item at its own time.

/// Queue of items in transit, ordered by arrival time; equal times keep the order of sending. Jitter reorders items as
/// UDP does.
#[derive(Clone, Debug)]
pub struct DelayQueue<T> {
    in_transit: Vec<(f64, T)>,
}

impl<T> Default for DelayQueue<T> {
    fn default() -> Self {
        Self { in_transit: Vec::new() }
    }
}

/// Tolerance for the rounding of arrival times, which are sums of tick times and delays.
const ROUNDING_S: f64 = 1e-9;

impl<T> DelayQueue<T> {
    /// Sends an item that arrives at `at_s`.
    pub fn send(&mut self, at_s: f64, item: T) {
        // Most items come after all others.
        if self.in_transit.last().is_none_or(|(last_s, _)| *last_s <= at_s) {
            self.in_transit.push((at_s, item));
            return;
        }
        let place = self.in_transit.partition_point(|(other_s, _)| *other_s <= at_s);
        self.in_transit.insert(place, (at_s, item));
    }

    /// Moves everything that has arrived by `now_s` to the end of `arrived`.
    pub fn receive(&mut self, now_s: f64, arrived: &mut Vec<T>) {
        let count = self.in_transit.partition_point(|(at_s, _)| *at_s <= now_s + ROUNDING_S);
        arrived.extend(self.in_transit.drain(..count).map(|(_, item)| item));
    }
}
